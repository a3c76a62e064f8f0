"""Forward selection: effects beside others, and two faults that tolerances explain one by one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.diagnosis import forward_selection
from bayes_asv.diagnosis.forward_selection import (
    Selection,
    reconsider_pulses,
    select_effects,
    start_selection,
)
from bayes_asv.diagnosis.model_assessment import AssessedModel, assess
from bayes_asv.diagnosis.model_comparison import (
    ExtendedModel,
    fit_candidates,
    leading_candidates,
)
from bayes_asv.diagnosis.results import NamedEffect
from bayes_asv.diagnosis.tolerance_prior import ModelEvidence
from bayes_asv.diagnosis.unlisted_faults import UnlistedExplanation
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.posterior.effect_fit import read_effect
from bayes_asv.posterior.fitted_model import Dataset
from tests.battery.cases import case
from tests.battery.vehicles import Fleet
from tests.diagnosis.models import assess_case, diagnose_case, ignore_progress


@cache
def _assess(dataset: _Same, model: _Same, seed: int) -> AssessedModel:
    return assess(dataset.value, model.value, seed)


@cache
def _fit_candidates(
    dataset: _Same, model: _Same, test: _Same, excluded: tuple[str, ...], further: bool
) -> tuple[ExtendedModel, ...]:
    found = fit_candidates(
        dataset.value, model.value, test.value, excluded=excluded, further=further
    )
    return tuple(found)


@dataclass(frozen=True)
class _Same:
    """A value that equals itself only."""

    value: Any

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.value is other.value

    def __hash__(self) -> int:
        return id(self.value)


@pytest.fixture(autouse=True)
def _fitted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Selections of the same recordings begin with the same fits, which are made once."""
    monkeypatch.setattr(
        forward_selection,
        "assess",
        lambda dataset, model, seed: _assess(_Same(dataset), _Same(model), seed),
    )
    monkeypatch.setattr(
        forward_selection,
        "fit_candidates",
        lambda dataset, model, test, on_effect, excluded=(), *, further=False: list(
            _fit_candidates(_Same(dataset), _Same(model), _Same(test), tuple(excluded), further)
        ),
    )


def _selected(name: str, seed: int, number: int, fleet: Fleet) -> Selection:
    assessed = assess_case(name, seed, number, fleet)
    return select_effects(start_selection(assessed), 1, ignore_progress)


def test_a_listed_effect_is_named() -> None:
    selection = _selected("bound_rebound-400", 5, 0, "dev")
    assert [e.placed.effect.name for e in selection.effects] == ["bound_rebound"]
    assert selection.stopped_by == ""


def test_a_force_pulse_is_not_an_unknown_force() -> None:
    selection = _selected("external_force-4000", 5, 0, "dev")
    assert [e.placed.effect.name for e in selection.effects] == ["external_force"]
    assert selection.stopped_by == ""


def test_many_different_pulses_are_an_unknown_force() -> None:
    """A kerb under one wheel, no two moments alike."""
    selection = _selected("one_sided_kerb-4000", 72, 0, "test")
    assert selection.stopped_by == "an unknown force at the rear axle"
    assert selection.effects == ()


def test_a_strong_engine_that_wanders_is_the_only_cause() -> None:
    """What it leaves beside its notch for a third of a run is neither memory nor an effect."""
    one, diagnosis = diagnose_case("engine_vibration-4000", 56, 0, "test", fitted=1)
    (true,) = one.truth.effects
    assert diagnosis.engine is not None
    frequency = diagnosis.engine.frequency.value
    assert frequency == pytest.approx(true.parameters["frequency"], rel=0.03)
    assert diagnosis.named == ()
    assert diagnosis.unexplained is not None
    assert not diagnosis.unexplained.detected


def test_two_large_faults_are_named_where_tolerances_explain_either() -> None:
    true = {f"{e.name}@{e.where}" for e in case("pair-4000", 56, 1, "test").truth.effects}
    selection = _selected("pair-4000", 56, 1, "test")
    assert {str(e.placed) for e in selection.effects} == true
    assert all(e.probability > 0.99 for e in selection.effects)


@pytest.mark.parametrize("placed_effects", [0, 1])
def test_an_effect_on_trial_is_not_named_where_an_unlisted_fault_follows(
    monkeypatch: pytest.MonkeyPatch, placed_effects: int
) -> None:
    """Two dampers of 4000, each of which tolerances explain: the first is on trial."""

    def unlisted(_: Dataset, evidence: ModelEvidence) -> UnlistedExplanation:
        better = len(evidence.model.placed_effects) == placed_effects
        return UnlistedExplanation(np.inf if better else -np.inf, "an unlisted fault")

    monkeypatch.setattr(forward_selection, "best_unlisted_explanation", unlisted)
    selection = _selected("pair-4000", 56, 1, "test")
    assert selection.stopped_by == "an unlisted fault"
    assert all(e.probability < 0.2 for e in selection.effects)


@pytest.mark.parametrize("p_none", [0.02, 0.05, 0.08])
def test_no_effect_is_more_probable_than_that_any_is_present(
    monkeypatch: pytest.MonkeyPatch, p_none: float
) -> None:
    """The first of two is on trial, and tolerances alone remain possible after the second."""
    effects = [read_effect(f"bound_rebound@{axle}") for axle in ("front", "rear")]

    def assessed(_: Any, model: Any, seed: int) -> Any:
        p = 0.0 if len(model.placed_effects) < len(effects) else 1.0
        return SimpleNamespace(p_value=p, model=model, denoised=None, dataset=None)

    def compared(now: Any, *_: Any, further: bool) -> Any:
        placed = tuple(effects[: len(now.model.placed_effects) + 1])
        model = SimpleNamespace(placed_effects=placed)
        best: Any = SimpleNamespace(placed=placed[-1], model=model)
        nothing = p_none if further else 0.9
        return forward_selection._Step([best], np.array([1.0 - nothing]), nothing, 5.0, [], "")

    monkeypatch.setattr(forward_selection, "assess", assessed)
    monkeypatch.setattr(forward_selection, "_compare_next_effects", compared)
    monkeypatch.setattr(
        forward_selection, "indistinguishable_from_best", lambda denoised, base, extended: extended
    )
    start = assessed(None, SimpleNamespace(placed_effects=()), 0)
    selection = select_effects(Selection(start, (), [], 1.0), 0, ignore_progress)
    # odds of 9 : 1 for tolerances, against the first effect with or without the second
    present = 0.1 / p_none / (0.9 + 0.1 / p_none)
    assert [e.placed for e in selection.effects] == effects
    assert selection.p_none == pytest.approx(1.0 - present)
    probabilities = [e.probability for e in selection.effects]
    assert probabilities == pytest.approx([present, present * (1.0 - p_none)])


def test_an_effect_with_values_for_each_axle_is_rescaled_as_one() -> None:
    both = tuple(
        NamedEffect(read_effect(f"digressive_damper@{axle}"), 0.11, (), {})
        for axle in ("front", "rear")
    )
    start = Selection(None, both, [], 0.9)  # type: ignore[arg-type]
    selection = forward_selection._rescaled(start, 9.0, 0.01)
    assert [e.probability for e in selection.effects] == pytest.approx([0.99, 0.99])
    assert selection.p_none == 0.01


@given(before=st.floats(0.5, 0.999), p_none=st.floats(0.0, 1.0))
def test_the_probability_of_tolerances_follows_bayes_rule(before: float, p_none: float) -> None:
    """Three explanations: tolerances alone, the first effect, and the first with a second."""
    tolerances, first = before, 1.0 - before
    both = first * (1.0 - p_none) / max(p_none, 1e-12)
    expected = tolerances / (tolerances + first + both)
    updated = forward_selection._updated_tolerance_probability(before, p_none)
    assert updated == pytest.approx(expected, rel=1e-6)


def test_a_further_effect_is_named_where_it_is_more_probable_than_not() -> None:
    """3.7 nats, 0.69: a pulse beside a droop stop, both of noncentrality 40."""
    one, diagnosis = diagnose_case("pair-40", 69, 8, "test")
    true = {e.name: e.where for e in one.truth.effects}
    assert {e.placed.effect.name: e.placed.where for e in diagnosis.named} == true
    assert diagnosis.named[0].probability > 0.95
    assert 0.5 < diagnosis.named[1].probability < 0.95
    # no single unlisted fault explains both
    assert diagnosis.unexplained is not None
    assert -100.0 < diagnosis.unexplained.alternative < -10.0


def test_excluded_effects_are_not_named() -> None:
    one = case("bound_rebound-400", 5, 0)
    assessed = assess_case("bound_rebound-400", 5, 0, "dev")
    truth = f"bound_rebound@{one.truth.effects[0].where}"
    every = [str(group.candidates[0].placed) for group in leading_candidates(assessed.test)]
    assert truth in every
    other = [str(g.candidates[0].placed) for g in leading_candidates(assessed.test, (truth,))]
    assert other
    assert truth not in other
    start = start_selection(assessed)
    selection = select_effects(start, 1, ignore_progress, (truth,), max_effects=1)
    assert truth not in [str(e.placed) for e in selection.effects]


def test_fewer_candidates_are_fitted_for_a_further_effect() -> None:
    """Those that are fitted for a further effect are fitted for the first one as well."""
    test = assess_case("null", 5, 0, "dev").test
    first, further = (
        {str(g.candidates[0].placed) for g in leading_candidates(test, further=f)}
        for f in (False, True)
    )
    assert further < first


def _named(placed: PlacedEffect) -> NamedEffect:
    return NamedEffect(placed, 1.0, (), {})


def _pulse(run: int) -> NamedEffect:
    return _named(replace(read_effect("external_force@front"), run=run))


def _pulse_then_drift() -> Selection:
    assessed = assess_case("bound_rebound-400", 5, 0, "dev")
    return Selection(
        assessed, (_pulse(1), _named(read_effect("sensor_drift@front_wheel"))), [], 0.0
    )


def test_pulses_that_were_named_last_are_not_reconsidered() -> None:
    selection = _pulse_then_drift()
    last = replace(selection, effects=selection.effects[::-1])
    assert reconsider_pulses(last, 1, ignore_progress) is last
    damper = _named(read_effect("bound_rebound@front"))
    three = replace(last, effects=(damper, *last.effects))
    assert reconsider_pulses(three, 1, ignore_progress) is three
    alone = replace(selection, effects=selection.effects[:1])
    assert reconsider_pulses(alone, 1, ignore_progress) is alone


def test_as_many_effects_as_may_be_named_are_not_reconsidered() -> None:
    placed_effects = [read_effect(w) for w in ("sensor_gain@rear_wheel", "sensor_lag@rear_wheel")]
    effects = (_pulse(0), _pulse(0), *(_named(s) for s in placed_effects))
    full = Selection(None, effects, [], 0.0)  # type: ignore[arg-type]
    assert reconsider_pulses(full, 0, ignore_progress) is full


def _without_pulse(monkeypatch: pytest.MonkeyPatch, selection: Selection) -> None:
    """Replace the removal of the pulse, which would fit the model again."""
    monkeypatch.setattr(
        forward_selection,
        "remove_effects",
        lambda assessed, effects, removed, seed: (assessed, [selection.effects[1]]),
    )
    monkeypatch.setattr(forward_selection, "weighted_posterior", lambda model, evidence: [])


@pytest.mark.parametrize(("behind", "replaced"), [(1.0, True), (-1.0, False)])
def test_a_pulse_is_replaced_by_an_effect_of_more_evidence(
    monkeypatch: pytest.MonkeyPatch, behind: float, replaced: bool
) -> None:
    selection = _pulse_then_drift()
    stop = _named(read_effect("droop_stop@front"))

    def select(start: Selection, *_: object, max_effects: int = 4) -> Selection:
        return replace(start, effects=(selection.effects[1], stop)[:max_effects])

    monkeypatch.setattr(forward_selection, "select_effects", select)
    _without_pulse(monkeypatch, selection)
    evidence = selection.assessed.evidence
    old = replace(evidence, by_scale=evidence.by_scale - behind)
    monkeypatch.setattr(forward_selection, "model_evidence", lambda denoised, model: old)
    monkeypatch.setattr(
        forward_selection, "fit_again", lambda denoised, model, placed_effects: model
    )
    effects = reconsider_pulses(selection, 1, ignore_progress).effects
    assert effects == ((selection.effects[1], stop) if replaced else selection.effects)


def test_a_pulse_that_is_named_first_again_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    selection = _pulse_then_drift()
    limits: list[int] = []

    def select(start: Selection, *_: object, max_effects: int = 4) -> Selection:
        limits.append(max_effects)
        return replace(start, effects=(*start.effects, selection.effects[0]))

    monkeypatch.setattr(forward_selection, "select_effects", select)
    _without_pulse(monkeypatch, selection)
    assert reconsider_pulses(selection, 1, ignore_progress) is selection
    assert limits == [2]
