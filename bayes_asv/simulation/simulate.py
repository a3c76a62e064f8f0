"""Simulated recordings of the half car and of the roll car, and the response of any linear car."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bayes_asv.domain.channels import CHANNELS, ROLL_CHANNELS
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.units import si_factor
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.assembly import SecondOrder, state_form
from bayes_asv.models.discretization import simulate_linear
from bayes_asv.models.from_vehicle import roll_car
from bayes_asv.models.half_car import HalfCar, LinearSystem, deflection_form
from bayes_asv.models.roll_car import RollCar, deflections
from bayes_asv.simulation.roads import Road

__all__ = ["Drive", "response", "simulate", "simulate_roll"]

Array = NDArray[np.float64]

_INTEGRATION_RATE = 10_000.0  # Hz, of hubs, chassis and sensor filters
_REST = 0.5  # s at standstill before the road begins


@dataclass(frozen=True)
class Drive:
    """A simulated drive of the half car (C = 4, A = 2) or of the roll car (C = 7, A = 4).

    Parameters
    ----------
    recording : Recording
        Readings of the C sensors, in in/s², m/s² or counts.
    time : (M,) array
        Integration grid, s.
    deflection : (M, A) array
        Suspension deflections, extension positive, m.
    acceleration : (C, M) array
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
    """Simulate a recording of the half car over a road.

    The hubs follow the road, the rear one a wheelbase behind the front one.  The chassis responds
    as the linear half car.  Each sensor filters, delays, adds noise, saturates and quantizes as
    declared in the vehicle file; what the file leaves out is ideal.

    Parameters
    ----------
    vehicle : Vehicle
        Nominal values and sensors.
    road : Road
        From :func:`bayes_asv.simulation.roads.road`.
    rate : float
        Sampling rate, Hz.
    seconds : float
        Length of the recording.
    seed : int
        Seed of the sensor noise.
    car : HalfCar, optional
        Parameters other than the nominal ones, SI units.

    Returns
    -------
    Drive
    """
    rng = np.random.default_rng([seed, 1])
    if car is None:
        car = HalfCar(*(getattr(vehicle, name).value for name in HalfCar._fields))
    time = _integration_grid(vehicle, CHANNELS, seconds)
    distance = road.speed * (time - _REST)
    hubs = np.stack(
        [_hub_acceleration(road, distance), _hub_acceleration(road, distance - car.l)], axis=1
    )
    system = deflection_form(car)
    states = simulate_linear(system, time, hubs)
    chassis = states @ system.C.T
    truth = np.stack([hubs[:, 0], chassis[:, 0], hubs[:, 1], chassis[:, 1]])
    recording = _measure(vehicle, CHANNELS, road, seed, time, truth, rate, seconds, rng)
    return Drive(recording, time, states[:, [0, 2]], truth)


def simulate_roll(
    vehicle: Vehicle,
    tracks: tuple[Road, Road],
    *,
    skew: float = 0.0,
    rate: float = 400.0,
    seconds: float = 2.5,
    seed: int = 0,
    car: RollCar | None = None,
) -> Drive:
    """Simulate a recording of the roll car over a left and a right track.

    The hubs follow the tracks, the rear ones a wheelbase behind the front ones.  The chassis
    responds as the linear car with heave, pitch and roll.  Sensors are as for `simulate`.

    Parameters
    ----------
    vehicle : Vehicle
        With a table ``[roll]``.
    tracks : pair of Road
        Under the left and the right wheels; the speed is that of the left track.
    skew : float
        Distance by which the right track is shifted forward, m.
    rate : float
        Sampling rate, Hz.
    seconds : float
        Length of the recording.
    seed : int
        Seed of the sensor noise.
    car : RollCar, optional
        Parameters other than the nominal ones, SI units.

    Returns
    -------
    Drive

    Raises
    ------
    InputError
        If the vehicle has no ``[roll]``.
    """
    rng = np.random.default_rng([seed, 1])
    car = roll_car(vehicle) if car is None else car
    time = _integration_grid(vehicle, ROLL_CHANNELS, seconds)
    left, right = tracks
    distance = left.speed * (time - _REST)
    hubs = np.stack(
        [
            _hub_acceleration(left, distance),
            _hub_acceleration(right, distance - skew),
            _hub_acceleration(left, distance - car.l),
            _hub_acceleration(right, distance - skew - car.l),
        ],
        axis=1,
    )
    system = deflections(car)
    states = simulate_linear(system, time, hubs)
    truth = np.vstack([hubs.T, (states @ system.C.T).T])
    recording = _measure(vehicle, ROLL_CHANNELS, left, seed, time, truth, rate, seconds, rng)
    return Drive(recording, time, states[:, :4], truth)


def response(system: SecondOrder, time: Array, u: Array, rate: Array) -> tuple[Array, Array]:
    """Compute the response of a linear car to its inputs, from rest.

    Parameters
    ----------
    system : SecondOrder
        n coordinates, p inputs.
    time : (N,) array
        Times, s.
    u, rate : (N, p) arrays
        Heights of the road (or of the wheels), m, and their rates, m/s, linear between samples.

    Returns
    -------
    position, acceleration : (N, n) arrays
        Of the coordinates, SI units.
    """
    form = state_form(system)
    inputs = np.hstack([u, rate])
    states = simulate_linear(form, time, inputs)
    out = states @ form.C.T + inputs @ form.D.T
    n = len(system.M)
    return out[:, :n], out[:, n:]


def _integration_grid(vehicle: Vehicle, channels: tuple[str, ...], seconds: float) -> Array:
    """Build the times (M,), s, from standstill to beyond the last delayed reading."""
    delays = [vehicle.sensor(name).delay for name in channels]
    start, end = -_REST + min(*delays, 0.0), seconds + max(*delays, 0.0) + 0.1
    return np.arange(start, end, 1.0 / _INTEGRATION_RATE)


def _measure(
    vehicle: Vehicle,
    channels: tuple[str, ...],
    road: Road,
    seed: int,
    time: Array,
    truth: Array,
    rate: float,
    seconds: float,
    rng: np.random.Generator,
) -> Recording:
    """Measure true accelerations (C, M), m/s², at times (M,), s, with the vehicle's sensors."""
    sensors = [vehicle.sensor(name) for name in channels]
    bandwidths = [sensor.bandwidth for sensor in sensors if sensor.bandwidth is not None]
    rows = np.arange(round(seconds * rate)) / rate
    unit = "in/s^2" if vehicle.units == "US" else "m/s^2"
    values = np.empty((len(channels), len(rows)))
    units = []
    for c, sensor in enumerate(sensors):
        signal = truth[c]
        if bandwidths:  # a sensor without a bandwidth is like the slowest of the others
            signal = _one_pole_filter(time, signal, sensor.bandwidth or min(bandwidths))
        sampled = CubicSpline(time, signal)(rows + sensor.delay)
        if sensor.noise is not None:
            sampled = sampled + sensor.noise * _unit_noise(rng, len(rows), rate, sensor.bandwidth)
        sampled = np.clip(sampled, sensor.low, sensor.high)
        if sensor.counts_scale is not None and sensor.zero_counts is not None:
            counts = np.rint(sampled / sensor.counts_scale + sensor.zero_counts)
            values[c], own_unit = counts, "counts"
        else:
            if sensor.resolution is not None:
                sampled = np.rint(sampled / sensor.resolution) * sensor.resolution
            values[c], own_unit = sampled / si_factor(unit, "acceleration"), unit
        units.append(own_unit)
    note = f"simulated: {vehicle.name} over {road.name} at {road.speed:.2f} m/s, seed {seed}"
    return Recording(
        time=rows,
        values=values,
        units=tuple(units),
        metadata=(("sample_rate", f"{rate:g} Hz"), ("note", note)),
        source=f"simulated {road.name}",
        channels=channels,
    )


def _hub_acceleration(road: Road, x: Array) -> Array:
    """Hub acceleration, m/s²: second difference of the road height at distances x, m."""
    d = road.speed / _INTEGRATION_RATE
    second_difference = road.height(x + d) - 2.0 * road.height(x) + road.height(x - d)
    return np.asarray(second_difference * _INTEGRATION_RATE**2)


def _one_pole_filter(time: Array, signal: Array, bandwidth: float) -> Array:
    """Filter a signal with one pole at `bandwidth`, Hz, from rest."""
    pole = np.array([[-2.0 * math.pi * bandwidth]])
    system = LinearSystem(pole, -pole, np.eye(1), np.zeros((1, 1)))
    return simulate_linear(system, time, signal[:, None])[:, 0]


def _unit_noise(rng: np.random.Generator, n: int, rate: float, bandwidth: float | None) -> Array:
    """Draw noise of unit variance that has passed the sensor's one-pole filter (AR(1))."""
    white = rng.normal(size=n)
    if bandwidth is None:
        return white
    correlation = math.exp(-2.0 * math.pi * bandwidth / rate)
    out = np.empty(n)
    out[0] = white[0]
    for k in range(1, n):
        out[k] = correlation * out[k - 1] + math.sqrt(1.0 - correlation**2) * white[k]
    return out
