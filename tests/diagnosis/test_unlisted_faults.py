"""Faults outside the list are recognised before listed effects stand in for them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bayes_asv.diagnosis.forward_selection import select_effects, start_selection
from bayes_asv.diagnosis.unlisted_fault_models import FaultTerm
from bayes_asv.diagnosis.unlisted_faults import UnlistedFaultScores
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


def test_a_fault_of_one_sign_gains_nothing_by_the_other_sign() -> None:
    kinds: list[Any] = [SimpleNamespace(opposite=listed) for listed in ("a listed one", None)]
    terms = tuple(FaultTerm(kind, ()) for kind in kinds for _ in range(2))
    gradient, own = np.array([12.0, -12.0, 12.0, -12.0]), np.array([16.0, 16.0, 36.0, 36.0])
    scores = UnlistedFaultScores(gradient, np.diag(own), np.diag(np.sqrt(own)), terms)
    assert scores.gains == pytest.approx([4.5, 0.0, 2.0, 2.0])
    hidden = scores._replace(sensitivities=1e4 * scores.sensitivities)
    assert not hidden.gains.any()  # the model's own coordinates explain the same


def test_no_effect_is_named_beside_a_resonance_above_what_the_car_excites() -> None:
    """At 187 Hz, where its frequency does not show."""
    assessed = assess_case("bracket_resonance-400", 66, 1, "test")
    selection = select_effects(start_selection(assessed), 0, ignore_progress)
    assert selection.effects == ()
    assert selection.stopped_by == "a sensor mount that resonates (rear chassis)"
