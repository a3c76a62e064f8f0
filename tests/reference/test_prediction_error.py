"""The grey box's minimiser and the tests of what it leaves."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from bayes_asv.reference.prediction_error import minimise
from bayes_asv.reference.residuals import fit_percent, independence, whiteness

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


def test_it_finds_what_was_put_in_without_noise() -> None:
    time = np.linspace(0.0, 3.0, 200)
    model = decay(time)
    base, _ = model(np.log([1.7, 2.4]))  # type: ignore[operator]
    found = minimise(model, base + np.array([0.3, -0.2]), np.log([1.0, 2.0]))  # type: ignore[arg-type]
    assert found.converged
    assert np.exp(found.theta) == pytest.approx([1.7, 2.4], rel=1e-6)
    assert found.beta == pytest.approx([0.3, -0.2], abs=1e-6)


def test_its_deviations_hold_for_correlated_white_noise() -> None:
    """120 data sets, seed 5: errors over claimed deviations have a variance of one."""
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


def test_rows_without_a_reading_do_not_count() -> None:
    time = np.linspace(0.0, 3.0, 200)
    model = decay(time)
    base, _ = model(np.log([1.7, 2.4]))  # type: ignore[operator]
    base[20:60, 1] = np.nan
    found = minimise(model, base, np.log([1.0, 2.0]))  # type: ignore[arg-type]
    assert len(found.residual) == 160
    assert np.exp(found.theta) == pytest.approx([1.7, 2.4], rel=1e-6)


def test_more_unknowns_cost_more() -> None:
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


def test_tests_of_residuals_are_even_under_their_null() -> None:
    """300 records, seed 11: a test at 10 % rejects between 4 and 17 % of them."""
    rng = np.random.default_rng(11)
    white, apart = [], []
    for _ in range(300):
        u = np.convolve(rng.normal(size=820), np.ones(20) / 20.0, "valid")[:800]
        white.append(whiteness(rng.normal(size=800)).p)
        coloured = np.convolve(rng.normal(size=805), [1.0, 0.6, 0.3], "valid")[:800]
        apart.append(independence(coloured, u).p)
    for p in (white, apart):
        assert 0.04 < np.mean(np.array(p) < 0.1) < 0.17


def test_tests_of_residuals_see_colour_and_input() -> None:
    rng = np.random.default_rng(3)
    e, u = rng.normal(size=800), rng.normal(size=800)
    assert whiteness(np.convolve(e, [1.0, 0.4], "same")).p < 1e-6
    assert independence(e + 0.3 * np.roll(u, 4), u).p < 1e-4
    assert independence(e, u).p > 1e-3


def test_fit_percent() -> None:
    y = np.array([1.0, 2.0, 3.0, 4.0])
    assert fit_percent(y, y) == 100.0
    assert fit_percent(y, np.full(4, 2.5)) == 0.0
    assert np.isnan(fit_percent(np.ones(4), y))
