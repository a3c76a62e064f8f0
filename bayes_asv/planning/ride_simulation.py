"""Ride simulation: a car on tyres that can leave the ground, several drives in parallel.

The estimator measures the motion of the hubs, so the vehicle file needs no tyre data.  A plan has
no measurement yet and assumes typical tyres of small cars unless they are given.  According to
``benchmarks/plan.py`` this assumption causes most of the error of the predicted deviations.

With q the coordinates of the body, H the heights of the tops of its suspension elements, u the hubs
and h the road under each tyre::

    J q̈ = Hᵀ F                 F = −K δ − c δ̇,   δ = H q − u
    m_u ü = −F + T             T = max(k_t (h − u) + c_t (ḣ − u̇), −W)

relative to rest on level ground.  W is the static wheel load: the tyre force on the ground cannot
become negative.  The right wheels of a car that has some meet an obstacle later than the left ones,
and have a rough road of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bayes_asv.domain.channels import Channel
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.units import STANDARD_GRAVITY
from bayes_asv.models.car_model import CarModel, Output, state_space
from bayes_asv.planning.drives import LEAD_IN, RoadProfile, enveloped_profile

__all__ = ["RIGHT_LATER", "Motion", "Pass", "Tyres", "default_tyres", "simulate_passes"]

Array = NDArray[np.float64]
RoadCurves = dict[tuple[RoadProfile, int], tuple[CubicSpline, CubicSpline, float]]

RIGHT_LATER = 0.5
"""Distance by which the right wheels meet an obstacle later than the left ones, m."""

_RIGHT_SEED = 50_021  # between the seeds of a rough road's left and right track
_SETTLING_TIME = 0.25  # s at rest before the recording, for filters and delays
_MARGIN = 0.05  # s simulated beyond the end of the recording
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
    """Tyres and unsprung masses of the E suspension elements of a car.

    Parameters
    ----------
    mass : (E,) array
        Unsprung mass, kg.
    rate, damping : (E,) arrays
        Vertical stiffness and damping of the tyres, N/m and N·s/m.
    static_deflection : float
        Static tyre deflection, mean of all, m.
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
    signals : (C, M) array
        What the channels measure, SI units.
    deflection : (E, M) array
        Suspension deflections from rest, extension positive, m.
    airborne : (E,) array
        Longest uninterrupted time of each tyre off the ground, s.
    """

    time: Array
    signals: Array
    deflection: Array
    airborne: Array


def _static_loads(car: CarModel) -> Array:
    """Weight (E,) of the body on each suspension element, N."""
    H, J = car.heights(car.nominal)[0], car.inertia(car.nominal)[0]
    pull = np.zeros(len(J))  # gravity along the coordinates; of the first, all mass that it lifts
    pull[0] = STANDARD_GRAVITY * J[0] / H[0, 0]
    return np.asarray(np.linalg.pinv(H.T) @ pull)


def default_tyres(car: CarModel, rate: float | None = None, unsprung: float | None = None) -> Tyres:
    """Return typical tyres and unsprung masses for a car.

    Parameters
    ----------
    car : CarModel
        The car.
    rate, unsprung : float, optional
        Known values of one axle, both sides together, N/m and kg.

    Returns
    -------
    Tyres
    """
    load = _static_loads(car)
    alike = np.array([sum(o.axle == e.axle for o in car.elements) for e in car.elements])
    springs = np.array([float(car.nominal[e.spring][0]) for e in car.elements])
    mass = _UNSPRUNG_RATIO * load / STANDARD_GRAVITY if unsprung is None else unsprung / alike
    weight = load + STANDARD_GRAVITY * mass
    typical = np.maximum(_TYRE_STIFFNESS_RATIO * springs, weight / _MAX_STATIC_DEFLECTION)
    rates = typical if rate is None else rate / alike
    damping = 2.0 * _TYRE_DAMPING_RATIO * np.sqrt(rates * mass)
    return Tyres(mass, rates, damping, float(np.mean(weight / rates)))


def simulate_passes(
    car: CarModel, tyres: Tyres, passes: Sequence[Pass], channels: Sequence[Channel]
) -> list[Motion]:
    """Simulate independent passes of a car, by a fourth-order Runge–Kutta method.

    Parameters
    ----------
    car : CarModel
        At its nominal values.
    tyres : Tyres
        Tyres and unsprung masses.
    passes : sequence of Pass
        Roads, speeds and lengths.
    channels : sequence of Channel
        What is measured.

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
    hub, rate_of = _hub_states(car)
    for e in range(len(tyres.rate)):
        on_ground[:, hub[e]] -= tyres.rate[e] * force_input[:, e]
        on_ground[:, rate_of[e]] -= tyres.damping[e] * force_input[:, e]
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
            car, tyres, (state_matrix, force_input), [passes[k] for k in group], curves,
            1.0 / rate, channels,
        )  # fmt: skip
        motions.update(zip(group, simulated, strict=True))
    return [motions[k] for k in range(len(passes))]


def _hub_states(car: CarModel) -> tuple[list[int], list[int]]:
    """Numbers of the states that are heights of the hubs, and their rates."""
    n, ne = len(car.coordinates), len(car.elements)
    return [n + e for e in range(ne)], [2 * n + ne + e for e in range(ne)]


def _wheelbase(car: CarModel) -> float:
    """Distance of the rear axle behind the front one, m; zero for a car of one axle."""
    return float(car.nominal["l"][0]) if "l" in car.names else 0.0


def _behind(car: CarModel, e: int, road: RoadProfile) -> float:
    """Distance by which an element meets a road later than the first one, m."""
    element = car.elements[e]
    behind = _wheelbase(car) if element.axle == "rear" else 0.0
    skewed = element.side == "right" and road.kind != "rough"
    return behind + (RIGHT_LATER if skewed else 0.0)


def _seed(car: CarModel, e: int, one: Pass) -> int:
    """Seed of the road under an element."""
    has_separate_road = car.elements[e].side == "right" and one.road.kind == "rough"
    return one.seed + (_RIGHT_SEED if has_separate_road else 0)


def _simulate_group(
    car: CarModel,
    tyres: Tyres,
    matrices: tuple[Array, Array],
    passes: Sequence[Pass],
    curves: RoadCurves,
    step: float,
    channels: Sequence[Channel],
) -> list[Motion]:
    """Simulate passes in parallel, for the duration of the longest."""
    duration = max(one.seconds for one in passes) + _SETTLING_TIME + _MARGIN
    time = np.arange(-_SETTLING_TIME, duration - _SETTLING_TIME + step, step)
    half = np.arange(2 * len(time) - 1) * 0.5 * step - _SETTLING_TIME
    road = np.empty((len(half), len(car.elements), len(passes)))
    slope = np.empty_like(road)
    for k, one in enumerate(passes):
        for e in range(len(car.elements)):
            height, gradient, end = curves[one.road, _seed(car, e, one)]
            # beyond its end a shorter pass continues over a constant height, which is discarded
            x = np.minimum(one.speed * (half - LEAD_IN) - _behind(car, e, one.road), end)
            road[:, e, k] = height(x)
            slope[:, e, k] = np.where(x < end, gradient(x) * one.speed, 0.0)
    weight = _static_loads(car) + STANDARD_GRAVITY * tyres.mass
    states, force = _integrate(car, *matrices, tyres, weight, road, slope, step)
    return [
        _motion(
            car, *matrices, time, states[:, :, k], force[:, :, k], weight, one.seconds, channels
        )
        for k, one in enumerate(passes)
    ]


def _road_curves(car: CarModel, tyres: Tyres, passes: Sequence[Pass]) -> RoadCurves:
    """Return height, gradient and end of each road, long enough for every pass over it."""
    ends: dict[tuple[RoadProfile, int], float] = {}
    starts: dict[tuple[RoadProfile, int], float] = {}
    for one in passes:
        end = one.speed * (one.seconds + 2.0 * _MARGIN - LEAD_IN) + 0.1
        last = max(_behind(car, e, one.road) for e in range(len(car.elements)))
        start = one.speed * (LEAD_IN + _SETTLING_TIME) + last + 0.1
        for e in range(len(car.elements)):
            key = one.road, _seed(car, e, one)
            ends[key] = max(ends.get(key, 0.0), end)
            starts[key] = max(starts.get(key, 0.0), start)
    curves = {}
    for key, end in ends.items():
        curve = enveloped_profile(key[0], end, starts[key], tyres.static_deflection, key[1])
        curves[key] = curve, curve.derivative(), end
    return curves


def _matrices(car: CarModel, mass: Array) -> tuple[Array, Array]:
    """Return A without tyres and B of tyre forces; states q, u and their rates."""
    values = car.nominal
    H = car.heights(values)[0]
    ne, n = H.shape
    stretch = np.hstack([H, -np.eye(ne)])  # deflections by body and hubs
    inverse = np.diag(1.0 / np.concatenate([car.inertia(values)[0], mass]))
    spring = np.diag([float(values[e.spring][0]) for e in car.elements])
    if car.stiffness is not None:
        spring = spring + car.stiffness(values)[0]
    damper = np.diag([float(values[e.damping][0]) for e in car.elements])
    size = n + ne
    state_matrix = np.zeros((2 * size, 2 * size))
    state_matrix[:size, size:] = np.eye(size)
    state_matrix[size:, :size] = -inverse @ stretch.T @ spring @ stretch
    state_matrix[size:, size:] = -inverse @ stretch.T @ damper @ stretch
    force_input = np.zeros((2 * size, ne))
    _, rate_of = _hub_states(car)
    force_input[rate_of, range(ne)] = 1.0 / mass
    return state_matrix, force_input


def _integrate(
    car: CarModel,
    state_matrix: Array,
    force_input: Array,
    tyres: Tyres,
    weight: Array,
    road: Array,
    slope: Array,
    step: float,
) -> tuple[Array, Array]:
    """Integrate the states (M, n, K) and tyre forces (M, E, K) over the road at half steps."""
    steps = (len(road) + 1) // 2
    size, count = len(state_matrix), road.shape[2]
    k_t, c_t, minimum = tyres.rate[:, None], tyres.damping[:, None], -weight[:, None]
    # tyre force = k_t h + c_t ḣ − G x, never below minus the static load
    from_road = k_t * road + c_t * slope
    hub, rate_of = _hub_states(car)
    feedback = np.zeros((len(hub), size))
    feedback[range(len(hub)), hub] = tyres.rate
    feedback[range(len(hub)), rate_of] = tyres.damping

    def force(x: Array, n: int) -> Array:
        return np.asarray(np.maximum(from_road[n] - feedback @ x, minimum))

    def derivative(x: Array, n: int) -> Array:
        return np.asarray(state_matrix @ x + force_input @ force(x, n))

    states = np.empty((steps, size, count))
    forces = np.empty((steps, len(hub), count))
    x = np.zeros((size, count))
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
    car: CarModel,
    state_matrix: Array,
    force_input: Array,
    time: Array,
    states: Array,
    force: Array,
    weight: Array,
    seconds: float,
    channels: Sequence[Channel],
) -> Motion:
    """Compute signals, deflections and airborne times of one pass from its states."""
    kept = time <= seconds + _MARGIN
    time, x, tyre = time[kept], states[kept], force[kept]
    hub, rate_of = _hub_states(car)
    hubs = x @ state_matrix[rate_of].T + tyre @ force_input[rate_of].T
    H = car.heights(car.nominal)[0]
    ne, n = H.shape
    deflection = x[:, :n] @ H.T - x[:, hub]
    deflection_rate = x[:, n + ne : 2 * n + ne] @ H.T - x[:, rate_of]
    outputs = [Output(channel) for channel in channels if not channel.is_input]
    system = state_space(car, car.nominal, outputs)
    of_estimator = np.zeros((len(x), system.A.shape[1]))
    of_estimator[:, 0 : 2 * ne : 2], of_estimator[:, 1 : 2 * ne : 2] = deflection, deflection_rate
    turning = [o.channel.axis for o in outputs if o.channel.axis is not None]
    for k, axis in enumerate(turning):
        of_estimator[:, 2 * ne + k] = x[:, n + ne + car.coordinates.index(axis)]
    read = iter(system.C[0] @ of_estimator.T)
    signals = [hubs[:, car.element_of(c)] if c.is_input else next(read) for c in channels]
    step = float(time[1] - time[0])
    off_ground = tyre <= -weight * (1.0 - 1e-9)
    airborne = np.array([step * _longest_run(off_ground[:, e]) for e in range(ne)])
    return Motion(time, np.stack(signals), deflection.T, airborne)


def _longest_run(flags: NDArray[np.bool_]) -> int:
    """Return the length of the longest run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return int(np.max(edges[1::2] - edges[::2], initial=0))
