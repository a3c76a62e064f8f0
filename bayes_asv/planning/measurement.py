"""Simulated recordings of candidate drives: accelerations measured with the vehicle's sensors."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PPoly
from scipy.signal import lfilter

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.recording import COUNTS, Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.planning.ride_simulation import Motion

__all__ = [
    "DEFAULT_NOISE",
    "FilteredMotion",
    "filter_motion",
    "reading_extremes",
    "simulate_recording",
    "with_default_noise",
]

Array = NDArray[np.float64]

# Without declared noise and resolution: 5 mg, for an ADXL320 behind a 50 Hz filter (250 µg/√Hz in
# the data sheet, 2.2 mg rms) and a 10-bit converter over ±5 g (steps of 10 mg, 2.8 mg rms), with a
# margin for the mounting.
DEFAULT_NOISE = 0.05  # m/s²
# With a declared resolution but no declared noise: the sensor alone.
_DEFAULT_SENSOR_NOISE = 0.02  # m/s²


def with_default_noise(vehicle: Vehicle) -> tuple[Vehicle, tuple[str, ...]]:
    """Fill in a default noise for sensors without a declared one.

    Parameters
    ----------
    vehicle : Vehicle
        As read.

    Returns
    -------
    vehicle : Vehicle
        With noise for every channel.
    channels : tuple of str
        Channels that had none.
    """
    sensors = dict(vehicle.sensors)
    missing: list[str] = []
    for name in CHANNELS:
        sensor = vehicle.sensor(name)
        if sensor.noise is None:
            missing.append(name)
            quantized = sensor.resolution or sensor.counts_scale
            sensor = replace(sensor, noise=_DEFAULT_SENSOR_NOISE if quantized else DEFAULT_NOISE)
        sensors[name] = sensor
    return replace(vehicle, sensors=sensors), tuple(missing)


class FilteredMotion(NamedTuple):
    """Accelerations behind the sensors' filters, before noise, saturation and quantization.

    Parameters
    ----------
    curves : CubicSpline
        Accelerations of the four channels, m/s², over time, s.
    span : tuple of 2 float
        Beginning and end of the curves, s.
    """

    curves: CubicSpline
    span: tuple[float, float]

    def channel(self, c: int, time: Array) -> Array:
        """Evaluate one channel at times (N,), s."""
        inside = np.clip(time, *self.span)
        curve = PPoly(self.curves.c[:, :, c], self.curves.x)
        return np.asarray(curve(inside))


def filter_motion(vehicle: Vehicle, motion: Motion) -> FilteredMotion:
    """Filter a motion with the one-pole filters of the vehicle's sensors.

    A sensor without a bandwidth is taken to be like the slowest of the others, as in the estimator.
    """
    sensors = vehicle.sensors_of(CHANNELS)
    bandwidths = [sensor.bandwidth for sensor in sensors if sensor.bandwidth is not None]
    step = float(motion.time[1] - motion.time[0])
    signals = [
        _one_pole_filter(signal, step, sensor.bandwidth or min(bandwidths))
        if bandwidths
        else signal
        for signal, sensor in zip(motion.acceleration, sensors, strict=True)
    ]
    curves = CubicSpline(motion.time, np.stack(signals, axis=1))
    return FilteredMotion(curves, (float(motion.time[0]), float(motion.time[-1])))


def simulate_recording(
    vehicle: Vehicle, filtered: FilteredMotion, rate: float, seconds: float, seed: int
) -> Recording:
    """Simulate the recording of a logger.

    Each sensor adds noise that has passed its own filter, saturates and quantizes.

    Parameters
    ----------
    vehicle : Vehicle
        Its sensors are used.
    filtered : FilteredMotion
        Accelerations behind their filters.
    rate : float
        Sampling rate, Hz.
    seconds : float
        Length of the recording.
    seed : int
        Seed of the noise.

    Returns
    -------
    Recording
        In counts for sensors with zero and scale, in m/s² otherwise.
    """
    rng = np.random.default_rng([seed, 400])
    rows = np.arange(round(seconds * rate)) / rate
    values = np.empty((4, len(rows)))
    units = []
    for c, sensor in enumerate(vehicle.sensors_of(CHANNELS)):
        reading = filtered.channel(c, rows + sensor.delay)
        reading = reading + (sensor.noise or 0.0) * _unit_noise(
            rng, len(rows), rate, sensor.bandwidth
        )
        reading = np.clip(reading, sensor.low, sensor.high)
        if sensor.counts_scale is not None and sensor.zero_counts is not None:
            values[c] = np.rint(reading / sensor.counts_scale + sensor.zero_counts)
            units.append(COUNTS)
        else:
            step = sensor.resolution
            values[c] = np.rint(reading / step) * step if step else reading
            units.append("m/s^2")
    return Recording(rows, values, tuple(units), source="this drive")


def reading_extremes(filtered: FilteredMotion, seconds: float) -> Array:
    """Return the extreme readings of each channel (4, 2), m/s², without saturation."""
    value = filtered.curves(np.arange(0.0, seconds, 1e-3))
    return np.stack([value.min(axis=0), value.max(axis=0)], axis=1)


def _one_pole_filter(signal: Array, step: float, bandwidth: float) -> Array:
    """Filter an evenly sampled signal with one pole, exact for piecewise linear signals."""
    phase = 2.0 * math.pi * bandwidth * step
    decay = math.exp(-phase)
    newer = 1.0 - (1.0 - decay) / phase  # weight of the newer sample
    out, _ = lfilter([newer, 1.0 - decay - newer], [1.0, -decay], signal, zi=[0.0])
    return np.asarray(out)


def _unit_noise(rng: np.random.Generator, n: int, rate: float, bandwidth: float | None) -> Array:
    """Draw noise of unit variance that has passed the sensor's one-pole filter (AR(1))."""
    white = rng.normal(size=n)
    if bandwidth is None or n < 2:
        return white
    decay = math.exp(-2.0 * math.pi * bandwidth / rate)
    white[1:] *= math.sqrt(1.0 - decay**2)
    return np.asarray(lfilter([1.0], [1.0, -decay], white))
