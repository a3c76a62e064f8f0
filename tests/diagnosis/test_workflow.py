"""From recordings to a name: a few drives of the rig, each with one thing wrong."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from bayes_asv.diagnosis.workflow import Diagnosis, diagnose
from bayes_asv.report.documents.diagnose import diagnose_document
from bayes_asv.report.sections.diagnosis import diagnosis_lines
from tests.battery.cases import Case, case


@cache
def asked(name: str) -> tuple[Case, Diagnosis]:
    one = case(name, 3, 0)
    return one, diagnose(one.recordings, one.holdout, one.vehicle, 1)


def test_a_car_without_fault_agrees() -> None:
    _, found = asked("null/bump~baja")
    assert found.verdict == "agreement"
    assert found.named == ()
    assert found.p > 0.05
    assert found.gaps is not None
    for gap in found.gaps.values():
        assert gap.before == pytest.approx(gap.floor, rel=0.15)


def test_a_hidden_effect_is_named_and_the_gap_closes() -> None:
    one, found = asked("bound_rebound@rear-4000/bump~baja")
    assert found.verdict == "named"
    first = found.named[0]
    assert str(first.site) == "bound_rebound@rear"
    assert first.probability > 0.9
    assert found.gaps is not None
    assert (found.gaps["holdout"].closed or 0.0) > 0.85
    assert not found.gaps["holdout"].worse
    assert found.left is not None
    assert not found.left.present
    assert found.before is not None
    assert found.after is not None
    low, high = one.truth.meant["c_r"]
    interval = np.quantile(found.after["c_r"], [0.025, 0.975])
    assert interval[0] < high
    assert interval[1] > low


def test_the_document_and_the_words_say_the_same() -> None:
    _, found = asked("bound_rebound@rear-4000/bump~baja")
    document = diagnose_document(found)
    assert document.schema_name == "bayes_asv/diagnose/1"
    effect = document.effects[0]
    assert (effect.name, effect.where) == ("bound_rebound", "rear")
    assert effect.parameters["ratio"].eti95[0] < effect.parameters["ratio"].mean
    text = " ".join(diagnosis_lines(document))
    assert "Rear damper: rebound damping is " in text
    assert "held-out runs" in text


def test_what_has_no_name_is_said_to_have_none() -> None:
    _, found = asked("compliant_seat-4000/bump~baja")
    assert found.verdict in ("named", "unexplained")
    assert found.left is not None
    assert found.left.present


def test_what_only_the_held_out_run_shows_is_said_to_be_there() -> None:
    """A fault that came between the drives: nothing in those that were fitted, plain afterwards."""
    sound = case("null/bump~baja", 3, 0)
    _, agreed = asked("null/bump~baja")
    assert agreed.left is not None
    assert not agreed.left.present
    worn = case("bound_rebound@rear-4000/bump~baja", 3, 0)
    found = diagnose(sound.recordings, worn.recordings[:1], sound.vehicle, 1)
    assert found.named == ()
    assert found.left is not None
    assert found.left.present
    assert found.verdict == "unexplained"


def test_a_damper_in_a_soft_mount_is_not_a_lag_of_a_sensor_alone() -> None:
    """They differ by a twentieth of their energy; the mount is one coefficient in all runs."""
    one = case("maxwell_mount-400", 41, 1)
    found = diagnose(one.recordings, one.holdout, one.vehicle, 1)
    assert found.left is not None
    assert found.left.present
    assert "soft mount" in found.left.like


def test_a_push_acts_when_it_did_once_an_engine_is_cut_out() -> None:
    """The filter takes a quarter of a second off the beginning; the push came 0.9 s after it."""
    one = case("pair-400", 44, 1)
    engine, push = one.truth.effects
    assert (engine.name, push.name) == ("engine_vibration", "external_force")
    found = diagnose(one.recordings, one.holdout, one.vehicle, 1)
    assert found.engine is not None
    assert found.engine.frequency.value == pytest.approx(engine.parameters["frequency"], rel=0.03)
    assert [n.site.effect.name for n in found.named] == ["external_force"]
    assert found.effects is not None
    start = found.effects[str(found.named[0].site)]["start"]
    assert float(np.mean(start)) == pytest.approx(push.parameters["start"], abs=0.03)
    assert found.gaps is not None
    assert (found.gaps["fit"].closed or 0.0) > 0.85  # the push acts in the run that had it
    assert found.left is not None
    assert not found.left.present
