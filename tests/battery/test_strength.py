"""Noncentrality against complete covariance matrices, a prior, and a power law."""

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

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.recording import Recording, accelerations, sample_times
from bayes_asv.domain.vehicle import Vehicle
from benchmarks.calibration.dense import Noise, respond
from tests.battery.cases import declared
from tests.battery.drives import Drive, as_recording, simulate_drive
from tests.battery.strength import find_size, frozen_distance, whitened_distance
from tests.battery.world import World
from tests.rig import Coulomb, LinearSpring, SensorSpec, baja, with_terms

Array = NDArray[np.float64]

# 0.75 s at 200 Hz: the front has gone over the bump, the rear is on it
ROWS = slice(0, 300, 2)
SPEC = SensorSpec()
BUMP = Drive("bump", 0.8, 4.6, 0, 0)


def noise_free(world: World, planned: Drive, rows: slice = slice(None)) -> Recording:
    whole = as_recording(simulate_drive(world, planned, noise_free=True), "")
    return Recording(whole.time[rows], whole.values[:, rows], whole.units, (), "")


def dense(recording: Recording, vehicle: Vehicle) -> float:
    """Least distance by complete covariance matrices, which shares no code with the filter."""
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
        for s in vehicle.sensors_of(CHANNELS)
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


def test_noncentrality_agrees_with_complete_covariance_matrices() -> None:
    vehicle = declared(baja(), SPEC)
    car = with_terms(baja(), "front", Coulomb(12.0))
    with_friction = noise_free(World(car, SPEC), BUMP, ROWS)
    loss = dense(with_friction, vehicle)
    assert loss > 100.0
    assert whitened_distance([with_friction], vehicle)[0] == pytest.approx(loss, rel=0.05)


@pytest.mark.parametrize("terrain", ["bump", "stops", "rough", "rollers"])
def test_a_linear_car_has_no_distance_but_its_given_values(terrain: str) -> None:
    vehicle = declared(baja(), SPEC)
    drives = [Drive(terrain, 0.7, speed, 3, 0) for speed in (2.8, 3.6)]
    q, z = whitened_distance(
        [noise_free(World(baja(), SPEC), planned) for planned in drives], vehicle
    )
    assert q - float(z @ z) < 0.3  # what a spline through the samples cannot know
    assert float(z @ z) < 0.05


@pytest.mark.parametrize("off", [0.2, 0.7])
def test_a_wrong_given_value_costs_its_deviations_squared(off: float) -> None:
    """A spring rate that the data determine far better than the vehicle file does."""
    vehicle = declared(baja(), SPEC)
    car = with_terms(baja(), "rear", LinearSpring((math.exp(off) - 1.0) * baja().k_r))
    drives = [Drive("rough", 0.8, speed, 3, 0) for speed in (4.5, 5.5)]
    loss = whitened_distance(
        [noise_free(World(car, SPEC), planned) for planned in drives], vehicle
    )[0]
    # mass, weight fraction and the other spring take a little of it over
    assert 0.85 < loss / (off / 0.05) ** 2 < 1.01


def test_what_a_given_value_takes_up_is_no_error_over_another_terrain() -> None:
    """A wrong spring rate is taken up; a nonlinear law is met with the wrong car there."""
    vehicle = declared(baja(), SPEC)
    stiff = with_terms(baja(), "rear", LinearSpring(0.2 * baja().k_r))
    with_friction = with_terms(baja(), "rear", Coulomb(12.0))
    distances = {}
    for name, car in (("stiff", stiff), ("rubbed", with_friction)):
        fit = [
            noise_free(World(car, SPEC), Drive("rough", 0.8, speed, 3, 0)) for speed in (4.5, 5.5)
        ]
        other_terrain = [noise_free(World(car, SPEC), BUMP)]
        q, z = whitened_distance(fit, vehicle)
        distances[name] = (
            q,
            frozen_distance(other_terrain, vehicle, z),
            whitened_distance(other_terrain, vehicle)[0],
        )
    taken_up, gap, alone = distances["stiff"]
    assert taken_up > 10.0
    assert gap < 1.0
    assert alone > 10.0
    assert distances["rubbed"][1] > distances["rubbed"][2] > 100.0


@settings(max_examples=60)
@given(
    power=st.floats(1.0, 20.0), factor=st.floats(1e-3, 1e3), target=st.sampled_from([10.0, 4000.0]),
    off=st.floats(0.05, 20.0),
)  # fmt: skip
def test_a_size_is_found_for_any_power_law(
    power: float, factor: float, target: float, off: float
) -> None:
    exact = (target / factor) ** (1.0 / power)
    calls = []

    def loss(size: float) -> float:
        calls.append(size)
        return float(factor * size**power)

    found = find_size(loss, target, off * exact, 50.0 * exact)
    assert found.noncentrality == pytest.approx(target, rel=0.1)
    assert len(calls) <= 14


def test_the_largest_size_is_not_exceeded() -> None:
    found = find_size(lambda size: 3.0 * size**2, 4000.0, 0.1, 2.0)
    assert (found.size, found.noncentrality) == (2.0, 12.0)
