"""What turns out slight when it is fitted in full is a tolerance."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.diagnosis.forward_selection import begun, grow
from bayes_asv.diagnosis.model_search import Model, asked, weighed
from bayes_asv.diagnosis.savage_dickey import as_slight
from bayes_asv.diagnosis.tolerance_prior import AMOUNTS, ModelEvidence, unfolded
from bayes_asv.models.effects import AXLES, EFFECTS, Scale, Site
from bayes_asv.posterior.effect_candidates import Candidate
from bayes_asv.posterior.effect_fit import added, read_site
from bayes_asv.posterior.fitted_model import FittedModel, base, fitted, setting
from bayes_asv.posterior.map_fit import lay_out
from tests.battery.cases import case

_CUT_OFF = math.log(math.erf(3.0 / math.sqrt(2.0)))  # of a tolerance's belief, at three


@cache
def _car() -> Model:
    one = case("sensor_lag-40", 44, 0)
    lines, _, _ = lay_out(one.recordings, one.vehicle)
    where = setting(one.vehicle, lines)
    return asked(where, base(where), 1)


def _with(name: str) -> tuple[Site, FittedModel, list[Candidate]]:
    model, one = _car(), read_site(name)
    group = [c for c in model.found.candidates if c.site.key == one.key]
    return one, added(model.quiet, model.stage, group), list(model.found.candidates)


def _alone(stage: FittedModel) -> ModelEvidence:
    """A stage that is granted nothing else, though there may be much of everything."""
    log_evidence = stage.mode.log_evidence
    log_evidence += unfolded(stage, stage.mode.z, stage.mode.covariance)
    return replace(
        weighed(_car().quiet, stage),
        by_amount=np.where(AMOUNTS == 1.0, log_evidence, -np.inf),
        amount=1.0,
        shift=0.0 * stage.mode.z,
        covariance=stage.mode.covariance,
    )


def _narrow(stage: FittedModel, sites: list[Site], begin: float) -> float:
    """Evidence of a fit with tolerances for priors, nothing of the wide ones left."""
    scale = stage.space.sizes
    assert scale is not None
    narrowed = []
    for one in sites:
        first = one.effect.parameters[0]
        size = first.size(scale)
        narrow = replace(first, wide=one.effect.slightly(scale)[first.name] / size)
        effect = replace(one.effect, parameters=(narrow, *one.effect.parameters[1:]))
        narrowed.append(Site(effect, one.where))
    target = _car().quiet.target(tuple(narrowed))
    z = stage.carried_to(target.space)
    for one in narrowed:
        first = one.effect.parameters[0]
        z[target.space.names.index(one.coordinate_name(first))] = first.coordinate(begin, scale)
    found = fitted(target, z)
    return found.mode.log_evidence + unfolded(found, found.mode.z, found.mode.covariance)


def _value(stage: FittedModel, one: Site) -> float:
    return stage.space.effects(stage.mode.z)[one][one.effect.parameters[0].name]


@pytest.mark.parametrize(
    "name", ["sensor_drift@rear_chassis", "damper_fade@rear", "coulomb_friction@rear"]
)
def test_it_is_the_evidence_under_a_narrower_prior(name: str) -> None:
    one, stage, known = _with(name)
    other = _narrow(stage, [one], _value(stage, one))
    found = as_slight([one], stage, _alone(stage), known)
    cut_off = 0.0 if one.effect.name == "coulomb_friction" else _CUT_OFF
    assert found + cut_off == pytest.approx(other, abs=0.15)


@pytest.mark.parametrize("name", ["damper_fade@both", "coulomb_friction@both"])
def test_on_both_axles_it_is_the_tolerance_of_either(name: str) -> None:
    """Which know their own not equally well, and differ: about as much as a nat is left out."""
    one, stage, known = _with(name)
    own = [Site(one.effect, axle) for axle in AXLES]
    other = _narrow(stage, own, _value(stage, one))
    assert as_slight([one], stage, _alone(stage), known) == pytest.approx(other, abs=1.5)


def test_what_nobody_has_a_little_of_is_never_slight() -> None:
    one, stage, known = _with("bump_stop@front")
    assert as_slight([one], stage, _alone(stage), known) == -math.inf


def test_in_a_car_that_has_nothing_else_nothing_is_slight() -> None:
    one, stage, known = _with("damper_fade@rear")
    assert as_slight([one], stage, replace(_alone(stage), amount=0.0), known) == -math.inf


@given(value=st.floats(0.1, 3.0), seed=st.integers(0, 100))
def test_times_a_little_is_as_much_more_force(value: float, seed: int) -> None:
    """By the laws themselves: at the same deflection and rate."""
    scale = Scale(1200.0, 16000.0)
    rng = np.random.default_rng(seed)
    delta, rate = rng.uniform(0.01, 0.03), rng.uniform(0.1, 0.2)
    for name, key in (("progressive_spring", "kappa"), ("damper_fade", "loss")):
        effect = EFFECTS[name]
        little = {**effect.slightly(scale), "curl": 0.0}
        values = {**little, key: value * little[key]}
        assert effect.force is not None
        one, more = (
            float(effect.force(v, 1.0, 1.0, np.array(delta), np.array(rate), np.array(0.5)))
            for v in (little, values)
        )
        assert effect.tolerances(values, little) == pytest.approx(more / one, rel=1e-6)


@given(
    speed=st.floats(0.1, 0.45),
    sharpness=st.floats(1.3, 3.6),
    knee=st.floats(0.2, 5.0),
)
def test_a_damper_is_straight_within_two_per_cent_of_its_force(
    speed: float, sharpness: float, knee: float
) -> None:
    effect = EFFECTS["digressive_damper"]
    assert effect.straight is not None
    assert effect.force is not None
    little = effect.straight(effect.slightly(Scale(1200.0, 16000.0)), 0.02, speed)
    values = {"knee": knee, "sharpness": sharpness}
    lost = [
        float(effect.force(v, 1.0, 1.0, np.array(0.0), np.array(speed), np.array(0.0))) / speed
        for v in (little, values)
    ]
    assert lost[0] == pytest.approx(0.02, rel=0.05)
    assert effect.tolerances(values, little) == pytest.approx(lost[1] / lost[0])


@given(travel=st.floats(0.005, 0.049))
def test_a_spring_is_straight_within_one_and_a_half_per_cent(travel: float) -> None:
    effect = EFFECTS["progressive_spring"]
    assert effect.straight is not None
    assert effect.force is not None
    little = effect.straight(effect.slightly(Scale(1200.0, 16000.0)), travel, 0.2)
    more = effect.force(little, 1.0, 1.0, np.array(travel), np.array(0.0), np.array(0.0))
    assert float(more) / -travel == pytest.approx(0.015, rel=0.01)


def test_a_little_of_everything_is_not_dry_friction() -> None:
    """Friction of 1.2 tolerances in such a car won by 22 nats, being fitted in full."""
    one = case("clutter", 43, 1, "test")
    lines, _, _ = lay_out(one.recordings, one.vehicle)
    where = setting(one.vehicle, lines)
    model = asked(where, base(where), 0)
    assert model.p < 0.05
    grown = grow(begun(model), 0, lambda share, words: None)
    assert grown.named == ()
    assert grown.none > 0.9
