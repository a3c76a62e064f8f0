"""Large sensor faults: a quarter of the declared bandwidth, a lag of two samples, much noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bayes_asv.diagnosis.workflow import diagnose
from bayes_asv.domain.recording import Recording, accelerations
from tests.posterior.cases import DECLARED, as_recording, case, vehicle
from tests.rig import DEFAULT_SPEEDS, TERRAINS, SensorSpec, baja, draw, drive

SLOW: dict[str, Any] = {"bandwidth": (50.0, 12.5, 50.0, 50.0)}
LATE: dict[str, Any] = {"delay": (5e-3, 6.75e-4, 0.0, 6.75e-4)}


def _driven(terrain: str, spec: SensorSpec) -> Recording:
    car = draw(baja(), np.random.default_rng([1, 3]), DECLARED)
    run = drive(car, TERRAINS[terrain](1), DEFAULT_SPEEDS[terrain], 400.0, 2.5, spec, 1)
    return as_recording(run, f"{terrain}.csv")


@pytest.mark.parametrize(
    ("fault", "name", "parameter"),
    [
        (SLOW, "sensor_bandwidth@front_chassis", ("bandwidth", 0.25)),
        (LATE, "sensor_lag@front_wheel", ("lag", 5e-3)),
    ],
)
def test_a_large_sensor_fault_is_one_effect(
    fault: dict[str, Any], name: str, parameter: tuple[str, float]
) -> None:
    """A first-order pattern of the bandwidth fails on held-out recordings."""
    spec = replace(SensorSpec(), **fault)
    recordings, holdout = [_driven("bump", spec)], [_driven("rough", spec)]
    diagnosis = diagnose(recordings, holdout, vehicle(DECLARED), 0)
    (effect,) = diagnosis.named
    names = [str(effect.placed), *(str(o.placed) for o in effect.indistinguishable)]
    assert name in names
    assert effect.probability > 0.9
    assert diagnosis.unexplained is not None
    assert not diagnosis.unexplained.present
    error = (diagnosis.errors or {})["holdout"]
    assert error.closed is not None
    assert error.closed > 0.95
    if names[0] == name:
        draws = (diagnosis.effect_draws or {})[name][parameter[0]]
        low, high = np.quantile(draws, [0.001, 0.999])
        assert low < parameter[1] < high


@pytest.mark.parametrize("name", ["front_wheel", "front_chassis"])
def test_a_noisy_sensor_is_no_effect_of_the_car(name: str) -> None:
    """With the declared noise the damper had a bend or the spring a curve, certainly."""
    car, recording = vehicle(DECLARED), case("bump", 6, DECLARED)[2]
    values = accelerations(recording, car)
    c = recording.channels.index(name)
    noise = 10.0 * (car.sensor(name).noise or 0.0)
    values[c] += noise * np.random.default_rng(6).normal(size=values.shape[1])
    found = diagnose([replace(recording, values=values, units=("m/s^2",) * 4)], [], car)
    assert (found.verdict, found.named) == ("agreement", ())
    words = f"the {name.replace('_', ' ')} sensor of bump-6.csv is"
    (warning,) = (w for w in found.warnings if w.startswith(words))
    assert "times as noisy as the vehicle file says" in warning
    assert warning.endswith("the noise that it shows is used here")
    assert found.vehicle is car
