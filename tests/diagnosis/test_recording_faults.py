"""What is found before any fit, on recordings to which it was done."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bayes_asv.diagnosis.recording_faults import found_before
from bayes_asv.domain.recording import Recording
from bayes_asv.posterior.map_fit import lay_out
from tests.battery.cases import case


def found(recording: Recording) -> list[dict[str, Any]]:
    lines, reasons, _ = lay_out([recording], case("null/stops~baja").vehicle)
    assert not reasons
    return list(found_before(lines))


def whole() -> Recording:
    return case("null/stops~baja").recordings[0]


def cut(recording: Recording, rows: slice | np.ndarray[Any, np.dtype[Any]]) -> Recording:
    return replace(recording, time=recording.time[rows], values=recording.values[:, rows])


def test_a_recording_that_begins_at_rest_and_loses_nothing_shows_nothing() -> None:
    assert found(whole()) == []


def test_one_that_begins_in_the_middle_of_a_stop_says_so() -> None:
    recording = whole()
    loudest = int(np.argmax(np.abs(recording.values[0] - np.median(recording.values[0]))))
    (only,) = found(cut(recording, slice(loudest - 10, None)))
    assert (only["name"], only["where"]) == ("initial_state", None)
    assert only["times_noise"] > 10.0


def test_readings_at_a_rail_are_counted() -> None:
    recording = whole()
    values = recording.values.copy()
    values[2, 300:304] = case("null/stops~baja").vehicle.sensor("rear_wheel").low
    (only,) = found(replace(recording, values=values))
    assert (only["name"], only["samples"]) == ("sensor_clipping", 4)


def test_rows_that_are_missing_are_counted() -> None:
    recording = whole()
    rows = np.delete(np.arange(len(recording.time)), [300, 301, 640])
    (only,) = found(cut(recording, rows))
    assert (only["name"], only["samples"]) == ("dropped_samples", 3)


def test_a_clock_that_scatters_is_measured() -> None:
    recording = whole()
    rng = np.random.default_rng(4)
    time = recording.time + 1e-4 * rng.standard_normal(len(recording.time))
    (only,) = found(replace(recording, time=time))
    assert only["name"] == "uneven_clock"
    assert only["rms_seconds"] == pytest.approx(1e-4 * np.sqrt(2.0), rel=0.1)
