"""Kinds of recordings: a single one, different rates, an engine, an effect of one run."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from bayes_asv.diagnosis import workflow
from bayes_asv.diagnosis.denoised_model import denoised_model
from bayes_asv.diagnosis.engine import Engine, remove_engine_tones
from bayes_asv.diagnosis.holdout_validation import Split, simulation_errors
from bayes_asv.diagnosis.misspecification_test import MisspecificationResult
from bayes_asv.diagnosis.model_assessment import AssessedModel, assess, refit_shared
from bayes_asv.diagnosis.model_comparison import draw_effects
from bayes_asv.diagnosis.results import DiagnosisResult, NamedEffect
from bayes_asv.diagnosis.unlisted_faults import pulse_sensitivities
from bayes_asv.diagnosis.workflow import diagnose, missing_effects
from bayes_asv.domain.recording import Recording
from bayes_asv.models.effects import AXLES
from bayes_asv.posterior.effect_fit import read_effect, with_effects
from bayes_asv.posterior.fitted_model import fit_linear_car, make_dataset
from tests.battery.cases import Case, case
from tests.diagnosis.models import prepared


@cache
def _with_pulse() -> tuple[AssessedModel, NamedEffect]:
    """A car with a force pulse in one of its runs, which is named."""
    one = case("external_force-4000", 66, 1, "test")
    truth = one.truth.effects[0]
    placed = replace(read_effect(f"external_force@{truth.where}"), run=truth.run)
    dataset, model = with_effects(prepared(one.recordings, one.vehicle), (placed,))
    return assess(dataset, model, 1), NamedEffect(placed, 1.0, (), {})


def _shortened(one: Recording, rows: int) -> Recording:
    return replace(one, time=one.time[:rows], values=one.values[:, :rows])


def _with_rest(one: Recording, rows: int, *, first: bool) -> Recording:
    """A recording with a number of rows at rest before or after it."""
    rng = np.random.default_rng(1)
    rest = one.values[:, :1] + 0.01 * rng.normal(size=(4, rows))
    values = np.concatenate([rest, one.values] if first else [one.values, rest], axis=1)
    step = float(np.median(np.diff(one.time)))
    return replace(one, time=step * np.arange(values.shape[1], dtype=np.float64), values=values)


@pytest.mark.parametrize("rest_first", [True, False])
def test_a_recording_with_one_half_at_rest_is_not_split(rest_first: bool) -> None:
    """Offsets of the sensors that differ are no motion."""
    one = case("null/bump~baja", 5, 0)
    alone = _with_rest(one.recordings[0], 1600, first=rest_first)
    values = alone.values.copy()
    values[0] += 4.0 * float(np.std(one.recordings[0].values[0]))
    whole = replace(alone, values=values)
    fitted, held_out, notes = workflow._split([whole], (), one.vehicle, "half")
    assert (fitted, held_out) == ([whole], [])
    assert len(notes) == 1
    assert notes[0].startswith("no part of")


def test_a_recording_that_is_not_split_is_diagnosed_as_a_whole() -> None:
    one = case("null/bump~baja", 5, 0)
    alone = _with_rest(_shortened(one.recordings[0], 600), 700, first=True)
    diagnosis = diagnose([alone], (), one.vehicle, 1)
    assert diagnosis.verdict == "agreement"
    assert any(w.startswith("no part of") for w in diagnosis.warnings)
    assert diagnosis.holdout == ()
    assert set(diagnosis.errors or {}) == {"fit"}


def test_a_recording_that_moves_throughout_is_split_in_halves() -> None:
    one = case("null/bump~baja", 5, 0)
    first, second = one.recordings
    step = float(np.median(np.diff(first.time)))
    joined = replace(
        first,
        time=np.concatenate([first.time, second.time - second.time[0] + first.time[-1] + step]),
        values=np.concatenate([first.values, second.values], axis=1),
    )
    diagnosis = diagnose([joined], (), one.vehicle, 1)
    assert len(diagnosis.holdout) == len(diagnosis.fitted) == 1


def test_an_effect_beside_something_unexplained_is_not_in_the_model(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assessed, _ = _with_pulse()
    vehicle = assessed.dataset.vehicle
    damper = NamedEffect(read_effect("bound_rebound@front"), 0.99, (), {})
    nothing = MisspecificationResult(score=-3.0, axle="front", p_whiteness=0.4, excess_noise=())
    results = [nothing, replace(nothing, p_unlisted=1e-6)]

    def result(*_: object) -> DiagnosisResult:
        unexplained = results.pop(0)
        return DiagnosisResult(
            "named", (), (), (), vehicle, 0, named=(damper,), unexplained=unexplained
        )

    monkeypatch.setattr(workflow, "diagnose", result)
    assert missing_effects([], vehicle) == (damper.placed,)
    assert missing_effects([], vehicle) == ()


def _with_tone(one: Case, frequency: float, amplitude: float) -> list[Recording]:
    """Recordings with a tone in the chassis; the last one without, at half the rate."""
    out = []
    for run in one.recordings[:-1]:
        values = run.values.copy()
        values[[1, 3]] += amplitude * np.sin(2.0 * np.pi * frequency * run.time)
        out.append(replace(run, values=values))
    slow = one.recordings[-1]
    return [*out, replace(slow, time=slow.time[::2], values=slow.values[:, ::2])]


def test_an_engine_above_the_band_of_a_slow_recording_is_found_in_the_others() -> None:
    one = case("null/bump~baja", 5, 0)
    amplitude = 0.5 * float(np.std(one.recordings[0].values[1]))
    dataset = prepared(_with_tone(one, 105.0, amplitude), one.vehicle)
    _, _, engine, _ = remove_engine_tones(
        dataset, fit_linear_car(dataset), (), fit_linear_car, fit_linear_car
    )
    assert engine is not None
    assert engine.frequency.value == pytest.approx(105.0, abs=0.5)


def test_an_engine_does_not_hide_what_effects_do_to_the_error() -> None:
    one = case("engine_vibration-4000", 5, 0)
    fit, holdout = (prepared(runs, one.vehicle) for runs in (one.recordings, one.holdout))
    given = Split(fit, holdout, fit_linear_car(fit))
    dataset, linear, engine, held = remove_engine_tones(
        fit, given.linear, holdout.recordings, fit_linear_car, fit_linear_car
    )
    assert isinstance(engine, Engine)
    assessed = assess(dataset, linear, 1)
    without_tones = Split(dataset, make_dataset(one.vehicle, held), linear)
    errors = simulation_errors(given, without_tones, assessed, [], engine, 1)
    silent = errors.without_engine
    assert silent is not None
    assert silent.before == silent.after == errors.errors["holdout"].after
    assert errors.errors["holdout"].before > 1.5 * silent.before


def test_an_effect_of_one_run_does_not_act_in_others() -> None:
    assessed, pulse = _with_pulse()
    assert pulse.placed in assessed.model.placed_effects
    assert refit_shared(assessed.model, assessed.dataset).placed_effects == ()


def test_a_free_force_is_added_to_a_named_pulse() -> None:
    """Without the pulse the sensitivities are the same: the car is linear."""
    assessed, pulse = _with_pulse()
    model = assessed.model
    with_pulse = denoised_model(assessed.denoised, model)
    z = model.mode.z.copy()
    force = pulse.placed.coordinate_name(pulse.placed.effect.parameters[0])
    z[model.space.names.index(force)] = 0.0
    zero = replace(model, mode=replace(model.mode, z=z))
    without = denoised_model(assessed.denoised, zero)
    for axle in AXLES:
        one, other = pulse_sensitivities(with_pulse, axle), pulse_sensitivities(without, axle)
        largest = float(np.abs(one).max())
        assert largest > 0.0
        np.testing.assert_allclose(one, other, atol=1e-6 * largest)


def test_draws_of_effects_account_for_tolerances() -> None:
    """A shift of the mode by tolerances shifts the draws."""
    assessed, pulse = _with_pulse()
    model, evidence = assessed.model, assessed.evidence
    force = pulse.placed.effect.parameters[0]
    k = model.space.names.index(pulse.placed.coordinate_name(force))
    shift = np.zeros_like(evidence.mode_shift)
    before = draw_effects(model, replace(evidence, mode_shift=shift), 1)
    shift[k] = 1.0
    after = draw_effects(model, replace(evidence, mode_shift=shift), 1)
    placed = str(pulse.placed)
    moved = np.mean(after[placed]["force"]) - np.mean(before[placed]["force"])
    sizes = model.space.sizes
    assert sizes is not None
    zero, one = force.value(np.array([0.0, 1.0]), sizes)
    assert moved == pytest.approx(float(one - zero), rel=1e-6)
