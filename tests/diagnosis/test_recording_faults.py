"""Faults of recordings that show before any fit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bayes_asv.diagnosis.recording_faults import (
    channels_with_missing_bits,
    find_recording_faults,
)
from bayes_asv.domain.recording import Recording
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.battery.cases import case


def _faults(recording: Recording) -> list[dict[str, Any]]:
    lines, reasons, _ = prepare_runs([recording], case("null/stops~baja").vehicle)
    assert not reasons
    return list(find_recording_faults(lines))


def _complete() -> Recording:
    return case("null/stops~baja").recordings[0]


def _rows(recording: Recording, rows: slice | np.ndarray[Any, np.dtype[Any]]) -> Recording:
    return replace(recording, time=recording.time[rows], values=recording.values[:, rows])


def test_a_complete_recording_that_begins_at_rest_has_no_faults() -> None:
    assert _faults(_complete()) == []


def test_a_recording_that_begins_in_motion_is_reported() -> None:
    recording = _complete()
    largest = int(np.argmax(np.abs(recording.values[0] - np.median(recording.values[0]))))
    (fault,) = _faults(_rows(recording, slice(largest - 10, None)))
    assert (fault["name"], fault["where"]) == ("initial_state", None)
    assert fault["times_noise"] > 10.0


def test_clipped_readings_are_counted() -> None:
    recording = _complete()
    values = recording.values.copy()
    values[2, 300:304] = case("null/stops~baja").vehicle.sensor("rear_wheel").low
    (fault,) = _faults(replace(recording, values=values))
    assert (fault["name"], fault["samples"]) == ("sensor_clipping", 4)


def test_missing_rows_are_counted() -> None:
    recording = _complete()
    rows = np.delete(np.arange(len(recording.time)), [300, 301, 640])
    (fault,) = _faults(_rows(recording, rows))
    assert (fault["name"], fault["samples"]) == ("dropped_samples", 3)


def test_the_jitter_of_a_clock_is_measured() -> None:
    recording = _complete()
    rng = np.random.default_rng(4)
    time = recording.time + 1e-4 * rng.standard_normal(len(recording.time))
    (fault,) = _faults(replace(recording, time=time))
    assert fault["name"] == "uneven_clock"
    assert fault["rms_seconds"] == pytest.approx(1e-4 * np.sqrt(2.0), rel=0.1)


def test_a_converter_that_never_sets_a_bit_is_reported() -> None:
    recording = case("null/rough~baja").recordings[0]
    channel = recording.channels.index("front_chassis")
    values = recording.values.copy()
    step = 8.0 * float(np.min(np.diff(np.unique(values[channel]))))
    values[channel] -= step * np.mod(np.floor(values[channel] / step), 2.0)
    lines, reasons, _ = prepare_runs(
        [replace(recording, values=values)], case("null/rough~baja").vehicle
    )
    assert not reasons
    assert channels_with_missing_bits(lines) == ("front_chassis",)
