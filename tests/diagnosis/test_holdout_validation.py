"""Names that fail on what was held out, and names that only came too early."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from bayes_asv.diagnosis import forward_selection as growing
from bayes_asv.diagnosis import holdout_validation as proof
from bayes_asv.diagnosis.forward_selection import Selection, begun, grow, reconsidered
from bayes_asv.diagnosis.holdout_validation import failed
from bayes_asv.diagnosis.model_comparison import leading
from bayes_asv.diagnosis.model_search import Model, asked, upheld
from bayes_asv.diagnosis.results import Named
from bayes_asv.diagnosis.simulation_error import Gap, Left, before_and_after, grew, left_over
from bayes_asv.models.effects import Site
from bayes_asv.posterior.effect_fit import read_site, with_effects
from bayes_asv.posterior.fitted_model import Dataset, base, setting
from bayes_asv.posterior.map_fit import lay_out
from tests.battery.cases import case

_WORSE = Gap(1.0, 1.1, 0.5, True)


@cache
def _model() -> tuple[Model, Dataset]:
    """A car with bound over rebound, which has been named, and what was held out."""
    one = case("bound_rebound-400", 5, 0)
    site = read_site(f"bound_rebound@{one.truth.effects[0].where}")
    lines, _, _ = lay_out(one.recordings, one.vehicle)
    held, _, _ = lay_out(one.holdout, one.vehicle)
    where, stage = with_effects(setting(one.vehicle, lines), (site,))
    return asked(where, stage, 1), setting(one.vehicle, held)


def _named(site: Site) -> Named:
    return Named(site, 1.0, (), {"fit": _WORSE, "holdout": _WORSE})


def test_a_name_that_is_missed_when_it_is_left_out_does_not_fail() -> None:
    model, held = _model()
    assert failed(held, model, [_named(model.stage.sites[0])], None, 1) == []


def _wrong() -> tuple[Model, Dataset]:
    """The same with an effect three times as large as it is, and the other way round."""
    model, held = _model()
    site = model.stage.sites[0]
    z = model.stage.mode.z.copy()
    k = model.stage.space.names.index(site.coordinate_name(site.effect.parameters[0]))
    z[k] *= -3.0
    wrong = replace(model.stage, mode=replace(model.stage.mode, z=z))
    return replace(model, stage=wrong), held


@pytest.fixture
def objected(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the likelihood of what was held out speak against every name."""
    monkeypatch.setattr(proof, "upheld", lambda *_: False)


@pytest.mark.usefixtures("objected")
def test_a_name_that_does_harm_fails() -> None:
    wrong, held = _wrong()
    one = _named(wrong.stage.sites[0])
    assert failed(held, wrong, [one], None, 1) == [one]


def test_what_acted_in_one_run_alone_is_not_asked_of_others() -> None:
    model, held = _model()
    push = replace(read_site("external_force@front"), run=0)
    assert failed(held, model, [_named(push)], None, 1) == []
    assert failed(None, model, [_named(model.stage.sites[0])], None, 1) == []


@pytest.mark.usefixtures("objected")
def test_names_that_only_together_do_harm_all_fail() -> None:
    """Each of them is better there than not, and all together are worse than nothing."""
    model, held = _model()
    site = model.stage.sites[0]
    better = Named(site, 1.0, (), {"holdout": Gap(1.0, 0.9, 0.5, False)})
    push = replace(_named(replace(read_site("external_force@front"), run=0)))
    assert failed(held, model, [better, push], _WORSE, 1) == [better, push]
    assert failed(held, model, [push], _WORSE, 1) == [push]
    assert failed(held, model, [better, push], Gap(0.5, 0.505, 0.5, True), 1) == []


@pytest.mark.usefixtures("objected")
def test_noise_is_no_excuse_where_it_covers_for_a_model_that_is_wrong() -> None:
    """A model that ran away on a road car: before 1.18, after 1.34, its own floor 1.33 m/s^2."""
    right, held = _model()
    wrong, _ = _wrong()
    gap = before_and_after(held, right.stage, wrong.stage, 1)
    assert gap.floor == left_over(held, right.stage, 1).noise
    assert gap.floor < left_over(held, wrong.stage, 1).noise
    assert before_and_after(held, wrong.stage, right.stage, 1).floor == gap.floor
    one = Named(wrong.stage.sites[0], 1.0, (), {"holdout": Gap(1.0, 0.9, 0.5, False)})
    assert failed(held, wrong, [one], gap, 1) == [one]


def test_what_is_there_is_kept_where_a_gap_grows_by_chance(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    model, held = _model()
    one = _named(model.stage.sites[0])
    monkeypatch.setattr(proof, "before_and_after", lambda *_, **__: _WORSE)
    assert failed(held, model, [one], _WORSE, 1) == []
    monkeypatch.setattr(proof, "upheld", lambda *_: False)
    assert failed(held, model, [one], _WORSE, 1) == [one]


def test_a_name_for_noise_fails() -> None:
    """A null that alarms: its gap grew by a tenth on what was held out."""
    one = case("null", 72, 75, "test")
    runs = (lay_out(runs, one.vehicle)[0] for runs in (one.recordings, one.holdout))
    fit, held = (setting(one.vehicle, lines) for lines in runs)
    where, stage = with_effects(fit, (read_site("sensor_bandwidth@rear_wheel"),))
    model = asked(where, stage, 1)
    gap = before_and_after(held, base(where), model.stage, 1)
    name = Named(stage.sites[0], 1.0, (), {"holdout": gap})
    assert gap.after > 1.05 * gap.before
    assert not upheld(model, held, [name])
    assert failed(held, model, [name], None, 1) == [name]


def test_what_failed_is_not_named_again() -> None:
    one = case("bound_rebound-400", 5, 0)
    lines, _, _ = lay_out(one.recordings, one.vehicle)
    where = setting(one.vehicle, lines)
    plain = asked(where, base(where), 1)
    truth = f"bound_rebound@{one.truth.effects[0].where}"
    assert truth in [str(lead.candidates[0].site) for lead in leading(plain.found)]
    left = [str(lead.candidates[0].site) for lead in leading(plain.found, (truth,))]
    assert left
    assert truth not in left
    grown = grow(begun(plain), 1, lambda share, words: None, (truth,))
    assert truth not in [str(n.site) for n in grown.named]


def test_what_promises_less_than_a_name_has_to_bring_is_asked_first_alone() -> None:
    """Whatever is asked beside a name is asked without one as well."""
    one = case("null", 5, 0)
    lines, _, _ = lay_out(one.recordings, one.vehicle)
    where = setting(one.vehicle, lines)
    found = asked(where, base(where), 1).found
    first, beside = (
        {str(lead.candidates[0].site) for lead in leading(found, beside=b)} for b in (False, True)
    )
    assert beside < first


def test_a_gap_that_did_not_grow_seldom_seems_to() -> None:
    """600 pairs of white residuals of 2.5 s, seed 4: 2.5 % asked for, three deviations more had."""
    rng = np.random.default_rng(4)
    time = np.arange(1000) / 400.0
    grown = 0
    for k in range(600):
        one, two = (Left((rng.normal(size=(1000, 2)),), (time,), (1.0,)) for _ in range(2))
        grown += grew(one, two, k)
    assert 4 <= grown <= 26


def test_a_simulation_that_runs_away_is_worse_than_any() -> None:
    still = Left((np.zeros((400, 2)),), (np.arange(400) / 400.0,), (1.0,))
    away = replace(still, residual=(np.full((400, 2), np.nan),))
    assert grew(still, away, 1)
    assert not grew(away, away, 1)  # nothing was read there


def _silent(share: float, words: str) -> None:
    pass


def _after_a_push() -> Selection:
    """A push, and after it a drift."""
    model, _ = _model()
    push = _named(replace(read_site("external_force@front"), run=1))
    return Selection(model, (push, _named(read_site("sensor_drift@front_wheel"))), [], 0.0)


def test_pushes_that_came_last_are_not_asked_again() -> None:
    grown = _after_a_push()
    last = replace(grown, named=grown.named[::-1])
    assert reconsidered(last, 1, _silent) is last
    damper = _named(read_site("bound_rebound@front"))
    three = replace(last, named=(damper, *last.named))
    assert reconsidered(three, 1, _silent) is three
    alone = replace(grown, named=grown.named[:1])
    assert reconsidered(alone, 1, _silent) is alone


@pytest.mark.parametrize(("behind", "wins"), [(1.0, True), (-1.0, False)])
def test_a_push_gives_way_to_what_it_stood_in_for(
    monkeypatch: pytest.MonkeyPatch, behind: float, wins: bool
) -> None:
    grown = _after_a_push()
    stop = _named(read_site("droop_stop@front"))

    def grow(begin: Selection, *_: object, most: int = 4) -> Selection:
        return replace(begin, named=(grown.named[1], stop)[:most])

    monkeypatch.setattr(growing, "grow", grow)
    monkeypatch.setattr(growing, "without", lambda model, named, failed, seed: (model, [named[1]]))
    monkeypatch.setattr(growing, "told_by", lambda stage, allowed: [])
    level = replace(grown.model.allowed, by_amount=grown.model.allowed.by_amount - behind)
    monkeypatch.setattr(growing, "weighed", lambda quiet, stage: level)
    monkeypatch.setattr(growing, "refitted", lambda quiet, stage, sites: stage)
    found = reconsidered(grown, 1, _silent).named
    assert found == ((grown.named[1], stop) if wins else grown.named)


def test_a_push_that_is_named_first_of_all_again_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    grown = _after_a_push()
    asked: list[int] = []

    def grow(begin: Selection, *_: object, most: int = 4) -> Selection:
        asked.append(most)
        return replace(begin, named=(*begin.named, grown.named[0]))

    monkeypatch.setattr(growing, "grow", grow)
    monkeypatch.setattr(growing, "without", lambda model, named, failed, seed: (model, [named[1]]))
    monkeypatch.setattr(growing, "told_by", lambda stage, allowed: [])
    assert reconsidered(grown, 1, _silent) is grown
    assert asked == [2]
