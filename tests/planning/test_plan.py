"""Plans: what is chosen, what is refused and why, and the document they are told in."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bayes_asv.domain.vehicle import Given, Sensor, Travel, Vehicle, read_vehicle
from bayes_asv.planning.document import PASSES, plan_document
from bayes_asv.planning.plan import Plan, plan
from bayes_asv.planning.widths import ANSWERS, widths
from bayes_asv.planning.words import plan_lines
from bayes_asv.shipped import shipped

MPH = 0.44704
BAJA = read_vehicle(shipped("vehicles", "baja2008.toml"))


def _plan(vehicle: Vehicle, want: float = 0.05, **options: Any) -> Plan:
    usual: dict[str, Any] = {"rates": [400.0], "kinds": ["bump"], "speed_limit": 12 * MPH}
    return plan(vehicle, dict.fromkeys(ANSWERS, want), **{**usual, **options})


@pytest.fixture(scope="module")
def made() -> Plan:
    return _plan(BAJA, rates=[100.0, 400.0])


def test_the_chosen_drive_gives_what_is_wanted_gently(made: Plan) -> None:
    assert made.verdict == "ok"
    assert made.chosen is not None
    assert made.chosen.trial.gentle
    assert made.passes == 1
    promised = made.promised(made.chosen, made.passes)
    assert all(0.0 < promised[name] <= 0.05 for name in ANSWERS)
    # the mass is known to 1 %, and every rate with it
    assert promised["c_f"] == pytest.approx(0.0097, rel=0.03)
    assert made.limits == ()


def test_more_is_learned_from_faster_and_higher_and_at_a_higher_rate(made: Plan) -> None:
    by = {
        (one.trial.drive.ground.height, one.trial.drive.speed, one.trial.drive.rate): one.quality
        for one in made.judged
        if one.trial.usable and one.trial.drive.ground.length < 1.0
    }
    inch = 0.0254
    assert by[2 * inch, 8 * MPH, 400.0] < by[2 * inch, 4 * MPH, 400.0]
    assert by[3 * inch, 6 * MPH, 400.0] < by[2 * inch, 6 * MPH, 400.0]
    assert by[2 * inch, 6 * MPH, 400.0] < by[2 * inch, 6 * MPH, 100.0]


def test_a_mass_too_badly_known_is_named_with_what_it_needs() -> None:
    made = _plan(BAJA, want=0.004, rates=[200.0], speed_limit=7 * MPH)
    assert made.verdict == "refused"
    assert made.chosen is None
    assert made.best is not None
    answers = {what.answer: what.needed for what in made.limits}
    assert set(answers) == {"c_f", "c_r", "i"}
    better = BAJA.m.value * answers["c_f"]["m"]
    mended = replace(BAJA, m=Given(BAJA.m.value, 0.999 * better))
    assert _plan(mended, want=0.004, rates=[200.0], speed_limit=7 * MPH).verdict == "ok"
    text = "\n".join(plan_lines(made))
    assert "know the sprung mass to 0.40 % (given: 1.00 %)" in text


def test_drives_are_refused_for_their_own_reasons() -> None:
    tight = [replace(sensor, low=-12.0, high=12.0) for sensor in BAJA.sensors]
    low = replace(BAJA, sensors=(tight[0], tight[1], tight[2], tight[3]))
    short = replace(BAJA, travel=Travel(rear_bump=0.02, rear_droop=0.03))
    for vehicle, words in ((low, "end of its range"), (short, "of droop and has 1.2 in")):
        made = _plan(vehicle, speed_limit=8 * MPH)
        reasons = [reason for one in made.judged for reason in one.trial.reasons]
        assert any(words in reason for reason in reasons), words
        assert any(one.trial.usable for one in made.judged)
        for one in made.judged:
            assert one.trial.usable or one.passes is None
    slow = _plan(BAJA, rates=[20.0], speed_limit=5 * MPH)
    assert slow.best is None
    assert slow.passes == 0
    assert any("too slow for this car" in why for why in plan_document(slow)["reasons"])
    flying = _plan(BAJA, rates=[100.0])
    assert any("off the ground" in r for one in flying.judged for r in one.trial.reasons)


def test_the_document_says_the_same_and_is_json(made: Plan) -> None:
    document = json.loads(json.dumps(plan_document(made), allow_nan=False))
    assert document["schema"] == "bayes_asv/plan/1"
    assert len(document["drives"]) == len(made.judged)
    for told, one in zip(document["drives"], made.judged, strict=True):
        assert told["speed"]["si"] == one.trial.drive.speed
        assert told["speed"]["unit"] == "mph"
        assert told["usable"] == one.trial.usable
        assert set(told["passes_needed"]) == set(ANSWERS)
        if not one.trial.usable:
            assert told["reasons"]
            assert told["width_percent"] is None
            assert set(told["why_never"]) == set(ANSWERS)
            continue
        for n in PASSES:
            found = widths(one.trial.information, n, made.before)
            assert list(told["width_percent"][str(n)].values()) == pytest.approx(100.0 * found)
    recommended = document["recommended"]
    chosen = document["drives"][recommended["drive"]]
    assert chosen["road"]["words"] in recommended["words"]
    assert chosen["road"]["height"]["unit"] == "in"
    assert recommended["width_percent"] == chosen["width_percent"][str(recommended["passes"])]
    assert {"m", "c_f", "i"} <= set(document["inseparable"][0]["of"])


def test_the_same_seed_gives_the_same_plan_and_units_change_words_only() -> None:
    options: dict[str, Any] = {"kinds": ["stops", "rough"], "rates": [100.0]}
    options["speed_limit"] = 5.2 * MPH
    first, again = _plan(BAJA, **options), _plan(BAJA, **options)
    assert plan_document(first) == plan_document(again)
    metric = _plan(replace(BAJA, units="SI"), **options)
    assert metric.chosen is not None
    assert "km/h" in plan_document(metric)["recommended"]["words"]
    assert metric.floor == first.floor


def test_without_sensors_the_plan_says_what_it_assumed() -> None:
    bare = replace(BAJA, sensors=(Sensor(),) * 4, travel=Travel())
    made = _plan(bare, rates=[200.0], speed_limit=7 * MPH)
    assert made.verdict == "ok"
    warnings = " ".join(plan_document(made)["warnings"])
    for words in ("no noise for any sensor", "no range for some", "suspension travel"):
        assert words in warnings
    assert np.isfinite([one.quality for one in made.judged if one.trial.usable]).all()


def test_told_tyres_are_driven_on_and_guessed_ones_are_said(made: Plan) -> None:
    guessed = plan_document(made)["tyres"]
    assert guessed["assumed"]
    assert any("say --tyre-rate" in line for line in plan_lines(made))
    own = _plan(BAJA, tyre_rate=52_540.0, unsprung=33.0, rates=[200.0], speed_limit=6 * MPH)
    assert own.tyres.rate.tolist() == [52_540.0, 52_540.0]
    assert own.tyres.mass.tolist() == [33.0, 33.0]
    told = plan_document(own)["tyres"]
    assert not told["assumed"]
    assert told["rate"]["unit"] == "lbf/in"
    assert told["rate"]["front"] == pytest.approx(300.0, rel=1e-3)
    assert not any("say --tyre-rate" in line for line in plan_lines(own))
