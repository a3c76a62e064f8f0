"""Listed effects, in the functional forms of the rig."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, Literal

import numpy as np

from tests.battery.world import Axle, Effect, MotionRange, World, axles, minus_damper, with_terms_at
from tests.rig import (
    CHANNELS,
    AsymmetricDamper,
    Coulomb,
    DigressiveDamper,
    Engine,
    FadingDamper,
    LinearSpring,
    Push,
    RigCar,
    SensorSpec,
    SensorTone,
    SinhSpring,
    SmoothStop,
    Term,
)
from tests.rig.units import STANDARD_GRAVITY

__all__ = ["EFFECTS", "SECONDS", "draw_effect", "places"]

SECONDS: Final = 2.5
"""Length of a run, s."""

_SUSPENSION: Final = ("front", "rear", "both")
_ONE_AXLE: Final = ("front", "rear")
_STOP_RATE: Final = 4.0  # rate of a stop over that of the spring
_STOP_WIDTH: Final = 0.03  # travel over which a stop comes in, over the travel in use
_STOP_CLEAR: Final = 8.0  # widths beyond the travel in use at which a stop of size zero is

EffectFactory = Callable[[str, np.random.Generator, MotionRange, RigCar], Effect]


def places(name: str) -> tuple[str, ...]:
    """Return the possible places of an effect."""
    return _PLACES[name]


def draw_effect(
    name: str, where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar
) -> Effect:
    """Draw an effect of variable size at a place.

    Parameters
    ----------
    name, where : str
        A key of :data:`EFFECTS` and one of its :func:`places`.
    rng : numpy.random.Generator
        Draws its sign, time and frequency.
    motion : MotionRange
        Of the drives without it.
    car : RigCar
        The car without it.
    """
    return EFFECTS[name](where, rng, motion, car)


def _at(where: str, pair: tuple[float, float]) -> float:
    """Value of an axle, or the larger one of both."""
    return max(pair) if where == "both" else pair[where == "rear"]


def _c(car: RigCar, axle: Axle) -> float:
    return car.c_f if axle == "front" else car.c_r


def _k(car: RigCar, axle: Axle) -> float:
    return car.k_f if axle == "front" else car.k_r


def _sign(rng: np.random.Generator, positive: float = 0.5) -> float:
    return 1.0 if rng.random() < positive else -1.0


def _bound_rebound(
    where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar
) -> Effect:
    sign = _sign(rng, 0.75)  # most dampers resist rebound more

    def change(world: World, size: float) -> World:
        ratio = math.exp(sign * size)

        def terms(car: RigCar, axle: Axle) -> Sequence[Term]:
            return AsymmetricDamper(_c(car, axle), ratio), minus_damper(_c(car, axle))

        return with_terms_at(world, where, terms)

    def parameters(size: float) -> dict[str, float]:
        return {"ratio": math.exp(sign * size)}

    return Effect("bound_rebound", where, change, parameters, 0.006, math.log(5.0), 0.03)


def _digressive(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    rate = _at(where, motion.rate)

    def knee(size: float) -> float:
        return rate / math.sqrt(size)

    def change(world: World, size: float) -> World:
        def terms(car: RigCar, axle: Axle) -> Sequence[Term]:
            return DigressiveDamper(_c(car, axle), knee(size)), minus_damper(_c(car, axle))

        return with_terms_at(world, where, terms)

    return Effect("digressive_damper", where, change, lambda s: {"knee": knee(s)}, 0.03, 100.0, 0.1)


def _coulomb(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    def change(world: World, size: float) -> World:
        return with_terms_at(world, where, lambda _car, _axle: (Coulomb(size),))

    # friction of ball joint and seal: a few thousandths of the load
    weight = 0.5 * car.m * STANDARD_GRAVITY
    return Effect(
        "coulomb_friction", where, change, lambda s: {"force": s}, 6e-4 * weight, 0.2 * weight,
        1.3e-3 * weight,
    )  # fmt: skip


def _progressive(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    travel = _at(where, motion.travel)

    def change(world: World, size: float) -> World:
        def terms(car: RigCar, axle: Axle) -> Sequence[Term]:
            k = _k(car, axle)
            return SinhSpring(k, size / travel**2), LinearSpring(-k)

        return with_terms_at(world, where, terms)

    return Effect(
        "progressive_spring", where, change, lambda s: {"kappa": s / travel**2}, 0.01, 2.0, 0.02
    )


def _stop(droop: bool) -> EffectFactory:
    def make(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
        peak = motion.droop if droop else motion.bump
        which = axles(where)
        reach = {axle: peak[axle == "rear"] for axle in which}

        def gap(axle: Axle, size: float) -> float:
            return reach[axle] * (1.0 + _STOP_CLEAR * _STOP_WIDTH - size)

        def change(world: World, size: float) -> World:
            def terms(car: RigCar, axle: Axle) -> Sequence[Term]:
                rate = _STOP_RATE * _k(car, axle)
                width = _STOP_WIDTH * reach[axle]
                return (SmoothStop(gap(axle, size), rate, droop, width),)

            return with_terms_at(world, where, terms)

        def parameters(size: float) -> dict[str, float]:
            first = which[0]
            return {"gap": gap(first, size), "rate": _STOP_RATE * _k(car, first)}

        name = "droop_stop" if droop else "bump_stop"
        return Effect(name, where, change, parameters, 0.15, 1.1, 0.0)

    return make


def _spring_rate(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    sign = _sign(rng)

    def change(world: World, size: float) -> World:
        factor = math.exp(sign * size)

        def terms(car: RigCar, axle: Axle) -> Sequence[Term]:
            return (LinearSpring((factor - 1.0) * _k(car, axle)),)

        return with_terms_at(world, where, terms)

    def parameters(size: float) -> dict[str, float]:
        return {"factor": math.exp(sign * size)}

    return Effect("spring_rate", where, change, parameters, 0.16, math.log(2.5), 0.05)


def _fade(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    def change(world: World, size: float) -> World:
        def terms(car: RigCar, axle: Axle) -> Sequence[Term]:
            return FadingDamper(_c(car, axle), size, SECONDS), minus_damper(_c(car, axle))

        return with_terms_at(world, where, terms)

    return Effect("damper_fade", where, change, lambda s: {"loss": s}, 0.008, 0.9, 0.015)


def _weight(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    sign = _sign(rng)

    def change(world: World, size: float) -> World:
        return replace(world, car=replace(world.car, wdf=world.car.wdf * (1.0 + sign * size)))

    return Effect(
        "weight_distribution", "", change, lambda s: {"factor": 1.0 + sign * s}, 0.032, 0.25, 0.01
    )


def _push(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    """A force pulse in one of the two fitted runs, such as a gust or a moving passenger."""
    sign, start, duration = _sign(rng), float(rng.uniform(0.4, 1.5)), float(rng.uniform(0.2, 0.7))
    run = int(rng.integers(2))
    place: Literal["front", "rear", "both"] = where  # type: ignore[assignment]

    def change(world: World, size: float) -> World:
        push = Push(sign * size, start, duration, place)
        return replace(world, forces=(*world.forces, push))

    def parameters(size: float) -> dict[str, float]:
        return {"force": sign * size, "start": start, "duration": duration}

    weight = car.m * STANDARD_GRAVITY
    return Effect(
        "external_force", where, change, parameters, 2e-3 * weight, 0.3 * weight, 0.0, run
    )


def _engine(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    frequency, seed = float(rng.uniform(22.0, 45.0)), int(rng.integers(2**31))
    if where in CHANNELS:
        channel = CHANNELS.index(where)

        def shaken(world: World, size: float) -> World:
            tone = SensorTone(channel, frequency, size, seed=seed)
            return replace(world, mountings=(*world.mountings, tone))

        def tone(size: float) -> dict[str, float]:
            return {"frequency": frequency, "amplitude": size}

        return Effect("engine_vibration", where, shaken, tone, 0.02, 10.0, 0.0)
    share = {"front": 1.0, "rear": 0.0, "both": 0.5}[where]

    def change(world: World, size: float) -> World:
        engine = Engine(frequency, size, front_share=share, seed=seed)
        return replace(world, forces=(*world.forces, engine))

    def parameters(size: float) -> dict[str, float]:
        return {"frequency": frequency, "amplitude": size}

    weight = car.m * STANDARD_GRAVITY
    return Effect("engine_vibration", where, change, parameters, 2e-3 * weight, 0.3 * weight, 0.0)


def _sensor(
    name: str, key: str, field: str, unit: str, first: float, largest: float, tolerance: float
) -> EffectFactory:
    """Return the factory of a sensor fault: a change of one field of one channel."""

    def make(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
        sign, channel = _sign(rng), CHANNELS.index(where)

        def moved(value: float, size: float) -> float:
            return value * math.exp(sign * size) if unit == "factor" else value + sign * size

        def change(world: World, size: float) -> World:
            return replace(world, sensors=_set(world.sensors, field, channel, moved, size))

        def parameters(size: float) -> dict[str, float]:
            begin = {"gain": 1.0, "bandwidth": 50.0}.get(field, 0.0)
            return {key: moved(begin, size)}

        return Effect(name, where, change, parameters, first, largest, tolerance)

    return make


def _set(
    sensors: SensorSpec, field: str, channel: int, moved: Callable[[float, float], float],
    size: float,
) -> SensorSpec:  # fmt: skip
    """Return the sensors with one field of one channel changed."""
    values = list(getattr(sensors, field))
    values[channel] = moved(values[channel], size)
    changes: dict[str, Any] = {field: tuple(values)}
    return replace(sensors, **changes)


EFFECTS: Final[Mapping[str, EffectFactory]] = {
    "bound_rebound": _bound_rebound,
    "digressive_damper": _digressive,
    "coulomb_friction": _coulomb,
    "progressive_spring": _progressive,
    "bump_stop": _stop(droop=False),
    "droop_stop": _stop(droop=True),
    "spring_rate": _spring_rate,
    "damper_fade": _fade,
    "weight_distribution": _weight,
    "external_force": _push,
    "sensor_gain": _sensor("sensor_gain", "factor", "gain", "factor", 0.002, 0.5, 0.005),
    "sensor_lag": _sensor("sensor_lag", "lag", "delay", "s", 2e-5, 5e-3, 2e-5),
    "sensor_bandwidth": _sensor(
        "sensor_bandwidth", "bandwidth", "bandwidth", "factor", 0.01, math.log(4.0), 0.03
    ),
    "sensor_drift": _sensor("sensor_drift", "slope", "drift", "m/s^3", 0.02, 10.0, 0.01),
    "engine_vibration": _engine,
}
"""Factories by the names of ``docs/interfaces.md``."""

_PLACES: Final[Mapping[str, tuple[str, ...]]] = {
    **dict.fromkeys(EFFECTS, _SUSPENSION),
    "weight_distribution": ("",),
    "bump_stop": _ONE_AXLE,
    "droop_stop": _ONE_AXLE,
    **dict.fromkeys(("sensor_gain", "sensor_lag", "sensor_bandwidth", "sensor_drift"), CHANNELS),
    "engine_vibration": (*_SUSPENSION, *CHANNELS),
}
