"""Clocks that are off: found by the search, and inside their intervals with the car."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.domain.clocks import Clock, declared_clocks, with_declared_clock_error
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording, sample_times
from bayes_asv.estimate_result import EstimationResult
from bayes_asv.estimation import estimate
from bayes_asv.models.cars import car_model
from bayes_asv.posterior.clock_errors import align_clocks, fit_aligned
from bayes_asv.posterior.effect_fit import read_effect
from bayes_asv.posterior.effects import sensor_corrections
from bayes_asv.posterior.likelihood import WHITE, Posterior
from bayes_asv.posterior.map_fit import best_fit
from bayes_asv.posterior.parameters import make_parameter_space
from bayes_asv.preprocessing.prepare import prepare
from bayes_asv.preprocessing.prepared_recording import ClockVariants, interpolation_weights
from benchmarks.clocks import CLOCK, clock_draws, drawn, recorded


def covered(result: EstimationResult, name: str, true: float) -> float:
    """Error of a parameter in its standard deviations."""
    draws = result.draws[name]
    return float(abs(draws.mean() - true) / draws.std())


@pytest.mark.parametrize(("terrain", "offset"), [("bump", 0.012), ("stops", -0.009)])
def test_an_offset_is_found_and_no_longer_biases_the_dampers(terrain: str, offset: float) -> None:
    car, vehicle = drawn(10)
    recording = recorded(car, terrain, 2.0, 400.0, offset, 0.0, 7)
    result = estimate([recording], replace(vehicle, clocks=(CLOCK,)), seed=1)
    assert result.verdict == "ok"
    assert result.input_check is None
    found = clock_draws(result, "offset")
    assert abs(found.mean() - offset) < 4.0 * found.std() < 1e-3
    for name in ("c_f", "c_r", "i"):
        assert covered(result, name, getattr(car, name)) < 4.0, name
        assert result.draws[name].std() < 0.02 * getattr(car, name), name


def test_a_drift_is_found_on_a_long_run() -> None:
    car, vehicle = drawn(10)
    recording = recorded(car, "rough", 30.0, 200.0, -0.006, 40e-6, 3)
    timed = align_clocks([recording], vehicle, (CLOCK,))
    (mode,) = timed.modes[0]
    assert mode.probability == 1.0
    assert np.all(np.abs(mode.value - (-0.006, 40e-6)) < 4.0 * mode.sd)
    assert mode.sd[1] < 2e-6
    fit = fit_aligned(timed)
    at_mode = fit.space.values(fit.mode.z[None])
    for name in ("c_f", "c_r", "i"):
        assert abs(float(at_mode[name][0]) / getattr(car, name) - 1.0) < 0.005, name


def test_a_clock_that_is_right_costs_little() -> None:
    car, vehicle = drawn(12)
    recording = recorded(car, "stops", 2.0, 400.0, 0.0, 0.0, 5)
    without = estimate([recording], vehicle, seed=1)
    declared = estimate([recording], replace(vehicle, clocks=(CLOCK,)), seed=1)
    for name in ("c_f", "c_r", "i"):
        assert covered(declared, name, getattr(car, name)) < 4.0, name
        assert declared.draws[name].std() < 2.0 * without.draws[name].std(), name


def test_the_front_logger_against_the_rear_one() -> None:
    car, vehicle = drawn(14)
    plain = recorded(car, "bump", 2.0, 400.0, 0.0, 0.0, 9)
    clock = Clock("front", ("front_wheel", "front_chassis"), drift_sd=0.0)
    wrong = with_declared_clock_error(
        plain, vehicle, clock, 0.007, 0.0
    )  # declared late, so in truth early
    (mode,) = align_clocks([wrong], vehicle, (clock,)).modes[0]
    # the clock adds to what is declared
    assert abs(mode.value[0] + 0.007) < 4.0 * mode.sd[0] < 1e-3


def test_runs_have_offsets_of_their_own_and_one_drift() -> None:
    car, vehicle = drawn(16)
    runs = [recorded(car, "bump", 2.0, 400.0, offset, 0.0, 1) for offset in (0.01, -0.004)]
    timed = align_clocks(runs, vehicle, (CLOCK,))
    fit = fit_aligned(timed)
    names = [one.name for one in fit.space.coordinates if one.kind == "clock"]
    assert names == ["clock offset phone 0", "clock drift phone", "clock offset phone 1"]
    for run, offset in enumerate((0.01, -0.004)):
        assert abs(fit.space.clock_errors(fit.mode.z[None], run)[0, 0] - offset) < 5e-4


def test_the_likelihood_between_recordings_is_that_of_a_recording_there() -> None:
    car, vehicle = drawn(10)
    recording = recorded(car, "bump", 2.0, 400.0, 0.012, 0.0, 7)
    timed = align_clocks([recording], vehicle, (CLOCK,))
    fit = fit_aligned(timed)
    line = fit.space.recordings[0]
    assert line.clock_variants is not None
    job = timed.jobs[0]
    between = line.clock_variants.middle + (0.7, -0.4) * line.clock_variants.step
    exact, *_ = job.prepared([between, line.clock_variants.middle])
    assert exact.readings == line.readings
    z = fit.mode.z.copy()
    for k, error in zip(fit.space.clock_coordinates(0), between, strict=True):
        one = fit.space.coordinates[k]
        z[k] = (error - one.centre) / one.scale
    value = float(fit.posterior.by_run(z[None])[0, 0])
    there = replace(fit.space, recordings=(exact,))
    alone = float(Posterior(there, (WHITE,)).by_run(z[None])[0, 0])
    assert abs(value - alone) < 0.02
    sampled = fit.posterior.expanded(fit.mode.z, fit.mode.covariance)
    assert abs(float(sampled.by_run(z[None])[0, 0]) - value) < 0.02


def test_sensors_that_are_off_are_corrected_at_the_times_of_each_recording() -> None:
    """With an effect, the likelihood of each clock error is that of the recording made for it."""
    car, vehicle = drawn(10)
    recording = recorded(car, "bump", 2.0, 400.0, 0.012, 0.0, 7)
    (prepared,) = align_clocks([recording], vehicle, (CLOCK,)).prepared
    effects = (read_effect("sensor_lag@front_wheel"),)
    fit = best_fit((prepared,), vehicle, placed_effects=effects)
    assert prepared.clock_variants is not None
    middle, step = prepared.clock_variants.middle, prepared.clock_variants.step
    z = fit.mode.z.copy()
    z[fit.space.names.index(effects[0].coordinate_name(effects[0].effect.parameters[0]))] += 1.0
    for u, one in zip(ClockVariants.points(2), prepared.clock_variants.recordings, strict=True):
        for k, error in zip(fit.space.clock_coordinates(0), middle + step * u, strict=True):
            coordinate = fit.space.coordinates[k]
            z[k] = (error - coordinate.centre) / coordinate.scale
        known = sensor_corrections(one, vehicle, one.reading)
        there = replace(fit.space, recordings=(one,))
        alone = Posterior(there, (WHITE,), sensor_corrections=(known,))
        np.testing.assert_allclose(fit.posterior.by_run(z[None]), alone.by_run(z[None]), atol=1e-6)


def test_a_drift_of_some_ppm_does_not_change_the_steps_of_the_filter() -> None:
    """At 200 Hz the step is the longest that a filter may take."""
    car, vehicle = drawn(10)
    recording = recorded(car, "bump", 2.0, 200.0, 0.0, 0.0, 7)
    recordings = [
        prepare(
            with_declared_clock_error(recording, vehicle, CLOCK, 0.0, drift),
            vehicle,
            car_model("half", vehicle),
        )
        for drift in (-20e-6, 0.0, 20e-6)
    ]
    assert len({len(line.instants) for line in recordings}) == 1


def test_weights_interpolate_polynomials_of_second_degree() -> None:
    rng = np.random.default_rng(3)
    a, b, c = rng.normal(), rng.normal(size=3), rng.normal(size=(3, 3))
    points = np.vstack([np.zeros(3), ClockVariants.points(3)])

    def value(u: np.ndarray) -> np.ndarray:
        return np.asarray(a + u @ b + np.einsum("wi,ij,wj->w", u, c, u))

    u = rng.normal(size=(5, 3))
    np.testing.assert_allclose(interpolation_weights(u) @ value(points), value(u), rtol=1e-10)


def test_sample_times_follow_offset_and_drift() -> None:
    _, vehicle = drawn(0)
    time = np.linspace(0.0, 100.0, 1001)
    recording = Recording(time=time, values=np.zeros((4, 1001)), units=("m/s^2",) * 4)
    later = with_declared_clock_error(recording, vehicle, CLOCK, 0.012, 50e-6)
    change = sample_times(later, vehicle) - sample_times(recording, vehicle)
    np.testing.assert_allclose(change[[0, 2]], 0.0, atol=1e-12)
    np.testing.assert_allclose(change[1], 0.012 - time * 50e-6 / (1.0 + 50e-6), atol=1e-9)


def test_a_recording_may_declare_its_clock() -> None:
    _, vehicle = drawn(0)
    recording = Recording(
        time=np.arange(4.0), values=np.zeros((4, 4)), units=("m/s^2",) * 4,
        metadata=(("unsynchronised", "front_chassis, rear_chassis"),),
    )  # fmt: skip
    (clock,) = declared_clocks([recording], vehicle)
    assert clock.channels == ("front_chassis", "rear_chassis")
    wrong = replace(recording, metadata=(("unsynchronised", "front_chasis"),))
    with pytest.raises(InputError, match="did you mean front_chassis"):
        declared_clocks([wrong], vehicle)
    with pytest.raises(InputError, match="two clocks"):
        declared_clocks([recording], replace(vehicle, clocks=(CLOCK,)))


def test_a_clock_of_all_channels_or_of_none_is_no_unknown() -> None:
    car, vehicle = drawn(10)
    recording = recorded(car, "bump", 2.0, 400.0, 0.0, 0.0, 7)
    clocks = (Clock("all", recording.channels), Clock("none", ("body_pitch_rate",)))
    timed = align_clocks([recording], vehicle, clocks[:1])
    assert timed.modes == ((),)
    assert timed.prepared[0].clock_variants is None
    assert align_clocks([recording], vehicle, clocks[1:]).modes == ((),)
    line = prepare(recording, vehicle, car_model("half", vehicle))
    assert not np.any(make_parameter_space(vehicle, (line,)).origin)


def test_two_possible_offsets_are_both_told_and_no_damper_is_judged(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    car, vehicle = drawn(10)
    recording = recorded(car, "bump", 2.0, 400.0, 0.012, 0.0, 7)
    timed = align_clocks([recording], vehicle, (CLOCK,))
    assert timed.ambiguity is None
    (mode,) = timed.modes[0]
    rival = mode._replace(value=mode.value - (0.02, 0.0), probability=0.3)
    both = replace(timed, modes=((mode._replace(probability=0.7), rival),))
    monkeypatch.setattr("bayes_asv.estimation.align_clocks", lambda *arguments: both)
    result = estimate([recording], replace(vehicle, clocks=(CLOCK,)), seed=1)
    assert result.input_check is not None
    assert any(
        "12 ms later than stamped (probability 0.7)" in text
        and "8 ms earlier than stamped (probability 0.3)" in text
        for text in result.warnings
    )
