"""Simulated recordings of any car over a road, and the response of linear systems."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from bayes_asv.domain.channels import Channel
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.units import display_units, si_factor
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.assembly import SecondOrder, state_form
from bayes_asv.models.car_model import CarModel, Output, state_space
from bayes_asv.models.cars import car_model
from bayes_asv.models.discretization import simulate_linear
from bayes_asv.models.half_car_equations import LinearSystem
from bayes_asv.simulation.roads import Road

__all__ = [
    "Drive", "one_pole_filter", "response", "simulate", "unit_noise", "usual_channels",
]  # fmt: skip

Array = NDArray[np.float64]

_INTEGRATION_RATE = 10_000.0  # Hz, of hubs, body and sensor filters
_REST = 0.5  # s at standstill before the road begins


@dataclass(frozen=True)
class Drive:
    """A simulated drive of a car with C channels and E suspension elements.

    Parameters
    ----------
    recording : Recording
        Readings of the sensors, in in/s², m/s² or counts, in or mm, deg/s.
    time : (M,) array
        Integration grid, s.
    deflection : (M, E) array
        Suspension deflections, extension positive, m.
    truth : (C, M) array
        True quantities in channel order, before the sensors, SI units.
    """

    recording: Recording
    time: Array
    deflection: Array
    truth: Array


def simulate(
    vehicle: Vehicle,
    road: Road,
    *,
    rate: float = 400.0,
    seconds: float = 2.5,
    seed: int = 0,
    car: str = "half",
    values: Mapping[str, float] | None = None,
    channels: Sequence[str] | None = None,
    right: Road | None = None,
    skew: float = 0.0,
) -> Drive:
    """Simulate a recording of a car over a road.

    The hubs follow the road, the rear ones a wheelbase behind the front ones.  The body responds
    as the linear car.  Each sensor filters, delays, adds noise, saturates and quantises as declared
    in the vehicle file; what the file leaves out is ideal.

    Parameters
    ----------
    vehicle : Vehicle
        Nominal values and sensors.
    road : Road
        From :func:`bayes_asv.simulation.roads.road`; its speed is that of the car.
    rate : float
        Sampling rate, Hz.
    seconds : float
        Length of the recording.
    seed : int
        Seed of the sensor noise.
    car : str
        Name of the car model, see :data:`bayes_asv.models.cars.CARS`.
    values : mapping, optional
        Parameters of the car other than nominal, SI units.
    channels : sequence of str, optional
        What is measured; by default accelerations of all wheel hubs and of the body above them.
    right : Road, optional
        Under the right wheels of a car that has some; by default the same road.
    skew : float
        Distance by which the right road is shifted forward, m.

    Returns
    -------
    Drive

    Raises
    ------
    InputError
        If the vehicle lacks what the car needs, or the car does not have a channel.
    """
    rng = np.random.default_rng([seed, 1])
    model = car_model(car, vehicle)
    truth_of_car = {p.name: p.nominal for p in model.parameters} | dict(values or {})
    of_car = {name: np.array([x]) for name, x in truth_of_car.items()}
    measured = [vehicle.channel(name) for name in (channels or usual_channels(model))]
    for channel in measured:
        if not model.has_channel(channel):
            raise InputError(
                f"channel '{channel.name}'", f"is not one of the {model.name} car",
                "leave it out, or choose another car",
            )  # fmt: skip
    time = _integration_grid(vehicle, measured, seconds)
    distance = road.speed * (time - _REST)
    wheelbase = truth_of_car.get("l", vehicle.l.value)
    hubs = np.stack(
        [
            _hub_acceleration(
                right if element.side == "right" and right is not None else road,
                distance
                - (skew if element.side == "right" else 0.0)
                - (wheelbase if element.axle == "rear" else 0.0),
            )
            for element in model.elements
        ],
        axis=1,
    )
    outputs = [Output(channel) for channel in measured if not channel.is_input]
    system = state_space(model, of_car, outputs)
    linear = LinearSystem(
        system.A[0], system.B[0], system.C[0], np.zeros((len(outputs), len(model.elements)))
    )
    states = simulate_linear(linear, time, hubs)
    read = iter((states @ linear.C.T).T)
    truth = np.stack(
        [
            hubs[:, model.element_of(channel)] if channel.is_input else next(read)
            for channel in measured
        ]
    )
    recording = _measure(vehicle, measured, road, seed, time, truth, rate, seconds, rng)
    return Drive(recording, time, states[:, 0 : 2 * len(model.elements) : 2], truth)


def usual_channels(model: CarModel) -> tuple[str, ...]:
    """Name wheel hubs and body above each element; where it rolls one body sensor at the rear."""
    if "roll" in model.coordinates:
        wheels = [f"{element.name}_wheel" for element in model.elements]
        return (*wheels, "front_left_chassis", "front_right_chassis", "rear_chassis")
    return tuple(
        f"{element.name}_{part}" for element in model.elements for part in ("wheel", "chassis")
    )


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


def _integration_grid(vehicle: Vehicle, channels: Sequence[Channel], seconds: float) -> Array:
    """Build the times (M,), s, from standstill to beyond the last delayed reading."""
    delays = [vehicle.sensor(channel.name).delay for channel in channels]
    start, end = -_REST + min(*delays, 0.0), seconds + max(*delays, 0.0) + 0.1
    return np.arange(start, end, 1.0 / _INTEGRATION_RATE)


def _measure(
    vehicle: Vehicle,
    channels: Sequence[Channel],
    road: Road,
    seed: int,
    time: Array,
    truth: Array,
    rate: float,
    seconds: float,
    rng: np.random.Generator,
) -> Recording:
    """Measure true quantities (C, M), SI units, at times (M,), s, with the vehicle's sensors."""
    sensors = [vehicle.sensor(channel.name) for channel in channels]
    bandwidths = [sensor.bandwidth for sensor in sensors if sensor.bandwidth is not None]
    rows = np.arange(round(seconds * rate)) / rate
    shown = display_units(vehicle.units)
    values = np.empty((len(channels), len(rows)))
    units = []
    for c, (channel, sensor) in enumerate(zip(channels, sensors, strict=True)):
        signal = truth[c]
        # An accelerometer without a bandwidth is like the slowest of the others.
        alike = bandwidths and channel.quantity == "acceleration"
        corner = sensor.bandwidth or (min(bandwidths) if alike else None)
        if corner is not None:
            signal = one_pole_filter(time, signal, corner)
        sampled = CubicSpline(time, signal)(rows + sensor.delay)
        if sensor.noise is not None:
            sampled = sampled + sensor.noise * unit_noise(rng, len(rows), rate, sensor.bandwidth)
        sampled = np.clip(sampled, sensor.low, sensor.high)
        if sensor.counts_scale is not None and sensor.zero_counts is not None:
            counts = np.rint(sampled / sensor.counts_scale + sensor.zero_counts)
            values[c], own_unit = counts, "counts"
        else:
            if sensor.resolution is not None:
                sampled = np.rint(sampled / sensor.resolution) * sensor.resolution
            own_unit = shown[channel.dimension]
            values[c] = sampled / si_factor(own_unit, channel.dimension)
        units.append(own_unit)
    note = f"simulated: {vehicle.name} over {road.name} at {road.speed:.2f} m/s, seed {seed}"
    return Recording(
        time=rows,
        values=values,
        units=tuple(units),
        metadata=(("sample_rate", f"{rate:g} Hz"), ("note", note)),
        source=f"simulated {road.name}",
        channels=tuple(channel.name for channel in channels),
    )


def _hub_acceleration(road: Road, x: Array) -> Array:
    """Hub acceleration, m/s²: second difference of the road height at distances x, m."""
    d = road.speed / _INTEGRATION_RATE
    second_difference = road.height(x + d) - 2.0 * road.height(x) + road.height(x - d)
    return np.asarray(second_difference * _INTEGRATION_RATE**2)


def one_pole_filter(time: Array, signal: Array, bandwidth: float) -> Array:
    """Filter a signal with one pole at `bandwidth`, Hz, from rest."""
    pole = np.array([[-2.0 * math.pi * bandwidth]])
    system = LinearSystem(pole, -pole, np.eye(1), np.zeros((1, 1)))
    return simulate_linear(system, time, signal[:, None])[:, 0]


def unit_noise(rng: np.random.Generator, n: int, rate: float, bandwidth: float | None) -> Array:
    """Draw noise of unit variance that has passed the sensor's one-pole filter (AR(1))."""
    white = rng.normal(size=n)
    if bandwidth is None or n < 2:
        return white
    decay = math.exp(-2.0 * math.pi * bandwidth / rate)
    white[1:] *= math.sqrt(1.0 - decay**2)
    return np.asarray(lfilter([1.0], [1.0, -decay], white))
