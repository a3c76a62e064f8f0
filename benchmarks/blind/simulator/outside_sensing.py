"""Unlisted faults of the path from the mount of a sensor to its converter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .blueprint import Blueprint
from .kinds import CHANNELS, Vector
from .scene import Scene
from .sensors import Motion, Sensing
from .signals import filtered, one_pole

__all__ = ["SENSING_FAULTS", "crosstalk"]

Maker = Callable[[Scene, np.random.Generator], Blueprint]
Change = Callable[[Vector, Motion, int], Vector]


def _channel(rng: np.random.Generator, kinds: str = "") -> str:
    return str(rng.choice([c for c in CHANNELS if c.endswith(kinds)]))


def _peak(scene: Scene, channel: str) -> float:
    """Largest reading without a fault, m/s²."""
    number = CHANNELS.index(channel)
    return max(float(np.max(np.abs(rows[:, number]))) for rows in scene.base[:2])


def _felt(channel: str, change: Change) -> Sensing:
    """Return a change of the acceleration that one sensor feels."""

    def mount(motion: Motion, run: int) -> Motion:
        return motion.reading(channel, change(motion.acceleration[channel], motion, run))

    return Sensing(mount=mount)


def _smooth(signal: Vector, step: float, pace: float) -> Vector:
    """Low-pass of one pole with a time constant, s, from rest."""
    return np.asarray(np.real(one_pole(signal, step, complex(-1.0 / pace))))


def _soft_bracket(scene: Scene, rng: np.random.Generator) -> Blueprint:
    channel, loss = _channel(rng), float(rng.uniform(0.05, 0.10))

    def sensing(size: float) -> Sensing:
        # size is the inverse of the resonance, s
        omega = 2.0 * np.pi / size
        pole = omega * complex(-loss, np.sqrt(1.0 - loss * loss))
        poles = (pole, pole.conjugate())
        return _felt(channel, lambda a, motion, run: filtered(a, motion.step, poles))

    name = "unlisted:soft_bracket"
    return Blueprint(name, channel, "resonance of a mount", (0.005, 0.045), sensing=sensing)


def _ac_coupling(scene: Scene, rng: np.random.Generator) -> Blueprint:
    channel = _channel(rng)

    def sensing(size: float) -> Sensing:
        # size is the corner, Hz
        pace = 1.0 / (2.0 * np.pi * size)
        return _felt(channel, lambda a, motion, run: a - _smooth(a, motion.step, pace))

    return Blueprint("unlisted:ac_coupling", channel, "high-pass", (0.005, 2.5), sensing=sensing)


def _rectified(scene: Scene, rng: np.random.Generator) -> Blueprint:
    channel, sign = _channel(rng), float(rng.choice([-1.0, 1.0]))
    pace, peak = float(rng.uniform(0.03, 0.12)), _peak(scene, channel)

    def sensing(size: float) -> Sensing:
        def change(a: Vector, motion: Motion, run: int) -> Vector:
            return a + sign * size * _smooth(a * a, motion.step, pace) / peak

        return _felt(channel, change)

    name = "unlisted:vibration_rectification"
    return Blueprint(name, channel, "zero shifts by power", (0.003, 2.0), sensing=sensing)


def _zero_shift(scene: Scene, rng: np.random.Generator) -> Blueprint:
    channel, fades = _channel(rng), float(rng.uniform(0.1, 0.3))
    threshold, signs = 0.45 * _peak(scene, channel), rng.choice([-1.0, 1.0], 64)

    def sensing(size: float) -> Sensing:
        def change(a: Vector, motion: Motion, run: int) -> Vector:
            t, out, last = motion.times, a.copy(), -1.0
            over = np.abs(a) > threshold
            for number, hit in enumerate(np.flatnonzero(over[1:] & ~over[:-1])):
                if t[hit] - last > 0.08:
                    last = float(t[hit])
                    u = np.maximum(t - last, 0.0)
                    out += np.where(t > last, size * signs[number % 64] * np.exp(-u / fades), 0.0)
            return out

        return _felt(channel, change)

    name = "unlisted:shock_zero_shift"
    return Blueprint(name, channel, "zero jumps at hits", (0.003, 4.0), sensing=sensing)


def _sticky(scene: Scene, rng: np.random.Generator) -> Blueprint:
    channel = _channel(rng)

    def sensing(size: float) -> Sensing:
        def change(a: Vector, motion: Motion, run: int) -> Vector:
            follows, now = [], 0.0
            for wanted in a.tolist():
                now = min(max(now, wanted - size), wanted + size)
                follows.append(now)
            return np.array(follows)

        return _felt(channel, change)

    name = "unlisted:sticky_sensor"
    return Blueprint(name, channel, "backlash", (0.003, 3.0), sensing=sensing)


def _crossover(scene: Scene, rng: np.random.Generator) -> Blueprint:
    channel = _channel(rng)

    def sensing(size: float) -> Sensing:
        return _felt(channel, lambda a, motion, run: a - size * np.tanh(a / size))

    name = "unlisted:crossover_distortion"
    return Blueprint(name, channel, "gap about zero", (0.003, 3.0), sensing=sensing)


def _whip(scene: Scene, rng: np.random.Generator) -> Blueprint:
    channel = _channel(rng)
    omega, loss = 2.0 * np.pi * float(rng.uniform(7.0, 16.0)), float(rng.uniform(0.03, 0.08))
    pole = omega * complex(-loss, np.sqrt(1.0 - loss * loss))
    poles = (pole, pole.conjugate())

    def sensing(size: float) -> Sensing:
        def change(a: Vector, motion: Motion, run: int) -> Vector:
            return a + size * (filtered(a, motion.step, poles) - a)

        return _felt(channel, change)

    name = "unlisted:whipping_cable"
    return Blueprint(name, channel, "cable that swings", (0.001, 0.4), sensing=sensing)


def _automatic_gain(scene: Scene, rng: np.random.Generator) -> Blueprint:
    channel = _channel(rng)
    peak = _peak(scene, channel)
    attack, release = float(rng.uniform(0.006, 0.015)), float(rng.uniform(0.15, 0.4))

    def sensing(size: float) -> Sensing:
        def change(a: Vector, motion: Motion, run: int) -> Vector:
            rise, fall = motion.step / attack, motion.step / release
            level, found = 0.0, []
            for wanted in np.abs(a).tolist():
                level += (wanted - level) * (rise if wanted > level else fall)
                found.append(level)
            return a / (1.0 + size * np.array(found) / peak)

        return _felt(channel, change)

    name = "unlisted:automatic_gain"
    return Blueprint(name, channel, "gain follows level", (0.003, 1.5), sensing=sensing)


def crosstalk(scene: Scene, rng: np.random.Generator) -> tuple[Blueprint, float]:
    """Return a share of one channel in another, from 0.5 to 3 %, and that share."""
    source, target = (str(c) for c in rng.choice(CHANNELS, 2, replace=False))

    def sensing(size: float) -> Sensing:
        return _felt(target, lambda a, motion, run: a + size * motion.acceleration[source])

    size = float(np.exp(rng.uniform(np.log(0.005), np.log(0.03))))
    form = f"{source} in {target}"
    return Blueprint("unlisted:crosstalk", target, form, (0.005, 0.03), sensing=sensing), size


SENSING_FAULTS: dict[str, Maker] = {
    "soft_bracket": _soft_bracket,
    "ac_coupling": _ac_coupling,
    "vibration_rectification": _rectified,
    "shock_zero_shift": _zero_shift,
    "sticky_sensor": _sticky,
    "crossover_distortion": _crossover,
    "whipping_cable": _whip,
    "automatic_gain": _automatic_gain,
}
