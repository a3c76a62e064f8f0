"""Single runs for :mod:`benchmarks.online`: effects, verdicts, and a damper that fails at once."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.recording import Recording
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.models.effects import placed_effect as read
from bayes_asv.posterior.effect_fit import with_effects
from bayes_asv.posterior.fitted_model import make_dataset
from bayes_asv.preprocessing.run_preparation import prepare_runs
from bayes_asv.simulation import roads
from bayes_asv.simulation.simulate import simulate
from bayes_asv.tracking.track import TrackResult, track
from tests.posterior.cases import DECLARED, as_recording, case, vehicle
from tests.rig import (
    DEFAULT_SPEEDS,
    TERRAINS,
    CustomLaw,
    RigCar,
    SensorSpec,
    Term,
    baja,
    draw,
    draw_biases,
    drive,
    with_terms,
)

__all__ = ["EFFECTS", "failed", "judged", "mistaken", "simulated", "with_effect"]

Array = NDArray[np.float64]
Row = dict[str, Any]

_GRAVITY = 9.80665


def _uneven(car: RigCar, rng: np.random.Generator) -> tuple[float, Term, bool]:
    """Damper of the package's own law, with a ratio drawn around one."""
    ratio = math.exp(0.4 * rng.normal())
    c, share, b = car.c_f, (ratio - 1.0) / (ratio + 1.0), 0.015
    return (
        ratio,
        CustomLaw(lambda d, v, t: -c * v * (1.0 + share * v / (v * v + b * b) ** 0.5)),
        False,
    )


def _digressive(car: RigCar, rng: np.random.Generator) -> tuple[float, Term, bool]:
    knee, c = float(rng.uniform(0.2, 0.8)), car.c_f
    return knee, CustomLaw(lambda d, v, t: -c * v / (1.0 + (v / knee) ** 2) ** 0.5), False


def _friction(car: RigCar, rng: np.random.Generator) -> tuple[float, Term, bool]:
    force, slip = float(rng.uniform(0.01, 0.06)) * car.m * _GRAVITY / 2.0, 0.01
    return force, CustomLaw(lambda d, v, t: -force * v / (v * v + slip * slip) ** 0.5), True


def _progressive(car: RigCar, rng: np.random.Generator) -> tuple[float, Term, bool]:
    kappa, k = float(rng.uniform(20.0, 150.0)), car.k_f
    return (
        kappa,
        CustomLaw(lambda d, v, t: -k * d * (kappa * d * d) * (1.0 + 0.15 * kappa * d * d)),
        True,
    )


_LAWS: dict[str, Callable[[RigCar, np.random.Generator], tuple[float, Term, bool]]] = {
    "bound_rebound@front": _uneven,
    "digressive_damper@front": _digressive,
    "coulomb_friction@front": _friction,
    "progressive_spring@front": _progressive,
}
EFFECTS = (*_LAWS, "spring_rate@front", "sensor_gain@rear_chassis")


def _drive(name: str, seed: int) -> tuple[RigCar, float, Recording]:
    """Drive over a bump with an effect; return car, value of its parameter, and recording."""
    rng = np.random.default_rng([seed, 95])
    car = draw(baja(), rng, DECLARED)
    sensors, driven = draw_biases(SensorSpec(), rng), car
    if name in _LAWS:
        truth, term, keep = _LAWS[name](car, rng)
        driven = with_terms(car, "front", term, damper=keep)
    elif name == "spring_rate@front":
        truth = math.exp(0.15 * rng.normal())
        # the factor is that on the given value, the error of which is drawn as declared
        driven = car = replace(car, k_f=truth * car.k_f)
    else:
        truth = math.exp(0.05 * rng.normal())
        sensors = replace(sensors, gain=(1.0, 1.0, 1.0, truth))
    run = drive(driven, TERRAINS["bump"](seed), DEFAULT_SPEEDS["bump"], 400.0, 2.5, sensors, seed)
    return car, truth, as_recording(run, f"{name}-{seed}.csv")


def with_effect(name: str, seed: int, *, compare: bool) -> Row:
    """Track a drive with an effect; if asked, compare with the mode of the posterior."""
    car, truth, recording = _drive(name, seed)
    given, placed = vehicle(DECLARED), read(name)
    result = track(recording, given, effects=[placed])
    parameter = placed.effect.parameters[0].name
    low, high = (float(q) for q in np.quantile(result.effects[placed][parameter], [0.025, 0.975]))
    rates = np.array([car.c_f, car.c_r, car.i])
    row: Row = {
        "seed": seed,
        "truth": truth,
        "eti95": [low, high],
        "inside": low <= truth <= high,
        "z": (np.log(result.frames.median[-1] / rates) / result.frames.log_sd[-1]).tolist(),
        "consistency": result.consistency.verdict,
        "without": track(recording, given).consistency.verdict,
    }
    if compare:
        row |= _compared(result, placed, recording)
    return row


def _compared(result: TrackResult, placed: PlacedEffect, recording: Recording) -> Row:
    """Differences from mode and curvature of the posterior, in its standard deviations."""
    lines, _, _ = prepare_runs((recording,), result.vehicle)
    _, fitted = with_effects(make_dataset(result.vehicle, lines), (placed,))
    covariance = fitted.mode.covariance
    first = placed.effect.parameters[0]
    k = fitted.space.names.index(placed.coordinate_name(first))
    mean, sd = result.coordinates.effect_moments(result.mean, result.covariance)
    own = [e.name for e in result.coordinates.effects].index(placed.coordinate_name(first))
    names = result.coordinates.estimands
    mode = fitted.space.cars(fitted.mode.z[None])[0, : len(names)]
    deviation = np.array([fitted.space.log_deviation(covariance, n) for n in names])
    return {
        "shift": float(abs(mean[own]) - abs(fitted.mode.z[k]) if first.form == "positive"
                       else mean[own] - fitted.mode.z[k]) / math.sqrt(covariance[k, k]),
        "ratio": float(sd[own]) / math.sqrt(covariance[k, k]),
        "shifts": (np.log(result.frames.median[-1] / mode) / deviation).tolist(),
    }  # fmt: skip


def simulated(name: str, rate: float, seed: int) -> Row:
    """Verdict on what ``bayes-asv simulate`` writes for the shipped car."""
    from bayes_asv.domain.vehicle import read_vehicle
    from bayes_asv.shipped import shipped

    given = read_vehicle(shipped("vehicles", "baja2008.toml"))
    road = roads.road(name, np.random.default_rng([seed, 0]))
    recording = simulate(given, road, rate=rate, seconds=2.5, seed=seed).recording
    return _verdict(track(recording, given))


def judged(terrain: str, rate: float, sensors: SensorSpec, seed: int, seconds: float = 2.0) -> Row:
    """Verdict on a drive of the rig whose sensors are as declared but for where noise arises."""
    _, _, recording = case(terrain, seed, DECLARED, rate, seconds, sensors)
    return _verdict(track(recording, vehicle(DECLARED, replace(sensors, noise_kind="filtered"))))


def mistaken(terrain: str, fault: str, seed: int) -> Row:
    """Verdict on a drive that is not as declared."""
    if fault in _LAWS:
        _, _, recording = _drive(fault, seed)
        return _verdict(track(recording, vehicle(DECLARED)))
    _, _, recording = case(terrain, seed, DECLARED)
    values = recording.values.copy()
    if fault == "front wheel 20 ms late":
        values[0, 8:] = recording.values[0, :-8]
    else:  # the noise of a chassis channel is twice what is declared
        values[1] += math.sqrt(3.0) * 0.9 * np.random.default_rng(seed).normal(size=len(values[1]))
    return _verdict(track(replace(recording, values=values), vehicle(DECLARED)))


def _verdict(result: TrackResult) -> Row:
    found = result.consistency
    return {
        "verdict": found.verdict if result.verdict == "ok" else result.verdict,
        "nis": found.nis_mean,
        "faults": list(found.faults),
    }


def failed(loss: float, seed: int) -> Row:
    """Track a front damper that loses a share of its rate at 5 s, on a rough road."""
    rng = np.random.default_rng([seed, 96])
    car = draw(baja(), rng, DECLARED)
    c, when = car.c_f, 5.0
    law = CustomLaw(lambda d, v, t: -c * v * (1.0 if t < when else 1.0 - loss))
    driven = with_terms(car, "front", law, damper=False)
    sensors = draw_biases(SensorSpec(), rng)
    road = TERRAINS["rough"](seed)
    run = drive(driven, road, DEFAULT_SPEEDS["rough"], 400.0, 14.0, sensors, seed)
    frames = track(as_recording(run, f"failed-{seed}.csv"), vehicle(DECLARED)).frames
    true = np.where(frames.time < when, c, (1.0 - loss) * c)
    z = np.log(frames.median[:, 0] / true) / frames.log_sd[:, 0]
    wrong = np.abs(np.log(frames.median[:, 0] / true)) > math.log(1.1)
    after = frames.time > when
    known = (frames.log_sd[:, 0] < 0.1) & ~wrong
    last = frames.time[after & ~known]
    return {
        "seed": seed,
        "followed": float(last[-1] - when) if len(last) else 0.0,
        "at_end": float(z[-1]),
        "inside": float(np.mean(np.abs(z[after]) < 1.96)),
        "trusted_while_wrong": float(np.mean(frames.consistent[after] & (np.abs(z[after]) > 3.0))),
    }
