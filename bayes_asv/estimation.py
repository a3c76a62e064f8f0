"""Estimation: the posterior of a car from recordings."""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import ModuleType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.analysis.damping_rates import (
    MAX_DRAWS,
    DampingRates,
    damping_rates,
    with_equal_power,
)
from bayes_asv.analysis.input_mistakes import InputCheck, check_input
from bayes_asv.analysis.predictive_checks import predictive_checks
from bayes_asv.analysis.run_consistency import (
    MAX_COMPARED,
    RunConsistency,
    compare_runs,
    fit_single_run,
)
from bayes_asv.analysis.spring_curves import spring_curves
from bayes_asv.analysis.uncertainty_budget import find_budget
from bayes_asv.domain.clocks import Clock, check_clocks, clock_of_group, declared_clocks
from bayes_asv.domain.errors import FitError
from bayes_asv.domain.progress import Progress
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.estimate_result import EstimationResult, RunFit
from bayes_asv.filters.kalman import VALUE
from bayes_asv.models.car_model import CarModel
from bayes_asv.models.cars import car_model
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.models.effects.clocks import EFFECT as CLOCK_OFFSET
from bayes_asv.posterior.clock_errors import ClockAlignment, align_clocks, fit_aligned
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.posterior.identifiability import unidentified_before_fit
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.posterior.map_fit import MapFit, best_fit, fit_near_declared_noise
from bayes_asv.posterior.model_error import draw_cars, model_error
from bayes_asv.preprocessing.run_preparation import nothing_in, prepare_runs, select_runs

__all__ = ["LIKELIHOODS", "estimate"]

Array = NDArray[np.float64]

LIKELIHOODS = ("innovations", "output-error")

_STEPS_IN_DOUBT = 120  # largest number of sampler steps if the input has to be corrected anyway
# Shape of independent draws (random effects, or a normal approximation): rows as for ensembles.
_INDEPENDENT_DRAWS = (4, 2500)


def estimate(
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    *,
    likelihood: str = "innovations",
    below: float | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    placed_effects: tuple[PlacedEffect, ...] = (),
    car: str = "half",
) -> EstimationResult:
    """Estimate a car's damping rates and inertias from one or several of its recordings.

    Parameters
    ----------
    recordings : sequence of Recording
        Runs of the same car; each has its own biases, initial state and noise.
    vehicle : Vehicle
        Nominal and given values with their standard deviations.
    likelihood : {'innovations', 'output-error'}
        With the noise of the wheel sensors in the covariance, or with white residuals.
    below : float, optional
        Use only the motion below this frequency (Hz).
    seed : int
        Seed of all draws.
    progress : callable, optional
        Called with the share done and a short text.
    placed_effects : tuple of PlacedEffect
        Effects that the car and its sensors have.
    car : str
        Name of the car model, see :data:`bayes_asv.models.cars.CARS`.

    Returns
    -------
    EstimationResult
        Refusal and lack of convergence are verdicts in the result, not exceptions.

    Raises
    ------
    InputError
        If a channel is in counts without a calibration, or if the band does not contain the modes
        of the car.
    ValueError
        For an unknown likelihood or no recording.
    """
    if likelihood not in LIKELIHOODS:
        raise ValueError(f"likelihood must be one of {', '.join(LIKELIHOODS)}")
    if not recordings:
        raise ValueError("at least one recording is needed")
    start_time = time.perf_counter()
    runs, logs = select_runs(recordings, vehicle, below, car)
    if not logs:
        return _estimate_runs(runs, vehicle, likelihood, below, seed, progress, placed_effects, car)
    model = car_model(car, vehicle)
    empty = tuple(nothing_in(log) for log in logs if not any(event.used for event in log.events))
    warnings = tuple(text for log in logs for text in log.recording.warnings)
    if not runs:
        result = EstimationResult(
            "refused", empty, (), vehicle, model, (), likelihood, seed, 0.0, below=below
        )
    else:
        result = _estimate_runs(
            runs, vehicle, likelihood, below, seed, progress, placed_effects, car
        )
        warnings += empty
    return replace(
        result,
        recordings=tuple(recordings),
        warnings=(*warnings, *result.warnings),
        long_logs=logs,
        seconds=time.perf_counter() - start_time,
    )


class _Task(NamedTuple):
    """Arguments of an estimate from recordings that are used whole."""

    recordings: Sequence[Recording]
    vehicle: Vehicle
    car: CarModel
    likelihood: str
    below: float | None
    seed: int
    placed_effects: tuple[PlacedEffect, ...]
    progress: Progress | None

    def report(self, share: float, words: str) -> None:
        """Report progress."""
        if self.progress is not None:
            self.progress(share, words)


class _ModeAndChecks(NamedTuple):
    """Mode and checks before sampling.

    Parameters
    ----------
    map_fit : MapFit or None
        The mode; None if nothing could be fitted, or if the runs are inconsistent.
    run_consistency : RunConsistency or None
        Comparison of the runs, if there are several.
    alignment : ClockAlignment or None
        The recordings with aligned clocks, if clock errors are declared.
    prepared : bool
        Whether the recordings could be prepared.
    reasons, warnings, notes : tuple of str
        Messages; any reason means that the estimate is refused, and notes follow the warnings of
        the fit.
    model_error : (D, D) array or None
        Covariance of the mode's error due to model misfit; None without misfit.
    input_check : InputCheck or None
        Result of the input check.
    """

    map_fit: MapFit | None
    run_consistency: RunConsistency | None
    alignment: ClockAlignment | None
    prepared: bool
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]
    notes: tuple[str, ...] = ()
    model_error: Array | None = None
    input_check: InputCheck | None = None


def _estimate_runs(
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    likelihood: str,
    below: float | None,
    seed: int,
    progress: Progress | None,
    placed_effects: tuple[PlacedEffect, ...],
    car: str,
) -> EstimationResult:
    """Estimate from recordings that are used whole."""
    start_time = time.perf_counter()
    clocks, placed_effects = _split_clocks(recordings, vehicle, placed_effects)
    model = car_model(car, vehicle)
    task = _Task(recordings, vehicle, model, likelihood, below, seed, placed_effects, progress)
    try:
        result = _estimate_task(task, clocks)
    except FitError as error:
        result = _refused(task, (error.reason,))
    task.report(1.0, "done")
    return replace(result, seconds=time.perf_counter() - start_time)


def _estimate_task(task: _Task, clocks: tuple[Clock, ...]) -> EstimationResult:
    """Estimate, or raise FitError where no car can be fitted to the recordings."""
    with ThreadPoolExecutor(1) as executor:
        # the sampler takes a while to load, while compiled code computes the fit
        loading = executor.submit(importlib.import_module, "bayes_asv.posterior.sampler")
        fit = _add_checks(task, _fit_runs(task, clocks))
        sampler = loading.result()
    if fit.run_consistency is not None and fit.map_fit is None and not fit.reasons:
        task.report(0.9, "the runs do not agree")
        result = _estimate_random_effects(
            fit.run_consistency, task.recordings, task.vehicle, fit.warnings, task.seed, sampler
        )
    elif fit.reasons or fit.map_fit is None:
        mistakes = (
            (fit.input_check.sentence,)
            if fit.input_check is not None and fit.input_check.mistakes
            else ()
        )
        result = replace(
            _refused(task, (*mistakes, *fit.reasons)),
            warnings=fit.warnings,
            run_consistency=fit.run_consistency,
        )
    else:
        result = _sample(task, fit, fit.map_fit, sampler)
    return replace(result, input_check=fit.input_check)


def _refused(task: _Task, reasons: tuple[str, ...]) -> EstimationResult:
    return EstimationResult(
        "refused", reasons, (), task.vehicle, task.car, tuple(task.recordings), task.likelihood,
        task.seed, 0.0, below=task.below,
    )  # fmt: skip


def _fit_runs(task: _Task, clocks: tuple[Clock, ...]) -> _ModeAndChecks:
    """Prepare the recordings, and find the mode of their joint posterior."""
    vehicle, likelihood, placed_effects = task.vehicle, task.likelihood, task.placed_effects
    prepared, reasons, warnings = prepare_runs(task.recordings, vehicle, task.below, task.car.name)
    if reasons:
        return _ModeAndChecks(None, None, None, bool(prepared), reasons, warnings)
    task.report(0.0, "checking what the recordings can tell")
    unidentified = unidentified_before_fit(prepared, vehicle)
    alignment, run_consistency = None, None
    if clocks:
        task.report(0.0, "comparing the clocks")
        alignment = align_clocks(
            task.recordings, vehicle, clocks, task.below, task.car.name, likelihood
        )
        prepared = alignment.prepared
    ambiguity = () if alignment is None or alignment.ambiguity is None else (alignment.ambiguity,)
    task.report(0.0, "looking for the best fit")
    if (
        len(prepared) > 1
        and likelihood == "innovations"  # intervals of the other one are too narrow
        and not placed_effects
        and len(task.car.estimated) <= MAX_COMPARED
    ):
        single_runs = [fit_single_run(one, vehicle, task.seed) for one in prepared]
        run_consistency = compare_runs(single_runs, math.prod(_INDEPENDENT_DRAWS), task.seed)
    if run_consistency is not None and run_consistency.fit_separately:
        warnings += run_consistency.warnings
        notes = (*unidentified, *ambiguity)
        return _ModeAndChecks(
            None, run_consistency, alignment, True, run_consistency.reasons, warnings, notes
        )
    map_fit = (
        best_fit(prepared, vehicle, likelihood, placed_effects)
        if alignment is None
        else fit_aligned(alignment, placed_effects)
    )
    # identifiability at the mode replaces that at nominal values
    notes = (*(() if map_fit.mode.converged else unidentified), *ambiguity)
    return _ModeAndChecks(
        map_fit, run_consistency, alignment, True, map_fit.reasons, warnings, notes
    )


def _add_checks(task: _Task, fit: _ModeAndChecks) -> _ModeAndChecks:
    """Check the model and the input at the mode."""
    map_fit, error, input_check = fit.map_fit, None, None
    full_likelihood = (
        task.below is None and task.likelihood == "innovations" and fit.alignment is None
    )
    if full_likelihood and map_fit is not None and (map_fit.misfit_reasons or task.placed_effects):
        map_fit, error = _refit_with_model_error(map_fit, task.vehicle)
    reasons = fit.reasons if map_fit is None else map_fit.reasons
    if task.below is None and not task.placed_effects and fit.prepared:
        task.report(0.05, "checking the input")
        at_mode = task.recordings if fit.alignment is None else fit.alignment.recordings
        input_check = check_input(at_mode, task.vehicle, task.car.name, refused=bool(reasons))
    if (
        full_likelihood
        and map_fit is not None
        and error is None
        and input_check
        and not input_check.model_holds
    ):
        map_fit, error = _refit_with_model_error(map_fit, task.vehicle)
    fit_warnings = () if map_fit is None else map_fit.warnings
    if fit.alignment is not None and fit.alignment.ambiguity is not None:
        input_check = input_check or InputCheck((), fit.alignment.ambiguity)
    return fit._replace(
        map_fit=map_fit,
        reasons=reasons,
        warnings=(*fit.warnings, *fit_warnings, *fit.notes),
        model_error=error,
        input_check=input_check,
    )


def _sample(
    task: _Task, fit: _ModeAndChecks, map_fit: MapFit, sampler: ModuleType
) -> EstimationResult:
    """Draw from the posterior around its mode, and compute the reported quantities."""
    seed, space, posterior, input_check = (
        task.seed,
        map_fit.space,
        map_fit.posterior,
        fit.input_check,
    )
    warnings = fit.warnings if input_check is None else (input_check.sentence, *fit.warnings)
    task.report(0.1, "sampling")
    if fit.model_error is not None:
        rng, spread = np.random.default_rng([seed, 29]), map_fit.mode.covariance + fit.model_error
        cars = draw_cars(space, map_fit.mode.z, spread, math.prod(_INDEPENDENT_DRAWS), rng)
        ensembles = sampler.independent_draws(posterior, cars.reshape(*_INDEPENDENT_DRAWS, -1))
    else:
        # the expansion in clock errors is too inaccurate for nonlinear force laws
        exact_form = fit.alignment is None or bool(task.placed_effects)
        ensembles = sampler.sample_posterior(
            posterior
            if exact_form
            else posterior.expanded(map_fit.mode.z, map_fit.mode.covariance),
            map_fit.mode,
            seed,
            None
            if task.progress is None
            else lambda share, words: task.report(0.1 + 0.85 * share, words),
            _STEPS_IN_DOUBT
            if input_check is not None and input_check.mistakes
            else sampler.MAX_STEPS,
        )
    if any(placed.effect.free_form for placed in task.placed_effects):
        ensembles = ensembles.thinned(MAX_DRAWS)
    flat = ensembles.draws.reshape(-1, space.dimension)
    by_ensemble = ensembles.log_posterior.shape
    draws = {n: x.reshape(by_ensemble) for n, x in space.quantities(flat, seed).items()}
    if not ensembles.converged:
        warnings += (
            f"the ensembles had not agreed after {ensembles.draws.shape[1]} draws each "
            f"(R̂ {ensembles.rhat_max:.3f}, effective draws "
            f"{min(ensembles.ess_bulk_min, ensembles.ess_tail_min):.0f}); do not trust the "
            "intervals: the recordings may hold motion that the model does not describe",
        )
    dampers = damping_rates(posterior, map_fit.mode.z, flat, draws)
    warnings += tuple(_free_curve_warning(damper) for damper in dampers if damper.free_form)
    clocks_known = fit.alignment is None or not any(fit.alignment.modes)
    is_linear = clocks_known and not task.placed_effects and fit.model_error is None
    return EstimationResult(
        verdict="ok" if ensembles.converged else "not_converged",
        reasons=(),
        warnings=warnings,
        vehicle=task.vehicle,
        car=task.car,
        recordings=tuple(task.recordings),
        likelihood=space.likelihood,
        seed=seed,
        seconds=0.0,
        draws=with_equal_power(draws, dampers),
        nuisance={n: x.reshape(by_ensemble) for n, x in space.nuisance(flat).items()},
        log_posterior=ensembles.log_posterior,
        rhat_max=ensembles.rhat_max,
        ess_bulk_min=ensembles.ess_bulk_min,
        ess_tail_min=ensembles.ess_tail_min,
        acceptance=ensembles.acceptance,
        sampler=ensembles.sampler,
        runs=tuple(
            _run_fit(recording, posterior, flat, run, seed)
            for run, recording in enumerate(task.recordings)
        ),
        space=space,
        uncertainty_budget=find_budget(posterior, map_fit.mode, task.vehicle)
        if ensembles.converged and is_linear
        else None,
        run_consistency=fit.run_consistency,
        below=task.below,
        dampers=dampers,
        springs=spring_curves(posterior, map_fit.mode.z, flat, draws),
        effects={
            placed: {n: x.reshape(by_ensemble) for n, x in values.items()}
            for placed, values in space.effect_draws(flat).items()
        },
    )


def _refit_with_model_error(map_fit: MapFit, vehicle: Vehicle) -> tuple[MapFit, Array | None]:
    """Fit again with noise levels near the declared ones, and compute the model error of that mode.

    The original fit is returned if the new one explains too little, or if there is no model error.
    With a misfit, the search converges less closely, to far within the model error.
    """
    tight_noise_fit = fit_near_declared_noise(map_fit, vehicle)
    assert tight_noise_fit.tight_noise_fit is not None
    error = model_error(tight_noise_fit.tight_noise_fit)
    return (
        (map_fit, None) if tight_noise_fit.reasons or not error.any() else (tight_noise_fit, error)
    )


def _free_curve_warning(damper: DampingRates) -> str:
    return (
        f"the curve of the {damper.element.replace('_', ' ')} damper is free, so that it has no "
        "single rate to hold against the nominal one; the rate above is that of equal power at the "
        f"speeds driven, {damper.speed:.2g} m/s in root mean square"
    )


def _split_clocks(
    recordings: Sequence[Recording], vehicle: Vehicle, placed_effects: tuple[PlacedEffect, ...]
) -> tuple[tuple[Clock, ...], tuple[PlacedEffect, ...]]:
    """Return clocks that are declared or requested as an effect, and the other effects."""
    declared = declared_clocks(recordings, vehicle)
    names = {name for recording in recordings for name in recording.channels}
    declared_names = [names.intersection(clock.channels) for clock in declared]
    requested = [
        clock_of_group(placed.where) for placed in placed_effects if placed.effect is CLOCK_OFFSET
    ]
    new = [clock for clock in requested if names.intersection(clock.channels) not in declared_names]
    clocks = (*declared, *new)
    check_clocks(clocks, "--with clock_offset")
    return clocks, tuple(placed for placed in placed_effects if placed.effect is not CLOCK_OFFSET)


def _estimate_random_effects(
    run_consistency: RunConsistency,
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    warnings: tuple[str, ...],
    seed: int,
    sampler: ModuleType,
) -> EstimationResult:
    """Estimate from inconsistent runs: the mean car, and each run with its own posterior."""
    population = run_consistency.population
    pooled = run_consistency.joint(math.prod(_INDEPENDENT_DRAWS), seed)
    rhat, bulk, tail = sampler.convergence_diagnostics(
        population.centre.reshape(_INDEPENDENT_DRAWS[0], _INDEPENDENT_DRAWS[1], 1, -1)
    )
    return EstimationResult(
        verdict="ok",
        reasons=(),
        warnings=warnings,
        vehicle=vehicle,
        car=run_consistency.space.car,
        recordings=tuple(recordings),
        likelihood=run_consistency.space.likelihood,
        seed=seed,
        seconds=0.0,
        draws={
            n: x.reshape(_INDEPENDENT_DRAWS)
            for n, x in run_consistency.quantities(population.centre, seed).items()
        },
        nuisance=run_consistency.nuisance(_INDEPENDENT_DRAWS, seed),
        log_posterior=population.log_density.reshape(_INDEPENDENT_DRAWS),
        rhat_max=rhat,
        ess_bulk_min=bulk,
        ess_tail_min=tail,
        sampler="random effects",
        runs=tuple(
            _run_fit(recording, single_run.fit.posterior, single_run.z, 0, seed + run)
            for run, (recording, single_run) in enumerate(
                zip(recordings, run_consistency.runs, strict=True)
            )
        ),
        space=run_consistency.space,
        run_consistency=run_consistency,
        below=run_consistency.space.recordings[0].below,
        pooled_draws=run_consistency.quantities(pooled, seed),
    )


def _run_fit(
    recording: Recording, posterior: Posterior, flat: Array, run: int, seed: int
) -> RunFit:
    """Simulate one recording at the posterior mean and for a few draws."""
    prepared = posterior.space.recordings[run]
    centre = flat.mean(axis=0)
    picked = flat[np.linspace(0, len(flat) - 1, 24).astype(int)]
    elements = len(prepared.car.elements)
    simulations = [free_run(posterior, z, run) for z in picked]
    innovations = posterior.innovations(centre, run)
    innovations[prepared.kind != VALUE] = np.nan
    return RunFit(
        recording=recording,
        prepared=prepared,
        free=free_run(posterior, centre, run),
        ensemble=np.stack([one.output for one in simulations]),
        travel=np.stack([one.states[:, 0 : 2 * elements : 2] for one in simulations]),
        velocity=np.stack([one.states[:, 1 : 2 * elements : 2] for one in simulations]),
        innovations=innovations,
        residual_ar=posterior.residual_ars[run],
        # replicates contain only sensor noise; if that explains little, there is nothing to check
        checks=()
        if posterior.space.likelihood == "coloured" or posterior.space.placed_effects
        else predictive_checks(posterior, flat, run, seed),
    )
