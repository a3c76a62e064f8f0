"""A damper in series with a stiffness whose curve has steep and nearly flat pieces in turn."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from bayes_asv.filters.suspension_forces import (
    _carry_series_damper,
    law_workspace,
    resisting_force_history,
)
from bayes_asv.filters.vector_code import LANES, lanes_last
from bayes_asv.models.effects import EFFECTS
from bayes_asv.models.effects.base import Effect
from tests.filters.test_force_laws import table

C, STIFFNESS = 310.0, 256_000.0
# logarithms of the slopes from knot to knot: soft, stiff, and soft again beyond
COMPRESSION = (1.0, 0.5, 0.5, -1.6, -1.6, 0.75, 0.75, -0.95, -0.95, -0.3, -0.3, 0.1, 0.1, 0.0, 0.0)
EXTENSION = (0.1, 0.1, 0.1, 0.15, 0.15, -0.5, -0.5, -0.45, -0.45, -0.2, -0.2, 0.05, 0.05, 0.0, 0.0)


def damper() -> tuple[Effect, dict[str, float], np.ndarray]:
    """The curve as an effect with its values, and the laws of the damper and of its stiffness."""
    effect = EFFECTS["damper_curve"]
    steps = (*COMPRESSION, *EXTENSION)
    values = {p.name: step for p, step in zip(effect.parameters, steps, strict=True)}
    series = table("damper_hysteresis", {"stiffness": STIFFNESS})
    return effect, values, np.concatenate([table("damper_curve", values), series])


@pytest.mark.parametrize("speed", [0.05, 0.1, 0.2, 0.4])
def test_its_force_is_that_of_a_stiff_solver(speed: float) -> None:
    effect, values, law = damper()
    time = np.arange(0.0, 0.25, 0.0005)

    def rate(t: float) -> float:
        slow, fast = np.sin(2.0 * np.pi * 6.0 * t), np.sin(2.0 * np.pi * 31.0 * t)
        return float(speed * (slow + 0.3 * fast))

    def resists(u: float) -> float:
        assert effect.force is not None
        force = effect.force(values, C, 0.0, np.zeros(1), np.array([u]), np.zeros(1))
        return float(C * u - np.ravel(force)[0])

    def slope(t: float, m: np.ndarray) -> np.ndarray:
        own = brentq(lambda u: resists(u) - float(m[0]), -20.0, 20.0)
        return np.array([STIFFNESS * (rate(t) - own)])

    exact = solve_ivp(slope, (0.0, 0.25), [0.0], "Radau", time, rtol=1e-7, atol=1e-4).y[0]
    step = np.diff(time, prepend=0.0)
    rates = np.array([rate(t) for t in time])
    (found,) = resisting_force_history(law[None], 0, np.array([C]), rates, step)
    assert np.max(np.abs(found - exact)) < 0.02 * np.max(np.abs(exact))


def test_its_force_does_not_depend_on_where_the_search_for_its_rate_begins() -> None:
    """Newton's method alone is thrown to and fro between flat pieces of such a curve."""
    _, _, law = damper()
    rng = np.random.default_rng(1)
    lanes = lanes_last(law[None])[0]
    work, c = law_workspace(1), np.full(LANES, C)
    for _ in range(300):
        force, begin, end = rng.normal(0.0, 1.0, (3, LANES)) * [[60.0], [0.2], [0.2]]
        found = []
        for guess in (np.zeros(LANES), rng.normal(0.0, 0.3, LANES)):
            series, ahead = np.zeros((4, LANES)), np.zeros(LANES)
            series[3] = guess
            _carry_series_damper(
                lanes, 0, c, force, begin, end, begin, 0.0, 0.0, 0.0025, work, series, ahead
            )
            found.append(np.concatenate([series.ravel(), ahead]))
        assert found[1] == pytest.approx(found[0], rel=1e-5, abs=1e-5)


def test_a_curve_that_hardly_rises_leaves_its_force_finite() -> None:
    """Where a force does not rise at all, no rate at the damper belongs to a larger one."""
    effect = EFFECTS["damper_curve"]
    count = len(effect.parameters) // 2
    steps = (*[0.5] * count, *[-8.0] * count)  # to e⁻⁶⁴ of the slope at rest in extension
    values = {p.name: step for p, step in zip(effect.parameters, steps, strict=True)}
    law = np.concatenate(
        [table("damper_curve", values), table("damper_hysteresis", {"stiffness": STIFFNESS})]
    )
    time = np.arange(0.0, 1.0, 0.0025)
    rates = 0.8 * np.sin(2.0 * np.pi * 3.0 * time)
    (force,) = resisting_force_history(
        law[None], 0, np.array([1400.0]), rates, np.diff(time, prepend=0.0)
    )
    assert np.all(np.isfinite(force))
    assert np.max(force) < 0.5 * -np.min(force)
