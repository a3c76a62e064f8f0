"""`bayes-asv acquire` as a person types it; with a logger at it in ``tests/firmware``."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bayes_asv.io import read_recording
from tests.acquire.synthetic import SyntheticBlock, counts, stream
from tests.cli.conftest import Check, Command

FRONT, REAR = SyntheticBlock(1, counts(1)), SyntheticBlock(2, counts(2), ppm=-35.0)


@pytest.fixture
def raw(tmp_path: Path) -> Path:
    """Return the raw bytes of a whole run."""
    path = tmp_path / "kept.raw"
    path.write_bytes(stream(FRONT, REAR))
    return path


def test_kept_bytes_become_the_recording(invoke: Command, tmp_path: Path, raw: Path) -> None:
    output, answer = tmp_path / "r.csv", tmp_path / "a.json"
    said = invoke("acquire", "--replay", raw, "-o", output, "--json", answer)
    assert said.status == 0
    assert said.err == ""
    assert "800 rows at 400 Hz" in said.out
    document = json.loads(answer.read_text())
    assert document["schema"] == "bayes_asv/acquire/1"
    assert document["verdict"] == "ok"
    assert document["rows"] == 800
    assert document["drift_ppm"] == pytest.approx(-35, abs=1)
    recording = read_recording(output)
    assert np.array_equal(recording.values[:2].T, FRONT.rows)
    assert np.array_equal(recording.values[2:].T, REAR.rows)
    assert recording.get("clock rear") == f"{document['drift_ppm']:.4f} ppm"


def test_gaps_are_written_told_and_end_with_3(invoke: Command, tmp_path: Path, raw: Path) -> None:
    raw.write_bytes(stream(FRONT) + b"".join(REAR.frames[:-7]))
    output = tmp_path / "r.csv"
    said = invoke("acquire", "--replay", raw, "-o", output, "--json", "-")
    assert said.status == 3
    assert json.loads(said.out)["verdict"] == "incomplete"
    assert "70 of 800 rows of the rear board were not received: 731 to 800" in said.err
    recording = read_recording(output)
    assert np.isnan(recording.values[2:, 730:]).all()
    assert any("731 to 800" in v for k, v in recording.metadata if k == "note")


def test_bytes_without_a_run_write_nothing(invoke: Command, tmp_path: Path, raw: Path) -> None:
    raw.write_bytes(b"no logger speaks so\n" * 40)
    answer = tmp_path / "a.json"
    said = invoke("acquire", "--replay", raw, "-o", tmp_path / "r.csv", "--json", answer)
    assert said.status == 3
    assert "No recording was written" in said.out
    document = json.loads(answer.read_text())
    assert document["verdict"] == "refused"
    assert document["reasons"]
    assert not (tmp_path / "r.csv").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--replay", "none.raw"), "no such file"),
        (("--port", "/nowhere/port"), "cannot be opened"),
        (("--replay", "x", "--port", "y"), "--replay takes no port"),
        (("--pre", "10"), "--pre belongs to --mode loop"),
        (("--trigger", "1", "--mode", "fixed"), "--trigger belongs to --mode loop"),
        (("--resume", "--start", "--port", "y"), "leave out --start"),
        (("--frequency", "300"), "300"),
    ],
)
def test_wrong_usage_is_one_sentence(
    invoke: Command, refuse: Check, tmp_path: Path, options: tuple[str, ...], words: str
) -> None:
    assert refuse(invoke("acquire", "-o", tmp_path / "r.csv", *options), words)
    assert list(tmp_path.iterdir()) == []


def test_kept_bytes_are_not_written_over(invoke: Command, refuse: Check, tmp_path: Path) -> None:
    (tmp_path / "r.csv.raw").write_bytes(b"older")
    assert refuse(invoke("acquire", "--port", "/nowhere", "-o", tmp_path / "r.csv"), "--resume")
    assert (tmp_path / "r.csv.raw").read_bytes() == b"older"
