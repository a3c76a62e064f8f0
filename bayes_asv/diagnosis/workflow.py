"""The discrepancy workflow: from recordings to the effects that the linear car lacks.

1. Data checks, and a fit of the linear car with noise levels near the declared ones.  If it
   explains too little, the input is checked for a misread channel.
2. An engine is recognised by its tones, which are removed.  If another fault may have caused them,
   they are removed only after that fault is named.
3. A score test over all candidate effects: is any missing?
4. Forward selection: the most probable effect is added and everything is fitted again, until no
   effect is missing; effects that turn out to be unnecessary are removed, and all of them if they
   simulate the fitted recordings worse than the linear car does.
5. If the listed effects do not explain everything, free laws of the dampers or springs are tried in
   their place.
6. Validation on held-out recordings with all parameters fixed: an effect that makes the simulation
   worse there is removed, and the selection is continued once.
7. Misspecification tests on all recordings together: does anything remain that is not in the list?
   If so, a regression on unlisted faults joins the model, provided that the held-out error falls.
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
from bayes_asv.diagnosis.recording_faults import (
    channels_with_missing_bits,
    find_recording_faults,
)
from bayes_asv.diagnosis.results import DiagnosisResult, NamedEffect
from bayes_asv.diagnosis.score_test import one_sided_squares
from bayes_asv.diagnosis.simulation_error import compare_errors
from bayes_asv.diagnosis.thresholds import ALTERNATIVE_MARGIN, SIGNIFICANCE_LEVEL
from bayes_asv.diagnosis.unlisted_fault_fit import fit_unlisted_faults
from bayes_asv.domain.clocks import declared_clocks
from bayes_asv.domain.errors import FitError
from bayes_asv.domain.progress import Progress
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.cars import car_model
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.posterior.clock_errors import align_clocks
from bayes_asv.posterior.fit_checks import band_advice, explained_power_findings
from bayes_asv.posterior.fitted_model import (
    Dataset,
    FittedModel,
    fit_linear_car,
    make_dataset,
)
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.posterior.model_error import model_error
from bayes_asv.preprocessing.faulty_channels import with_measured_noise
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.resampling import at_own_rate
from bayes_asv.preprocessing.run_preparation import prepare_runs

__all__ = ["DiagnosisResult", "NamedEffect", "diagnose", "missing_effects"]

# Energy of the tones over the energy that the best candidate explains, below which effects are
# selected before an engine is considered.  A missing effect also leaves lines in the innovations,
# near the car's own frequencies or those of a washboard; an engine alone gives candidates low
# scores (docs/method.md).
_ENGINE_FIRST = 10.0
# Share of the energy that an effect explained which it may leave in lines, being of nearly the
# right form only; the tones of an engine must contain more.
_INEXACT_LAW = 0.03
# Wheel power of a recording's second half over that of its first, for the second to be held out.
_MIN_EXCITATION = 0.3
_MIN_ROWS = 200  # least number of rows of a half that is held out


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
        Declared vehicle and sensors.
    seed : int
        Seed of all draws.
    progress : callable, optional
        Called with the share of the work that is done, and a description of the next step.
    car : str
        Name of the car model, see :data:`bayes_asv.models.cars.CARS`.

    Returns
    -------
    DiagnosisResult
    """
    try:
        return _diagnose(recordings, holdout, vehicle, seed, progress or (lambda *_: None), car)
    except FitError as error:
        return DiagnosisResult("refused", (error.reason,), (), (), vehicle, seed, car=car)


def _diagnose(
    recordings: Sequence[Recording],
    holdout: Sequence[Recording],
    vehicle: Vehicle,
    seed: int,
    progress: Progress,
    car: str,
) -> DiagnosisResult:
    """Diagnose, or raise FitError where no car can be fitted to the recordings."""
    clock = time.perf_counter()
    progress(0.0, "preparing the recordings")
    recordings = [at_own_rate(one) for one in recordings]
    holdout = [at_own_rate(one) for one in holdout]
    fit_runs, holdout_runs, notes = _split(recordings, holdout, vehicle, car)
    fit, reasons, warnings = prepare_runs(fit_runs, vehicle, car=car)
    if reasons:
        return DiagnosisResult("refused", reasons, warnings, (), vehicle, seed, car=car)
    # with noise that is far too low, effects of the car would be named for that of a sensor
    declared = vehicle
    vehicle, noisy = with_measured_noise(fit_runs, declared, car_model(car, declared))
    if noisy:
        fit, warnings = prepare_runs(fit_runs, vehicle, car=car)[0], (*warnings, *noisy)
    holdout_prepared, unusable, _ = (
        prepare_runs(holdout_runs, vehicle, car=car) if holdout_runs else ((), (), ())
    )
    if unusable:
        notes.append("the held-out recordings cannot be used: " + "; ".join(unusable))
        holdout_prepared = ()
    fit, holdout_prepared = (
        _align_runs(runs, prepared, vehicle, car)
        for runs, prepared in ((fit_runs, fit), (holdout_runs, holdout_prepared))
    )
    progress(0.05, f"fitting the linear {car} car")
    dataset = make_dataset(vehicle, fit)
    given = Split(
        dataset,
        make_dataset(vehicle, holdout_prepared) if holdout_prepared else None,
        fit_linear_car(dataset),
    )
    misread_sentence = _misread_channel(given, fit_runs, vehicle, car)
    if misread_sentence is not None:
        reasons = (misread_sentence,)
        return DiagnosisResult("refused", reasons, warnings, (), declared, seed, car=car)
    search = _search(given, holdout_prepared, seed, progress)
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
        missing_bits=channels_with_missing_bits((*fit, *holdout_prepared)),
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
    final = (assessed if regression is None else regression.assessed).on_inputs_as_read
    reasons = _explains_too_little(final)
    if reasons:
        return DiagnosisResult("refused", reasons, warnings, (), declared, seed, car=car)
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
    final_evidence = assessed.evidence
    if unexplained.detected:
        posteriors = [
            one._replace(covariance=one.covariance + model_error(one.model)) for one in posteriors
        ]
        final_evidence = replace(
            final_evidence, covariance=final_evidence.covariance + model_error(assessed.model)
        )
    unnamed = () if regression is None else regression.causes
    dampers, rates = draw_dampers(final, final_evidence, seed, unnamed)
    return DiagnosisResult(
        verdict=verdict,
        reasons=(),
        warnings=(*warnings, *notes),
        recording_faults=find_recording_faults(fit),
        vehicle=declared,
        seed=seed,
        car=car,
        p_value=search.p_value,
        named=named,
        engine=engine,
        p_none=selection.p_none,
        unexplained=unexplained,
        localization=localization,
        unnamed=unnamed,
        errors=errors,
        fitted=fit,
        holdout=search.holdout_runs,
        base_model=search.without_tones.linear,
        final_model=final,
        quantities_before=draw_quantities([before], seed),
        quantities_after={**draw_quantities(posteriors, seed), **rates},
        effect_draws=draw_effects(assessed.model, final_evidence, seed),
        dampers=dampers,
        springs=draw_springs(final, final_evidence, seed),
        seconds=time.perf_counter() - clock,
    )


def _explains_too_little(model: FittedModel) -> tuple[str, ...]:
    """Give the reasons of `estimate` to refuse a model that explains less than half of the motion.

    Recordings of a real car at full band can be so far from the model that noise as declared draws
    the fit to values that no car has.
    """
    out: list[str] = []
    for run, recording in enumerate(model.space.recordings):
        simulated = free_run(model.posterior, model.mode.z, run)
        reasons, _ = explained_power_findings(recording, simulated)
        if reasons:
            out += [*reasons, *band_advice(recording, simulated)]
    return tuple(out)


def _misread_channel(
    given: Split, runs: Sequence[Recording], vehicle: Vehicle, car: str
) -> str | None:
    """Describe a misread channel, if the linear car explains too little.

    Faults that an effect describes, such as a sensor lag or a wrong gain, are left to the search.
    """
    posterior, z = given.linear.posterior, given.linear.mode.z
    findings = [
        explained_power_findings(recording, free_run(posterior, z, run))
        for run, recording in enumerate(given.fit.recordings)
    ]
    if not any(reasons or warnings for reasons, warnings in findings):
        return None
    input_check = check_input(runs, vehicle, car)
    likeliest = input_check.mistakes[:1] if input_check is not None else ()
    return (
        input_check.sentence
        if input_check is not None and any(m.misread for m in likeliest)
        else None
    )


class _Search(NamedTuple):
    """Result of the search for an engine and for missing effects.

    Parameters
    ----------
    selection : Selection
        Selected effects, before the validation.
    engine : Engine or None
        Engine whose tones were removed.
    without_tones : Split
        Recordings without engine tones, and the linear car fitted to them.
    holdout_runs : tuple of PreparedRecording
        The held-out recordings without engine tones.
    p_value : float
        Family-wise p-value of the linear car.
    effect_count : int
        Number of candidate effects, counted once for each place.
    """

    selection: Selection
    engine: Engine | None
    without_tones: Split
    holdout_runs: tuple[PreparedRecording, ...]
    p_value: float
    effect_count: int


def _search(
    given: Split, holdout_runs: tuple[PreparedRecording, ...], seed: int, progress: Progress
) -> _Search:
    """Search for an engine and for missing effects."""
    first = assess(given.fit, given.linear, seed)
    explained = _explained_energy(first)
    dataset, linear, engine, holdout_runs = remove_engine_tones(
        given.fit,
        given.linear,
        holdout_runs,
        fit_linear_car,
        fit_linear_car,
        _ENGINE_FIRST * explained,
    )
    if engine is not None:
        first = assess(dataset, linear, seed)
    start = start_selection(first, engine_found=engine is not None)
    selection = select_effects(start, seed, progress)
    models = first.model, selection.assessed.model
    if selection.effects and compare_errors(dataset, *models, seed, same_runs=True).worse:
        selection = start  # the effects led to a wrong mode
    held_out = _holdout_dataset(given, holdout_runs, engine)
    selection = with_free_laws(selection, first, held_out, seed, progress)
    if engine is None:
        # the missing effects may have hidden an engine
        assessed = selection.assessed
        explained = max(_explained_energy(assessed), _INEXACT_LAW * explained)
        fits = partial(refit, assessed.model), partial(refit_shared, assessed.model)
        removed, model, engine, holdout_runs = remove_engine_tones(
            assessed.dataset, assessed.on_inputs_as_read, holdout_runs, *fits, explained
        )
        if engine is not None:
            dataset, linear = removed, fit_linear_car(removed)
            restarted = replace(selection, assessed=assess(dataset, model, seed), engine_found=True)
            selection = select_effects(restarted, seed, progress)
    split = Split(dataset, _holdout_dataset(given, holdout_runs, engine), linear)
    return _Search(selection, engine, split, holdout_runs, first.p_value, first.test.effect_count)


def _holdout_dataset(
    given: Split, holdout_runs: tuple[PreparedRecording, ...], engine: Engine | None
) -> Dataset | None:
    """Return the held-out recordings, without engine tones if there is an engine."""
    if engine is None or not holdout_runs:
        return given.holdout
    return make_dataset(given.fit.vehicle, holdout_runs)


def _explained_energy(assessed: AssessedModel) -> float:
    """Energy of the innovations that the best candidate, or all tolerances together, explain."""
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
    """Return the effects that an estimate should include."""
    diagnosis = diagnose(recordings, (), vehicle, seed, progress, car)
    return tuple(effect.placed for effect in diagnosis.supported)


def _align_runs(
    runs: Sequence[Recording], recordings: tuple[PreparedRecording, ...], vehicle: Vehicle, car: str
) -> tuple[PreparedRecording, ...]:
    """Prepare runs again with the most probable errors of declared clocks."""
    clocks = declared_clocks(runs, vehicle) if recordings else ()
    if not clocks:
        return recordings
    return prepare_runs(align_clocks(runs, vehicle, clocks, car=car).recordings, vehicle, car=car)[
        0
    ]


def _split(
    recordings: Sequence[Recording], holdout: Sequence[Recording], vehicle: Vehicle, car: str
) -> tuple[list[Recording], list[Recording], list[str]]:
    """Choose the recordings to fit and to hold out, with notes on the choice."""
    if holdout:
        return list(recordings), list(holdout), []
    if len(recordings) > 1:
        last = recordings[-1]
        return list(recordings[:-1]), [last], [f"{last.source} is held out for the validation"]
    recording = recordings[0]
    name = recording.source or "the recording"
    middle = len(recording.time) // 2
    first, second = (
        replace(recording, time=recording.time[half], values=recording.values[:, half])
        for half in (slice(0, middle), slice(middle, None))
    )
    elements = car_model(car, vehicle).elements
    wheels = [recording.channels.index(f"{element.name}_wheel") for element in elements]
    power = [float(np.nanvar(half.values[wheels], axis=1).sum()) for half in (first, second)]
    usable = middle >= _MIN_ROWS and not any(
        prepare_runs([half], vehicle, car=car)[1] for half in (first, second)
    )
    if power[1] > _MIN_EXCITATION * power[0] and usable:
        return [first], [second], [f"the second half of {name} is held out for the validation"]
    return (
        [recording],
        [],
        [f"no part of {name} can be held out for the validation: give a second drive"],
    )
