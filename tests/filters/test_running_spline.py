"""The running spline against scipy's and against quadrature."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.interpolate import CubicSpline

from bayes_asv.filters.prediction import ORDER
from bayes_asv.filters.running_spline import (
    forward_elimination,
    interpolation_errors,
    spline_coefficients,
    step_moments,
)

Array = NDArray[np.float64]


def _curve(time: Array, value: Array, ahead: int) -> Array:
    n = len(time)
    superdiagonal, right, out = np.zeros(n), np.zeros(n), np.zeros((n, 4))
    starts = np.zeros(n, bool)
    forward_elimination(0, time, value, starts, superdiagonal, right)
    spline_coefficients(0, n - 1, ahead, time, value, starts, superdiagonal, right, out)
    return out


@given(seed=st.integers(0, 10_000))
def test_far_from_its_ends_it_is_the_cubic_spline(seed: int) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.5, 1.5, 60)) / 400.0
    value = rng.normal(size=60)
    found = _curve(time, value, 60)
    spline = CubicSpline(time, value)
    middle = slice(20, 40)
    wanted = np.column_stack(
        [spline(time, n) / math.factorial(n) for n in range(3)] + [np.append(spline.c[0], 0.0)]
    )
    np.testing.assert_allclose(found[middle], wanted[middle], rtol=1e-4, atol=1e-4 * 400.0**2)


@given(seed=st.integers(0, 10_000), ahead=st.integers(2, 8))
def test_a_sample_more_matters_a_quarter_as_much(seed: int, ahead: int) -> None:
    rng = np.random.default_rng(seed)
    time, value = np.arange(80) / 400.0, rng.normal(size=80)
    whole = _curve(time, value, 80)[:60, 1]
    short = _curve(time, value, ahead)[:60, 1]
    # the end's slope is off by a few steps of the data; each sample waited for takes 2 − √3 of it
    steepest = 400.0 * np.max(np.abs(np.diff(value)))
    assert np.max(np.abs(whole - short)) < 12.0 * steepest * (2.0 - np.sqrt(3.0)) ** ahead


def test_it_is_drawn_through_its_samples_and_is_a_parabola_exactly() -> None:
    time = np.cumsum([0.0, 1.0, 0.7, 1.3, 0.9, 1.1, 1.0]) / 100.0
    value = 2.0 - 30.0 * time + 500.0 * time**2
    out = _curve(time, value, 7)
    np.testing.assert_allclose(out[:-1, 0], value[:-1])
    np.testing.assert_allclose(out[:-1, 1], -30.0 + 1000.0 * time[:-1], atol=1e-9)
    np.testing.assert_allclose(out[:-1, 2], 500.0, rtol=1e-9)


def test_what_a_cubic_misses_is_nothing_on_a_cubic() -> None:
    time = np.cumsum([0.0, 1.0, 0.7, 1.3, 0.9, 1.1, 1.0])
    value = time**3 - time
    out = np.full(7, np.nan)
    interpolation_errors(0, 7, time, value, np.zeros(7, bool), out)
    np.testing.assert_allclose(out, 0.0, atol=1e-18)
    value[3] += 2.0
    interpolation_errors(0, 7, time, value, np.zeros(7, bool), out)
    assert out[3] == pytest.approx(4.0)


@given(seed=st.integers(0, 10_000))
def test_moments_are_integrals(seed: int) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.6, 1.4, 12)) / 400.0
    value = rng.normal(size=12)
    curve = _curve(time, value, 12)
    instants = np.sort(rng.uniform(time[1], time[-2], 5))
    moments, spread = np.zeros((5, ORDER)), np.zeros((5, 2))
    known = np.ones(5, bool)
    deviation = rng.uniform(size=12)
    gaps = np.zeros(12, bool)
    step_moments(
        instants,
        float(time[0]),
        time,
        curve,
        deviation,
        gaps,
        moments,
        spread,
        known,
        np.zeros((len(known), 2)),
    )
    assert known.all()

    def signal(t: float) -> float:
        k = min(max(int(np.searchsorted(time, t, side="right")) - 1, 0), 10)
        s = t - time[k]
        return float(curve[k] @ [1.0, s, s**2, s**3])

    left = float(time[0])
    for e, end in enumerate(instants):
        inside = [t for t in time if left < t < end]
        for j in (0, 1, 4):
            whole, _ = quad(
                lambda t, j=j, end=end: (end - t) ** j / math.factorial(j) * signal(t),
                left, end, points=inside or None, epsabs=1e-14,
            )  # fmt: skip
            assert moments[e, j] == pytest.approx(whole, rel=1e-7, abs=1e-14)
        at = int(np.searchsorted(time, 0.5 * (left + end), side="right")) - 1
        assert spread[e, 0] == pytest.approx(time[at + 1] - time[at])
        assert spread[e, 1] == pytest.approx(deviation[at] ** 2 * spread[e, 0])
        left = float(end)


def test_no_curve_where_there_is_a_gap() -> None:
    time, value = np.array([0.0, 0.1, 0.2, 1.0, 1.1, 1.2]), np.arange(6.0)
    curve = _curve(time, value, 6)
    gaps = np.array([False, False, True, False, False, True])
    moments, spread, known = np.zeros((3, ORDER)), np.zeros((3, 2)), np.ones(3, bool)
    step_moments(
        np.array([0.15, 1.05, 1.15]), 0.05, time, curve, np.zeros(6), gaps, moments, spread,
        known, np.zeros((3, 2)),
    )  # fmt: skip
    assert known.tolist() == [True, False, True]
