"""An engine: tones removed without bias, probability, force and frequency against the rig's."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import expit

from bayes_asv.diagnosis.engine import (
    IntervalEstimate,
    _distinct,
    engine_probability,
    estimate_engine_force,
    remove_engine_tones,
)
from bayes_asv.diagnosis.model_assessment import assess
from bayes_asv.diagnosis.score_test import one_sided_squares
from bayes_asv.diagnosis.thresholds import PRIOR_NONE
from bayes_asv.diagnosis.tolerance_prior import with_offset
from bayes_asv.diagnosis.tone_detection import detect_tones
from bayes_asv.models.half_car_equations import HalfCar
from bayes_asv.posterior.fisher_scoring import slopes
from bayes_asv.posterior.fitted_model import FittedModel, fit_linear_car
from bayes_asv.preprocessing.tone_removal import notch_of
from tests.battery.cases import case
from tests.diagnosis.models import fit_linear, prepared


@cache
def _without_tones() -> FittedModel:
    one = case("engine_vibration-400", 5, 0)
    dataset = prepared(one.recordings, one.vehicle)
    _, model, engine, _ = remove_engine_tones(
        dataset, fit_linear_car(dataset), (), fit_linear_car, fit_linear_car
    )
    assert engine is not None
    return model


def test_a_zero_offset_leaves_the_posterior_unchanged() -> None:
    """With removed tones the posterior has a term for the missing band."""
    model = _without_tones()
    z = model.mode.z[None]
    zero = with_offset(model, np.zeros((1, len(model.mode.slopes.nu))), np.zeros(1))
    np.testing.assert_allclose(zero.log_posterior(z), model.posterior.log_posterior(z), atol=1e-6)
    # and the term is large enough to decide
    assert sum(abs(model.posterior.removed_band_correction(z, run)[0]) for run in range(2)) > 20.0


def test_the_gradient_of_noise_levels_accounts_for_the_missing_band() -> None:
    """Against central differences of the log-posterior, 0.01 prior standard deviations wide."""
    model = _without_tones()
    z = model.mode.z + 0.2
    at_z = slopes(model.posterior, z)
    levels = [k for k, name in enumerate(model.space.names) if name.startswith("noise ")]
    assert levels
    ignoring_it = replace(at_z, removed_band_correction=np.zeros(len(z)))
    for k in levels:
        step = 0.01 * np.eye(len(z))[k]
        up, down = model.posterior.log_posterior(np.array([z + step, z - step]))
        expected = (up - down) / 0.02
        assert abs(at_z.gradient(z)[k] - expected) < 0.02 * abs(expected) + 0.1
    assert np.max(np.abs((at_z.gradient(z) - ignoring_it.gradient(z))[levels])) > 1.0


@pytest.mark.parametrize(
    ("name", "engine"),
    [("progressive_spring@rear-4000", False), ("engine_vibration@both-400", True)],
)
def test_lines_near_the_cars_own_frequencies_are_no_engine(name: str, engine: bool) -> None:
    one = case(name, 5, 0)
    dataset, model = fit_linear(prepared(one.recordings, one.vehicle))
    test = assess(dataset, model, 1).test
    explained = float(one_sided_squares(test.standardized_scores, test).max())
    _, _, found, _ = remove_engine_tones(
        dataset, model, (), fit_linear_car, fit_linear_car, explained
    )
    assert (found is not None) == engine


@given(st.floats(-1e4, -1.0), st.floats(0.0, 1e4))
def test_the_probability_rises_as_the_p_value_falls(log_p: float, less: float) -> None:
    rare, rarer = engine_probability(log_p), engine_probability(log_p - less)
    assert 0.0 < engine_probability(0.0) <= rare <= rarer <= 1.0


@given(st.floats(-300.0, -1.01))
def test_the_odds_are_those_of_the_bound(log_p: float) -> None:
    p = math.exp(log_p)
    factor = -1.0 / (math.e * p * math.log(p))
    prior = (1.0 - PRIOR_NONE) / 17.0 / PRIOR_NONE  # sixteen effects, and an engine
    assert math.isclose(engine_probability(log_p), expit(math.log(prior * factor)), rel_tol=1e-9)


def test_a_weak_tone_is_not_certain_and_a_strong_one_is() -> None:
    """A tone at 30 Hz in two runs of 2.5 s; energies 45 and 400, seed 10."""
    rng = np.random.default_rng(10)
    t = np.arange(1000) / 400.0

    def probability(energy: float) -> float:
        size = math.sqrt(energy / 2.0 / 1000.0)
        tone = size * np.sin(2.0 * math.pi * 30.0 * t)[:, None]
        runs = [rng.normal(size=(1000, 2)) + tone for _ in range(2)]
        return engine_probability(detect_tones(runs, 400.0, 10.0, 0.05).log_p)

    weak = [probability(45.0) for _ in range(20)]
    assert float(np.median(weak)) > 0.2
    assert min(weak) < 0.9
    assert all(probability(400.0) > 0.999 for _ in range(5))


def _estimates(
    name: str, frequency: float | None = None
) -> tuple[IntervalEstimate, IntervalEstimate, float, float]:
    """Frequency and amplitude as estimated, and their true values."""
    one = case(name, 93)
    true = {e.name: e.parameters for e in one.truth.effects}.get("engine_vibration", {})
    dataset = prepared(one.recordings, one.vehicle)
    tone = notch_of(frequency or true["frequency"])
    estimates = estimate_engine_force(dataset, fit_linear_car(dataset), [tone])
    return *estimates, tone.frequency, true.get("amplitude", 0.0)


@pytest.mark.parametrize("place", ["front", "rear", "both"])
def test_force_and_frequency_are_estimated_wherever_the_engine_acts(place: str) -> None:
    """Of 24 such engines, seed 93, 23 forces and 20 frequencies lay within their intervals."""
    frequency, amplitude, true, force = _estimates(f"engine_vibration@{place}-400")
    assert frequency.low < frequency.value < frequency.high
    assert frequency.value == pytest.approx(true, abs=0.4)
    assert amplitude.low < force < amplitude.high
    assert amplitude.value == pytest.approx(force, rel=0.15)


def test_noise_alone_is_no_force() -> None:
    _, amplitude, _, _ = _estimates("null", 30.0)
    assert amplitude.low == 0.0
    assert amplitude.value < 0.5 * _estimates("engine_vibration@front-400")[1].value


def test_other_tones_of_an_engine_are_not_taken_for_noise() -> None:
    """Engine orders 1.5, 2 and 2.5: taken for noise they took half of the force."""
    one = case("null", 93)
    rng = np.random.default_rng(3)
    force, orders = 0.3, (40.0, 30.0, 50.0)
    runs = []
    for run in one.recordings:
        values = run.values.copy()
        for frequency in orders:
            phase = 2.0 * np.pi * (frequency * run.time + rng.uniform())
            values[[1, 3]] += force * np.sin(phase)
        runs.append(replace(run, values=values))
    dataset = prepared(runs, one.vehicle)
    tones = [notch_of(f) for f in orders]
    model = fit_linear_car(dataset)
    known = estimate_engine_force(dataset, model, tones)[1].value
    unknown = estimate_engine_force(dataset, model, tones[:1])[1].value
    assert known > 1.3 * unknown
    car = HalfCar(*model.space.cars(model.mode.z[None])[0])
    sensor_filter = np.hypot(1.0, 40.0 / 50.0)
    assert known == pytest.approx(force * sensor_filter * car.m, rel=0.35)


@pytest.mark.parametrize(("front", "rear"), [(0.5, 0.1), (0.1, 0.5), (0.5, -0.1)])
def test_the_net_force_of_an_engine_does_not_depend_on_where_it_sits(
    front: float, rear: float
) -> None:
    """Mass times the acceleration of the centre of gravity, wherever the line of force passes."""
    one = case("null", 93)
    runs = []
    for run in one.recordings:
        values = run.values.copy()
        wave = np.sin(2.0 * np.pi * 30.0 * run.time)
        values[1] += front * wave
        values[3] += rear * wave
        runs.append(replace(run, values=values))
    dataset = prepared(runs, one.vehicle)
    model = fit_linear_car(dataset)
    amplitude = estimate_engine_force(dataset, model, [notch_of(30.0)])[1]
    car = HalfCar(*model.space.cars(model.mode.z[None])[0])
    sensor_filter = np.hypot(1.0, 30.0 / 50.0)
    expected = car.m * (car.wdf * front + (1.0 - car.wdf) * rear) * sensor_filter
    assert amplitude.value == pytest.approx(expected, rel=0.1)
    assert amplitude.low < expected < amplitude.high


def test_a_force_is_shared_by_axles_that_sensors_do_not_tell_apart() -> None:
    """One sensor, or two at one axle; with one above each axle, both forces are estimated."""
    of_front, of_rear = [0.02 + 0.001j, 0.002], [0.003, 0.018 + 0.002j]
    apart = np.array([of_front, of_rear])
    assert _distinct(apart) is apart
    for alike in (apart[:1], apart[[0, 0]]):
        shared = _distinct(alike)
        assert shared.shape == (len(alike), 1)
        np.testing.assert_allclose(shared[:, 0], alike.mean(axis=1))
