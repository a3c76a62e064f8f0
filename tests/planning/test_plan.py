"""Plans: the recommended drive, refusals with their reasons, and the document."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.vehicle import Given, Sensor, Travel, Vehicle, read_vehicle
from bayes_asv.planning.document import PASSES, plan_document
from bayes_asv.planning.plan import PlanResult, plan
from bayes_asv.planning.predicted_sd import predicted_sd
from bayes_asv.planning.text import plan_lines
from bayes_asv.shipped import shipped

MPH = 0.44704
BAJA = read_vehicle(shipped("vehicles", "baja2008.toml"))
TWO_SIDES = read_vehicle(Path(__file__).parents[2] / "data" / "vehicles" / "baja2008_roll.toml")
PARAMETERS = ("c_f", "c_r", "i", "k_g")


def _plan(vehicle: Vehicle, want: float = 0.05, **options: Any) -> PlanResult:
    usual: dict[str, Any] = {"rates": [400.0], "kinds": ["bump"], "speed_limit": 12 * MPH}
    return plan(vehicle, dict.fromkeys(PARAMETERS, want), **{**usual, **options})


@pytest.fixture(scope="module")
def made() -> PlanResult:
    return _plan(BAJA, rates=[100.0, 400.0])


def test_the_chosen_drive_is_gentle_and_reaches_the_wanted_deviations(made: PlanResult) -> None:
    assert made.verdict == "ok"
    assert made.chosen is not None
    assert made.chosen.evaluation.gentle
    assert made.passes == 1
    sd_after = made.sd_after(made.chosen, made.passes)
    assert all(0.0 < sd_after[name] <= 0.05 for name in PARAMETERS)
    # the mass is known to 1 %, and every rate with it
    assert sd_after["c_f"] == pytest.approx(0.0097, rel=0.03)
    assert made.limits == ()


def test_information_grows_with_speed_height_and_sampling_rate(made: PlanResult) -> None:
    by = {
        (
            one.evaluation.drive.road.height,
            one.evaluation.drive.speed,
            one.evaluation.drive.rate,
        ): one.worst_ratio
        for one in made.rated
        if one.evaluation.usable and one.evaluation.drive.road.length < 1.0
    }
    inch = 0.0254
    assert by[2 * inch, 8 * MPH, 400.0] < by[2 * inch, 4 * MPH, 400.0]
    assert by[3 * inch, 6 * MPH, 400.0] < by[2 * inch, 6 * MPH, 400.0]
    assert by[2 * inch, 6 * MPH, 400.0] < by[2 * inch, 6 * MPH, 100.0]


def test_a_mass_that_limits_the_result_is_reported_with_the_required_deviation() -> None:
    made = _plan(BAJA, want=0.004, rates=[200.0], speed_limit=7 * MPH)
    assert made.verdict == "refused"
    assert made.chosen is None
    assert made.best is not None
    required = {limiting.parameter: limiting.required_sd for limiting in made.limits}
    assert set(required) == {"c_f", "c_r", "i"}
    better = BAJA.m.value * required["c_f"]["m"]
    weighed = replace(BAJA, m=Given(BAJA.m.value, 0.999 * better))
    assert _plan(weighed, want=0.004, rates=[200.0], speed_limit=7 * MPH).verdict == "ok"
    text = "\n".join(plan_lines(made))
    assert "measure the sprung mass to 0.40 % (given: 1.00 %)" in text


def test_unusable_drives_have_their_own_reasons() -> None:
    tight = {name: replace(s, low=-12.0, high=12.0) for name, s in BAJA.sensors.items()}
    low = replace(BAJA, sensors=tight)
    short = replace(BAJA, travel=Travel(rear_bump=0.02, rear_droop=0.03))
    for vehicle, words in ((low, "end of its range"), (short, "of droop and has 1.2 in")):
        made = _plan(vehicle, speed_limit=8 * MPH)
        reasons = [reason for one in made.rated for reason in one.evaluation.reasons]
        assert any(words in reason for reason in reasons), words
        assert any(one.evaluation.usable for one in made.rated)
        for one in made.rated:
            assert one.evaluation.usable or one.passes is None
    slow = _plan(BAJA, rates=[20.0], speed_limit=5 * MPH)
    assert slow.best is None
    assert slow.passes == 0
    assert any("too slow for this car" in why for why in plan_document(slow)["reasons"])
    flying = _plan(BAJA, rates=[100.0])
    assert any("off the ground" in r for one in flying.rated for r in one.evaluation.reasons)


def test_the_document_agrees_with_the_plan_and_is_json(made: PlanResult) -> None:
    document = json.loads(json.dumps(plan_document(made), allow_nan=False))
    assert document["schema"] == "bayes_asv/plan/1"
    assert len(document["drives"]) == len(made.rated)
    for entry, one in zip(document["drives"], made.rated, strict=True):
        assert entry["speed"]["si"] == one.evaluation.drive.speed
        assert entry["speed"]["unit"] == "mph"
        assert entry["usable"] == one.evaluation.usable
        assert set(entry["passes_needed"]) == set(PARAMETERS)
        if not one.evaluation.usable:
            assert entry["reasons"]
            assert entry["width_percent"] is None
            assert set(entry["why_never"]) == set(PARAMETERS)
            continue
        for n in PASSES:
            sd = predicted_sd(one.evaluation.information, n, made.prior)
            shown = {name: 100.0 * sd[name] for name in PARAMETERS}
            assert entry["width_percent"][str(n)] == pytest.approx(shown)
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
    assert metric.sd_floor == first.sd_floor


def test_without_sensors_the_plan_reports_its_assumptions() -> None:
    bare = replace(BAJA, sensors={}, travel=Travel())
    made = _plan(bare, rates=[200.0], speed_limit=7 * MPH)
    assert made.verdict == "ok"
    warnings = " ".join(plan_document(made)["warnings"])
    for words in ("no noise for any sensor", "no range for some", "suspension travel"):
        assert words in warnings
    assert np.isfinite([one.worst_ratio for one in made.rated if one.evaluation.usable]).all()


def test_given_tyres_are_used_and_assumed_ones_are_reported(made: PlanResult) -> None:
    assumed = plan_document(made)["tyres"]
    assert assumed["assumed"]
    assert any("give --tyre-rate" in line for line in plan_lines(made))
    own = _plan(BAJA, tyre_rate=52_540.0, unsprung=33.0, rates=[200.0], speed_limit=6 * MPH)
    assert own.tyres.rate.tolist() == [52_540.0, 52_540.0]
    assert own.tyres.mass.tolist() == [33.0, 33.0]
    given = plan_document(own)["tyres"]
    assert not given["assumed"]
    assert given["rate"]["unit"] == "lbf/in"
    assert given["rate"]["front"] == pytest.approx(300.0, rel=1e-3)
    assert not any("give --tyre-rate" in line for line in plan_lines(own))


def _plan_of(vehicle: Vehicle, car: str, names: tuple[str, ...], **options: Any) -> PlanResult:
    answers = {"quarter-front": ("c_f",), "half": PARAMETERS}.get(
        car, ("c_fl", "c_fr", "c_rl", "c_rr", "i", "i_roll")
    )
    usual: dict[str, Any] = {"rates": [200.0], "kinds": ["bump"], "speed_limit": 7 * MPH}
    return plan(
        vehicle, dict.fromkeys(answers, 0.05), car=car, channels=names or None,
        **{**usual, **options},
    )  # fmt: skip


def test_one_axle_tells_nothing_about_the_other_and_the_pitch_inertia() -> None:
    made = _plan_of(BAJA, "quarter-front", ())
    assert made.verdict == "ok"
    assert made.estimands == ("c_f",)
    document = json.loads(json.dumps(plan_document(made), allow_nan=False))
    assert document["channels"] == ["front_wheel", "front_chassis"]
    (line,) = document["unidentified"]
    assert "rear damping rate and the pitch inertia" in line
    assert set(document["drives"][0]["travel"]) == {"unit", "front_bump", "front_droop"}


def test_every_car_and_every_sensor_can_be_planned() -> None:
    wheels = ("front_wheel", "rear_wheel")
    both = _plan_of(BAJA, "half", (*wheels, "front_travel", "body_pitch_rate"))
    one = _plan_of(BAJA, "half", (*wheels, "front_travel"))
    assert both.best is not None
    assert one.best is not None
    assert both.verdict == one.verdict == "ok"
    assert plan_document(both)["unidentified"] == []
    drives = [made.sd_after(made.rated[0], 1) for made in (both, one)]
    assert all(drives[0][name] <= drives[1][name] * 1.001 for name in PARAMETERS)
    others = plan_document(both)["drives"][0]["largest_reading"]["others"]
    assert set(others) == {"front_travel", "body_pitch_rate"}
    roll = _plan_of(TWO_SIDES, "roll", ())
    assert roll.verdict == "ok"
    assert "left ones" in " ".join(plan_document(roll)["warnings"])


def test_a_sensor_too_coarse_for_a_parameter_does_not_tell_it() -> None:
    """A potentiometer at the front that reads to a decimetre knows nothing of the rear damper."""
    coarse = replace(BAJA, sensors={**BAJA.sensors, "front_travel": Sensor(noise=0.1)})
    made = _plan_of(coarse, "half", ("front_wheel", "rear_wheel", "front_travel"), max_passes=1)
    told = plan_document(made)["unidentified"]
    assert any("rear damping rate (c_r)" in line and "rear suspension travel" in line
               for line in told)  # fmt: skip


def test_channels_that_do_not_fit_the_car_are_refused_in_a_sentence() -> None:
    for car, names, words in (
        ("half", ("front_wheel", "front_chassis"), "lack rear_wheel"),
        ("half", ("front_wheel", "rear_wheel"), "measure nothing"),
        ("quarter-front", ("front_wheel", "rear_wheel", "front_chassis"), "is not one of the"),
    ):
        with pytest.raises(InputError, match=words):
            _plan_of(BAJA, car, names)
