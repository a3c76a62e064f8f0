"""Misspecification: what is left unexplained, and what named effects are worth beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.diagnosis.engine import Engine, IntervalEstimate
from bayes_asv.diagnosis.misspecification_test import (
    MisspecificationResult,
    best_alternative,
    misspecification_tests,
)
from bayes_asv.diagnosis.model_assessment import assess, fit_pooled
from bayes_asv.diagnosis.residual_tests import Outlier
from bayes_asv.diagnosis.results import NamedEffect
from bayes_asv.diagnosis.thresholds import RELIABILITY_ALONE
from bayes_asv.diagnosis.workflow import DiagnosisResult
from bayes_asv.models.effects import EFFECTS, PlacedEffect
from bayes_asv.posterior.effect_fit import read_effect, with_effects
from tests.battery.cases import case
from tests.diagnosis.models import diagnose_case, prepared

NOTHING = MisspecificationResult(score=-3.0, axle="front", p_whiteness=0.4, excess_noise=())


NAME = NamedEffect(PlacedEffect(EFFECTS["bound_rebound"], "front"), 1.0, (), {})


def _beside(unexplained: MisspecificationResult | None) -> DiagnosisResult:
    vehicle = case("null/bump~baja", 5, 0).vehicle
    return DiagnosisResult("named", (), (), (), vehicle, 0, named=(NAME,), unexplained=unexplained)


def _probability(unexplained: MisspecificationResult | None) -> float:
    """Probability of a name that is certain among those in the list."""
    return _beside(unexplained).probability_of(NAME)


def test_no_name_is_certain_since_a_fault_that_is_not_in_the_list_may_imitate_it() -> None:
    assert not NOTHING.present
    assert _probability(NOTHING) == _probability(None) == RELIABILITY_ALONE
    assert _beside(NOTHING).supported == (NAME,)


def test_a_name_that_no_unlisted_fault_replaces_is_more_reliable_beside_one() -> None:
    left = replace(NOTHING, p_unlisted=1e-4)
    far, near = replace(left, alternative=-1e5), replace(left, alternative=-5.0)
    assert _probability(near) < _probability(far) < _probability(NOTHING)
    assert _beside(far).supported == (NAME,)
    assert _beside(near).supported == ()


@pytest.mark.parametrize("behind", [3.0, 1.0, 0.0, -1.0])
def test_odds_against_an_unlisted_fault_lower_the_probability_of_a_name(behind: float) -> None:
    with_alternative = replace(NOTHING, alternative=-behind)
    assert with_alternative.present
    assert not with_alternative.detected
    odds = 1.0 / (1.0 + np.exp(-behind))
    assert _probability(with_alternative) == pytest.approx(RELIABILITY_ALONE * odds)
    assert bool(_beside(with_alternative).supported) == (behind > 0.0)


def test_an_engine_that_both_explanations_have_is_as_probable_beside_either() -> None:
    engine = Engine(
        IntervalEstimate(25.0, 24.0, 26.0), IntervalEstimate(30.0, 25.0, 35.0), (25.0,), 0.97
    )
    vehicle = case("null/bump~baja", 5, 0).vehicle
    better = replace(NOTHING, alternative=20.0)
    beside, detected = (
        DiagnosisResult("named", (), (), (), vehicle, 0, unexplained=one).probability_of(engine)
        for one in (better, replace(better, p_unlisted=1e-4))
    )
    assert beside == pytest.approx(RELIABILITY_ALONE * 0.97)
    assert 0.2 < detected < 0.5


def test_a_name_is_not_lost_to_an_unlisted_fault_that_explains_more() -> None:
    assert 0.05 < _probability(replace(NOTHING, alternative=1e5)) < 0.2


@pytest.mark.parametrize(
    "unexplained",
    [
        replace(NOTHING, score=6.0),
        replace(NOTHING, p_whiteness=1e-4),
        replace(NOTHING, p_unlisted=1e-4),
        replace(NOTHING, p_jitter=1e-4),
        replace(NOTHING, outlier=Outlier(1e-4, "front_wheel", "run.csv", 1.0, 4)),
        replace(NOTHING, missing_bits=("front_wheel",)),
        replace(NOTHING, p_whiteness=0.002, p_unlisted=0.002, p_jitter=0.3),
        replace(NOTHING, excess_noise=("front_wheel",)),
        replace(NOTHING, failed=("spring_rate@rear",)),
        replace(NOTHING, p_unlisted=1e-4, alternative=-1.0),
    ],
)
def test_named_effects_beside_a_detected_fault_are_unreliable(
    unexplained: MisspecificationResult,
) -> None:
    assert unexplained.detected
    assert unexplained.present
    alternative = _probability(replace(NOTHING, alternative=-1.0))
    assert 0.0 < _probability(unexplained) < 0.5 < alternative


@pytest.mark.parametrize(
    "unexplained", [replace(NOTHING, p_whiteness=0.002), replace(NOTHING, p_unlisted=0.002)]
)
def test_a_single_weak_sign_is_not_significant(unexplained: MisspecificationResult) -> None:
    assert not unexplained.present


def test_the_tests_together_keep_their_false_alarm_rate() -> None:
    """4000 draws of three p-values, seed 1: each is tested at 0.001, and their combination."""
    p = np.random.default_rng(1).random((4000, 3))
    detected = sum(
        replace(NOTHING, p_whiteness=a, p_unlisted=b, p_jitter=c).detected for a, b, c in p
    )
    assert detected <= 30


def test_a_displaced_sensor_that_is_named_a_gain_has_an_alternative() -> None:
    """Excess noise covers what the gain leaves; with noise held, it would hide the alternative."""
    _, diagnosis = diagnose_case("sensor_place-400", 69, 1, "test", fitted=1)
    assert [str(e.placed) for e in diagnosis.named] == ["sensor_gain@front_chassis"]
    unexplained = diagnosis.unexplained
    assert unexplained is not None
    assert unexplained.closest_fault == "a sensor at another position (front chassis)"
    assert unexplained.alternative > -3.0
    assert unexplained.present
    assert not unexplained.detected


def test_a_true_gain_has_no_alternative() -> None:
    one = case("sensor_gain-400", 69, 2, "test")
    (true,) = one.truth.effects
    gain = read_effect(f"sensor_gain@{true.where}")
    dataset, model = with_effects(prepared(one.recordings, one.vehicle), (gain,))
    assessed = assess(dataset, model, 0)
    pooled, model, evidence = fit_pooled(assessed, prepared(one.holdout, one.vehicle))
    alternative, _ = best_alternative(pooled, model, 1, assessed.test.effect_count)
    assert -100.0 < alternative < -10.0
    unexplained = misspecification_tests(pooled, evidence, 0)
    assert not replace(unexplained, alternative=alternative).present
