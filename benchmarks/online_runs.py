"""Single runs for :mod:`benchmarks.online`: simulated drives through the online filter."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr
from scipy.stats import chi2

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.recording import Recording, accelerations, nominal_rate
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.ukf_state import Steps
from bayes_asv.models.cars import car_model
from bayes_asv.posterior.map_fit import best_fit
from bayes_asv.preprocessing.run_preparation import prepare_runs
from bayes_asv.tracking.alarm import Alarm, AlarmMonitor
from bayes_asv.tracking.filter import DEFAULT_SETTINGS, ENGINES, Engine, initial_state
from bayes_asv.tracking.filter_model import filter_model
from bayes_asv.tracking.frames import Frames
from bayes_asv.tracking.parameters import coordinates
from bayes_asv.tracking.relinearization import slice_steps
from bayes_asv.tracking.sensor_noise import sensor_model
from bayes_asv.tracking.streaming_timeline import StreamingTimeline
from bayes_asv.tracking.track import TrackResult, track
from tests.posterior.cases import DECLARED, EXACT, as_recording, case, vehicle
from tests.rig import (
    DEFAULT_SPEEDS,
    TERRAINS,
    FadingDamper,
    RigCar,
    SensorSpec,
    baja,
    draw,
    draw_biases,
    drive,
    with_terms,
)
from tests.rig.terrain import rollers

__all__ = [
    "KNOWLEDGE", "NAMES", "after_crossing", "compared", "covered", "faded_share", "fading",
    "long_drive", "nees_band", "raised", "speeds", "watched",
]  # fmt: skip

Array = NDArray[np.float64]
Row = dict[str, Any]

NAMES = ("c_f", "c_r", "i")
KNOWLEDGE = {"exact": EXACT, "declared": DECLARED}
_NO_EVENTS = DEFAULT_SETTINGS._replace(
    information_gain=math.inf, review_interval=math.inf, fault_duration=math.inf
)


def covered(
    terrain: str, rate: float, knowledge: str, seed: int, sensors: SensorSpec | None = None
) -> Row:
    """Track one drive of two seconds, and compare the last row with the truth."""
    sds = KNOWLEDGE[knowledge]
    car, _, recording = case(terrain, seed, sds, rate=rate, sensors=sensors)
    began = time.process_time()
    result = track(recording, vehicle(sds, sensors))
    seconds = time.process_time() - began
    truth = np.array([getattr(car, name) for name in NAMES])
    error = np.log(result.frames.median[-1] / truth)
    scale = result.coordinates.scale[:3]
    covariance = result.covariance[:3, :3] * np.outer(scale, scale)
    found = result.consistency
    return {
        "terrain": terrain,
        "rate": rate,
        "knowledge": knowledge,
        "seed": seed,
        "verdict": result.verdict,
        "error": error.tolist(),
        "sd": result.frames.log_sd[-1].tolist(),
        "nees": float(error @ np.linalg.solve(covariance, error)),
        "nis": found.nis_mean,
        "nis_band95": list(found.nis_band95),
        "consistent": found.verdict == "consistent",
        "resets": len(result.resets),
        "cpu_seconds": seconds,
    }


def compared(terrain: str, seed: int) -> Row:
    """Compare the last row of a drive of two seconds with mode and curvature of the posterior."""
    _, _, recording = case(terrain, seed, EXACT)
    lines, _, _ = prepare_runs([recording], vehicle(EXACT))
    found = best_fit(lines, vehicle(EXACT))
    mode = found.space.cars(found.mode.z[None])[0, : len(NAMES)]
    sd = np.array([found.space.log_deviation(found.mode.covariance, n) for n in NAMES])
    frames = track(recording, vehicle(EXACT)).frames
    return {
        "terrain": terrain,
        "seed": seed,
        "shift": (np.log(frames.median[-1] / mode) / sd).tolist(),
        "ratio": (frames.log_sd[-1] / sd).tolist(),
    }


def long_drive(
    seconds: float,
    rate: float,
    seed: int,
    *,
    terrain: str = "rough",
    loss: float = 0.0,
    fade: float = 20.0,
    like: RigCar | None = None,
) -> tuple[RigCar, Recording]:
    """Drive a car drawn around the baja; its front damper may lose a share of its rate."""
    rng = np.random.default_rng([seed, 92])
    car = draw(baja(), rng, DECLARED) if like is None else like
    driven = car
    if loss:
        driven = with_terms(car, "front", FadingDamper(car.c_f, loss, fade), damper=False)
    sensors = draw_biases(SensorSpec(), rng)
    ground, speed = TERRAINS[terrain](seed), DEFAULT_SPEEDS[terrain]
    if terrain == "rollers":  # as many as the drive is long: at rest there is no information
        ground = rollers(count=math.ceil(seconds * speed / 1.4) + 1)
    run = drive(driven, ground, speed, rate, seconds, sensors, seed)
    return car, as_recording(run, f"{terrain}-{seed}.csv")


def faded_share(time_: Array, loss: float, fade: float) -> Array:
    """Share of its rate that a fading damper has left."""
    through = np.clip(time_ / fade, 0.0, 1.0)
    return np.asarray(1.0 - loss * (1.0 - np.exp(-3.0 * through)) / (1.0 - np.exp(-3.0)))


def fading(seed: int, forget: float | None) -> Row:
    """Track a front damper that loses 30 % in 20 s; the lag is the delay behind the truth."""
    car, recording = long_drive(24.0, 400.0, seed, loss=0.3)
    frames = track(recording, vehicle(DECLARED), forget=forget).frames
    inside = (frames.time > 2.0) & (frames.time < 20.0)
    share = frames.median[:, 0] / car.c_f
    true = faded_share(frames.time, 0.3, 20.0)
    # errors of mass and springs scale the whole curve: they are the given values', not a lag
    share = share / np.median((share / true)[inside])
    shifts = np.arange(0.0, 5.0, 0.05)
    errors = [
        float(np.mean((share - np.interp(frames.time - s, frames.time, true))[inside] ** 2))
        for s in shifts
    ]
    return {
        "seed": seed,
        "forget": forget,
        "lag": float(shifts[int(np.argmin(errors))]),
        "rms_percent": 100.0 * math.sqrt(float(np.mean((share - true)[inside] ** 2))),
        "consistent_share": float(frames.consistent.mean()),
    }


def watched(seed: int, minutes: float, share_left: float, below: float, sure: float) -> Row:
    """Watch a car whose front damper has a constant share of its nominal rate."""
    nominal = baja()
    rng = np.random.default_rng([seed, 93])
    car = draw(nominal, rng, DECLARED)
    car = replace(car, c_f=share_left * nominal.c_f, c_r=nominal.c_r)
    terrain = ("rough", "rollers")[seed % 2]
    _, recording = long_drive(60.0 * minutes, 400.0, seed, terrain=terrain, like=car)
    given = vehicle(DECLARED)
    monitor, alarm, frames = raised(recording, given, below, sure)
    limit = math.log(below * given.c_f.value)
    p = ndtr((limit - np.log(frames.median[:, 0])) / frames.log_sd[:, 0])
    p = p[frames.consistent & (frames.time > 2.0)]  # before, the prior dominates
    return {
        "seed": seed,
        "terrain": terrain,
        "hours": len(frames) / 400.0 / 3600.0 if alarm is None else alarm.time / 3600.0,
        "share_left": share_left,
        "alarm": None if alarm is None else alarm.time,
        "told": monitor.rows_consistent / max(monitor.rows, 1),
        "largest": float(np.max(p, initial=0.0)),
    }


def after_crossing(seed: int, below: float, sure: float) -> float | None:
    """Time from the crossing of a share, by a damper that loses 30 % in 20 s, to the alarm, s.

    None where no alarm comes in 40 s.
    """
    like = draw(baja(), np.random.default_rng([seed, 94]), DECLARED)
    like = replace(like, c_f=baja().c_f)
    _, recording = long_drive(40.0, 400.0, seed, loss=0.3, like=like)
    _, alarm, frames = raised(recording, vehicle(DECLARED), below, sure)
    crossed = float(frames.time[int(np.argmax(faded_share(frames.time, 0.3, 20.0) < below))])
    return None if alarm is None else alarm.time - crossed


def raised(
    recording: Recording, car: Vehicle, below: float, sure: float
) -> tuple[AlarmMonitor, Alarm | None, Frames]:
    """Track a recording and test it for alarms, as ``bayes-asv watch`` does."""
    result: TrackResult = track(recording, car, forget=60.0)
    monitor = AlarmMonitor(car_model("half", car), below, sure, 1.0)
    return monitor, monitor.update(result.frames), result.frames


def speeds(knowledge: str, repeats: int = 7) -> Row:
    """Time both engines over the same steps, and the replay of a minute."""
    known = KNOWLEDGE[knowledge]
    car = vehicle(known)
    driven = draw(baja(), np.random.default_rng([5, 92]), known)  # true values differ as declared
    _, recording = long_drive(60.0, 800.0, 5, like=driven)
    half = car_model("half", car)
    sensors = sensor_model(car, half, CHANNELS)
    timeline = StreamingTimeline(car, sensors, nominal_rate(recording))
    steps = timeline.push(recording.time, accelerations(recording, car).T).steps
    space = coordinates(half, CHANNELS)
    model = filter_model(space, sensors)

    def best(run: Engine, part: Steps, times: int) -> float:
        """Return the steps per second of CPU time, best of a few runs on a busy machine."""
        most = 0.0
        for _ in range(times):
            state, out = initial_state(model), np.zeros((len(part.step), model.into.width))
            began = time.process_time()
            run(0, False, state, model, _NO_EVENTS, part, out)
            most = max(most, len(part.step) / (time.process_time() - began))
        return most

    compiled = best(ENGINES["compiled"], steps, repeats)
    reference = best(ENGINES["filterpy"], slice_steps(steps, 500, 800), 2)
    replays = []
    for _ in range(repeats):
        began = time.process_time()
        track(recording, car)
        replays.append(60.0 / (time.process_time() - began))
    return {
        "knowledge": knowledge,
        "parameters": len(space),
        "compiled_steps_a_second": compiled,
        "filterpy_steps_a_second": reference,
        "ratio": compiled / reference,
        "replay_times_faster": max(replays),
        "replay_median": float(np.median(replays)),
    }


def nees_band(runs: int, level: float = 0.95) -> tuple[float, float]:
    """Interval of the mean NEES of three parameters over so many runs."""
    tail = 0.5 * (1.0 - level)
    low, high = (float(chi2.ppf(share, 3 * runs)) / runs for share in (tail, 1.0 - tail))
    return low, high
