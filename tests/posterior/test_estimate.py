"""The posterior on drives of the rig, which shares no code with the model."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Given, Nominal, Sensor, Vehicle
from bayes_asv.estimate_result import EstimationResult
from bayes_asv.estimation import estimate
from bayes_asv.report.documents.estimate import estimate_document
from tests.posterior.cases import DECLARED, EXACT, INCH, case, vehicle
from tests.rig import RigCar, SensorSpec

NAMES = ("c_f", "c_r", "i", "k_g")
Array = NDArray[np.float64]
Runs = list[tuple[RigCar, EstimationResult]]
Change = Callable[[Array, Array], tuple[Array, Array]]


def _with_sensors(car: Vehicle, change: Callable[[Sensor], Sensor]) -> Vehicle:
    return replace(car, sensors={name: change(sensor) for name, sensor in car.sensors.items()})


@pytest.fixture(scope="module")
def exact_runs() -> Runs:
    """Three fresh drives a terrain with exact known values: a short form of the 45-run bench."""
    car = vehicle(EXACT)
    out = []
    for terrain in ("bump", "stops", "rough"):
        for seed in range(3):
            truth, _, recording = case(terrain, 100 + seed, EXACT)
            out.append((truth, estimate([recording], car, seed=seed)))
    return out


def test_exact_known_values_give_a_tenth_of_a_percent(exact_runs: Runs) -> None:
    assert all(result.verdict == "ok" for _, result in exact_runs)
    for name in ("c_f", "c_r", "i"):
        errors = [
            abs(float(np.median(result.draws[name])) / getattr(truth, name) - 1.0)
            for truth, result in exact_runs
        ]
        assert np.median(errors) < 1e-3, name


def test_truth_lies_within_the_claimed_intervals(exact_runs: Runs) -> None:
    """27 deviations in units of the claim: more than four is one in ten thousand."""
    for truth, result in exact_runs:
        for name in ("c_f", "c_r", "i"):
            x = result.draws[name]
            assert abs(float(x.mean()) - getattr(truth, name)) < 4.5 * float(x.std())


def test_ensembles_agree_each_time(exact_runs: Runs) -> None:
    for _, result in exact_runs:
        assert result.rhat_max < 1.01
        assert min(result.ess_bulk_min, result.ess_tail_min) >= 1000.0


def test_uncertain_mass_widens_rates_and_inertia_but_not_the_radius_of_gyration() -> None:
    truth, _, recording = case("stops", 7, DECLARED)
    result = estimate([recording], vehicle(DECLARED))
    spread = {n: float(result.draws[n].std() / result.draws[n].mean()) for n in NAMES}
    assert 0.008 < spread["c_f"] < 0.013
    assert spread["k_g"] < 0.002
    for name in NAMES:
        x = result.draws[name]
        assert abs(float(x.mean()) - getattr(truth, name)) < 4.0 * float(x.std())
    # the springs are measured by the drive, better than they were given
    assert result.draws["k_f"].std() / result.draws["m"].std() < 0.8 * truth.k_f / truth.m * 5.0


def test_same_seed_same_answer_and_another_seed_another_draw() -> None:
    _, _, recording = case("bump", 3, EXACT)
    car = vehicle(EXACT)
    one, two, three = (estimate([recording], car, seed=s) for s in (5, 5, 6))
    assert np.array_equal(one.draws["c_f"], two.draws["c_f"])
    assert not np.array_equal(one.draws["c_f"], three.draws["c_f"])


def test_units_do_not_matter() -> None:
    """The same data in SI units and with SI nominal values give the same posterior."""
    _, _, recording = case("bump", 3, EXACT)
    car = vehicle(EXACT)
    metric = Recording(recording.time, recording.values * INCH, ("m/s^2",) * 4, (), "si")
    one, two = estimate([recording], car), estimate([metric], replace(car, units="SI"))
    for name in NAMES:
        np.testing.assert_allclose(one.draws[name], two.draws[name], rtol=1e-9)


def test_two_runs_together_know_more_than_either() -> None:
    rng_case = [case(terrain, 21, EXACT) for terrain in ("bump", "stops")]
    assert rng_case[0][0] == rng_case[1][0]  # one car, two drives
    car = vehicle(EXACT)
    alone = [estimate([recording], car) for _, _, recording in rng_case]
    both = estimate([recording for _, _, recording in rng_case], car)
    for name in ("c_f", "c_r", "i"):
        sds = [float(result.draws[name].std()) for result in alone]
        pooled = 1.0 / math.sqrt(sum(sd**-2 for sd in sds))
        assert float(both.draws[name].std()) == pytest.approx(pooled, rel=0.25)
        assert abs(both.draws[name].mean() - getattr(rng_case[0][0], name)) < 4.5 * pooled


def test_white_residuals_claim_too_much() -> None:
    """Why the noise of the wheel sensors belongs in the covariance."""
    _, _, recording = case("rough", 4, EXACT)
    car = vehicle(EXACT)
    honest = estimate([recording], car)
    white = estimate([recording], car, likelihood="output-error")
    assert white.verdict == "ok"
    assert float(white.draws["c_f"].std()) < 0.8 * float(honest.draws["c_f"].std())


@pytest.mark.usefixtures("without_input_search")
def test_a_prior_with_a_deviation_is_used() -> None:
    _, _, recording = case("bump", 3, EXACT)
    car = vehicle(EXACT)
    tight = replace(car, i=Nominal(1.2 * car.i.value, 1e-4 * car.i.value))
    result = estimate([recording], tight)
    assert float(result.draws["i"].mean()) == pytest.approx(1.2 * car.i.value, rel=0.01)


def test_missing_rows_uneven_stamps_and_delays_do_not_bias() -> None:
    sensors = replace(SensorSpec(), jitter=2e-4, dropped=0.05)
    truth, run, recording = case("bump", 9, EXACT, sensors=sensors)
    assert len(run.time) < 790
    result = estimate([recording], vehicle(EXACT))
    for name in ("c_f", "c_r", "i"):
        x = result.draws[name]
        assert abs(float(x.mean()) / getattr(truth, name) - 1.0) < 0.006
        assert abs(float(x.mean()) - getattr(truth, name)) < 4.5 * float(x.std())


@pytest.mark.usefixtures("without_input_search")
def test_the_wrong_sign_of_a_delay_shows_what_delays_are_worth() -> None:
    truth, _, recording = case("stops", 2, EXACT)
    car = vehicle(EXACT)
    wrong = _with_sensors(car, lambda sensor: replace(sensor, delay=-sensor.delay))
    result = estimate([recording], wrong)
    errors = [abs(float(result.draws[n].mean()) / getattr(truth, n) - 1.0) for n in NAMES[:3]]
    assert max(errors) > 0.02


def test_sensors_of_different_bandwidth_are_made_equal() -> None:
    sensors = replace(SensorSpec(), bandwidth=(120.0, 50.0, 120.0, 50.0))
    truth, _, recording = case("bump", 12, EXACT, sensors=sensors)
    result = estimate([recording], vehicle(EXACT, sensors))
    for name in ("c_f", "c_r", "i"):
        assert float(result.draws[name].mean()) == pytest.approx(getattr(truth, name), rel=0.004)


@pytest.mark.usefixtures("without_input_search")
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t, v: (t[:120], v[:, :120]), "too short"),
        (lambda t, v: (t[::16], v[:, ::16]), "too slow"),
        (lambda t, v: (t, v * 0.002), "hardly moved"),
        (lambda t, v: (t, v / INCH), "check the unit of the column"),
        (lambda t, v: (t, np.clip(v, -250.0, 250.0)), "end of its range"),
        (lambda t, v: (t, v[[1, 0, 3, 2]]), "explains only"),
        (lambda t, v: (np.where(t > 1.0, t + 0.3, t), v), "gap"),
    ],
    ids=["short", "slow", "parked", "inches", "saturated", "swapped", "gap"],
)
def test_what_cannot_answer_is_refused_in_words(change: Change, words: str) -> None:
    _, _, recording = case("stops", 1, EXACT)
    car = vehicle(EXACT)
    if words == "end of its range":
        limit = 250.0 * INCH
        car = _with_sensors(car, lambda sensor: replace(sensor, low=-limit, high=limit))
    time, values = change(recording.time, recording.values)
    result = estimate([Recording(time, values, recording.units, (), "run.csv")], car)
    assert result.verdict == "refused"
    assert any(words in reason for reason in result.reasons)
    assert all(";" in reason or ":" in reason for reason in result.reasons)  # each has a mend
    assert not result.draws


def test_clipped_samples_are_bounds_not_values() -> None:
    """A handful of clipped samples must not move the answer; as values they would."""
    truth, _, recording = case("stops", 5, EXACT)
    car = vehicle(EXACT)
    top = np.sort(recording.values[1])[-8]
    values = recording.values.copy()
    values[1] = np.minimum(values[1], top)
    clipped = Recording(recording.time, values, recording.units, (), "clipped.csv")
    narrow = replace(car.sensor("front_chassis"), high=top * INCH)
    sensors = {**car.sensors, "front_chassis": narrow}
    bounded = estimate([clipped], replace(car, sensors=sensors))
    assert any("used as bounds" in warning for warning in bounded.warnings)
    for name in ("c_f", "c_r", "i"):
        x = bounded.draws[name]
        assert abs(float(x.mean()) - getattr(truth, name)) < 4.5 * float(x.std())
        assert float(x.mean()) == pytest.approx(getattr(truth, name), rel=0.005)


def test_an_exact_known_value_is_not_sampled() -> None:
    _, _, recording = case("bump", 3, EXACT)
    car = replace(vehicle(EXACT), k_f=Given(vehicle(EXACT).k_f.value, 100.0))
    result = estimate([recording], car)
    assert "k_f" in result.draws
    assert "k_r" not in result.draws
    assert "m" not in result.draws


def test_misuse_is_an_error() -> None:
    car = vehicle(EXACT)
    with pytest.raises(ValueError, match="at least one recording"):
        estimate([], car)
    _, _, recording = case("bump", 3, EXACT)
    with pytest.raises(ValueError, match="likelihood"):
        estimate([recording], car, likelihood="magic")


def test_two_boards_with_clocks_of_their_own_lose_nothing_of_the_report() -> None:
    """Front and rear read at instants of their own, more than a row apart."""
    sensors = replace(SensorSpec(), clock_offset=(0.0, 0.004))
    truth, run, _ = case("stops", 6, EXACT, sensors=sensors)
    declared = (("delay rear_wheel", "0.004 s"), ("delay rear_chassis", "0.004675 s"))
    recording = Recording(run.time, run.channels / INCH, ("in/s^2",) * 4, declared, "two.csv")
    result = estimate([recording], vehicle(EXACT))
    for name in ("c_f", "c_r", "i"):
        x = result.draws[name]
        assert abs(float(x.mean()) - getattr(truth, name)) < 4.5 * float(x.std())
    chassis = estimate_document(result).to_dict()["runs"][0]["chassis"]
    for name in ("front_chassis", "rear_chassis"):
        assert sum(v is not None for v in chassis[name]["measured"]) > 780
        assert 0.0 < chassis[name]["whiteness_p"] < 1.0
        assert chassis[name]["autocorrelation"][0] == pytest.approx(1.0)


def test_readings_that_do_not_overlap_are_refused() -> None:
    _, _, recording = case("stops", 1, EXACT)
    values = recording.values.copy()
    values[0, 60:], values[2, :700] = np.nan, np.nan
    result = estimate(
        [Recording(recording.time, values, recording.units, (), "run.csv")], vehicle(EXACT)
    )
    assert result.verdict == "refused"
    assert any("while the wheels were measured" in reason for reason in result.reasons)


def test_a_hole_in_one_wheel_is_refused_by_name() -> None:
    _, _, recording = case("stops", 1, EXACT)
    values = recording.values.copy()
    values[2, 300:345] = np.nan
    result = estimate(
        [Recording(recording.time, values, recording.units, (), "run.csv")], vehicle(EXACT)
    )
    assert any("rear wheel of run.csv has a gap" in reason for reason in result.reasons)


def test_a_bandwidth_for_some_sensors_only_is_said() -> None:
    _, _, recording = case("bump", 3, EXACT)
    car = vehicle(EXACT)
    front = replace(car.sensor("front_chassis"), bandwidth=None)
    some = replace(car, sensors={**car.sensors, "front_chassis": front})
    result = estimate([recording], some)
    assert any("bandwidth for some sensors only" in warning for warning in result.warnings)
    np.testing.assert_array_equal(result.draws["c_f"], estimate([recording], car).draws["c_f"])
