"""Faults that are not in the list of effects: the correct verdict is *unexplained*."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tests.battery.effects import EffectFactory
from tests.battery.world import Axle, Effect, MotionRange, World, minus_damper, with_terms_at
from tests.rig import (
    CHANNELS,
    BoucWen,
    Bracket,
    Compressed,
    Lash,
    MaxwellMount,
    OneSided,
    Panel,
    PositionDamper,
    QuadraticDamper,
    RigCar,
    Seat,
    Term,
)
from tests.rig.units import STANDARD_GRAVITY

__all__ = ["UNLISTED_FAULTS"]

_ROD_END = 1.2e4  # stiffness of a rod end over its damper's rate, 1/s: 0.08 ms


def _axle(rng: np.random.Generator) -> Axle:
    return "front" if rng.random() < 0.5 else "rear"


def _c(car: RigCar, axle: Axle) -> float:
    return car.c_f if axle == "front" else car.c_r


def _maxwell(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    axle = _axle(rng)

    def change(world: World, size: float) -> World:
        # a stiffer mount than 0.1 ms is beyond the integrator
        def terms(car: RigCar, axle: Axle) -> Sequence[Term]:
            c = _c(car, axle)
            return MaxwellMount(c, c / max(size, 1e-4)), minus_damper(c)

        return with_terms_at(world, axle, terms)

    return Effect("maxwell_mount", axle, change, lambda s: {"time": s}, 3e-4, 0.03, 0.0)


def _bouc_wen(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    axle = _axle(rng)
    travel = 0.15 * motion.travel[axle == "rear"]

    def change(world: World, size: float) -> World:
        return with_terms_at(world, axle, lambda _car, _axle: (BoucWen(size, travel),))

    return Effect("bouc_wen", axle, change, lambda s: {"force": s}, 1.0, 2000.0, 0.0)


def _seat(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    omega = 2.0 * math.pi * float(rng.uniform(3.0, 6.0))
    place = float(rng.uniform(-0.1, 0.1)) * car.l

    def change(world: World, size: float) -> World:
        mass = size * world.car.m
        seat = Seat(mass, mass * omega**2, 2.0 * 0.2 * mass * omega, place)
        return replace(world, car=replace(world.car, seat=seat))

    return Effect("compliant_seat", "", change, lambda s: {"share": s}, 0.001, 0.3, 0.0)


def _lash(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    axle = _axle(rng)

    def change(world: World, size: float) -> World:
        def terms(car: RigCar, axle: Axle) -> Sequence[Term]:
            c = _c(car, axle)
            return Lash(c, size, _ROD_END * c), minus_damper(c)

        return with_terms_at(world, axle, terms)

    return Effect("damper_lash", axle, change, lambda s: {"play": s}, 5e-5, 0.01, 0.0)


def _bracket(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    channel = int(rng.integers(4))

    def change(world: World, size: float) -> World:
        bracket = Bracket(channel, 60.0 / math.sqrt(size))
        return replace(world, mountings=(*world.mountings, bracket))

    def parameters(size: float) -> dict[str, float]:
        return {"frequency": 60.0 / math.sqrt(size)}

    return Effect("bracket_resonance", CHANNELS[channel], change, parameters, 0.02, 4.0, 0.0)


def _panel(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    channel = int(rng.choice([1, 3]))
    frequency = float(rng.uniform(14.0, 35.0))

    def change(world: World, size: float) -> World:
        return replace(world, mountings=(*world.mountings, Panel(channel, frequency, size)))

    def parameters(size: float) -> dict[str, float]:
        return {"share": size, "frequency": frequency}

    return Effect("panel_resonance", CHANNELS[channel], change, parameters, 0.002, 1.0, 0.0)


def _one_sided(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    start, behind = float(rng.uniform(0.4, 1.2)), float(rng.uniform(0.2, 0.6))
    frequency, duration = float(rng.uniform(1.4, 2.6)), float(rng.uniform(0.12, 0.3))

    def change(world: World, size: float) -> World:
        kerb = OneSided(size, start, duration, behind, frequency)
        return replace(world, mountings=(*world.mountings, kerb))

    return Effect("one_sided_kerb", "", change, lambda s: {"lift": s}, 1e-4, 0.08, 0.0)


def _position(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    axle = _axle(rng)
    travel = motion.travel[axle == "rear"]

    def change(world: World, size: float) -> World:
        def terms(car: RigCar, axle: Axle) -> Sequence[Term]:
            c = _c(car, axle)
            return PositionDamper(c, size / travel**2), minus_damper(c)

        return with_terms_at(world, axle, terms)

    return Effect(
        "position_damper", axle, change, lambda s: {"growth": s / travel**2}, 0.02, 20.0, 0.0
    )


def _progressive(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    axle = _axle(rng)
    rate = motion.rate[axle == "rear"]

    def change(world: World, size: float) -> World:
        def terms(car: RigCar, axle: Axle) -> Sequence[Term]:
            return (QuadraticDamper(size * _c(car, axle) / rate, 0.05 * rate),)

        return with_terms_at(world, axle, terms)

    return Effect("progressive_damper", axle, change, lambda s: {"share": s}, 0.02, 10.0, 0.0)


def _jitter(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    def change(world: World, size: float) -> World:
        return replace(world, sensors=replace(world.sensors, hidden_jitter=size))

    return Effect("hidden_jitter", "", change, lambda s: {"rms": s}, 3e-5, 2e-3, 0.0)


def _compressed(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    channel = int(rng.integers(4))

    def limit(size: float) -> float:
        return STANDARD_GRAVITY / math.sqrt(size)

    def change(world: World, size: float) -> World:
        return replace(world, mountings=(*world.mountings, Compressed(channel, limit(size))))

    return Effect(
        "sensor_compression", CHANNELS[channel], change, lambda s: {"limit": limit(s)}, 1e-3, 4.0,
        0.0,
    )  # fmt: skip


def _place(where: str, rng: np.random.Generator, motion: MotionRange, car: RigCar) -> Effect:
    front = rng.random() < 0.5
    sign = 1.0 if rng.random() < 0.5 else -1.0

    def change(world: World, size: float) -> World:
        offset = (sign * size, 0.0) if front else (0.0, sign * size)
        return replace(world, sensors=replace(world.sensors, chassis_offset=offset))

    where = "front_chassis" if front else "rear_chassis"
    return Effect("sensor_place", where, change, lambda s: {"offset": sign * s}, 0.005, 0.6, 0.0)


UNLISTED_FAULTS: Final[Mapping[str, EffectFactory]] = {
    "maxwell_mount": _maxwell,
    "bouc_wen": _bouc_wen,
    "compliant_seat": _seat,
    "damper_lash": _lash,
    "bracket_resonance": _bracket,
    "panel_resonance": _panel,
    "one_sided_kerb": _one_sided,
    "position_damper": _position,
    "progressive_damper": _progressive,
    "hidden_jitter": _jitter,
    "sensor_compression": _compressed,
    "sensor_place": _place,
}
"""Factories by name; a diagnosis has no name for most of these."""

NAMES: Final[Mapping[str, str]] = {
    "maxwell_mount": "damper_hysteresis",
    "bouc_wen": "coulomb_friction",
    "progressive_damper": "damper_curve",
}
"""Names that a diagnosis has for some of them: laws of a damper or of friction in another form."""
