"""The compiled filter against the readable one, to nine digits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.recording import accelerations
from bayes_asv.domain.vehicle import Sensor, Vehicle, read_vehicle
from bayes_asv.filters.kalman import AT_LEAST, AT_MOST, MISSING
from bayes_asv.filters.ukf_state import Steps
from bayes_asv.models.cars import car_model
from bayes_asv.simulation.roads import road
from bayes_asv.simulation.simulate import simulate
from bayes_asv.tracking import reference_ukf
from bayes_asv.tracking.filter import DEFAULT_SETTINGS, ENGINES, initial_state
from bayes_asv.tracking.filter_model import FilterModel, filter_model
from bayes_asv.tracking.parameters import coordinates
from bayes_asv.tracking.relinearization import slice_steps
from bayes_asv.tracking.sensor_noise import SensorModel, sensor_model
from bayes_asv.tracking.streaming_timeline import StreamingTimeline
from tests.posterior.cases import DECLARED, EXACT, case, vehicle
from tests.tracking.drives import tracked

ROWS = 70
NO_EVENTS = DEFAULT_SETTINGS._replace(information_gain=1e9, review_interval=1e9, fault_duration=1e9)


def _sensors(car: Vehicle) -> SensorModel:
    return sensor_model(car, car_model("half", car), CHANNELS)


def _model(car: Vehicle, forget: float | None = None) -> FilterModel:
    return filter_model(coordinates(car_model("half", car), CHANNELS), _sensors(car), forget)


def _steps(car: Vehicle, terrain: str = "bump", first: int = 150) -> Steps:
    _, _, recording = case(terrain, 3, DECLARED)
    timeline = StreamingTimeline(car, _sensors(car), 400.0)
    chunk = timeline.push(recording.time, accelerations(recording, car).T)
    return slice_steps(chunk.steps, first, first + ROWS)


def _both(
    car: Vehicle,
    steps: Steps,
    forget: float | None = None,
    width: float = 1.0,
    **settings: float,
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """Results of both engines: rows, event and final state."""
    return _ends(_model(car, forget), steps, width, **settings)


def _ends(
    model: FilterModel, steps: Steps, width: float = 1.0, **settings: float
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    ends = []
    for run in ENGINES.values():
        state, out = initial_state(model), np.zeros((len(steps.step), model.into.width))
        state.D[:] *= width
        event = run(0, False, state, model, NO_EVENTS._replace(**settings), steps, out)
        ends.append([out, np.asarray(event), *state[:7], state.statistics[: model.at.deviance]])
    return ends[0], ends[1]


def _differing(ends: tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]) -> list[int]:
    """Indices of the results that differ by more than 1e-9."""
    pairs = enumerate(zip(*ends, strict=True))
    return [k for k, (a, b) in pairs if not np.allclose(a, b, 1e-9, 1e-9, equal_nan=True)]


@pytest.mark.parametrize("sds", [EXACT, DECLARED], ids=["exact", "declared"])
def test_missing_readings(sds: dict[str, float]) -> None:
    car = vehicle(sds)
    steps = _steps(car)
    steps.kind[::7, 0] = MISSING
    steps.kind[3::11, 1] = MISSING
    assert _differing(_both(car, steps)) == []


def test_bounds_a_restart_and_process_noise() -> None:
    car = vehicle(DECLARED)
    steps = _steps(car)
    steps.kind[5::9, 0] = AT_LEAST
    steps.kind[6::13, 1] = AT_MOST
    steps.restart[40] = True
    assert _differing(_both(car, steps, forget=20.0)) == []


def test_raised_noise_factor_and_drift() -> None:
    car = vehicle(EXACT)
    steps = _steps(car, "rough", 220)
    steps.reading[30:, 1] += 2.0
    ends = _both(car, steps, width=0.02, drift_threshold=1.2)
    assert _differing(ends) == []
    out, into = ends[0][0], _model(car).into
    assert out[:, into.noise_factor + 1].max() > 3.0
    assert out[:, into.drift].max() == 1.0


def test_uncertain_scales_without_bandwidth() -> None:
    car = vehicle(EXACT)
    car = replace(
        car,
        sensors={
            n: replace(s, bandwidth=None, counts_scale=0.1, counts_scale_sd=0.002, resolution=0.0)
            for n, s in car.sensors.items()
        },
    )
    space = coordinates(car_model("half", car), CHANNELS, (0.02, 0.02, 0.02, 0.02))
    assert len(space) == 7
    steps = _steps(vehicle(EXACT))
    model = filter_model(space, _sensors(car))
    outs = []
    for run in ENGINES.values():
        state, out = initial_state(model), np.zeros((ROWS, model.into.width))
        run(0, False, state, model, NO_EVENTS, steps, out)
        outs.append(out)
    np.testing.assert_allclose(outs[0], outs[1], rtol=1e-9, atol=1e-9)


def test_trackers_with_relinearization() -> None:
    _, _, recording = case("stops", 5, DECLARED, seconds=0.62)
    car = vehicle(DECLARED)
    _, fast = tracked(recording, car)
    tracker, readable = tracked(recording, car, engine="filterpy")
    assert tracker.filter.relinearizing or tracker.filter.state.D[0, 0] < 0.1
    np.testing.assert_allclose(fast.median, readable.median, rtol=1e-9)
    np.testing.assert_allclose(fast.log_sd, readable.log_sd, rtol=1e-8)
    np.testing.assert_allclose(fast.predicted, readable.predicted, rtol=1e-9, atol=1e-9)


def test_reference_filter_has_no_fixed_reference() -> None:
    car = vehicle(EXACT)
    model = _model(car)
    with pytest.raises(ValueError, match="fixed reference"):
        reference_ukf.run(
            0,
            True,
            initial_state(model),
            model,
            DEFAULT_SETTINGS,
            _steps(car),
            np.zeros((ROWS, model.into.width)),
        )


WHEELS = ("front_wheel", "rear_wheel")
CORNERS = tuple(f"{axle}_{side}" for axle in ("front", "rear") for side in ("left", "right"))
SENSORS = {
    "quarter-front": ("front_wheel", "front_chassis"),
    "quarter-rear": ("rear_wheel", "rear_chassis"),
    "half": (*WHEELS, "front_travel", "body_pitch_rate", "rear_chassis"),
    "roll": (
        *(f"{corner}_wheel" for corner in CORNERS), "front_left_chassis", "front_right_chassis",
        "rear_chassis",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SENSORS)
def test_any_car_with_any_sensors(name: str) -> None:
    """Missing and clipped readings, anti-roll bars, springs that share an unknown, input biases."""
    file = "baja2008_roll.toml" if name == "roll" else "baja2008.toml"
    given = read_vehicle(Path(__file__).parents[2] / "data" / "vehicles" / file)
    names = SENSORS[name]
    declared = {n: Sensor(noise=1e-4) for n in names if n.endswith("_travel")}
    declared |= {n: Sensor(noise=2e-3) for n in names if n.endswith("_rate")}
    declared |= {n: replace(given.sensor(n), noise=0.05) for n in names if n not in declared}
    given = replace(given, sensors={**given.sensors, **declared})
    if given.roll is not None:
        given = replace(given, roll=replace(given.roll, front_bar=2000.0))
    rough = road("bump", np.random.default_rng(2))
    recording = simulate(given, rough, car=name, channels=names, seconds=1.0).recording
    car = car_model(name, given)
    sensors = sensor_model(given, car, names)
    timeline = StreamingTimeline(given, sensors, 400.0)
    chunk = timeline.push(recording.time, accelerations(recording, given).T)
    steps = slice_steps(chunk.steps, 220, 220 + (25 if name == "roll" else ROWS))
    steps.kind[::7, 0] = MISSING
    steps.kind[5::9, -1] = AT_LEAST
    model = filter_model(coordinates(car, names), sensors, 20.0)
    assert model.sizes.directions == int("body_pitch_rate" in names) + int(name == "roll")
    # a part of the prior's width: the first readings would move the parameters by factors
    assert _differing(_ends(model, steps, 0.3)) == []
