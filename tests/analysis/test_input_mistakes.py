"""Mistakes in the input are named, and right inputs raise no doubt, on drives of the rig."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from bayes_asv.analysis import input_mistakes
from bayes_asv.analysis.input_hypotheses import CORRECT, hypotheses_of_recording
from bayes_asv.analysis.input_mistakes import Mistake, check_input, rear_leads
from bayes_asv.analysis.nominal_values import nominal_mistakes
from bayes_asv.analysis.screening_fit import screening_fit
from bayes_asv.domain.recording import Recording, accelerations, nominal_rate
from bayes_asv.domain.vehicle import Given, Nominal, Vehicle, read_vehicle
from bayes_asv.estimation import estimate
from bayes_asv.io import read_recording
from bayes_asv.models.cars import car_model
from bayes_asv.simulation.roads import road
from bayes_asv.simulation.simulate import simulate
from tests.posterior.cases import DECLARED, case, vehicle
from tests.posterior.test_other_sensors import vehicle as vehicle_with_other_sensors
from tests.posterior.test_roll import as_recording as wide_recording
from tests.posterior.test_roll import vehicle as wide_vehicle
from tests.rig import bump
from tests.rig.wide import shifted, wide_baja, wide_drive

Input = tuple[Recording, Vehicle]


def worn(seed: int, terrain: str = "stops") -> Input:
    """A right input: the drive of a car within what is declared."""
    return case(terrain, seed, DECLARED, seconds=1.5)[2], vehicle(DECLARED)


def columns(*order: int) -> Callable[[Recording, Vehicle], Input]:
    return lambda recording, car: (
        replace(recording, values=recording.values[list(order)]),
        car,
    )


def rear_chassis_late(recording: Recording, car: Vehicle) -> Input:
    values = recording.values.copy()
    values[3] = np.interp(recording.time - 0.007, recording.time, values[3])
    return replace(recording, values=values), car


def front_chassis_scaled(recording: Recording, car: Vehicle) -> Input:
    values = recording.values.copy()
    values[1] *= 1.15
    return replace(recording, values=values), car


def rear_chassis_inboard(recording: Recording, car: Vehicle) -> Input:
    """The body is rigid: a quarter of the way to the front, a sensor reads a quarter of it."""
    values = recording.values.copy()
    values[3] = 0.75 * values[3] + 0.25 * values[1]
    return replace(recording, values=values), car


def front_wheel_filtered(recording: Recording, car: Vehicle) -> Input:
    """By a Butterworth filter of second order, which is not the one that is looked for."""
    values = recording.values.copy()
    values[0] = sosfilt(butter(2, 12.0, fs=nominal_rate(recording), output="sos"), values[0])
    return replace(recording, values=values), car


def wheels_in_g(recording: Recording, car: Vehicle) -> Input:
    """Under a header of m/s²; the data show that they differ from the chassis, not who is right."""
    values = recording.values.copy()
    values[[0, 2]] /= 9.80665
    return replace(recording, values=values), car


def halved_springs(recording: Recording, car: Vehicle) -> Input:
    front, rear = (Given(k.value / 2.0, k.sd / 2.0) for k in (car.k_f, car.k_r))
    return recording, replace(car, k_f=front, k_r=rear)


def rear_damping_in_si(recording: Recording, car: Vehicle) -> Input:
    return recording, with_nominal(car, c_r=175.127)


MISTAKES = {
    "exchanged axles": (columns(2, 3, 0, 1), "front wheel and rear wheel, and front chassis and"),
    "exchanged wheel and chassis": (columns(0, 1, 3, 2), "rear wheel and rear chassis are exch"),
    "late sensor": (rear_chassis_late, "rear chassis is 7.0 ms late"),
    "scaled sensor": (front_chassis_scaled, "readings of front chassis are 1.1"),
    "sensor off its axle": (rear_chassis_inboard, "off its axle by 25 % of the wheelbase, towards"),
    "filtered sensor": (front_wheel_filtered, "front wheel is low-pass filtered at some"),
    "unit of the wheels": (wheels_in_g, "beside those of front wheel and rear wheel: a column in"),
    "unit of a damper": (rear_damping_in_si, "a value in N·s/m was given the unit lbf·s/in"),
    "springs of one side": (halved_springs, "the rate of one side is given instead of both sides"),
}


def test_a_time_in_milliseconds_leaves_a_refusal_its_own_reasons() -> None:
    recording, car = worn(3)
    slow = replace(recording, time=1e3 * recording.time)
    assert check_input([slow], car, refused=True) is None
    answer = estimate([slow], car)
    assert answer.verdict == "refused"
    assert any("time" in reason for reason in answer.reasons)


@pytest.mark.parametrize("kind", MISTAKES)
def test_a_mistake_is_named(kind: str) -> None:
    make, words = MISTAKES[kind]
    recording, car = make(*worn(3))
    doubt = check_input([recording], car)
    assert doubt is not None
    assert words in doubt.mistakes[0].words
    assert doubt.mistakes[0].probability > 0.5
    assert doubt.sentence.startswith("the input is probably wrong: ")


@pytest.mark.parametrize("terrain", ["bump", "stops", "rough"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_right_input_raises_no_doubt(terrain: str, seed: int) -> None:
    recording, car = worn(seed, terrain)
    assert check_input([recording], car) is None


def test_a_mistake_of_one_recording_is_named_with_it() -> None:
    first, car = worn(3)
    second = replace(worn(4)[0], source="again.csv")
    exchanged, _ = columns(1, 0, 2, 3)(second, car)
    doubt = check_input([first, exchanged], car)
    assert doubt is not None
    words = "in again.csv the columns of front wheel and front chassis are exchanged"
    assert doubt.mistakes[0].words == words


def test_what_no_recording_agrees_with_is_searched_for_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A mistake of one recording needs another one that agrees; a damper is in all of them."""
    searched = []
    every = input_mistakes._likeliest

    def counted(others: Any, recordings: Any, *rest: Any) -> list[Mistake]:
        searched.append(len(recordings))
        return every(others, recordings, *rest)

    monkeypatch.setattr(input_mistakes, "_likeliest", counted)
    data = Path(__file__).parents[2] / "data"
    car = read_vehicle(data / "vehicles" / "baja2008.toml")
    runs = [
        read_recording(data / "recordings" / f"valved-{n}-400hz.csv") for n in ("bump", "stops")
    ]
    doubt = check_input(runs, car)
    assert doubt is not None
    assert not doubt.model_holds
    assert searched == [2]


def test_a_channel_that_is_constant_in_one_recording_can_be_looked_at() -> None:
    first, car = worn(3)
    values = worn(4)[0].values.copy()
    values[3] = values[3, 0]
    doubt = check_input([first, replace(first, values=values[:, : len(first.time)])], car)
    assert doubt is not None


def test_a_wheel_that_is_still_under_a_body_that_moves_has_a_dead_sensor() -> None:
    recording, car = worn(3)
    values = recording.values.copy()
    values[2] = 0.02 * np.random.default_rng(1).normal(size=values.shape[1])
    refused = estimate([replace(recording, values=values)], car)
    assert refused.verdict == "refused"
    assert any("but the rear chassis did" in reason for reason in refused.reasons)
    assert any("probably dead, loose" in reason for reason in refused.reasons)
    assert not any("drive over" in reason for reason in refused.reasons)


def test_an_estimate_says_its_doubt_first_and_a_refusal_its_cause() -> None:
    recording, car = halved_springs(*worn(4))
    result = estimate([recording], car, seed=1)
    assert result.input_check is not None
    assert result.warnings[0] == result.input_check.sentence
    values = recording.values.copy()
    values[1] *= -1.0
    refused = estimate([replace(recording, values=values)], worn(4)[1], seed=1)
    assert refused.verdict == "refused"
    assert "front chassis is upside down" in refused.reasons[0]


def test_what_undoes_a_mistake_does_not_depend_on_the_units_of_the_columns() -> None:
    counted, car = worn(1)
    si = replace(counted, values=accelerations(counted, car), units=("m/s^2",) * 4)
    size = np.array([[1.0], [9.80665], [0.0254], [1.0]])
    mixed = replace(si, values=si.values / size, units=("m/s^2", "g", "in/s^2", "m/s^2"))
    _assert_undone_alike(si, mixed, car)


def test_mistakes_of_other_sensors_are_undone_in_their_own_units() -> None:
    """A column in millimetres or degrees per second, as one in metres or radians per second."""
    given = vehicle_with_other_sensors()
    channels = ("front_wheel", "rear_wheel", "front_travel", "body_vertical", "body_pitch_rate")
    ground = road("bump", np.random.default_rng(5))
    si = simulate(given, ground, seconds=1.0, seed=5, channels=channels).recording
    si = replace(si, units=("m/s^2", "m/s^2", "m", "m/s^2", "rad/s"))
    size = np.array([[9.80665], [1.0], [1e-3], [9.80665], [np.pi / 180.0]])
    mixed = replace(si, values=si.values / size, units=("g", "m/s^2", "mm", "g", "deg/s"))
    _assert_undone_alike(si, mixed, given)


def _assert_undone_alike(si: Recording, mixed: Recording, car: Vehicle) -> None:
    """Undo every mistake in both columns of SI units and those of other units."""
    model = car_model("half", car)
    ways = [hypotheses_of_recording(one, car, model) for one in (si, mixed)]
    changed = 0
    for one, other in zip(*ways, strict=True):
        for by in one.sizes or (0.0,):
            found = [h.undo(r, car, by) for h, r in ((one, si), (other, mixed))]
            plain, converted = (accelerations(*corrected) for corrected in found)
            np.testing.assert_allclose(converted, plain, atol=1e-9, err_msg=str(one.words(by)))
            noise, other_noise = ([v.sensor(n).noise for n in si.channels] for _, v in found)
            assert noise == pytest.approx(other_noise)
            changed += not np.allclose(plain, si.values)
    assert changed > 50


@pytest.mark.parametrize("name", ["front_wheel", "front_chassis", "rear_chassis"])
def test_a_gain_is_as_probable_as_the_readings_that_it_scaled(name: str) -> None:
    """The density of readings is per unit of those given; the wheels are not predicted."""
    recording, car = worn(1)
    log = math.log(1.3)
    (gain,) = (
        one
        for one in hypotheses_of_recording(recording, car, car_model("half", car))
        if one.sizes and one.stretch(log) == {name: -log}
    )
    scaled, scaled_car = gain.undo(recording, car, -log)
    right = input_mistakes._evaluate(CORRECT, 0.0, [recording], car, "half")
    found = input_mistakes._evaluate(gain, log, [scaled], scaled_car, "half")
    readings = len(recording.time) if name.endswith("chassis") else 0
    assert found.log_posterior == pytest.approx(right.log_posterior - log * readings, abs=0.01)
    assert found.dispersion == pytest.approx(right.dispersion)


def test_the_order_of_the_wheels_is_that_of_the_road() -> None:
    recording, _ = worn(5)
    assert not rear_leads([recording])
    assert rear_leads([replace(recording, values=recording.values[[2, 3, 0, 1]])])
    still = replace(recording, values=np.zeros_like(recording.values))
    assert not rear_leads([still])


def with_nominal(car: Vehicle, **factors: float) -> Vehicle:
    changed = {n: Nominal(getattr(car, n).value * f) for n, f in factors.items()}
    return replace(car, **changed)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("factors", "words"),
    [
        ({"c_f": 0.5, "c_r": 0.5}, "one side of an axle only"),
        ({"c_f": 2.78, "c_r": 2.78}, "at the damper instead of at the wheel"),
        ({"c_f": 1.0 / 12.0, "c_r": 1.0 / 12.0}, "a value in lbf·s/in was given the unit lbf·s/ft"),
        (
            {"c_f": 1.0 / 175.127, "c_r": 1.0 / 175.127},
            "a value in lbf·s/in was given the unit N·s/m",
        ),
        ({"c_f": 1.0, "c_r": 12.0}, "the nominal rear damping rate has a wrong unit"),
        ({"c_f": 1.0, "c_r": 0.5}, "the nominal rear damping rate is given for one side"),
        ({"i": 1.0 / 6.6}, "nominal pitch inertia means"),
    ],
)
def test_a_mistake_in_nominal_values_is_named(factors: dict[str, float], words: str) -> None:
    recording, car = worn(6)
    wrong = with_nominal(car, **factors)
    fit = screening_fit([recording], wrong)
    assert fit is not None
    model = car_model("half", wrong)
    mistakes = nominal_mistakes(wrong, model, fit.values)
    # 12 and 14.6 are one factor, given how much a damper may be worn
    assert any(words in mistake.words for mistake in mistakes[:2])


@pytest.mark.parametrize("deviation", [0.0, 0.08])
def test_dampers_whose_nominal_rates_are_exchanged_look_like_each_other(deviation: float) -> None:
    """A rear damper that is softer and a front one that is stiffer by the same factor."""
    car = with_nominal(vehicle(DECLARED), c_f=1.0, c_r=0.5)  # front and rear differ by 1.44
    model = car_model("half", car)
    values = {p.name: p.nominal for p in model.parameters}
    values["c_f"], values["c_r"] = values["c_r"] * (1.0 + deviation), values["c_f"]
    mistakes = nominal_mistakes(car, model, values)
    assert mistakes
    assert mistakes[0].words == "front and rear nominal damping are exchanged"


@pytest.mark.parametrize("loss", [0.6, 0.75, 1.0, 1.15])
def test_wear_is_no_mistake(loss: float) -> None:
    car = vehicle(DECLARED)
    model = car_model("half", car)
    values = {p.name: p.nominal for p in model.parameters}
    values["c_f"] *= loss
    values["c_r"] *= math.sqrt(loss)
    assert nominal_mistakes(car, model, values) == []


def test_a_spring_of_a_corner_that_the_recording_contradicts_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The roll car's springs are halves of what the vehicle file gives for an axle."""
    monkeypatch.setattr(input_mistakes, "likely_mistakes", lambda *_, **__: [])  # finds none
    nominal, road_left = wide_baja(), bump()
    car = replace(nominal, k=(*nominal.k[:3], 2.0 * nominal.k[3]))
    run = wide_drive(car, (road_left, shifted(road_left, 0.6)), 4.4, 400.0, 2.0, 5)
    found = check_input([wide_recording(run)], wide_vehicle(tmp_path, {"k": 0.05}), "roll")
    assert found is not None
    assert "contradicts what is given" in found.sentence
    said = re.search(r"the rear right spring rate, ([0-9.]+) times", found.sentence)
    assert said is not None
    assert float(said[1]) == pytest.approx(0.5, rel=0.1)
