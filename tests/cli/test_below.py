"""``--below`` from the shell: what it says, what it writes, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Check, Command, Saved


def test_the_band_is_told_and_the_answer_is_that_of_the_whole(
    invoke: Command, stops: Path, baja: Path, saved: Saved, tmp_path: Path
) -> None:
    file = tmp_path / "band.json"
    said = invoke("estimate", stops, "-v", baja, "--below", 12, "--json", file)
    assert said.status == 0
    assert "Note: only the motion below 12 Hz was used." in said.out.splitlines()
    document = json.loads(file.read_text(encoding="utf-8"))
    assert document["diagnostics"]["band"] == [0.0, 12.0]
    assert saved.document["diagnostics"]["band"] is None
    for name in ("c_f", "c_r", "i"):
        band, whole = (d["parameters"][name] for d in (document, saved.document))
        assert abs(band["mean"] - whole["mean"]) < 0.5 * whole["sd"]
        assert band["sd"] == pytest.approx(whole["sd"], rel=0.2)  # the mass rules both
    for chassis in document["runs"][0]["chassis"].values():
        assert chassis["lag_seconds"] == pytest.approx(1.0 / 25.0)  # two a period, of 400 Hz rows
        assert max(chassis["spectrum"]["frequency"]) <= 12.5


def test_a_band_that_leaves_out_the_car_is_refused(
    invoke: Command, refuse: Check, stops: Path, baja: Path
) -> None:
    said = invoke("estimate", stops, "-v", baja, "--below", 2)
    assert refuse(said, "--below 2", "moves at up to 3 Hz", "give at least 3.6")
    assert refuse(invoke("estimate", stops, "-v", baja, "--below", -5), "--below")
    assert refuse(invoke("estimate", stops, "-v", baja, "--below", "nan"), "--below")


def test_a_record_that_the_filter_eats_up_cannot_answer(
    invoke: Command, stops: Path, baja: Path
) -> None:
    said = invoke("estimate", stops, "-v", baja, "--below", 5)
    assert said.status == 3
    assert "too short for the motion below 5 Hz alone" in said.out


def test_a_band_near_the_sampling_rate(
    invoke: Command, refuse: Check, stops: Path, baja: Path, saved: Saved, tmp_path: Path
) -> None:
    """An eighth of its period is shorter than a row, which is no gap for that."""
    file = tmp_path / "band.json"
    assert invoke("estimate", stops, "-v", baja, "--below", 60, "--json", file).status == 0
    document = json.loads(file.read_text(encoding="utf-8"))
    for name in ("c_f", "c_r", "i"):
        band, whole = (d["parameters"][name] for d in (document, saved.document))
        assert abs(band["mean"] - whole["mean"]) < 0.3 * whole["sd"]
        assert band["sd"] == pytest.approx(whole["sd"], rel=0.2)
    said = invoke("estimate", stops, "-v", baja, "--below", 101)
    assert refuse(said, "--below 101", "sampling rate", "400 Hz", "give at most 100")


def test_a_report_of_a_band_has_neither_diagnosis_nor_track(
    invoke: Command, refuse: Check, stops: Path, baja: Path, saved: Saved, tmp_path: Path
) -> None:
    page, file = tmp_path / "band.html", tmp_path / "band.json"
    said = invoke("report", stops, "-v", baja, "--below", 12, "-o", page, "--json", file)
    assert said.status == 0
    document = json.loads(file.read_text(encoding="utf-8"))
    assert document["diagnostics"]["band"] == [0.0, 12.0]
    assert document.get("diagnosis") is None
    assert document.get("online") is None
    text = page.read_text(encoding="utf-8").replace("\N{NO-BREAK SPACE}", " ")
    assert "Only the motion below 12 Hz was used." in text
    (tmp_path / "whole.json").write_text(json.dumps(saved.document), encoding="utf-8")
    again = invoke("report", "--from", tmp_path / "whole.json", "--below", 12, "-o", page)
    assert refuse(again, "--below", "leave the saved estimate out")
