"""The compiled filter against a linear Kalman filter, dense Gaussians and matrix exponentials."""

import math
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.filters import ukf as unscented
from bayes_asv.filters.cholesky_update import (
    add_parameter_noise,
    measurement_update,
    parameter_variance,
    recentre,
)
from bayes_asv.filters.prediction import TAYLOR
from bayes_asv.filters.simd_batch import (
    fill_lanes,
    propagate,
    set_parameters,
    transition_matrices,
    unscented_moments,
)
from bayes_asv.filters.simd_layout import blocks, lane_rows, shape_of
from bayes_asv.filters.ukf_state import ALL, FilterSettings, State, Steps
from bayes_asv.models.cars import car_model
from bayes_asv.models.half_car_equations import HalfCar, deflection_form
from bayes_asv.tracking.filter import initial_state
from bayes_asv.tracking.filter_model import FilterModel, filter_model
from bayes_asv.tracking.parameters import coordinates
from bayes_asv.tracking.sensor_noise import sensor_model
from tests.filters.half_car_case import CAR, Prepared, kalman_pass, recursion_case
from tests.filters.linear_cases import VEHICLE

Array = NDArray[np.float64]

NEVER = FilterSettings(
    gate=math.inf, prior_readings=1e300, slow_window=500.0, fast_window=32.0,
    fast_threshold=math.inf, fault_threshold=math.inf, fault_duration=math.inf,
    drift_threshold=math.inf, information_gain=math.inf, review_interval=math.inf,
)  # fmt: skip
SCALE = {"c_f": 1.1, "c_r": 1.1, "i": 0.7}


def _model(noise: Array, start: Array) -> FilterModel:
    """`CAR` with exact given values, and sensors and prior variances of its own."""
    half = car_model("half", VEHICLE)
    car = replace(
        half,
        parameters=tuple(
            replace(p, nominal=getattr(CAR, p.name), terms=((p.name, 1.0, SCALE.get(p.name, 0.0)),))
            for p in half.parameters
        ),
    )
    sensors = replace(sensor_model(VEHICLE, car, CHANNELS), noise=np.ones(4))
    model = filter_model(coordinates(car, CHANNELS), sensors)
    return replace(model, arrays=model.arrays._replace(noise=noise, start=np.diag(start)))


def _steps(laid: Prepared) -> Steps:
    h, moments, spread, kind, reading, _, _ = laid
    n = len(h)
    return Steps(
        h, moments, spread, kind, reading, np.zeros(n, bool), np.zeros((n, 2, 2)),
        np.full(n, ALL, np.int8),
    )  # fmt: skip


@given(seed=st.integers(0, 10_000), bounds=st.booleans(), fixed=st.booleans())
def test_with_known_parameters_it_is_the_linear_filter(
    seed: int, bounds: bool, fixed: bool
) -> None:
    _, _, noise, laid = recursion_case(seed, n=40)
    laid[5][:] = 0.0  # the filter knows no variance of single readings
    if bounds:
        rng = np.random.default_rng(seed)
        at = rng.uniform(size=laid[3].shape) < 0.1
        laid[3][at & (laid[3] == 1)] = rng.integers(2, 4)
    linear = kalman_pass(noise, laid)
    expected, kept = linear.log_likelihood[0], linear.innovations[0]
    model = _model(noise, laid[6])
    state = initial_state(model)
    state.D[:] = 0.0
    # noise is as white as it is declared, beyond doubt
    state.statistics[model.at.white_share] = 0.0
    state.statistics[model.at.white_information] = 1e300
    out = np.zeros((40, model.into.width))
    unscented.run(model.sizes, 0, fixed, state, model.arrays, NEVER, _steps(laid), out)
    assert state.statistics[model.at.log_likelihood] == pytest.approx(expected, rel=1e-11, abs=1e-9)
    if not fixed:
        np.testing.assert_allclose(
            out[:, model.into.innovation : model.into.innovation + 2], kept, atol=1e-9
        )


def _random_belief(rng: np.random.Generator, p: int) -> tuple[Array, Array, Array, Array, Array]:
    """μ, D, x, J, Π of the form θ = μ + Dᵀ d, s = x + Jᵀ d + η."""
    D = np.triu(0.3 * rng.normal(size=(p, p)))
    D[range(p), range(p)] = rng.uniform(0.2, 1.0, p)
    root = rng.normal(size=(10, 10))
    Pi = root @ root.T
    return rng.normal(size=p), D, rng.normal(size=10), rng.normal(size=(p, 10)), Pi


def _joint(mu: Array, D: Array, x: Array, J: Array, Pi: Array) -> tuple[Array, Array]:
    """Mean and covariance of (θ, s)."""
    p = len(mu)
    covariance = np.zeros((p + 10, p + 10))
    both = np.hstack([D, J])
    covariance[:] = both.T @ both
    covariance[p:, p:] += Pi
    return np.concatenate([mu, x]), covariance


@given(seed=st.integers(0, 10_000), p=st.integers(1, 7))
def test_a_reading_is_taken_up_as_bayes_says(seed: int, p: int) -> None:
    rng = np.random.default_rng(seed)
    mu, D, x, J, Pi = _random_belief(rng, p)
    mean, covariance = _joint(mu, D, x, J, Pi)
    # y = a θ-part through d, a part through s, and noise
    by_d, by_s, noise, y = rng.normal(size=p), rng.normal(size=10), 0.3, float(rng.normal())
    g = by_d + J @ by_s
    row = np.concatenate([np.linalg.solve(D, by_d), by_s])
    variance = row @ covariance @ row + noise
    gain = covariance @ row / variance
    nu = y - (row @ mean - np.linalg.solve(D, by_d) @ mu)
    wanted_mean = mean + gain * nu
    wanted = covariance - np.outer(gain, gain) * variance
    m, F, weight = np.zeros(p), np.eye(p), np.zeros(p)
    PC = Pi @ by_s
    rest = float(by_s @ PC + noise)
    assert parameter_variance(g, F, weight) + rest == pytest.approx(variance)
    measurement_update(
        10, y, float(by_s @ x), g, PC, rest, x, J, m, F, Pi, weight, np.zeros(p), True
    )
    recentre(10, mu, D, x, J, m, F)
    found_mean, found = _joint(mu, D, x, J, Pi)
    np.testing.assert_allclose(found_mean, wanted_mean, atol=1e-9)
    np.testing.assert_allclose(found, wanted, atol=1e-9)
    np.testing.assert_array_equal(F, np.eye(p))
    assert np.all(np.tril(D, -1) == 0.0)


@given(seed=st.integers(0, 10_000), p=st.integers(1, 7))
def test_a_walk_adds_its_variance_and_nothing_else(seed: int, p: int) -> None:
    rng = np.random.default_rng(seed)
    mu, D, x, J, Pi = _random_belief(rng, p)
    _, covariance = _joint(mu, D, x, J, Pi)
    before = np.sum(np.log(np.diag(D)))
    variance = rng.uniform(size=p) * (rng.uniform(size=p) < 0.7)
    grown = add_parameter_noise(10, D, J, Pi, variance)
    _, found = _joint(mu, D, x, J, Pi)
    wanted = covariance + np.diag(np.append(variance, np.zeros(10)))
    np.testing.assert_allclose(found, wanted, atol=1e-9)
    assert grown == pytest.approx(np.sum(np.log(np.diag(D))) - before, abs=1e-9)


@given(seed=st.integers(0, 10_000))
def test_lanes_carry_sigma_points_exactly(seed: int) -> None:
    rng = np.random.default_rng(seed)
    _, _, noise, laid = recursion_case(seed, n=2, missing=False)
    model = _model(noise, laid[6])
    arrays, sizes, rows, shape = (
        model.arrays, model.sizes, lane_rows(model.sizes), shape_of(model.sizes)
    )  # fmt: skip
    p, distance, h = 3, math.sqrt(3.0), float(laid[0][1])
    mu, D = 0.2 * rng.normal(size=p), np.triu(0.2 * rng.normal(size=(p, p)))
    x, J = 0.1 * rng.normal(size=10), 0.05 * rng.normal(size=(p, 10))
    wanted = []
    for sign, i in [(0, 0), *((s, i) for i in range(p) for s in (1, -1))]:
        theta = mu + sign * distance * D[i]
        state = x + sign * distance * J[i]
        car = arrays.base[:8].copy()
        car[:3] = np.exp(arrays.centre + arrays.scale * theta)
        system = deflection_form(HalfCar(*car))
        after = expm(system.A * h) @ state[:4]
        drive, steady = system.B, -system.B @ state[6:8]
        for j in range(TAYLOR + 1):
            if j < laid[1].shape[2]:
                after = after + drive @ laid[1][1, :, j]
            after = after + steady * h ** (j + 1) / math.factorial(j + 1)
            drive, steady = system.A @ drive, system.A @ steady
        wanted.append(after)
    points = np.array(wanted)
    W = np.zeros(blocks(p, sizes.elements) * rows.size)
    fill_lanes(sizes, rows, W, p, arrays)
    max_rate = set_parameters(
        sizes.elements, rows, shape, W, mu, D, distance, arrays.element, arrays.log, arrays.centre,
        arrays.scale, arrays.place, arrays.term, arrays.coefficient, arrays.factors,
        arrays.constant, arrays.copies, arrays.bars, arrays.uncertain_gains,
    )  # fmt: skip
    inputs = np.zeros((2, TAYLOR + 1))
    propagate(
        sizes, rows, shape, W, p, distance, x, J, arrays.input_bias, h, laid[1][1], inputs,
        max_rate, True,
    )  # fmt: skip
    phi, gamma, Q = (np.zeros(s) for s in ((4, 4), (4, 2), (2, 4, 4)))
    transition_matrices(sizes, rows, W, p, h, phi, gamma, Q)
    even_covariance = np.zeros((4, 4))
    unscented_moments(sizes, rows, W, p, distance, x, J, even_covariance, np.empty((2, 4)))
    even = 0.5 * (points[1::2] + points[2::2]) - points[0]
    np.testing.assert_allclose(J[:, :4], (points[1::2] - points[2::2]) / (2 * distance), atol=1e-11)
    np.testing.assert_allclose(x[:4], points[0] + even.sum(axis=0) / 3.0, atol=1e-11)
    np.testing.assert_allclose(even_covariance, even.T @ even / 3.0, atol=1e-11)
    car = arrays.base[:8].copy()
    car[:3] = np.exp(arrays.centre + arrays.scale * mu)
    np.testing.assert_allclose(phi, expm(deflection_form(HalfCar(*car)).A * h), atol=1e-12)


def test_a_run_in_two_is_the_same_as_a_run_in_one() -> None:
    _, _, noise, laid = recursion_case(5, n=60)
    model = _model(noise, laid[6])
    steps = _steps(laid)
    whole, halves = initial_state(model), initial_state(model)
    out, other = np.zeros((60, model.into.width)), np.zeros((60, model.into.width))
    unscented.run(model.sizes, 0, False, whole, model.arrays, NEVER, steps, out)
    first = Steps(*(cast(Array, part)[:23] for part in steps))  # type: ignore[arg-type]
    unscented.run(model.sizes, 0, False, halves, model.arrays, NEVER, first, other)
    unscented.run(model.sizes, 23, False, halves, model.arrays, NEVER, steps, other)
    np.testing.assert_array_equal(out, other)
    for one, two in zip(whole, halves, strict=True):
        np.testing.assert_array_equal(one, two)


def test_it_comes_back_when_it_has_learnt_enough() -> None:
    _, _, noise, laid = recursion_case(5, n=400, missing=False)
    model = _model(noise, laid[6])
    state: State = initial_state(model)
    out = np.zeros((400, model.into.width))
    settings = NEVER._replace(information_gain=0.5)
    event, at = unscented.run(
        model.sizes, 0, False, state, model.arrays, settings, _steps(laid), out
    )
    assert event == unscented.RELINEARIZE
    assert 0 < at < 400
    volume = np.sum(np.log(np.diag(state.D)))
    assert volume == pytest.approx(-state.statistics[model.at.information_gain], abs=1e-9)
    assert volume < -0.5
