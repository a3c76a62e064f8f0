"""Cars and sensors other than four accelerometers: simulated parameters are recovered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.domain.channels import channel
from bayes_asv.domain.vehicle import Sensor, Vehicle, read_vehicle
from bayes_asv.estimation import estimate
from bayes_asv.models.car_model import CarModel
from bayes_asv.models.cars import car_model
from bayes_asv.posterior.map_fit import best_fit
from bayes_asv.posterior.parameters import make_parameter_space
from bayes_asv.preprocessing.run_preparation import prepare_runs
from bayes_asv.simulation.roads import road
from bayes_asv.simulation.simulate import simulate
from tests.cli.conftest import ROOT
from tests.posterior.cases import DECLARED, EXACT, case, prepared
from tests.posterior.cases import vehicle as rig_vehicle

WHEELS = ("front_wheel", "rear_wheel")
CASES = {
    "quarter-front": ("quarter-front", ("front_wheel", "front_chassis")),
    "quarter-rear": ("quarter-rear", ("rear_wheel", "rear_chassis")),
    "travel": ("half", (*WHEELS, "front_travel", "rear_travel")),
    "imu": ("half", (*WHEELS, "body_vertical", "body_pitch_rate")),
}


def baja() -> Vehicle:
    """The baja with its four accelerometers."""
    return read_vehicle(ROOT / "data" / "vehicles" / "baja2008.toml")


def vehicle() -> Vehicle:
    """The baja with potentiometers and an inertial unit 0.9 m ahead of its rear axle."""
    car = baja()
    sensors = {
        "front_travel": Sensor(noise=0.0005),
        "rear_travel": Sensor(noise=0.0005),
        "body_vertical": Sensor(noise=0.05, bandwidth=50.0),
        "body_pitch_rate": Sensor(noise=0.005),
    }
    unit = replace(channel("body_vertical"), position=0.9)
    return replace(car, sensors={**car.sensors, **sensors}, channels=(unit,))


def drawn(car: CarModel, rng: np.random.Generator) -> dict[str, float]:
    """A car from the prior, its damping and inertia within a factor of 1.5 at one deviation."""
    terms: dict[str, float] = {}
    out = {}
    for p in car.parameters:
        if p.kind == "fraction":
            out[p.name] = p.nominal + p.terms[0][2] * rng.normal()
            continue
        log = np.log(p.nominal)
        for term, coefficient, sd in p.terms:
            log += coefficient * min(sd, 0.4) * terms.setdefault(term, float(rng.normal()))
        out[p.name] = float(np.exp(log))
    return out


@pytest.mark.parametrize("name", CASES)
def test_simulated_parameters_are_recovered(name: str) -> None:
    seed = 1
    which, channels = CASES[name]
    given = vehicle()
    car = car_model(which, given)
    rng = np.random.default_rng([seed, 77])
    true = drawn(car, rng)
    drive = simulate(
        given, road("stops", rng), seed=seed, car=which, values=true, channels=channels
    )
    result = estimate([drive.recording], given, seed=seed, car=which)
    assert (result.verdict, result.reasons) == ("ok", ())
    for parameter in car.estimated:
        logs = np.log(result.draws[parameter])
        sd = float(logs.std())
        assert sd < 0.15, parameter  # measured, not merely known a priori
        assert abs(float(logs.mean()) - np.log(true[parameter])) < 3.5 * sd, parameter


def test_the_spectrum_of_the_motion_is_no_engine() -> None:
    """Exact deflections and rates show what a fit is off by, on a slope through 5 Hz."""
    seed = 2
    given = replace(vehicle(), sensors=baja().sensors)
    channels = (*WHEELS, "front_travel", "rear_travel", "body_pitch_rate")
    ground = road("stops", np.random.default_rng([seed, 0]))
    drive = simulate(given, ground, rate=200.0, seconds=2.0, seed=seed, channels=channels)
    lines, reasons, _ = prepare_runs([drive.recording], given)
    assert not reasons
    found = best_fit(lines, given)
    assert not [text for text in found.warnings if "shakes" in text]
    assert found.space.recordings[0].notches == ()


def test_accelerations_identify_five_of_seven_logarithms() -> None:
    """Mass and wheelbase scale the answer: c_f, c_r, i, m, l, k_f and k_r have five ratios."""
    sds = DECLARED | {"l": 0.02}
    line = prepared(case("bump", 1, EXACT, seconds=1.0)[2], rig_vehicle(sds))
    prior = make_parameter_space(rig_vehicle(sds), (line,)).prior
    assert prior.identified.shape == (7, 5)
    assert prior.unidentified.shape == (7, 2)
    basis = np.hstack([prior.identified, prior.unidentified])
    np.testing.assert_allclose(basis.T @ basis, np.eye(7), atol=1e-12)
