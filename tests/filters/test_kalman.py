"""The Kalman filter against dense Gaussians, the exact response and quadrature, for every car."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from bayes_asv.filters.free_response import free_response
from bayes_asv.filters.kalman import (
    AT_LEAST,
    AT_MOST,
    LANES,
    MISSING,
    VALUE,
    SensorNoise,
    filter_pass,
    log_likelihood,
)  # fmt: skip
from bayes_asv.filters.prediction import upper_tail
from bayes_asv.models.discretization import simulate_linear
from bayes_asv.models.half_car_equations import LinearSystem
from tests.filters.linear_cases import KINDS, Case, dense, linear_case, straight_moments


def _linear(case: Case) -> LinearSystem:
    A, B, C = (x[0] for x in case.system[:3])
    return LinearSystem(A, B, C, np.zeros((len(C), B.shape[1])))


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_the_likelihood_is_that_of_the_dense_gaussian(name: str, seed: int) -> None:
    case = linear_case(name, seed, n=10)
    means, covariance = dense(case)
    use = (case.data.kind == VALUE).ravel()
    expected = multivariate_normal(
        means.ravel()[use], covariance[np.ix_(use, use)], allow_singular=True
    ).logpdf(case.data.reading.ravel()[use])
    found = filter_pass(case.system, case.noise, case.data)
    # process noise is integrated by two Gauss points: good to 1e-6 here
    assert found.log_likelihood[0] == pytest.approx(expected, rel=1e-6, abs=1e-5)
    nu, logs = (x[0].ravel() for x in (found.innovations, found.log_variances))
    again = -0.5 * np.sum(math.log(2.0 * math.pi) + logs[use] + nu[use] ** 2)
    assert again == pytest.approx(found.log_likelihood[0], rel=1e-9)
    assert not nu[~use].any()


@pytest.mark.parametrize("name", KINDS)
def test_sets_side_by_side_are_those_one_by_one(name: str) -> None:
    case = linear_case(name, 4, n=40, sets=LANES + 14)
    together = log_likelihood(case.system, case.noise, case.data)
    for k in (0, 1, LANES - 1, LANES, LANES + 13):
        one = log_likelihood(case.system.subset([k]), case.noise.subset([k]), case.data)
        assert one[0] == pytest.approx(together[k], rel=1e-10)


@pytest.mark.parametrize("name", KINDS)
def test_known_zeros_are_taken_off_the_readings(name: str) -> None:
    """Each set has zeros of its own: as if its readings had been less by as much."""
    case = linear_case(name, 5, n=40, sets=LANES + 3)
    rng = np.random.default_rng(6)
    biases = rng.normal(size=case.system.biases.shape)
    together = log_likelihood(case.system._replace(biases=biases), case.noise, case.data)
    nu = case.inputs.shape[1]
    for k in (0, LANES, LANES + 2):
        less = case.data._replace(
            moments=straight_moments(case.data.step, case.inputs - biases[k, :nu]),
            reading=case.data.reading - biases[k, nu:],
        )
        one = log_likelihood(case.system.subset([k]), case.noise.subset([k]), less)
        assert one[0] == pytest.approx(together[k], rel=1e-9)


@pytest.mark.parametrize("name", KINDS)
def test_innovations_of_data_from_the_model_are_white_and_normal(name: str) -> None:
    """Without noise in the inputs the model is easy to draw from independently."""
    n = 3000
    rng = np.random.default_rng(7)
    case = linear_case(name, 7, n=n, missing=False)
    nu = case.inputs.shape[1]
    white = case.noise.white.copy()
    white[:, :nu] = 0.0
    noise = SensorNoise(white, 0.0 * white, case.noise.poles)
    states = simulate_linear(_linear(case), case.time, case.inputs)
    made = states @ case.system.C[0].T
    reading = made + rng.normal(size=made.shape) * np.sqrt(white[0, nu:])
    data = case.data._replace(
        process_noise=0.0 * case.data.process_noise,
        extra_variance=0.0 * case.data.extra_variance,
        reading=reading,
    )
    found = filter_pass(case.system, noise, data).innovations[0]
    count = found.size
    assert abs(found.std() - 1.0) < 4.0 / math.sqrt(2 * count)
    lagged = np.mean(found[1:] * found[:-1], axis=0)
    assert np.max(np.abs(lagged)) < 4.0 / math.sqrt(n)


def test_a_bound_is_the_integral_of_the_density_beyond_it() -> None:
    case = linear_case("half", 11, n=6, missing=False)
    kind, reading = case.data.kind, case.data.reading

    def value(what: int, at: float) -> float:
        kind[-1], reading[-1, 0] = (what, MISSING), at
        return float(log_likelihood(case.system, case.noise, case.data)[0])

    # As a function of the last reading the likelihood is a scaled normal density.
    low, middle, high = (value(VALUE, x) for x in (-1.0, 0.0, 1.0))
    variance = -1.0 / (low + high - 2.0 * middle)
    mean, sd = 0.5 * (high - low) * variance, math.sqrt(variance)
    scale = middle - float(norm.logpdf(0.0, mean, sd))
    for rail in (mean - 2.0 * sd, mean, mean + 3.0 * sd):
        beyond, below = norm.logsf(rail, mean, sd), norm.logcdf(rail, mean, sd)
        assert value(AT_LEAST, rail) == pytest.approx(scale + float(beyond), abs=1e-6)
        assert value(AT_MOST, rail) == pytest.approx(scale + float(below), abs=1e-6)


@pytest.mark.parametrize("z", [-30.0, -3.0, 0.0, 2.0, 8.0, 24.9, 25.1, 60.0])
def test_far_tails_keep_their_digits(z: float) -> None:
    log_tail, hazard = upper_tail(z)
    assert log_tail == pytest.approx(float(norm.logsf(z)), rel=1e-9, abs=1e-15)
    assert hazard == pytest.approx(math.exp(norm.logpdf(z) - norm.logsf(z)), rel=1e-6)


@pytest.mark.parametrize("name", KINDS)
def test_the_free_response_is_the_exact_one(name: str) -> None:
    case = linear_case(name, 3, n=60)
    rng = np.random.default_rng(3)
    nx, nd, ny = case.system.A.shape[1], case.system.N.shape[1], case.system.C.shape[1]
    begin = np.concatenate([0.1 * rng.normal(size=nx), np.zeros(nd), rng.normal(size=ny)])
    (output,), (states,) = free_response(case.system.subset([0]), case.data, begin[None])
    expected = simulate_linear(_linear(case), case.time, case.inputs, begin[:nx])
    np.testing.assert_allclose(states, expected, atol=1e-10)
    np.testing.assert_allclose(
        output, expected @ case.system.C[0].T + begin[nx + nd :], rtol=1e-9, atol=1e-8
    )
