"""Spline interpolation of the measured wheel accelerations.

A straight line between two samples is not what the wheel did: with straight lines the claimed
intervals were two to four times too narrow on sharp bumps, with a cubic spline they were
honest.  The spline enters the half car through its exact moments over each step,
∫ (h−s)ʲ/j! u(s) ds, which do not depend on the car and are computed once.
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

# Between two samples of a jump that passed a one-pole filter, the integral of a cubic spline
# errs by 0.14 – 0.16 of what the spline errs when it leaves one sample out, root mean square
# over the place of the jump, at 200 to 800 Hz behind 50 Hz (kinks err less, bare jumps more).
JUMP_SHARE = 0.15
NOISE_MARGIN = 6.0  # variances of the noise's own misses that are not taken for an edge


class WheelSignal(NamedTuple):
    """One wheel's acceleration between its samples.

    Parameters
    ----------
    spline : CubicSpline
        û(t) in m/s², through every usable sample.
    knots : (K,) array
        Times of those samples, s.
    sd : (K - 1,) array
        Deviation (m/s²) of the mean of û over each interval for what happened between the
        samples: a spline cannot know where in the interval an edge was.
    """

    spline: CubicSpline
    knots: Array
    sd: Array


def match_bandwidths(time: Array, signal: Array, bandwidth: float, target: float) -> Array:
    """Pass a signal on from its sensor's one-pole filter to a slower one.

    A common filter on inputs and outputs leaves a linear relation as it is; sensors of
    different bandwidth do not.  Filtering with (1 + s/ω) / (1 + s/ω₀) makes them equal.

    Parameters
    ----------
    time, signal : (N,) arrays
        Times (s) and samples; straight lines between them.
    bandwidth, target : float
        Pole of the sensor that took the signal, and of the common filter, Hz.

    Returns
    -------
    (N,) array
        What a sensor with the target's bandwidth would have read.
    """
    if bandwidth <= target * (1.0 + 1e-9):
        return signal
    pieces = np.zeros((4, len(signal) - 1))
    pieces[2], pieces[3] = np.diff(signal) / np.diff(time), signal[:-1]
    slow = low_passed(time, pieces, 2.0 * math.pi * target)
    share = target / bandwidth
    return np.asarray(share * signal + (1.0 - share) * slow)


def interpolation_sd(time: Array, signal: Array) -> Array:
    """Deviation of an interval's mean acceleration for what happened between its samples.

    Each sample is predicted by the cubic through its four neighbours.  What that misses, less
    the share of the noise, measures how sharp the signal is there.

    Parameters
    ----------
    time, signal : (K,) arrays
        Times (s) and samples (m/s²).

    Returns
    -------
    (K - 1,) array
        Deviation, m/s².
    """
    n = len(time)
    missed = np.zeros(n)
    if n >= 5:
        t = [time[j : n - 4 + j] for j in range(5)]
        predicted = np.zeros(n - 4)
        for j in (0, 1, 3, 4):
            weight = np.ones(n - 4)
            for other in (0, 1, 3, 4):
                if other != j:
                    weight *= (t[2] - t[other]) / (t[j] - t[other])
            predicted += weight * signal[j : n - 4 + j]
        missed[2:-2] = (signal[2:-2] - predicted) ** 2
        # The quiet quarter of the record shows what noise alone gives: of a χ²(1) variable
        # the lower quartile is 0.1015.
        noise = float(np.quantile(missed[2:-2], 0.25)) / 0.1015
        missed = np.maximum(missed - NOISE_MARGIN * noise, 0.0)
    padded = np.concatenate([missed[:1], missed, missed[-1:]])
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
        A clipped sample is put where its neighbours point, though never inside the rail, and
        its interval gets a deviation as large as that excursion.
    """
    there = np.isfinite(signal)
    clipped = there & (low | high)
    plain = there & ~clipped
    value = signal.copy()
    if clipped.any():
        guess = CubicSpline(time[plain], signal[plain])(time[clipped])
        beyond = np.where(high[clipped], 1.0, -1.0) * (guess - signal[clipped])
        # A spline over a wide gap can point anywhere: never further than the rail itself.
        beyond = np.clip(beyond, 0.0, np.abs(signal[clipped]))
        value[clipped] += np.where(high[clipped], beyond, -beyond)
    knots, value = time[there], value[there]
    deviation = interpolation_sd(knots, value)
    if clipped.any():
        excess = np.abs(value - signal[there])
        reach = np.where(clipped[there], np.maximum(excess, 0.1 * np.abs(value)), 0.0)
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
        Row k belongs to the step that ends at instant k; row 0 is zero.  Checked against
        adaptive quadrature in the tests.
    """
    n = len(instants)
    inside = signal.knots[(signal.knots > instants[0]) & (signal.knots < instants[-1])]
    edges = np.union1d(instants, inside)
    left, right = edges[:-1], edges[1:]
    # On a piece û is cubic and the weight of degree below `order`: Gauss–Legendre is exact.
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
