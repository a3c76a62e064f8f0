"""A filter with one pole, at stamps that need not be even."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.kernels.steps import OPTIONS

__all__ = ["low_passed"]

Array = NDArray[np.float64]


@njit(**OPTIONS)
def low_passed(time: Array, signal: Array, pole: float) -> Array:
    """Pass a signal, straight lines between its samples, through ω/(s + ω), exactly.

    Parameters
    ----------
    time, signal : (N,) arrays
        Stamps (s) and samples; at rest at the first one before it.
    pole : float
        ω, rad/s.

    Returns
    -------
    (N,) array
    """
    slow = np.empty_like(signal)
    slow[0] = signal[0]
    for k in range(1, len(signal)):
        h = time[k] - time[k - 1]
        lag = (signal[k] - signal[k - 1]) / (h * pole)
        slow[k] = signal[k] - lag + (slow[k - 1] - signal[k - 1] + lag) * math.exp(-pole * h)
    return slow
