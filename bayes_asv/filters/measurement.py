"""Measurement update of a Kalman filter, one output at a time, compiled into each filter.

Output y reads C x + b + v + white noise.  A reading at the rail of its sensor is a bound: its
log-likelihood is that of a tail of the normal distribution, and the state is conditioned on it by
matching two moments.  Arrays end in an axis of lanes, as in :mod:`.prediction`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.prediction import INLINE
from bayes_asv.filters.tails import upper_tail

__all__ = [
    "AT_LEAST", "AT_MOST", "LOG_2PI", "MISSING", "VALUE", "condition", "condition_on_bound",
    "condition_on_value", "predicted_reading", "project",
]  # fmt: skip

Array = NDArray[np.float64]

MISSING, VALUE, AT_LEAST, AT_MOST = 0, 1, 2, 3  # kinds of reading
LOG_2PI = math.log(2.0 * math.pi)


@njit(**INLINE)
def project(
    y: int, rows: int, coupled: int, ny: int, lanes: int, C: Array, P: Array, PC: Array, S: Array
) -> None:
    """Fill P hᵀ (n, L) and h P hᵀ (L,) of output y, whose row h is C, one for b and one for v."""
    n = coupled + 2 * ny
    b_y, v_y = coupled + y, coupled + ny + y
    for b in range(n):
        for q in range(lanes):
            total = P[b_y, b, q] + P[v_y, b, q]
            for a in range(rows):
                total += C[y, a, q] * P[a, b, q]
            PC[b, q] = total
    for q in range(lanes):
        total = PC[b_y, q] + PC[v_y, q]
        for a in range(rows):
            total += C[y, a, q] * PC[a, q]
        S[q] = total


@njit(**INLINE)
def predicted_reading(
    y: int, rows: int, coupled: int, ny: int, lanes: int, C: Array, mean: Array, out: Array
) -> None:
    """Fill the predicted reading (L,) of output y."""
    for q in range(lanes):
        total = mean[coupled + y, q] + mean[coupled + ny + y, q]
        for a in range(rows):
            total += C[y, a, q] * mean[a, q]
        out[q] = total


@njit(**INLINE)
def condition_on_value(
    lanes: int, reading: float, S: Array, shift: Array, shrink: Array, squared: Array
) -> None:
    """Fill the gains of a reading whose predictions stand in ``shift``; add ν² to ``squared``."""
    for q in range(lanes):
        left = reading - shift[q]
        inverse = 1.0 / S[q]
        shift[q] = left * inverse
        shrink[q] = inverse
        squared[q] += left * left * inverse


@njit(**INLINE)
def condition_on_bound(
    lanes: int, at_least: bool, bound: float, S: Array, shift: Array, shrink: Array, total: Array
) -> None:
    """Fill the gains of a bound, predictions being in ``shift``; add its log p to ``total``."""
    sign = 1.0 if at_least else -1.0
    for q in range(lanes):
        root = math.sqrt(S[q])
        z = sign * (bound - shift[q]) / root
        log_tail, hazard = upper_tail(z)
        total[q] += log_tail
        shift[q] = sign * hazard / root
        shrink[q] = hazard * (hazard - z) / S[q]


@njit(**INLINE)
def condition(
    n: int, lanes: int, PC: Array, shift: Array, shrink: Array, mean: Array, P: Array
) -> None:
    """Update mean (n, L) and covariance (n, n, L): m + P hᵀ shift, P − P hᵀ shrink h P."""
    for a in range(n):
        for q in range(lanes):
            mean[a, q] += PC[a, q] * shift[q]
    for a in range(n):
        for b in range(n):
            for q in range(lanes):
                P[a, b, q] -= (PC[a, q] * shrink[q]) * PC[b, q]
