"""The filter with a residual autoregression, against dense algebra and against the plain filter."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from bayes_asv.filters import kalman_ar
from bayes_asv.filters.kalman import MISSING, VALUE, Measurements, filter_pass, log_likelihood
from bayes_asv.models.discretization import simulate_linear
from bayes_asv.models.half_car_equations import LinearSystem
from tests.filters.linear_cases import KINDS, Case, linear_case

Array = NDArray[np.float64]


def _value(case: Case, closes: NDArray[np.bool_], ar: Array, root: Array) -> float:
    value = kalman_ar.log_likelihood(case.system, case.noise, case.data, closes, ar, root)
    return float(value[0])


@pytest.mark.parametrize("name", KINDS)
def test_without_lags_it_is_the_plain_filter(name: str) -> None:
    """Two ways to integrate out the initial state and the biases give one number."""
    case = linear_case(name, 2, n=40)
    ny = case.data.kind.shape[1]
    plain = float(log_likelihood(case.system, case.noise, case.data)[0])
    every = np.ones(40, bool)
    white = np.zeros((0, ny, ny)), np.eye(ny)
    assert _value(case, every, *white) == pytest.approx(plain, abs=1e-6)
    kept = kalman_ar.innovations(case.system, case.noise, case.data, every, *white)[0]
    np.testing.assert_array_equal(kept == 0.0, case.data.kind == MISSING)


def _whitened(nu: Array, ar: Array, root: Array) -> Array:
    """Take an autoregression out of a series (N, ny), plainly."""
    out = np.zeros(nu.shape)
    for k in range(len(nu)):
        e = nu[k].copy()
        for j in range(min(len(ar), k)):
            e -= ar[j] @ nu[k - 1 - j]
        out[k] = root @ e
    return out


@pytest.mark.parametrize("name", KINDS)
def test_it_whitens_the_innovations_linearly(name: str) -> None:
    """Dense algebra: whitened innovations are linear in the unknowns, which are normal."""
    n = 40
    case = linear_case(name, 3, n=n, missing=False)
    nx, nu, ny = case.system.A.shape[1], case.inputs.shape[1], case.data.kind.shape[1]
    nd = case.system.N.shape[1]
    rng = np.random.default_rng(3)
    ar = 0.2 * rng.normal(size=(3, ny, ny))
    root = np.tril(0.3 * rng.normal(size=(ny, ny)), -1) + np.diag(rng.uniform(0.8, 1.3, ny))
    start = case.data.initial_covariance
    certain = 1e-24 * np.eye(len(start))

    def innovations_of(readings: Array, driven: Array) -> tuple[Array, float]:
        data = case.data._replace(moments=driven, reading=readings, initial_covariance=certain)
        found = filter_pass(case.system, case.noise, data)
        kept = found.innovations[0]
        return kept, float(found.log_likelihood[0]) + 0.5 * float(np.sum(kept**2))

    nus, log_scale = innovations_of(case.data.reading, case.data.moments)
    w = _whitened(nus, ar, root).ravel()
    A, B, C = (x[0] for x in case.system[:3])
    linear = LinearSystem(A, B, C, np.zeros((ny, nu)))
    design = np.zeros((ny * n, len(start)))
    for a in range(len(start)):
        free = np.zeros((n, ny))
        if a < nx:
            still = np.zeros((n, nu))
            free = simulate_linear(linear, case.time, still, np.eye(nx)[a]) @ C.T
        elif a < nx + nd:
            held = -np.broadcast_to(case.system.N[:, a - nx], (n, nu))
            free = simulate_linear(linear, case.time, held, np.zeros(nx)) @ C.T
        else:
            free[:, a - nx - nd] = 1.0
        nothing = 0.0 * case.data.moments
        design[:, a] = _whitened(innovations_of(free, nothing)[0], ar, root).ravel()
    covariance = np.eye(ny * n) + design @ start @ design.T
    _, log_det = np.linalg.slogdet(covariance)
    expected = log_scale + n * float(np.sum(np.log(np.diag(root))))
    expected -= 0.5 * (log_det + w @ np.linalg.solve(covariance, w))
    every = np.ones(n, bool)
    assert _value(case, every, ar, root) == pytest.approx(expected, rel=1e-7, abs=1e-5)
    kept = kalman_ar.innovations(case.system, case.noise, case.data, every, ar, root)[0]
    best = np.linalg.solve(design.T @ design + np.linalg.inv(start), design.T @ w)
    np.testing.assert_allclose(kept.ravel(), w - design @ best, atol=1e-5)


def test_two_instants_a_row_are_one_group() -> None:
    """Two boards with two clocks: splitting a row by nothing must change nothing."""
    case = linear_case("half", 9, n=12, missing=False)
    ar, root = np.full((2, 2, 2), 0.1), np.array([[1.1, 0.0], [0.2, 0.9]])
    whole = _value(case, np.ones(12, bool), ar, root)
    old = case.data
    step, moments, spread = (
        np.repeat(x, 2, axis=0) for x in (old.step, old.moments, old.process_noise)
    )
    reading, extra = (np.repeat(x, 2, axis=0) for x in (old.reading, old.extra_variance))
    kind = np.repeat(old.kind, 2, axis=0)
    step[1::2] = 0.0  # the second instant of a row comes no later
    kind[0::2, 1] = MISSING
    kind[1::2, 0] = MISSING
    closes = np.ones(24, bool)
    closes[0::2] = False
    data = Measurements(step, moments, spread, kind, reading, extra, case.data.initial_covariance)
    assert _value(case._replace(data=data), closes, ar, root) == pytest.approx(whole, abs=1e-9)


@pytest.mark.parametrize("there", [[1], [0], [0, 2], [1, 2]])
def test_part_of_a_group_counts_by_its_marginal(there: list[int]) -> None:
    """With readings of a group missing the others have their marginal, not conditional, spread."""
    case = linear_case("roll", 5, n=2, missing=False)
    root = np.array([[1.3, 0.0, 0.0], [-0.4, 0.8, 0.0], [0.2, -0.1, 1.1]])
    case.data.kind[:] = MISSING
    case.data.kind[1, there] = VALUE
    case.data.initial_covariance[:] = 1e-24 * np.eye(
        len(case.data.initial_covariance)
    )  # nothing to integrate out
    found = filter_pass(case.system, case.noise, case.data)
    nu = found.innovations[0][1, there]
    ar, every = np.zeros((1, 3, 3)), np.ones(2, bool)
    inverse = np.linalg.inv(root)
    covariance = (inverse @ inverse.T)[np.ix_(there, there)]
    shift = 0.5 * nu @ nu - 0.5 * nu @ np.linalg.solve(covariance, nu)
    shift -= 0.5 * math.log(np.linalg.det(covariance))
    expected = found.log_likelihood[0] + shift
    assert _value(case, every, ar, root) == pytest.approx(expected, abs=1e-9)
