"""Colour by the compiled recursion, against dense algebra and against the recursion without it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from bayes_asv.filters import kalman as innovations
from bayes_asv.filters import kalman_ar as coloured
from bayes_asv.models.discretization import simulate_linear
from bayes_asv.models.half_car import deflection_form
from tests.filters.test_kalman import CAR, LaidOut, recursion_case

Array = NDArray[np.float64]


def _value(noise: Array, laid: LaidOut, closes: NDArray[np.bool_], *colour: Array) -> float:
    out = np.zeros(1)
    coloured.log_likelihood(np.array([CAR]), noise[None], *laid, closes, *colour, out)
    return float(out[0])


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000))
def test_without_colour_it_is_the_plain_recursion(seed: int) -> None:
    """Two ways to integrate out the initial state and the biases give one number."""
    _, _, noise, laid = recursion_case(seed, n=40)
    plain, kept = np.full((40, 2), np.nan), np.full((40, 2), np.nan)
    base = innovations.residuals(np.array(CAR), noise, *laid, plain)
    every = np.ones(40, bool)
    white = (np.zeros((0, 2, 2)), np.eye(2))
    assert _value(noise, laid, every, *white) == pytest.approx(base, abs=1e-7)
    value = coloured.residuals(np.array(CAR), noise, *laid, every, *white, kept)
    assert value == _value(noise, laid, every, *white)
    np.testing.assert_array_equal(np.isnan(kept), laid[3] == innovations.MISSING)


def _whitened(nu: Array, ar: Array, root: Array) -> Array:
    """Take an autoregression out of a series (N, 2), plainly."""
    out = np.zeros(nu.shape)
    for k in range(len(nu)):
        e = nu[k].copy()
        for j in range(min(len(ar), k)):
            e -= ar[j] @ nu[k - 1 - j]
        out[k] = root @ e
    return out


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000))
def test_colour_is_a_linear_whitening_of_the_innovations(seed: int) -> None:
    """Dense algebra: whitened innovations are linear in the six unknowns, which are normal."""
    n = 40
    time, _, noise, laid = recursion_case(seed, n=n, missing=False)
    rng = np.random.default_rng(seed)
    ar = 0.2 * rng.normal(size=(3, 2, 2))
    root = np.array([[1.3, 0.0], [-0.4, 0.8]])
    step, moments, spread, kind, reading, extra, start = laid
    certain = np.full(6, 1e-24)

    def innovations_of(readings: Array, driven: Array) -> tuple[Array, float]:
        kept = np.zeros((n, 2))
        value = innovations.residuals(
            np.array(CAR), noise, step, driven, spread, kind, readings, extra, certain, kept
        )
        return kept, value + 0.5 * float(np.sum(kept**2))

    nu, log_scale = innovations_of(reading, moments)
    w = _whitened(nu, ar, root).ravel()
    system = deflection_form(CAR)
    design = np.zeros((2 * n, 6))
    for a in range(6):
        free = np.zeros((n, 2))
        if a < 4:
            free = simulate_linear(system, time, np.zeros((n, 2)), np.eye(4)[a]) @ system.C.T
        else:
            free[:, a - 4] = 1.0
        design[:, a] = _whitened(innovations_of(free, 0.0 * moments)[0], ar, root).ravel()
    spread_of_w = np.eye(2 * n) + design @ np.diag(start) @ design.T
    _, log_det = np.linalg.slogdet(spread_of_w)
    expected = log_scale + n * math.log(1.3 * 0.8)
    expected -= 0.5 * (log_det + w @ np.linalg.solve(spread_of_w, w))
    value = _value(noise, laid, np.ones(n, bool), ar, root)
    assert value == pytest.approx(expected, rel=1e-8, abs=1e-6)
    kept = np.zeros((n, 2))
    coloured.residuals(np.array(CAR), noise, *laid, np.ones(n, bool), ar, root, kept)
    precision = design.T @ design + np.diag(1.0 / start)
    best = np.linalg.solve(precision, design.T @ w)
    np.testing.assert_allclose(kept.ravel(), w - design @ best, atol=1e-6)


def test_two_instants_a_row_are_one_row_for_the_colour() -> None:
    """Two boards with two clocks: splitting a row by nothing must change nothing."""
    _, _, noise, laid = recursion_case(9, n=12, missing=False)
    colour = np.full((2, 2, 2), 0.1), np.array([[1.1, 0.0], [0.2, 0.9]])
    whole = _value(noise, laid, np.ones(12, bool), *colour)
    step, moments, spread, reading, extra = (
        np.repeat(x, 2, axis=0) for x in (*laid[:3], laid[4], laid[5])
    )
    kind = np.repeat(laid[3], 2, axis=0)
    step[1::2] = 0.0  # the second instant of a row comes no later
    kind[0::2, 1] = innovations.MISSING
    kind[1::2, 0] = innovations.MISSING
    closes = np.ones(24, bool)
    closes[0::2] = False
    split = (step, moments, spread, kind, reading, extra, laid[6])
    assert _value(noise, split, closes, *colour) == pytest.approx(whole, abs=1e-9)


def test_colour_scores_a_lone_reading_by_its_own_deviation() -> None:
    """With one reading of a pair missing the other has its marginal, not conditional, spread."""
    _, _, noise, laid = recursion_case(5, n=2, missing=False)
    root = np.array([[1.3, 0.0], [-0.4, 0.8]])
    laid[3][:] = innovations.MISSING
    laid[3][1, 1] = innovations.VALUE
    laid[6][:] = 1e-24  # nothing to integrate out
    plain, kept = np.zeros((2, 2)), np.zeros((2, 2))
    base = innovations.residuals(np.array(CAR), noise, *laid, plain)
    ar, every = np.zeros((1, 2, 2)), np.ones(2, bool)
    value = coloured.residuals(np.array(CAR), noise, *laid, every, ar, root, kept)
    inverse = np.linalg.inv(root)
    sd = math.sqrt((inverse @ inverse.T)[1, 1])
    assert kept[1, 1] == pytest.approx(plain[1, 1] / sd)
    shift = 0.5 * plain[1, 1] ** 2 - 0.5 * kept[1, 1] ** 2 - math.log(sd)
    assert value == pytest.approx(base + shift)
