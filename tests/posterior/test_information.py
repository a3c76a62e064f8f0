"""What recordings cannot tell, said before anything is fitted, against what a fit then finds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Nominal, Sensor, Vehicle, read_vehicle
from bayes_asv.estimation import estimate
from bayes_asv.posterior.identifiability import unidentified_before_fit
from bayes_asv.posterior.information import fisher_information, make_parameter_prior, predicted_sd
from bayes_asv.posterior.map_fit import best_fit
from bayes_asv.preprocessing.run_preparation import prepare_runs
from bayes_asv.shipped import shipped
from bayes_asv.simulation.roads import road
from bayes_asv.simulation.simulate import simulate

BAJA = read_vehicle(shipped("vehicles", "baja2008.toml"))
COARSE = replace(BAJA, sensors={**BAJA.sensors, "front_travel": Sensor(noise=1.0)})
FRONT = ("front_wheel", "rear_wheel", "front_travel")


def _drive(vehicle: Vehicle, channels: tuple[str, ...] | None, car: str = "half") -> Recording:
    bump = road("bump", np.random.default_rng(1))
    return simulate(vehicle, bump, seed=3, car=car, channels=channels).recording


@pytest.mark.parametrize(
    ("car", "channels"),
    [("half", None), ("half", FRONT), ("quarter-rear", None),
     ("half", ("front_wheel", "rear_wheel", "front_chassis", "body_pitch_rate"))],
)  # fmt: skip
def test_the_fit_is_as_uncertain_as_its_recording_promises(
    car: str, channels: tuple[str, ...] | None
) -> None:
    lines, reasons, _ = prepare_runs([_drive(BAJA, channels, car)], BAJA, None, car)
    assert not reasons
    assert unidentified_before_fit(lines, BAJA) == ()
    about = make_parameter_prior(lines[0].car, lines[0].output_models)
    asked = {name: about.log_gradients[name] for name in about.car.estimated}
    promised = predicted_sd(fisher_information(lines[0], BAJA, about), 1, about, asked)
    found = best_fit(lines, BAJA)
    for name, sd in promised.items():
        after = found.space.log_deviation(found.mode.covariance, name)
        assert after == pytest.approx(sd, rel=0.15)


def test_what_the_sensors_cannot_tell_is_said_before_and_confirmed_after_the_fit() -> None:
    """A potentiometer at the front that reads to a metre knows nothing of the rear damper."""
    recording = _drive(COARSE, FRONT)
    lines, _, _ = prepare_runs([recording], COARSE)
    before = unidentified_before_fit(lines, COARSE)
    assert any("rear damping rate (c_r)" in w and "rear suspension travel" in w for w in before)
    found = estimate([recording], COARSE)
    assert found.verdict == "refused"
    assert set(before) <= {*found.reasons, *found.warnings}
    assert len([*found.reasons, *found.warnings]) == len({*found.reasons, *found.warnings})


def test_an_answer_that_is_the_users_own_is_marked_as_such() -> None:
    value = COARSE.c_r.value
    known = replace(COARSE, c_r=Nominal(value, 0.02 * value))
    lines, _, _ = prepare_runs([_drive(known, FRONT)], known)
    said = [words for words in unidentified_before_fit(lines, known) if "(c_r)" in words]
    assert len(said) == 1
    assert "its interval is that of the vehicle file" in said[0]
