"""A free spring curve: it rises, k is its stiffness at rest, and other springs are near to one."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import quad

from bayes_asv.filters.force_laws import excess_many
from bayes_asv.models.effects import EFFECTS, Scale, placed_effect
from bayes_asv.models.effects.piecewise_slope import integral
from bayes_asv.models.effects.spring_curve import KNOTS, slopes

EFFECT = EFFECTS["spring_curve"]
SCALE = Scale(load=1100.0, spring=17000.0)
K = 17000.0
MIDDLE = len(KNOTS) // 2
NONE = {p.name: float(p.value(0.0, SCALE)) for p in EFFECT.parameters}


def _values(seed: int) -> dict[str, float]:
    rng = np.random.default_rng(seed)
    return {p.name: float(p.value(rng.normal(), SCALE)) for p in EFFECT.parameters}


def _force(values: dict[str, float], delta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Force against extension, N."""
    assert EFFECT.force is not None
    zero = np.zeros_like(delta)
    return np.asarray(K * delta - EFFECT.force(values, 0.0, K, delta, zero, zero))


def _through(slope_at_knots: NDArray[np.float64]) -> dict[str, float]:
    """Values of the curve with given relative slopes at the knots."""
    logs = np.log(slope_at_knots / slope_at_knots[MIDDLE])
    return {
        **{f"extension_{k + 1}": logs[MIDDLE + k + 1] - logs[MIDDLE + k] for k in range(MIDDLE)},
        **{f"compression_{k + 1}": logs[MIDDLE - k - 1] - logs[MIDDLE - k] for k in range(MIDDLE)},
    }


@given(seed=st.integers(0, 2**31))
def test_the_force_rises_with_deflection_from_nothing_at_rest(seed: int) -> None:
    delta = np.linspace(-0.2, 0.2, 4001)
    force = _force(_values(seed), delta)
    assert np.all(np.diff(force) > 0.0)
    assert abs(force[2000]) < 1e-9


@given(seed=st.integers(0, 2**31))
def test_k_is_the_slope_at_rest_and_far_outside_the_force_is_linear(seed: int) -> None:
    values, h = _values(seed), 1e-7
    g = slopes(values)
    ends = _force(values, np.array([-h, h, -0.3, -0.2, 0.2, 0.3]))
    assert (ends[1] - ends[0]) / (2 * h) == pytest.approx(K, rel=1e-4)
    assert (ends[3] - ends[2]) / 0.1 == pytest.approx(K * g[0], rel=1e-9)
    assert (ends[5] - ends[4]) / 0.1 == pytest.approx(K * g[-1], rel=1e-9)


@given(seed=st.integers(0, 2**31), x=st.floats(-0.15, 0.15))
def test_the_force_is_the_integral_of_the_slope(seed: int, x: float) -> None:
    values = _values(seed)
    g = slopes(values)
    inner = [float(k) for k in KNOTS if min(x, 0.0) < k < max(x, 0.0)]
    edges = sorted([0.0, x, *inner])
    total = sum(quad(lambda d: float(np.interp(d, KNOTS, g)), a, b)[0] for a, b in pairwise(edges))
    wanted = K * math.copysign(total, x)
    assert float(_force(values, np.array([x]))[0]) == pytest.approx(wanted, rel=1e-9, abs=1e-9)


@given(seed=st.integers(0, 2**31))
def test_the_compiled_force_and_slope_are_continuous_at_the_knots(seed: int) -> None:
    assert EFFECT.packed is not None
    values, h = _values(seed), 1e-10
    row = np.array([[0.0, EFFECT.code, *EFFECT.packed(values)]])
    zero = np.zeros(len(KNOTS))
    below, above = (
        excess_many(row, 0, 0.0, K, KNOTS + by, zero, zero, 1.0)[:, :2] for by in (-h, h)
    )
    largest = K * float(slopes(values).max())
    np.testing.assert_allclose(below, above, atol=1e-5 * largest, rtol=1e-9)


def test_no_steps_are_a_linear_spring_and_one_side_leaves_the_other() -> None:
    np.testing.assert_allclose(slopes(NONE), 1.0)
    one = slopes({**NONE, "compression_4": 1.0})
    assert np.ptp(one[KNOTS > -0.01]) < 1e-12  # from the fourth knot on, at 11.3 mm, it is stiffer
    np.testing.assert_allclose(one[KNOTS < -0.011], math.e)


@pytest.mark.parametrize("kappa", [20.0, 100.0, 300.0])
def test_a_progressive_spring_is_near_to_a_curve(kappa: float) -> None:
    cubic = EFFECTS["progressive_spring"].force
    assert cubic is not None
    delta = np.linspace(-0.06, 0.06, 121)
    zero = np.zeros_like(delta)
    wanted = K * delta - cubic({"kappa": kappa, "curl": 0.0}, 0.0, K, delta, zero, zero)
    found = _force(_through(1.0 + 3.0 * kappa * KNOTS**2), delta)
    assert np.abs(found - wanted).max() < 0.012 * np.abs(wanted).max()


def test_a_second_spring_is_near_to_a_curve() -> None:
    """Stiffer by a factor 2.5 from 20 mm of compression on."""
    delta = np.linspace(-0.06, 0.03, 181)
    wanted = K * (delta + 1.5 * np.minimum(delta + 0.02, 0.0))
    found = _force(_through(np.where(KNOTS < -0.02, 2.5, 1.0)), delta)
    assert np.abs(found - wanted).max() < 0.06 * np.abs(wanted).max()


def test_the_integral_takes_any_knots() -> None:
    knots, g = np.array([-2.0, 0.0, 1.0]), np.array([3.0, 1.0, 2.0])
    x = np.array([-3.0, -1.0, 0.0, 0.5, 2.0])
    np.testing.assert_allclose(integral(knots, g, x), [-7.0, -1.5, 0.0, 0.625, 3.5])


def test_it_contains_the_parametric_form_at_its_own_place() -> None:
    curve = placed_effect("spring_curve@front")
    assert curve.subsumes(placed_effect("progressive_spring@both"))
    assert not curve.subsumes(placed_effect("progressive_spring@rear"))
    assert not curve.subsumes(placed_effect("bump_stop@front"))
    assert not curve.subsumes(placed_effect("damper_curve@front"))
