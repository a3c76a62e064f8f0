"""Rows laid out as they come, against the layout of whole recordings."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording, Timing, accelerations, sample_times, timing
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.kalman import AT_LEAST, MISSING, VALUE
from bayes_asv.filters.ukf_state import Steps
from bayes_asv.preprocessing.timeline import build
from bayes_asv.tracking.sensor_noise import sensing
from bayes_asv.tracking.streaming_spline import AHEAD
from bayes_asv.tracking.streaming_timeline import Laid, Layout, Rows, longest_gap
from tests.posterior.cases import EXACT, case, vehicle
from tests.rig import SensorSpec

Array = NDArray[np.float64]

CAR = vehicle(EXACT)


def _laid(
    recording: Recording, sizes: list[int], car: Vehicle = CAR, clocks: Timing | None = None
) -> Laid:
    """Everything that a layout gives, the rows coming in chunks of these sizes."""
    layout = Layout(car, sensing(car), 400.0, clocks or timing(recording))
    acc = accelerations(recording, car).T
    parts, at = [], 0
    for size in sizes:
        parts.append(layout.push(recording.time[at : at + size], acc[at : at + size]))
        at += size
    parts.append(layout.finish())
    return Laid(
        Steps(*(np.concatenate(x) for x in zip(*(p.steps for p in parts), strict=True))),
        Rows(*(np.concatenate(x) for x in zip(*(p.rows for p in parts), strict=True))),
    )


@pytest.mark.parametrize("rate", [100.0, 400.0, 800.0])
def test_it_is_the_layout_of_the_whole_recording(rate: float) -> None:
    _, _, recording = case("stops", 2, EXACT, rate=rate)
    line = build(recording, CAR)
    steps, rows = _laid(recording, [len(recording.time)])
    np.testing.assert_allclose(steps.step, line.step, atol=1e-12)
    np.testing.assert_array_equal(steps.kind, line.kind)
    np.testing.assert_array_equal(steps.reading, line.reading)
    assert not steps.afresh.any()
    scale = np.abs(line.moments).max(axis=(0, 1))
    # ends apart, where the curves begin differently, the few samples ahead are as good as all
    inner = slice(12, -12)
    np.testing.assert_array_less(
        np.abs(steps.moments - line.moments)[inner].max(axis=(0, 1)), 4e-3 * scale
    )
    assert np.abs(steps.moments - line.moments)[inner, :, 0].std() < 2e-4 * scale[0]
    np.testing.assert_allclose(steps.spread[:, :2], line.spread[:, :2], atol=1e-12)
    assert len(rows.stamp) == len(recording.time)


@settings(max_examples=12)
@given(sizes=st.lists(st.integers(1, 60), min_size=1, max_size=12), seed=st.integers(0, 3))
def test_chunks_make_no_difference(sizes: list[int], seed: int) -> None:
    _, _, recording = case("bump", seed, EXACT, seconds=0.6, sensors=SensorSpec(dropped=0.1))
    values = recording.values.copy()
    rng = np.random.default_rng(seed)
    values[rng.uniform(size=values.shape) < 0.05] = np.nan
    values[0, 100:120] = np.nan
    values[2, 60:63] = 1e5  # beyond the rail
    recording = replace(recording, values=values)
    first, second, third, fourth = CAR.sensors
    car = replace(CAR, sensors=(first, second, replace(third, high=60.0), fourth))
    n = len(recording.time)
    clocks = Timing((None,) * 4, (0.0, 0.0, 3e-3, 3e-3))
    whole = _laid(recording, [n], car, clocks)
    cutting = [*sizes, max(n - sum(sizes), 0)]
    parts = _laid(recording, cutting, car, clocks)
    for one, two in zip(whole.steps, parts.steps, strict=True):
        np.testing.assert_array_equal(one, two)
    for one, two in zip(whole.rows, parts.rows, strict=True):
        np.testing.assert_array_equal(one, two)


def test_a_row_waits_for_a_few_that_follow() -> None:
    _, _, recording = case("bump", 1, EXACT, seconds=0.2)
    layout = Layout(CAR, sensing(CAR), 400.0)
    acc = accelerations(recording, CAR).T
    done = [
        len(layout.push(recording.time[k : k + 1], acc[k : k + 1]).rows.stamp) for k in range(60)
    ]
    # a chassis reading is taken 0.7 ms after its wheel reading: in the interval that begins there
    assert done[:AHEAD] == [0] * AHEAD
    assert done[AHEAD:] == [1] * (60 - AHEAD)


def test_behind_a_gap_the_motion_begins_anew() -> None:
    _, _, recording = case("rough", 1, EXACT, seconds=1.5)
    keep = (recording.time < 0.6) | (recording.time > 1.1)
    cut_out = replace(recording, time=recording.time[keep], values=recording.values[:, keep])
    steps, rows = _laid(cut_out, [len(cut_out.time)])
    assert np.count_nonzero(steps.afresh) == 1
    k = int(np.flatnonzero(steps.afresh)[0])
    assert steps.step[k] > 0.5
    assert len(rows.stamp) == len(cut_out.time)
    # the reading with which it begins counts; the last one before the gap has no curve behind it
    assert steps.kind[k].tolist() == [VALUE, VALUE]
    assert np.isnan(rows.measured).all(axis=1).sum() <= 2


def test_a_wheel_that_goes_dark_takes_its_rows_with_it() -> None:
    _, _, recording = case("rough", 1, EXACT, seconds=1.5)
    values = recording.values.copy()
    dark = (recording.time >= 0.6) & (recording.time < 1.1)
    values[2, dark] = np.nan
    steps, rows = _laid(replace(recording, values=values), [len(recording.time)])
    assert len(rows.stamp) == len(recording.time)
    assert np.isnan(rows.measured[dark]).all()
    assert np.isfinite(rows.measured[~dark]).mean() > 0.99
    assert np.count_nonzero(steps.afresh) == 1


def test_short_holes_are_bridged() -> None:
    _, _, recording = case("rough", 1, EXACT)
    keep = np.ones(len(recording.time), bool)
    keep[[200, 201, 350]] = False
    holed = replace(recording, time=recording.time[keep], values=recording.values[:, keep])
    steps, _ = _laid(holed, [len(holed.time)])
    line = build(holed, CAR)
    assert not steps.afresh.any()
    np.testing.assert_allclose(steps.step, line.step, atol=1e-12)
    assert longest_gap(400.0) > 4.0 / 400.0


def test_clocks_and_delays_are_those_of_the_recording() -> None:
    _, _, recording = case("bump", 1, EXACT, seconds=1.0)
    told = replace(recording, metadata=(("clock rear", "400 ppm"), ("delay front_chassis", "1 ms")))
    steps, rows = _laid(told, [len(told.time)])
    instants = float(sample_times(told, CAR)[1:4:2, 0].min()) + np.cumsum(steps.step)
    true = sample_times(told, CAR)
    row = 300
    assert instants[rows.step[row, 0]] == pytest.approx(true[1, row], abs=1e-9)
    assert instants[rows.step[row, 1]] == pytest.approx(true[3, row], abs=1e-9)


def test_faster_sensors_are_made_equal() -> None:
    _, _, recording = case("bump", 1, EXACT, seconds=1.0)
    fast = tuple(
        replace(s, bandwidth=200.0) if k in (0, 2) else s for k, s in enumerate(CAR.sensors)
    )
    car = replace(CAR, sensors=fast)  # type: ignore[arg-type]
    steps, _ = _laid(recording, [37] * 10 + [len(recording.time) - 370], car)
    line = build(recording, car)
    scale = float(np.abs(line.moments[:, :, 0]).max())
    assert np.abs(steps.moments - line.moments)[12:-12, :, 0].max() < 4e-3 * scale


def test_a_rail_is_a_bound() -> None:
    _, _, recording = case("bump", 1, EXACT, seconds=1.0)
    top = float(np.nanmax(accelerations(recording, CAR)[1])) - 0.5
    sensors = tuple(replace(s, high=top) if k == 1 else s for k, s in enumerate(CAR.sensors))
    car = replace(CAR, sensors=sensors)  # type: ignore[arg-type]
    values = recording.values.copy()
    values[1] = np.minimum(values[1], top / 0.0254)
    steps, rows = _laid(replace(recording, values=values), [400], car)
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
def test_rows_that_make_no_sense_are_refused(times: list[float], acc: Array) -> None:
    layout = Layout(CAR, sensing(CAR), 400.0)
    with pytest.raises(InputError):
        layout.push(np.array(times), acc)


def test_nothing_gives_nothing() -> None:
    layout = Layout(CAR, sensing(CAR), 400.0)
    assert len(layout.push(np.empty(0), np.empty((0, 4))).rows.stamp) == 0
    assert len(layout.finish().steps.step) == 0
    assert MISSING == 0
