"""A recording from a road and a vehicle, with a seed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.units import si_factor
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.discretization import simulate_linear
from bayes_asv.models.half_car import HalfCar, LinearSystem, deflection_form
from bayes_asv.simulation.roads import Road

__all__ = ["FINE", "SETTLE", "Drive", "fine_grid", "hub_acceleration", "read_out", "simulate"]

Array = NDArray[np.float64]

FINE = 10_000.0
"""Rate at which hub, chassis and sensor filters are computed, Hz."""
SETTLE = 0.5
"""Parked before the road begins, s."""


@dataclass(frozen=True)
class Drive:
    """A simulated drive.

    Parameters
    ----------
    recording : Recording
        What the sensors read, in in/s², m/s² or counts.
    time : (M,) array
        Fine time grid, s.
    deflection : (M, 2) array
        Front and rear suspension deflection, extension positive, m.
    acceleration : (4, M) array
        True accelerations in channel order, before the sensors, m/s².
    """

    recording: Recording
    time: Array
    deflection: Array
    acceleration: Array


def simulate(
    vehicle: Vehicle,
    road: Road,
    *,
    rate: float = 400.0,
    seconds: float = 2.5,
    seed: int = 0,
    car: HalfCar | None = None,
) -> Drive:
    """Drive a vehicle over a road and record it with its sensors.

    The hubs follow the road, the rear one a wheel base later; the chassis answers as the
    linear half car; each sensor filters, delays, adds noise and rounds as the vehicle file
    says (nothing where it says nothing).

    Parameters
    ----------
    vehicle : Vehicle
        Nominal values and sensors.
    road : Road
        From :func:`bayes_asv.simulation.roads.road`.
    rate : float
        Rows a second, Hz.
    seconds : float
        Length of the recording.
    seed : int
        Seed of the sensor noise.
    car : HalfCar, optional
        Another car than the nominal one, SI units.

    Returns
    -------
    Drive
    """
    rng = np.random.default_rng([seed, 1])
    if car is None:
        car = HalfCar(*(getattr(vehicle, name).value for name in HalfCar._fields))
    fine = fine_grid(vehicle, CHANNELS, seconds)
    hubs = np.stack(
        [
            hub_acceleration(road, road.speed * (fine - SETTLE)),
            hub_acceleration(road, road.speed * (fine - SETTLE) - car.l),
        ],
        axis=1,
    )
    system = deflection_form(car)
    states = simulate_linear(system, fine, hubs)
    chassis = states @ system.C.T
    truth = np.stack([hubs[:, 0], chassis[:, 0], hubs[:, 1], chassis[:, 1]])
    note = f"simulated: {vehicle.name} over {road.name} at {road.speed:.2f} m/s, seed {seed}"
    recording = read_out(
        vehicle, CHANNELS, fine, truth, rate, seconds, rng, note, f"simulated {road.name}"
    )
    return Drive(recording, fine, states[:, [0, 2]], truth)


def fine_grid(vehicle: Vehicle, channels: tuple[str, ...], seconds: float) -> Array:
    """Make the times (M,), s, from before the recording to after its last reading."""
    delays = [vehicle.sensor(name).delay for name in channels]
    return np.arange(-SETTLE + min(*delays, 0.0), seconds + max(*delays, 0.0) + 0.1, 1.0 / FINE)


def read_out(
    vehicle: Vehicle,
    channels: tuple[str, ...],
    fine: Array,
    truth: Array,
    rate: float,
    seconds: float,
    rng: np.random.Generator,
    note: str,
    source: str,
) -> Recording:
    """Read true accelerations with a vehicle's sensors.

    Parameters
    ----------
    vehicle : Vehicle
        Its sensors filter, delay, add noise and round as the file says.
    channels : tuple of C str
        Which they are.
    fine : (M,) array
        Times, s.
    truth : (C, M) array
        Accelerations, m/s².
    rate, seconds : float
        Rows a second and length of the recording.
    rng : numpy Generator
        Draws the noise.
    note, source : str
        Kept with the recording.

    Returns
    -------
    Recording
    """
    sensors = [vehicle.sensor(name) for name in channels]
    bandwidths = [sensor.bandwidth for sensor in sensors if sensor.bandwidth is not None]
    rows = np.arange(round(seconds * rate)) / rate
    unit = "in/s^2" if vehicle.units == "US" else "m/s^2"
    values = np.empty((len(channels), len(rows)))
    units = []
    for c, sensor in enumerate(sensors):
        signal = truth[c]
        if bandwidths:  # a sensor without one is like the slowest of the others
            signal = _one_pole(fine, signal, sensor.bandwidth or min(bandwidths))
        sampled = CubicSpline(fine, signal)(rows + sensor.delay)
        if sensor.noise is not None:
            sampled = sampled + sensor.noise * _noise(rng, len(rows), rate, sensor.bandwidth)
        sampled = np.clip(sampled, sensor.low, sensor.high)
        if sensor.counts_scale is not None and sensor.zero_counts is not None:
            counts = np.rint(sampled / sensor.counts_scale + sensor.zero_counts)
            values[c], each = counts, "counts"
        else:
            if sensor.resolution is not None:
                sampled = np.rint(sampled / sensor.resolution) * sensor.resolution
            values[c], each = sampled / si_factor(unit, "acceleration"), unit
        units.append(each)
    return Recording(
        time=rows,
        values=values,
        units=tuple(units),
        metadata=(("sample_rate", f"{rate:g} Hz"), ("note", note)),
        source=source,
        channels=channels,
    )


def hub_acceleration(road: Road, x: Array) -> Array:
    """Hub acceleration, m/s²: second difference of the height at exact distances."""
    d = road.speed / FINE
    return np.asarray((road.height(x + d) - 2.0 * road.height(x) + road.height(x - d)) * FINE**2)


def _one_pole(time: Array, signal: Array, bandwidth: float) -> Array:
    """Pass a signal through the sensor's one-pole filter, at rest before."""
    pole = np.array([[-2.0 * math.pi * bandwidth]])
    system = LinearSystem(pole, -pole, np.eye(1), np.zeros((1, 1)))
    return simulate_linear(system, time, signal[:, None])[:, 0]


def _noise(rng: np.random.Generator, n: int, rate: float, bandwidth: float | None) -> Array:
    """Draw unit noise of a sensor: it passes the sensor's filter too, so it has a memory."""
    white = rng.normal(size=n)
    if bandwidth is None:
        return white
    memory = math.exp(-2.0 * math.pi * bandwidth / rate)
    out = np.empty(n)
    out[0] = white[0]
    for k in range(1, n):
        out[k] = memory * out[k - 1] + math.sqrt(1.0 - memory**2) * white[k]
    return out
