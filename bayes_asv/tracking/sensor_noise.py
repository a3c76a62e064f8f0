"""How noisy the sensors are, as the filter takes it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.preprocessing.noise_level import quiet_level

__all__ = ["Sensing", "heard_level", "sensing"]

Array = NDArray[np.float64]

# Weights of the cubic through four neighbours at the sample between them, its own last.
_MISS = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0
_FEWEST = 8  # readings that a level is heard in


@dataclass(frozen=True)
class Sensing:
    """The four sensors, in the order of ``CHANNELS``.

    Parameters
    ----------
    noise : (4,) array
        Deviation of one sample, m/s², steps left out; NaN where it is not given.
    steps : (4,) array
        One step of the reading, m/s²; zero where there is none.
    bandwidth : float or None
        Pole that all readings pass in the end, Hz.
    bandwidths : tuple of float or None
        Pole of each sensor, Hz.
    low, high : (4,) arrays
        Rails with half a step of slack, m/s²: what lies beyond is clipped.
    """

    noise: Array
    steps: Array
    bandwidth: float | None
    bandwidths: tuple[float | None, ...]
    low: Array
    high: Array

    @property
    def poles(self) -> Array:
        """Pole (4,) of the filter that all readings passed, rad/s; zero without a bandwidth."""
        return np.full(4, 2.0 * math.pi * (self.bandwidth or 0.0))

    def kernel_noise(self) -> Array:
        """Noise (12,) as the kernels take it: all of it filtered where there is a filter.

        A sensor's noise passes its filter; quantising does not.
        """
        out = np.zeros(12)
        for column, c in enumerate((0, 2, 1, 3)):  # wheels, then chassis
            white = self.steps[c] ** 2 / 12.0
            if self.bandwidth is None:
                white += self.noise[c] ** 2
            else:
                out[4 + column] = self.noise[c] ** 2
            out[column] = white
            out[8 + column] = self.poles[c]
        return out

    def missed_by_noise(self, channel: int, rate: float) -> float:
        """Variance (m²/s⁴) of what a cubic through four neighbours misses for noise alone."""
        lags = np.abs(np.subtract.outer(np.arange(5), np.arange(5)))
        kept = np.exp(-self.poles[channel] * lags / rate) if self.bandwidth else lags == 0
        filtered = float(_MISS @ kept @ _MISS) * float(self.noise[channel]) ** 2
        return filtered + float(_MISS @ _MISS) * float(self.steps[channel]) ** 2 / 12.0


def sensing(vehicle: Vehicle, counts: tuple[bool, ...] = (False,) * 4) -> Sensing:
    """Gather what a vehicle file says of its sensors.

    Parameters
    ----------
    vehicle : Vehicle
        As read.
    counts : tuple of 4 bool
        Channels that come in counts, whose scale is then their step.

    Returns
    -------
    Sensing
        A sensor without a bandwidth is taken to be like the slowest of the others.
    """
    sensors = [vehicle.sensor(name) for name in CHANNELS]
    given = [s.bandwidth for s in sensors if s.bandwidth is not None]
    step = [
        s.resolution or (abs(s.counts_scale or 0.0) if raw else 0.0)
        for s, raw in zip(sensors, counts, strict=True)
    ]
    slack = [0.5 * abs(s.resolution or s.counts_scale or 0.0) for s in sensors]
    return Sensing(
        noise=np.array([math.nan if s.noise is None else s.noise for s in sensors]),
        steps=np.array(step),
        bandwidth=min(given) if given else None,
        bandwidths=tuple(s.bandwidth for s in sensors),
        low=np.array([s.low + w for s, w in zip(sensors, slack, strict=True)]),
        high=np.array([s.high - w for s, w in zip(sensors, slack, strict=True)]),
    )


def heard_level(signal: Array, step: float) -> float:
    """Noise of one sample, m/s², from the quietest quarter of what was read so far.

    Parameters
    ----------
    signal : (N,) array
        Readings, m/s²; NaN where missing.
    step : float
        One step of the reading, m/s².

    Returns
    -------
    float
    """
    if np.count_nonzero(np.isfinite(signal)) < _FEWEST:
        return max(step, 0.1)
    return quiet_level(signal, step)
