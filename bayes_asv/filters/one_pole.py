"""First-order low-pass filter at stamps that need not be even."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.prediction import OPTIONS

__all__ = ["low_passed"]

Array = NDArray[np.float64]


@njit(**OPTIONS)
def low_passed(time: Array, pieces: Array, pole: float) -> Array:
    """Pass a signal that is a cubic between two stamps through ω/(s + ω), exactly.

    Of a polynomial u the filter makes u − u'/ω + u''/ω² − u'''/ω³, and forgets what it held.

    Parameters
    ----------
    time : (N,) array
        Stamps, s.
    pieces : (4, N − 1) array
        Coefficients of each cubic in the time since its stamp, the highest power first (as
        ``scipy.interpolate.CubicSpline`` keeps them).
    pole : float
        ω, rad/s.

    Returns
    -------
    (N,) array
        At the stamps; the filter holds the signal's first value when it begins.
    """
    out = np.empty(len(time))
    out[0] = pieces[3, 0]
    for k in range(len(time) - 1):
        h = time[k + 1] - time[k]
        third, second = 6.0 * pieces[0, k] / pole, 2.0 * pieces[1, k]
        first, value = pieces[2, k], pieces[3, k]
        begin = value - (first - (second - third) / pole) / pole
        value += h * (first + h * (0.5 * second + h * pieces[0, k]))
        first += h * (second + 3.0 * h * pieces[0, k])
        second += 6.0 * h * pieces[0, k]
        end = value - (first - (second - third) / pole) / pole
        out[k + 1] = end + (out[k] - begin) * math.exp(-pole * h)
    return out
