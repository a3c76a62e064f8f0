"""Effects that the data cannot tell from those of a finished model."""

from __future__ import annotations

from functools import cache

from bayes_asv.diagnosis.forward_selection import similar_candidates, with_indistinguishable
from bayes_asv.diagnosis.model_assessment import AssessedModel, assess
from bayes_asv.diagnosis.results import NamedEffect
from bayes_asv.posterior.effect_fit import read_effect, with_effects
from tests.battery.cases import case
from tests.diagnosis.models import prepared


@cache
def _finished() -> tuple[AssessedModel, tuple[NamedEffect, ...]]:
    """Dampers that differ in compression and rebound, and a drift named at the wrong sensor."""
    one = case("pair-4000", 41, 0)
    assert [e.name for e in one.truth.effects] == ["bound_rebound", "sensor_drift"]
    assert one.truth.effects[1].where == "rear_wheel"
    placed_effects = (read_effect("sensor_drift@rear_chassis"), read_effect("bound_rebound@both"))
    dataset, model = with_effects(prepared(one.recordings, one.vehicle), placed_effects)
    return assess(dataset, model, 1), tuple(
        NamedEffect(placed, 1.0, (), {}) for placed in placed_effects
    )


def test_the_drift_of_a_wheel_is_similar_to_that_of_its_chassis() -> None:
    assessed, named = _finished()
    similar = {str(group[0].placed) for group in similar_candidates(assessed, named[0])}
    assert "sensor_drift@rear_wheel" in similar
    assert "sensor_drift@front_wheel" not in similar
    assert similar_candidates(assessed, named[1]) == []


def test_each_effect_lists_what_is_indistinguishable_from_it() -> None:
    assessed, named = _finished()
    drift, dampers = with_indistinguishable(assessed, named)
    others = [str(other.placed) for other in drift.indistinguishable]
    assert "sensor_drift@rear_wheel" in others
    assert dampers.indistinguishable == ()


def test_a_single_effect_is_not_compared_again() -> None:
    assessed, named = _finished()
    assert with_indistinguishable(assessed, named[:1]) == named[:1]
