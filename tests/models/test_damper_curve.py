"""A free damping curve: it rises, keeps its sides apart, and c is its rate of equal power."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.stats import norm

from bayes_asv.models.effects import EFFECTS, Scale, placed_effect
from bayes_asv.models.effects.damper_curve import KNOTS, slopes

EFFECT = EFFECTS["damper_curve"]
SCALE = Scale(load=1100.0, spring=17000.0)
C = 1500.0


def _values(seed: int) -> dict[str, float]:
    rng = np.random.default_rng(seed)
    return {p.name: float(p.value(rng.normal(), SCALE)) for p in EFFECT.parameters}


def _force(values: dict[str, float], rate: NDArray[np.float64]) -> NDArray[np.float64]:
    assert EFFECT.force is not None
    zero = np.zeros_like(rate)
    return np.asarray(C * rate - EFFECT.force(values, C, 0.0, zero, rate, zero))


@given(seed=st.integers(0, 2**31))
def test_the_force_rises_with_speed_from_nothing_at_rest(seed: int) -> None:
    rate = np.linspace(-1.5, 1.5, 3001)
    force = _force(_values(seed), rate)
    assert np.all(np.diff(force) > 0.0)
    assert abs(force[1500]) < 1e-9


@given(seed=st.integers(0, 2**31))
def test_c_is_the_rate_of_the_linear_damper_of_equal_power(seed: int) -> None:
    values, sd = _values(seed), 0.15

    def power(v: float) -> float:
        return float(_force(values, np.array([v]))[0]) * v * float(norm.pdf(v, scale=sd))

    edges = [*KNOTS, 1.5]
    total = sum(quad(power, a, b)[0] for a, b in zip([-1.5, *KNOTS], edges, strict=True))
    np.testing.assert_allclose(total, C * sd**2, rtol=1e-6)


def test_no_steps_are_a_linear_damper_and_one_side_leaves_the_other() -> None:
    none = dict.fromkeys((p.name for p in EFFECT.parameters), 0.0)
    np.testing.assert_allclose(slopes(none), 1.0)
    ninth = slopes({**none, "compression_9": -1.0})
    assert np.ptp(ninth[KNOTS >= 0.0]) < 1e-12
    # from the ninth knot on the slope has fallen by a factor e
    fallen = KNOTS < -0.095
    assert fallen.sum() == 7
    np.testing.assert_allclose(ninth[fallen] / ninth[-1], np.exp(-1.0))
    np.testing.assert_allclose(ninth[~fallen] / ninth[-1], 1.0)


def test_it_contains_the_bent_forms_at_its_own_place() -> None:
    curve = placed_effect("damper_curve@front")
    assert curve.subsumes(placed_effect("digressive_damper@front"))
    assert curve.subsumes(placed_effect("bound_rebound@both"))
    assert not curve.subsumes(placed_effect("bound_rebound@rear"))
    assert not curve.subsumes(placed_effect("damper_hysteresis@front"))
    assert not placed_effect("digressive_damper@front").subsumes(curve)
