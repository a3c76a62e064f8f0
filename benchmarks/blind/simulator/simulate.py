"""Motion of a half car on tyres over a road, by Runge–Kutta steps, many cars side by side.

States of a column: heave, pitch, height of the front and of the rear axle (m, rad, from rest),
their rates, and whatever memory the mechanisms of its faults have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .cars import GRAVITY, Car, geometry
from .kinds import Vector, Whole

__all__ = ["Drive", "History", "Mechanism", "Now", "integrate", "motion_matrices"]


@dataclass(frozen=True)
class Drive:
    """A run before it is driven: what the road does to the tyres at every half step.

    ``begin`` time of the first step, s; ``step``, s; ``length`` of the recording, s; ``height``
    (halves, 2) and ``rate`` (halves, 2) of the road under the axles, m and m/s.
    """

    begin: float
    step: float
    length: float
    speed: float
    height: Vector
    rate: Vector

    @property
    def times(self) -> Vector:
        """Times of the steps, s."""
        return self.begin + self.step * np.arange((len(self.height) + 1) // 2)

    @property
    def half_times(self) -> Vector:
        """Times of the half steps, s."""
        return self.begin + 0.5 * self.step * np.arange(len(self.height))


class Now:
    """What a mechanism sees and changes at one moment; arrays have one column for each car.

    ``delta`` and ``rate`` (2, B) are deflections (m) and their rates (m/s); ``force`` (6, B), N,
    has the suspension forces on the chassis, the tyre forces on the axles, and forces on the
    chassis alone, each front and rear. ``aux`` is the mechanism's own memory and ``flow`` takes
    its rate of change. ``half`` counts half steps.
    """

    __slots__ = ("aux", "delta", "flow", "force", "half", "into", "rate", "state")

    half: int
    delta: Vector
    rate: Vector
    force: Vector
    aux: Vector
    flow: Vector
    state: Vector
    into: Vector

    def acceleration(self) -> Vector:
        """Accelerations (4, B) of heave, pitch and axles under the forces so far."""
        return self.into @ self.force


class Mechanism(Protocol):
    """A part of a car that adds forces and may have a memory."""

    @property
    def states(self) -> int:
        """Number of states of a column."""

    def act(self, now: Now) -> None:
        """Add to ``now.force``, and fill ``now.flow``."""


@dataclass(frozen=True)
class History:
    """What happened: (steps, …, B) arrays. ``memory`` has the mechanisms' states and rates."""

    times: Vector
    state: Vector
    flow: Vector
    delta: Vector
    rate: Vector
    suspension: Vector
    runs: Whole
    memory: tuple[slice, ...]

    def column(self, number: int) -> History:
        """Return the history of one column alone, still with an axis of columns."""
        one = slice(number, number + 1)
        return History(
            self.times,
            self.state[:, :, one],
            self.flow[:, :, one],
            self.delta[:, :, one],
            self.rate[:, :, one],
            self.suspension[:, :, one],
            self.runs[one],
            self.memory,
        )


def motion_matrices(car: Car) -> tuple[Vector, Vector]:
    """Rows (8, 8) from states to linear forces, deflections and rates; and forces to accelerations.

    The rows are the suspension forces on the chassis (2), the tyre forces without the road (2),
    deflections (2) and their rates (2). The second matrix (4, 6) takes the forces of
    :class:`Now`.
    """
    body = geometry(car)
    stretch = np.hstack([body, -np.eye(2)])
    rows = np.zeros((8, 8))
    rows[4:6, :4] = stretch
    rows[6:8, 4:] = stretch
    rows[0:2] = -np.diag(car.k) @ rows[4:6] - np.diag(car.c) @ rows[6:8]
    rows[2, 2], rows[3, 3] = -car.tyre[0], -car.tyre[1]
    rows[2, 6], rows[3, 7] = -car.tyre_damping[0], -car.tyre_damping[1]
    into = np.zeros((4, 6))
    into[:2, 0:2] = into[:2, 4:6] = np.diag([1.0 / car.m, 1.0 / car.i]) @ body.T
    for axle in range(2):
        into[2 + axle, axle] = -1.0 / car.unsprung[axle]
        into[2 + axle, 2 + axle] = 1.0 / car.unsprung[axle]
    return rows, into


def integrate(
    car: Car, drives: Sequence[Drive], runs: Whole, mechanisms: Sequence[Mechanism] = ()
) -> History:
    """Drive columns of cars, column j in run ``runs[j]``, all with the same mechanisms.

    A tyre pushes but does not pull: it leaves the road where the force would be negative.
    """
    rows, into = motion_matrices(car)
    step = drives[0].step
    count = (len(drives[0].height) + 1) // 2
    width = len(runs)
    tyre = np.stack(
        [np.asarray(car.tyre) * d.height + np.asarray(car.tyre_damping) * d.rate for d in drives],
        axis=-1,
    )[:, :, runs]
    lift = np.array(
        [
            [-GRAVITY * (car.m * car.wdf + car.unsprung[0])],
            [-GRAVITY * (car.m * (1.0 - car.wdf) + car.unsprung[1])],
        ]
    )
    places, total = [], 8
    for mechanism in mechanisms:
        places.append(slice(total, total + mechanism.states))
        total += mechanism.states
    now = Now()
    now.into = into
    forces = np.zeros((6, width))
    now.force = forces
    loose = any(len(range(p.start, p.stop)) for p in places)

    def slope(x: Vector, half: int) -> Vector:
        linear = rows @ (x[:8] if loose else x)
        forces[0:2] = linear[0:2]
        np.maximum(linear[2:4] + tyre[half], lift, out=forces[2:4])
        change = np.empty_like(x)
        if mechanisms:
            forces[4:6] = 0.0
            now.half, now.state = half, x
            now.delta, now.rate = linear[4:6], linear[6:8]
            for place, mechanism in zip(places, mechanisms, strict=True):
                now.aux, now.flow = x[place], change[place]
                mechanism.act(now)
        change[0:4] = x[4:8]
        change[4:8] = into @ forces
        return change

    state = np.zeros((count, total, width))
    flow = np.zeros((count, total, width))
    suspension = np.zeros((count, 2, width))
    x = np.zeros((total, width))
    half_step, sixth = 0.5 * step, step / 6.0
    for n in range(count):
        k1 = slope(x, 2 * n)
        state[n], flow[n], suspension[n] = x, k1, forces[0:2]
        if n == count - 1:
            break
        k2 = slope(x + half_step * k1, 2 * n + 1)
        k3 = slope(x + half_step * k2, 2 * n + 1)
        k4 = slope(x + step * k3, 2 * n + 2)
        k2 += k3
        k2 *= 2.0
        k2 += k1
        k2 += k4
        x = x + sixth * k2
    stretch = np.einsum("rs,nsb->nrb", rows[4:8], state[:, :8])
    return History(
        drives[0].times,
        state,
        flow,
        stretch[:, 0:2],
        stretch[:, 2:4],
        suspension,
        runs,
        tuple(places),
    )
