"""Readable counterpart of :mod:`bayes_asv.filters.noise_adaptation`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.ukf import DONE, RELINEARIZE, RESET, REVIEW
from bayes_asv.filters.ukf_state import (
    DRIFT_DETECTED,
    DRIFT_LAGS,
    FAST_FACTOR,
    FAULT_TIME,
    INFORMATION_GAIN,
    LONG_RUN_VARIANCE,
    NOISE_SUM,
    NOISE_WEIGHT,
    REVIEW_TIME,
    FilterSettings,
)

__all__ = ["NoiseAdaptation"]

Array = NDArray[np.float64]

_SUM = slice(NOISE_SUM, NOISE_SUM + 2)
_WEIGHT = slice(NOISE_WEIGHT, NOISE_WEIGHT + 2)
_FAST = slice(FAST_FACTOR, FAST_FACTOR + 2)


@dataclass(frozen=True)
class NoiseAdaptation:
    """Noise factors, autocovariance of the innovations, and the decisions that follow from them.

    Parameters
    ----------
    statistics, autocovariance : arrays
        Of the filter's state; changed in place.
    settings : FilterSettings
        Thresholds.
    """

    statistics: Array
    autocovariance: Array
    settings: FilterSettings

    def factors(self) -> Array:
        """Factor on each axle's declared noise variance (2,)."""
        n, statistics = self.settings.prior_readings, self.statistics
        slow = (n + statistics[_SUM]) / (n + statistics[_WEIGHT])
        fast = statistics[_FAST]
        return np.where(fast > np.maximum(slow, self.settings.fast_threshold), fast, slow)

    def update_factor(self, axle: int, nis: float, factor: float) -> None:
        """Update an axle's noise factors by a reading's NIS."""
        settings, statistics = self.settings, self.statistics
        total, weight, fast = statistics[_SUM], statistics[_WEIGHT], statistics[_FAST]  # views
        raw = min(nis, settings.gate) * factor
        total[axle] += min(raw, settings.gate) - total[axle] / settings.slow_window
        weight[axle] += 1.0 - weight[axle] / settings.slow_window
        fast[axle] += (raw - fast[axle]) / settings.fast_window

    def update_autocovariance(self, axle: int, nu: float) -> None:
        """Update an axle's autocovariance by a normalised innovation."""
        limit = math.sqrt(self.settings.gate)
        lagged, covariance = self.autocovariance[axle]
        lagged[0] = min(max(nu, -limit), limit)
        covariance += (lagged[0] * lagged - covariance) / self.settings.slow_window
        lagged[1:] = lagged[:-1].copy()

    def detect_drift(self) -> None:
        """Flag a drift of the parameters by the long-run variance of the innovations."""
        weights = 2.0 * (1.0 - np.arange(1, DRIFT_LAGS + 1) / (DRIFT_LAGS + 1.0))
        covariance = self.autocovariance[:, 1]
        correlation = covariance[:, 1:] / covariance[:, :1]
        largest = float(np.max(1.0 + correlation @ weights))
        self.statistics[LONG_RUN_VARIANCE] = largest
        if largest > self.settings.drift_threshold:
            self.statistics[DRIFT_DETECTED] = 1.0
        elif largest**2 < self.settings.drift_threshold:
            self.statistics[DRIFT_DETECTED] = 0.0

    def event(self) -> int:
        """Decision that the filter needs, or DONE."""
        if self.statistics[FAULT_TIME] > self.settings.fault_duration:
            return RESET
        if self.statistics[INFORMATION_GAIN] > self.settings.information_gain:
            return RELINEARIZE
        return REVIEW if self.statistics[REVIEW_TIME] > self.settings.review_interval else DONE
