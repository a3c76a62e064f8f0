"""Simulated noise against the filter that takes noise apart, and against a dense covariance."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest

from bayes_asv.filters.kalman import SensorNoise, filter_pass
from bayes_asv.filters.noise_simulation import normals_needed, simulate_noise
from tests.filters.linear_cases import KINDS, Case, dense, linear_case

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def _draws(case: Case, count: int, seed: int) -> Array:
    needed = normals_needed(case.inputs.shape[1], case.data.kind.shape[1])
    normals = np.random.default_rng(seed).standard_normal((len(case.data.step), count, needed))
    return simulate_noise(case.system, case.noise, case.data, normals)


def _at_rest(name: str, seed: int, n: int) -> Case:
    """A recording that starts at rest, without biases and inputs."""
    case = linear_case(name, seed, n=n, missing=False)
    tiny = 1e-18 * np.eye(len(case.data.initial_covariance))
    data = case.data._replace(moments=0.0 * case.data.moments, initial_covariance=tiny)
    return case._replace(data=data, inputs=0.0 * case.inputs)


@pytest.mark.parametrize("name", KINDS)
def test_the_filter_finds_white_noise_of_variance_one_in_it(name: str) -> None:
    """40 records of 200 instants, seed 1: the filter knows nothing of how they were made."""
    case = _at_rest(name, 1, 200)
    made = _draws(case, 40, 2)
    nu = np.stack(
        [
            filter_pass(
                case.system, case.noise, case.data._replace(reading=made[:, k].copy())
            ).innovations[0]
            for k in range(40)
        ]
    )
    count = nu.size
    assert abs(nu.mean()) < 4.0 / np.sqrt(count)
    assert nu.var() == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / count))
    assert kstest(nu.ravel(), "norm").pvalue > 1e-3
    ny = nu.shape[2]
    for lag in range(1, 4):
        for one in range(ny):
            for other in range(ny):
                found = np.mean(nu[:, lag:, one] * nu[:, :-lag, other])
                assert abs(found) < 4.5 / np.sqrt(count / ny)


@pytest.mark.parametrize("name", ["half", "body"])
def test_its_covariance_is_that_of_the_model(name: str) -> None:
    """20 000 records, seed 3, against matrix exponentials (Van Loan 1978)."""
    case = _at_rest(name, 4, 4)
    made = _draws(case, 20_000, 3)[-1]
    _, covariance = dense(case)
    ny = made.shape[1]
    expected = covariance[-ny:, -ny:]
    scale = np.sqrt(np.diag(expected))
    found = np.cov(made.T)
    assert found / np.outer(scale, scale) == pytest.approx(
        expected / np.outer(scale, scale), abs=0.04
    )


def test_without_noise_there_is_none() -> None:
    case = _at_rest("half", 5, 30)
    zero = 0.0 * case.noise.white
    data = case.data._replace(
        process_noise=0.0 * case.data.process_noise, extra_variance=0.0 * case.data.extra_variance
    )
    silent = case._replace(noise=SensorNoise(zero, zero, case.noise.poles), data=data)
    assert np.array_equal(_draws(silent, 3, 1), np.zeros((30, 3, 2)))
