"""A cubic spline through samples as they come in, compiled.

The second derivatives of a cubic spline solve a tridiagonal system.  Its elimination runs forward
in time, sample by sample; the way back fades by a factor of 0.27 a sample, so a few samples ahead
are as good as all.  Ends are parabolas.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.discretization import OPTIONS, ORDER

__all__ = ["eliminate", "missed", "pieces", "step_moments"]

Array = NDArray[np.float64]

_SHARES = np.array([1.0 / math.factorial(j) for j in range(ORDER + 5)])


@njit(**OPTIONS)
def eliminate(
    first: int, time: Array, value: Array, opens: NDArray[np.bool_], upper: Array, right: Array
) -> None:
    """Carry the elimination on to the last sample but one.

    Parameters
    ----------
    first : int
        First sample whose row was not eliminated yet.
    time, value : (K,) arrays
        Samples, s and m/s².
    opens : (K,) bool array
        Samples with which a curve begins: nothing joins them to the one before.
    upper, right : (K,) arrays
        Row k says M_k + upper_k M_{k+1} = right_k; filled from ``first`` on.
    """
    for k in range(first, time.shape[0] - 1):
        if opens[k] or k == 0:
            upper[k], right[k] = -1.0, 0.0  # M_k = M_{k+1}: the curve begins as a parabola
            continue
        if opens[k + 1]:
            upper[k], right[k] = 0.0, 0.0  # never asked for
            continue
        before = time[k] - time[k - 1]
        after = time[k + 1] - time[k]
        slope = (value[k + 1] - value[k]) / after - (value[k] - value[k - 1]) / before
        pivot = 1.0 / (2.0 * (before + after) - before * upper[k - 1])
        upper[k] = after * pivot
        right[k] = (6.0 * slope - before * right[k - 1]) * pivot


@njit(**OPTIONS)
def missed(
    first: int, last: int, time: Array, value: Array, opens: NDArray[np.bool_], out: Array
) -> None:
    """Fill out[first:last] with the square of what a cubic through four neighbours misses."""
    for k in range(first, last):
        out[k] = 0.0
        if k < 2 or k + 2 >= time.shape[0]:
            continue
        if opens[k - 1] or opens[k] or opens[k + 1] or opens[k + 2]:
            continue
        guess = 0.0
        for j in (-2, -1, 1, 2):
            weight = 1.0
            for other in (-2, -1, 1, 2):
                if other != j:
                    weight *= (time[k] - time[k + other]) / (time[k + j] - time[k + other])
            guess += weight * value[k + j]
        out[k] = (value[k] - guess) ** 2


@njit(**OPTIONS)
def pieces(
    first: int,
    last: int,
    ahead: int,
    time: Array,
    value: Array,
    opens: NDArray[np.bool_],
    upper: Array,
    right: Array,
    out: Array,
) -> None:
    """Fill out[first:last] (…, 4) with u, u', u''/2, u'''/6 at the left end of each interval.

    ``ahead`` samples beyond an interval's left end are looked at, or as many as there are.
    """
    for k in range(first, last):
        end = k + 1
        while end < k + ahead and end + 1 < time.shape[0] and not opens[end + 1]:
            end += 1
        later = right[end - 1] / (1.0 + upper[end - 1]) if upper[end - 1] > -1.0 else 0.0
        here = later
        for j in range(end - 1, k - 1, -1):
            here = right[j] - upper[j] * later
            if j > k:
                later = here
        h = time[k + 1] - time[k]
        out[k, 0] = value[k]
        out[k, 1] = (value[k + 1] - value[k]) / h - h * (2.0 * here + later) / 6.0
        out[k, 2] = 0.5 * here
        out[k, 3] = (later - here) / (6.0 * h)


@njit(**OPTIONS)
def step_moments(
    instants: Array,
    before: float,
    knots: Array,
    curve: Array,
    deviation: Array,
    closed: NDArray[np.bool_],
    moments: Array,
    spread: Array,
    known: NDArray[np.bool_],
) -> None:
    """Integrate a wheel's curve over each step.

    Parameters
    ----------
    instants : (E,) array
        Ends of the steps, s, in order.
    before : float
        Where the first step begins, s.
    knots : (K,) array
        Times of the samples, s; all steps end before the last.
    curve : (K, 4) array
        Pieces; row k belongs to the interval that begins at sample k.
    deviation : (K,) array
        Deviation of the mean over each interval for what happened between the samples, m/s².
    closed : (K,) bool array
        Intervals over which there is no curve.
    moments : (E, ORDER) array
        Filled with ∫₀ʰ (h−s)ʲ/j! û ds.
    spread : (E, 2) array
        Filled with length (s) and intensity (m²/s³) as in ``kernels.innovations``.
    known : (E,) bool array
        Set to False where a step is not all on a curve.
    """
    at = 0
    left = before
    own = np.empty(ORDER)
    for e in range(instants.shape[0]):
        right = instants[e]
        for j in range(ORDER):
            moments[e, j] = 0.0
        spread[e, 0] = spread[e, 1] = 0.0
        while at + 2 < knots.shape[0] and knots[at + 1] <= left:
            at += 1
        if left < knots[0] - 1e-9 or right > knots[knots.shape[0] - 1] + 1e-9:
            known[e] = False
            left = right
            continue
        middle = 0.5 * (left + right)
        here = at
        begin = left
        while True:
            if closed[here]:
                known[e] = False
                break
            inner = here + 2 < knots.shape[0] and knots[here + 1] < right
            end = knots[here + 1] if inner else right
            if knots[here] <= middle and (middle < knots[here + 1] or not inner):
                spread[e, 0] = knots[here + 1] - knots[here]
                spread[e, 1] = deviation[here] ** 2 * spread[e, 0]
            span = end - begin
            if span > 0.0:
                t = begin - knots[here]
                c3 = curve[here, 3]
                c2 = curve[here, 2] + 3.0 * c3 * t
                c1 = curve[here, 1] + (2.0 * curve[here, 2] + 3.0 * c3 * t) * t
                c0 = curve[here, 0] + (curve[here, 1] + (curve[here, 2] + c3 * t) * t) * t
                power = span
                for j in range(ORDER):
                    # ∫₀ˢ (s−τ)ʲ/j! τ^q dτ = q! s^(j+q+1)/(j+q+1)!
                    own[j] = power * (
                        c0 * _SHARES[j + 1]
                        + span
                        * (
                            c1 * _SHARES[j + 2]
                            + span * (2.0 * c2 * _SHARES[j + 3] + span * 6.0 * c3 * _SHARES[j + 4])
                        )
                    )
                    power *= span
                rest = right - end
                if rest > 0.0:
                    for j in range(ORDER):
                        weight = 1.0
                        for q in range(j + 1):
                            moments[e, j] += weight * own[j - q]
                            weight *= rest / (q + 1)
                else:
                    for j in range(ORDER):
                        moments[e, j] += own[j]
            if not inner:
                break
            begin = end
            here += 1
        left = right
