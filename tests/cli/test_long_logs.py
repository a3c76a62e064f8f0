"""A log of ten minutes as a file: estimate takes the events from it and says which."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bayes_asv as asv
from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.sections import ESTIMATE, long_logs
from bayes_asv.report.sections.blocks import Figure, Text
from bayes_asv.report.svg import style
from tests.cli.conftest import Command, Said
from tests.rig import RigCar, SensorSpec, baja, draw, draw_biases, vehicle_toml
from tests.rig.long_log import LongLog, hour, long_log
from tests.rig.units import LBF_PER_INCH, LBF_S2_INCH

RATE = 200.0
SENSORS = draw_biases(SensorSpec(), np.random.default_rng(4))


@pytest.fixture(scope="module")
def car() -> RigCar:
    return draw(baja(), np.random.default_rng(3))


@pytest.fixture(scope="module")
def drive(car: RigCar) -> LongLog:
    return long_log(car, hour(10.0, 8, 5), RATE, SENSORS, 5)


@pytest.fixture(scope="module")
def vehicle_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("car") / "car.toml"
    path.write_text(vehicle_toml(baja(), SensorSpec()), encoding="utf-8")
    return path


def recording(drive: LongLog, begin: float, end: float) -> asv.Recording:
    rows = (drive.time >= begin) & (drive.time < end)
    return asv.Recording(
        drive.time[rows], drive.channels[:, rows], ("m/s^2",) * 4, source=f"cut at {begin:.0f} s"
    )


@pytest.fixture(scope="module")
def said(
    drive: LongLog, vehicle_file: Path, invoke: Command, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Said, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("log")
    recording(drive, 0.0, np.inf).to_csv(folder / "log.csv")
    done = invoke(
        "estimate", folder / "log.csv", "--vehicle", vehicle_file, "--json", folder / "e.json"
    )
    return done, json.loads((folder / "e.json").read_text("utf-8"))


def test_the_truth_is_found_in_the_best_events(said: tuple[Said, Any], car: RigCar) -> None:
    done, document = said
    assert done.status == 0, done.err
    units = {"c_f": LBF_PER_INCH, "c_r": LBF_PER_INCH, "i": LBF_S2_INCH}
    for name, unit in units.items():
        found = document["parameters"][name]
        # one parameter in twenty is outside of 95 %: three times the half width is chance enough
        assert abs(found["mean"] - getattr(car, name) / unit) < 3.0 * found["sd"]
        assert found["sd"] < 0.012 * found["mean"]


def test_the_answer_says_what_was_used_and_what_was_not(
    said: tuple[Said, Any], drive: LongLog
) -> None:
    done, document = said
    (log,) = document["logs"]
    used = [event for event in log["events"] if event["used"]]
    assert len(used) == len(document["runs"]) == 6
    assert all(event["reason"] for event in log["events"] if not event["used"])
    assert sum(event["unfit"] for event in log["events"]) == len(drive.of("jump"))
    (line,) = [text for text in done.sentences if text.startswith("log.csv lasts")]
    assert line.startswith("log.csv lasts 10.0 min: 9 bumps and ")
    assert " were found, and the best 6 used (" in line
    assert "1 as the wheels left the ground" in line
    assert "as it would shrink no interval by 2 %" in line
    assert "standing " in line
    assert document["provenance"]["recordings"][0]["file"] == "log.csv"
    assert len(document["provenance"]["recordings"]) == 1


def test_the_report_shows_them(said: tuple[Said, Any]) -> None:
    assert long_logs.SECTION in ESTIMATE
    with style():
        text, figure = long_logs.SECTION.content(EstimateDocument.model_validate(said[1]))
    assert isinstance(text, Text)
    assert isinstance(figure, Figure)
    assert text.title == "Events of long recordings"
    (picture,) = figure.panels
    assert "6 used" in picture.alt
    assert "1 unfit" in picture.alt


def test_a_bump_cut_by_hand_gives_the_same_answer(
    said: tuple[Said, Any], drive: LongLog, vehicle_file: Path
) -> None:
    vehicle = asv.read_vehicle(vehicle_file)
    begin, end = drive.of("bump")[0]
    by_hand = asv.estimate(recording(drive, begin, end - 2.0), vehicle, seed=1)
    for name in ("c_f", "c_r", "i"):
        found = said[1]["parameters"][name]
        low, high = by_hand[name].interval(0.95)
        assert low < found["mean"] < high
        assert found["eti95"][1] - found["eti95"][0] <= 1.03 * (high - low)


def test_the_library_finds_the_same_events(
    said: tuple[Said, Any], drive: LongLog, vehicle_file: Path
) -> None:
    vehicle = asv.read_vehicle(vehicle_file)
    events = asv.find_events(recording(drive, 0.0, np.inf), vehicle)
    found = [(event.begin, event.end, event.used) for event in events]
    (log,) = said[1]["logs"]
    assert found == [(event["begin"], event["end"], event["used"]) for event in log["events"]]
    # Pieces of one log are recordings like others, and differ although their hash is that of it.
    pieces = [event.recording for event in events if event.used]
    assert len({piece.sha256 for piece in pieces}) == 1
    assert asv.estimate(pieces[:1], vehicle, seed=1).verdict == "ok"
    with pytest.raises(asv.InputError, match="holds the same"):
        asv.estimate([pieces[0], pieces[0]], vehicle)


def test_a_log_without_events_is_refused_with_the_reason(
    drive: LongLog, vehicle_file: Path
) -> None:
    rng = np.random.default_rng(0)
    still = 0.04 * rng.standard_normal((4, 40_000))
    log = asv.Recording(np.arange(40_000) / RATE, still, ("m/s^2",) * 4, source="parked.csv")
    result = asv.estimate(log, asv.read_vehicle(vehicle_file))
    assert result.verdict == "refused"
    assert "the wheels hardly move anywhere in parked.csv" in result.reasons[0]
    assert any("no event" in line and "standing" in line for line in result.lines())
    ((begin, end), *_) = drive.of("jump")
    rows = (drive.time >= begin - 1.0) & (drive.time < end)
    values = np.hstack(
        [still + drive.channels.mean(axis=1, keepdims=True), drive.channels[:, rows]]
    )
    jump = asv.Recording(np.arange(values.shape[1]) / RATE, values, ("m/s^2",) * 4, source="jump")
    result = asv.estimate(jump, asv.read_vehicle(vehicle_file))
    assert result.verdict == "refused"
    assert "the wheels left the ground" in result.reasons[0]
