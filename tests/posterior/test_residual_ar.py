"""Noise that is not white: found when it is there, left alone when it is not."""

import numpy as np
import pytest

from bayes_asv.posterior.residual_ar import (
    chance_factor,
    fit_residual_ar,
    long_run_variance,
    portmanteau,
)


def test_white_innovations_stay_white() -> None:
    rng = np.random.default_rng(0)
    orders = [fit_residual_ar(rng.normal(size=(800, 2))).order for _ in range(200)]
    assert np.count_nonzero(orders) <= 2


def test_an_autoregression_is_found_and_whitened() -> None:
    rng = np.random.default_rng(1)
    a = np.array([[[1.2, 0.1], [0.0, 0.8]], [[-0.7, 0.0], [0.2, -0.4]]])
    nu = np.zeros((3000, 2))
    for k in range(2, 3000):
        nu[k] = a[0] @ nu[k - 1] + a[1] @ nu[k - 2] + [1.5, 0.7] * rng.normal(size=2)
    colour = fit_residual_ar(nu)
    assert 2 <= colour.order <= 3
    np.testing.assert_allclose(colour.coefficients[:2], a, atol=0.08)
    np.testing.assert_allclose(1.0 / np.diag(colour.root), [1.5, 0.7], rtol=0.05)


def test_a_tone_is_coloured() -> None:
    rng = np.random.default_rng(2)
    t = np.arange(800) / 400.0
    nu = rng.normal(size=(800, 2)) + np.sin(2 * np.pi * 33.0 * t)[:, None]
    colour = fit_residual_ar(nu)
    assert colour.order >= 2


def test_too_few_innovations_are_left_alone() -> None:
    assert fit_residual_ar(np.ones((10, 2))).order == 0


def test_portmanteau_is_uniform_on_white_noise_and_small_on_coloured() -> None:
    rng = np.random.default_rng(3)
    p = [portmanteau(rng.normal(size=800), 20) for _ in range(400)]
    assert 0.02 < np.mean(np.array(p) < 0.05) < 0.09
    white = rng.normal(size=801)
    assert portmanteau(white[1:] + 0.4 * white[:-1], 20) < 1e-6
    assert portmanteau(np.zeros(50), 20) == 1.0


def test_missing_innovations_do_not_dilute_a_colour() -> None:
    rng = np.random.default_rng(4)
    nu = np.zeros((4000, 2))
    for k in range(1, 4000):
        nu[k] = 0.7 * nu[k - 1] + rng.normal(size=2)
    nu[rng.uniform(size=4000) < 0.15, 0] = np.nan
    colour = fit_residual_ar(nu)
    np.testing.assert_allclose(colour.coefficients[0], 0.7 * np.eye(2), atol=0.06)
    np.testing.assert_allclose(np.diag(colour.root), 1.0, atol=0.06)


@pytest.mark.parametrize("level", [0.05, 0.005])
def test_chance_makes_the_long_run_variance_larger_by_as_much(level: float) -> None:
    rng = np.random.default_rng(1)
    time, use = np.arange(1000) / 400.0, np.ones((1000, 1), bool)
    found = [long_run_variance(rng.normal(size=(1000, 1)), use, time) for _ in range(3000)]
    assert np.quantile(found, 1.0 - level) == pytest.approx(
        chance_factor(use, time, level), rel=0.06
    )
