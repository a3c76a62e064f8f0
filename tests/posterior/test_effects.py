"""Effects among the coordinates: sensors that are off, and the scoring that fits them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.posterior.effect_fit import read_effect, with_effects
from bayes_asv.posterior.fisher_scoring import slopes
from bayes_asv.posterior.fitted_model import Dataset, make_dataset, transfer_coordinates
from bayes_asv.posterior.model_error import draw_cars
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.posterior.cases import EXACT, as_recording, vehicle
from tests.rig import (
    DEFAULT_SPEEDS,
    TERRAINS,
    CurveDamper,
    Push,
    RigCar,
    SensorSpec,
    baja,
    draw,
    drive,
    with_terms,
)


def driven(terrain: str, spec: SensorSpec) -> tuple[RigCar, Vehicle, Recording]:
    car = draw(baja(), np.random.default_rng([11, 3]), EXACT)
    run = drive(car, TERRAINS[terrain](5), DEFAULT_SPEEDS[terrain], 400.0, 2.5, spec, 6)
    return car, vehicle(EXACT), as_recording(run, "run.csv")


def laid(recording: Recording, car: Vehicle) -> Dataset:
    lines, reasons, _ = prepare_runs((recording,), car)
    assert not reasons
    return make_dataset(car, lines)


def test_the_slopes_are_those_of_the_log_posterior() -> None:
    _, car, recording = driven("bump", SensorSpec())
    where = laid(recording, car)
    posterior = where.posterior(
        (read_effect("bound_rebound@front"), read_effect("sensor_lag@rear_wheel"))
    )
    z = np.random.default_rng(1).normal(0.0, 0.05, posterior.space.dimension)
    found = slopes(posterior, z).gradient(z)
    h = 1e-4
    away = np.concatenate([z + h * np.eye(len(z)), z - h * np.eye(len(z))])
    up, down = np.split(posterior.log_posterior(away), 2)
    np.testing.assert_allclose(found, (up - down) / (2 * h), rtol=2e-3, atol=0.05)


def test_a_filter_is_stable_where_delays_split_its_steps() -> None:
    """Steps of 0.2 and 2.3 ms in turn, and a damper whose force lags its rate by 1 ms.

    A parabola through the short step took what a reading had changed in the force for its bend:
    innovations alternated in sign and grew to 20 standard deviations.
    """
    spec = replace(SensorSpec(), delay=(0.0, 1e-4, 0.0, 3e-4), bandwidth=(float("inf"),) * 4)
    _, _, recording = driven("bump", spec)
    placed = read_effect("damper_hysteresis@rear")
    dataset = laid(recording, vehicle(EXACT, spec))
    linear, lagging = dataset.posterior(()), dataset.posterior((placed,))
    z = np.zeros(linear.space.dimension)
    z[[name.startswith("noise") for name in linear.space.names]] = -3.0  # half of the noise
    rate = linear.space.cars(z[None])[0][1]
    stiffness = {"stiffness": rate / 1e-3}
    moved = transfer_coordinates(linear.space, z, lagging.space, placed, stiffness)
    usual = linear.innovations_and_variances(z, 0)[0]
    found = lagging.innovations_and_variances(moved, 0)[0]
    assert np.max(np.abs(found[:40])) < np.max(np.abs(usual[:40])) + 2.0


DECLARED_DELAY = (0.0, 6.75e-4, 0.0, 6.75e-4)
SENSORS = {
    "sensor_gain@front_chassis": ({"gain": (1.0, 1.03, 1.0, 1.0)}, "factor", 1.03),
    "sensor_gain@rear_wheel": ({"gain": (1.0, 1.0, 0.97, 1.0)}, "factor", 0.97),
    "sensor_lag@front_wheel": ({"delay": (4e-4, *DECLARED_DELAY[1:])}, "lag", 4e-4),
    "sensor_lag@rear_chassis": ({"delay": (*DECLARED_DELAY[:3], 2.75e-4)}, "lag", -4e-4),
    "sensor_bandwidth@front_wheel": ({"bandwidth": (40.0, 50.0, 50.0, 50.0)}, "bandwidth", 0.8),
    "sensor_bandwidth@rear_chassis": ({"bandwidth": (50.0, 50.0, 50.0, 65.0)}, "bandwidth", 1.3),
    "sensor_bandwidth@front_chassis": ({"bandwidth": (50.0, 12.5, 50.0, 50.0)}, "bandwidth", 0.25),
    "sensor_bandwidth@rear_wheel": ({"bandwidth": (50.0, 50.0, 15.0, 50.0)}, "bandwidth", 0.3),
    "sensor_lag@front_chassis": ({"delay": (0.0, 5.675e-3, 0.0, 6.75e-4)}, "lag", 5e-3),
    "sensor_drift@front_chassis": ({"drift": (0.0, 0.2, 0.0, 0.0)}, "slope", 0.2),
}


@pytest.mark.parametrize("name", SENSORS)
def test_a_sensor_that_is_off_is_measured(name: str) -> None:
    wrong, parameter, truth = SENSORS[name]
    _, car, recording = driven("bump", replace(SensorSpec(), **wrong))  # type: ignore[arg-type]
    _, stage = with_effects(laid(recording, car), (read_effect(name),))
    assert stage.mode.converged
    placed = stage.placed_effects[0]
    k = stage.space.names.index(placed.coordinate_name(placed.effect.parameters[0]))
    sd = np.sqrt(np.linalg.inv(stage.mode.slopes.precision())[k, k])
    z = placed.effect.parameters[0].coordinate(truth, stage.space.sizes)
    assert abs(stage.mode.z[k] - z) < 3.0 * sd
    assert abs(z) > 6.0 * sd  # and it is measured, not merely allowed for
    assert placed.effect.parameters[0].name == parameter


def test_draws_of_a_free_curve_are_as_probable_as_normal_ones() -> None:
    rates = (-1.0, -0.05, -0.01, 0.0, 0.01, 0.05, 1.0)
    forces = (-700.0, -320.0, -150.0, 0.0, 60.0, 150.0, 900.0)
    car = with_terms(
        draw(baja(), np.random.default_rng([11, 3]), EXACT),
        "front", CurveDamper(rates, forces), damper=False,
    )  # fmt: skip
    run = drive(car, TERRAINS["stops"](5), DEFAULT_SPEEDS["stops"], 400.0, 2.5, SensorSpec(), 6)
    recording = as_recording(run, "run.csv")
    _, model = with_effects(laid(recording, vehicle(EXACT)), (read_effect("damper_curve@front"),))
    covariance = np.asarray(np.linalg.inv(model.mode.slopes.precision()), np.float64)
    rng = np.random.default_rng(3)
    z = draw_cars(model.space, model.mode.z, covariance, 100, rng)
    lost = model.mode.log_posterior - model.posterior.log_posterior(z)
    # a normal density loses half the dimension; draws that are normal in z lose thousands
    assert np.median(lost) < 5.0 * 0.5 * len(model.mode.z)


@pytest.mark.parametrize("push", [Push(260.0, 0.99, 0.4), Push(-320.0, 1.1, 0.2, "front")])
def test_a_push_is_found_at_its_time_and_place(push: Push) -> None:
    car = draw(baja(), np.random.default_rng([11, 3]), EXACT)
    run = drive(
        car, TERRAINS["stops"](5), DEFAULT_SPEEDS["stops"], 400.0, 2.5, SensorSpec(), 6,
        forces=[push],
    )  # fmt: skip
    recording = as_recording(run, "run.csv")
    _, model = with_effects(
        laid(recording, vehicle(EXACT)), (read_effect(f"external_force@{push.where}"),)
    )
    found = model.space.effects(model.mode.z)[model.placed_effects[0]]
    # times count from the first row, although body sensors are read later than their stamps say
    assert found["start"] == pytest.approx(push.start, abs=1e-3)
    assert found["start"] + found["duration"] == pytest.approx(push.start + push.duration, abs=1e-3)
    assert found["force"] == pytest.approx(push.force, rel=0.05)


@pytest.mark.parametrize(
    ("text", "mend"),
    [("rust", "there are bound_rebound"), ("bound_rebound@left", "use bound_rebound@front")],
)
def test_an_effect_that_is_none_gets_one_sentence(text: str, mend: str) -> None:
    with pytest.raises(InputError, match=mend):
        read_effect(text)
