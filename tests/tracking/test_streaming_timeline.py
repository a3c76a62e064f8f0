"""The streaming timeline against the timeline of a whole recording."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording, Timing, accelerations, sample_times, timing
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.kalman import AT_LEAST, MISSING, VALUE
from bayes_asv.filters.ukf_state import Steps
from bayes_asv.models.cars import car_model
from bayes_asv.preprocessing.prepare import prepare
from bayes_asv.tracking.sensor_noise import SensorModel, sensor_model
from bayes_asv.tracking.streaming_spline import LOOKAHEAD
from bayes_asv.tracking.streaming_timeline import Rows, StreamingTimeline, TimelineChunk, max_gap
from tests.posterior.cases import EXACT, case, vehicle
from tests.rig import SensorSpec

Array = NDArray[np.float64]

CAR = vehicle(EXACT)


def _sensors(car: Vehicle) -> SensorModel:
    return sensor_model(car, car_model("half", car), CHANNELS)


def _scheduled(
    recording: Recording, sizes: list[int], car: Vehicle = CAR, clocks: Timing | None = None
) -> TimelineChunk:
    """All steps and rows, the rows arriving in chunks of these sizes."""
    timeline = StreamingTimeline(car, _sensors(car), 400.0, clocks or timing(recording))
    acc = accelerations(recording, car).T
    parts, at = [], 0
    for size in sizes:
        parts.append(timeline.push(recording.time[at : at + size], acc[at : at + size]))
        at += size
    parts.append(timeline.finish())
    return TimelineChunk(
        Steps(*(np.concatenate(x) for x in zip(*(p.steps for p in parts), strict=True))),
        Rows(*(np.concatenate(x) for x in zip(*(p.rows for p in parts), strict=True))),
    )


@pytest.mark.parametrize("rate", [100.0, 400.0, 800.0])
def test_timeline_of_the_whole_recording(rate: float) -> None:
    _, _, recording = case("stops", 2, EXACT, rate=rate)
    whole = prepare(recording, CAR, car_model("half", CAR))
    steps, rows = _scheduled(recording, [len(recording.time)])
    np.testing.assert_allclose(steps.step, whole.step, atol=1e-12)
    np.testing.assert_array_equal(steps.kind, whole.kind)
    np.testing.assert_array_equal(steps.reading, whole.reading)
    assert not steps.restart.any()
    scale = np.abs(whole.moments).max(axis=(0, 1))
    # except at the ends, where the splines differ, the lookahead is as good as all samples
    inner = slice(12, -12)
    np.testing.assert_array_less(
        np.abs(steps.moments - whole.moments)[inner].max(axis=(0, 1)), 4e-3 * scale
    )
    assert np.abs(steps.moments - whole.moments)[inner, :, 0].std() < 2e-4 * scale[0]
    np.testing.assert_allclose(steps.spread[:, :2], whole.process_noise[:, :2], atol=1e-12)
    assert len(rows.stamp) == len(recording.time)


@settings(max_examples=12)
@given(sizes=st.lists(st.integers(1, 60), min_size=1, max_size=12), seed=st.integers(0, 3))
def test_chunk_size_has_no_effect(sizes: list[int], seed: int) -> None:
    _, _, recording = case("bump", seed, EXACT, seconds=0.6, sensors=SensorSpec(dropped=0.1))
    values = recording.values.copy()
    rng = np.random.default_rng(seed)
    values[rng.uniform(size=values.shape) < 0.05] = np.nan
    values[0, 100:120] = np.nan
    values[2, 60:63] = 1e5  # beyond the rail
    recording = replace(recording, values=values)
    narrow = replace(CAR.sensor("rear_wheel"), high=60.0)
    car = replace(CAR, sensors={**CAR.sensors, "rear_wheel": narrow})
    n = len(recording.time)
    clocks = Timing((None,) * 4, (0.0, 0.0, 3e-3, 3e-3))
    whole = _scheduled(recording, [n], car, clocks)
    cutting = [*sizes, max(n - sum(sizes), 0)]
    parts = _scheduled(recording, cutting, car, clocks)
    for one, two in zip(whole.steps, parts.steps, strict=True):
        np.testing.assert_array_equal(one, two)
    for one, two in zip(whole.rows, parts.rows, strict=True):
        np.testing.assert_array_equal(one, two)


def test_rows_wait_for_the_lookahead() -> None:
    _, _, recording = case("bump", 1, EXACT, seconds=0.2)
    timeline = StreamingTimeline(CAR, _sensors(CAR), 400.0)
    acc = accelerations(recording, CAR).T
    done = [
        len(timeline.push(recording.time[k : k + 1], acc[k : k + 1]).rows.stamp) for k in range(60)
    ]
    # a chassis reading is taken 0.7 ms after its wheel reading, in the interval that starts there
    assert done[:LOOKAHEAD] == [0] * LOOKAHEAD
    assert done[LOOKAHEAD:] == [1] * (60 - LOOKAHEAD)


def test_motion_restarts_after_a_gap() -> None:
    _, _, recording = case("rough", 1, EXACT, seconds=1.5)
    keep = (recording.time < 0.6) | (recording.time > 1.1)
    cut_out = replace(recording, time=recording.time[keep], values=recording.values[:, keep])
    steps, rows = _scheduled(cut_out, [len(cut_out.time)])
    assert np.count_nonzero(steps.restart) == 1
    k = int(np.flatnonzero(steps.restart)[0])
    assert steps.step[k] > 0.5
    assert len(rows.stamp) == len(cut_out.time)
    # the first reading after the gap counts; the last one before it has no spline after it
    assert steps.kind[k].tolist() == [VALUE, VALUE]
    assert np.isnan(rows.measured).all(axis=1).sum() <= 2


def test_rows_without_a_wheel_are_missing() -> None:
    _, _, recording = case("rough", 1, EXACT, seconds=1.5)
    values = recording.values.copy()
    lost = (recording.time >= 0.6) & (recording.time < 1.1)
    values[2, lost] = np.nan
    steps, rows = _scheduled(replace(recording, values=values), [len(recording.time)])
    assert len(rows.stamp) == len(recording.time)
    assert np.isnan(rows.measured[lost]).all()
    assert np.isfinite(rows.measured[~lost]).mean() > 0.99
    assert np.count_nonzero(steps.restart) == 1


def test_short_gaps_are_interpolated() -> None:
    _, _, recording = case("rough", 1, EXACT)
    keep = np.ones(len(recording.time), bool)
    keep[[200, 201, 350]] = False
    gappy = replace(recording, time=recording.time[keep], values=recording.values[:, keep])
    steps, _ = _scheduled(gappy, [len(gappy.time)])
    whole = prepare(gappy, CAR, car_model("half", CAR))
    assert not steps.restart.any()
    np.testing.assert_allclose(steps.step, whole.step, atol=1e-12)
    assert max_gap(400.0) > 4.0 / 400.0


def test_clocks_and_delays_of_the_recording() -> None:
    _, _, recording = case("bump", 1, EXACT, seconds=1.0)
    timed = replace(
        recording, metadata=(("clock rear", "400 ppm"), ("delay front_chassis", "1 ms"))
    )
    steps, rows = _scheduled(timed, [len(timed.time)])
    instants = float(sample_times(timed, CAR)[1:4:2, 0].min()) + np.cumsum(steps.step)
    true = sample_times(timed, CAR)
    row = 300
    assert instants[rows.step[row, 0]] == pytest.approx(true[1, row], abs=1e-9)
    assert instants[rows.step[row, 1]] == pytest.approx(true[3, row], abs=1e-9)


def test_bandwidths_are_matched() -> None:
    _, _, recording = case("bump", 1, EXACT, seconds=1.0)
    fast = {
        name: replace(CAR.sensor(name), bandwidth=200.0) for name in ("front_wheel", "rear_wheel")
    }
    car = replace(CAR, sensors={**CAR.sensors, **fast})
    steps, _ = _scheduled(recording, [37] * 10 + [len(recording.time) - 370], car)
    whole = prepare(recording, car, car_model("half", car))
    scale = float(np.abs(whole.moments[:, :, 0]).max())
    assert np.abs(steps.moments - whole.moments)[12:-12, :, 0].max() < 4e-3 * scale


def test_clipped_readings_are_bounds() -> None:
    _, _, recording = case("bump", 1, EXACT, seconds=1.0)
    top = float(np.nanmax(accelerations(recording, CAR)[1])) - 0.5
    narrow = replace(CAR.sensor("front_chassis"), high=top)
    car = replace(CAR, sensors={**CAR.sensors, "front_chassis": narrow})
    values = recording.values.copy()
    values[1] = np.minimum(values[1], top / 0.0254)
    steps, rows = _scheduled(replace(recording, values=values), [400], car)
    assert np.count_nonzero(steps.kind[:, 0] == AT_LEAST) > 1
    assert np.all(steps.kind[:, 1] != AT_LEAST)
    assert np.isnan(rows.measured[:, 0]).sum() >= np.count_nonzero(steps.kind[:, 0] == AT_LEAST)


@pytest.mark.parametrize(
    ("times", "acc"),
    [
        ([0.0, 0.0], np.zeros((2, 4))),
        ([0.0, math.nan], np.zeros((2, 4))),
        ([0.0, 1.0], np.zeros((4, 2))),
    ],
)
def test_impossible_rows_are_refused(times: list[float], acc: Array) -> None:
    timeline = StreamingTimeline(CAR, _sensors(CAR), 400.0)
    with pytest.raises(InputError):
        timeline.push(np.array(times), acc)


def test_no_rows_give_no_steps() -> None:
    timeline = StreamingTimeline(CAR, _sensors(CAR), 400.0)
    assert len(timeline.push(np.empty(0), np.empty((0, 4))).rows.stamp) == 0
    assert len(timeline.finish().steps.step) == 0
    assert MISSING == 0
