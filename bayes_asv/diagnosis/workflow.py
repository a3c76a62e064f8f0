"""The discrepancy workflow: from recordings to the effects that the linear car lacks.

1. Preflight, and a fit of the linear car with noise levels near the given ones; where it explains
   too little, the input is checked for a channel that is not what it is taken for.
2. An engine is recognised by its tones, which are removed; where they may belong to another fault,
   only once that is named.
3. One test over all candidate effects: is any missing?
4. Forward selection: the most probable effect is added and everything is fitted again, until no
   effect is missing; effects that turned out unnecessary are removed.
5. Where something is left that no effect of the list explains, free laws of the dampers or springs
   are tried in the place of the named effects.
6. Validation on held-out recordings with everything frozen: an effect that makes the simulation
   worse there is removed, and another is selected once.
7. Misspecification tests on all recordings together: is anything left that is not in the list?
   What is found joins the model without a name, where that makes the held-out error smaller.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from bayes_asv.analysis.input_mistakes import check_input
from bayes_asv.diagnosis.engine import Engine, remove_engine_tones
from bayes_asv.diagnosis.forward_selection import (
    Progress,
    Selection,
    select_effects,
    start_selection,
    with_indistinguishable,
)
from bayes_asv.diagnosis.free_laws import with_free_laws
from bayes_asv.diagnosis.holdout_validation import Split, validate
from bayes_asv.diagnosis.localization import localize
from bayes_asv.diagnosis.misspecification_test import best_alternative, misspecification_tests
from bayes_asv.diagnosis.model_assessment import (
    AssessedModel,
    assess,
    fit_pooled,
    refit,
    refit_shared,
)
from bayes_asv.diagnosis.model_comparison import (
    WeightedPosterior,
    draw_dampers,
    draw_effects,
    draw_quantities,
    draw_springs,
    weighted_posterior,
)
from bayes_asv.diagnosis.recording_faults import find_recording_faults
from bayes_asv.diagnosis.remainder import fit_unlisted_faults
from bayes_asv.diagnosis.results import DiagnosisResult, NamedEffect
from bayes_asv.diagnosis.score_test import one_sided_squares
from bayes_asv.diagnosis.thresholds import ALTERNATIVE_MARGIN, SIGNIFICANCE_LEVEL
from bayes_asv.domain.clocks import declared_clocks
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.cars import car_model
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.posterior.clock_errors import align_clocks
from bayes_asv.posterior.fit_checks import explained_power_findings
from bayes_asv.posterior.fitted_model import Dataset, fit_linear_car, make_dataset
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.posterior.model_error import model_error
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.resampling import at_own_rate
from bayes_asv.preprocessing.run_preparation import prepare_runs

__all__ = ["DiagnosisResult", "NamedEffect", "diagnose", "missing_effects"]

# A car that lacks an effect has lines in its innovations as well, near its own frequencies or those
# of a washboard, while an engine alone gives candidates little (docs/method.md): where the tones
# hold less than ten times the energy that the best candidate explains, effects are named first.
_ENGINE_FIRST = 10.0
_INEXACT_LAW = 0.03  # of that energy, which a named effect of nearly the right form leaves in lines
# Wheel power of a recording's second half over that of its first, for the second to be held out.
_MIN_EXCITATION = 0.3
_MIN_ROWS = 200  # of a half that is held out


def diagnose(
    recordings: Sequence[Recording],
    holdout: Sequence[Recording],
    vehicle: Vehicle,
    seed: int = 0,
    progress: Progress | None = None,
    car: str = "half",
) -> DiagnosisResult:
    """Find where simulation and measurement disagree, and which effects are missing.

    Parameters
    ----------
    recordings : sequence of Recording
        Runs to fit.
    holdout : sequence of Recording
        Runs for the validation; without any, part of the others is held out.
    vehicle : Vehicle
        As given.
    seed : int
        Seed of all draws.
    progress : callable, optional
        Called with the share of the work that is done, and what follows.
    car : str
        Name of the car model, see :data:`bayes_asv.models.cars.CARS`.

    Returns
    -------
    DiagnosisResult
    """
    clock = time.perf_counter()
    progress = progress or (lambda share, text: None)
    progress(0.0, "preparing the recordings")
    recordings = [at_own_rate(one) for one in recordings]
    holdout = [at_own_rate(one) for one in holdout]
    fit_runs, holdout_runs, notes = _split(recordings, holdout, vehicle, car)
    fit, reasons, warnings = prepare_runs(fit_runs, vehicle, car=car)
    if reasons:
        return DiagnosisResult("refused", reasons, warnings, (), vehicle, seed, car=car)
    held, unusable, _ = (
        prepare_runs(holdout_runs, vehicle, car=car) if holdout_runs else ((), (), ())
    )
    if unusable:
        notes.append("the held-out recordings cannot be used: " + "; ".join(unusable))
        held = ()
    fit, held = (
        _synchronised(runs, prepared, vehicle, car)
        for runs, prepared in ((fit_runs, fit), (holdout_runs, held))
    )
    progress(0.05, f"fitting the linear {car} car")
    dataset = make_dataset(vehicle, fit)
    given = Split(dataset, make_dataset(vehicle, held) if held else None, fit_linear_car(dataset))
    misread = _misread_channel(given, fit_runs, vehicle, car)
    if misread is not None:
        return DiagnosisResult("refused", (misread,), warnings, (), vehicle, seed, car=car)
    search = _search(given, held, seed, progress)
    localization = localize(search.without_tones.fit, search.without_tones.linear)
    validated = validate(
        search.selection, given, search.without_tones, search.engine, seed, progress
    )
    selection = validated.selection
    assessed, named = selection.assessed, selection.effects
    progress(0.9, "testing for faults that are not in the list")
    pooled, model, evidence = fit_pooled(assessed, search.without_tones.holdout)
    unexplained = replace(
        misspecification_tests(pooled, evidence, seed),
        failed=validated.failed,
        stopped_by=selection.stopped_by,
    )
    if named:
        alternative, fault = best_alternative(pooled, model, len(named), search.effect_count)
        unexplained = replace(unexplained, alternative=alternative)
        if alternative > ALTERNATIVE_MARGIN and not unexplained.detected:
            unexplained = replace(unexplained, closest_fault=fault)
    regression, errors = None, validated.errors
    if unexplained.detected:
        progress(0.92, "adding to the model what is left")
        remainder = fit_unlisted_faults(
            assessed, len(named), search.effect_count, search.without_tones, errors, seed
        )
        regression, errors = remainder.regression, remainder.errors
        alternative = max(unexplained.alternative, remainder.alternative)
        unexplained = replace(unexplained, alternative=alternative)
    progress(0.95, "looking for indistinguishable explanations")
    named = with_indistinguishable(assessed, named)
    posteriors = selection.posteriors
    if regression is not None:
        assessed = regression.assessed
        posteriors = weighted_posterior(assessed.model, assessed.evidence)
    verdict = "agreement"
    engine = search.engine
    if search.p_value < SIGNIFICANCE_LEVEL or unexplained.present or engine is not None:
        verdict = "named" if named or engine is not None else "unexplained"
    linear = given.linear
    before = WeightedPosterior(1.0, linear, linear.mode.z, linear.mode.covariance)
    final = assessed.on_inputs_as_read
    spread = assessed.evidence
    if unexplained.detected:
        posteriors = [
            one._replace(covariance=one.covariance + model_error(one.model)) for one in posteriors
        ]
        spread = replace(spread, covariance=spread.covariance + model_error(assessed.model))
    dampers, rates = draw_dampers(final, spread, seed)
    return DiagnosisResult(
        verdict=verdict,
        reasons=(),
        warnings=(*warnings, *notes),
        recording_faults=find_recording_faults(fit),
        vehicle=vehicle,
        seed=seed,
        car=car,
        p_value=search.p_value,
        named=named,
        engine=engine,
        p_none=selection.p_none,
        unexplained=unexplained,
        localization=localization,
        unnamed=() if regression is None else regression.causes,
        errors=errors,
        training=fit,
        holdout=search.held,
        base_model=search.without_tones.linear,
        final_model=final,
        quantities_before=draw_quantities([before], seed),
        quantities_after={**draw_quantities(posteriors, seed), **rates},
        effect_draws=draw_effects(assessed.model, spread, seed),
        dampers=dampers,
        springs=draw_springs(final, spread, seed),
        seconds=time.perf_counter() - clock,
    )


def _misread_channel(
    given: Split, runs: Sequence[Recording], vehicle: Vehicle, car: str
) -> str | None:
    """Say which channel is not what it is taken for, where the linear car explains too little.

    What an effect describes, such as a sensor that is late or out of calibration, is left to the
    search.
    """
    posterior, z = given.linear.posterior, given.linear.mode.z
    short = [
        explained_power_findings(recording, free_run(posterior, z, run))
        for run, recording in enumerate(given.fit.recordings)
    ]
    if not any(reasons or warnings for reasons, warnings in short):
        return None
    doubt = check_input(runs, vehicle, car)
    likeliest = doubt.mistakes[:1] if doubt is not None else ()
    return doubt.sentence if doubt is not None and any(m.misread for m in likeliest) else None


class _Search(NamedTuple):
    """Engine and effects that were found.

    Parameters
    ----------
    selection : Selection
        Selected effects, before the validation.
    engine : Engine or None
        Whose tones were removed.
    without_tones : Split
        Recordings without engine tones, and the linear car there.
    held : tuple of PreparedRecording
        The held-out recordings without engine tones.
    p_value : float
        Family-wise p-value of the linear car.
    effect_count : int
        Number of effects, each at each place, that were selected from.
    """

    selection: Selection
    engine: Engine | None
    without_tones: Split
    held: tuple[PreparedRecording, ...]
    p_value: float
    effect_count: int


def _search(
    given: Split, held: tuple[PreparedRecording, ...], seed: int, progress: Progress
) -> _Search:
    """Search for an engine and for missing effects."""
    first = assess(given.fit, given.linear, seed)
    explained = _explained_energy(first)
    dataset, linear, engine, held = remove_engine_tones(
        given.fit, given.linear, held, fit_linear_car, fit_linear_car, _ENGINE_FIRST * explained
    )
    if engine is not None:
        first = assess(dataset, linear, seed)
    start = start_selection(first, other_cause=engine is not None)
    selection = select_effects(start, seed, progress)
    held_out = _held_out(given, held, engine)
    selection = with_free_laws(selection, first, held_out, seed, progress)
    if engine is None:
        # the missing effects may have hidden an engine
        assessed = selection.assessed
        explained = max(_explained_energy(assessed), _INEXACT_LAW * explained)
        fits = partial(refit, assessed.model), partial(refit_shared, assessed.model)
        removed, model, engine, held = remove_engine_tones(
            assessed.dataset, assessed.on_inputs_as_read, held, *fits, explained
        )
        if engine is not None:
            dataset, linear = removed, fit_linear_car(removed)
            again = replace(selection, assessed=assess(dataset, model, seed), other_cause=True)
            selection = select_effects(again, seed, progress)
    split = Split(dataset, _held_out(given, held, engine), linear)
    return _Search(selection, engine, split, held, first.p_value, first.test.effect_count)


def _held_out(
    given: Split, held: tuple[PreparedRecording, ...], engine: Engine | None
) -> Dataset | None:
    """Held-out recordings, without the tones of an engine that was found."""
    if engine is None or not held:
        return given.holdout
    return make_dataset(given.fit.vehicle, held)


def _explained_energy(assessed: AssessedModel) -> float:
    """Energy of innovations that the best candidate, or all tolerances, explain."""
    test, by_scale = assessed.test, assessed.evidence.by_scale
    best = float(one_sided_squares(test.standardized_scores, test).max())
    return max(best, 2.0 * float(by_scale.max() - by_scale[0]))


def missing_effects(
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    seed: int = 0,
    progress: Progress | None = None,
    car: str = "half",
) -> tuple[PlacedEffect, ...]:
    """Effects that are more probable than not, for an estimate with them in the model."""
    diagnosis = diagnose(recordings, (), vehicle, seed, progress, car)
    return tuple(e.placed for e in diagnosis.named if diagnosis.probability_of(e) > 0.5)


def _synchronised(
    runs: Sequence[Recording], recordings: tuple[PreparedRecording, ...], vehicle: Vehicle, car: str
) -> tuple[PreparedRecording, ...]:
    """Prepare runs again at the most probable errors of the clocks that are declared."""
    clocks = declared_clocks(runs, vehicle) if recordings else ()
    if not clocks:
        return recordings
    return prepare_runs(align_clocks(runs, vehicle, clocks, car=car).recordings, vehicle, car=car)[
        0
    ]


def _split(
    recordings: Sequence[Recording], holdout: Sequence[Recording], vehicle: Vehicle, car: str
) -> tuple[list[Recording], list[Recording], list[str]]:
    """Choose the recordings that are fitted and held out, with notes on the choice."""
    if holdout:
        return list(recordings), list(holdout), []
    if len(recordings) > 1:
        last = recordings[-1]
        return list(recordings[:-1]), [last], [f"{last.source} is held out for the validation"]
    whole = recordings[0]
    name = whole.source or "the recording"
    middle = len(whole.time) // 2
    first, second = (
        replace(whole, time=whole.time[half], values=whole.values[:, half])
        for half in (slice(0, middle), slice(middle, None))
    )
    elements = car_model(car, vehicle).elements
    wheels = [whole.channels.index(f"{element.name}_wheel") for element in elements]
    power = [float(np.nanvar(half.values[wheels], axis=1).sum()) for half in (first, second)]
    usable = middle >= _MIN_ROWS and not any(
        prepare_runs([half], vehicle, car=car)[1] for half in (first, second)
    )
    if power[1] > _MIN_EXCITATION * power[0] and usable:
        return [first], [second], [f"the second half of {name} is held out for the validation"]
    return (
        [whole],
        [],
        [f"no part of {name} can be held out for the validation: give a second drive"],
    )
