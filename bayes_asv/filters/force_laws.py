"""Nonlinear suspension force laws, one branch a law.

A row of the table is ``(element, code, p0, p1, …)``, filled up with zeros.  Spring and damper
laws multiply what they change, so that they compose; stops, friction and outside forces
add.  Every branch keeps the value and both slopes.  The readable forms stand in
:mod:`bayes_asv.models.effects`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.prediction import INLINE, OPTIONS

__all__ = [
    "BOUND_REBOUND",
    "BUMP_STOP",
    "COULOMB",
    "CURVE_FIRST",
    "CURVE_KNOTS",
    "DAMPER_CURVE",
    "DIGRESSIVE",
    "DROOP_STOP",
    "FADE",
    "OUTSIDE",
    "PROGRESSIVE",
    "SERIES_STIFFNESS",
    "SPRING_CURVE",
    "SPRING_FIRST",
    "SPRING_KNOTS",
    "SPRING_RATIO",
    "damper_force",
    "excess",
    "excess_many",
    "series_stiffness",
    "undamped_excess",
]

(
    BOUND_REBOUND,
    DIGRESSIVE,
    COULOMB,
    PROGRESSIVE,
    BUMP_STOP,
    DROOP_STOP,
    FADE,
    OUTSIDE,
    DAMPER_CURVE,
    SERIES_STIFFNESS,
    SPRING_CURVE,
) = range(11)

CURVE_KNOTS = 8
"""Knots of a free damping curve on either side of rest."""
CURVE_FIRST = 0.00625
"""Speed of the first of them, m/s; each next one is at twice the speed of the last."""
SPRING_KNOTS = 10
"""Knots of a free spring curve on either side of rest."""
SPRING_FIRST = 0.004
"""Deflection of the first of them, m."""
SPRING_RATIO = math.sqrt(2.0)
"""Deflection of each next one over that of the last: the tenth is at 90.5 mm."""

Array = NDArray[np.float64]


@njit(**OPTIONS)
def _rounded(beyond: float, width: float) -> tuple[float, float]:
    """Return max(beyond, 0) rounded over a width, never quite zero, and its slope."""
    root = math.sqrt(beyond * beyond + width * width)
    # of numbers of like size the difference would lose its digits
    value = 0.5 * (beyond + root) if beyond > 0.0 else 0.5 * width * width / (root - beyond)
    return value, value / root


@njit(**INLINE)
def _on_curve(
    table: Array, lane: int, row: int, x: float, knots: int, first: float, ratio: float
) -> tuple[float, float]:
    """Return the integral of a piecewise linear slope from rest to x, and the slope there.

    Its knots are at rest, at ``first`` and each at ``ratio`` times the last, on either side.
    """
    rest, side = 2 + knots, 1 if x >= 0.0 else -1
    far, low, high = abs(x), 0.0, first
    slope = table[lane, row, rest]
    total, at, knot = 0.0, slope, 1
    while knot <= knots:
        after = table[lane, row, rest + side * knot]
        if far <= high:
            come = far - low
            at = slope + (after - slope) * come / (high - low)
            total += 0.5 * (slope + at) * come
            break
        total += 0.5 * (slope + after) * (high - low)
        slope, low, high, knot = after, high, ratio * high, knot + 1
    if knot > knots:
        at = slope
        total += slope * (far - low)
    return side * total, at


@njit(**INLINE)
def series_stiffness(table: Array, lane: int, element: int) -> float:
    """Return the stiffness in series with an element's damper (N/m); 0 where there is none."""
    found = 0.0
    for row in range(table.shape[1]):
        if table[lane, row, 0] == element and table[lane, row, 1] == SERIES_STIFFNESS:
            found = table[lane, row, 2]
    return found


@njit(**INLINE)
def damper_force(
    table: Array, lane: int, element: int, c: float, rate: float, share: float
) -> tuple[float, float]:
    """Return the force against the rate of deflection that an element's damper exerts (N).

    Behind it stands its slope in that rate, N·s/m.  Parameters are those of :func:`excess`.
    """
    damper, damper_v = c * rate, c
    for row in range(table.shape[1]):
        if table[lane, row, 0] != element:
            continue
        code = table[lane, row, 1]
        p0, p1 = table[lane, row, 2], table[lane, row, 3]
        if code == BOUND_REBOUND:  # p0 = (ratio − 1)/(ratio + 1), p1 = rounding, m/s
            root = math.sqrt(rate * rate + p1 * p1)
            factor = 1.0 + p0 * rate / root
            slope = p0 * p1 * p1 / (root * root * root)
            damper_v = damper_v * factor + damper * slope
            damper *= factor
        elif code == DIGRESSIVE:  # p0 = 1/knee, s/m, p1 = sharpness of the knee
            x = abs(rate * p0)
            if x > 1e-9:
                bend = x**p1
                factor = (1.0 + bend) ** (-1.0 / p1)
                slope = -factor * bend / (1.0 + bend) / rate
                damper_v = damper_v * factor + damper * slope
                damper *= factor
        elif code == DAMPER_CURVE:  # slopes at the knots over c, from the fastest compression on
            along, at = _on_curve(table, lane, row, rate, CURVE_KNOTS, CURVE_FIRST, 2.0)
            factor = along / rate if abs(rate) > 1e-9 else at
            slope = (at - factor) / rate if abs(rate) > 1e-9 else 0.0
            damper_v = damper_v * factor + damper * slope
            damper *= factor
        elif code == FADE:  # p0 = share lost at the end, p1 = how it levels off
            come = share if abs(p1) < 1e-6 else math.expm1(-p1 * share) / math.expm1(-p1)
            damper_v *= 1.0 - p0 * come
            damper *= 1.0 - p0 * come
    return damper, damper_v


@njit(**INLINE)
def undamped_excess(
    table: Array, lane: int, element: int, k: float, delta: float, rate: float, time: float
) -> tuple[float, float, float]:
    """Return the force beyond −k δ of all but the damper (N), and its slopes in δ and δ̇.

    Parameters are those of :func:`excess`.
    """
    spring, spring_d = k * delta, k
    added, added_d, added_v = 0.0, 0.0, 0.0
    for row in range(table.shape[1]):
        if table[lane, row, 0] != element:
            continue
        code = table[lane, row, 1]
        p0, p1, p2 = table[lane, row, 2], table[lane, row, 3], table[lane, row, 4]
        if code == COULOMB:  # p0 = force, N, p1 = slip speed, m/s
            root = math.sqrt(rate * rate + p1 * p1)
            added -= p0 * rate / root
            added_v -= p0 * p1 * p1 / (root * root * root)
        elif code == PROGRESSIVE:  # p0 = κ, 1/m², p1 = share of κ² δ⁴
            x = p0 * delta * delta
            factor = 1.0 + x + p1 * x * x
            slope = (2.0 * p0 + 4.0 * p1 * p0 * x) * delta
            spring_d = spring_d * factor + spring * slope
            spring *= factor
        elif code == SPRING_CURVE:  # slopes at the knots over k, from the deepest compression on
            along, at = _on_curve(table, lane, row, delta, SPRING_KNOTS, SPRING_FIRST, SPRING_RATIO)
            factor = along / delta if abs(delta) > 1e-9 else at
            slope = (at - factor) / delta if abs(delta) > 1e-9 else 0.0
            spring_d = spring_d * factor + spring * slope
            spring *= factor
        elif code in (BUMP_STOP, DROOP_STOP):
            # p0 = gap, m, p1 = rate, N/m, p2 = rounding, m, p3 = power
            sign, power = -1.0 if code == BUMP_STOP else 1.0, table[lane, row, 5]
            deep, slope = _rounded(sign * delta - p0, p2)
            at_rest, _ = _rounded(-p0, p2)
            force = p1 * p2 * (deep / p2) ** power
            added -= sign * (force - p1 * p2 * (at_rest / p2) ** power)
            added_d -= power * force / deep * slope
        elif code == OUTSIDE:  # p0 = force, N, p1 = start, p2 = duration, p3 = rise, s
            rise = table[lane, row, 5]
            up = min(max((time - p1) / rise + 0.5, 0.0), 1.0)
            down = min(max((time - p1 - p2) / rise + 0.5, 0.0), 1.0)
            added += p0 * (up * up * (3.0 - 2.0 * up) - down * down * (3.0 - 2.0 * down))
    return added - (spring - k * delta), added_d - (spring_d - k), added_v


@njit(**INLINE)
def excess(
    table: Array,
    lane: int,
    element: int,
    c: float,
    k: float,
    delta: float,
    rate: float,
    time: float,
    share: float,
) -> tuple[float, float, float]:
    """Return an element's force beyond −k δ − c δ̇ (N), and its slopes in δ and δ̇.

    Parameters
    ----------
    table : (L, K, P) array
        The laws of L parameter sets; see the module.
    lane, element : int
        Which set, and which suspension element.
    c, k : float
        Damping rate (N s/m) and spring rate (N/m).
    delta, rate : float
        Deflection (m) and its rate (m/s), extension positive.
    time, share : float
        Time in the recording (s), and the share of the recording that has gone by.
    """
    damper, damper_v = damper_force(table, lane, element, c, rate, share)
    beyond, by_deflection, by_rate = undamped_excess(table, lane, element, k, delta, rate, time)
    return beyond - (damper - c * rate), by_deflection, by_rate - (damper_v - c)


@njit(**OPTIONS)
def excess_many(
    table: Array,
    element: int,
    c: float,
    k: float,
    delta: Array,
    rate: Array,
    time: Array,
    end: float,
) -> Array:
    """Return :func:`excess` of a table (K, P) at N points (N, 3); ``share`` is 1 at ``end``, s."""
    laws = table.reshape((1, *table.shape))
    out = np.empty((len(delta), 3))
    for n in range(len(delta)):
        out[n] = excess(laws, 0, element, c, k, delta[n], rate[n], time[n], time[n] / end)
    return out
