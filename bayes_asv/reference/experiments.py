"""The reference's experiments run again: chapters 5, 6, 7 and 8.

Chapter 5 estimates the parameters that simulated data were made with.  A car with exact values runs
over one bump without noise.  The reference's grey box uses the four states and the positions and
velocities of the wheels at 300 instants; ``idgrey`` holds the inputs between them, since App. C.2
has ``data.int = 'foh'`` only as a comment.  Held inputs lag by half a sample, which the estimate
compensates with damping.

Chapters 6 and 7 show two recordings without a road, one sensor on all channels and an engine.

The recordings of chapter 8 are not public.  Ours are simulated drives of a car with a worn front
damper over two parking stops at 400 and 800 Hz with known true values (``data/recordings``).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.progress import Progress
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.units import INCH, MPH
from bayes_asv.domain.vehicle import Sensor, Vehicle, read_vehicle
from bayes_asv.estimate_result import EstimationResult
from bayes_asv.estimation import estimate
from bayes_asv.io import read_recording
from bayes_asv.models.discretization import simulate_linear
from bayes_asv.models.half_car_equations import HalfCar, LinearSystem, position_form
from bayes_asv.reference.greybox import (
    PointEstimate,
    fit_states,
    grey_box,
    largest_travel,
    nominal_car,
)
from bayes_asv.reference.integrated import DETRENDINGS, REST_TIME, Integrated, integrate
from bayes_asv.reference.modal import axle_matrices
from bayes_asv.shipped import shipped
from bayes_asv.simulation.roads import Road
from bayes_asv.simulation.simulate import one_pole_filter, simulate

__all__ = [
    "POINTS",
    "RUNS",
    "ExactStates",
    "Readings",
    "Run",
    "common_sensor_readings",
    "engine_readings",
    "fit_exact_accelerations",
    "fit_exact_states",
    "reproduce_runs",
    "shipped_vehicle",
    "simulate_exact_states",
    "smooth_bump",
    "table_51_quantities",
]

Array = NDArray[np.float64]

POINTS = 300
"""Number of points in the reference (section 5.3)."""
STEP = 0.005  # s, not given in the reference; 300 points cover the bump and the decay
_SUBSTEPS = 10  # of the exact solution per step
_HEIGHT, _LENGTH, _SPEED = 3 * INCH, 60 * INCH, 10 * MPH  # m, m, m/s


def smooth_bump() -> Road:
    """Return a bump h sin⁶(πx/L), 3 in high and 60 in long, at 10 mph.

    Five derivatives are continuous, so a spline interpolates it accurately.  Over the shipped bump,
    whose jerk is discontinuous, the same estimate has an error of 0.02 %.
    """

    def height(x: Array) -> Array:
        inside = (x > 0.0) & (x < _LENGTH)
        return np.where(inside, _HEIGHT * np.sin(np.pi * x / _LENGTH) ** 6, 0.0)

    return Road("smooth bump", _SPEED, height)


class ExactStates(NamedTuple):
    """States and inputs of a car over a bump, without noise (Fig. 5.2)."""

    time: Array
    u: Array
    y: Array


def simulate_exact_states(car: HalfCar, step: float = STEP, points: int = POINTS) -> ExactStates:
    """Simulate a car over :func:`smooth_bump` without noise.

    Parameters
    ----------
    car : HalfCar
        SI units.
    step : float
        Time between points, s.
    points : int
        Number of points.

    Returns
    -------
    ExactStates
        Times (N,), inputs u (N, 4) as in eq. 5.4 and states y (N, 4) as in eq. 5.3; SI units.
    """
    bump = smooth_bump()
    h = step / _SUBSTEPS
    time: Array = h * np.arange((points - 1) * _SUBSTEPS + 1, dtype=np.float64)
    columns = []
    for distance in (0.0, car.l):
        x = bump.speed * (time - REST_TIME) - distance
        d = bump.speed * h
        columns += [bump.height(x), (bump.height(x + d) - bump.height(x - d)) / (2.0 * h)]
    u = np.stack(columns, axis=1)
    y = simulate_linear(position_form(car), time, u)
    return ExactStates(time[::_SUBSTEPS], u[::_SUBSTEPS], y[::_SUBSTEPS])


def fit_exact_states(vehicle: Vehicle, hold: str, step: float = STEP) -> PointEstimate:
    """Estimate the parameters of the exact states in the reference's coordinates."""
    data = simulate_exact_states(nominal_car(vehicle), step)
    return fit_states(data.time, data.u, data.y, vehicle, hold=hold, initial="zero")


def fit_exact_accelerations(vehicle: Vehicle, rate: float = 400.0) -> PointEstimate:
    """Estimate the parameters from exact accelerations, in deflections."""
    drive = simulate(vehicle, smooth_bump(), rate=rate, seconds=1.5)
    return grey_box(drive.recording, vehicle, coordinates="deflection", initial="zero")


def table_51_quantities(estimate: PointEstimate, vehicle: Vehicle) -> dict[str, float]:
    """Return the quantities of Table 5.1 of an estimate: k_g, m, and both damping ratios."""
    car = nominal_car(vehicle)._replace(
        **{name: estimate.parameters[name].value for name in ("c_f", "c_r", "i")}
    )
    return {"k_g": car.k_g, "zeta_f": car.zeta_f, "zeta_r": car.zeta_r}


_ENGINE_RATE = 4000.0  # Hz, of the simulation
# Unbalanced mass times crank radius of a single cylinder without a balancer, not given in the
# reference; this value makes some 2 m/s² at 3000 rpm.
_UNBALANCE = 0.0045  # kg·m
_REAR_SHARE = 0.8  # fraction of the force at the rear axle, near the engine
_ENGINE_SPEEDS = (28.0, 60.0)  # Hz, idle and full speed, 1700 to 3600 rpm


class Readings(NamedTuple):
    """Readings of several channels: times (N,), s, and values (N, channels)."""

    time: Array
    values: Array


def common_sensor_readings(
    vehicle: Vehicle, rate: float = 800.0, seconds: float = 0.25
) -> Readings:
    """Simulate Fig. 6.6: one chassis sensor, moved by hand, read on all four channels.

    Each channel is sampled with its own delay, so the two channels of a board differ by the delay
    times the slope of the signal.

    Returns
    -------
    Readings
        Counts, in channel order.
    """
    sensor = vehicle.sensor("front_chassis")
    time = np.arange(round(seconds * rate)) / rate
    counts = np.stack(
        [
            _to_counts(_hand_motion(time + other.delay), sensor)
            for other in vehicle.sensors_of(CHANNELS)
        ],
        axis=1,
    )
    return Readings(time, counts)


def engine_readings(
    vehicle: Vehicle, car: HalfCar, seed: int, rate: float = 200.0, seconds: float = 4.0
) -> Readings:
    """Simulate Fig. 7.2: both chassis channels of the standing car with its engine running.

    The engine speed Ω = φ̇ varies at random, and its force is F = μ Ω² sin φ with the unbalance μ.

    Parameters
    ----------
    vehicle, car : Vehicle, HalfCar
        Sensors, and the car; its wheels stand still.
    seed : int
        Seed of engine speed and noise.
    rate, seconds : float
        Sampling rate, Hz, and length, s.

    Returns
    -------
    Readings
        m/s², front and rear chassis.
    """
    rng = np.random.default_rng([seed, 72])
    fine = np.arange(round((seconds + 0.01) * _ENGINE_RATE)) / _ENGINE_RATE
    knots = np.linspace(0.0, fine[-1], 10)
    speed = np.interp(fine, knots, rng.uniform(*_ENGINE_SPEEDS, len(knots)))
    phase = 2.0 * np.pi * np.cumsum(speed) / _ENGINE_RATE
    force = _UNBALANCE * (2.0 * np.pi * speed) ** 2 * np.sin(phase)
    M, C, K = axle_matrices(car)
    inverse = np.linalg.inv(M)
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ K, -inverse @ C]])
    force_input = inverse @ np.array([[1.0 - _REAR_SHARE], [_REAR_SHARE]])
    system = LinearSystem(
        A, np.concatenate([np.zeros((2, 1)), force_input]), np.eye(4), np.zeros((4, 1))
    )
    x = simulate_linear(system, fine, force[:, None])
    chassis = (
        x @ np.concatenate([-inverse @ K, -inverse @ C], axis=1).T + force[:, None] * force_input.T
    )
    time = np.arange(round(seconds * rate)) / rate
    columns = []
    for axle, name in enumerate(("front_chassis", "rear_chassis")):
        sensor = vehicle.sensor(name)
        signal = chassis[:, axle]
        if sensor.bandwidth is not None:
            signal = one_pole_filter(fine, signal, sensor.bandwidth)
        reading = np.interp(time + sensor.delay, fine, signal)
        reading += (sensor.noise or 0.0) * rng.standard_normal(len(time))
        step = sensor.resolution or 0.0
        columns.append(np.rint(reading / step) * step if step else reading)
    return Readings(time, np.stack(columns, axis=1))


def _hand_motion(t: Array) -> Array:
    """Acceleration of a sensor moved by hand, m/s², at times t, s."""
    return np.asarray(
        4.0 * np.sin(2.0 * np.pi * 7.0 * t) + 1.5 * np.sin(2.0 * np.pi * 17.0 * t + 1.0)
    )


def _to_counts(signal: Array, sensor: Sensor) -> Array:
    scale, zero = sensor.counts_scale, sensor.zero_counts
    return np.rint(signal / (scale or 0.0627) + (zero or 512.0))


RUNS: Final = ("stops-400hz.csv", "stops-800hz.csv")
REFERENCE_DETRENDING: Final = {"stops-400hz.csv": "trend", "stops-800hz.csv": "constant"}
"""Detrending of the 400 Hz and 800 Hz data in the reference (section 8.1)."""


@dataclass(frozen=True)
class Run:
    """One recording, estimated by three methods.

    Parameters
    ----------
    name : str
        Name of its file.
    recording : Recording
        As read.
    truth : dict of str to float
        True c_f, c_r, i and k_g of the simulated car, SI units.
    integrated : dict of str to Integrated
        Integrated states by kind of detrending.
    reference_fits : dict of str to PointEstimate
        The reference's grey box by kind of detrending: states as outputs, held inputs, initially at
        rest.
    deflection : PointEstimate
        The same criterion in deflections.
    posterior : EstimationResult
        Result of ``bayes-asv estimate``.
    """

    name: str
    recording: Recording
    truth: dict[str, float]
    integrated: dict[str, Integrated]
    reference_fits: dict[str, PointEstimate]
    deflection: PointEstimate
    posterior: EstimationResult

    @property
    def reference_detrending(self) -> str:
        """Kind of detrending that the reference applies at this sampling rate."""
        return REFERENCE_DETRENDING[self.name]

    def largest_travel(self, detrending: str) -> tuple[float, float]:
        """Return the largest integrated deflection, front and rear, m."""
        front, rear = largest_travel(self.integrated[detrending])
        return float(front), float(rear)


def shipped_vehicle(name: str) -> Vehicle:
    """Read a vehicle shipped with the package."""
    return read_vehicle(shipped("vehicles", name))


def reproduce_runs(vehicle: Vehicle, seed: int, progress: Progress | None = None) -> list[Run]:
    """Estimate every shipped run over the stops by all methods.

    Parameters
    ----------
    vehicle : Vehicle
        The Baja car as declared in its vehicle file.
    seed : int
        Seed of the sampler.
    progress : callable, optional
        Called with the fraction done and a description.

    Returns
    -------
    list of Run
    """
    report = progress or (lambda share, words: None)
    runs = []
    for n, name in enumerate(RUNS):
        report(n / len(RUNS), f"{name}: grey box")
        recording = read_recording(shipped("recordings", name))
        integrated = {r: integrate(recording, vehicle, r) for r in DETRENDINGS}
        reference_fits = {
            r: grey_box(recording, vehicle, coordinates="integrated", initial="zero", detrending=r)
            for r in DETRENDINGS
        }
        deflection = grey_box(recording, vehicle)
        report((n + 0.5) / len(RUNS), f"{name}: posterior")
        posterior = estimate([recording], vehicle, seed=seed)
        runs.append(
            Run(name, recording, _truth(name), integrated, reference_fits, deflection, posterior)
        )
    return runs


def _truth(name: str) -> dict[str, float]:
    file = shipped("recordings", name.replace(".csv", ".truth.json"))
    truth: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))["parameters"]["SI"]
    return {key: float(truth[key]) for key in ("c_f", "c_r", "i", "k_g")}
