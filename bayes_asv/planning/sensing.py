"""Recordings of planned drives: true accelerations through the sensors of a vehicle file."""

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
from bayes_asv.domain.vehicle import Sensor, Vehicle
from bayes_asv.planning.motion import Motion

__all__ = ["ASSUMED_NOISE", "Felt", "extremes", "feel", "record", "with_assumed_noise"]

Array = NDArray[np.float64]

# Where neither noise nor a step is given: 5 mg, the noise of an ADXL320 behind 50 Hz (250 µg/√Hz
# by its data sheet, 2.2 mg) and a 10-bit converter over ±5 g (a step of 10 mg, 2.8 mg rms) with
# a margin for the mounting.
ASSUMED_NOISE = 0.05  # m/s²
# Where a step is given and the noise is not: the sensor alone.
_ASSUMED_SENSOR = 0.02  # m/s²


def with_assumed_noise(vehicle: Vehicle) -> tuple[Vehicle, tuple[str, ...]]:
    """Fill in the noise of sensors that the vehicle file gives none for.

    Parameters
    ----------
    vehicle : Vehicle
        As read.

    Returns
    -------
    vehicle : Vehicle
        With a noise for every channel.
    channels : tuple of str
        Those that had none.
    """
    sensors: list[Sensor] = []
    missing: list[str] = []
    for name in CHANNELS:
        sensor = vehicle.sensor(name)
        if sensor.noise is None:
            missing.append(name)
            stepped = sensor.resolution or sensor.counts_scale
            sensor = replace(sensor, noise=_ASSUMED_SENSOR if stepped else ASSUMED_NOISE)
        sensors.append(sensor)
    a, b, c, d = sensors
    return replace(vehicle, sensors=(a, b, c, d)), tuple(missing)


class Felt(NamedTuple):
    """What the sensors of a vehicle pass on of one motion, before noise, rails and steps.

    Parameters
    ----------
    curves : CubicSpline
        Accelerations of the four channels behind their filters, m/s², over time in s.
    span : tuple of 2 float
        Where the curves are known, s.
    """

    curves: CubicSpline
    span: tuple[float, float]

    def channel(self, c: int, at: Array) -> Array:
        """One channel (N,) at instants (N,)."""
        inside = np.clip(at, *self.span)
        piece = PPoly(self.curves.c[:, :, c], self.curves.x)
        return np.asarray(piece(inside))


def feel(vehicle: Vehicle, motion: Motion) -> Felt:
    """Pass a motion through the filters of a vehicle's sensors.

    A sensor without a bandwidth is like the slowest of the others, as the estimator takes it.
    """
    given = [sensor.bandwidth for sensor in vehicle.sensors if sensor.bandwidth is not None]
    step = float(motion.time[1] - motion.time[0])
    passed = [
        _one_pole(signal, step, sensor.bandwidth or min(given)) if given else signal
        for signal, sensor in zip(motion.acceleration, vehicle.sensors, strict=True)
    ]
    curves = CubicSpline(motion.time, np.stack(passed, axis=1))
    return Felt(curves, (float(motion.time[0]), float(motion.time[-1])))


def record(vehicle: Vehicle, felt: Felt, rate: float, seconds: float, seed: int) -> Recording:
    """Write what the logger would.

    Each sensor adds noise that passed its own filter, stops at its rails and rounds.

    Parameters
    ----------
    vehicle : Vehicle
        Gives the sensors.
    felt : Felt
        What they pass on.
    rate : float
        Rows a second, Hz.
    seconds : float
        Length.
    seed : int
        Of the noise.

    Returns
    -------
    Recording
        In m/s², or counts where the vehicle gives zero and scale.
    """
    rng = np.random.default_rng([seed, 400])
    rows = np.arange(round(seconds * rate)) / rate
    values = np.empty((4, len(rows)))
    units = []
    for c, sensor in enumerate(vehicle.sensors):
        read = felt.channel(c, rows + sensor.delay)
        read = read + (sensor.noise or 0.0) * _noise(rng, len(rows), rate, sensor.bandwidth)
        read = np.clip(read, sensor.low, sensor.high)
        if sensor.counts_scale is not None and sensor.zero_counts is not None:
            values[c] = np.rint(read / sensor.counts_scale + sensor.zero_counts)
            units.append(COUNTS)
        else:
            step = sensor.resolution
            values[c] = np.rint(read / step) * step if step else read
            units.append("m/s^2")
    first, second, third, fourth = units
    return Recording(rows, values, (first, second, third, fourth), source="this drive")


def extremes(felt: Felt, seconds: float) -> Array:
    """Smallest and largest reading of each channel (4, 2), m/s², whatever the sensors' ranges."""
    value = felt.curves(np.arange(0.0, seconds, 1e-3))
    return np.stack([value.min(axis=0), value.max(axis=0)], axis=1)


def _one_pole(signal: Array, step: float, bandwidth: float) -> Array:
    """Pass an evenly sampled signal through one pole, exactly for straight lines in between."""
    phase = 2.0 * math.pi * bandwidth * step
    keep = math.exp(-phase)
    ramp = 1.0 - (1.0 - keep) / phase  # weight of the newer end
    out, _ = lfilter([ramp, 1.0 - keep - ramp], [1.0, -keep], signal, zi=[0.0])
    return np.asarray(out)


def _noise(rng: np.random.Generator, n: int, rate: float, bandwidth: float | None) -> Array:
    """Draw unit noise with the memory of the sensor's filter."""
    white = rng.normal(size=n)
    if bandwidth is None or n < 2:
        return white
    keep = math.exp(-2.0 * math.pi * bandwidth / rate)
    white[1:] *= math.sqrt(1.0 - keep**2)
    return np.asarray(lfilter([1.0], [1.0, -keep], white))
