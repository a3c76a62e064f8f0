"""``bayes-asv track`` from the shell: what it prints and writes, and when it refuses."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bayes_asv.domain.recording import Recording
from bayes_asv.io import read_recording, write_recording
from bayes_asv.report.schema import read_saved
from tests.cli.conftest import ROOT, Check, Command

UNITS = {"c_f": "lbf*s/in", "c_r": "lbf*s/in", "i": "lbf*s^2*in", "k_g": "in"}


def _truth(recording: Path) -> dict[str, float]:
    text = recording.with_suffix("").with_suffix(".truth.json").read_text(encoding="utf-8")
    found: dict[str, float] = json.loads(text)["parameters"]["US"]
    return found


@pytest.fixture(scope="module")
def told(
    invoke: Command, bump: Path, baja: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, dict[str, Any], Path]:
    """One track with every output there is."""
    folder = tmp_path_factory.mktemp("track")
    said = invoke(
        "track", bump, "-v", baja, "--json", folder / "t.json", "--trace", folder / "t.csv",
        "--seed", 7,
    )  # fmt: skip
    assert said.status == 0
    assert said.err == ""
    return said.out, json.loads((folder / "t.json").read_text(encoding="utf-8")), folder


def test_it_says_the_verdict(told: tuple[str, dict[str, Any], Path]) -> None:
    lines = told[0].splitlines()
    assert lines[0] == "Front damper: 20 % softer than nominal. Rear damper: agrees with nominal."
    assert any("The filter is consistent" in line for line in lines)


def test_the_document_keeps_to_its_schema(
    told: tuple[str, dict[str, Any], Path], bump: Path
) -> None:
    document = told[1]
    assert document["schema"] == "bayes_asv/track/1"
    assert document["verdict"] == "ok"
    assert document["reasons"] == document["warnings"] == []
    truth = _truth(bump)
    for name, unit in UNITS.items():
        p = document["parameters"][name]
        assert p["unit"] == unit
        low, high = p["eti95"]
        assert low < p["median"] <= p["mean"] < high
        assert low < truth[name] < high
        assert 0.0 <= p["p_below_nominal"] <= 1.0
        assert p["si"]["mean"] > 0.0
    found = document["consistency"]
    low, high = found["nis_band95"]
    assert low < found["nis_mean"] < high
    assert found["verdict"] == "consistent"
    assert document["trace"].endswith("t.csv")
    assert document["seed"] == 7


def test_the_trace_has_a_row_for_each_row(
    told: tuple[str, dict[str, Any], Path], bump: Path
) -> None:
    with open(told[2] / "t.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    recording = read_recording(bump)
    assert len(rows) == len(recording.time)
    assert list(rows[0])[:7] == [
        "time [s]", "c_f mean", "c_f sd", "c_r mean", "c_r sd", "i mean", "i sd",
    ]  # fmt: skip
    time = [float(row["time [s]"]) for row in rows]
    np.testing.assert_allclose(time, recording.time, atol=1e-6)
    for name in ("c_f", "c_r", "i"):
        last = told[1]["parameters"][name]
        assert float(rows[-1][f"{name} mean"]) == pytest.approx(last["mean"], rel=1e-6)
        assert float(rows[-1][f"{name} sd"]) == pytest.approx(last["sd"], rel=1e-6)
        widths = [float(row[f"{name} sd"]) for row in rows]
        assert widths[0] > 20.0 * widths[-1]


def test_the_answer_is_that_of_estimate(told: tuple[str, dict[str, Any], Path], saved: Any) -> None:
    """Another drive of the same car: the intervals of both have to meet."""
    for name in UNITS:
        one, two = told[1]["parameters"][name], saved.document["parameters"][name]
        apart = abs(one["mean"] - two["mean"])
        assert apart < 2.0 * (one["sd"] + two["sd"])


def test_a_saved_track_is_read_again_and_reported(
    told: tuple[str, dict[str, Any], Path], invoke: Command, tmp_path: Path
) -> None:
    saved = told[2] / "t.json"
    assert read_saved(saved).to_dict() == told[1]
    for suffix in ("html", "pdf"):
        said = invoke("report", "--from", saved, "-o", tmp_path / f"x.{suffix}")
        assert said.status == 0, said.err
    page = (tmp_path / "x.html").read_text(encoding="utf-8")
    assert "Parameters from the online filter" in page
    assert "Consistency of the filter" in page


def test_both_engines_print_the_same(
    invoke: Command, baja: Path, bump: Path, tmp_path: Path
) -> None:
    recording = read_recording(bump)
    part = Recording(
        recording.time[:280], recording.values[:, :280], recording.units, source="part.csv"
    )
    write_recording(part, tmp_path / "part.csv")
    said = [
        invoke("track", tmp_path / "part.csv", "-v", baja, "--engine", engine)
        for engine in ("compiled", "filterpy")
    ]
    assert said[0] == said[1]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ((), ("either a recording or --port",)),
        (("REC", "--forget", "0"), ("--forget",)),
        (("REC", "--engine", "steam"), ("steam",)),
        (("REC", "--trace", "/nowhere/x.csv"), ("its folder does not exist",)),
        (("none.csv",), ("no such file",)),
        (("REC", "--rate", "nan"), ()),
    ],
)
def test_what_cannot_be_is_said_in_one_line(
    invoke: Command,
    refuse: Check,
    baja: Path,
    bump: Path,
    words: tuple[str, ...],
    expected: tuple[str, ...],
) -> None:
    given = [bump if word == "REC" else word for word in words]
    said = invoke("track", *given, "-v", baja)
    if words and words[-1] == "nan":  # the recording has stamps of its own
        assert said.status in (0, 2)
        return
    assert refuse(said, *expected)


def test_a_parked_car_is_refused(invoke: Command, baja: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    time = np.arange(800) / 400.0
    parked = Recording(time, 0.02 * rng.normal(size=(4, 800)), ("m/s^2",) * 4, source="p.csv")
    write_recording(parked, tmp_path / "p.csv")
    said = invoke("track", tmp_path / "p.csv", "-v", baja, "--json", tmp_path / "p.json")
    assert said.status == 3
    document = json.loads((tmp_path / "p.json").read_text(encoding="utf-8"))
    assert document["verdict"] == "refused"
    assert any("hardly moved" in reason for reason in document["reasons"])
    assert read_saved(tmp_path / "p.json").to_dict() == document
    told = invoke("report", "--from", tmp_path / "p.json", "-o", tmp_path / "p.html")
    assert told.status == 3


def test_json_on_standard_output_is_all_that_is_there(
    invoke: Command, bump: Path, baja: Path
) -> None:
    said = invoke("track", bump, "-v", baja, "--json", "-")
    assert json.loads(said.out)["verdict"] == "ok"
    assert "damper" in said.err


def test_counts_with_uncertain_scales(invoke: Command, tmp_path: Path, baja: Path) -> None:
    text = baja.read_text(encoding="utf-8")
    assert "counts_scale" in text
    said = invoke("track", ROOT / "data" / "recordings" / "stops-800hz.csv", "-v", baja)
    assert said.status == 0
    assert "20 % softer" in said.out


@pytest.mark.usefixtures("without_input_search")
def test_where_the_filter_is_not_consistent_nothing_is_claimed(
    invoke: Command, baja: Path, tmp_path: Path
) -> None:
    """A damper whose bound and rebound differ: figures without probabilities, and what to do."""
    valved = ROOT / "data" / "recordings" / "valved-stops-400hz.csv"
    said = invoke("track", valved, "-v", baja, "--json", tmp_path / "t.json")
    assert said.status == 0
    lines = said.sentences
    assert lines[0].startswith("Not to be relied on")
    assert not any("certain" in line or "95 %:" in line for line in lines)
    assert lines[-2].startswith("Next: ")
    said = invoke("report", "--from", tmp_path / "t.json", "-o", tmp_path / "t.html")
    assert said.out.startswith("Not to be relied on")
    page = (tmp_path / "t.html").read_text(encoding="utf-8")
    assert page.count("<strong>not to be relied on</strong>") == 4
    assert "oil, seals" not in page
    bump = ROOT / "data" / "recordings" / "valved-bump-400hz.csv"
    for command, status, words in (
        ("track", 0, "Not to be relied on"),
        ("watch", 3, "Cannot tell whether a damper is worn."),
    ):
        said = invoke(command, bump, "-v", baja)
        assert said.status == status
        assert said.out.startswith(words)
        assert "faster or over a higher one" not in said.out


@pytest.mark.parametrize("name", ["x.mp4", "x", "gif"])
def test_an_animation_under_another_name_is_refused_before_the_work(
    invoke: Command, refuse: Check, bump: Path, baja: Path, tmp_path: Path, name: str
) -> None:
    said = invoke("track", bump, "-v", baja, "--gif", tmp_path / name)
    assert refuse(said, name, "an animation is a GIF", "end the name in .gif")
    assert list(tmp_path.iterdir()) == []
