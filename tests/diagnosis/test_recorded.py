"""What recordings may be like: one alone, of different rates, an engine in what was held out."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from bayes_asv.diagnosis import workflow
from bayes_asv.diagnosis.denoised_model import clear
from bayes_asv.diagnosis.engine_force import Engine, without_engine
from bayes_asv.diagnosis.holdout_validation import Recorded, proof
from bayes_asv.diagnosis.misspecification_test import Unexplained
from bayes_asv.diagnosis.model_averaging import effect_draws
from bayes_asv.diagnosis.model_search import Model, asked, elsewhere
from bayes_asv.diagnosis.pulse_scan import pulses
from bayes_asv.diagnosis.results import Diagnosis, Named
from bayes_asv.diagnosis.workflow import diagnose, named_in
from bayes_asv.domain.recording import Recording
from bayes_asv.posterior.effect_fit import read_site, with_effects
from bayes_asv.posterior.fitted_model import base, setting
from bayes_asv.posterior.map_fit import lay_out
from tests.battery.cases import Case, case


@cache
def _pushed() -> tuple[Model, Named]:
    """A car that was pushed in one of its runs, which has been named."""
    one = case("external_force-4000", 66, 1, "test")
    truth = one.truth.effects[0]
    site = replace(read_site(f"external_force@{truth.where}"), run=truth.run)
    lines, _, _ = lay_out(one.recordings, one.vehicle)
    where, stage = with_effects(setting(one.vehicle, lines), (site,))
    return asked(where, stage, 1), Named(site, 1.0, (), {})


def _waiting(one: Recording, rows: int, *, first: bool) -> Recording:
    """A recording with so many rows of standing still before or behind it."""
    rng = np.random.default_rng(1)
    still = one.values[:, :1] + 0.01 * rng.normal(size=(4, rows))
    values = np.concatenate([still, one.values] if first else [one.values, still], axis=1)
    step = float(np.median(np.diff(one.time)))
    return replace(one, time=step * np.arange(values.shape[1], dtype=np.float64), values=values)


@pytest.mark.parametrize("waits_first", [True, False])
def test_a_recording_with_half_a_drive_is_not_cut_in_two(waits_first: bool) -> None:
    """In the half that stands nothing moves; zeros of the sensors that differ are no motion."""
    one = case("null/bump~baja", 5, 0)
    alone = _waiting(one.recordings[0], 1600, first=waits_first)
    values = alone.values.copy()
    values[0] += 4.0 * float(np.std(one.recordings[0].values[0]))
    found = diagnose([replace(alone, values=values)], (), one.vehicle, 1)
    assert found.verdict != "refused"
    assert any(w.startswith("nothing of") for w in found.warnings)
    assert found.holdout == ()


def test_a_recording_that_moves_throughout_is_cut_in_two() -> None:
    one = case("null/bump~baja", 5, 0)
    first, second = one.recordings
    step = float(np.median(np.diff(first.time)))
    joined = replace(
        first,
        time=np.concatenate([first.time, second.time - second.time[0] + first.time[-1] + step]),
        values=np.concatenate([first.values, second.values], axis=1),
    )
    found = diagnose([joined], (), one.vehicle, 1)
    assert len(found.holdout) == len(found.fit) == 1


def test_a_name_beside_something_found_is_not_more_likely_than_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    model, _ = _pushed()
    damper = Named(read_site("bound_rebound@front"), 0.99, (), {})
    clean = Unexplained(score=-3.0, axle="front", p_memory=0.4, swollen=())
    left = [clean, replace(clean, p_decoy=1e-6)]

    def found(*_: object) -> Diagnosis:
        car = model.where.vehicle
        return Diagnosis("named", (), (), (), car, 0, named=(damper,), left=left.pop(0))

    monkeypatch.setattr(workflow, "diagnose", found)
    assert named_in([], model.where.vehicle) == (damper.site,)
    assert named_in([], model.where.vehicle) == ()


def _humming_at(one: Case, frequency: float, amplitude: float) -> list[Recording]:
    """Recordings whose chassis hum but for the last, whose logger reads half as often."""
    out = []
    for run in one.recordings[:-1]:
        values = run.values.copy()
        values[[1, 3]] += amplitude * np.sin(2.0 * np.pi * frequency * run.time)
        out.append(replace(run, values=values))
    slow = one.recordings[-1]
    return [*out, replace(slow, time=slow.time[::2], values=slow.values[:, ::2])]


def test_an_engine_above_what_a_slow_recording_holds_is_heard_in_the_others() -> None:
    one = case("null/bump~baja", 5, 0)
    loud = 0.5 * float(np.std(one.recordings[0].values[1]))
    lines, reasons, _ = lay_out(_humming_at(one, 105.0, loud), one.vehicle)
    assert reasons == ()
    where = setting(one.vehicle, lines)
    _, _, engine, _ = without_engine(where, base(where), (), base, base)
    assert engine is not None
    assert engine.frequency.value == pytest.approx(105.0, abs=0.5)


def test_an_engine_does_not_hide_what_names_do_to_the_gap() -> None:
    one = case("engine_vibration-4000", 5, 0)
    lines, _, _ = lay_out(one.recordings, one.vehicle)
    held, _, _ = lay_out(one.holdout, one.vehicle)
    where, given = setting(one.vehicle, lines), setting(one.vehicle, held)
    plain = base(where)
    cut, linear, engine, silent = without_engine(where, plain, held, base, base)
    assert isinstance(engine, Engine)
    model = asked(cut, linear, 1)
    quiet = Recorded(cut, setting(one.vehicle, silent), linear)
    found = proof(Recorded(where, given, plain), quiet, model, [], engine, 1)
    assert found.silent is not None
    assert found.silent.before == found.silent.after == found.gaps["holdout"].after
    assert found.gaps["holdout"].before > 1.5 * found.silent.before


def test_what_acted_in_one_run_does_not_act_elsewhere() -> None:
    model, push = _pushed()
    assert push.site in model.stage.sites
    assert elsewhere(model.stage, model.where).sites == ()


def test_a_force_of_any_course_is_added_to_a_named_push() -> None:
    """Without the push the same pulses have the same signatures: the car is linear."""
    model, push = _pushed()
    quiet = clear(model.quiet, model.stage)
    z = model.stage.mode.z.copy()
    z[model.stage.space.names.index(push.site.coordinate_name(push.site.effect.parameters[0]))] = (
        0.0
    )
    gone = replace(model.stage, mode=replace(model.stage.mode, z=z))
    without = clear(model.quiet, gone)
    for axle in range(2):
        there, alone = pulses(quiet, axle), pulses(without, axle)
        assert np.abs(there).max() > 0.0
        np.testing.assert_allclose(there, alone, atol=1e-6 * float(np.abs(there).max()))


def test_effects_are_told_with_a_little_of_everything_beside_them() -> None:
    model, push = _pushed()
    force = push.site.effect.parameters[0]
    k = model.stage.space.names.index(push.site.coordinate_name(force))
    shift = np.zeros_like(model.allowed.shift)
    before = effect_draws(model.stage, replace(model.allowed, shift=shift), 1)
    shift[k] = 1.0
    after = effect_draws(model.stage, replace(model.allowed, shift=shift), 1)
    moved = np.mean(after[str(push.site)]["force"]) - np.mean(before[str(push.site)]["force"])
    sizes = model.stage.space.sizes
    assert sizes is not None
    one = force.value(np.array([0.0, 1.0]), sizes)
    assert moved == pytest.approx(float(one[1] - one[0]), rel=1e-6)
