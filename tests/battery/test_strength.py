"""Noncentrality: held against whole covariance matrices, a prior's arithmetic, and a power law."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import least_squares

from bayes_asv.domain.recording import Recording, accelerations, sample_times
from bayes_asv.domain.vehicle import Vehicle
from benchmarks.calibration.dense import Noise, respond
from tests.battery.cases import declared
from tests.battery.courses import Drive, as_recording, driven
from tests.battery.strength import carried, left_over, scaled
from tests.battery.world import World
from tests.rig import Coulomb, LinearSpring, SensorSpec, baja, with_terms

Array = NDArray[np.float64]

# 0.75 s at 200 Hz: the front has gone over the bump, the rear is on it
ROWS = slice(0, 300, 2)
SPEC = SensorSpec()
BUMP = Drive("bump", 0.8, 4.6, 0, 0)


def quiet(world: World, how: Drive, rows: slice = slice(None)) -> Recording:
    whole = as_recording(driven(world, how, quiet=True), "")
    return Recording(whole.time[rows], whole.values[:, rows], whole.units, (), "")


def dense(recording: Recording, vehicle: Vehicle) -> float:
    """Least distance by whole covariance matrices: shares no code with the product's filter."""
    acc, times = accelerations(recording, vehicle), sample_times(recording, vehicle)
    use = times[1] <= times[0, -1]
    samples, readings = times[0], times[1, use]
    y = acc[[1, 3]][:, use].ravel()
    n, m = len(readings), len(samples)
    fine = np.append((samples[:-1, None] + np.diff(samples)[:, None] * np.arange(4) / 4).ravel(),
                     samples[-1])  # fmt: skip
    motion = CubicSpline(samples, acc[[0, 2]].T)(fine).T[:, :, None]
    noises = [
        Noise((s.resolution or 0.0) ** 2 / 12.0, (s.noise or 0.0) ** 2, 2.0 * math.pi * 50.0)
        for s in vehicle.sensors
    ]
    given_values = (vehicle.m, vehicle.l, vehicle.wdf, vehicle.k_f, vehicle.k_r)
    nominal = np.array([v.value for v in (vehicle.c_f, vehicle.c_r, vehicle.i, *given_values)])
    sd = np.array([math.log(3.0)] * 2 + [math.log(2.0)] + [v.sd / v.value for v in given_values])

    def car(p: Array) -> Array:
        return np.asarray(nominal * np.exp(sd * p))

    def covariance(p: Array) -> Array:
        basis = CubicSpline(samples, np.eye(m))(fine)
        S = np.zeros((2 * n, 2 * n))
        for axle in range(2):
            alone = np.zeros((2, len(fine), m))
            alone[axle] = basis
            G = respond(car(p), fine, alone, readings).reshape(2 * n, m)
            S += G @ noises[2 * axle].covariance(samples) @ G.T
            block = slice(axle * n, (axle + 1) * n)
            S[block, block] += noises[2 * axle + 1].covariance(readings) + 1.0
        ends = np.array([readings[0], readings[-1]])
        free = respond(car(p), ends, np.zeros((2, 2, 4)), readings, np.eye(4)).reshape(2 * n, 4)
        return np.asarray(S + (free * np.array([0.01, 1.0, 0.01, 1.0])) @ free.T)

    root = cholesky(covariance(np.zeros(8)), lower=True)

    def residual(p: Array) -> Array:
        r = y - respond(car(p), fine, motion, readings)[:, :, 0].ravel()
        return np.concatenate([solve_triangular(root, r, lower=True), p])

    return 2.0 * float(least_squares(residual, np.zeros(8), xtol=1e-4, ftol=1e-4).cost)


def test_noncentrality_is_that_of_whole_covariance_matrices() -> None:
    vehicle = declared(baja(), SPEC)
    car = with_terms(baja(), "front", Coulomb(12.0))
    rubbed = quiet(World(car, SPEC), BUMP, ROWS)
    loss = dense(rubbed, vehicle)
    assert loss > 100.0
    assert left_over([rubbed], vehicle)[0] == pytest.approx(loss, rel=0.05)


@pytest.mark.parametrize("terrain", ["bump", "stops", "rough", "rollers"])
def test_a_linear_car_leaves_nothing_but_its_given_values(terrain: str) -> None:
    vehicle = declared(baja(), SPEC)
    drives = [Drive(terrain, 0.7, speed, 3, 0) for speed in (2.8, 3.6)]
    q, z = left_over([quiet(World(baja(), SPEC), how) for how in drives], vehicle)
    assert q - float(z @ z) < 0.3  # what a spline through the samples cannot know
    assert float(z @ z) < 0.05


@pytest.mark.parametrize("off", [0.2, 0.7])
def test_a_given_value_loses_its_deviations_squared(off: float) -> None:
    """A spring that the data tell far better than the vehicle file costs what the file says."""
    vehicle = declared(baja(), SPEC)
    car = with_terms(baja(), "rear", LinearSpring((math.exp(off) - 1.0) * baja().k_r))
    drives = [Drive("rough", 0.8, speed, 3, 0) for speed in (4.5, 5.5)]
    loss = left_over([quiet(World(car, SPEC), how) for how in drives], vehicle)[0]
    # mass, weight fraction and the other spring take a little of it over
    assert 0.85 < loss / (off / 0.05) ** 2 < 1.01


def test_what_a_linear_car_takes_over_leaves_no_gap_on_other_ground() -> None:
    """A spring that is off is bent for; a law that bends is met elsewhere with the wrong car."""
    vehicle = declared(baja(), SPEC)
    stiff = with_terms(baja(), "rear", LinearSpring(0.2 * baja().k_r))
    rubbed = with_terms(baja(), "rear", Coulomb(12.0))
    left = {}
    for name, car in (("stiff", stiff), ("rubbed", rubbed)):
        fit = [quiet(World(car, SPEC), Drive("rough", 0.8, speed, 3, 0)) for speed in (4.5, 5.5)]
        there = [quiet(World(car, SPEC), BUMP)]
        q, z = left_over(fit, vehicle)
        left[name] = q, carried(there, vehicle, z), left_over(there, vehicle)[0]
    bent_for, gap, asked_alone = left["stiff"]
    assert bent_for > 10.0
    assert gap < 1.0
    assert asked_alone > 10.0
    assert left["rubbed"][1] > left["rubbed"][2] > 100.0


@settings(max_examples=60)
@given(
    power=st.floats(1.0, 20.0), factor=st.floats(1e-3, 1e3), target=st.sampled_from([10.0, 4000.0]),
    off=st.floats(0.05, 20.0),
)  # fmt: skip
def test_sizes_are_found_whatever_the_power(
    power: float, factor: float, target: float, off: float
) -> None:
    exact = (target / factor) ** (1.0 / power)
    calls = []

    def loss(size: float) -> float:
        calls.append(size)
        return float(factor * size**power)

    found = scaled(loss, target, off * exact, 50.0 * exact)
    assert found.noncentrality == pytest.approx(target, rel=0.1)
    assert len(calls) <= 14


def test_a_size_that_no_car_has_is_not_passed() -> None:
    found = scaled(lambda size: 3.0 * size**2, 4000.0, 0.1, 2.0)
    assert (found.size, found.noncentrality) == (2.0, 12.0)
