"""Effects beside others: an engine that wanders, and two faults that tolerances explain in turn."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.diagnosis import forward_selection as growing
from bayes_asv.diagnosis.results import Named
from bayes_asv.diagnosis.workflow import diagnose
from bayes_asv.posterior.effect_fit import read_site
from tests.battery.cases import case


def test_a_loud_engine_that_wanders_is_all_there_is() -> None:
    """Beside its notch a third of a run was left; innovations remembered it (p = 4e-10), and a
    spring that is not off was named at p = 0.04."""
    one = case("engine_vibration-4000", 56, 0, "test")
    (true,) = one.truth.effects
    found = diagnose(one.recordings, one.holdout, one.vehicle, 0)
    assert found.engine is not None
    assert found.engine.frequency.value == pytest.approx(true.parameters["frequency"], rel=0.03)
    assert found.named == ()
    assert found.trust == 1.0


def test_two_plain_faults_are_named_where_a_little_of_everything_explains_either() -> None:
    one = case("pair-4000", 56, 1, "test")
    found = diagnose(one.recordings, one.holdout, one.vehicle, 0)
    assert {str(n.site) for n in found.named} == {f"{e.name}@{e.where}" for e in one.truth.effects}
    assert all(n.probability > 0.99 for n in found.named)
    gap = (found.gaps or {})["holdout"]
    assert gap.closed is not None
    assert gap.closed > 0.95


def test_an_effect_with_values_of_its_own_at_each_axle_is_believed_as_one() -> None:
    both = tuple(
        Named(read_site(f"digressive_damper@{axle}"), 0.11, (), {}) for axle in ("front", "rear")
    )
    grown = growing._believed(growing.Selection(None, both, [], 0.9), 9.0, 0.01)  # type: ignore[arg-type]
    assert [n.probability for n in grown.named] == pytest.approx([0.99, 0.99])
    assert grown.none == 0.01


@given(before=st.floats(0.5, 0.999), nothing=st.floats(0.0, 1.0))
def test_a_doubt_is_bayes_rule_for_three_explanations(before: float, nothing: float) -> None:
    """A little of everything, the first alone, and the first with the second."""
    little, first = before, 1.0 - before
    both = first * (1.0 - nothing) / max(nothing, 1e-12)
    expected = little / (little + first + both)
    assert growing._doubt(before, nothing) == pytest.approx(expected, rel=1e-6)


def test_a_further_fault_is_named_where_it_is_likelier_there_than_not() -> None:
    """3.7 nats, 0.69: a push beside a droop stop, both of noncentrality 40."""
    one = case("pair-40", 69, 8, "test")
    found = diagnose(one.recordings, one.holdout, one.vehicle, 0)
    assert {n.site.effect.name: n.site.where for n in found.named} == {
        e.name: e.where for e in one.truth.effects
    }
    assert found.named[0].probability > 0.95
    assert 0.5 < found.named[1].probability < 0.95
    # no one thing without a name is both
    assert found.left is not None
    assert -100.0 < found.left.rival < -10.0


def test_what_asks_for_as_many_names_as_may_be_is_not_asked_again() -> None:
    sites = [read_site(w) for w in ("sensor_gain@rear_wheel", "sensor_lag@rear_wheel")]
    push = replace(read_site("external_force@front"), run=0)
    names = tuple(Named(s, 0.9, (), {}) for s in (push, push, *sites))
    full = growing.Selection(None, names, [], 0.0)  # type: ignore[arg-type]
    assert growing.reconsidered(full, 0, lambda share, words: None) is full
