"""Noise, resolution, bandwidth and range of a car's sensors, for the online filter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import Channel
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.car_model import CarModel, Output
from bayes_asv.preprocessing.quantization import quiet_level

__all__ = ["SensorModel", "estimate_noise", "sensor_model"]

Array = NDArray[np.float64]

# Weights of five samples in the error of the cubic through the outer four at the middle one.
_INTERPOLATION_ERROR = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0
_MIN_READINGS = 8  # least number of readings for an estimate of the noise
_CLIP, _ROUNDS = 3.0, 10  # differences that are used, in noise levels, and number of iterations
_CLIPPED = 0.9866  # standard deviation of a standard normal variable truncated at three
# Noise that is assumed with fewer readings, SI units: 10 mg, 0.2 °/s and 1 mm.
_UNKNOWN_NOISE = {"acceleration": 0.1, "angular_rate": 4e-3, "deflection": 1e-3}


@dataclass(frozen=True)
class SensorModel:
    """The sensors of a car on C channels.

    Parameters
    ----------
    car : CarModel
        The car.
    channels : tuple of Channel
        The channels.
    noise : (C,) array
        Standard deviation of one sample without quantisation, SI units; NaN if undeclared.
    resolution : (C,) array
        Quantisation step, SI units; zero without one.
    bandwidth : float or None
        Common pole of all readings after bandwidth matching, Hz.
    bandwidths : tuple of float or None
        Pole of each sensor, Hz.
    low, high : (C,) arrays
        Limits of the range less half a quantisation step, SI units; readings beyond are clipped.
    """

    car: CarModel
    channels: tuple[Channel, ...]
    noise: Array
    resolution: Array
    bandwidth: float | None
    bandwidths: tuple[float | None, ...]
    low: Array
    high: Array

    @property
    def inputs(self) -> tuple[int, ...]:
        """Indices of the channels that are the inputs of the elements, in the elements' order."""
        by_element = {self.car.element_of(x): c for c, x in enumerate(self.channels) if x.is_input}
        return tuple(by_element[e] for e in range(len(self.car.elements)))

    @property
    def outputs(self) -> tuple[int, ...]:
        """Indices of the output channels."""
        return tuple(c for c, channel in enumerate(self.channels) if not channel.is_input)

    @property
    def poles(self) -> Array:
        """Pole (C,) that the readings passed, rad/s; zero without one.

        An accelerometer without a declared bandwidth is assumed to be like the slowest of the
        others; any other sensor without one is assumed to have no filter.
        """
        filtered = [
            bandwidth is not None or channel.quantity == "acceleration"
            for bandwidth, channel in zip(self.bandwidths, self.channels, strict=True)
        ]
        return np.where(filtered, 2.0 * math.pi * (self.bandwidth or 0.0), 0.0)

    @property
    def output_models(self) -> tuple[Output, ...]:
        """Models of the outputs, including whether each passed the common filter."""
        pole = 2.0 * math.pi * (self.bandwidth or 0.0)
        return tuple(
            Output(self.channels[c], 1.0 / pole if pole > 0.0 and self.poles[c] == 0.0 else 0.0)
            for c in self.outputs
        )

    def noise_parameters(self) -> Array:
        """Noise (3 C,) for ``ukf_state.Model``: white, filtered and poles.

        The noise of a sensor passes its filter, if it has one; quantisation noise is white.
        """
        order = [*self.inputs, *self.outputs]
        poles = self.poles[order]
        variance = self.noise[order] ** 2
        white = self.resolution[order] ** 2 / 12.0 + np.where(poles > 0.0, 0.0, variance)
        return np.concatenate([white, np.where(poles > 0.0, variance, 0.0), poles])

    def interpolation_noise(self, channel: int, rate: float) -> float:
        """Variance (m²/s⁴) of the error of a cubic through four neighbours due to noise alone."""
        lags = np.abs(np.subtract.outer(np.arange(5), np.arange(5)))
        correlation = np.exp(-self.poles[channel] * lags / rate) if self.bandwidth else lags == 0
        w = _INTERPOLATION_ERROR
        filtered = float(w @ correlation @ w) * float(self.noise[channel]) ** 2
        return filtered + float(w @ w) * float(self.resolution[channel]) ** 2 / 12.0

    def estimated(self, channel: int, time: Array, signal: Array) -> float:
        """Estimate the noise of one sample of a channel from its readings, SI units."""
        finite = np.isfinite(signal)
        return estimate_noise(
            time[finite], signal[finite], float(self.resolution[channel]),
            float(self.poles[channel]), _UNKNOWN_NOISE[self.channels[channel].quantity],
        )  # fmt: skip


def sensor_model(
    vehicle: Vehicle, car: CarModel, names: Sequence[str], counts: Sequence[bool] | None = None
) -> SensorModel:
    """Collect the properties of a car's sensors.

    Parameters
    ----------
    vehicle : Vehicle
        Vehicle as read.
    car : CarModel
        Its model, which includes all the channels.
    names : sequence of C str
        Names of the channels.
    counts : sequence of C bool, optional
        Whether each channel is in counts, so that its scale is its quantisation step; none by
        default.

    Returns
    -------
    SensorModel

    Raises
    ------
    InputError
        If an input of the car is missing, or nothing else is measured.
    """
    counts = (False,) * len(names) if counts is None else counts
    for element in car.elements:
        if f"{element.name}_wheel" not in names:
            raise InputError(
                "channels", f"lack {element.name}_wheel, which the {car.name} car needs",
                "choose the car that fits these channels",
            )  # fmt: skip
    channels = tuple(vehicle.channel(name) for name in names)
    if all(channel.is_input for channel in channels):
        raise InputError(
            "channels", f"measure nothing that the {car.name} car explains",
            "record the acceleration of the body, its pitch rate or the suspension travel",
        )  # fmt: skip
    sensors = [vehicle.sensor(name) for name in names]
    given = [s.bandwidth for s in sensors if s.bandwidth is not None]
    resolution = [
        s.resolution or (abs(s.counts_scale or 0.0) if raw else 0.0)
        for s, raw in zip(sensors, counts, strict=True)
    ]
    margin = [0.5 * abs(s.resolution or s.counts_scale or 0.0) for s in sensors]
    return SensorModel(
        car=car,
        channels=channels,
        noise=np.array([math.nan if s.noise is None else s.noise for s in sensors]),
        resolution=np.array(resolution),
        bandwidth=min(given) if given else None,
        bandwidths=tuple(s.bandwidth for s in sensors),
        low=np.array([s.low + m for s, m in zip(sensors, margin, strict=True)]),
        high=np.array([s.high - m for s, m in zip(sensors, margin, strict=True)]),
    )


def estimate_noise(
    time: Array, readings: Array, resolution: float, pole: float, unknown: float
) -> float:
    """Estimate the noise of one sample from readings that begin at standstill.

    Third differences remove smooth motion.  For white noise of variance σ² their variance is 20 σ²,
    for noise with a correlation ρ between readings it is 20 − 30 ρ + 12 ρ² − 2 ρ³ times σ².
    Differences beyond three standard deviations are left out, since the car may begin to move; the
    initial value is that of the quarter with the least motion.

    Parameters
    ----------
    time, readings : (N,) arrays
        Instants, s, and readings, SI units.
    resolution : float
        Quantisation step, SI units.
    pole : float
        Pole of the sensor's filter, rad/s; zero without one.
    unknown : float
        Noise if there are too few readings or all are equal, SI units.
    """
    if len(readings) < _MIN_READINGS or np.ptp(readings) == 0.0:
        return max(resolution, unknown)
    steps = resolution / math.sqrt(12.0)
    differences = np.abs(np.diff(readings, 3)) / math.sqrt(20.0)
    level = quiet_level(readings, resolution)
    for _ in range(_ROUNDS):
        small = differences[differences < _CLIP * level]
        level = max(float(np.sqrt(np.mean(small**2))) / _CLIPPED, steps, 1e-6)
    # quantisation noise is kept: an underestimated noise level is worse than an overestimated one
    rho = math.exp(-pole * float(np.median(np.diff(time)))) if pole else 0.0
    share = (20.0 - 30.0 * rho + 12.0 * rho**2 - 2.0 * rho**3) / 20.0
    return math.sqrt(max(level**2 - steps**2, 0.0) / share + steps**2)
