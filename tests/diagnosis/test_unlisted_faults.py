"""Faults outside the list are recognised before listed effects stand in for them."""

from __future__ import annotations

import pytest

from bayes_asv.diagnosis.workflow import diagnose
from tests.battery.cases import case


@pytest.mark.parametrize(
    ("name", "seed", "number", "description"),
    [
        # between the axles
        ("compliant_seat-4000", 58, 0, "a mass on a spring near the middle"),
        # at 187 Hz, above what the car excites, where its frequency does not show
        ("bracket_resonance-400", 66, 1, "a sensor mount that resonates (rear chassis)"),
    ],
)
def test_no_effect_is_named_where_an_unlisted_fault_explains_more(
    name: str, seed: int, number: int, description: str
) -> None:
    one = case(name, seed, number, "test")
    diagnosis = diagnose(one.recordings, one.holdout, one.vehicle, 0)
    assert diagnosis.verdict == "unexplained"
    assert diagnosis.named == ()
    unexplained = diagnosis.unexplained
    assert unexplained is not None
    assert unexplained.closest_fault == unexplained.stopped_by == description
    assert unexplained.failed == ()
    assert diagnosis.unnamed
    cause = diagnosis.unnamed[0]
    assert description.startswith(cause.kind)  # a resonance at the wheel reads nearly the same
    assert diagnosis.errors is not None
    assert (diagnosis.errors["holdout"].closed or 0.0) > 0.8
