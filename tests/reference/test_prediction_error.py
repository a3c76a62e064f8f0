"""The prediction-error minimiser and its residual tests."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from bayes_asv.reference.prediction_error import (
    fit_percent,
    independence_test,
    minimise,
    whiteness_test,
)

Array = NDArray[np.float64]


def decay(time: Array) -> object:
    """Two outputs exp(−e^θ t) and θ-free, each with an offset of its own."""

    def model(theta: Array) -> tuple[Array, Array]:
        first = np.exp(-np.exp(theta[0]) * time)
        second = np.cos(np.exp(theta[1]) * time)
        design = np.zeros((len(time), 2, 2))
        design[:, 0, 0] = design[:, 1, 1] = 1.0
        return np.stack([first, second], axis=1), design

    return model


def test_it_recovers_the_parameters_without_noise() -> None:
    time = np.linspace(0.0, 3.0, 200)
    model = decay(time)
    base, _ = model(np.log([1.7, 2.4]))  # type: ignore[operator]
    found = minimise(model, base + np.array([0.3, -0.2]), np.log([1.0, 2.0]))  # type: ignore[arg-type]
    assert found.converged
    assert np.exp(found.theta) == pytest.approx([1.7, 2.4], rel=1e-6)
    assert found.beta == pytest.approx([0.3, -0.2], abs=1e-6)


def test_standard_deviations_are_valid_for_correlated_white_noise() -> None:
    """120 data sets, seed 5: standardised errors have a variance of one."""
    rng = np.random.default_rng(5)
    time = np.linspace(0.0, 3.0, 120)
    model = decay(time)
    truth = np.log([1.7, 2.4])
    base, _ = model(truth)  # type: ignore[operator]
    root = np.linalg.cholesky(np.array([[1.0, 0.6], [0.6, 0.5]])) * 0.02
    z = []
    for _ in range(120):
        found = minimise(model, base + rng.normal(size=base.shape) @ root.T, np.log([1.5, 2.2]))  # type: ignore[arg-type]
        assert found.converged
        z.append((found.theta - truth) / np.sqrt(np.diag(found.covariance)[:2]))
    variance = np.mean(np.square(z), axis=0)
    # a variance from 120 draws has a deviation of √(2/120) = 0.13
    assert np.abs(variance - 1.0).max() < 4.0 * 0.13


def test_rows_with_missing_readings_are_ignored() -> None:
    time = np.linspace(0.0, 3.0, 200)
    model = decay(time)
    base, _ = model(np.log([1.7, 2.4]))  # type: ignore[operator]
    base[20:60, 1] = np.nan
    found = minimise(model, base, np.log([1.0, 2.0]))  # type: ignore[arg-type]
    assert len(found.residual) == 160
    assert np.exp(found.theta) == pytest.approx([1.7, 2.4], rel=1e-6)


def test_information_criteria_penalise_unknowns() -> None:
    rng = np.random.default_rng(1)
    time = np.linspace(0.0, 3.0, 200)
    model = decay(time)
    base, _ = model(np.log([1.7, 2.4]))  # type: ignore[operator]
    found = minimise(model, base + 0.01 * rng.normal(size=base.shape), np.log([1.5, 2.2]))  # type: ignore[arg-type]
    assert found.unknowns == 4
    assert found.aic == pytest.approx(8.0 - 2.0 * found.log_likelihood)
    assert found.bic - found.aic == pytest.approx(4.0 * (np.log(200.0) - 2.0))
    # the same likelihood written out
    e, L = found.residual, found.noise
    direct = -0.5 * np.sum(
        2.0 * np.log(2.0 * np.pi)
        + np.log(np.linalg.det(L))
        + np.einsum("nq,qr,nr->n", e, np.linalg.inv(L), e)
    )
    assert found.log_likelihood == pytest.approx(float(direct), rel=1e-9)


def test_residual_tests_have_their_nominal_size() -> None:
    """300 records, seed 11: a test at 10 % rejects between 4 and 17 % of them."""
    rng = np.random.default_rng(11)
    whiteness, independence = [], []
    for _ in range(300):
        u = np.convolve(rng.normal(size=820), np.ones(20) / 20.0, "valid")[:800]
        whiteness.append(whiteness_test(rng.normal(size=800)).p)
        coloured = np.convolve(rng.normal(size=805), [1.0, 0.6, 0.3], "valid")[:800]
        independence.append(independence_test(coloured, u).p)
    for p in (whiteness, independence):
        assert 0.04 < np.mean(np.array(p) < 0.1) < 0.17


def test_residual_tests_detect_correlation_and_input() -> None:
    rng = np.random.default_rng(3)
    e, u = rng.normal(size=800), rng.normal(size=800)
    assert whiteness_test(np.convolve(e, [1.0, 0.4], "same")).p < 1e-6
    assert independence_test(e + 0.3 * np.roll(u, 4), u).p < 1e-4
    assert independence_test(e, u).p > 1e-3


def test_fit_percent() -> None:
    y = np.array([1.0, 2.0, 3.0, 4.0])
    assert fit_percent(y, y) == 100.0
    assert fit_percent(y, np.full(4, 2.5)) == 0.0
    assert np.isnan(fit_percent(np.ones(4), y))
