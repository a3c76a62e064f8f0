"""Records of noise against the recursion that takes noise apart, and against a covariance."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.stats import kstest

from bayes_asv.filters import kalman as innovations
from bayes_asv.filters.noise_simulation import NORMALS, noise_path
from bayes_asv.models.half_car import HalfCar, deflection_form

Array = NDArray[np.float64]

CAR = HalfCar(1261.0, 1751.0, 70.7, 226.6, 1.727, 0.47, 17513.0, 17513.0)
NOISE = np.array([0.02, 0.03, 0.05, 0.04, 0.01, 0.02, 0.03, 0.02, 314.0, 314.0, 280.0, 300.0])


def _steps(n: int, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Uneven steps with an intensity of their own, and extra variance of single readings."""
    step = np.append(0.0, rng.uniform(0.001, 0.005, n - 1))
    spread = np.stack([step, step, 0.01 * step, 0.02 * step], axis=1)
    return step, spread, 0.01 * rng.uniform(size=(n, 2))


def _paths(step: Array, spread: Array, extra: Array, count: int, seed: int) -> Array:
    normals = np.random.default_rng(seed).standard_normal((len(step), count, NORMALS))
    out = np.empty((len(step), count, 2))
    noise_path(np.array(CAR), NOISE, step, spread, extra, normals, out)
    return out


def test_the_recursion_finds_white_noise_of_variance_one_in_it() -> None:
    """40 records of 200 instants, seed 1: the filter knows nothing of how they were made."""
    step, spread, extra = _steps(200, np.random.default_rng(1))
    made = _paths(step, spread, extra, 40, 2)
    nu = np.empty((40, 200, 2))
    for k in range(40):
        innovations.residuals(
            np.array(CAR), NOISE, step, np.zeros((200, 2, innovations.ORDER)), spread,
            np.ones((200, 2), np.int8), np.ascontiguousarray(made[:, k]), extra,
            np.full(6, 1e-18), nu[k],
        )  # fmt: skip
    count = nu.size
    assert abs(nu.mean()) < 4.0 / np.sqrt(count)
    assert nu.var() == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / count))
    assert kstest(nu.ravel(), "norm").pvalue > 1e-3
    for lag in range(1, 4):
        for one in range(2):
            for other in range(2):
                found = np.mean(nu[:, lag:, one] * nu[:, :-lag, other])
                assert abs(found) < 4.0 / np.sqrt(0.5 * count)


def test_variance_after_three_steps_is_that_of_the_model() -> None:
    """20 000 records, seed 3, against matrix exponentials (Van Loan 1978)."""
    step, spread, extra = _steps(4, np.random.default_rng(4))
    made = _paths(step, spread, extra, 20_000, 3)[-1]
    system = deflection_form(CAR)
    # x, the wheels' slow noise, the chassis' slow noise
    P = np.zeros((8, 8))
    P[4:, 4:] = np.diag(NOISE[4:8])
    for h, row in zip(step[1:], spread[1:], strict=True):
        big = np.zeros((6, 6))
        big[:4, :4], big[:4, 4:] = system.A, np.eye(4)[:, [1, 3]]
        F = np.zeros((8, 8))
        F[:4, :4], F[:4, 4:6] = expm(system.A * h), expm(big * h)[:4, 4:]
        F[4:, 4:] = np.diag(decay := np.exp(-NOISE[8:] * h))
        block = np.zeros((8, 8))
        block[:4, :4], block[4:, 4:] = -system.A, system.A.T
        block[[1, 3], [5, 7]] = NOISE[:2] * row[:2] + row[2:]
        flow = expm(block * h)
        Q = np.zeros((8, 8))
        Q[:4, :4] = flow[4:, 4:].T @ flow[:4, 4:]
        Q[4:, 4:] = np.diag(NOISE[4:8] * (1.0 - decay**2))
        P = F @ P @ F.T + Q
    out = np.hstack([system.C, np.zeros((2, 2)), np.eye(2)])
    S = out @ P @ out.T + np.diag(NOISE[2:4] + extra[-1])
    assert np.cov(made.T) == pytest.approx(S, rel=0.06)


def test_without_noise_there_is_none() -> None:
    step, spread, extra = _steps(30, np.random.default_rng(5))
    out = np.full((30, 3, 2), np.nan)
    normals = np.ones((30, 3, NORMALS))
    silent = np.append(np.zeros(8), NOISE[8:])
    noise_path(np.array(CAR), silent, step, 0.0 * spread, 0.0 * extra, normals, out)
    assert np.array_equal(out, np.zeros((30, 3, 2)))
