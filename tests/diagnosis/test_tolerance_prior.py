"""Tolerance prior, and an effect that is no larger than its tolerance (Savage–Dickey ratio)."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.diagnosis.forward_selection import select_effects, start_selection
from bayes_asv.diagnosis.model_assessment import AssessedModel, model_evidence
from bayes_asv.diagnosis.tolerance_prior import (
    TOLERANCE_SCALES,
    ModelEvidence,
    evidence_as_tolerance,
    half_normal_correction,
    tolerance_evidence,
)
from bayes_asv.models.effects import AXLES, EFFECTS, PlacedEffect, Scale
from bayes_asv.posterior.effect_fit import Candidate, fit_with_effect, read_effect
from bayes_asv.posterior.fitted_model import FittedModel, fit_model
from tests.battery.cases import case
from tests.diagnosis.models import assess_case, assess_linear, ignore_progress

_TRUNCATION = math.log(math.erf(3.0 / math.sqrt(2.0)))  # of a tolerance's prior, at three


def test_a_tolerance_that_would_have_to_be_negative_imitates_nothing() -> None:
    """One at its upper bound still imitates: what is left of it is its own."""
    assessed = assess_case("null", 5, 0, "dev")
    test = assessed.test
    tolerances = np.flatnonzero([c.tolerance for c in test.candidates])
    one_sided = np.array([test.candidates[k].one_sided for k in tolerances])
    own = np.diag(test.information)
    gradient = np.zeros_like(own)
    negative, large = tolerances[one_sided][0], tolerances[~one_sided][0]
    gradient[negative], gradient[large] = -30.0 - own[negative], 30.0 * (1.0 + own[large])
    changed = replace(test, gradient=gradient, information=np.diag(own))
    evidence = tolerance_evidence(assessed.model, changed, rough=True)
    assert evidence.scale > 0.0
    rest = changed.sensitivities[tolerances[tolerances != negative]]
    np.testing.assert_array_equal(evidence.sensitivities, evidence.scale * rest)


@cache
def _car() -> AssessedModel:
    return assess_linear(case("sensor_lag-40", 44, 0))


def _with_effect(name: str) -> tuple[PlacedEffect, FittedModel, list[Candidate]]:
    assessed, placed = _car(), read_effect(name)
    every = list(assessed.test.candidates)
    group = [c for c in every if c.placed.key == placed.key]
    return placed, fit_with_effect(assessed.denoised, assessed.model, group), every


def _without_other_tolerances(model: FittedModel, scale: float = 1.0) -> ModelEvidence:
    """Evidence at one scale, by default the full one, though no other effect has a tolerance."""
    log_evidence = model.mode.log_evidence
    log_evidence += half_normal_correction(model, model.mode.z, model.mode.covariance)
    return replace(
        model_evidence(_car().denoised, model),
        by_scale=np.where(scale == TOLERANCE_SCALES, log_evidence, -np.inf),
        scale=scale,
        mode_shift=0.0 * model.mode.z,
        covariance=model.mode.covariance,
    )


def _with_narrow_priors(
    model: FittedModel, placed_effects: list[PlacedEffect], start: float, share: float = 1.0
) -> float:
    """Log evidence of a fit with shares of tolerances for priors in place of the wide ones."""
    scale = model.space.sizes
    assert scale is not None
    narrowed = []
    for placed in placed_effects:
        first = placed.effect.parameters[0]
        size = first.size(scale)
        tolerance = placed.effect.tolerance_values_for(scale)[first.name]
        narrow = replace(first, prior_scale=share * tolerance / size)
        effect = replace(placed.effect, parameters=(narrow, *placed.effect.parameters[1:]))
        narrowed.append(PlacedEffect(effect, placed.where))
    posterior = _car().denoised.posterior(tuple(narrowed))
    z = model.transfer(posterior.space)
    for placed in narrowed:
        first = placed.effect.parameters[0]
        k = posterior.space.names.index(placed.coordinate_name(first))
        z[k] = first.coordinate(start, scale)
    fit = fit_model(posterior, z)
    return fit.mode.log_evidence + half_normal_correction(fit, fit.mode.z, fit.mode.covariance)


def _value(model: FittedModel, placed: PlacedEffect) -> float:
    return model.space.effects(model.mode.z)[placed][placed.effect.parameters[0].name]


@pytest.mark.parametrize(
    "name", ["sensor_drift@rear_chassis", "damper_fade@rear", "coulomb_friction@rear"]
)
def test_the_evidence_as_a_tolerance_is_that_under_a_narrow_prior(name: str) -> None:
    placed, model, known = _with_effect(name)
    expected = _with_narrow_priors(model, [placed], _value(model, placed))
    value = evidence_as_tolerance([placed], model, _without_other_tolerances(model), known)
    truncation = 0.0 if placed.effect.one_sided else _TRUNCATION
    assert value + truncation == pytest.approx(expected, abs=0.15)


@pytest.mark.parametrize("share", TOLERANCE_SCALES[1:-1].tolist())
def test_the_evidence_at_another_scale_is_that_of_smaller_tolerances(share: float) -> None:
    placed, model, known = _with_effect("damper_fade@rear")
    expected = _with_narrow_priors(model, [placed], share * _value(model, placed), share)
    value = evidence_as_tolerance([placed], model, _without_other_tolerances(model, share), known)
    truncation = 0.0 if placed.effect.one_sided else _TRUNCATION
    assert value + truncation == pytest.approx(expected, abs=0.15)


@pytest.mark.parametrize("name", ["damper_fade@both", "coulomb_friction@both"])
def test_at_both_axles_it_is_the_tolerance_of_either(name: str) -> None:
    """These know their own unequally well, and differ: about a nat is left out."""
    placed, model, known = _with_effect(name)
    own = [PlacedEffect(placed.effect, axle) for axle in AXLES]
    expected = _with_narrow_priors(model, own, _value(model, placed))
    value = evidence_as_tolerance([placed], model, _without_other_tolerances(model), known)
    assert value == pytest.approx(expected, abs=1.5)


def test_an_effect_without_a_tolerance_has_no_such_evidence() -> None:
    placed, model, known = _with_effect("bump_stop@front")
    evidence = _without_other_tolerances(model)
    assert evidence_as_tolerance([placed], model, evidence, known) == -math.inf


def test_a_car_without_other_tolerances_has_no_such_evidence() -> None:
    placed, model, known = _with_effect("damper_fade@rear")
    evidence = replace(_without_other_tolerances(model), scale=0.0)
    assert evidence_as_tolerance([placed], model, evidence, known) == -math.inf


def test_a_fit_that_diverged_has_no_evidence() -> None:
    """Its sensitivities are finite numbers that no car has, beside which the prior is lost."""
    assessed = assess_case("null", 5, 0, "dev")
    test = replace(assessed.test, information=1e200 * assessed.test.information)
    assert tolerance_evidence(assessed.model, test).log_evidence == -math.inf
    assert math.isfinite(tolerance_evidence(assessed.model, assessed.test).log_evidence)


@given(value=st.floats(0.1, 3.0), seed=st.integers(0, 100))
def test_the_number_of_tolerances_is_the_ratio_of_the_forces(value: float, seed: int) -> None:
    """At the same deflection and velocity."""
    scale = Scale(1200.0, 16000.0)
    rng = np.random.default_rng(seed)
    deflection, velocity = rng.uniform(0.01, 0.03), rng.uniform(0.1, 0.2)
    for name, key in (("progressive_spring", "kappa"), ("damper_fade", "loss")):
        effect = EFFECTS[name]
        tolerance = {**effect.tolerance_values_for(scale), "curl": 0.0}
        values = {**tolerance, key: value * tolerance[key]}
        assert effect.force is not None
        one, more = (
            float(
                effect.force(v, 1.0, 1.0, np.array(deflection), np.array(velocity), np.array(0.5))
            )
            for v in (tolerance, values)
        )
        assert effect.in_tolerances(values, tolerance) == pytest.approx(more / one, rel=1e-6)


@given(
    velocity=st.floats(0.1, 0.45),
    drop=st.floats(0.2, 50.0),
    knee=st.floats(0.2, 5.0),
)
def test_the_tolerance_of_a_damper_is_two_per_cent_of_its_force(
    velocity: float, drop: float, knee: float
) -> None:
    """At the largest velocity in use."""
    effect = EFFECTS["digressive_damper"]
    assert effect.scaled_to_range is not None
    assert effect.force is not None
    tolerance = effect.scaled_to_range(
        effect.tolerance_values_for(Scale(1200.0, 16000.0)), 0.02, velocity
    )
    values = {"knee": knee, "drop": drop}
    lost = [
        float(effect.force(v, 1.0, 1.0, np.array(0.0), np.array(velocity), np.array(0.0)))
        / velocity
        for v in (tolerance, values)
    ]
    assert lost[0] == pytest.approx(0.02, rel=0.05)
    assert effect.in_tolerances(values, tolerance) == pytest.approx(lost[1] / lost[0])


@given(travel=st.floats(0.005, 0.049))
def test_the_tolerance_of_a_spring_is_one_and_a_half_per_cent(travel: float) -> None:
    """Of its force at the largest travel in use."""
    effect = EFFECTS["progressive_spring"]
    assert effect.scaled_to_range is not None
    assert effect.force is not None
    tolerance = effect.scaled_to_range(
        effect.tolerance_values_for(Scale(1200.0, 16000.0)), travel, 0.2
    )
    force = effect.force(tolerance, 1.0, 1.0, np.array(travel), np.array(0.0), np.array(0.0))
    assert float(force) / -travel == pytest.approx(0.015, rel=0.01)


def test_deviations_within_tolerance_are_not_named() -> None:
    """Dry friction of 1.2 tolerances, fitted in full, gains 22 nats over the first order."""
    assessed = assess_linear(case("clutter", 43, 1, "test"), 0)
    assert assessed.p_value < 0.05
    selection = select_effects(start_selection(assessed), 0, ignore_progress)
    assert selection.effects == ()
    assert selection.p_none > 0.9
