"""Integrals of truncated normal coordinates against quadrature and Monte Carlo."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import norm

from bayes_asv.diagnosis.tolerance_prior import integrate_truncated

WIDE = np.array([3.0])


@given(gradient=st.floats(-40.0, 40.0), own=st.floats(0.0, 30.0), low=st.sampled_from([-3.0, 0.0]))
def test_one_coordinate_agrees_with_quadrature(gradient: float, own: float, low: float) -> None:
    result = integrate_truncated(np.array([gradient]), np.array([[own]]), np.array([low]), WIDE)
    top = float(result.mode[0])

    def density(t: float) -> float:
        return float(np.exp(gradient * (t - top) - 0.5 * own * (t**2 - top**2)) * norm.pdf(t))

    near = sorted({min(max(top + by, low), 3.0) for by in (-1.0, -0.1, 0.0, 0.1, 1.0)})
    value, _ = quad(density, low, 3.0, points=near, limit=200)
    at_top = gradient * top - 0.5 * own * top**2
    expected = np.log(value / (norm.cdf(3.0) - norm.cdf(low))) + at_top
    assert abs(result.log_integral - expected) < 1e-6 * (1.0 + abs(expected))


def test_correlated_coordinates_agree_with_monte_carlo() -> None:
    """400,000 draws of the prior, seed 5."""
    rng = np.random.default_rng(5)
    draws = rng.standard_normal((400_000, 3))
    draws = draws[np.all(np.abs(draws) < 3.0, axis=1)]
    half = rng.standard_normal((3, 3))
    information = 0.6 * half @ half.T
    for gradient in ([0.0, 0.0, 0.0], [2.0, -1.0, 0.5], [9.0, 1.0, -2.0]):
        logs = draws @ gradient - 0.5 * np.einsum("ij,jk,ik->i", draws, information, draws)
        expected = np.log(np.mean(np.exp(logs - logs.max()))) + logs.max()
        bounds = np.full(3, -3.0), np.full(3, 3.0)
        result = integrate_truncated(np.array(gradient), information, *bounds)
        assert abs(result.log_integral - expected) < 0.15


def test_a_coordinate_far_outside_its_bounds_gains_little() -> None:
    """Twelve standard deviations, known to a fifth of one."""
    own = np.array([[24.0]])
    result = integrate_truncated(np.array([300.0]), own, -WIDE, WIDE)
    assert result.mode[0] == 3.0
    unbounded = 0.5 * 300.0**2 / 25.0 - 0.5 * np.log(25.0)
    assert result.log_integral < unbounded - 900.0


def test_without_data_nothing_is_gained() -> None:
    lower, upper = np.array([0.0, -3.0]), np.full(2, 3.0)
    result = integrate_truncated(np.zeros(2), np.zeros((2, 2)), lower, upper)
    assert abs(result.log_integral) < 1e-12
    assert np.all(result.mode == 0.0)
