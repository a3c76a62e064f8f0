"""Channels that were read at rates and times of their own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bayes_asv as asv
from bayes_asv.domain.recording import Recording, nominal_rate
from bayes_asv.models.cars import car_model
from bayes_asv.preprocessing.data_checks import preflight
from bayes_asv.preprocessing.prepare import prepare
from tests.rig.car import baja
from tests.rig.run import drive
from tests.rig.sensors import SensorSpec
from tests.rig.terrain import bump

VEHICLE = Path(__file__).parents[2] / "data" / "vehicles" / "baja2008.toml"
CHANNELS = ("front_wheel", "front_chassis", "rear_wheel", "rear_chassis")


def _merged(fast: float, slow: float, shift: float) -> Recording:
    """Wheels at one rate and chassis at another, each with stamps of its own."""
    spec = SensorSpec(adc=None, delay=(0.0,) * 4)
    runs = [drive(baja(), bump(), 3.2, rate, 3.0, spec, 5) for rate in (fast, slow)]
    times = [runs[0].time, runs[1].time + shift]
    stamps = np.unique(np.concatenate(times))
    values = np.full((4, stamps.size), np.nan)
    for c in range(4):
        source = c % 2
        readings = runs[source].channels[c]
        if source:  # the other board samples later: take what the motion was then
            readings = np.interp(times[1], runs[1].time, readings)
        values[c, np.searchsorted(stamps, times[source])] = readings
    return Recording(stamps, values, ("m/s^2",) * 4, source="two loggers", channels=CHANNELS)


@pytest.fixture(scope="module")
def car() -> asv.Vehicle:
    """Return the rig's car with sensors that have no steps; their noise is as the rig has it."""
    vehicle = asv.read_vehicle(VEHICLE)
    spec = SensorSpec()
    return replace(
        vehicle,
        sensors={
            name: replace(
                vehicle.sensor(name),
                zero_counts=None,
                counts_scale=None,
                resolution=None,
                noise=spec.noise[c],
                delay=0.0,
            )
            for c, name in enumerate(CHANNELS)
        },
    )


def test_rows_of_other_channels_are_no_missing_readings(car: asv.Vehicle) -> None:
    recording = _merged(400.0, 300.0, 0.0007)
    assert nominal_rate(recording) == pytest.approx(400.0)
    assert preflight(car, prepare(recording, car, car_model("half", car))) == ([], [])


def test_readings_that_are_missing_at_their_own_rate_are_counted(car: asv.Vehicle) -> None:
    recording = _merged(400.0, 300.0, 0.0007)
    values = recording.values.copy()
    there = np.flatnonzero(np.isfinite(values[1]))
    values[1, there[100:110]] = np.nan
    few = replace(recording, values=values)
    reasons, warnings = preflight(car, prepare(few, car, car_model("half", car)))
    assert reasons == []
    assert warnings == ["10 readings of the front chassis sensor of two loggers are missing"]
    values = values.copy()
    values[1, there[200:600]] = np.nan
    many = replace(recording, values=values)
    reasons, _ = preflight(car, prepare(many, car, car_model("half", car)))
    assert len(reasons) == 1
    assert reasons[0].startswith("410 of ")


@pytest.mark.parametrize("rates", [(400.0, 12.0), (12.0, 400.0)])
def test_the_slowest_channel_has_to_follow_the_car(
    car: asv.Vehicle, rates: tuple[float, float]
) -> None:
    recording = _merged(*rates, 0.0007)
    reasons, _ = preflight(car, prepare(recording, car, car_model("half", car)))
    assert any("was taken at 12 Hz, too slow for this car" in reason for reason in reasons)


def test_two_rates_give_the_answer_of_one(car: asv.Vehicle) -> None:
    one = asv.estimate(_merged(400.0, 400.0, 0.0), car, seed=1)
    two = asv.estimate(_merged(400.0, 250.0, 0.0013), car, seed=1)
    truth = baja()
    for name, value in (("c_f", truth.c_f), ("c_r", truth.c_r), ("i", truth.i)):
        low, high = two[name].to("SI").interval(0.95)
        assert low < value < high
        assert two[name].sd == pytest.approx(one[name].sd, rel=0.3)
