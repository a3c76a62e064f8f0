"""What a finished model could have named in place of one of its effects."""

from __future__ import annotations

from functools import cache

from bayes_asv.diagnosis.equivalent_models import alike, with_twins
from bayes_asv.diagnosis.model_search import Model, asked
from bayes_asv.diagnosis.results import Named
from bayes_asv.posterior.effect_fit import read_site, with_effects
from bayes_asv.posterior.fitted_model import setting
from bayes_asv.posterior.map_fit import lay_out
from tests.battery.cases import case


@cache
def _finished() -> tuple[Model, tuple[Named, ...]]:
    """Dampers that differ in bound and rebound, and a drift said to be the chassis sensor's."""
    one = case("pair-4000", 41, 0)
    assert [e.name for e in one.truth.effects] == ["bound_rebound", "sensor_drift"]
    assert one.truth.effects[1].where == "rear_wheel"
    lines, _, _ = lay_out(one.recordings, one.vehicle)
    sites = (read_site("sensor_drift@rear_chassis"), read_site("bound_rebound@both"))
    where, stage = with_effects(setting(one.vehicle, lines), sites)
    return asked(where, stage, 1), tuple(Named(site, 1.0, (), {}) for site in sites)


def test_a_wheels_drift_is_its_chassis_drift() -> None:
    model, named = _finished()
    near = {str(group[0].site) for group in alike(model, named[0])}
    assert "sensor_drift@rear_wheel" in near
    assert "sensor_drift@front_wheel" not in near
    assert alike(model, named[1]) == []


def test_what_cannot_be_told_from_it_is_listed_with_each_effect() -> None:
    model, named = _finished()
    drift, dampers = with_twins(model, named)
    assert "sensor_drift@rear_wheel" in [str(other.site) for other in drift.others]
    assert dampers.others == ()


def test_a_single_effect_is_not_asked_again() -> None:
    model, named = _finished()
    assert with_twins(model, named[:1]) == named[:1]
