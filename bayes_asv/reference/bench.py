"""Two recordings of the reference that need no road: one sensor on all channels, and an engine."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.vehicle import Sensor, Vehicle
from bayes_asv.models.discretization import simulate_linear
from bayes_asv.models.half_car import HalfCar, LinearSystem
from bayes_asv.reference.modal import axle_matrices

__all__ = ["Bench", "engine_idling", "one_sensor_everywhere"]

Array = NDArray[np.float64]

_FINE = 4000.0  # Hz
# What a single cylinder without a balancer shakes the frame with: unbalanced mass times crank
# radius.  The reference does not give it; this makes some 2 m/s² at 3000 rpm.
_IMBALANCE = 0.0045  # kg·m
_REAR = 0.8  # share of the force at the rear axle line, where the engine sits
_HZ = (28.0, 60.0)  # idle and full speed, 1700 to 3600 rpm


class Bench(NamedTuple):
    """Readings of several channels: stamps (N,), s, and values (N, channels)."""

    time: Array
    values: Array


def one_sensor_everywhere(vehicle: Vehicle, rate: float = 800.0, seconds: float = 0.25) -> Bench:
    """Fig. 6.6: one chassis sensor, moved by hand, read on all four channels.

    Each channel is read at its own delay, so what the two pairs differ by is the delay of the
    second channel of a board times the slope of the signal.

    Returns
    -------
    Bench
        Counts, in the order of the channels.
    """
    sensor = vehicle.sensor("front_chassis")
    time = np.arange(round(seconds * rate)) / rate
    counts = np.stack(
        [_counts(_by_hand(time + each.delay), sensor) for each in vehicle.sensors], axis=1
    )
    return Bench(time, counts)


def engine_idling(
    vehicle: Vehicle, car: HalfCar, seed: int, rate: float = 200.0, seconds: float = 4.0
) -> Bench:
    """Fig. 7.2: the car standing, its engine revved at random, both chassis channels at 200 Hz.

    The engine shakes the half car with F = μ Ω² sin φ, μ the imbalance and φ̇ = Ω its speed.

    Parameters
    ----------
    vehicle, car : Vehicle, HalfCar
        Sensors, and the car they are on; wheels stand still.
    seed : int
        Of the revving.
    rate, seconds : float
        Hz and s.

    Returns
    -------
    Bench
        m/s², front and rear chassis.
    """
    rng = np.random.default_rng([seed, 72])
    fine = np.arange(round((seconds + 0.01) * _FINE)) / _FINE
    knots = np.linspace(0.0, fine[-1], 10)
    speed = np.interp(fine, knots, rng.uniform(*_HZ, len(knots)))
    phase = 2.0 * np.pi * np.cumsum(speed) / _FINE
    force = _IMBALANCE * (2.0 * np.pi * speed) ** 2 * np.sin(phase)
    M, C, K = axle_matrices(car)
    inverse = np.linalg.inv(M)
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ K, -inverse @ C]])
    push = inverse @ np.array([[1.0 - _REAR], [_REAR]])
    system = LinearSystem(A, np.concatenate([np.zeros((2, 1)), push]), np.eye(4), np.zeros((4, 1)))
    x = simulate_linear(system, fine, force[:, None])
    chassis = x @ np.concatenate([-inverse @ K, -inverse @ C], axis=1).T + force[:, None] * push.T
    time = np.arange(round(seconds * rate)) / rate
    columns = []
    for axle, name in enumerate(("front_chassis", "rear_chassis")):
        sensor = vehicle.sensor(name)
        signal = _one_pole(fine, chassis[:, axle], sensor.bandwidth)
        read = np.interp(time + sensor.delay, fine, signal)
        read += (sensor.noise or 0.0) * rng.standard_normal(len(time))
        step = sensor.resolution or 0.0
        columns.append(np.rint(read / step) * step if step else read)
    return Bench(time, np.stack(columns, axis=1))


def _by_hand(t: Array) -> Array:
    """Move a sensor arbitrarily, m/s²."""
    return np.asarray(
        4.0 * np.sin(2.0 * np.pi * 7.0 * t) + 1.5 * np.sin(2.0 * np.pi * 17.0 * t + 1.0)
    )


def _counts(signal: Array, sensor: Sensor) -> Array:
    scale, zero = sensor.counts_scale, sensor.zero_counts
    return np.rint(signal / (scale or 0.0627) + (zero or 512.0))


def _one_pole(time: Array, signal: Array, bandwidth: float | None) -> Array:
    if bandwidth is None:
        return signal
    pole = np.array([[-2.0 * np.pi * bandwidth]])
    system = LinearSystem(pole, -pole, np.eye(1), np.zeros((1, 1)))
    return simulate_linear(system, time, signal[:, None])[:, 0]
