"""How the hubs move: a half car on tyres that can leave the ground, many drives at a time.

The estimator takes the hubs' motion as it is measured, so nothing about tyres is asked of the
vehicle file.  A plan needs them before there is a measurement.  What a tyre does between road
and hub is therefore assumed from what small cars have, unless it is told; ``benchmarks/plan.py``
says what that costs: most of what a promise is off by.

With z and θ the heave and pitch (nose-up) of the chassis, u the hubs, h the road under the tyre::

    m z̈ = F_f + F_r            i θ̈ = l_f F_f − l_r F_r
    m_u ü = −F + T             F = −k δ − c δ̇,   δ_f = z + l_f θ − u_f,  δ_r = z − l_r θ − u_r
    T = max(k_t (h − u) + c_t (ḣ − u̇), −W)

counted from rest on level ground; W is the weight that the tyre carries there: it cannot pull.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bayes_asv.domain.errors import InputError
from bayes_asv.models.half_car import HalfCar
from bayes_asv.planning.grounds import Ground, ground_under_tyre

__all__ = ["LEAD", "Motion", "Pass", "Tyres", "assumed_tyres", "drive_all"]

Array = NDArray[np.float64]
Laid = dict[tuple[Ground, int], tuple[CubicSpline, CubicSpline, float]]

LEAD = 0.5  # s of level ground at the beginning of a recording
_BEFORE = 0.25  # s at rest before the recording, so that filters and delays have settled
_AFTER = 0.05  # s beyond its end
_GRAVITY = 9.80665  # m/s²
_RATE = 2000.0  # steps a second: fifty and more in a period of wheel hop
_HIGHEST_RATE = 10_000.0
_TOGETHER = 24  # passes side by side: fewer waste time in Python, more waste memory
_PHASE = 0.5  # of the fastest eigenvalue in a step, where Runge and Kutta are good to 1e-4

# What small cars have.  Wheels, hubs and half the links weigh a fifth to a third of what they
# carry.  A tyre is three to ten times as stiff as the spring above it (Gillespie, Fundamentals of
# Vehicle Dynamics, ch. 5), and flattens by 1 to 2 cm at rest however soft the spring is.
_UNSPRUNG = 0.25
_STIFFER = 4.0  # than the spring, at least
_FLATTENED = 0.018  # m, at most
_FLATTEST = 0.1  # m, beyond which a number is in a wrong unit
_TYRE_RATIO = 0.03  # damping of the tyre itself: a few per cent


class Tyres(NamedTuple):
    """What is below the suspension, an axle each, front then rear.

    Parameters
    ----------
    mass : (2,) array
        Unsprung mass, kg.
    rate, damping : (2,) arrays
        Of the tyres, N/m and N·s/m.
    flattened : float
        Static deflection of the tyres, mean of both axles, m.
    """

    mass: Array
    rate: Array
    damping: Array
    flattened: float


class Pass(NamedTuple):
    """One drive over a ground.

    Parameters
    ----------
    ground : Ground
        What lies there; the front axle reaches it :data:`LEAD` after the recording begins.
    speed : float
        m/s.
    seconds : float
        Length of the recording.
    seed : int
        Of a rough road.
    """

    ground: Ground
    speed: float
    seconds: float
    seed: int = 0


@dataclass(frozen=True)
class Motion:
    """What one pass does to the car.

    Parameters
    ----------
    time : (M,) array
        s, zero where the recording begins.
    acceleration : (4, M) array
        Front hub, chassis above it, rear hub, chassis above it, m/s².
    deflection : (2, M) array
        Front and rear, extension positive, m from rest.
    flight : (2,) array
        Longest time that the front and the rear tyres are off the ground at a stretch, s.
    """

    time: Array
    acceleration: Array
    deflection: Array
    flight: Array


def assumed_tyres(car: HalfCar, rate: float | None = None, unsprung: float | None = None) -> Tyres:
    """Tyres and unsprung masses in the middle of what cars have, for this car's springs.

    Parameters
    ----------
    car : HalfCar
        SI units.
    rate, unsprung : float, optional
        Of an axle, both sides together, where a person knows them: N/m and kg.

    Returns
    -------
    Tyres
    """
    carried = car.m * np.array([car.wdf, 1.0 - car.wdf])
    mass = _UNSPRUNG * carried if unsprung is None else np.full(2, unsprung)
    weight = _GRAVITY * (carried + mass)
    usual = np.maximum(_STIFFER * np.array([car.k_f, car.k_r]), weight / _FLATTENED)
    rates = usual if rate is None else np.full(2, rate)
    damping = 2.0 * _TYRE_RATIO * np.sqrt(rates * mass)
    return Tyres(mass, rates, damping, float(np.mean(weight / rates)))


def drive_all(car: HalfCar, tyres: Tyres, passes: Sequence[Pass]) -> list[Motion]:
    """Drive a car over many grounds, each on its own.

    Fourth-order Runge–Kutta, passes of like length side by side.

    Parameters
    ----------
    car : HalfCar
        SI units.
    tyres : Tyres
        Below it.
    passes : sequence of Pass
        Grounds, speeds and lengths.

    Returns
    -------
    list of Motion
        In the order of the passes.

    Raises
    ------
    InputError
        When the car is so stiff for its mass, or its tyres so soft, that no real one is.
    """
    if not tyres.flattened <= _FLATTEST:
        raise InputError(
            "tyres",
            f"would flatten by {1e3 * tyres.flattened:.0f} mm at rest",
            "check the unit of their rate, and that it is of both sides together",
        )
    free, push = _matrices(car, tyres.mass)
    springy = free.copy()
    for axle in range(2):  # with its tyres on the ground
        springy[:, 2 + axle] -= tyres.rate[axle] * push[:, axle]
        springy[:, 6 + axle] -= tyres.damping[axle] * push[:, axle]
    fastest = float(np.max(np.abs(np.linalg.eigvals(springy))))
    rate = max(_RATE, fastest / _PHASE)
    if not rate <= _HIGHEST_RATE:
        raise InputError(
            "vehicle",
            f"springs, dampers and tyres would make the wheels move at {fastest / 6.28:.0f} Hz",
            "check the units of masses, springs, damping and tyres",
        )
    curves = _lay(car, tyres, passes)
    # those of like length side by side, so that short ones need not wait for long ones
    order = sorted(range(len(passes)), key=lambda k: passes[k].seconds)
    found: dict[int, Motion] = {}
    for first in range(0, len(order), _TOGETHER):
        group = order[first : first + _TOGETHER]
        driven = _drive_group(
            car, tyres, (free, push), [passes[k] for k in group], curves, 1.0 / rate
        )
        found.update(zip(group, driven, strict=True))
    return [found[k] for k in range(len(passes))]


def _drive_group(
    car: HalfCar,
    tyres: Tyres,
    matrices: tuple[Array, Array],
    passes: Sequence[Pass],
    curves: Laid,
    step: float,
) -> list[Motion]:
    """Drive passes side by side, as long as the longest of them takes."""
    most = max(one.seconds for one in passes) + _BEFORE + _AFTER
    time = np.arange(-_BEFORE, most - _BEFORE + step, step)
    half = np.arange(2 * len(time) - 1) * 0.5 * step - _BEFORE
    road = np.empty((len(half), 2, len(passes)))
    slope = np.empty_like(road)
    for k, one in enumerate(passes):
        curve, rising, reach = curves[one.ground, one.seed]
        for axle in range(2):
            # a pass that ends before the longest one goes on over level ground, unseen
            place = np.minimum(one.speed * (half - LEAD) - axle * car.l, reach)
            road[:, axle, k] = curve(place)
            slope[:, axle, k] = np.where(place < reach, rising(place) * one.speed, 0.0)
    weight = _GRAVITY * (car.m * np.array([car.wdf, 1.0 - car.wdf]) + tyres.mass)
    states, force = _integrate(*matrices, tyres, weight, road, slope, step)
    return [
        _motion(car, *matrices, time, states[:, :, k], force[:, :, k], weight, one.seconds)
        for k, one in enumerate(passes)
    ]


def _lay(car: HalfCar, tyres: Tyres, passes: Sequence[Pass]) -> Laid:
    """Each ground once, long enough for every pass over it: height, slope, and where it ends."""
    reach: dict[tuple[Ground, int], float] = {}
    behind: dict[tuple[Ground, int], float] = {}
    for one in passes:
        key = one.ground, one.seed
        end = one.speed * (one.seconds + 2.0 * _AFTER - LEAD) + 0.1
        start = one.speed * (LEAD + _BEFORE) + car.l + 0.1
        reach[key] = max(reach.get(key, 0.0), end)
        behind[key] = max(behind.get(key, 0.0), start)
    found = {}
    for key, end in reach.items():
        curve = ground_under_tyre(key[0], end, behind[key], tyres.flattened, key[1])
        found[key] = curve, curve.derivative(), end
    return found


def _matrices(car: HalfCar, mass: Array) -> tuple[Array, Array]:
    """State (z, θ, u_f, u_r and their rates): matrix without tyres (8, 8), push of tyres (8, 2)."""
    front = np.array([1.0, car.l_f, -1.0, 0.0])
    rear = np.array([1.0, -car.l_r, 0.0, -1.0])
    inverse = np.diag([1.0 / car.m, 1.0 / car.i, 1.0 / mass[0], 1.0 / mass[1]])
    stiffness = car.k_f * np.outer(front, front) + car.k_r * np.outer(rear, rear)
    damping = car.c_f * np.outer(front, front) + car.c_r * np.outer(rear, rear)
    free = np.zeros((8, 8))
    free[:4, 4:] = np.eye(4)
    free[4:, :4] = -inverse @ stiffness
    free[4:, 4:] = -inverse @ damping
    push = np.zeros((8, 2))
    push[6, 0], push[7, 1] = 1.0 / mass
    return free, push


def _integrate(
    free: Array, push: Array, tyres: Tyres, weight: Array, road: Array, slope: Array, step: float
) -> tuple[Array, Array]:
    """States (M, 8, K) and tyre forces (M, 2, K) from road and its rate at whole and half steps."""
    steps = (len(road) + 1) // 2
    count = road.shape[2]
    k_t, c_t, least = tyres.rate[:, None], tyres.damping[:, None], -weight[:, None]
    # tyre force = pull(road) − G x, never below minus the weight
    pull = k_t * road + c_t * slope
    grip = np.zeros((2, 8))
    grip[0, 2], grip[1, 3] = tyres.rate
    grip[0, 6], grip[1, 7] = tyres.damping

    def force(x: Array, at: int) -> Array:
        return np.asarray(np.maximum(pull[at] - grip @ x, least))

    def rates(x: Array, at: int) -> Array:
        return np.asarray(free @ x + push @ force(x, at))

    states = np.empty((steps, 8, count))
    forces = np.empty((steps, 2, count))
    x = np.zeros((8, count))
    for n in range(steps):
        states[n], forces[n] = x, force(x, 2 * n)
        if n == steps - 1:
            break
        a = rates(x, 2 * n)
        b = rates(x + 0.5 * step * a, 2 * n + 1)
        c = rates(x + 0.5 * step * b, 2 * n + 1)
        d = rates(x + step * c, 2 * n + 2)
        x = x + step / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    return states, forces


def _motion(
    car: HalfCar,
    free: Array,
    push: Array,
    time: Array,
    states: Array,
    force: Array,
    weight: Array,
    seconds: float,
) -> Motion:
    """Accelerations, deflections and flights of one pass from its states."""
    kept = time <= seconds + _AFTER
    time, x, tyre = time[kept], states[kept], force[kept]
    moved = x @ free.T + tyre @ push.T
    z, pitch, hubs = moved[:, 4], moved[:, 5], moved[:, 6:]
    acceleration = np.stack([hubs[:, 0], z + car.l_f * pitch, hubs[:, 1], z - car.l_r * pitch])
    deflection = np.stack(
        [x[:, 0] + car.l_f * x[:, 1] - x[:, 2], x[:, 0] - car.l_r * x[:, 1] - x[:, 3]]
    )
    step = float(time[1] - time[0])
    up = tyre <= -weight * (1.0 - 1e-9)
    flight = np.array([step * _longest_stretch(up[:, axle]) for axle in range(2)])
    return Motion(time, acceleration, deflection, flight)


def _longest_stretch(flags: NDArray[np.bool_]) -> int:
    """Length of the longest unbroken stretch of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return int(np.max(edges[1::2] - edges[::2], initial=0))
