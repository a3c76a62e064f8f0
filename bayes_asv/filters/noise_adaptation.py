"""Noise adaptation and drift detection of the unscented filter, compiled.

Each output has a noise factor on its declared noise variance, estimated from normalised innovations
squared (NIS): slowly as a rule, and quickly when a sensor fails.  Autocorrelated innovations show
that the parameters drift.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.prediction import INLINE
from bayes_asv.filters.ukf_state import DRIFT_LAGS, FilterSettings, Statistics

__all__ = [
    "SNAPSHOT_INTERVAL", "detect_drift", "is_excited", "noise_factors", "take_snapshot",
    "update_autocovariance", "update_noise_factor", "update_white_share",
]  # fmt: skip

Array = NDArray[np.float64]

_MIN_EXCITATION = 25.0  # variance of the estimated acceleration over its error variance
_EXCITATION_TIME = 0.25  # time constant of that variance, s

SNAPSHOT_INTERVAL = 0.1
"""Time between snapshots of the parameters, s."""


@njit(**INLINE)
def noise_factors(
    ny: int, at: Statistics, statistics: Array, settings: FilterSettings, noise_factor: Array
) -> None:
    """Fill the factor on each output's declared noise variance.

    It is the slow estimate (n₀ + Σ) / (n₀ + w), with the exponentially weighted sum Σ and number w
    of NIS values and n₀ prior readings, or the fast one where that exceeds its threshold.
    """
    for y in range(ny):
        weight = settings.prior_readings + statistics[at.noise_weight + y]
        noise_factor[y] = (settings.prior_readings + statistics[at.noise_sum + y]) / weight
        if statistics[at.fast_factor + y] > max(settings.fast_threshold, noise_factor[y]):
            noise_factor[y] = statistics[at.fast_factor + y]


@njit(**INLINE)
def update_noise_factor(
    at: Statistics, statistics: Array, settings: FilterSettings, y: int, nis: float, factor: float
) -> None:
    """Update both estimates of an output's noise factor by a reading's NIS."""
    raw = min(nis, settings.gate) * factor
    decay = 1.0 - 1.0 / settings.slow_window
    total, weight, fast = at.noise_sum + y, at.noise_weight + y, at.fast_factor + y
    statistics[total] = statistics[total] * decay + min(raw, settings.gate)
    statistics[weight] = statistics[weight] * decay + 1.0
    statistics[fast] += (raw - statistics[fast]) / settings.fast_window


@njit(**INLINE)
def update_white_share(
    at: Statistics,
    statistics: Array,
    window: float,
    before: float,
    nu: float,
    correlation: float,
    part: float,
) -> None:
    """Update the share of the noise that is white although the sensor has a filter.

    Noise may come before a sensor's filter or behind it.  If it is white and the model takes it for
    filtered noise with a correlation ρ from reading to reading, whitening gives v_k − ρ v_{k−1},
    and the product of two successive innovations has the mean −ρ/(1 + ρ²), times the ``part`` of
    this noise in their variance.  The share is estimated by least squares from these products,
    whose variance is one, over a window of readings.

    Parameters
    ----------
    at : Statistics
        Indices of the statistics in the filter's state.
    statistics : array
        Statistics of the filter, updated in place.
    window : float
        Time constant, readings.
    before, nu : float
        Normalised innovations of the reading before and of this one, clipped.
    correlation, part : float
        See above.
    """
    slope = part * correlation / (1.0 + correlation * correlation)
    share, information = at.white_share, at.white_information
    statistics[information] += slope * slope - statistics[information] / window
    step = slope * nu * before / statistics[information]
    statistics[share] = min(max(statistics[share] - step, 0.0), 1.0)


@njit(**INLINE)
def update_autocovariance(autocovariance: Array, nu: float, settings: FilterSettings) -> None:
    """Update an output's autocovariance (2, 1 + DRIFT_LAGS) by a normalised innovation.

    The innovation is clipped at the gate.
    """
    limit = math.sqrt(settings.gate)
    nu = min(max(nu, -limit), limit)
    share = 1.0 / settings.slow_window
    autocovariance[0, 0] = nu
    for lag in range(DRIFT_LAGS, -1, -1):
        autocovariance[1, lag] += (nu * autocovariance[0, lag] - autocovariance[1, lag]) * share
        if lag > 0:
            autocovariance[0, lag] = autocovariance[0, lag - 1]


@njit(**INLINE)
def detect_drift(
    ny: int, at: Statistics, statistics: Array, autocovariance: Array, threshold: float
) -> None:
    """Flag a drift of the parameters while the long-run variance of the innovations is large.

    The long-run variance 1 + 2 Σ (1 − l/(L+1)) r_l, with Bartlett weights (Newey & West 1987), is
    one for white innovations.  The flag ends below the square root of the threshold.
    """
    largest = 0.0
    for y in range(ny):
        if not autocovariance[y, 1, 0] > 0.0:
            continue
        total = 1.0
        for lag in range(1, DRIFT_LAGS + 1):
            taper = 2.0 * (1.0 - lag / (DRIFT_LAGS + 1.0))
            total += taper * autocovariance[y, 1, lag] / autocovariance[y, 1, 0]
        largest = max(largest, total)
    statistics[at.long_run_variance] = largest
    if largest > threshold:
        statistics[at.drift_detected] = 1.0
    elif largest * largest < threshold:
        statistics[at.drift_detected] = 0.0


@njit(**INLINE)
def is_excited(
    ny: int, nx: int, at: Statistics, statistics: Array, x: Array, Pi: Array, C: Array, h: float
) -> bool:
    """Whether the car moves enough for its readings to carry information about the parameters.

    At rest the only input is the noise of the wheel sensors, and the filter would explain it by a
    car that does not respond.  So the estimate of an output has to vary by more than five standard
    deviations of its error.
    """
    share = min(h / _EXCITATION_TIME, 1.0)
    excited = False
    for y in range(ny):
        value = 0.0
        variance = 0.0
        for a in range(nx):
            value += C[y, a] * x[a]
            for b in range(nx):
                variance += C[y, a] * C[y, b] * Pi[a, b]
        mean, spread = at.motion_mean + y, at.motion_variance + y
        difference = value - statistics[mean]
        statistics[mean] += share * difference
        statistics[spread] += share * (difference * difference - statistics[spread])
        excited = excited or statistics[spread] > _MIN_EXCITATION * variance
    return excited


@njit(**INLINE)
def take_snapshot(
    ny: int,
    at: Statistics,
    statistics: Array,
    snapshots: Array,
    mu: Array,
    D: Array,
    fast_threshold: float,
    h: float,
) -> None:
    """Save the parameters regularly while the fast noise factors are low.

    Two snapshots are kept, so that the older one is at least one interval old.
    """
    statistics[at.snapshot_time] += h
    if statistics[at.snapshot_time] < SNAPSHOT_INTERVAL:
        return
    for y in range(ny):
        if statistics[at.fast_factor + y] > fast_threshold:
            return
    statistics[at.snapshot_time] = 0.0
    for i in range(mu.shape[0]):
        snapshots[0, i, 0] = snapshots[1, i, 0]
        snapshots[1, i, 0] = mu[i]
        for k in range(mu.shape[0]):
            snapshots[0, i, 1 + k] = snapshots[1, i, 1 + k]
            snapshots[1, i, 1 + k] = D[i, k]
