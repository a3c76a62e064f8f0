"""A clock that is off is named, and no longer missing where it is declared."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bayes_asv.diagnosis.workflow import diagnose
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from benchmarks.clocks import CLOCK, drawn, recorded

OFFSET = 0.008


@pytest.fixture(scope="module")
def late() -> tuple[Vehicle, list[Recording]]:
    """A car whose body is sampled late, on two drives."""
    car, vehicle = drawn(11)
    return vehicle, [
        replace(recorded(car, terrain, 2.0, 400.0, OFFSET, 0.0, 7), source=terrain)
        for terrain in ("bump", "stops")
    ]


def test_an_undeclared_offset_is_named(late: tuple[Vehicle, list[Recording]]) -> None:
    vehicle, runs = late
    found = diagnose(runs[:1], runs[1:], vehicle, 0)
    assert [str(one.placed) for one in found.named] == ["clock_offset@body"]
    assert found.effect_draws is not None
    draws = found.effect_draws["clock_offset@body"]["offset"]
    assert abs(float(draws.mean()) - OFFSET) < 4.0 * float(draws.std()) < 4e-4


def test_a_declared_clock_leaves_nothing_missing(late: tuple[Vehicle, list[Recording]]) -> None:
    vehicle, runs = late
    found = diagnose(runs[:1], runs[1:], replace(vehicle, clocks=(CLOCK,)), 0)
    assert found.verdict == "agreement"
