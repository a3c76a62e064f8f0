"""Nonlinear suspension force laws, one branch a law.

A row of the table is ``(element, code, p0, p1, p2, p3)``.  Spring and damper laws multiply what
they change, so that they compose; stops, friction and outside forces add.  Every branch keeps
the value and both slopes.  The readable forms stand in :mod:`bayes_asv.models.effects`.
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
    "DIGRESSIVE",
    "DROOP_STOP",
    "FADE",
    "OUTSIDE",
    "PROGRESSIVE",
    "excess",
    "excess_many",
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
) = range(8)

Array = NDArray[np.float64]


@njit(**OPTIONS)
def _rounded(beyond: float, width: float) -> tuple[float, float]:
    """Return max(beyond, 0) rounded over a width, never quite zero, and its slope."""
    root = math.sqrt(beyond * beyond + width * width)
    # of numbers of like size the difference would lose its digits
    value = 0.5 * (beyond + root) if beyond > 0.0 else 0.5 * width * width / (root - beyond)
    return value, value / root


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
    table : (L, K, 6) array
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
    damper, damper_v = c * rate, c
    spring, spring_d = k * delta, k
    added, added_d, added_v = 0.0, 0.0, 0.0
    for row in range(table.shape[1]):
        if table[lane, row, 0] != element:
            continue
        code = table[lane, row, 1]
        p0, p1, p2 = table[lane, row, 2], table[lane, row, 3], table[lane, row, 4]
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
        elif code == COULOMB:  # p0 = force, N, p1 = slip speed, m/s
            root = math.sqrt(rate * rate + p1 * p1)
            added -= p0 * rate / root
            added_v -= p0 * p1 * p1 / (root * root * root)
        elif code == PROGRESSIVE:  # p0 = κ, 1/m², p1 = share of κ² δ⁴
            x = p0 * delta * delta
            factor = 1.0 + x + p1 * x * x
            slope = (2.0 * p0 + 4.0 * p1 * p0 * x) * delta
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
        elif code == FADE:  # p0 = share lost at the end, p1 = how it levels off
            come = share if abs(p1) < 1e-6 else math.expm1(-p1 * share) / math.expm1(-p1)
            damper_v *= 1.0 - p0 * come
            damper *= 1.0 - p0 * come
        elif code == OUTSIDE:  # p0 = force, N, p1 = start, p2 = duration, p3 = rise, s
            rise = table[lane, row, 5]
            up = min(max((time - p1) / rise + 0.5, 0.0), 1.0)
            down = min(max((time - p1 - p2) / rise + 0.5, 0.0), 1.0)
            added += p0 * (up * up * (3.0 - 2.0 * up) - down * down * (3.0 - 2.0 * down))
    beyond: float = added - (damper - c * rate) - (spring - k * delta)
    return beyond, added_d - (spring_d - k), added_v - (damper_v - c)


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
    """Return :func:`excess` of a table (K, 6) at N points (N, 3); ``share`` is 1 at ``end``, s."""
    laws = table.reshape((1, *table.shape))
    out = np.empty((len(delta), 3))
    for n in range(len(delta)):
        out[n] = excess(laws, 0, element, c, k, delta[n], rate[n], time[n], time[n] / end)
    return out
