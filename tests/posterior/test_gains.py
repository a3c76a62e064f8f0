"""Sensor scales that are uncertain: coordinates like any given value."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.analysis.uncertainty_budget import find_budget
from bayes_asv.domain.recording import Recording, accelerations
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.posterior.map_fit import MapFit, best_fit
from bayes_asv.posterior.parameters import make_parameter_space
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.posterior.cases import DECLARED, EXACT, vehicle
from tests.rig import DEFAULT_SPEEDS, TERRAINS, RigCar, SensorSpec, baja, draw, drive


def declared(sds: dict[str, float], share: float) -> Vehicle:
    """The nominal baja whose scales are known to a share of themselves."""
    car = vehicle(sds)
    sensors = {
        name: replace(s, counts_scale_sd=share * abs(s.counts_scale or 0.0))
        for name, s in car.sensors.items()
    }
    return replace(car, sensors=sensors)


def counted(gain: tuple[float, float, float, float]) -> tuple[RigCar, Recording]:
    """A drive in counts whose sensors read too much or too little, seed 7."""
    rng = np.random.default_rng([7, 46])
    car = draw(baja(), rng, DECLARED)
    road, noise = (int(v) for v in rng.integers(2**31, size=2))
    spec = replace(SensorSpec(), gain=gain)
    run = drive(car, TERRAINS["bump"](road), DEFAULT_SPEEDS["bump"], 400.0, 2.0, spec, noise)
    assert run.counts is not None
    return car, Recording(run.time, run.counts.astype(float), ("counts",) * 4, (), "counts.csv")


def fitted(car: Vehicle, recording: Recording) -> MapFit:
    lines, reasons, warnings = prepare_runs((recording,), car)
    assert not reasons
    assert warnings == ()
    fit = best_fit(lines, car)
    assert fit.mode.converged
    return fit


@pytest.fixture(scope="module")
def off() -> tuple[RigCar, Recording]:
    return counted((1.0, 1.012, 0.995, 0.99))


def test_scales_are_as_uncertain_beside_a_recording_that_is_not_in_counts(
    off: tuple[RigCar, Recording],
) -> None:
    """In any order of the recordings."""
    car, in_counts = declared(EXACT, 0.01), off[1]
    values = accelerations(in_counts, car)
    in_units = replace(in_counts, values=values, units=("m/s^2",) * len(values))
    lines, reasons, _ = prepare_runs((in_counts, in_units), car)
    assert not reasons
    for runs in (lines[:1], lines, lines[::-1]):
        space = make_parameter_space(car, runs)
        gains = {one.name: one.scale for one in space.coordinates if one.kind == "gain"}
        assert gains == pytest.approx({f"gain {name}": 0.01 for name in in_counts.channels})


def test_a_gain_is_a_reading_over_truth(off: tuple[RigCar, Recording]) -> None:
    """A wheel that reads g times too much is one whose readings and noise are divided by g."""
    fit = fitted(declared(EXACT, 0.01), counted((1.0, 1.0, 1.0, 1.0))[1])
    z = fit.mode.z.copy()
    z[fit.space.names.index("gain front_wheel")] = 1.5
    z[fit.space.names.index("gain rear_wheel")] = 0.0
    plain = z.copy()
    plain[fit.space.names.index("gain front_wheel")] = 0.0
    gain = math.exp(1.5 * 0.01)
    level = fit.space.coordinates[fit.space.names.index("noise front_wheel 0")]
    plain[fit.space.names.index(level.name)] -= math.log(gain) / level.scale
    recording = fit.space.recordings[0]
    moments, spread, steps = (
        recording.moments.copy(),
        recording.process_noise.copy(),
        recording.quantization_steps.copy(),
    )
    moments[:, 0] /= gain
    spread[:, len(recording.inputs)] /= gain**2  # what the wheel did between its samples
    steps[0] /= gain
    shrunk_line = replace(
        recording, moments=moments, process_noise=spread, quantization_steps=steps
    )
    shrunk = replace(fit.space, recordings=(shrunk_line,))
    np.testing.assert_allclose(
        fit.posterior.innovations(z, 0),
        replace(fit.posterior, space=shrunk).innovations(plain, 0),
        atol=1e-9,
    )


def test_scales_that_are_off_are_allowed_for(off: tuple[RigCar, Recording]) -> None:
    truth, recording = off
    wide = fitted(declared(DECLARED, 0.01), recording)
    narrow = fitted(declared(DECLARED, 0.0), recording)
    missed = {}
    for fit, share in ((wide, "wide"), (narrow, "narrow")):
        best = dict(zip(fit.space.car.names, fit.space.cars(fit.mode.z[None])[0], strict=True))
        missed[share] = [
            abs(math.log(best[n] / getattr(truth, n)))
            / fit.space.log_deviation(fit.mode.covariance, n)
            for n in ("c_f", "c_r", "i")
        ]
    assert max(missed["wide"]) < 2.0
    assert max(missed["narrow"]) > 2.5  # what is declared exact and is not
    width = find_budget(wide.posterior, wide.mode, declared(DECLARED, 0.01))
    for name, answer in width.estimands.items():
        assert sum(answer.shares.values()) == pytest.approx(1.0, abs=1e-6)
        if name != "k_g":
            sd = wide.space.log_deviation(wide.mode.covariance, name)
            assert answer.sd == pytest.approx(sd, rel=0.04)
    gains = [s for n, s in width.estimands["c_f"].shares.items() if n.startswith("gain ")]
    assert 0.15 < sum(gains) < 0.4


def test_a_recording_that_is_not_in_counts_has_no_scale() -> None:
    _, recording = counted((1.0, 1.0, 1.0, 1.0))
    car = declared(DECLARED, 0.01)
    sensors = car.sensors_of(recording.channels)
    values = (recording.values - np.array([[s.zero_counts] for s in sensors])) * np.array(
        [[s.counts_scale] for s in sensors]
    )
    told = Recording(recording.time, values, ("m/s^2",) * 4, (), "told.csv")
    lines, _, warnings = prepare_runs((told,), car)
    assert not np.any(lines[0].scale_sd)
    assert sum("is not in counts" in w for w in warnings) == 4
