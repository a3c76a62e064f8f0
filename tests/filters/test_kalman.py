"""The compiled recursion against a dense Gaussian, a readable filter and quadrature."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.stats import multivariate_normal, norm

from bayes_asv.filters import kalman as kernel
from bayes_asv.filters.free_response import free_run
from bayes_asv.filters.tails import upper_tail
from bayes_asv.models.discretization import simulate_linear
from bayes_asv.models.half_car import HalfCar, deflection_form

Array = NDArray[np.float64]
LaidOut = tuple[Array, Array, Array, NDArray[np.int8], Array, Array, Array]

CAR = HalfCar(1261.0, 1751.0, 70.7, 226.6, 1.727, 0.47, 17513.0, 17513.0)


def recursion_case(
    seed: int, n: int = 25, missing: bool = True
) -> tuple[Array, Array, Array, LaidOut]:
    """A small recording: uneven steps, missing readings, straight wheel accelerations."""
    rng = np.random.default_rng(seed)
    step = np.append(0.0, rng.uniform(0.001, 0.005, n - 1))
    time = np.cumsum(step)
    u = 5.0 * rng.normal(size=(n, 2))
    moments = np.zeros((n, 2, kernel.ORDER))
    for k in range(1, n):
        h = step[k]
        for j in range(kernel.ORDER):
            # ∫ (h−s)ʲ/j! (u₀ + (u₁−u₀) s/h) ds
            whole = h ** (j + 1) / math.factorial(j + 1)
            ramp = h ** (j + 1) / math.factorial(j + 2)
            moments[k, :, j] = u[k - 1] * (whole - ramp) + u[k] * ramp
    kind = np.ones((n, 2), np.int8)
    if missing:
        kind[rng.uniform(size=(n, 2)) < 0.2] = kernel.MISSING
    spread = np.stack([step, step, 0.01 * step, 0.02 * step], axis=1)
    reading = 3.0 * rng.normal(size=(n, 2))
    extra = 0.01 * rng.uniform(size=(n, 2))
    start = np.array([0.01, 0.5, 0.02, 0.4, 1.0, 2.0])
    noise = np.array([0.02, 0.03, 0.05, 0.04, 0.01, 0.02, 0.03, 0.02, 314.0, 314.0, 280.0, 300.0])
    return time, u, noise, (step, moments, spread, kind, reading, extra, start)


def _dense(noise: Array, laid: LaidOut, u: Array, time: Array) -> float:
    """log p of all readings at once: mean and covariance built from the model's own words."""
    step, _, spread, kind, reading, extra, start = laid
    system = deflection_form(CAR)
    n = len(step)
    mean_x = simulate_linear(system, time, u)
    # Everything random is linear in independent sources; keep each state's response to them.
    sources = 6 + 4 + n * 8
    response = np.zeros((10, sources))
    response[range(6), range(6)] = np.sqrt(start)
    response[6:, 6:10] = np.diag(np.sqrt(noise[4:8]))
    rows, means, values, extras = [], [], [], []
    at = 10
    for k in range(n):
        h = step[k]
        if h > 0.0:
            Phi = expm(system.A * h)
            big = np.zeros((6, 6))
            big[:4, :4], big[:4, 4:] = system.A, np.eye(4)[:, [1, 3]]
            Gamma = expm(big * h)[:4, 4:]
            moved = response.copy()
            moved[:4] = Phi @ response[:4] + Gamma @ response[6:8]
            decay = np.exp(-noise[8:12] * h)
            moved[6:] = decay[:, None] * response[6:]
            intensity = noise[:2] * spread[k, :2] + spread[k, 2:]
            # ∫ Φ(s) E Φ(s)ᵀ ds by one matrix exponential (Van Loan 1978)
            block = np.zeros((8, 8))
            block[:4, :4], block[4:, 4:] = -system.A, system.A.T
            block[1, 5], block[3, 7] = intensity
            flow = expm(block * h)
            Q = flow[4:, 4:].T @ flow[:4, 4:]
            values_q, vectors = np.linalg.eigh(Q)
            moved[:4, at : at + 4] = vectors * np.sqrt(np.maximum(values_q, 0.0))
            fresh = noise[4:8] * (1.0 - decay**2)
            moved[range(6, 10), range(at + 4, at + 8)] = np.sqrt(fresh)
            response = moved
        at += 8
        for axle in range(2):
            if kind[k, axle] == kernel.VALUE:
                row = np.concatenate([system.C[axle], np.zeros(6)])
                row[4 + axle] = row[8 + axle] = 1.0
                rows.append(row @ response)
                means.append(system.C[axle] @ mean_x[k])
                values.append(reading[k, axle])
                extras.append(noise[2 + axle] + extra[k, axle])
    R = np.array([np.pad(r, (0, sources + 8 - len(r))) for r in rows])
    covariance = R @ R.T + np.diag(extras)
    return float(multivariate_normal.logpdf(values, means, covariance))


@given(seed=st.integers(0, 10_000))
def test_likelihood_is_that_of_the_dense_gaussian(seed: int) -> None:
    time, u, noise, laid = recursion_case(seed, n=8)
    out = np.zeros(1)
    kernel.log_likelihood(np.array([CAR]), noise[None], *laid, out)
    # the kernel integrates the process noise by two Gauss points: good to 1e-6 here
    assert out[0] == pytest.approx(_dense(noise, laid, u, time), rel=1e-6, abs=1e-5)


def test_innovations_of_data_from_the_model_are_white_and_normal() -> None:
    """Without noise in the wheels the model is easy to draw from independently."""
    rng = np.random.default_rng(7)
    time, u, noise, laid = recursion_case(7, n=4000, missing=False)
    noise = noise * 0.0
    noise[2:4], noise[8:] = [0.05, 0.04], 300.0
    laid[2][:] = 0.0
    laid[5][:] = 0.0
    system = deflection_form(CAR)
    states = simulate_linear(system, time, u)
    laid[4][:] = states @ system.C.T + rng.normal(size=(4000, 2)) * np.sqrt(noise[2:4])
    kept = np.zeros((4000, 2))
    value = kernel.residuals(np.array(CAR), noise, *laid, kept)
    assert abs(kept.std() - 1.0) < 4.0 / math.sqrt(2 * 8000)
    lagged = [float(np.mean(kept[1:, a] * kept[:-1, a])) for a in range(2)]
    assert np.max(np.abs(lagged)) < 4.0 / math.sqrt(4000)
    out = np.zeros(1)
    kernel.log_likelihood(np.array([CAR]), noise[None], *laid, out)
    assert value == out[0]


def test_a_bound_is_the_integral_of_the_density_beyond_it() -> None:
    _, _, noise, laid = recursion_case(11, n=6, missing=False)
    kind, reading = laid[3], laid[4]

    def value(what: int, at: float) -> float:
        kind[-1], reading[-1, 0] = (what, kernel.MISSING), at
        out = np.zeros(1)
        kernel.log_likelihood(np.array([CAR]), noise[None], *laid, out)
        return float(out[0])

    # As a function of the last reading the likelihood is a scaled normal density.
    low, middle, high = (value(kernel.VALUE, x) for x in (-1.0, 0.0, 1.0))
    variance = -1.0 / (low + high - 2.0 * middle)
    mean, sd = 0.5 * (high - low) * variance, math.sqrt(variance)
    scale = middle - float(norm.logpdf(0.0, mean, sd))
    for rail in (mean - 2.0 * sd, mean, mean + 3.0 * sd):
        beyond, below = norm.logsf(rail, mean, sd), norm.logcdf(rail, mean, sd)
        assert value(kernel.AT_LEAST, rail) == pytest.approx(scale + float(beyond), abs=1e-7)
        assert value(kernel.AT_MOST, rail) == pytest.approx(scale + float(below), abs=1e-7)


@pytest.mark.parametrize("z", [-30.0, -3.0, 0.0, 2.0, 8.0, 24.9, 25.1, 60.0])
def test_far_tails_keep_their_digits(z: float) -> None:
    log_tail, hazard = upper_tail(z)
    assert log_tail == pytest.approx(float(norm.logsf(z)), rel=1e-9, abs=1e-15)
    assert hazard == pytest.approx(math.exp(norm.logpdf(z) - norm.logsf(z)), rel=1e-6)


@given(seed=st.integers(0, 1000))
def test_free_run_is_the_exact_response(seed: int) -> None:
    time, u, _, laid = recursion_case(seed, n=60)
    rng = np.random.default_rng(seed)
    x0 = 0.1 * rng.normal(size=4)
    system = deflection_form(CAR)
    out = np.empty((60, 4, 2))
    start = np.stack([x0, x0], axis=1)
    free_run(system.A, laid[0], laid[1], start, np.array([1.0, 0.0]), out)
    driven = simulate_linear(system, time, u, x0)
    free = simulate_linear(system, time, 0.0 * u, x0)
    np.testing.assert_allclose(out[:, :, 0], driven, atol=1e-11)
    np.testing.assert_allclose(out[:, :, 1], free, atol=1e-12)
