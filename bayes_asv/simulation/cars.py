"""Drives of the cars beyond the half car: any of them over a road, the one that rolls recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import ROLL_CHANNELS
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.assembly import SecondOrder, state_form
from bayes_asv.models.discretization import simulate_linear
from bayes_asv.models.from_vehicle import roll_car
from bayes_asv.models.roll_car import RollCar, deflections
from bayes_asv.simulation.roads import Road
from bayes_asv.simulation.simulate import SETTLE, fine_grid, hub_acceleration, read_out

__all__ = ["RollDrive", "follow", "simulate_roll"]

Array = NDArray[np.float64]


def follow(system: SecondOrder, time: Array, u: Array, rate: Array) -> tuple[Array, Array]:
    """Drive any car over its inputs, at rest before.

    Parameters
    ----------
    system : SecondOrder
        n coordinates, p inputs.
    time : (N,) array
        Times, s.
    u, rate : (N, p) arrays
        Heights of the road (or of the wheels), m, and their rates, m/s, straight in between.

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


@dataclass(frozen=True)
class RollDrive:
    """A simulated drive of a car that rolls.

    Parameters
    ----------
    recording : Recording
        What the seven sensors read.
    time : (M,) array
        Fine time grid, s.
    deflection : (M, 4) array
        Suspension deflections, extension positive, m.
    acceleration : (7, M) array
        True accelerations in the order of `ROLL_CHANNELS`, m/s².
    """

    recording: Recording
    time: Array
    deflection: Array
    acceleration: Array


def simulate_roll(
    vehicle: Vehicle,
    tracks: tuple[Road, Road],
    *,
    skew: float = 0.0,
    rate: float = 400.0,
    seconds: float = 2.5,
    seed: int = 0,
    car: RollCar | None = None,
) -> RollDrive:
    """Drive a car that rolls over a left and a right track and record it with its sensors.

    The hubs follow the tracks, the rear ones a wheel base later; the chassis answers as the linear
    car of three degrees of freedom.

    Parameters
    ----------
    vehicle : Vehicle
        With a ``[roll]``.
    tracks : pair of Road
        Under the left and the right wheels; the first's speed is the car's.
    skew : float
        How much later the right wheels meet their track, m.
    rate : float
        Rows a second, Hz.
    seconds : float
        Length of the recording.
    seed : int
        Seed of the sensor noise.
    car : RollCar, optional
        Another car than the nominal one, SI units.

    Returns
    -------
    RollDrive

    Raises
    ------
    InputError
        If the vehicle has no ``[roll]``.
    """
    rng = np.random.default_rng([seed, 1])
    car = roll_car(vehicle) if car is None else car
    fine = fine_grid(vehicle, ROLL_CHANNELS, seconds)
    left, right = tracks
    x = left.speed * (fine - SETTLE)
    hubs = np.stack(
        [
            hub_acceleration(left, x),
            hub_acceleration(right, x - skew),
            hub_acceleration(left, x - car.l),
            hub_acceleration(right, x - skew - car.l),
        ],
        axis=1,
    )
    system = deflections(car)
    states = simulate_linear(system, fine, hubs)
    truth = np.vstack([hubs.T, (states @ system.C.T).T])
    note = f"simulated: {vehicle.name} over {left.name} at {left.speed:.2f} m/s, seed {seed}"
    source = f"simulated {left.name}"
    recording = read_out(vehicle, ROLL_CHANNELS, fine, truth, rate, seconds, rng, note, source)
    return RollDrive(recording, fine, states[:, :4], truth)
