"""A cubic spline through samples as they arrive, compiled.

The second derivatives M of a cubic spline at its knots solve a tridiagonal system.  Its forward
elimination runs in time, sample by sample.  In the back substitution the influence of a later
sample decays by a factor 2 − √3 = 0.27 per sample, so that a few samples of lookahead are as good
as all.  The end pieces are parabolas.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.prediction import OPTIONS, ORDER

__all__ = ["forward_elimination", "interpolation_errors", "spline_coefficients", "step_moments"]

Array = NDArray[np.float64]

_INV_FACT = np.array([1.0 / math.factorial(j) for j in range(ORDER + 5)])


@njit(**OPTIONS)
def forward_elimination(
    first: int,
    time: Array,
    value: Array,
    starts: NDArray[np.bool_],
    superdiagonal: Array,
    rhs: Array,
) -> None:
    """Continue the forward elimination up to the last sample but one.

    Parameters
    ----------
    first : int
        First row that is not eliminated yet.
    time, value : (K,) arrays
        Samples, s and m/s².
    starts : (K,) bool array
        Samples at which a new curve starts after a gap.
    superdiagonal, rhs : (K,) arrays
        Row k reads M_k + superdiagonal_k M_{k+1} = rhs_k; filled from ``first`` on.
    """
    for k in range(first, time.shape[0] - 1):
        if starts[k] or k == 0:
            superdiagonal[k], rhs[k] = -1.0, 0.0  # M_k = M_{k+1}: a parabola
            continue
        if starts[k + 1]:
            superdiagonal[k], rhs[k] = 0.0, 0.0  # not used: the curve ends here
            continue
        before = time[k] - time[k - 1]
        after = time[k + 1] - time[k]
        slope = (value[k + 1] - value[k]) / after - (value[k] - value[k - 1]) / before
        pivot = 1.0 / (2.0 * (before + after) - before * superdiagonal[k - 1])
        superdiagonal[k] = after * pivot
        rhs[k] = (6.0 * slope - before * rhs[k - 1]) * pivot


@njit(**OPTIONS)
def interpolation_errors(
    first: int, last: int, time: Array, value: Array, starts: NDArray[np.bool_], out: Array
) -> None:
    """Fill out[first:last] with the squared error of the cubic through four neighbours.

    Zero where a sample lacks two neighbours on either side.
    """
    for k in range(first, last):
        out[k] = 0.0
        if k < 2 or k + 2 >= time.shape[0]:
            continue
        if starts[k - 1] or starts[k] or starts[k + 1] or starts[k + 2]:
            continue
        predicted = 0.0
        for j in (-2, -1, 1, 2):
            weight = 1.0
            for other in (-2, -1, 1, 2):
                if other != j:
                    weight *= (time[k] - time[k + other]) / (time[k + j] - time[k + other])
            predicted += weight * value[k + j]
        out[k] = (value[k] - predicted) ** 2


@njit(**OPTIONS)
def spline_coefficients(
    first: int,
    last: int,
    lookahead: int,
    time: Array,
    value: Array,
    starts: NDArray[np.bool_],
    superdiagonal: Array,
    rhs: Array,
    out: Array,
) -> None:
    """Fill out[first:last] (…, 4) with u, u', u''/2, u'''/6 at the left end of each interval.

    The back substitution starts ``lookahead`` samples after that end, or at the last one.
    """
    for k in range(first, last):
        end = k + 1
        while end < k + lookahead and end + 1 < time.shape[0] and not starts[end + 1]:
            end += 1
        m_right = (
            rhs[end - 1] / (1.0 + superdiagonal[end - 1]) if superdiagonal[end - 1] > -1.0 else 0.0
        )
        m_left = m_right
        for j in range(end - 1, k - 1, -1):
            m_left = rhs[j] - superdiagonal[j] * m_right
            if j > k:
                m_right = m_left
        h = time[k + 1] - time[k]
        out[k, 0] = value[k]
        out[k, 1] = (value[k + 1] - value[k]) / h - h * (2.0 * m_left + m_right) / 6.0
        out[k, 2] = 0.5 * m_left
        out[k, 3] = (m_right - m_left) / (6.0 * h)


@njit(**OPTIONS)
def step_moments(
    instants: Array,
    before: float,
    knots: Array,
    curve: Array,
    sd: Array,
    gaps: NDArray[np.bool_],
    moments: Array,
    spread: Array,
    covered: NDArray[np.bool_],
    ends: Array,
) -> None:
    """Integrate a wheel's spline over each step.

    Parameters
    ----------
    instants : (E,) array
        Ends of the steps, s, in order.
    before : float
        Start of the first step, s.
    knots : (K,) array
        Times of the samples, s; all steps end before the last.
    curve : (K, 4) array
        Spline coefficients; row k belongs to the interval that starts at sample k.
    sd : (K,) array
        Standard deviation of the mean over each interval, which the spline cannot know, m/s².
    gaps : (K,) bool array
        Intervals without a curve.
    moments : (E, ORDER) array
        Filled with ∫₀ʰ (h−s)ʲ/j! û ds.
    spread : (E, 2) array
        Filled with the length of the interval (s) and ``sd``² times that length (m²/s³), for the
        interval in which the middle of the step lies.
    covered : (E,) bool array
        Set to False where a part of the step has no curve.
    ends : (E, 2) array
        Filled with the acceleration at the beginning and at the end of each step, m/s².
    """
    first = 0
    left = before
    piece = np.empty(ORDER)
    for e in range(instants.shape[0]):
        right = instants[e]
        for j in range(ORDER):
            moments[e, j] = 0.0
        spread[e, 0] = spread[e, 1] = ends[e, 0] = ends[e, 1] = 0.0
        while first + 2 < knots.shape[0] and knots[first + 1] <= left:
            first += 1
        if left < knots[0] - 1e-9 or right > knots[knots.shape[0] - 1] + 1e-9:
            covered[e] = False
            left = right
            continue
        middle = 0.5 * (left + right)
        k = first
        start = left
        while True:
            if gaps[k]:
                covered[e] = False
                break
            continues = k + 2 < knots.shape[0] and knots[k + 1] < right
            end = knots[k + 1] if continues else right
            if knots[k] <= middle and (middle < knots[k + 1] or not continues):
                spread[e, 0] = knots[k + 1] - knots[k]
                spread[e, 1] = sd[k] ** 2 * spread[e, 0]
            span = end - start
            t = start - knots[k]
            c3 = curve[k, 3]
            c2 = curve[k, 2] + 3.0 * c3 * t
            c1 = curve[k, 1] + (2.0 * curve[k, 2] + 3.0 * c3 * t) * t
            c0 = curve[k, 0] + (curve[k, 1] + (curve[k, 2] + c3 * t) * t) * t
            if start == left:
                ends[e, 0] = c0
            ends[e, 1] = c0 + (c1 + (c2 + c3 * span) * span) * span
            if span > 0.0:
                power = span
                for j in range(ORDER):
                    # ∫₀ˢ (s−τ)ʲ/j! τ^q dτ = q! s^(j+q+1)/(j+q+1)!
                    piece[j] = power * (
                        c0 * _INV_FACT[j + 1]
                        + span
                        * (
                            c1 * _INV_FACT[j + 2]
                            + span
                            * (2.0 * c2 * _INV_FACT[j + 3] + span * 6.0 * c3 * _INV_FACT[j + 4])
                        )
                    )
                    power *= span
                rest = right - end
                if rest > 0.0:
                    for j in range(ORDER):
                        weight = 1.0
                        for q in range(j + 1):
                            moments[e, j] += weight * piece[j - q]
                            weight *= rest / (q + 1)
                else:
                    for j in range(ORDER):
                        moments[e, j] += piece[j]
            if not continues:
                break
            start = end
            k += 1
        left = right
