"""Faults outside the list are recognised before listed effects stand in for them."""

from __future__ import annotations

from bayes_asv.diagnosis.forward_selection import select_effects, start_selection
from tests.diagnosis.models import assess_case, diagnose_case, ignore_progress


def test_no_effect_is_named_where_an_unlisted_fault_explains_more() -> None:
    """A mass on a spring between the axles."""
    description = "a mass on a spring near the middle"
    _, diagnosis = diagnose_case("compliant_seat-4000", 58, 0, "test", fitted=1)
    assert diagnosis.verdict == "unexplained"
    assert diagnosis.named == ()
    unexplained = diagnosis.unexplained
    assert unexplained is not None
    assert unexplained.closest_fault == unexplained.stopped_by == description
    assert unexplained.failed == ()
    assert diagnosis.unnamed
    cause = diagnosis.unnamed[0]
    assert description.startswith(cause.kind)
    assert diagnosis.errors is not None
    assert (diagnosis.errors["holdout"].closed or 0.0) > 0.8


def test_no_effect_is_named_beside_a_resonance_above_what_the_car_excites() -> None:
    """At 187 Hz, where its frequency does not show."""
    assessed = assess_case("bracket_resonance-400", 66, 1, "test")
    selection = select_effects(start_selection(assessed), 0, ignore_progress)
    assert selection.effects == ()
    assert selection.stopped_by == "a sensor mount that resonates (rear chassis)"
