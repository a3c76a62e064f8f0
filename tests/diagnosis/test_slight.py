"""What turns out slight when it is fitted in full is a tolerance."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.diagnosis.growing import begun, grow
from bayes_asv.diagnosis.model import Model, asked, weighed
from bayes_asv.diagnosis.slight import as_slight
from bayes_asv.diagnosis.tolerance import AMOUNTS
from bayes_asv.inference.adding import added, read_site
from bayes_asv.inference.bestfit import lay_out
from bayes_asv.inference.candidates import Candidate
from bayes_asv.inference.stage import Stage, base, fitted, setting
from bayes_asv.model.effects import EFFECTS, Scale, Site
from tests.battery.cases import case

# half of N(0, 1) up to three, which evidence by Laplace knows as a whole N(0, 1) about one mode
_TRUNCATED = math.log(math.erf(3.0 / math.sqrt(2.0)))


@cache
def _car() -> Model:
    one = case("sensor_lag-40", 44, 0, "dev")
    lines, _, _ = lay_out(one.recordings, one.vehicle)
    where = setting(one.vehicle, lines)
    return asked(where, base(where), 1)


def _with(site: Site) -> tuple[Stage, list[Candidate]]:
    model = _car()
    group = [c for c in model.found.candidates if c.site.key == site.key]
    return added(model.quiet, model.stage, group), list(model.found.candidates)


@pytest.mark.parametrize("name", ["sensor_lag@front_chassis", "damper_fade@rear"])
def test_it_is_the_evidence_under_a_narrower_prior(name: str) -> None:
    """Fitted again with the tolerance for a prior, nothing of the wide one left."""
    site = read_site(name)
    stage, little = _with(site)
    quiet = _car().quiet
    found = weighed(quiet, stage)
    alone = np.where(AMOUNTS == 1.0, stage.mode.log_evidence, -np.inf)  # nothing else granted
    alone_found = replace(found, by_amount=alone, shift=0.0 * found.shift,
                          covariance=stage.mode.covariance)  # fmt: skip
    first = site.effect.parameters[0]
    scale = stage.space.sizes
    assert scale is not None
    narrow = replace(first, wide=site.effect.slightly(scale)[first.name])
    effect = replace(site.effect, parameters=(narrow, *site.effect.parameters[1:]))
    target = quiet.target((Site(effect, site.where),))
    z = stage.mode.z.copy()
    k = stage.space.names.index(site.coordinate_name(first))
    z[k] = narrow.coordinate(float(first.value(z[k], scale)), scale)
    other = fitted(target, z).mode.log_evidence
    assert as_slight(site, stage, alone_found, little) + _TRUNCATED == pytest.approx(other, abs=0.3)


def test_what_nobody_has_a_little_of_is_never_slight() -> None:
    site = read_site("bump_stop@front")
    stage, little = _with(site)
    assert as_slight(site, stage, weighed(_car().quiet, stage), little) == -math.inf


@given(
    name=st.sampled_from([n for n, e in EFFECTS.items() if e.slight is not None]),
    times=st.floats(0.05, 20.0),
)
def test_a_tolerance_is_one_tolerance(name: str, times: float) -> None:
    effect = EFFECTS[name]
    scale = Scale(1200.0, 16000.0)
    little = effect.slightly(scale)[effect.parameters[0].name]
    assert effect.tolerances(np.array(little), little) == pytest.approx(1.0)
    more = effect.tolerances(np.array([little, little * (1.0 + 0.1 * times)]), little)
    further = effect.tolerances(np.array([little, little / (1.0 + 0.1 * times)]), little)
    assert np.diff(more)[0] * np.diff(further)[0] < 0.0


def test_a_knee_twice_as_high_is_a_quarter_as_much() -> None:
    assert EFFECTS["digressive_damper"].tolerances(np.array(5.0), 2.5) == pytest.approx(0.25)


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
