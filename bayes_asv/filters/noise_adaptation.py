"""Noise adaptation and drift detection of the unscented filter, compiled.

Each axle has a noise factor on its declared noise variance, estimated from normalised innovations
squared (NIS): slowly as a rule, and quickly when a sensor fails.  Autocorrelated innovations show
that the parameters drift.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.prediction import OPTIONS
from bayes_asv.filters.ukf_state import (
    DRIFT_DETECTED,
    DRIFT_LAGS,
    FAST_FACTOR,
    LONG_RUN_VARIANCE,
    MOTION_MEAN,
    MOTION_VARIANCE,
    NOISE_SUM,
    NOISE_WEIGHT,
    SNAPSHOT_TIME,
    FilterSettings,
    State,
)

__all__ = [
    "SNAPSHOT_INTERVAL", "detect_drift", "is_excited", "noise_factors", "take_snapshot",
    "update_autocovariance", "update_noise_factor",
]  # fmt: skip

Array = NDArray[np.float64]

_MIN_EXCITATION = 25.0  # variance of the estimated acceleration over its error variance
_EXCITATION_TIME = 0.25  # time constant of that variance, s

SNAPSHOT_INTERVAL = 0.1
"""Time between snapshots of the parameters, s."""


@njit(**OPTIONS)
def noise_factors(statistics: Array, settings: FilterSettings, noise_factor: Array) -> None:
    """Fill the factor on each axle's declared noise variance.

    It is the slow estimate (n₀ + Σ) / (n₀ + w), with the exponentially weighted sum Σ and number w
    of NIS values and n₀ prior readings, or the fast one where that exceeds its threshold.
    """
    for axle in range(2):
        weight = settings.prior_readings + statistics[NOISE_WEIGHT + axle]
        noise_factor[axle] = (settings.prior_readings + statistics[NOISE_SUM + axle]) / weight
        if statistics[FAST_FACTOR + axle] > max(settings.fast_threshold, noise_factor[axle]):
            noise_factor[axle] = statistics[FAST_FACTOR + axle]


@njit(**OPTIONS)
def update_noise_factor(
    statistics: Array, settings: FilterSettings, axle: int, nis: float, noise_factor: float
) -> None:
    """Update both estimates of an axle's noise factor by a reading's NIS."""
    raw = min(nis, settings.gate) * noise_factor
    decay = 1.0 - 1.0 / settings.slow_window
    statistics[NOISE_SUM + axle] = statistics[NOISE_SUM + axle] * decay + min(raw, settings.gate)
    statistics[NOISE_WEIGHT + axle] = statistics[NOISE_WEIGHT + axle] * decay + 1.0
    statistics[FAST_FACTOR + axle] += (raw - statistics[FAST_FACTOR + axle]) / settings.fast_window


@njit(**OPTIONS)
def update_autocovariance(autocovariance: Array, nu: float, settings: FilterSettings) -> None:
    """Update an axle's autocovariance (2, 1 + DRIFT_LAGS) by a normalised innovation.

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


@njit(**OPTIONS)
def detect_drift(state: State, threshold: float) -> None:
    """Flag a drift of the parameters while the long-run variance of the innovations is large.

    The long-run variance 1 + 2 Σ (1 − l/(L+1)) r_l, with Bartlett weights (Newey & West 1987), is
    one for white innovations.  The flag ends below the square root of the threshold.
    """
    largest = 0.0
    for axle in range(2):
        total = 1.0
        for lag in range(1, DRIFT_LAGS + 1):
            taper = 2.0 * (1.0 - lag / (DRIFT_LAGS + 1.0))
            total += taper * state.autocovariance[axle, 1, lag] / state.autocovariance[axle, 1, 0]
        largest = max(largest, total)
    state.statistics[LONG_RUN_VARIANCE] = largest
    if largest > threshold:
        state.statistics[DRIFT_DETECTED] = 1.0
    elif largest * largest < threshold:
        state.statistics[DRIFT_DETECTED] = 0.0


@njit(**OPTIONS)
def is_excited(state: State, C: Array, h: float) -> bool:
    """Whether the car moves enough for its readings to carry information about the parameters.

    At rest the only input is the noise of the wheel sensors, and the filter would explain it by a
    car that does not respond.  So the estimated acceleration of an axle has to vary by more than
    five standard deviations of its error.
    """
    share = min(h / _EXCITATION_TIME, 1.0)
    excited = False
    for axle in range(2):
        value = 0.0
        variance = 0.0
        for a in range(4):
            value += C[axle, a] * state.x[a]
            for b in range(4):
                variance += C[axle, a] * C[axle, b] * state.Pi[a, b]
        difference = value - state.statistics[MOTION_MEAN + axle]
        state.statistics[MOTION_MEAN + axle] += share * difference
        state.statistics[MOTION_VARIANCE + axle] += share * (
            difference * difference - state.statistics[MOTION_VARIANCE + axle]
        )
        excited = excited or state.statistics[MOTION_VARIANCE + axle] > _MIN_EXCITATION * variance
    return excited


@njit(**OPTIONS)
def take_snapshot(state: State, fast_threshold: float, h: float) -> None:
    """Save the parameters regularly while the fast noise factors are low.

    Two snapshots are kept, so that the older one is at least one interval old.
    """
    statistics, snapshots = state.statistics, state.snapshots
    statistics[SNAPSHOT_TIME] += h
    if (
        statistics[SNAPSHOT_TIME] < SNAPSHOT_INTERVAL
        or max(statistics[FAST_FACTOR], statistics[FAST_FACTOR + 1]) > fast_threshold
    ):
        return
    statistics[SNAPSHOT_TIME] = 0.0
    for i in range(state.mu.shape[0]):
        snapshots[0, i, 0] = snapshots[1, i, 0]
        snapshots[1, i, 0] = state.mu[i]
        for k in range(state.mu.shape[0]):
            snapshots[0, i, 1 + k] = snapshots[1, i, 1 + k]
            snapshots[1, i, 1 + k] = state.D[i, k]
