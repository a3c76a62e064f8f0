"""Laws of the suspension: the compiled branch against the readable form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayes_asv.filters.force_laws import excess_many, table_of_laws
from bayes_asv.models.effects import EFFECTS, Scale

READABLE = [e for e in EFFECTS.values() if e.force is not None]
SCALE = Scale(load=1100.0, spring=17000.0)
C, K = 1200.0, 17000.0


def table(effect_name: str, values: dict[str, float], axle: int = 0) -> np.ndarray:
    effect = EFFECTS[effect_name]
    assert effect.packed is not None
    packed = effect.packed(values)
    return table_of_laws([[axle, effect.code, *packed]])


@pytest.mark.parametrize("effect", READABLE, ids=lambda e: e.name)
@given(seed=st.integers(0, 2**31))
@settings(max_examples=25, deadline=None)
def test_the_branch_is_the_readable_form(effect, seed: int) -> None:  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(seed)
    values = {p.name: float(p.value(rng.normal() * 0.7, SCALE)) for p in effect.parameters}
    delta, rate = rng.normal(0.0, 0.05, 60), rng.normal(0.0, 0.4, 60)
    time = rng.uniform(0.0, 2.5, 60)
    found = excess_many(table(effect.name, values), 0, C, K, delta, rate, time, 2.5)
    wanted = effect.force(values, C, K, delta, rate, time / 2.5)
    np.testing.assert_allclose(found[:, 0], wanted, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("effect", READABLE, ids=lambda e: e.name)
def test_slopes_are_those_of_the_force(effect) -> None:  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(5)
    values = {p.name: float(p.value(0.5, SCALE)) for p in effect.parameters}
    delta, rate = rng.normal(0.0, 0.05, 40), rng.normal(0.0, 0.4, 40)
    time = np.full(40, 1.0)
    rows = table(effect.name, values)

    def force(d: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.asarray(excess_many(rows, 0, C, K, d, v, time, 2.5)[:, 0])

    found = excess_many(rows, 0, C, K, delta, rate, time, 2.5)
    h = 1e-6
    in_delta = (force(delta + h, rate) - force(delta - h, rate)) / (2 * h)
    in_rate = (force(delta, rate + h) - force(delta, rate - h)) / (2 * h)
    np.testing.assert_allclose(found[:, 1], in_delta, rtol=1e-4, atol=1e-2)
    np.testing.assert_allclose(found[:, 2], in_rate, rtol=1e-4, atol=1e-2)


def test_laws_compose_and_keep_to_their_axle() -> None:
    """A damper that fades does so in bound and in rebound; stops only add."""
    both = np.concatenate(
        [
            table("bound_rebound", {"ratio": 2.0, "rounding": 1e-6}),
            table("damper_fade", {"loss": 0.4, "bend": 0.0}),
        ]
    )
    delta, rate, time = np.zeros(2), np.array([0.3, -0.3]), np.full(2, 1.25)
    found = excess_many(both, 0, C, K, delta, rate, time, 2.5)[:, 0]
    wanted = [-C * 0.3 * (4.0 / 3.0 * 0.8 - 1.0), C * 0.3 * (2.0 / 3.0 * 0.8 - 1.0)]
    assert found == pytest.approx(wanted)
    assert not np.any(excess_many(both, 1, C, K, delta, rate, time, 2.5))


def test_a_push_comes_and_goes() -> None:
    row = table("external_force", {"force": 50.0, "start": 1.0, "duration": 0.5, "rise": 0.1})
    time = np.array([0.9, 1.0, 1.2, 1.5, 1.6])
    zero = np.zeros(5)
    found = excess_many(row, 0, C, K, zero, zero, time, 2.5)[:, 0]
    assert found == pytest.approx([0.0, 25.0, 50.0, 25.0, 0.0])
