"""Laws of dampers, springs, friction and stops.

A law gives the force (N, upward on the chassis) that is added to −kδ − cδ̇, for deflections δ (m)
and rates δ̇ (m/s) of some axles (rows) and columns. Sizes have one entry for each column.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from .kinds import Vector
from .simulate import Now

__all__ = [
    "DAMPERS",
    "DIGRESSIVE",
    "FRICTION",
    "SPRINGS",
    "STOPS",
    "UNEVEN",
    "Bristles",
    "Law",
    "Maxwell",
    "Plain",
    "Pushed",
    "Timed",
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


# -- damper whose force flattens out ----------------------------------------------------------


def _arctan(c: Vector, size: Vector) -> Law:
    """F = c v_k (2/π) atan(π v / 2 v_k) with 1/v_k = size, s/m."""
    turn = 0.5 * np.pi * size

    def law(delta: Vector, rate: Vector) -> Vector:
        return np.asarray(c * (rate - np.arctan(turn * rate) / turn))

    return law


def _power(c: Vector, size: Vector) -> Law:
    """F = c v (1 + (v/v_0)²)^((n−1)/2) with n = 1 − size and v_0 = 0.05 m/s: |v|^n when fast."""
    exponent = -0.5 * size

    def law(delta: Vector, rate: Vector) -> Vector:
        return c * rate * (1.0 - (1.0 + (rate / 0.05) ** 2) ** exponent)

    return law


def _blow_off(c: Vector, size: Vector) -> Law:
    """Return an orifice, and a valve that opens at 0.11 m/s and takes ``size`` of the slope."""
    opens, soft = 0.11, 0.025

    def law(delta: Vector, rate: Vector) -> Vector:
        speed = np.abs(rate)
        over = speed - opens
        rest = -opens + np.hypot(opens, soft)
        more = 0.5 * (over + np.hypot(over, soft) - rest)
        return np.asarray(c * size * np.sign(rate) * more)

    return law


_SPEEDS = np.array([0.0, 0.025, 0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.2, 2.5])
_DYNO = np.array([0.0, 0.025, 0.0485, 0.086, 0.113, 0.134, 0.171, 0.216, 0.282, 0.408, 0.72])
_GRID = np.linspace(-2.5, 2.5, 5001)
_TABLE = np.sign(_GRID) * (np.abs(_GRID) - PchipInterpolator(_SPEEDS, _DYNO)(np.abs(_GRID)))


def _dyno(c: Vector, size: Vector) -> Law:
    """Return a curve as a dynamometer prints it, mixed with a straight one by ``size``."""

    def law(delta: Vector, rate: Vector) -> Vector:
        return c * size * np.interp(rate, _GRID, _TABLE)

    return law


DIGRESSIVE: dict[str, tuple[DamperMaker, tuple[float, float]]] = {
    "arctan": (_arctan, (0.05, 25.0)),
    "power": (_power, (0.002, 0.7)),
    "orifice and blow-off": (_blow_off, (0.004, 0.85)),
    "dynamometer table": (_dyno, (0.006, 1.0)),
}


# -- unequal compression and rebound; sizes are the natural logarithm of the ratio, signed -------


def _uneven_tanh(c: Vector, size: Vector) -> Law:
    """F = c v (1 + a tanh(v/b)), b = 0.02 m/s."""
    a = np.tanh(0.5 * size)

    def law(delta: Vector, rate: Vector) -> Vector:
        return np.asarray(-c * a * rate * np.tanh(rate / 0.02))

    return law


def _uneven_logcosh(c: Vector, size: Vector) -> Law:
    """Slope c (1 + a tanh(v/b)), b = 0.012 m/s."""
    a, b = np.tanh(0.5 * size), 0.012

    def law(delta: Vector, rate: Vector) -> Vector:
        x = np.abs(rate) / b
        return np.asarray(-c * a * b * (x + np.log1p(np.exp(-2.0 * x)) - np.log(2.0)))

    return law


def _uneven_hyperbola(c: Vector, size: Vector) -> Law:
    """F = c (v + a (√(v² + b²) − b)), b = 0.015 m/s: a check valve with a soft seat."""
    a, b = np.tanh(0.5 * size), 0.015

    def law(delta: Vector, rate: Vector) -> Vector:
        return np.asarray(-c * a * (np.hypot(rate, b) - b))

    return law


_KNOTS = np.array([-2.5, -1.0, -0.5, -0.26, -0.13, -0.06, 0, 0.06, 0.13, 0.26, 0.5, 1.0, 2.5])
_SHARES = np.array([-1, -1, -0.99, -1.03, -0.97, -0.93, 0, 0.94, 1.03, 0.98, 1.01, 1, 1.0])
_UNEVEN = PchipInterpolator(_KNOTS, _SHARES * _KNOTS)(_GRID)


def _uneven_table(c: Vector, size: Vector) -> Law:
    """Two branches of a dynamometer sheet, each straight within 3 %."""
    a = np.tanh(0.5 * size)

    def law(delta: Vector, rate: Vector) -> Vector:
        return np.asarray(-c * a * np.interp(rate, _GRID, _UNEVEN))

    return law


UNEVEN: dict[str, DamperMaker] = {
    "tanh": _uneven_tanh,
    "log cosh": _uneven_logcosh,
    "hyperbola": _uneven_hyperbola,
    "dynamometer table": _uneven_table,
}
DAMPERS = (*DIGRESSIVE, *UNEVEN)


# -- friction without memory; sizes in N -----------------------------------------------------


def _friction_tanh(size: Vector) -> Law:
    def law(delta: Vector, rate: Vector) -> Vector:
        return np.asarray(-size * np.tanh(rate / 0.012))

    return law


def _friction_arctan(size: Vector) -> Law:
    def law(delta: Vector, rate: Vector) -> Vector:
        return np.asarray(-size * (2.0 / np.pi) * np.arctan(rate / 0.005))

    return law


def _friction_stribeck(size: Vector) -> Law:
    """Breakaway a quarter above sliding friction, falling off within 40 mm/s."""

    def law(delta: Vector, rate: Vector) -> Vector:
        return np.asarray(
            -size * np.tanh(rate / 0.008) * (1.0 + 0.25 * np.exp(-((rate / 0.04) ** 2)))
        )

    return law


FRICTION: dict[str, Callable[[Vector], Law]] = {
    "tanh": _friction_tanh,
    "arctan": _friction_arctan,
    "Stribeck": _friction_stribeck,
}


@dataclass(frozen=True)
class Bristles:
    """Friction with elastic bristles: Dahl (``peak`` 0) or LuGre. ``size`` in N, ``give`` in m."""

    rows: slice
    size: Vector
    give: float
    peak: float

    @property
    def states(self) -> int:
        """One deflection of the bristles, in shares of ``give``, for each axle."""
        return len(range(2)[self.rows])

    def act(self, now: Now) -> None:
        """Add −size·(z + τ ż)."""
        rate = now.rate[self.rows]
        most = 1.0 + self.peak * np.exp(-((rate / 0.05) ** 2))
        flow = (rate - np.abs(rate) * now.aux / most) / self.give
        now.flow[:] = flow
        brake = now.aux + 0.0005 * flow if self.peak else now.aux
        now.force[self.rows] -= self.size * brake


# -- springs; sizes are κ, 1/m², signed ------------------------------------------------------


def _spring_cubic(k: Vector, size: Vector) -> Law:
    def law(delta: Vector, rate: Vector) -> Vector:
        return -k * size * delta**3

    return law


def _spring_sinh(k: Vector, size: Vector) -> Law:
    """Force k L sinh(δ/L), or asinh where it softens: κ = ±1/(6 L²)."""
    reach = 1.0 / np.sqrt(6.0 * np.abs(size))
    stiffens = size > 0

    def law(delta: Vector, rate: Vector) -> Vector:
        x = np.clip(delta / reach, -8.0, 8.0)
        return -k * reach * (np.where(stiffens, np.sinh(x), np.arcsinh(x)) - x)

    return law


def _spring_tan(k: Vector, size: Vector) -> Law:
    """Force k L tan(δ/L), or atan where it softens: κ = ±1/(3 L²)."""
    reach = 1.0 / np.sqrt(3.0 * np.abs(size))
    stiffens = size > 0

    def law(delta: Vector, rate: Vector) -> Vector:
        x = delta / reach
        bent = np.clip(x, -1.25, 1.25)
        tan = np.tan(bent) + (x - bent) * 10.0
        return -k * reach * (np.where(stiffens, tan, np.arctan(x)) - x)

    return law


SPRINGS: dict[str, Callable[[Vector, Vector], Law]] = {
    "cubic": _spring_cubic,
    "sinh": _spring_sinh,
    "tan": _spring_tan,
}


# -- stops: force over compression d ≥ 0 (m) and its rate (m/s), for a first rate K (N/m) ----------


def _stop_cubic(first: float, d: Vector, speed: Vector) -> Vector:
    return first * d * (1.0 + (d / 0.008) ** 2)


def _stop_foam(first: float, d: Vector, speed: Vector) -> Vector:
    return np.asarray(first * 0.009 * np.expm1(np.minimum(d / 0.009, 5.0)))


def _stop_stages(first: float, d: Vector, speed: Vector) -> Vector:
    return np.asarray(first * (d + 2.5 * np.maximum(d - 0.004, 0.0)))


def _stop_hertz(first: float, d: Vector, speed: Vector) -> Vector:
    """Hunt and Crossley: a rounded rubber that loses energy."""
    return np.asarray(first * d * np.sqrt(d / 0.004) * np.maximum(1.0 + 0.5 * speed, 0.0))


STOPS: dict[str, Callable[[float, Vector, Vector], Vector]] = {
    "cubic": _stop_cubic,
    "exponential foam": _stop_foam,
    "two stages": _stop_stages,
    "Hunt-Crossley": _stop_hertz,
}


@dataclass(frozen=True)
class Maxwell:
    """A damper in series with a spring: its force (N) is the state.

    ``stiffness`` (rows, B), N/m, grows with force as 1 + |m|/``hardens`` (N) where that is given;
    ``parallel`` (rows, 1), N·s/m, is a damping beside the spring.
    """

    rows: slice
    c: Vector
    stiffness: Vector
    hardens: float = 0.0
    parallel: Vector | None = None

    @property
    def states(self) -> int:
        """One state for each axle."""
        return len(range(2)[self.rows])

    def act(self, now: Now) -> None:
        """Replace −c δ̇ by the force of the chain."""
        rate = now.rate[self.rows]
        if self.parallel is not None:
            flow = (self.c * rate - self.stiffness * now.aux) / (self.c + self.parallel)
            now.flow[:] = flow
            now.force[self.rows] += self.c * flow
            return
        stiffness = self.stiffness
        if self.hardens:
            stiffness = stiffness * (1.0 + np.abs(now.aux) / self.hardens)
        now.flow[:] = stiffness * (rate - now.aux / self.c)
        now.force[self.rows] += self.c * rate - now.aux
