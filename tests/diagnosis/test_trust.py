"""What a name counts for beside something that has none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.diagnosis.misspecification_test import Unexplained
from bayes_asv.diagnosis.results import Diagnosis
from tests.battery.cases import case

CLEAN = Unexplained(score=-3.0, axle="front", p_memory=0.4, swollen=())


def _trust(left: Unexplained | None) -> float:
    vehicle = case("null/bump~baja", 5, 0).vehicle
    return Diagnosis("named", (), (), (), vehicle, 0, left=left).trust


def test_a_name_with_nothing_beside_it_counts_in_full() -> None:
    assert not CLEAN.present
    assert _trust(CLEAN) == _trust(None) == 1.0


def test_a_rival_takes_less_than_what_was_found() -> None:
    rivalled = replace(CLEAN, rival=-1.0)
    assert rivalled.present
    assert not rivalled.found
    assert _trust(rivalled) == pytest.approx(0.9)


@pytest.mark.parametrize(
    "left",
    [
        replace(CLEAN, score=6.0),
        replace(CLEAN, p_memory=1e-4),
        replace(CLEAN, p_decoy=1e-4),
        replace(CLEAN, p_jitter=1e-4),
        replace(CLEAN, p_memory=0.002, p_decoy=0.002, p_jitter=0.3),
        replace(CLEAN, swollen=("front_wheel",)),
        replace(CLEAN, failed=("spring_rate@rear",)),
        replace(CLEAN, p_decoy=1e-4, rival=-1.0),
    ],
)
def test_a_name_beside_what_was_found_may_stand_in_for_it(left: Unexplained) -> None:
    assert left.found
    assert left.present
    assert 0.0 < _trust(left) < 0.5 < _trust(replace(CLEAN, rival=-1.0))


@pytest.mark.parametrize("left", [replace(CLEAN, p_memory=0.002), replace(CLEAN, p_decoy=0.002)])
def test_a_single_faint_sign_is_none(left: Unexplained) -> None:
    assert not left.present


def test_faint_signs_are_seldom_found_where_nothing_is() -> None:
    """4000 draws of three p-values, seed 1: one in a thousand each, and all of them together."""
    p = np.random.default_rng(1).random((4000, 3))
    found = sum(replace(CLEAN, p_memory=a, p_decoy=b, p_jitter=c).found for a, b, c in p)
    assert found <= 30
