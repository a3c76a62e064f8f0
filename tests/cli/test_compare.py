"""``bayes-asv compare`` on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Check, Command


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


def test_a_change_is_found(invoke: Command, baja: Path, drives: tuple[Path, Path]) -> None:
    sound, worn = drives
    said = invoke("compare", sound, "--with", worn, "-v", baja, "--json", "-")
    assert said.status == 0
    document = json.loads(said.out)
    assert (document["schema"], document["verdict"]) == ("bayes_asv/compare/1", "changed")
    low, high = document["changes"]["c_f"]["eti95"]
    assert low < 0.95 < high
    assert said.err.startswith("Changed: front damping rate (p < 0.001).\n")


def test_wrong_usage_is_one_line(
    invoke: Command, refuse: Check, baja: Path, drives: tuple[Path, Path]
) -> None:
    sound, worn = drives
    assert refuse(invoke("compare", sound, "-v", baja), "--with")
    assert refuse(invoke("compare", sound, "--with", sound, "-v", baja), "each recording once")
    assert refuse(invoke("compare", sound, "--with", worn), "--vehicle")
    assert refuse(invoke("compare", sound, "--with", worn, "-v", baja, "--json", worn), "replaced")


def test_recordings_that_cannot_answer(
    invoke: Command, baja: Path, drives: tuple[Path, Path], tmp_path: Path
) -> None:
    sound, worn = drives
    short = tmp_path / "short.csv"
    short.write_text("".join(worn.read_text("utf-8").splitlines(keepends=True)[:80]), "utf-8")
    said = invoke("compare", sound, "--with", short, "-v", baja, "--json", tmp_path / "c.json")
    assert said.status == 3
    assert "Why: the estimate after is refused" in said.out
    document = json.loads((tmp_path / "c.json").read_text("utf-8"))
    assert document["verdict"] == "refused"
    assert "too short" in document["reasons"][0]
