"""Diagnosis of other cars and sensors, on drives that are integrated here and not by the filter.

The body moves in absolute coordinates on wheels that follow a road; sensors filter and add noise.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from bayes_asv.diagnosis.model_assessment import assess
from bayes_asv.diagnosis.results import DiagnosisResult
from bayes_asv.diagnosis.score_test import ScoreTest, one_sided_squares
from bayes_asv.diagnosis.workflow import diagnose
from bayes_asv.domain.channels import channel
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Sensor, Vehicle, read_vehicle
from bayes_asv.posterior.fitted_model import fit_linear_car, make_dataset
from bayes_asv.preprocessing.run_preparation import prepare_runs
from bayes_asv.report.documents.diagnose import diagnose_document
from bayes_asv.report.page import report_page
from bayes_asv.report.schema import DiagnoseDocument
from bayes_asv.report.sections.diagnosis import diagnosis_lines
from tests.cli.conftest import ROOT
from tests.report.conftest import panel_keys

Array = NDArray[np.float64]
Damper = Callable[[Array], Array]
"""From deflection rates (ne,), m/s, to forces over the nominal damping rates, m/s."""

_CORNER, _RATE, _SECONDS = 50.0, 150.0, 1.0  # Hz, Hz, s
_RATIO, _GAIN = 1.6, 1.08  # rebound over compression damping, and a reading over the truth
_POSITION = 0.9  # m ahead of the rear axle, of the unit on the body
_NOISE = {"wheel": 0.02, "chassis": 0.01, "travel": 0.0005, "vertical": 0.02, "rate": 0.002}
_WHEELS = ("front_wheel", "rear_wheel")
_CORNERS = ("front_left", "front_right", "rear_left", "rear_right")


@dataclass(frozen=True)
class Setup:
    """A car model with what is measured."""

    car: str
    channels: tuple[str, ...]
    file: str = "baja2008.toml"


SETUPS = {
    "travel": Setup("half", (*_WHEELS, "front_travel", "rear_travel")),
    "body unit": Setup("half", (*_WHEELS, "body_vertical", "body_pitch_rate")),
    "front axle": Setup("quarter-front", ("front_wheel", "front_chassis")),
    "roll": Setup(
        "roll",
        (
            *(f"{corner}_wheel" for corner in _CORNERS),
            "front_left_chassis",
            "front_right_chassis",
            "rear_chassis",
        ),
        "baja2008_roll.toml",
    ),
}


def _vehicle(setup: Setup) -> Vehicle:
    car = read_vehicle(ROOT / "data" / "vehicles" / setup.file)
    sensors = {
        name: Sensor(
            noise=_NOISE[name.split("_")[-1]],
            bandwidth=_CORNER if channel(name).quantity == "acceleration" else None,
        )
        for name in setup.channels
    }
    unit = replace(channel("body_vertical"), position=_POSITION)
    return replace(car, sensors=sensors, channels=(unit,))


def _geometry(setup: Setup, car: Vehicle) -> tuple[Array, Array, Array, Array]:
    """Masses (n,), heights of the wheels' tops (ne, n), damping and spring rates (ne,)."""
    m, front, rear = car.m.value, car.l_f, car.l_r
    c, k = np.array([car.c_f.value, car.c_r.value]), np.array([car.k_f.value, car.k_r.value])
    if setup.car == "half":
        return np.array([m, car.i.value]), np.array([[1.0, front], [1.0, -rear]]), c, k
    if setup.car == "quarter-front":
        return np.array([m * car.wdf.value]), np.ones((1, 1)), c[:1], k[:1]
    assert car.roll is not None
    left_f, left_r = 0.5 * car.roll.front_track.value, 0.5 * car.roll.rear_track.value
    tops = [[1, front, left_f], [1, front, -left_f], [1, -rear, left_r], [1, -rear, -left_r]]
    masses = np.array([m, car.i.value, car.roll.inertia.value])
    return masses, np.array(tops, float), np.repeat(0.5 * c, 2), np.repeat(0.5 * k, 2)


def _place(name: str, car: Vehicle, heights: Array) -> Array:
    """Heights (n,) of an accelerometer on the body."""
    if name == "body_vertical":
        return np.array([1.0, _POSITION - car.l_r])
    if name == "rear_chassis" and len(heights) == 4:
        return np.asarray(heights[2:].mean(axis=0))
    corner = name.removesuffix("_chassis")
    element = _CORNERS.index(corner) if corner in _CORNERS else ("front", "rear").index(corner)
    return np.asarray(heights[element])


def _road(rng: np.random.Generator, count: int) -> list[CubicSpline]:
    """Heights of the wheels, m: sums of sines that begin softly; the rear follows the front."""
    time = np.linspace(-0.1, _SECONDS + 0.1, 5000)
    frequency = rng.uniform(0.8, 9.0, 14)
    phases = rng.uniform(0.0, 2.0 * np.pi, (2, 14))  # of the left and the right track
    amplitudes = 0.02 / frequency**1.2
    out = []
    for wheel in range(count):
        track, axle = (wheel % 2, wheel // 2) if count == 4 else (0, wheel)
        since = time - 0.1 - 0.25 * axle
        begun = np.clip(since / 0.3, 0.0, 1.0)
        soft = begun**3 * (10.0 - 15.0 * begun + 6.0 * begun**2)
        sines = np.sin(2.0 * np.pi * frequency[:, None] * since + phases[track][:, None])
        out.append(CubicSpline(time, soft * (amplitudes @ sines)))
    return out


def _linear(rates: Array) -> Array:
    return rates


def _asymmetric(rates: Array) -> Array:
    """The first damper resists rebound more than compression."""
    out = rates.copy()
    out[0] *= 2.0 / (1.0 + _RATIO) * (_RATIO if rates[0] > 0.0 else 1.0)
    return out


def _recording(
    setup: Setup, car: Vehicle, seed: int, damper: Damper, gains: dict[str, float]
) -> Recording:
    """Integrate a drive and measure it with the sensors of the vehicle."""
    rng = np.random.default_rng([seed, 5])
    masses, heights, c, k = _geometry(setup, car)
    wheels = _road(rng, len(heights))
    measured = [channel(name) for name in setup.channels]
    filtered = [one.name for one in measured if one.quantity == "acceleration"]
    places = {
        one.name: _place(one.name, car, heights)
        for one in measured
        if one.part == "body" and not one.axis
    }
    n = len(masses)

    def motion(time: float, q: Array, rate: Array) -> tuple[Array, Array, Array]:
        deflection = heights @ q - np.array([w(time) for w in wheels])
        speed = heights @ rate - np.array([w(time, 1) for w in wheels])
        force = -k * deflection - c * damper(speed)
        return deflection, speed, heights.T @ force / masses

    def slope(time: float, state: Array) -> Array:
        q, rate, read = state[:n], state[n : 2 * n], state[2 * n :]
        acceleration = motion(time, q, rate)[2]
        true = [
            places[name] @ acceleration if name in places else wheels[filtered.index(name)](time, 2)
            for name in filtered
        ]
        return np.concatenate([rate, acceleration, 2.0 * np.pi * _CORNER * (np.array(true) - read)])

    rows = np.arange(round(_SECONDS * _RATE)) / _RATE
    start = np.zeros(2 * n + len(filtered))
    solved = solve_ivp(
        slope, (0.0, rows[-1]), start, t_eval=rows, rtol=1e-7, atol=1e-9, max_step=0.01
    )
    values = []
    for one in measured:
        if one.quantity == "acceleration":
            signal = solved.y[2 * n + filtered.index(one.name)]
        elif one.quantity == "angular_rate":
            signal = solved.y[n + 1]
        else:
            element = ("front", "rear").index(str(one.axle))
            signal = heights[element] @ solved.y[:n] - wheels[element](rows)
        noise = float(car.sensor(one.name).noise or 0.0) * rng.normal(size=len(rows))
        values.append(gains.get(one.name, 1.0) * signal + noise)
    units = tuple(one.si_unit for one in measured)
    names = tuple(one.name for one in measured)
    return Recording(rows, np.array(values), units, (), f"drive {seed}", channels=names)


@cache
def diagnosed(name: str, seed: int, hidden: str = "") -> DiagnosisResult:
    """Diagnose two drives with something hidden, the second held out."""
    setup = SETUPS[name]
    car = _vehicle(setup)
    damper = _asymmetric if hidden == "damper" else _linear
    gains = {hidden: _GAIN} if hidden in setup.channels else {}
    runs = [_recording(setup, car, 2 * seed + k, damper, gains) for k in range(2)]
    return diagnose(runs[:1], runs[1:], car, seed, car=setup.car)


@pytest.mark.parametrize("name", SETUPS)
def test_a_car_without_a_fault_is_given_none(name: str) -> None:
    diagnosis = diagnosed(name, 0)
    assert diagnosis.named == ()
    assert diagnosis.engine is None
    assert diagnosis.unexplained is not None
    assert not diagnosis.unexplained.present
    assert diagnosis.errors is not None
    for error in diagnosis.errors.values():
        assert error.after < 1.15 * error.floor


@pytest.mark.parametrize("name", ["travel", "body unit", "front axle"])
def test_a_damper_that_is_asymmetric_is_named(name: str) -> None:
    diagnosis = diagnosed(name, 0, "damper")
    assert diagnosis.verdict == "named"
    assert [str(effect.placed) for effect in diagnosis.named] == ["bound_rebound@front"]
    assert diagnosis.probability_of(diagnosis.named[0]) > 0.9
    assert diagnosis.effect_draws is not None
    ratio = diagnosis.effect_draws["bound_rebound@front"]["ratio"]
    assert abs(float(ratio.mean()) - _RATIO) < 4.0 * float(ratio.std()) + 0.01
    assert diagnosis.errors is not None
    assert (diagnosis.errors["holdout"].closed or 0.0) > 0.9


@pytest.mark.parametrize(
    ("name", "sensor"),
    [
        ("travel", "front_travel"),
        ("body unit", "body_pitch_rate"),
    ],
)
def test_a_sensor_of_a_wrong_scale_is_named(name: str, sensor: str) -> None:
    diagnosis = diagnosed(name, 0, sensor)
    assert [str(effect.placed) for effect in diagnosis.named] == [f"sensor_gain@{sensor}"]
    assert diagnosis.effect_draws is not None
    factor = diagnosis.effect_draws[f"sensor_gain@{sensor}"]["factor"]
    assert abs(float(factor.mean()) - _GAIN) < 4.0 * float(factor.std())
    # as said and as saved
    again = _saved_and_drawn(diagnosis)
    (effect,) = again.effects
    assert (effect.name, effect.where) == ("sensor_gain", sensor)
    text = "\n".join(diagnosis_lines(again))
    assert f"{sensor.replace('_', ' ').capitalize()} sensor: it reads 1.0" in text


def _saved_and_drawn(diagnosis: DiagnosisResult) -> DiagnoseDocument:
    """Document of a diagnosis, read again; its page has the pictures of its first output."""
    document = diagnose_document(diagnosis)
    again = DiagnoseDocument.model_validate(json.loads(json.dumps(document.to_dict())))
    assert again == document
    page, _ = report_page(again)
    drawn = panel_keys(page)
    assert "gap" in drawn
    assert any(key.startswith("left-") and key.endswith("-0") for key in drawn)
    assert any(key.startswith("leftband-") and key.endswith("-0") for key in drawn)
    return again


def test_a_car_with_four_corners_is_said_to_be_one() -> None:
    lines = diagnosis_lines(_saved_and_drawn(diagnosed("roll", 0)))
    assert "The linear roll car agrees with the measurement" in lines[0]
    assert "half car" not in "\n".join(lines)


def _score_test_of_corners(damper: Damper, gains: dict[str, float]) -> tuple[ScoreTest, str]:
    """Score test of the roll car, and the candidate of the largest score."""
    setup = SETUPS["roll"]
    car = _vehicle(setup)
    lines, reasons, _ = prepare_runs([_recording(setup, car, 0, damper, gains)], car, car="roll")
    assert not reasons
    dataset = make_dataset(car, lines)
    test = assess(dataset, fit_linear_car(dataset), 0).test
    best = int(np.argmax(one_sided_squares(test.standardized_scores, test)))
    return test, str(test.candidates[best].placed)


def test_a_sensor_of_a_wrong_scale_at_one_corner_scores_highest_there() -> None:
    _, best = _score_test_of_corners(_linear, {"front_left_chassis": _GAIN})
    assert best == "sensor_gain@front_left_chassis"


def test_a_worn_damper_of_one_corner_scores_highest_there() -> None:
    test, best = _score_test_of_corners(_asymmetric, {})
    assert best == "bound_rebound@front_left"
    # a tolerance is that of one corner; both together have none of their own
    alike = [c for c in test.candidates if c.placed.effect.name == "bound_rebound"]
    places = {c.placed.where: c.tolerance for c in alike}
    assert places == {
        "front": False, "rear": False, "both": False, **dict.fromkeys(_CORNERS, True)
    }  # fmt: skip


def test_the_missing_force_is_mapped_where_accelerations_show_it() -> None:
    for name, axles in (("travel", ()), ("body unit", ()), ("front axle", ("front",))):
        located = diagnosed(name, 0, "damper").localization
        assert located is not None
        assert tuple(located.force_maps) == axles
        assert (located.strongest is not None) == bool(axles)
        assert located.channel in SETUPS[name].channels
    roll = diagnosed("roll", 0).localization
    assert roll is not None
    assert tuple(roll.force_maps) == ("front", "rear")


def test_the_simulation_error_is_in_the_unit_of_the_outputs() -> None:
    units = {
        name: diagnose_document(diagnosed(name, 0)).gap.unit
        for name in ("travel", "body unit", "front axle")
    }
    assert units == {"travel": "in", "body unit": "%", "front axle": "in/s^2"}
