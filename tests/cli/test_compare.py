"""``bayes-asv compare`` on the command line."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.cli.conftest import ROOT, Check, Command, Said


@pytest.fixture(scope="module")
def drives(
    invoke: Command, baja: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Path]:
    """Simulate the car as it was, and with a front damper that lost a twentieth."""
    folder = tmp_path_factory.mktemp("drives")
    sound, worn = folder / "sound.csv", folder / "worn.csv"
    assert invoke("simulate", "-v", baja, "-o", sound, "--seed", 1).status == 0
    said = invoke("simulate", "-v", baja, "-o", worn, "--set", "c_f=0.95", "--seed", 2)
    assert said.status == 0
    return sound, worn


@pytest.fixture(scope="module")
def compared(invoke: Command, baja: Path, drives: tuple[Path, Path]) -> tuple[Said, Path]:
    """Compare them, with every output there is."""
    sound, worn = drives
    json_file = sound.parent / "changes.json"
    page = sound.parent / "changes.html"
    said = invoke("compare", sound, "--with", worn, "-v", baja, "--json", json_file, "-o", page)
    return said, json_file


def test_a_change_is_found(compared: tuple[Said, Path]) -> None:
    said, json_file = compared
    assert (said.status, said.err) == (0, "")
    document = json.loads(json_file.read_text("utf-8"))
    assert (document["schema"], document["verdict"]) == ("bayes_asv/compare/1", "changed")
    low, high = document["changes"]["c_f"]["eti95"]
    assert low < 0.95 < high
    assert document["changes"]["c_f"]["p_changed"] > 0.999
    assert said.out.startswith("Changed: the front damper (p < 0.001).\n\n")
    assert re.search(r"\nFront damper +−\S+ % −\S+ to −\S+ % ▼ softer +> 99.9 %\n", said.out)
    assert said.out.endswith(f"{json_file.with_suffix('.html')}\n")


def test_a_saved_comparison_becomes_a_page(
    invoke: Command, refuse: Check, compared: tuple[Said, Path], drives: tuple[Path, Path],
    baja: Path, tmp_path: Path,
) -> None:  # fmt: skip
    _, json_file = compared
    page = tmp_path / "again.html"
    said = invoke("report", "--from", json_file, "-o", page)
    assert said.status == 0
    assert said.out.startswith("Front damper: ")
    assert page.read_bytes() == json_file.with_suffix(".html").read_bytes()
    said = invoke("report", drives[0], "-v", baja, "--from", json_file, "-o", page)
    assert refuse(said, "changes.json", "give no others beside it")
    document = json.loads(json_file.read_text("utf-8"))
    document["changes"]["c_f"]["ratio"] = 2.0
    broken = tmp_path / "broken.json"
    broken.write_text(json.dumps(document), "utf-8")
    said = invoke("report", "--from", broken, "-o", page)
    assert refuse(said, "broken.json: changes.c_f", "the ratio is not inside its interval")


@pytest.mark.parametrize("car", ["quarter-rear"])
def test_other_cars_are_compared(
    invoke: Command, baja: Path, drives: tuple[Path, Path], car: str
) -> None:
    sound, worn = drives
    said = invoke("compare", sound, "--with", worn, "-v", baja, "--car", car, "--json", "-")
    document = json.loads(said.out)
    assert list(document["changes"]) == ["c_r"]
    assert document["before"]["car"] == car


def test_effects_belong_to_each_session(invoke: Command, baja: Path) -> None:
    bump, stops = (
        ROOT / "data" / "recordings" / f"valved-{road}-400hz.csv" for road in ("bump", "stops")
    )
    effect = "bound_rebound@front"
    said = invoke(
        "compare", bump, "--with", stops, "-v", baja, "--with-effect", effect, "--json", "-"
    )
    document = json.loads(said.out)
    assert (said.status, document["verdict"]) == (0, "consistent")
    for side in ("before", "after"):
        (found,) = document[side]["effects"]
        assert found["parameters"]["ratio"]["mean"] == pytest.approx(1.478, abs=0.01)
        assert document[side]["forces"]["front"]["force_unit"] == "lbf"
    lines = " ".join(said.err.split())
    assert "Unequal compression and rebound damping at the front axle, ratio: 1.47" in lines


def test_wrong_usage_is_one_line(
    invoke: Command, refuse: Check, baja: Path, drives: tuple[Path, Path], tmp_path: Path
) -> None:
    sound, worn = drives
    assert refuse(invoke("compare", sound, "-v", baja), "--with")
    assert refuse(invoke("compare", sound, "--with", sound, "-v", baja), "each recording once")
    assert refuse(invoke("compare", sound, "--with", worn), "--vehicle")
    both = ("compare", sound, "--with", worn, "-v", baja)
    assert refuse(invoke(*both, "--json", worn), "replaced")
    assert refuse(invoke(*both, "-o", tmp_path / "x.txt"), "end the name in .html or .pdf")
    assert refuse(invoke(*both, "--vehicle-after", tmp_path / "no.toml"), "no.toml")
    assert refuse(invoke(*both, "--with-effect", "spring_rate@front"), "larger sd")
    assert refuse(invoke(*both, "--with-effect", "rust@front"), "is not an effect")
    said = invoke(*both, "--with-effect", "bound_rebound@front", "--below", 20)
    assert refuse(said, "leave out --below")


def test_recordings_that_cannot_answer(
    invoke: Command, baja: Path, drives: tuple[Path, Path], tmp_path: Path
) -> None:
    sound, worn = drives
    short = tmp_path / "short.csv"
    lines = worn.read_text("utf-8").splitlines(keepends=True)
    head = next(n for n, line in enumerate(lines) if line.startswith("time")) + 1
    short.write_text("".join([*lines[:head], *lines[head + 200 : head + 280]]), "utf-8")
    page = tmp_path / "c.html"
    said = invoke(
        "compare", sound, "--with", short, "-v", baja, "--json", tmp_path / "c.json", "-o", page
    )
    assert said.status == 3
    assert "Why: the estimate after is refused" in said.out
    document = json.loads((tmp_path / "c.json").read_text("utf-8"))
    assert document["verdict"] == "refused"
    assert "too short" in document["reasons"][0]
    assert "too short" in page.read_text("utf-8")
