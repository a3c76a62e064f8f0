"""Nonlinear suspension force laws, one branch a law, over vectors of parameter sets.

A row of the table is ``(element, code, p0, p1, …)``, filled up with zeros.  Spring and damper
laws multiply what they change, so that they compose; stops, friction and outside forces add.  Every
branch keeps the value and its slopes.  Forces with memory are those of steady motion here, and
:mod:`bayes_asv.filters.suspension_forces` carries them.  The readable forms stand in
:mod:`bayes_asv.models.effects`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.prediction import INLINE, OPTIONS
from bayes_asv.filters.vector_code import (
    LANES,
    Choice,
    Table,
    Vector,
    emitted,
    expm1,
    power,
    sqrt,
    where_positive,
)

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
    "KNOT_RATIO",
    "LAW_PARTS",
    "OUTSIDE",
    "PROGRESSIVE",
    "SERIES_STIFFNESS",
    "SPRING_CURVE",
    "SPRING_FIRST",
    "SPRING_KNOTS",
    "WITH_MEMORY",
    "apply_laws",
    "damper_forces",
    "excess_many",
    "row_of_law",
    "table_of_laws",
]

(
    BOUND_REBOUND,
    DIGRESSIVE,
    FADE,
    DAMPER_CURVE,
    PROGRESSIVE,
    COULOMB,
    BUMP_STOP,
    DROOP_STOP,
    OUTSIDE,
    SERIES_STIFFNESS,
    SPRING_CURVE,
) = range(11)

CURVE_KNOTS = 15
"""Knots of a free damping curve on either side of rest."""
CURVE_FIRST = 0.00625
"""Speed of the first of them, m/s: the last is at 0.8 m/s."""
SPRING_KNOTS = 10
"""Knots of a free spring curve on either side of rest."""
SPRING_FIRST = 0.004
"""Deflection of the first of them, m: the last is at 90.5 mm."""
KNOT_RATIO = math.sqrt(2.0)
"""Speed or deflection of each next knot over that of the last."""

_NUMBERS = 2 * max(CURVE_KNOTS, SPRING_KNOTS) + 1
_COLUMNS = 2 + _NUMBERS

_DEFLECTION, _RATE, _DAMPER, _SPRING, _ADDED = 0, 1, 2, 4, 6
LAW_PARTS = 9
"""Of a suspension element, over which laws compose: deflection (m) and its rate (m/s), the factor
of the damper's force and its slope in the rate, that of the spring's force and its slope in the
deflection, and a force that is added (N) with its slopes in both."""

Array = NDArray[np.float64]
Numbers = Sequence[Vector]
Pair = tuple[Vector, Vector]


def table_of_laws(rows: Sequence[Sequence[float]]) -> Array:
    """Return laws (element, code, numbers …) as a table (K, P), filled up with zeros."""
    out = np.zeros((len(rows), _COLUMNS))
    for row, law in zip(out, rows, strict=True):
        row[: len(law)] = law
    return out


def _bound_rebound(p: Numbers, rate: Vector, share: Vector) -> Pair:
    """Take p0 = (ratio − 1)/(ratio + 1) and p1 = rounding, m/s."""
    root = sqrt(rate * rate + p[1] * p[1])
    return 1.0 + p[0] * rate / root, p[0] * p[1] * p[1] / (root * root * root)


def _digressive(p: Numbers, rate: Vector, share: Vector) -> Pair:
    """Take p0 = 1/knee, s/m, and p1 = share of the slope at rest that is lost far beyond it."""
    x = rate * p[0]
    flat = 1.0 / sqrt(1.0 + x * x)
    return 1.0 - p[1] * (1.0 - flat), -p[1] * p[0] * x * flat * flat * flat


def _fade(p: Numbers, rate: Vector, share: Vector) -> Pair:
    """Take p0 = share lost at the end and p1 = how it levels off."""
    bent = abs(p[1]) - 1e-6
    bend = where_positive(bent, p[1], 1.0)
    come = where_positive(bent, expm1(-bend * share) / expm1(-bend), share)
    return 1.0 - p[0] * come, 0.0 * rate


def _damper_curve(p: Numbers, rate: Vector, share: Vector) -> Pair:
    """Take slopes at the knots over c, from the fastest compression on."""
    return _on_curve(p, CURVE_KNOTS, CURVE_FIRST, KNOT_RATIO, rate)


def _on_curve(p: Numbers, knots: int, first: float, ratio: float, x: Vector) -> Pair:
    """Return the factor of a force whose slope is piecewise linear, and the factor's slope.

    The first knot on either side is at ``first``, each next one at ``ratio`` times the distance of
    the last; beyond the last the slope stays.
    """
    far = abs(x)
    at = slope = p[knots]
    total = 0.0 * far
    low, high = 0.0, first
    for knot in range(1, knots + 1):
        after = where_positive(x, p[knots + knot], p[knots - knot])
        beyond = where_positive(far - low, far - low, 0.0)
        come = where_positive(beyond - (high - low), high - low, beyond)
        gained = (after - slope) * (come * (1.0 / (high - low)))
        total = total + come * (slope + 0.5 * gained)
        at, slope, low, high = at + gained, after, high, ratio * high
    total = total + where_positive(far - low, far - low, 0.0) * slope
    away = far - 1e-9
    safe = where_positive(away, far, 1.0)
    factor = where_positive(away, total / safe, at)
    bend = where_positive(away, (at - factor) / safe, 0.0)
    return factor, where_positive(x, bend, -bend)


def _progressive(p: Numbers, delta: Vector) -> Pair:
    """Take p0 = κ, 1/m², and p1 = share of κ² δ⁴."""
    x = p[0] * delta * delta
    return 1.0 + x + p[1] * x * x, (2.0 * p[0] + 4.0 * p[1] * p[0] * x) * delta


def _spring_curve(p: Numbers, delta: Vector) -> Pair:
    """Take slopes at the knots over k, from the deepest compression on."""
    return _on_curve(p, SPRING_KNOTS, SPRING_FIRST, KNOT_RATIO, delta)


def _coulomb(p: Numbers, delta: Vector, rate: Vector, time: Vector) -> tuple[Vector, ...]:
    """Take p0 = force, N, and p1 = slip speed, m/s: steady motion, without the memory of p2."""
    root = sqrt(rate * rate + p[1] * p[1])
    slope = p[0] * p[1] * p[1] / (root * root * root)
    return -p[0] * rate / root, 0.0 * rate, -slope


def _stop(sign: float) -> Callable[..., tuple[Vector, ...]]:
    def force(p: Numbers, delta: Vector, rate: Vector, time: Vector) -> tuple[Vector, ...]:
        """Take p0 = gap, m, p1 = rate, N/m, p2 = rounding, m, and p3 = power."""
        deep, slope = _rounded(sign * delta - p[0], p[2])
        at_rest, _ = _rounded(-p[0], p[2])
        scale = p[1] * p[2]
        pushed = scale * power(deep / p[2], p[3])
        added = pushed - scale * power(at_rest / p[2], p[3])
        return -sign * added, -p[3] * pushed / deep * slope, 0.0 * delta

    return force


def _rounded(beyond: Vector, width: Vector) -> Pair:
    """Return max(beyond, 0) rounded over a width, never quite zero, and its slope."""
    root = sqrt(beyond * beyond + width * width)
    # of numbers of like size the difference would lose its digits
    value = 0.5 * where_positive(beyond, beyond + root, width * width / (root - beyond))
    return value, value / root


def _outside(p: Numbers, delta: Vector, rate: Vector, time: Vector) -> tuple[Vector, ...]:
    """Take p0 = force, N, p1 = start, p2 = duration, and p3 = rise, s."""
    nothing = 0.0 * time
    up = _ramp((time - p[1]) / p[3] + 0.5)
    down = _ramp((time - p[1] - p[2]) / p[3] + 0.5)
    return p[0] * (up - down), nothing, nothing


def _ramp(x: Vector) -> Vector:
    """Return a cubic from 0 to 1, level at both ends and beyond."""
    inside: Vector = where_positive(x, where_positive(x - 1.0, 1.0, x), 0.0)
    return inside * inside * (3.0 - 2.0 * inside)


_DAMPER_LAWS: dict[int, Callable[..., Pair]] = {
    BOUND_REBOUND: _bound_rebound,
    DIGRESSIVE: _digressive,
    FADE: _fade,
    DAMPER_CURVE: _damper_curve,
}
"""Factor of a damper's force, and its slope in the rate."""
_SPRING_LAWS: dict[int, Callable[..., Pair]] = {
    PROGRESSIVE: _progressive,
    SPRING_CURVE: _spring_curve,
}
"""Factor of a spring's force, and its slope in the deflection."""
_FORCES: dict[int, Callable[..., tuple[Vector, ...]]] = {
    COULOMB: _coulomb,
    BUMP_STOP: _stop(-1.0),
    DROOP_STOP: _stop(1.0),
    OUTSIDE: _outside,
}
"""Force on the body (N), and its slopes in deflection and rate."""
_ON_DAMPER = tuple(_DAMPER_LAWS)
WITH_MEMORY = (SERIES_STIFFNESS, COULOMB)
"""Laws whose force depends on the past and is a state of its own, in the order of those states."""


@emitted
def _law_vectors(code: Choice, moment: Table, row: Table, parts: Table) -> None:
    """Apply a law to an element.

    Parameters
    ----------
    code : int
        Of the law.
    moment : (2,) table
        Time in the recording (s), and the share of the recording that has gone by.
    row : (P,) table
        The law.
    parts : (LAW_PARTS,) table
        Of the element; changed in place.
    """
    moment, row, parts = moment.shaped(2), row.shaped(_COLUMNS), parts.shaped(LAW_PARTS)
    for one in code.among([*_DAMPER_LAWS, *_SPRING_LAWS, *_FORCES]):
        p = [row[2 + n] for n in range(_NUMBERS)]
        delta, rate = parts[_DEFLECTION], parts[_RATE]
        if one in _FORCES:
            for n, value in enumerate(_FORCES[one](p, delta, rate, moment[0])):
                parts[_ADDED + n] = parts[_ADDED + n] + value
            continue
        if one in _DAMPER_LAWS:
            at, (factor, slope) = _DAMPER, _DAMPER_LAWS[one](p, rate, moment[1])
        else:
            at, (factor, slope) = _SPRING, _SPRING_LAWS[one](p, delta)
        before = parts[at]
        parts[at + 1] = parts[at + 1] * factor + before * slope
        parts[at] = before * factor


@njit(**INLINE)
def apply_laws(table: Array, moment: Array, dampers: bool, friction: bool, parts: Array) -> None:
    """Apply all laws to all elements.

    Parameters
    ----------
    table : (K, P, L) array
        See the module; elements and codes are those of lane 0.
    moment : (2, L) array
        Time in the recording (s), and the share of the recording that has gone by.
    dampers, friction : bool
        Whether those of dampers and of friction are applied as well.
    parts : (ne, LAW_PARTS, L) array
        Of the elements; changed in place.
    """
    for row in range(table.shape[0]):
        code = int(table[row, 1, 0])
        if (dampers or code not in _ON_DAMPER) and (friction or code != COULOMB):
            _law_vectors(code, moment, table[row], parts[int(table[row, 0, 0])])


@njit(**INLINE)
def damper_forces(
    table: Array,
    element: int,
    c: Array,
    rate: Array,
    moment: Array,
    parts: Array,
    force: Array,
    slope: Array,
) -> None:
    """Fill the forces of an element's damper against its rate of deflection, and their slopes.

    ``c``, ``rate``, ``force`` and ``slope`` are (L,), ``parts`` (LAW_PARTS, L) is room to work in.
    """
    for q in range(LANES):
        parts[_RATE, q], parts[_DAMPER, q], parts[_DAMPER + 1, q] = rate[q], 1.0, 0.0
    for row in range(table.shape[0]):
        code = int(table[row, 1, 0])
        if table[row, 0, 0] == element and code in _ON_DAMPER:
            _law_vectors(code, moment, table[row], parts)
    for q in range(LANES):
        force[q] = c[q] * rate[q] * parts[_DAMPER, q]
        slope[q] = c[q] * (parts[_DAMPER, q] + rate[q] * parts[_DAMPER + 1, q])


@njit(**INLINE)
def row_of_law(table: Array, element: int, code: int) -> int:
    """Return the row of a law of an element; −1 if there is none."""
    found = -1
    for row in range(table.shape[0]):
        if table[row, 0, 0] == element and table[row, 1, 0] == code:
            found = row
    return found


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
    """Return the forces of an element beyond −k δ − c δ̇ (N), and their slopes in δ and δ̇.

    Parameters
    ----------
    table : (K, P) array
        The laws; see the module.
    element : int
        Which suspension element.
    c, k : float
        Damping rate (N·s/m) and spring rate (N/m).
    delta, rate, time : (N,) arrays
        Deflection (m) and its rate (m/s), extension positive, and time in the recording (s).
    end : float
        Length of the recording, s.

    Returns
    -------
    (N, 3) array
    """
    own = table[table[:, 0] == element]
    laws = np.empty((*own.shape, LANES))
    for row in range(own.shape[0]):
        for column in range(own.shape[1]):
            laws[row, column] = own[row, column]
        laws[row, 0] = 0.0
    moment, parts = np.empty((2, LANES)), np.empty((1, LAW_PARTS, LANES))
    out = np.empty((len(delta), 3))
    for first in range(0, len(delta), LANES):
        parts[:] = 0.0
        for q in range(LANES):
            n = min(first + q, len(delta) - 1)
            moment[0, q], moment[1, q] = time[n], time[n] / end
            parts[0, _DEFLECTION, q], parts[0, _RATE, q] = delta[n], rate[n]
            parts[0, _DAMPER, q], parts[0, _SPRING, q] = 1.0, 1.0
        apply_laws(laws, moment, True, True, parts)
        for q in range(min(LANES, len(delta) - first)):
            of, d, v = parts[0, :, q], delta[first + q], rate[first + q]
            spring, damper = of[_SPRING] - 1.0, of[_DAMPER] - 1.0
            out[first + q, 0] = of[_ADDED] - k * d * spring - c * v * damper
            out[first + q, 1] = of[_ADDED + 1] - k * (spring + d * of[_SPRING + 1])
            out[first + q, 2] = of[_ADDED + 2] - c * (damper + v * of[_DAMPER + 1])
    return out
