"""The climb to a mode, where ridges are bent."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.posterior.effect_fit import candidates, fit_with_effect
from bayes_asv.posterior.fisher_scoring import secant_update
from bayes_asv.posterior.fitted_model import fit_linear_car, make_dataset
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.battery.cases import case


def test_a_weight_that_is_wrong_is_reached_along_a_bent_ridge() -> None:
    """The linear car puts a weight share that is 13 % off into five deviations of a spring.

    The way back from there is bent; with damping alone 20 rounds covered a thirtieth of it.
    """
    one = case("weight_distribution-40", 31, 0)
    lines, _, _ = prepare_runs(one.recordings, one.vehicle)
    where = make_dataset(one.vehicle, lines)
    plain = fit_linear_car(where)
    group = [c for c in candidates(plain, one.vehicle) if str(c.placed) == "weight_distribution"]
    stage = fit_with_effect(where, plain, group)
    assert stage.mode.converged
    assert stage.mode.log_posterior > plain.mode.log_posterior + 15.0


@given(seed=st.integers(0, 1000), steeper=st.floats(0.2, 30.0))
def test_a_change_of_slope_is_believed_along_its_step(seed: int, steeper: float) -> None:
    """And the curvature stays one: no step that follows can go downhill."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(5, 5))
    expected = root @ root.T + np.eye(5)
    true = expected + steeper * np.outer(root[0], root[0])
    step = rng.normal(size=5)
    found = secant_update(expected, step, true @ step)
    assert found @ step == pytest.approx(true @ step)
    assert np.linalg.eigvalsh(found)[0] > 0.0


def test_a_slope_that_did_not_fall_teaches_nothing() -> None:
    step = np.array([1.0, 0.0])
    assert np.array_equal(secant_update(np.eye(2), step, -0.5 * step), np.eye(2))
