"""Bounded normal coordinates against quadrature and against drawing them."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import norm

from bayes_asv.diagnosis.truncated_gaussian import bounded

WIDE = np.array([3.0])


@given(pull=st.floats(-40.0, 40.0), own=st.floats(0.0, 30.0), low=st.sampled_from([-3.0, 0.0]))
def test_one_coordinate_is_integrated_as_quadrature_does(
    pull: float, own: float, low: float
) -> None:
    found = bounded(np.array([pull]), np.array([[own]]), np.array([low]), WIDE)
    top = float(found.at[0])

    def density(t: float) -> float:
        return float(np.exp(pull * (t - top) - 0.5 * own * (t**2 - top**2)) * norm.pdf(t))

    near = sorted({min(max(top + by, low), 3.0) for by in (-1.0, -0.1, 0.0, 0.1, 1.0)})
    value, _ = quad(density, low, 3.0, points=near, limit=200)
    expected = np.log(value / (norm.cdf(3.0) - norm.cdf(low))) + pull * top - 0.5 * own * top**2
    assert abs(found.gain - expected) < 1e-6 * (1.0 + abs(expected))


def test_correlated_coordinates_against_draws() -> None:
    """Of 400,000 draws of the prior (seed 5); the bounds' shares are those of the marginals."""
    rng = np.random.default_rng(5)
    draws = rng.standard_normal((400_000, 3))
    draws = draws[np.all(np.abs(draws) < 3.0, axis=1)]
    half = rng.standard_normal((3, 3))
    gram = 0.6 * half @ half.T
    for pull in ([0.0, 0.0, 0.0], [2.0, -1.0, 0.5], [9.0, 1.0, -2.0]):
        logs = draws @ pull - 0.5 * np.einsum("ij,jk,ik->i", draws, gram, draws)
        expected = np.log(np.mean(np.exp(logs - logs.max()))) + logs.max()
        found = bounded(np.array(pull), gram, np.full(3, -3.0), np.full(3, 3.0))
        assert abs(found.gain - expected) < 0.15


def test_what_stands_far_out_is_not_a_little() -> None:
    """Twelve tolerances of something, known to a fifth of one: free they would cost 72 nats."""
    own = np.array([[24.0]])
    found = bounded(np.array([300.0]), own, -WIDE, WIDE)
    assert found.at[0] == 3.0
    free = 0.5 * 300.0**2 / 25.0 - 0.5 * np.log(25.0)
    assert found.gain < free - 900.0


def test_without_data_nothing_is_gained() -> None:
    found = bounded(np.zeros(2), np.zeros((2, 2)), np.array([0.0, -3.0]), np.full(2, 3.0))
    assert abs(found.gain) < 1e-12
    assert np.all(found.at == 0.0)
