"""Estimation: the posterior of a car from recordings."""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable, Sequence
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
from bayes_asv.preprocessing.run_preparation import prepare_runs
from bayes_asv.preprocessing.run_selection import nothing_in, select_runs

__all__ = ["LIKELIHOODS", "estimate"]

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]

LIKELIHOODS = ("innovations", "output-error")

_STEPS_IN_DOUBT = 120  # of the sampler, for an input that has to be corrected first anyway
_APART = (4, 2500)  # draws where runs do not agree: independent, in as many rows as ensembles


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
    """Posterior of a car's damping rates and inertias from one or several of its recordings.

    Parameters
    ----------
    recordings : sequence of Recording
        Runs of the same car; each has its own biases, initial state and noise.
    vehicle : Vehicle
        Nominal and known values with their deviations.
    likelihood : {'innovations', 'output-error'}
        With the noise of the wheel sensors in the covariance, or with white residuals.
    below : float, optional
        Use the motion below this frequency (Hz) alone.
    seed : int
        Same seed, same answer.
    progress : callable, optional
        Told the share done and a few words.
    placed_effects : tuple of PlacedEffect
        Effects that the car and its sensors have.
    car : str
        Name of the car model, see :data:`bayes_asv.models.cars.CARS`.

    Returns
    -------
    EstimationResult
        Refusal and lack of convergence are verdicts in it, not exceptions.

    Raises
    ------
    InputError
        When a channel is in counts and the vehicle lacks its calibration, or the car's own
        motion is not below the frequency.
    ValueError
        For an unknown likelihood or no recording.
    """
    if likelihood not in LIKELIHOODS:
        raise ValueError(f"likelihood must be one of {', '.join(LIKELIHOODS)}")
    if not recordings:
        raise ValueError("at least one recording is needed")
    began = time.perf_counter()
    runs, logs = select_runs(recordings, vehicle, below, car)
    if not logs:
        return _estimate_runs(runs, vehicle, likelihood, below, seed, progress, placed_effects, car)
    model = car_model(car, vehicle)
    empty = tuple(nothing_in(log) for log in logs if not any(event.used for event in log.events))
    warnings = tuple(text for log in logs for text in log.recording.warnings)
    if not runs:
        found = EstimationResult(
            "refused", empty, (), vehicle, model, (), likelihood, seed, 0.0, below=below
        )
    else:
        found = _estimate_runs(
            runs, vehicle, likelihood, below, seed, progress, placed_effects, car
        )
        warnings += empty
    return replace(
        found,
        recordings=tuple(recordings),
        warnings=(*warnings, *found.warnings),
        long_logs=logs,
        seconds=time.perf_counter() - began,
    )


class _Task(NamedTuple):
    """What is asked for, of recordings that are taken whole."""

    recordings: Sequence[Recording]
    vehicle: Vehicle
    car: CarModel
    likelihood: str
    below: float | None
    seed: int
    placed_effects: tuple[PlacedEffect, ...]
    progress: Progress | None

    def tell(self, share: float, words: str) -> None:
        """Report progress."""
        if self.progress is not None:
            self.progress(share, words)


class _ModeAndChecks(NamedTuple):
    """What is known before anything is sampled.

    Parameters
    ----------
    map_fit : MapFit or None
        The mode; None where nothing could be fitted, or the runs do not agree.
    run_consistency : RunConsistency or None
        Comparison of the runs, where there are several.
    timed : ClockAlignment or None
        The recordings with their clocks compared, where errors of clocks are declared.
    prepared : bool
        Whether there are recordings to look at.
    reasons, warnings, notes : tuple of str
        Any reason means that the data cannot answer; notes follow the warnings of the fit.
    model_error : (D, D) array or None
        Covariance of what the mode may be off because of the model; None where it lacks nothing.
    input_check : Doubt or None
        Whether an input is wrong.
    """

    map_fit: MapFit | None
    run_consistency: RunConsistency | None
    timed: ClockAlignment | None
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
    """Estimate from recordings that are taken whole."""
    began = time.perf_counter()
    model = car_model(car, vehicle)
    clocks, placed_effects = _clocks(recordings, vehicle, placed_effects)
    task = _Task(recordings, vehicle, model, likelihood, below, seed, placed_effects, progress)
    with ThreadPoolExecutor(1) as other:
        # The sampler takes a while to load; compiled code fits in the meantime.
        loading = other.submit(importlib.import_module, "bayes_asv.posterior.sampler")
        fit = _checked(task, _fit(task, clocks))
        sampler = loading.result()
    if fit.run_consistency is not None and fit.map_fit is None and not fit.reasons:
        task.tell(0.9, "the runs do not agree")
        answer = _estimate_random_effects(
            fit.run_consistency, recordings, vehicle, fit.warnings, seed, sampler
        )
    elif fit.reasons or fit.map_fit is None:
        mistaken = (
            (fit.input_check.sentence,)
            if fit.input_check is not None and fit.input_check.mistakes
            else ()
        )
        answer = EstimationResult(
            "refused", (*mistaken, *fit.reasons), fit.warnings, vehicle, model, tuple(recordings),
            likelihood, seed, 0.0, run_consistency=fit.run_consistency, below=below,
        )  # fmt: skip
    else:
        answer = _sampled(task, fit, fit.map_fit, sampler)
    task.tell(1.0, "done")
    return replace(answer, input_check=fit.input_check, seconds=time.perf_counter() - began)


def _fit(task: _Task, clocks: tuple[Clock, ...]) -> _ModeAndChecks:
    """Prepare the recordings, and find the mode of what they have in common."""
    vehicle, likelihood, placed_effects = task.vehicle, task.likelihood, task.placed_effects
    prepared, reasons, warnings = prepare_runs(task.recordings, vehicle, task.below, task.car.name)
    if reasons:
        return _ModeAndChecks(None, None, None, bool(prepared), reasons, warnings)
    task.tell(0.0, "checking what the recordings can tell")
    unidentified = unidentified_before_fit(prepared, vehicle)
    timed, agreement = None, None
    if clocks:
        task.tell(0.0, "comparing the clocks")
        timed = align_clocks(
            task.recordings, vehicle, clocks, task.below, task.car.name, likelihood
        )
        prepared = timed.prepared
    ambiguity = () if timed is None or timed.ambiguity is None else (timed.ambiguity,)
    task.tell(0.0, "looking for the best fit")
    if (
        len(prepared) > 1
        and likelihood == "innovations"  # the other form claims too much
        and not placed_effects
        and len(task.car.estimated) <= MAX_COMPARED
    ):
        alone = [fit_single_run(one, vehicle, task.seed) for one in prepared]
        agreement = compare_runs(alone, math.prod(_APART), task.seed)
    if agreement is not None and agreement.fit_separately:
        warnings += agreement.warnings
        notes = (*unidentified, *ambiguity)
        return _ModeAndChecks(None, agreement, timed, True, agreement.reasons, warnings, notes)
    found = (
        best_fit(prepared, vehicle, likelihood, placed_effects)
        if timed is None
        else fit_aligned(timed, placed_effects)
    )
    # At the mode the same is known better than at nominal values.
    notes = (*(() if found.mode.converged else unidentified), *ambiguity)
    return _ModeAndChecks(found, agreement, timed, True, found.reasons, warnings, notes)


def _checked(task: _Task, fit: _ModeAndChecks) -> _ModeAndChecks:
    """Check the model and the input at the mode."""
    found, error, doubt = fit.map_fit, None, None
    whole = task.below is None and task.likelihood == "innovations" and fit.timed is None
    if whole and found is not None and (found.misfit_reasons or task.placed_effects):
        found, error = _with_model_error(found, task.vehicle)
    reasons = fit.reasons if found is None else found.reasons
    if task.below is None and not task.placed_effects and fit.prepared:
        task.tell(0.05, "checking the input")
        at_mode = task.recordings if fit.timed is None else fit.timed.recordings
        doubt = check_input(at_mode, task.vehicle, task.car.name, refused=bool(reasons))
    if whole and found is not None and error is None and doubt and not doubt.model_holds:
        found, error = _with_model_error(found, task.vehicle)
    own = () if found is None else found.warnings
    if fit.timed is not None and fit.timed.ambiguity is not None:
        doubt = doubt or InputCheck((), fit.timed.ambiguity)
    return fit._replace(
        map_fit=found,
        reasons=reasons,
        warnings=(*fit.warnings, *own, *fit.notes),
        model_error=error,
        input_check=doubt,
    )


def _sampled(
    task: _Task, fit: _ModeAndChecks, found: MapFit, sampler: ModuleType
) -> EstimationResult:
    """Draw from the posterior around its mode, and compute what is reported of it."""
    seed, space, posterior, doubt = task.seed, found.space, found.posterior, fit.input_check
    warnings = fit.warnings if doubt is None else (doubt.sentence, *fit.warnings)
    task.tell(0.1, "sampling")
    if fit.model_error is not None:
        rng, spread = np.random.default_rng([seed, 29]), found.mode.covariance + fit.model_error
        cars = draw_cars(space, found.mode.z, spread, math.prod(_APART), rng)
        ensembles = sampler.independent_draws(posterior, cars.reshape(*_APART, -1))
    else:
        # the parameters of a force law are too far from linear for an expansion at the mode
        exact_form = fit.timed is None or bool(task.placed_effects)
        ensembles = sampler.sample_posterior(
            posterior if exact_form else posterior.expanded(found.mode.z, found.mode.covariance),
            found.mode,
            seed,
            None
            if task.progress is None
            else lambda share, words: task.tell(0.1 + 0.85 * share, words),
            _STEPS_IN_DOUBT if doubt is not None and doubt.mistakes else sampler.MAX_STEPS,
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
    dampers = damping_rates(posterior, found.mode.z, flat, draws)
    warnings += tuple(_no_single_rate(damper) for damper in dampers if damper.free_form)
    clocks_known = fit.timed is None or not any(fit.timed.modes)
    exact = clocks_known and not task.placed_effects and fit.model_error is None
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
        uncertainty_budget=find_budget(posterior, found.mode, task.vehicle)
        if ensembles.converged and exact
        else None,
        run_consistency=fit.run_consistency,
        below=task.below,
        dampers=dampers,
        springs=spring_curves(posterior, found.mode.z, flat, draws),
        effects={
            placed: {n: x.reshape(by_ensemble) for n, x in values.items()}
            for placed, values in space.effect_draws(flat).items()
        },
    )


def _with_model_error(found: MapFit, vehicle: Vehicle) -> tuple[MapFit, Array | None]:
    """Fit again with noise levels near the declared ones, and say how far that mode may be off.

    Returns the fit as it was where that one explains too little, or lacks nothing.  A climb through
    a misfit settles less closely than one through noise: what it leaves is far below the error of
    the model.
    """
    near = fit_near_declared_noise(found, vehicle)
    assert near.tight_noise_fit is not None
    error = model_error(near.tight_noise_fit)
    return (found, None) if near.reasons or not error.any() else (near, error)


def _no_single_rate(damper: DampingRates) -> str:
    return (
        f"the curve of the {damper.element.replace('_', ' ')} damper is free, so that it has no "
        "single rate to hold against the nominal one; the rate above is that of equal power at the "
        f"speeds driven, {damper.speed:.2g} m/s in root mean square"
    )


def _clocks(
    recordings: Sequence[Recording], vehicle: Vehicle, placed_effects: tuple[PlacedEffect, ...]
) -> tuple[tuple[Clock, ...], tuple[PlacedEffect, ...]]:
    """Clocks that are declared or asked for as an effect, and the other effects."""
    declared = declared_clocks(recordings, vehicle)
    names = {name for recording in recordings for name in recording.channels}
    known = [names.intersection(clock.channels) for clock in declared]
    asked = [
        clock_of_group(placed.where) for placed in placed_effects if placed.effect is CLOCK_OFFSET
    ]
    new = [clock for clock in asked if names.intersection(clock.channels) not in known]
    clocks = (*declared, *new)
    check_clocks(clocks, "--with clock_offset")
    return clocks, tuple(placed for placed in placed_effects if placed.effect is not CLOCK_OFFSET)


def _estimate_random_effects(
    agreement: RunConsistency,
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    warnings: tuple[str, ...],
    seed: int,
    sampler: ModuleType,
) -> EstimationResult:
    """Answer where runs do not agree: the mean car, and each run at its own posterior."""
    found = agreement.population
    together = agreement.joint(math.prod(_APART), seed)
    rhat, bulk, tail = sampler.convergence_diagnostics(
        found.centre.reshape(_APART[0], _APART[1], 1, -1)
    )
    return EstimationResult(
        verdict="ok",
        reasons=(),
        warnings=warnings,
        vehicle=vehicle,
        car=agreement.space.car,
        recordings=tuple(recordings),
        likelihood=agreement.space.likelihood,
        seed=seed,
        seconds=0.0,
        draws={n: x.reshape(_APART) for n, x in agreement.quantities(found.centre, seed).items()},
        nuisance=agreement.nuisance(_APART, seed),
        log_posterior=found.log_density.reshape(_APART),
        rhat_max=rhat,
        ess_bulk_min=bulk,
        ess_tail_min=tail,
        sampler="random effects",
        runs=tuple(
            _run_fit(recording, alone.fit.posterior, alone.z, 0, seed + run)
            for run, (recording, alone) in enumerate(zip(recordings, agreement.runs, strict=True))
        ),
        space=agreement.space,
        run_consistency=agreement,
        below=agreement.space.recordings[0].below,
        pooled_draws=agreement.quantities(together, seed),
    )


def _run_fit(
    recording: Recording, posterior: Posterior, flat: Array, run: int, seed: int
) -> RunFit:
    """Simulate one recording at the posterior's centre and at a few of its draws."""
    prepared = posterior.space.recordings[run]
    centre = flat.mean(axis=0)
    picked = flat[np.linspace(0, len(flat) - 1, 24).astype(int)]
    elements = len(prepared.car.elements)
    each = [free_run(posterior, z, run) for z in picked]
    innovations = posterior.innovations(centre, run)
    innovations[prepared.kind != VALUE] = np.nan
    return RunFit(
        recording=recording,
        prepared=prepared,
        free=free_run(posterior, centre, run),
        ensemble=np.stack([one.output for one in each]),
        travel=np.stack([one.states[:, 0 : 2 * elements : 2] for one in each]),
        velocity=np.stack([one.states[:, 1 : 2 * elements : 2] for one in each]),
        innovations=innovations,
        residual_ar=posterior.residual_ars[run],
        # Replicates know the sensors' noise alone; where it explains little there is nothing
        # to check.
        checks=()
        if posterior.space.likelihood == "coloured" or posterior.space.placed_effects
        else predictive_checks(posterior, flat, run, seed),
    )
