"""Noise, resolution, bandwidth and range of the four accelerometers, as the filter needs them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.preprocessing.noise_level import quiet_level

__all__ = ["SensorModel", "estimate_noise", "sensor_model"]

Array = NDArray[np.float64]

# Weights of five samples in the error of the cubic through the outer four at the middle one.
_INTERPOLATION_ERROR = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0
_MIN_READINGS = 8  # for an estimate of the noise
_UNKNOWN_NOISE = 0.1  # m/s², with fewer readings


@dataclass(frozen=True)
class SensorModel:
    """The four sensors, in the order of ``CHANNELS``.

    Parameters
    ----------
    noise : (4,) array
        Standard deviation of one sample without quantization, m/s²; NaN where it is not given.
    resolution : (4,) array
        Quantization step, m/s²; zero where there is none.
    bandwidth : float or None
        Common pole of all readings after bandwidth matching, Hz.
    bandwidths : tuple of float or None
        Pole of each sensor, Hz.
    low, high : (4,) arrays
        Limits of the range less half a quantization step, m/s²: readings beyond are clipped.
    """

    noise: Array
    resolution: Array
    bandwidth: float | None
    bandwidths: tuple[float | None, ...]
    low: Array
    high: Array

    @property
    def poles(self) -> Array:
        """Common pole of all readings (4,), rad/s; zero without a bandwidth."""
        return np.full(4, 2.0 * math.pi * (self.bandwidth or 0.0))

    def noise_parameters(self) -> Array:
        """Noise (12,) as ``ukf_state.Model`` takes it.

        The noise of a sensor passes its filter, if it has one; quantization noise is white.
        """
        out = np.zeros(12)
        for column, c in enumerate((0, 2, 1, 3)):  # wheels, then chassis
            white = self.resolution[c] ** 2 / 12.0
            if self.bandwidth is None:
                white += self.noise[c] ** 2
            else:
                out[4 + column] = self.noise[c] ** 2
            out[column] = white
            out[8 + column] = self.poles[c]
        return out

    def interpolation_noise(self, channel: int, rate: float) -> float:
        """Variance (m²/s⁴) of the error of a cubic through four neighbours for noise alone."""
        lags = np.abs(np.subtract.outer(np.arange(5), np.arange(5)))
        correlation = np.exp(-self.poles[channel] * lags / rate) if self.bandwidth else lags == 0
        w = _INTERPOLATION_ERROR
        filtered = float(w @ correlation @ w) * float(self.noise[channel]) ** 2
        return filtered + float(w @ w) * float(self.resolution[channel]) ** 2 / 12.0


def sensor_model(vehicle: Vehicle, counts: tuple[bool, ...] = (False,) * 4) -> SensorModel:
    """Collect the figures of a vehicle's sensors.

    Parameters
    ----------
    vehicle : Vehicle
        As read.
    counts : tuple of 4 bool
        Channels in counts, whose scale is then their quantization step.

    Returns
    -------
    SensorModel
        A sensor without a bandwidth is taken to have that of the slowest of the others.
    """
    sensors = [vehicle.sensor(name) for name in CHANNELS]
    given = [s.bandwidth for s in sensors if s.bandwidth is not None]
    resolution = [
        s.resolution or (abs(s.counts_scale or 0.0) if raw else 0.0)
        for s, raw in zip(sensors, counts, strict=True)
    ]
    margin = [0.5 * abs(s.resolution or s.counts_scale or 0.0) for s in sensors]
    return SensorModel(
        noise=np.array([math.nan if s.noise is None else s.noise for s in sensors]),
        resolution=np.array(resolution),
        bandwidth=min(given) if given else None,
        bandwidths=tuple(s.bandwidth for s in sensors),
        low=np.array([s.low + m for s, m in zip(sensors, margin, strict=True)]),
        high=np.array([s.high - m for s, m in zip(sensors, margin, strict=True)]),
    )


def estimate_noise(signal: Array, resolution: float) -> float:
    """Estimate the noise of one sample (m/s²) from the quietest quarter of a signal.

    Parameters
    ----------
    signal : (N,) array
        Readings, m/s²; NaN where missing.
    resolution : float
        Quantization step, m/s².
    """
    if np.count_nonzero(np.isfinite(signal)) < _MIN_READINGS:
        return max(resolution, _UNKNOWN_NOISE)
    return quiet_level(signal, resolution)
