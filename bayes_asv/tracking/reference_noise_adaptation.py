"""Readable counterpart of :mod:`bayes_asv.filters.noise_adaptation`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.ukf import DONE, RELINEARIZE, RESET, REVIEW
from bayes_asv.filters.ukf_state import DRIFT_LAGS, FilterSettings, Statistics

__all__ = ["NoiseAdaptation"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NoiseAdaptation:
    """Noise factors, autocovariance of the innovations, and decisions based on them.

    Parameters
    ----------
    at : Statistics
        Indices of the statistics.
    outputs : int
        Number of outputs, ny.
    statistics, autocovariance : arrays
        Parts of the filter's state; changed in place.
    settings : FilterSettings
        Thresholds.
    """

    at: Statistics
    outputs: int
    statistics: Array
    autocovariance: Array
    settings: FilterSettings

    def _each(self, first: int) -> Array:
        """View of a statistic of every output."""
        return self.statistics[first : first + self.outputs]

    def factors(self) -> Array:
        """Factor on each output's declared noise variance (ny,)."""
        n, at = self.settings.prior_readings, self.at
        slow = (n + self._each(at.noise_sum)) / (n + self._each(at.noise_weight))
        fast = self._each(at.fast_factor)
        return np.where(fast > np.maximum(slow, self.settings.fast_threshold), fast, slow)

    def update_factor(self, y: int, nis: float, factor: float) -> None:
        """Update an output's noise factors by a reading's NIS."""
        settings, at = self.settings, self.at
        total, weight = self._each(at.noise_sum), self._each(at.noise_weight)
        fast = self._each(at.fast_factor)
        raw = min(nis, settings.gate) * factor
        total[y] += min(raw, settings.gate) - total[y] / settings.slow_window
        weight[y] += 1.0 - weight[y] / settings.slow_window
        fast[y] += (raw - fast[y]) / settings.fast_window

    def update_white_share(self, y: int, nu: float, correlation: float, part: float) -> None:
        """Update the share of white noise by two successive innovations of an output."""
        limit, window = math.sqrt(self.settings.gate), self.settings.slow_window * self.outputs
        slope = part * correlation / (1.0 + correlation**2)
        share, information = self.at.white_share, self.at.white_information
        self.statistics[information] += slope**2 - self.statistics[information] / window
        product = min(max(nu, -limit), limit) * self.autocovariance[y, 0, 0]
        step = slope * product / self.statistics[information]
        self.statistics[share] = min(max(self.statistics[share] - step, 0.0), 1.0)

    def update_autocovariance(self, y: int, nu: float) -> None:
        """Update an output's autocovariance by a normalised innovation."""
        limit = math.sqrt(self.settings.gate)
        lagged, covariance = self.autocovariance[y]
        lagged[0] = min(max(nu, -limit), limit)
        covariance += (lagged[0] * lagged - covariance) / self.settings.slow_window
        lagged[1:] = lagged[:-1].copy()

    def detect_drift(self) -> None:
        """Flag a drift of the parameters by the long-run variance of the innovations."""
        weights = 2.0 * (1.0 - np.arange(1, DRIFT_LAGS + 1) / (DRIFT_LAGS + 1.0))
        covariance = self.autocovariance[:, 1]
        covariance = covariance[covariance[:, 0] > 0.0]
        correlation = covariance[:, 1:] / covariance[:, :1]
        largest = float(np.max(1.0 + correlation @ weights))
        self.statistics[self.at.long_run_variance] = largest
        if largest > self.settings.drift_threshold:
            self.statistics[self.at.drift_detected] = 1.0
        elif largest**2 < self.settings.drift_threshold:
            self.statistics[self.at.drift_detected] = 0.0

    def event(self) -> int:
        """Decision that the filter needs, or DONE."""
        if self.statistics[self.at.fault_time] > self.settings.fault_duration:
            return RESET
        if self.statistics[self.at.information_gain] > self.settings.information_gain:
            return RELINEARIZE
        return (
            REVIEW if self.statistics[self.at.review_time] > self.settings.review_interval else DONE
        )
