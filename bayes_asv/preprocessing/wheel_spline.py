"""Spline interpolation of the measured wheel accelerations.

With linear interpolation, intervals were two to four times too narrow on sharp bumps; with a cubic
spline, their coverage was correct.  The spline enters the half car through its exact moments over
each step, ∫ (h−s)ʲ/j! u(s) ds, which do not depend on the car and are computed once.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bayes_asv.filters.one_pole import low_passed

__all__ = [
    "JUMP_SHARE",
    "NOISE_MARGIN",
    "WheelSignal",
    "interpolation_sd",
    "match_bandwidths",
    "moments",
    "wheel_signal",
]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Error of the integral of a cubic spline between two samples, relative to the leave-one-out error
# of the spline: 0.14 – 0.16 (rms over the position of the edge) for a jump behind a one-pole filter
# of 50 Hz, sampled at 200 to 800 Hz.  Kinks have smaller errors, unfiltered jumps larger ones.
JUMP_SHARE = 0.15
# Squared leave-one-out error that noise explains, in variances of that error by noise alone.
NOISE_MARGIN = 6.0


class WheelSignal(NamedTuple):
    """One wheel's acceleration between its samples.

    Parameters
    ----------
    spline : CubicSpline
        û(t) in m/s², through every usable sample.
    knots : (K,) array
        Times of those samples, s.
    sd : (K - 1,) array
        Standard deviation (m/s²) of the interpolation error of the mean of û over each interval: a
        spline cannot know where in the interval an edge was.
    """

    spline: CubicSpline
    knots: Array
    sd: Array


def match_bandwidths(time: Array, signal: Array, bandwidth: float, target: float) -> Array:
    """Replace the one-pole filter of a signal's sensor by a slower one.

    A common filter on inputs and outputs does not change a linear relation; sensors of different
    bandwidths do.  Filtering with (1 + s/ω) / (1 + s/ω₀) makes the bandwidths equal.

    Parameters
    ----------
    time, signal : (N,) arrays
        Times (s) and samples, interpolated linearly.
    bandwidth, target : float
        Corner frequencies of the sensor and of the common filter, Hz.

    Returns
    -------
    (N,) array
        Readings of a sensor with the target bandwidth.
    """
    if bandwidth <= target * (1.0 + 1e-9):
        return signal
    pieces = np.zeros((4, len(signal) - 1))
    pieces[2], pieces[3] = np.diff(signal) / np.diff(time), signal[:-1]
    slow = low_passed(time, pieces, 2.0 * math.pi * target)
    share = target / bandwidth
    return np.asarray(share * signal + (1.0 - share) * slow)


def interpolation_sd(time: Array, signal: Array) -> Array:
    """Return the standard deviation of the interpolation error of an interval's mean acceleration.

    Each sample is predicted by the cubic through its four neighbours.  The prediction error, less
    the share of the noise, measures how sharp the signal is there.

    Parameters
    ----------
    time, signal : (K,) arrays
        Times (s) and samples (m/s²).

    Returns
    -------
    (K - 1,) array
        Standard deviation, m/s².
    """
    n = len(time)
    squared_error = np.zeros(n)
    if n >= 5:
        t = [time[j : n - 4 + j] for j in range(5)]
        predicted = np.zeros(n - 4)
        for j in (0, 1, 3, 4):
            weight = np.ones(n - 4)
            for other in (0, 1, 3, 4):
                if other != j:
                    weight *= (t[2] - t[other]) / (t[j] - t[other])
            predicted += weight * signal[j : n - 4 + j]
        squared_error[2:-2] = (signal[2:-2] - predicted) ** 2
        # noise level from the quarter with the smallest errors: the lower quartile of χ²(1) is
        # 0.1015
        noise = float(np.quantile(squared_error[2:-2], 0.25)) / 0.1015
        squared_error = np.maximum(squared_error - NOISE_MARGIN * noise, 0.0)
    padded = np.concatenate([squared_error[:1], squared_error, squared_error[-1:]])
    local = 0.25 * (padded[:-3] + padded[1:-2] + padded[2:-1] + padded[3:])
    return np.asarray(JUMP_SHARE * np.sqrt(local))


def wheel_signal(time: Array, signal: Array, low: Flags, high: Flags) -> WheelSignal:
    """Interpolate one wheel channel.

    Parameters
    ----------
    time : (N,) array
        True times of the samples, s, increasing.
    signal : (N,) array
        Accelerations, m/s²; NaN where missing.
    low, high : (N,) bool arrays
        Readings at the lower or upper rail: bounds, not values.

    Returns
    -------
    WheelSignal
        A clipped sample is extrapolated from its neighbours, but not to inside the rail, and its
        intervals get a standard deviation as large as that excursion.
    """
    finite = np.isfinite(signal)
    clipped = finite & (low | high)
    unclipped = finite & ~clipped
    value = signal.copy()
    if clipped.any():
        guess = CubicSpline(time[unclipped], signal[unclipped])(time[clipped])
        beyond = np.where(high[clipped], 1.0, -1.0) * (guess - signal[clipped])
        # a spline over a wide gap is unreliable: limit the excursion to the value of the rail
        beyond = np.clip(beyond, 0.0, np.abs(signal[clipped]))
        value[clipped] += np.where(high[clipped], beyond, -beyond)
    knots, value = time[finite], value[finite]
    deviation = interpolation_sd(knots, value)
    if clipped.any():
        excess = np.abs(value - signal[finite])
        reach = np.where(clipped[finite], np.maximum(excess, 0.1 * np.abs(value)), 0.0)
        deviation = np.maximum(deviation, 0.5 * (reach[:-1] + reach[1:]))
    return WheelSignal(CubicSpline(knots, value), knots, deviation)


def moments(signal: WheelSignal, instants: Array, order: int) -> Array:
    """∫₀ʰ (h−s)ʲ/j! û(t+s) ds over each step between instants, exactly.

    Parameters
    ----------
    signal : WheelSignal
        The wheel's acceleration.
    instants : (N,) array
        Increasing times, s.
    order : int
        Number of moments, at most 10.

    Returns
    -------
    (N, order) array
        Moments; row k belongs to the step that ends at instant k, and row 0 is zero.
    """
    n = len(instants)
    inside = signal.knots[(signal.knots > instants[0]) & (signal.knots < instants[-1])]
    edges = np.union1d(instants, inside)
    left, right = edges[:-1], edges[1:]
    # each piece is a cubic times a weight of degree below `order`: Gauss–Legendre is exact
    nodes, weights = np.polynomial.legendre.leggauss((order + 4) // 2 + 1)
    half = 0.5 * (right - left)
    t = (0.5 * (left + right))[:, None] + half[:, None] * nodes
    u = signal.spline(t)
    end = np.searchsorted(instants, 0.5 * (left + right))
    lag = instants[end][:, None] - t
    out = np.zeros((n, order))
    weighted = u * weights * half[:, None]
    starts = np.searchsorted(end, np.arange(1, n))
    for j in range(order):
        piece = weighted.sum(axis=1)
        out[1:, j] = np.add.reduceat(piece, starts)
        weighted = weighted * lag / (j + 1)
    return out
