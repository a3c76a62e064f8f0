"""Predictive checks: uniform where the model is true, small where something is hidden."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

from bayes_asv.analysis.predictive_checks import Check, predictive_checks
from bayes_asv.analysis.run_consistency import SingleRunFit, fit_single_run
from bayes_asv.domain.recording import Recording
from bayes_asv.filters.noise_simulation import normals_needed, simulate_noise
from bayes_asv.posterior.free_simulation import simulate_free
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.posterior.map_fit import best_fit
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.posterior.cases import EXACT, INCH, as_recording, case, vehicle
from tests.rig import (
    DEFAULT_SPEEDS,
    TERRAINS,
    AsymmetricDamper,
    ChassisForce,
    Push,
    RigCar,
    SensorSpec,
    baja,
    drive,
    with_terms,
)


def alone(recording: Recording, sensors: SensorSpec | None = None) -> SingleRunFit:
    lines, reasons, _ = prepare_runs([recording], vehicle(EXACT, sensors))
    assert not reasons
    return fit_single_run(lines[0], vehicle(EXACT, sensors), 0)


def checks_of(run: SingleRunFit, seed: int = 0) -> tuple[Check, ...]:
    return predictive_checks(run.fit.posterior, run.z, 0, seed)


def driven(
    car: RigCar, forces: Sequence[ChassisForce] = (), terrain: str = "stops"
) -> SingleRunFit:
    run = drive(
        car, TERRAINS[terrain](5), DEFAULT_SPEEDS[terrain], 400.0, 2.0, SensorSpec(), 6,
        forces=forces,
    )  # fmt: skip
    return alone(as_recording(run, "run.csv"))


@pytest.fixture(scope="module")
def plain() -> SingleRunFit:
    return driven(baja())


def test_of_the_model_itself_the_probabilities_are_uniform(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """60 records made by the model (seed 7), start and biases those of a drive at 100 Hz.

    The parameters are those that made the records, so nothing is fitted to them, and one car
    stands for all draws.
    """
    monkeypatch.setattr("bayes_asv.analysis.predictive_checks._CARS", 8)
    _, _, recording = case("stops", 8, EXACT, rate=100.0)
    plain = alone(recording)
    line = plain.fit.space.recordings[0]
    truth = np.repeat(plain.fit.mode.z[None], 50, axis=0)
    car = plain.fit.space.cars(truth[:1])[0]
    system = plain.fit.space.state_space(truth[:1], 0)
    noise = plain.fit.space.noises(truth[:1], 0)
    rng = np.random.default_rng(7)
    normals = rng.standard_normal((len(line.step), 60, normals_needed(2, 2)))
    made = simulate_noise(system, noise, line.measurements, normals)
    output = simulate_free(line, car).output
    found = []
    for k in range(60):
        fresh = replace(line, reading=output + made[:, k])
        where = replace(plain.fit.space, recordings=(fresh,))
        found.append(
            predictive_checks(Posterior(where, plain.fit.posterior.residual_ars), truth, 0, k)
        )
    for column, check in enumerate(found[0]):
        p = [checks[column].p_larger for checks in found]
        if check.of == "residual":  # a reading's start is fitted to the record, not to replicates
            assert kstest(p, "uniform").pvalue > 1e-3, check
    worst = np.array([min(check.p_family for check in checks) for checks in found])
    assert kstest(worst, "uniform").pvalue > 1e-3


def test_a_half_car_passes(plain: SingleRunFit) -> None:
    checks = checks_of(plain)
    assert len(checks) == 20
    assert {check.output for check in checks} == {0, 1}
    assert min(check.p_family for check in checks) > 0.01
    for check in checks:
        low, middle, high = check.replicated
        assert 0.0 < low < middle < high
        assert 0.0 < check.p <= 1.0
        assert check.p_family >= 0.5 * check.p  # what is rare among twenty is rarer alone


def test_statistics_of_the_reading_are_those_of_the_record(plain: SingleRunFit) -> None:
    recording = plain.fit.space.recordings[0]
    checks = checks_of(plain)
    for check in checks:
        y = recording.reading[recording.kind[:, check.output] == 1, check.output]
        if check.of == "reading" and check.band is None:
            wanted = np.abs(y - y.mean()).max() if check.quantity == "peak" else y.std()
            assert check.observed == pytest.approx(float(wanted))
    rms = {c.quantity if c.band is None else c.band[0]: c for c in checks if c.output == 0
           and c.of == "residual"}  # fmt: skip
    parts = np.sqrt(sum(rms[edge].observed ** 2 for edge in (0.5, 5.0, 15.0)))
    assert parts == pytest.approx(rms["rms"].observed, rel=0.15)


@pytest.mark.parametrize("ratio", [1.3, 3.0])
def test_a_hidden_bound_and_rebound_shows_in_what_is_left(ratio: float) -> None:
    car = with_terms(baja(), "front", AsymmetricDamper(baja().c_f, ratio), damper=False)
    far = [c for c in checks_of(driven(car)) if c.p_family < 0.01]
    assert any(c.of == "residual" and c.output == 0 and c.larger for c in far)


def test_a_push_on_the_frame_shows_in_the_body_band() -> None:
    run = driven(baja(), (Push(60.0, 1.2, 0.25, "rear"),))
    checks = checks_of(run)
    body = next(
        c for c in checks if c.output == 1 and c.of == "residual" and c.band == (0.5, 5.0)
    )  # fmt: skip
    assert body.larger
    assert body.p_family < 0.01
    assert body.observed > 1.5 * body.replicated[2]


def test_same_seed_same_probabilities(plain: SingleRunFit) -> None:
    one, two, three = checks_of(plain, 1), checks_of(plain, 1), checks_of(plain, 2)
    assert [c.p for c in one] == [c.p for c in two]
    assert [c.p for c in one] != [c.p for c in three]


def test_missing_rows_and_two_clocks_are_replicated_alike() -> None:
    sensors = replace(SensorSpec(), jitter=2e-4, dropped=0.05, clock_offset=(0.0, 0.004))
    _, run, _ = case("stops", 6, EXACT, sensors=sensors)
    declared = (("delay rear_wheel", "0.004 s"), ("delay rear_chassis", "0.004675 s"))
    recording = Recording(run.time, run.channels / INCH, ("in/s^2",) * 4, declared, "two.csv")
    checks = checks_of(alone(recording))
    assert len(checks) == 20
    assert min(check.p_family for check in checks) > 1e-3


def test_a_slow_record_has_no_band_above_what_it_can_hold() -> None:
    _, _, recording = case("bump", 3, EXACT)
    slow = replace(recording, time=recording.time[::8], values=recording.values[:, ::8])
    line = prepare_runs([slow], vehicle(EXACT))[0][0]
    fit = best_fit((line,), vehicle(EXACT))
    checks = predictive_checks(fit.posterior, np.repeat(fit.mode.z[None], 8, axis=0), 0, 0)
    bands = {check.band for check in checks if check.band is not None}
    assert max(high for _, high in bands) == pytest.approx(25.0, rel=1e-6)


def test_clipped_readings_do_not_make_a_peak_too_small() -> None:
    """Replicates are cut off where the sensor was."""
    _, _, recording = case("stops", 5, EXACT)
    top = np.sort(recording.values[1])[-8]
    values = recording.values.copy()
    values[1] = np.minimum(values[1], top)
    car = vehicle(EXACT)
    narrow = replace(car.sensor("front_chassis"), high=top * INCH)
    car = replace(car, sensors={**car.sensors, "front_chassis": narrow})
    lines, _, _ = prepare_runs([replace(recording, values=values)], car)
    run = fit_single_run(lines[0], car, 0)
    peak = next(c for c in checks_of(run) if c.output == 0 and c.quantity == "peak")
    assert peak.of == "reading"
    assert peak.p_family > 0.01
