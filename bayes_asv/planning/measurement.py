"""Simulated recordings of candidate drives, measured with the vehicle's sensors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PPoly
from scipy.signal import lfilter

from bayes_asv.domain.channels import Channel, Quantity
from bayes_asv.domain.recording import COUNTS, Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.planning.ride_simulation import Motion
from bayes_asv.simulation.simulate import unit_noise

__all__ = [
    "DEFAULT_NOISE",
    "FilteredMotion",
    "filter_motion",
    "reading_extremes",
    "simulate_recording",
    "with_default_noise",
]

Array = NDArray[np.float64]

DEFAULT_NOISE: Final[Mapping[Quantity, float]] = {
    # 5 mg, for an ADXL320 behind a 50 Hz filter (250 µg/√Hz in the data sheet, 2.2 mg rms) and a
    # 10-bit converter over ±5 g (steps of 10 mg, 2.8 mg rms), with a margin for the mounting.
    "acceleration": 0.05,
    # 0.1 °/s: 0.01 °/s/√Hz over 50 Hz is 0.09 °/s in a data sheet of a small gyro.
    "angular_rate": 2e-3,
    # 0.1 mm: a 10-bit converter over 250 mm has steps of 0.24 mm, 0.07 mm rms.
    "deflection": 1e-4,
}
"""Noise of a sensor without declared noise and resolution, SI units."""
# With a declared resolution but no declared noise: the sensor alone.
_SENSOR_SHARE = 0.4


def with_default_noise(
    vehicle: Vehicle, channels: Sequence[Channel]
) -> tuple[Vehicle, tuple[str, ...]]:
    """Fill in a default noise for sensors without a declared one.

    Parameters
    ----------
    vehicle : Vehicle
        Contents of the vehicle file.
    channels : sequence of Channel
        Measured channels.

    Returns
    -------
    vehicle : Vehicle
        With noise for every channel.
    channels : tuple of str
        Channels without a declared noise.
    """
    sensors = dict(vehicle.sensors)
    missing: list[str] = []
    for channel in channels:
        sensor = vehicle.sensor(channel.name)
        if sensor.noise is None:
            missing.append(channel.name)
            share = _SENSOR_SHARE if sensor.resolution or sensor.counts_scale else 1.0
            sensor = replace(sensor, noise=share * DEFAULT_NOISE[channel.quantity])
        sensors[channel.name] = sensor
    return replace(vehicle, sensors=sensors), tuple(missing)


class FilteredMotion(NamedTuple):
    """Signals behind the sensors' filters, before noise, saturation and quantisation.

    Parameters
    ----------
    channels : tuple of Channel
        Measured channels.
    curves : CubicSpline
        Signals of the channels, SI units, over time, s.
    span : tuple of 2 float
        Beginning and end of the curves, s.
    """

    channels: tuple[Channel, ...]
    curves: CubicSpline
    span: tuple[float, float]

    def channel(self, c: int, time: Array) -> Array:
        """Evaluate one channel at times (N,), s."""
        inside = np.clip(time, *self.span)
        curve = PPoly(self.curves.c[:, :, c], self.curves.x)
        return np.asarray(curve(inside))


def filter_motion(vehicle: Vehicle, motion: Motion, channels: Sequence[Channel]) -> FilteredMotion:
    """Filter a motion with the one-pole filters of the vehicle's sensors.

    An accelerometer without a bandwidth is taken to be like the slowest of the others, another
    sensor without one to have no filter, as in the estimator.
    """
    sensors = vehicle.sensors_of([channel.name for channel in channels])
    bandwidths = [sensor.bandwidth for sensor in sensors if sensor.bandwidth is not None]
    step = float(motion.time[1] - motion.time[0])
    signals = []
    for signal, sensor, channel in zip(motion.signals, sensors, channels, strict=True):
        alike = bandwidths and channel.quantity == "acceleration"
        corner = sensor.bandwidth or (min(bandwidths) if alike else None)
        signals.append(signal if corner is None else _one_pole_filter(signal, step, corner))
    curves = CubicSpline(motion.time, np.stack(signals, axis=1))
    return FilteredMotion(tuple(channels), curves, (float(motion.time[0]), float(motion.time[-1])))


def simulate_recording(
    vehicle: Vehicle, filtered: FilteredMotion, rate: float, seconds: float, seed: int
) -> Recording:
    """Simulate the recording of a logger.

    Each sensor adds noise that has passed its own filter, saturates and quantises.

    Parameters
    ----------
    vehicle : Vehicle
        Its sensors are used.
    filtered : FilteredMotion
        Signals behind their filters.
    rate : float
        Sampling rate, Hz.
    seconds : float
        Length of the recording.
    seed : int
        Seed of the noise.

    Returns
    -------
    Recording
        In counts for sensors with zero and scale, in SI units otherwise.
    """
    rng = np.random.default_rng([seed, 400])
    rows = np.arange(round(seconds * rate)) / rate
    names = tuple(channel.name for channel in filtered.channels)
    values = np.empty((len(names), len(rows)))
    units = []
    for c, sensor in enumerate(vehicle.sensors_of(names)):
        reading = filtered.channel(c, rows + sensor.delay)
        reading = reading + (sensor.noise or 0.0) * unit_noise(
            rng, len(rows), rate, sensor.bandwidth
        )
        reading = np.clip(reading, sensor.low, sensor.high)
        if sensor.counts_scale is not None and sensor.zero_counts is not None:
            values[c] = np.rint(reading / sensor.counts_scale + sensor.zero_counts)
            units.append(COUNTS)
        else:
            step = sensor.resolution
            values[c] = np.rint(reading / step) * step if step else reading
            units.append(filtered.channels[c].si_unit)
    return Recording(rows, values, tuple(units), source="this drive", channels=names)


def reading_extremes(filtered: FilteredMotion, seconds: float) -> Array:
    """Return the extreme readings of each channel (C, 2), SI units, without saturation."""
    value = filtered.curves(np.arange(0.0, seconds, 1e-3))
    return np.stack([value.min(axis=0), value.max(axis=0)], axis=1)


def _one_pole_filter(signal: Array, step: float, bandwidth: float) -> Array:
    """Filter an evenly sampled signal with one pole, exact for piecewise linear signals."""
    phase = 2.0 * math.pi * bandwidth * step
    decay = math.exp(-phase)
    newer = 1.0 - (1.0 - decay) / phase  # weight of the newer sample
    out, _ = lfilter([newer, 1.0 - decay - newer], [1.0, -decay], signal, zi=[0.0])
    return np.asarray(out)
