"""Sensor faults and worn dampers: detection, recovery and alarms."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from bayes_asv.domain.recording import Recording, accelerations
from bayes_asv.domain.vehicle import read_vehicle
from bayes_asv.filters.cholesky_update import FARTHEST
from bayes_asv.library.live import watch
from bayes_asv.models.cars import car_model
from bayes_asv.shipped import shipped
from bayes_asv.simulation.roads import road
from bayes_asv.simulation.simulate import simulate
from bayes_asv.tracking.alarm import Alarm, AlarmMonitor
from bayes_asv.tracking.frames import Frames
from bayes_asv.tracking.tracker import Tracker
from tests.posterior.cases import DECLARED, as_recording, case, vehicle
from tests.rig import (
    DEFAULT_SPEEDS,
    TERRAINS,
    CustomLaw,
    SensorSpec,
    baja,
    draw,
    drive,
    with_terms,
)
from tests.tracking.drives import faded, long_drive, tracked, true_parameters, with_values, z_scores

Array = NDArray[np.float64]

INCH = 0.0254
SECONDS, BREAKS = 14.0, 5.0


def _broken(recording: Recording, fault: str) -> Recording:
    """A drive whose rear chassis or front wheel sensor fails at BREAKS."""
    time, values = recording.time, recording.values.copy()
    rng = np.random.default_rng(3)
    later = time >= BREAKS
    if fault == "shifted":  # knocked: a third of gravity more
        values[3, later] += 3.0 / INCH
    elif fault == "rattling":
        for_a_second = later & (time < BREAKS + 1.0)
        values[3, for_a_second] += rng.normal(size=for_a_second.sum()) / INCH
    elif fault == "stuck":
        for_a_second = later & (time < BREAKS + 1.0)
        values[2, for_a_second] = values[2, for_a_second][0]
    elif fault == "silent":
        values[0, later & (time < BREAKS + 2.0)] = np.nan
    elif fault == "radio gap":
        keep = ~later | (time >= BREAKS + 2.0)
        return replace(recording, time=time[keep], values=values[:, keep])
    return with_values(recording, values)


def _at(frames: Frames, time: float) -> int:
    return int(np.searchsorted(frames.time, time))


@pytest.mark.parametrize("fault", ["shifted", "rattling", "stuck", "silent", "radio gap"])
def test_filter_recovers_from_a_fault(fault: str) -> None:
    """The same 14 s with and without a fault; seed 11."""
    _, recording = long_drive(SECONDS, 11)
    _, healthy = tracked(recording)
    tracker, frames = tracked(_broken(recording, fault))
    during, end = _at(frames, BREAKS + 0.2), len(frames) - 1
    if fault in ("shifted", "rattling", "stuck"):
        assert frames.inflation[_at(frames, BREAKS) : during].max() > 5.0
        assert not frames.consistent[during]
        assert tracker.filter.resets[0] == pytest.approx(BREAKS + 0.27, abs=0.15)
        assert tracker.consistency.summary().faults
    else:
        assert frames.consistent.mean() > 0.97
        assert not tracker.filter.resets
    # at the end the estimate is as good as without the fault
    assert frames.consistent[end]
    assert frames.inflation[end] < 1.3
    np.testing.assert_allclose(frames.log_sd[end], healthy.log_sd[-1], rtol=0.1)
    difference = np.log(frames.median[end] / healthy.median[-1])
    assert np.all(np.abs(difference) < 0.1 * healthy.log_sd[-1])


def test_estimate_stays_close_during_a_fault() -> None:
    car, recording = long_drive(SECONDS, 11)
    _, healthy = tracked(recording)
    _, frames = tracked(_broken(recording, "shifted"))
    for time in np.arange(BREAKS, BREAKS + 2.0, 0.1):
        k = _at(frames, float(time))
        difference = np.log(frames.median[k] / healthy.median[k])
        assert np.all(np.abs(difference) < 0.5 * frames.log_sd[k])
    assert np.all(np.abs(z_scores(frames, car)) < 3.0)


@pytest.mark.parametrize("ranged", [True, False], ids=["beyond its range", "without a range"])
@pytest.mark.parametrize("channel", [0, 3])
def test_one_outlier_has_no_effect(channel: int, ranged: bool) -> None:
    """A flipped bit, 1e6 in/s² once: the final interval is that without it."""
    _, recording = long_drive(SECONDS, 11)
    given = vehicle(DECLARED)
    if not ranged:
        free = {n: replace(s, low=-np.inf, high=np.inf) for n, s in given.sensors.items()}
        given = replace(given, sensors=free)
    values = recording.values.copy()
    values[channel, _row(recording, BREAKS)] = 1e6
    _, healthy = tracked(recording, given)
    _, frames = tracked(with_values(recording, values), given)
    difference = np.log(frames.median[-1] / healthy.median[-1])
    assert np.all(np.abs(difference) < 0.1 * healthy.log_sd[-1])
    np.testing.assert_allclose(frames.log_sd[-1], healthy.log_sd[-1], rtol=0.05)
    assert frames.consistent[-1]


def _row(recording: Recording, time: float) -> int:
    return int(np.searchsorted(recording.time, time))


def _lag(time: Array, tracked_share: Array, true: Array, seconds: float) -> float:
    """Delay of a curve behind the truth, s: the shift with the smallest error."""
    shifts = np.arange(0.0, 4.0, 0.05)
    inside = (time > 2.0) & (time < seconds)
    errors = [
        np.mean((tracked_share - np.interp(time - s, time, true))[inside] ** 2) for s in shifts
    ]
    return float(shifts[int(np.argmin(errors))])


@pytest.mark.parametrize("forget", [60.0, None], ids=["random walk", "constant"])
def test_fading_damper_is_tracked(forget: float | None) -> None:
    """30 % over 20 s on a rough road, up to the constant error of mass and springs."""
    car, recording = long_drive(24.0, 12, 0.3, 20.0)
    tracker, frames = tracked(recording, forget=forget)
    true = faded(frames.time, 0.3, 20.0)
    late = frames.time > 2.0
    share = frames.median[:, 0] / car.c_f
    offset = np.median((share / true)[late])  # errors of the given values
    assert abs(offset - 1.0) < 0.03
    assert np.max(np.abs(share / true / offset - 1.0)[late]) < 0.03
    assert _lag(frames.time, share / offset, true, 20.0) < 2.0
    if forget is not None:
        assert tracker.consistency.summary().verdict == "consistent"
    # the rear damper and the inertia do not change
    difference = np.log(frames.median[-1, 1:] / true_parameters(car)[1:]) / frames.log_sd[-1, 1:]
    assert np.all(np.abs(difference) < 3.5)


def _alarm(frames: Frames, monitor: AlarmMonitor, chunk: int = 200) -> Alarm | None:
    for k in range(0, len(frames), chunk):
        part = Frames(**{n: getattr(frames, n)[k : k + chunk] for n in Frames.__dataclass_fields__})
        found = monitor.update(part)
        if found is not None:
            return found
    return None


def test_alarm_for_a_worn_damper_only() -> None:
    car, recording = long_drive(24.0, 12, 0.3, 20.0)
    nominal = vehicle(DECLARED)
    _, frames = tracked(recording, forget=60.0)
    at_start = car.c_f / nominal.c_f.value
    monitor = AlarmMonitor(car_model("half", nominal), 0.85 * at_start, 0.99, 1.0)
    alarm = _alarm(frames, monitor)
    assert alarm is not None
    assert alarm.axle == "front"
    crossed = float(frames.time[np.argmax(faded(frames.time, 0.3, 20.0) < 0.85)])
    assert crossed < alarm.time < crossed + 6.0
    assert alarm.time - alarm.since >= 1.0
    assert alarm.low < alarm.median < alarm.high
    # chunk size has no effect
    again = _alarm(frames, AlarmMonitor(car_model("half", nominal), 0.85 * at_start, 0.99, 1.0), 13)
    assert again == alarm
    silent = AlarmMonitor(car_model("half", nominal), 0.6 * at_start, 0.99, 1.0)
    assert _alarm(frames, silent) is None
    assert silent.rows == len(frames)
    assert np.all(silent.probability < 0.5)


def test_inconsistent_filter_raises_no_alarm() -> None:
    _, recording = long_drive(24.0, 12, 0.3, 20.0)
    _, frames = tracked(recording, forget=60.0)
    never = replace(frames, consistent=np.zeros(len(frames), bool))
    monitor = AlarmMonitor(car_model("half", vehicle(DECLARED)), 1.5, 0.99, 1.0)
    assert _alarm(never, monitor) is None
    assert monitor.rows_consistent == 0


@pytest.mark.parametrize("loss", [0.5, 0.9])
def test_a_damper_that_fails_at_once_is_followed(loss: float) -> None:
    """At five seconds, on a rough road; meanwhile nothing that is wrong is trusted."""
    car = draw(baja(), np.random.default_rng([32, 91]), DECLARED)
    c = car.c_f
    law = CustomLaw(lambda d, v, t: -c * v * (1.0 if t < 5.0 else 1.0 - loss))
    driven = with_terms(car, "front", law, damper=False)
    run = drive(
        driven, TERRAINS["rough"](32), DEFAULT_SPEEDS["rough"], 400.0, 10.0, SensorSpec(), 4
    )
    _, frames = tracked(as_recording(run, "failed.csv"))
    error = np.log(frames.median[:, 0] / np.where(frames.time < 5.0, c, (1.0 - loss) * c))
    assert np.all(np.abs(error[frames.time > 8.5]) < 0.03)
    assert np.all(frames.log_sd[frames.time > 8.5, 0] < 0.03)
    lost = (frames.time > 5.1) & (np.abs(error) > 0.1)
    assert not frames.consistent[lost].any()
    assert np.all(np.abs(error) < 3.0 * frames.log_sd[:, 0] + 0.01, where=frames.time > 5.1)


def test_gap_of_hours_begins_another_recording() -> None:
    _, recording = long_drive(4.0, 21)
    time = np.concatenate([recording.time, recording.time + 7200.0])
    twice = replace(recording, time=time, values=np.tile(recording.values, 2))
    shifted = twice.values.copy()
    shifted[1, len(recording.time) :] += 30.0  # the zero of a sensor has moved meanwhile
    tracker, frames = tracked(with_values(twice, shifted))
    assert tracker.consistency.summary().verdict == "consistent"
    known = frames.log_sd[len(recording.time) - 1]
    assert np.all(frames.log_sd[-1] <= known)
    change = np.log(frames.median[-1] / frames.median[len(recording.time) - 1])
    assert np.all(np.abs(change) < 0.5 * known)


@pytest.mark.parametrize("kind", ["filtered", "white"])
def test_noise_before_or_behind_the_filter_is_consistent(
    kind: Literal["filtered", "white"],
) -> None:
    sensors = SensorSpec(noise_kind=kind, adc=None)
    for seed in (100, 101):
        car, _, recording = case("stops", seed, DECLARED, sensors=sensors)
        tracker, frames = tracked(recording, vehicle(DECLARED, sensors))
        summary = tracker.consistency.summary()
        assert summary.verdict == "consistent"
        assert 0.93 < summary.nis_mean < 1.07
        assert np.all(np.abs(z_scores(frames, car)) < 3.0)


def test_what_simulate_writes_is_consistent() -> None:
    """Converters so coarse that a car at rest reads the same number all the time."""
    given = read_vehicle(shipped("vehicles", "baja2008.toml"))
    for seed in (0, 1):
        bump = road("bump", np.random.default_rng([seed, 0]))
        recording = simulate(given, bump, rate=800.0, seconds=2.5, seed=seed).recording
        tracker, _ = tracked(recording, given)
        assert tracker.consistency.summary().verdict == "consistent"


def test_watch_says_where_it_cannot_tell(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Tracker, "input_doubt", lambda *_, **__: None)  # the filter alone
    _, recording = long_drive(6.0, 11)
    values = recording.values.copy()
    values[0, 8:] = recording.values[0, :-8]  # the front wheel 20 ms late
    result = watch(with_values(recording, values), vehicle(DECLARED))
    assert result is not None
    assert result.verdict == "refused"
    assert "No alarm" not in " ".join(result.lines())


def test_a_parameter_stops_where_numbers_would_overflow() -> None:
    """A body sensor that reads nothing while its wheel moves asks for a damper of any size."""
    _, _, recording = case("stops", 5, DECLARED, seconds=3.0)
    given = vehicle(DECLARED)
    values = accelerations(recording, given)
    values[recording.channels.index("rear_chassis")] = 0.0
    dead = replace(recording, values=values, units=("m/s^2",) * len(values))
    tracker, frames = tracked(dead, given)
    scale = tracker.coordinates.scale[:3]
    moved = np.abs(np.log(frames.median / frames.median[0])) / scale
    assert np.max(moved) <= 2.0 * FARTHEST
    assert tracker.consistency.summary().verdict == "inconsistent"
