"""Validation on held-out recordings: effects that fail there, and errors that grow by chance."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bayes_asv.diagnosis import holdout_validation, model_assessment
from bayes_asv.diagnosis.holdout_validation import failed_effects
from bayes_asv.diagnosis.model_assessment import (
    AssessedModel,
    assess,
    prune,
    remove_effects,
    supported_by_holdout,
)
from bayes_asv.diagnosis.results import NamedEffect
from bayes_asv.diagnosis.simulation_error import (
    ErrorChange,
    SimulationResiduals,
    compare_errors,
    error_increased,
    simulation_residuals,
)
from bayes_asv.models.effects import PlacedEffect, Scale
from bayes_asv.posterior.effect_fit import read_effect, with_effects
from bayes_asv.posterior.fitted_model import Dataset, fit_linear_car
from tests.battery.cases import case
from tests.diagnosis.models import fit_linear, prepared

_WORSE = ErrorChange(1.0, 1.1, 0.5, True)
_BETTER = ErrorChange(1.0, 0.9, 0.5, False)


@cache
def _true() -> tuple[AssessedModel, Dataset]:
    """A damper whose compression and rebound differ, named, and held-out recordings."""
    one = case("bound_rebound-400", 5, 0)
    placed = read_effect(f"bound_rebound@{one.truth.effects[0].where}")
    dataset, model = with_effects(prepared(one.recordings, one.vehicle), (placed,))
    return assess(dataset, model, 1), prepared(one.holdout, one.vehicle)


def _wrong() -> tuple[AssessedModel, Dataset]:
    """The same with an effect three times as large and of the opposite sign."""
    assessed, holdout = _true()
    model = assessed.model
    placed = model.placed_effects[0]
    z = model.mode.z.copy()
    k = model.space.names.index(placed.coordinate_name(placed.effect.parameters[0]))
    z[k] *= -3.0
    return replace(assessed, model=replace(model, mode=replace(model.mode, z=z))), holdout


def _named(placed: PlacedEffect, error: ErrorChange = _WORSE) -> NamedEffect:
    return NamedEffect(placed, 1.0, (), {"fit": error, "holdout": error})


def _pulse() -> NamedEffect:
    return _named(replace(read_effect("external_force@front"), run=0))


@pytest.fixture
def unsupported(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the likelihood of the held-out recordings speak against every effect."""
    monkeypatch.setattr(holdout_validation, "supported_by_holdout", lambda *_: False)


def test_a_true_effect_does_not_fail() -> None:
    assessed, holdout = _true()
    effect = _named(assessed.model.placed_effects[0])
    assert failed_effects(holdout, assessed, [effect], None, 1) == []


@pytest.mark.usefixtures("unsupported")
def test_a_wrong_effect_fails() -> None:
    assessed, holdout = _wrong()
    effect = _named(assessed.model.placed_effects[0])
    assert failed_effects(holdout, assessed, [effect], None, 1) == [effect]


def test_an_effect_of_one_run_is_not_judged_on_others() -> None:
    assessed, holdout = _true()
    assert failed_effects(holdout, assessed, [_pulse()], None, 1) == []
    assert failed_effects(None, assessed, [_named(assessed.model.placed_effects[0])], None, 1) == []


@pytest.mark.usefixtures("unsupported")
def test_effects_that_only_together_increase_the_error_all_fail() -> None:
    """Each alone lowers the error, and all together increase it."""
    assessed, holdout = _true()
    better = _named(assessed.model.placed_effects[0], _BETTER)
    both, pulse = [better, _pulse()], _pulse()
    assert failed_effects(holdout, assessed, both, _WORSE, 1) == both
    assert failed_effects(holdout, assessed, [pulse], _WORSE, 1) == [pulse]
    at_floor = ErrorChange(0.5, 0.505, 0.5, True)
    assert failed_effects(holdout, assessed, both, at_floor, 1) == []


@pytest.mark.usefixtures("unsupported")
def test_the_floor_is_that_of_the_better_model() -> None:
    """The noise of a wrong model covers for it, and would excuse its error."""
    right, holdout = _true()
    wrong, _ = _wrong()
    change = compare_errors(holdout, right.model, wrong.model, 1)
    assert change.floor == simulation_residuals(holdout, right.model, 1).floor
    assert change.floor < simulation_residuals(holdout, wrong.model, 1).floor
    assert compare_errors(holdout, wrong.model, right.model, 1).floor == change.floor
    effect = _named(wrong.model.placed_effects[0], _BETTER)
    assert failed_effects(holdout, wrong, [effect], change, 1) == [effect]


def test_an_effect_that_the_likelihood_supports_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """The error may increase by chance."""
    assessed, holdout = _true()
    effect = _named(assessed.model.placed_effects[0])
    monkeypatch.setattr(holdout_validation, "compare_errors", lambda *_, **__: _WORSE)
    assert failed_effects(holdout, assessed, [effect], _WORSE, 1) == []
    monkeypatch.setattr(holdout_validation, "supported_by_holdout", lambda *_: False)
    assert failed_effects(holdout, assessed, [effect], _WORSE, 1) == [effect]


def test_an_effect_that_fits_noise_fails() -> None:
    """A false alarm without a fault: the error on the held-out recordings grows by a tenth."""
    one = case("null", 72, 75, "test")
    fit, holdout = (prepared(runs, one.vehicle) for runs in (one.recordings, one.holdout))
    dataset, model = with_effects(fit, (read_effect("sensor_bandwidth@rear_wheel"),))
    assessed = assess(dataset, model, 1)
    change = compare_errors(holdout, fit_linear_car(dataset), assessed.model, 1)
    effect = NamedEffect(model.placed_effects[0], 1.0, (), {"holdout": change})
    assert change.after > 1.05 * change.before
    assert not supported_by_holdout(assessed, holdout, [effect])
    assert failed_effects(holdout, assessed, [effect], None, 1) == [effect]


def test_without_any_effect_a_model_is_the_linear_half_car_again() -> None:
    """Wherever the effects had drawn its mode."""
    one = case("null/bump", 5, 0)
    dataset, model = fit_linear(prepared(one.recordings, one.vehicle))
    assessed = assess(dataset, model, 1)
    z = np.full_like(model.mode.z, 9.0)
    away = replace(assessed, model=replace(model, mode=replace(model.mode, z=z)))
    again, kept = remove_effects(away, [], [], 1)
    assert not kept
    np.testing.assert_allclose(again.model.mode.z, model.mode.z, atol=0.05)


def test_an_unchanged_error_seldom_increases_significantly() -> None:
    """600 pairs of white residuals of 2.5 s, seed 4: 2.5 % nominal, up to three deviations more."""
    rng = np.random.default_rng(4)
    time = np.arange(1000) / 400.0
    increased = 0
    for k in range(600):
        one, two = (
            SimulationResiduals((rng.normal(size=(1000, 2)),), (time,), (1.0,)) for _ in range(2)
        )
        increased += error_increased(one, two, k)
    assert 4 <= increased <= 26


def test_a_simulation_that_diverges_is_worse_than_any() -> None:
    zero = SimulationResiduals((np.zeros((400, 2)),), (np.arange(400) / 400.0,), (1.0,))
    diverged = replace(zero, residuals=(np.full((400, 2), np.nan),))
    assert error_increased(zero, diverged, 1)
    assert not error_increased(diverged, diverged, 1)  # no reading there


@pytest.mark.parametrize(
    ("curve", "stiffness", "kept"),
    [
        ("damper_curve@front", 400_000.0, True),  # a lag of 2.5 ms at 1000 N·s/m
        ("damper_curve@front", 20_000_000.0, False),  # 0.05 ms
        ("damper_curve@rear", 20_000_000.0, True),  # not where the law is free
        ("bound_rebound@front", 20_000_000.0, True),
    ],
)
def test_what_makes_up_for_the_knots_of_a_free_law_is_removed(
    monkeypatch: pytest.MonkeyPatch, curve: str, stiffness: float, kept: bool
) -> None:
    """However much evidence it gains."""
    placed = tuple(read_effect(text) for text in (curve, "damper_hysteresis@front"))
    space = SimpleNamespace(
        sizes=Scale(load=1100.0, spring=17_000.0),
        effects=lambda _: {placed[1]: {"stiffness": stiffness}},
    )
    model = SimpleNamespace(placed_effects=placed, space=space, mode=SimpleNamespace(z=0.0))
    assessed: Any = SimpleNamespace(model=model)
    monkeypatch.setattr(model_assessment, "_evidence_for", lambda *_: 100.0)
    monkeypatch.setattr(
        model_assessment,
        "remove_effects",
        lambda one, effects, removed, _: (one, [e for e in effects if e not in removed]),
    )
    named = [NamedEffect(one, 1.0, (), {}) for one in placed]
    _, left = prune(assessed, named, 0)
    assert [e.placed for e in left] == list(placed if kept else placed[:1])
