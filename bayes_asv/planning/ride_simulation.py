"""Ride simulation: a half car on tyres that can leave the ground, several drives in parallel.

The estimator measures the motion of the hubs, so the vehicle file needs no tyre data.  A plan has
no measurement yet and assumes typical tyres of small cars unless they are given.  According to
``benchmarks/plan.py`` this assumption causes most of the error of the predicted deviations.

With z and θ the heave and pitch (nose-up) of the chassis, u the hubs, h the road under the tyre::

    m z̈ = F_f + F_r            i θ̈ = l_f F_f − l_r F_r
    m_u ü = −F + T             F = −k δ − c δ̇,   δ_f = z + l_f θ − u_f,  δ_r = z − l_r θ − u_r
    T = max(k_t (h − u) + c_t (ḣ − u̇), −W)

relative to rest on level ground.  W is the static wheel load: the tyre force on the ground cannot
become negative.
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
from bayes_asv.planning.drives import LEAD_IN, RoadProfile, enveloped_profile

__all__ = ["Motion", "Pass", "Tyres", "default_tyres", "simulate_passes"]

Array = NDArray[np.float64]
RoadCurves = dict[tuple[RoadProfile, int], tuple[CubicSpline, CubicSpline, float]]

_SETTLING_TIME = 0.25  # s at rest before the recording, for filters and delays
_MARGIN = 0.05  # s simulated beyond the end of the recording
_GRAVITY = 9.80665  # m/s²
_RATE = 2000.0  # Hz; more than fifty steps per period of wheel hop
_MAX_RATE = 10_000.0  # Hz; a stiffer car is implausible
_BATCH_SIZE = 24  # passes in parallel, a compromise between overhead and memory
_MAX_PHASE = 0.5  # |λ| h of the fastest eigenvalue, where Runge-Kutta is accurate to 1e-4

# Typical values of small cars.  An unsprung mass is a fifth to a third of the sprung mass above it.
# A tyre is three to ten times as stiff as the spring above it (Gillespie, Fundamentals of Vehicle
# Dynamics, ch. 5), and its static deflection is 1 to 2 cm even with a soft spring.
_UNSPRUNG_RATIO = 0.25
_TYRE_STIFFNESS_RATIO = 4.0  # minimum
_MAX_STATIC_DEFLECTION = 0.018  # m
_IMPLAUSIBLE_DEFLECTION = 0.1  # m, beyond which the unit of the rate is wrong
_TYRE_DAMPING_RATIO = 0.03


class Tyres(NamedTuple):
    """Tyres and unsprung masses per axle, front and rear.

    Parameters
    ----------
    mass : (2,) array
        Unsprung mass, kg.
    rate, damping : (2,) arrays
        Vertical stiffness and damping of the tyres, N/m and N·s/m.
    static_deflection : float
        Static tyre deflection, mean of both axles, m.
    """

    mass: Array
    rate: Array
    damping: Array
    static_deflection: float


class Pass(NamedTuple):
    """One pass over a road.

    Parameters
    ----------
    road : RoadProfile
        The road; the front axle reaches it :data:`~bayes_asv.planning.drives.LEAD_IN` after the
        beginning of the recording.
    speed : float
        Speed, m/s.
    seconds : float
        Length of the recording.
    seed : int
        Seed of a rough road.
    """

    road: RoadProfile
    speed: float
    seconds: float
    seed: int = 0


@dataclass(frozen=True)
class Motion:
    """Response of the car to one pass.

    Parameters
    ----------
    time : (M,) array
        Times, s, zero at the beginning of the recording.
    acceleration : (4, M) array
        Front hub, chassis above it, rear hub and chassis above it, m/s².
    deflection : (2, M) array
        Front and rear suspension deflections from rest, extension positive, m.
    airborne : (2,) array
        Longest uninterrupted time of the front and rear tyres off the ground, s.
    """

    time: Array
    acceleration: Array
    deflection: Array
    airborne: Array


def default_tyres(car: HalfCar, rate: float | None = None, unsprung: float | None = None) -> Tyres:
    """Return typical tyres and unsprung masses for a car.

    Parameters
    ----------
    car : HalfCar
        SI units.
    rate, unsprung : float, optional
        Known values of one axle, both sides together, N/m and kg.

    Returns
    -------
    Tyres
    """
    sprung = car.m * np.array([car.wdf, 1.0 - car.wdf])
    mass = _UNSPRUNG_RATIO * sprung if unsprung is None else np.full(2, unsprung)
    weight = _GRAVITY * (sprung + mass)
    typical = np.maximum(
        _TYRE_STIFFNESS_RATIO * np.array([car.k_f, car.k_r]), weight / _MAX_STATIC_DEFLECTION
    )
    rates = typical if rate is None else np.full(2, rate)
    damping = 2.0 * _TYRE_DAMPING_RATIO * np.sqrt(rates * mass)
    return Tyres(mass, rates, damping, float(np.mean(weight / rates)))


def simulate_passes(car: HalfCar, tyres: Tyres, passes: Sequence[Pass]) -> list[Motion]:
    """Simulate independent passes of a car, by a fourth-order Runge–Kutta method.

    Parameters
    ----------
    car : HalfCar
        SI units.
    tyres : Tyres
        Tyres and unsprung masses.
    passes : sequence of Pass
        Roads, speeds and lengths.

    Returns
    -------
    list of Motion
        In the order of the passes.

    Raises
    ------
    InputError
        If the car is implausibly stiff for its mass, or its tyres are implausibly soft.
    """
    if not tyres.static_deflection <= _IMPLAUSIBLE_DEFLECTION:
        raise InputError(
            "tyres",
            f"have a static deflection of {1e3 * tyres.static_deflection:.0f} mm",
            "check the unit of the tyre rate, and that it is for both sides together",
        )
    state_matrix, force_input = _matrices(car, tyres.mass)
    on_ground = state_matrix.copy()
    for axle in range(2):
        on_ground[:, 2 + axle] -= tyres.rate[axle] * force_input[:, axle]
        on_ground[:, 6 + axle] -= tyres.damping[axle] * force_input[:, axle]
    fastest = float(np.max(np.abs(np.linalg.eigvals(on_ground))))
    rate = max(_RATE, fastest / _MAX_PHASE)
    if not rate <= _MAX_RATE:
        raise InputError(
            "vehicle",
            f"with these springs, dampers and tyres the fastest mode is at {fastest / 6.28:.0f} Hz",
            "check the units of masses, springs, damping and tyres",
        )
    curves = _road_curves(car, tyres, passes)
    # batches of similar length, so that little time is spent beyond the end of short passes
    order = sorted(range(len(passes)), key=lambda k: passes[k].seconds)
    motions: dict[int, Motion] = {}
    for first in range(0, len(order), _BATCH_SIZE):
        group = order[first : first + _BATCH_SIZE]
        simulated = _simulate_group(
            car, tyres, (state_matrix, force_input), [passes[k] for k in group], curves, 1.0 / rate
        )
        motions.update(zip(group, simulated, strict=True))
    return [motions[k] for k in range(len(passes))]


def _simulate_group(
    car: HalfCar,
    tyres: Tyres,
    matrices: tuple[Array, Array],
    passes: Sequence[Pass],
    curves: RoadCurves,
    step: float,
) -> list[Motion]:
    """Simulate passes in parallel, for the duration of the longest."""
    duration = max(one.seconds for one in passes) + _SETTLING_TIME + _MARGIN
    time = np.arange(-_SETTLING_TIME, duration - _SETTLING_TIME + step, step)
    half = np.arange(2 * len(time) - 1) * 0.5 * step - _SETTLING_TIME
    road = np.empty((len(half), 2, len(passes)))
    slope = np.empty_like(road)
    for k, one in enumerate(passes):
        height, gradient, end = curves[one.road, one.seed]
        for axle in range(2):
            # beyond its end a shorter pass continues over a constant height, which is discarded
            x = np.minimum(one.speed * (half - LEAD_IN) - axle * car.l, end)
            road[:, axle, k] = height(x)
            slope[:, axle, k] = np.where(x < end, gradient(x) * one.speed, 0.0)
    weight = _GRAVITY * (car.m * np.array([car.wdf, 1.0 - car.wdf]) + tyres.mass)
    states, force = _integrate(*matrices, tyres, weight, road, slope, step)
    return [
        _motion(car, *matrices, time, states[:, :, k], force[:, :, k], weight, one.seconds)
        for k, one in enumerate(passes)
    ]


def _road_curves(car: HalfCar, tyres: Tyres, passes: Sequence[Pass]) -> RoadCurves:
    """Return height, gradient and end of each road, long enough for every pass over it."""
    ends: dict[tuple[RoadProfile, int], float] = {}
    starts: dict[tuple[RoadProfile, int], float] = {}
    for one in passes:
        key = one.road, one.seed
        end = one.speed * (one.seconds + 2.0 * _MARGIN - LEAD_IN) + 0.1
        start = one.speed * (LEAD_IN + _SETTLING_TIME) + car.l + 0.1
        ends[key] = max(ends.get(key, 0.0), end)
        starts[key] = max(starts.get(key, 0.0), start)
    curves = {}
    for key, end in ends.items():
        curve = enveloped_profile(key[0], end, starts[key], tyres.static_deflection, key[1])
        curves[key] = curve, curve.derivative(), end
    return curves


def _matrices(car: HalfCar, mass: Array) -> tuple[Array, Array]:
    """Return A (8, 8) without tyres and B (8, 2) of tyre forces; states z, θ, u_f, u_r, rates."""
    front = np.array([1.0, car.l_f, -1.0, 0.0])
    rear = np.array([1.0, -car.l_r, 0.0, -1.0])
    inverse = np.diag([1.0 / car.m, 1.0 / car.i, 1.0 / mass[0], 1.0 / mass[1]])
    stiffness = car.k_f * np.outer(front, front) + car.k_r * np.outer(rear, rear)
    damping = car.c_f * np.outer(front, front) + car.c_r * np.outer(rear, rear)
    state_matrix = np.zeros((8, 8))
    state_matrix[:4, 4:] = np.eye(4)
    state_matrix[4:, :4] = -inverse @ stiffness
    state_matrix[4:, 4:] = -inverse @ damping
    force_input = np.zeros((8, 2))
    force_input[6, 0], force_input[7, 1] = 1.0 / mass
    return state_matrix, force_input


def _integrate(
    state_matrix: Array,
    force_input: Array,
    tyres: Tyres,
    weight: Array,
    road: Array,
    slope: Array,
    step: float,
) -> tuple[Array, Array]:
    """Integrate the states (M, 8, K) and tyre forces (M, 2, K) over the road at half steps."""
    steps = (len(road) + 1) // 2
    count = road.shape[2]
    k_t, c_t, minimum = tyres.rate[:, None], tyres.damping[:, None], -weight[:, None]
    # tyre force = k_t h + c_t ḣ − G x, never below minus the static load
    from_road = k_t * road + c_t * slope
    feedback = np.zeros((2, 8))
    feedback[0, 2], feedback[1, 3] = tyres.rate
    feedback[0, 6], feedback[1, 7] = tyres.damping

    def force(x: Array, n: int) -> Array:
        return np.asarray(np.maximum(from_road[n] - feedback @ x, minimum))

    def derivative(x: Array, n: int) -> Array:
        return np.asarray(state_matrix @ x + force_input @ force(x, n))

    states = np.empty((steps, 8, count))
    forces = np.empty((steps, 2, count))
    x = np.zeros((8, count))
    for n in range(steps):
        states[n], forces[n] = x, force(x, 2 * n)
        if n == steps - 1:
            break
        a = derivative(x, 2 * n)
        b = derivative(x + 0.5 * step * a, 2 * n + 1)
        c = derivative(x + 0.5 * step * b, 2 * n + 1)
        d = derivative(x + step * c, 2 * n + 2)
        x = x + step / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    return states, forces


def _motion(
    car: HalfCar,
    state_matrix: Array,
    force_input: Array,
    time: Array,
    states: Array,
    force: Array,
    weight: Array,
    seconds: float,
) -> Motion:
    """Compute accelerations, deflections and airborne times of one pass from its states."""
    kept = time <= seconds + _MARGIN
    time, x, tyre = time[kept], states[kept], force[kept]
    derivative = x @ state_matrix.T + tyre @ force_input.T
    z, pitch, hubs = derivative[:, 4], derivative[:, 5], derivative[:, 6:]
    acceleration = np.stack([hubs[:, 0], z + car.l_f * pitch, hubs[:, 1], z - car.l_r * pitch])
    deflection = np.stack(
        [x[:, 0] + car.l_f * x[:, 1] - x[:, 2], x[:, 0] - car.l_r * x[:, 1] - x[:, 3]]
    )
    step = float(time[1] - time[0])
    off_ground = tyre <= -weight * (1.0 - 1e-9)
    airborne = np.array([step * _longest_run(off_ground[:, axle]) for axle in range(2)])
    return Motion(time, acceleration, deflection, airborne)


def _longest_run(flags: NDArray[np.bool_]) -> int:
    """Return the length of the longest run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return int(np.max(edges[1::2] - edges[::2], initial=0))
