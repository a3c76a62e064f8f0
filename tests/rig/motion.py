"""How the car moves: pack what is known, call the kernel, give the results names."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .car import RigCar
from .forces import ChassisForce
from .kernel import integrate
from .laws import Packed
from .road import lay
from .terrain import Terrain

__all__ = ["RATE", "Motion", "lagrange", "simulate"]

Reals = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

RATE = 16_000.0
"""Internal steps a second. Wheel hop is at 8 Hz: the error of a step is far below any sensor."""


@dataclass(frozen=True)
class Motion:
    """What truly happened, on the internal grid.

    Attributes
    ----------
    t_start, step : float
        Time of the first row, and the step, s.
    states : ndarray, shape (steps + 1, 10 + own)
        x, theta, u_f, u_r, their four rates, the seat and its rate, states of the terms; SI.
    acceleration : ndarray, shape (4, steps + 1)
        front hub, chassis at the front axle, rear hub, chassis at the rear axle, m/s^2.
    tyre_force : ndarray, shape (2, steps + 1)
        Whole tyre forces, N.
    suspension_force : ndarray, shape (2, steps + 1)
        Suspension forces on the chassis, N.
    road : ndarray, shape (2, steps + 1)
        Road height under each axle (after the envelope), m.
    deflection, deflection_rate : ndarray, shape (2, steps + 1)
        Of the suspension, extension positive, m and m/s.
    """

    t_start: float
    step: float
    states: Reals
    acceleration: Reals
    tyre_force: Reals
    suspension_force: Reals
    road: Reals
    deflection: Reals
    deflection_rate: Reals

    @property
    def time(self) -> Reals:
        """Times of the internal grid, s."""
        return self.t_start + self.step * np.arange(len(self.states), dtype=np.float64)


def simulate(
    car: RigCar,
    terrain: Terrain,
    speed: float,
    t_start: float,
    t_end: float,
    forces: Sequence[ChassisForce] = (),
    rate: float = RATE,
    initial: Reals | None = None,
) -> Motion:
    """Drive a car over a terrain.

    Parameters
    ----------
    car : RigCar
        Truth.
    terrain : Terrain
        The front axle is above its place 0 at ``terrain.lead_in``.
    speed : float
        Constant, m/s.
    t_start, t_end : float
        Times, s; the road is level under the car as it was at ``t_start``.
    forces : sequence of ChassisForce
        Their sum acts on the chassis.
    rate : float
        Steps a second.
    initial : ndarray, shape (8,), optional
        State at ``t_start``; at rest if not given.

    Returns
    -------
    Motion
        Everything on the internal grid. Checked in ``test_rig.py`` against the exact linear
        response.

    Raises
    ------
    FloatingPointError
        When the motion blows up: something is stiffer than ``rate`` can follow (a law's rate over
        an unsprung mass, or a mount's over its damper, times the step, has to stay below 2).
    """
    step = 1.0 / rate
    steps = math.ceil((t_end - t_start) * rate)
    origin = speed * terrain.lead_in
    begin = speed * t_start - origin - car.l
    end = speed * (t_start + steps * step) - origin
    if speed == 0.0:
        begin = end = -1e3  # a parked car stands before the terrain, whatever its lead-in
        origin = 1e3
    road = lay(terrain, _down(begin), -_down(-end), car.tyre_radius, car.contact_patch)
    kind, par, pool, pointer, split, own = _pack_laws(car)
    state = np.zeros(10 + own)
    if initial is not None:
        state[: len(initial)] = initial
        if car.seat is not None and len(initial) <= 8:
            state[8] = state[0] + car.seat.position * state[1]
            state[9] = state[4] + car.seat.position * state[5]
    body = _pack_body(car, speed, origin, road.start, road.grid)
    states, seen = integrate(
        t_start,
        step,
        steps,
        state,
        _outside(forces, t_start, step, steps),
        body,
        road.coefficients,
        kind,
        par,
        pool,
        pointer,
        split,
    )
    if not np.isfinite(states[-1]).all():
        raise FloatingPointError(f"the motion of {car.name!r} blows up at {rate:g} steps a second")
    front = states[:, 0] + car.l_f * states[:, 1] - states[:, 2]
    rear = states[:, 0] - car.l_r * states[:, 1] - states[:, 3]
    front_rate = states[:, 4] + car.l_f * states[:, 5] - states[:, 6]
    rear_rate = states[:, 4] - car.l_r * states[:, 5] - states[:, 7]
    columns = np.ascontiguousarray(seen.T)
    return Motion(
        t_start=t_start,
        step=step,
        states=states,
        acceleration=columns[0:4],
        tyre_force=columns[4:6],
        suspension_force=columns[6:8],
        road=columns[8:10],
        deflection=np.stack([front, rear]),
        deflection_rate=np.stack([front_rate, rear_rate]),
    )


def lagrange(values: Reals, at: Reals) -> Reals:
    """Interpolate rows of ``values`` (rows, n) at fractional columns by four-point cubics."""
    whole = np.clip(np.floor(at).astype(np.int64), 1, values.shape[1] - 3)
    r = at - whole
    return np.asarray(
        -r * (r - 1.0) * (r - 2.0) / 6.0 * values[:, whole - 1]
        + (r + 1.0) * (r - 1.0) * (r - 2.0) / 2.0 * values[:, whole]
        - (r + 1.0) * r * (r - 2.0) / 2.0 * values[:, whole + 1]
        + (r + 1.0) * r * (r - 1.0) / 6.0 * values[:, whole + 2]
    )


def _down(place: float) -> float:
    """Round down to whole metres, so that runs of one terrain share a laid road."""
    return math.floor(place)


def _outside(forces: Sequence[ChassisForce], t_start: float, step: float, steps: int) -> Reals:
    """Sum outside forces at every whole and half step; one column of zeros if there is none."""
    if not forces:
        return np.zeros((2, 1))
    t = t_start + 0.5 * step * np.arange(2 * steps + 1, dtype=np.float64)
    total = np.zeros((2, len(t)))
    for force in forces:
        front, rear = force.at(t)
        total[0] += front
        total[1] += rear
    return total


def _pack_laws(car: RigCar) -> tuple[Integers, Reals, Reals, Integers, int, int]:
    """Lay both axles' terms out as tables; also the number of front terms and of own states."""
    front, rear = car.laws
    terms: list[Packed] = [term.pack() for term in (*front, *rear)]
    kind = np.array([term.kind for term in terms], dtype=np.int64)
    par = np.zeros((len(terms), 6))
    pointer = np.zeros((len(terms), 3), dtype=np.int64)
    pool: list[float] = []
    own = 0
    for row, term in enumerate(terms):
        par[row, : len(term.parameters)] = term.parameters
        pointer[row] = (term.address, len(pool), 10 + own)
        pool.extend(term.table)
        own += term.states
    return kind, par, np.array([*pool, 0.0]), pointer, len(front), own


def _pack_body(car: RigCar, speed: float, origin: float, start: float, grid: float) -> Reals:
    """Masses, tyres and road as one vector, in the order that the kernel reads."""
    m, i, q = car.m, car.i, 0.0
    seat = (0.0, 0.0, 0.0, 0.0)
    if car.seat is not None:
        moving, p = car.seat.mass, car.seat.position
        # what is left when a point mass goes out of a rigid body: its centre and its inertia
        m = car.m - moving
        q = -moving * p / m
        i = car.i - moving * p * p - m * q * q
        seat = (moving, car.seat.k, car.seat.c, p)
    return np.array(
        [m, i, q, car.l_f, car.l_r, car.m_uf, car.m_ur, car.k_tf, car.k_tr, car.c_tf, car.c_tr,
         car.load_f, car.load_r, float(car.tyre_lifts), *seat, speed, origin, start, grid]
    )  # fmt: skip
