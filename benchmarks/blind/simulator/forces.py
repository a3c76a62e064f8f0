"""Laws of dampers, springs, friction and stops.

A law gives the force (N, upward on the chassis) that is added to −kδ − cδ̇, for deflections δ (m)
and rates δ̇ (m/s) of some axles (rows) and columns. Sizes have one entry for each column. Laws
with a memory are in ``memories.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import erf

from .cars import Car
from .kinds import Vector
from .simulate import Now

__all__ = [
    "DIGRESSIVE",
    "SPRINGS",
    "STOPS",
    "UNEVEN",
    "Inertance",
    "Law",
    "Plain",
    "Pushed",
    "Timed",
    "lip_seal",
    "strut_friction",
]

Law = Callable[[Vector, Vector], Vector]
DamperMaker = Callable[[Vector, Vector], Law]
"""From damping rates (rows, 1), N·s/m, and sizes (B,) to a law."""


@dataclass(frozen=True)
class Plain:
    """A law without memory at some axles."""

    rows: slice
    law: Law
    states: int = 0

    def act(self, now: Now) -> None:
        """Add the force of the law."""
        now.force[self.rows] += self.law(now.delta[self.rows], now.rate[self.rows])


@dataclass(frozen=True)
class Timed:
    """A damper whose force is that of a linear one times 1 + ``factor`` (halves, 1, B)."""

    rows: slice
    c: Vector
    factor: Vector
    states: int = 0

    def act(self, now: Now) -> None:
        """Add the change of the damper force."""
        now.force[self.rows] -= self.c * self.factor[now.half] * now.rate[self.rows]


@dataclass(frozen=True)
class Pushed:
    """Given forces on the chassis at both axles: ``shape`` (halves, 2, B), N."""

    shape: Vector
    states: int = 0

    def act(self, now: Now) -> None:
        """Add the forces of the moment."""
        now.force[4:6] += self.shape[now.half]


class Inertance:
    """Inertia between wheel and body: force against the acceleration of the deflection.

    ``size`` is the inertia over the unsprung mass of the axle; a small negative one is a lag.
    """

    states = 0

    def __init__(self, car: Car, axle: int, size: Vector) -> None:
        lever = (car.ahead, -car.behind)[axle]
        self.pick = np.array([1.0, lever, 0.0, 0.0])
        self.pick[2 + axle] = -1.0
        self.axle, self.size = axle, size * car.unsprung[axle]
        self.local = 1.0 / car.m + lever**2 / car.i + 1.0 / car.unsprung[axle]

    def act(self, now: Now) -> None:
        """Resist the acceleration of the deflection."""
        bare = self.pick @ now.acceleration()
        now.force[self.axle] -= self.size * bare / (1.0 + self.size * self.local)


# -- damper whose force flattens out; sizes are the inverse of a velocity, s/m -----------------


def _eyring(c: Vector, size: Vector) -> Law:
    """F = c v₀ asinh(v/v₀): oil that thins under shear as Eyring has it."""

    def law(delta: Vector, rate: Vector) -> Vector:
        return np.asarray(c * (rate - np.arcsinh(size * rate) / size))

    return law


def _cross(c: Vector, size: Vector) -> Law:
    """F = c v (r + (1 − r)/(1 + |v/v₀|^1.4)), r = 0.25: a long polymer in the oil, after Cross."""

    def law(delta: Vector, rate: Vector) -> Vector:
        return np.asarray(0.75 * c * rate * (1.0 - 1.0 / (1.0 + np.abs(size * rate) ** 1.4)))

    return law


def _weak_shims(c: Vector, size: Vector) -> Law:
    """Slope c (r + (1 − r) exp(−(v/v₀)²)), r = 0.2: shims that lift at pressures about a mean."""
    half = 0.5 * np.sqrt(np.pi)

    def law(delta: Vector, rate: Vector) -> Vector:
        return np.asarray(0.8 * c * (rate - half * erf(size * rate) / size))

    return law


DIGRESSIVE: dict[str, tuple[DamperMaker, tuple[float, float]]] = {
    "Eyring": (_eyring, (0.1, 60.0)),
    "Cross": (_cross, (0.02, 40.0)),
    "shims lifting": (_weak_shims, (0.05, 25.0)),
}


# -- unequal compression and rebound; sizes are the natural logarithm of the ratio, signed -------


def _seat_by_pressure(c: Vector, size: Vector) -> Law:
    """Check valve that follows force: v = F/c̃ (1 − α F/√(F² + F₀²)), F₀ = c̃·0.02 m/s."""
    alpha = np.tanh(0.5 * size)
    firm = c * (1.0 - alpha**2)

    def law(delta: Vector, rate: Vector) -> Vector:
        y = rate / 0.02
        x = y / (1.0 - alpha * y / np.sqrt(y * y + 1.0))
        for _ in range(4):
            root = x * x + 1.0
            miss = x - alpha * x * x / np.sqrt(root) - y
            x = x - miss / (1.0 - alpha * x * (x * x + 2.0) / root**1.5)
        return np.asarray(c * rate - firm * 0.02 * x)

    return law


def _seat_by_chance(c: Vector, size: Vector) -> Law:
    """Slope c (1 + a erf(v/b)), b = 0.02 m/s: a seat whose points close at scattered flows."""
    a, b, rest = np.tanh(0.5 * size), 0.02, 1.0 / np.sqrt(np.pi)

    def law(delta: Vector, rate: Vector) -> Vector:
        x = rate / b
        return np.asarray(-c * a * b * (x * erf(x) + rest * np.expm1(-x * x)))

    return law


UNEVEN: dict[str, DamperMaker] = {
    "seat closed by pressure": _seat_by_pressure,
    "scattered seat": _seat_by_chance,
}


# -- friction without memory; sizes in N -----------------------------------------------------


def strut_friction(size: Vector, reach: float) -> Law:
    """Friction of a strut whose side load grows with compression, by 0.3 over ``reach`` (m)."""

    def law(delta: Vector, rate: Vector) -> Vector:
        load = 1.0 - 0.3 * np.clip(delta / reach, -1.5, 1.5)
        return np.asarray(size * load * np.sign(rate) * np.expm1(-np.abs(rate) / 0.008))

    return law


def lip_seal(size: Vector, bias: float) -> Law:
    """Friction of a seal that grips ``bias`` more in one direction than the mean; rational."""

    def law(delta: Vector, rate: Vector) -> Vector:
        grip = rate / (np.abs(rate) + 0.004)
        return np.asarray(-size * grip * (1.0 + bias * grip))

    return law


# -- springs; sizes are κ, 1/m², signed ------------------------------------------------------


def _side_springs(k: Vector, size: Vector) -> Law:
    """Springs at right angles to the travel: k δ (1 + r (1 − 1/√(1 + (δ/L)²))), κ = r/(2 L²)."""
    r = np.where(size > 0, 1.6, -0.8)
    reach = np.sqrt(0.5 * r / size)

    def law(delta: Vector, rate: Vector) -> Vector:
        return np.asarray(-k * delta * r * (1.0 - 1.0 / np.hypot(1.0, delta / reach)))

    return law


def _gent(k: Vector, size: Vector) -> Law:
    """Rubber in shear whose chains run out of length, after Gent: k δ/(1 − κδ²)."""

    def law(delta: Vector, rate: Vector) -> Vector:
        x = np.minimum(size * delta**2, 0.75)
        return np.asarray(-k * delta * x / (1.0 - x))

    return law


def _air_chambers(k: Vector, size: Vector) -> Law:
    """Two equal volumes of air against each other, exponent 1.3: κ = 1.265/L²."""
    n = 1.3
    reach = np.sqrt((n + 1.0) * (n + 2.0) / (6.0 * size))

    def law(delta: Vector, rate: Vector) -> Vector:
        u = np.clip(delta / reach, -0.8, 0.8)
        force = reach / (2.0 * n) * ((1.0 - u) ** -n - (1.0 + u) ** -n)
        return np.asarray(-k * (force - u * reach))

    return law


SPRINGS: dict[str, tuple[Callable[[Vector, Vector], Law], bool]] = {
    "side springs": (_side_springs, True),
    "Gent rubber": (_gent, False),
    "opposed air chambers": (_air_chambers, False),
}
"""Makers of laws, and whether the law may also soften."""


# -- stops: force over compression d ≥ 0 (m) and its rate (m/s), for a first rate K (N/m) ----------


def _block(first: float, d: Vector, speed: Vector) -> Vector:
    """Return a neo-Hookean block 20 mm thick: (K h/3)(λ⁻² − λ) with λ = 1 − d/h."""
    stretch = 1.0 - np.minimum(d / 0.020, 0.75)
    return np.asarray(first * 0.020 / 3.0 * (stretch**-2 - stretch))


def _pad(first: float, d: Vector, speed: Vector) -> Vector:
    """Return a spring beside a dashpot of 6 ms that does not stick."""
    touch = -np.expm1(-d / 0.001)
    return np.asarray(np.maximum(first * (d + 0.006 * touch * speed), 0.0))


def _strap(first: float, d: Vector, speed: Vector) -> Vector:
    """Return webbing whose fibres straighten over 2.5 mm before they stretch."""
    toe = 0.0025
    return np.asarray(first * (d + toe * np.expm1(-d / toe)))


STOPS: dict[str, Callable[[float, Vector, Vector], Vector]] = {
    "neo-Hookean block": _block,
    "pad with dashpot": _pad,
    "webbing with a toe": _strap,
}
