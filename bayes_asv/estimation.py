"""Estimation: the posterior of a car from recordings."""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bayes_asv.analysis.damping_rates import (
    MAX_DRAWS,
    DampingRates,
    damping_rates,
    with_equal_power,
)
from bayes_asv.analysis.input_mistakes import Doubt, check_input
from bayes_asv.analysis.nominal_values import NominalDamping, nominal_damping
from bayes_asv.analysis.predictive_checks import Check, predictive_checks
from bayes_asv.analysis.run_consistency import (
    MAX_COMPARED,
    RunConsistency,
    compare_runs,
    fit_single_run,
)
from bayes_asv.analysis.spring_curves import SpringCurve, spring_curves
from bayes_asv.analysis.uncertainty_budget import UncertaintyBudget, find_budget
from bayes_asv.domain.clocks import Clock, check_clocks, clock_of_group, declared_clocks
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.car_model import CarModel
from bayes_asv.models.cars import car_model
from bayes_asv.models.effects import Site
from bayes_asv.models.effects.clocks import EFFECT as CLOCK_OFFSET
from bayes_asv.posterior.clock_errors import fitted, synchronised
from bayes_asv.posterior.free_simulation import FreeRun, free_run
from bayes_asv.posterior.likelihood import Posterior, ResidualAR
from bayes_asv.posterior.map_fit import (
    MapFit,
    best_fit,
    fit_near_declared_noise,
    prepare_runs,
    unidentified_before_fit,
)
from bayes_asv.posterior.model_error import draw_cars, model_error
from bayes_asv.posterior.parameters import ParameterSpace
from bayes_asv.preprocessing.events import LogEvents, choose, find_events, is_long
from bayes_asv.preprocessing.resampling import at_own_rate
from bayes_asv.preprocessing.timeline import PreparedRecording

__all__ = ["LIKELIHOODS", "Estimate", "RunFit", "estimate", "select_runs"]

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]

LIKELIHOODS = ("innovations", "output-error")

_STEPS_IN_DOUBT = 120  # of the sampler, for an input that has to be corrected first anyway
_APART = (4, 2500)  # draws where runs do not agree: independent, in as many rows as ensembles


@dataclass(frozen=True)
class RunFit:
    """How one recording was explained at the centre of the posterior.

    Parameters
    ----------
    recording : Recording
        As read.
    line : PreparedRecording
        The same, laid out.
    free : FreeRun
        Simulation from the wheels alone at the mean of the posterior's coordinates.
    ensemble : (S, E, ny) array
        Outputs of the simulation for S draws of the posterior, m/s².
    travel, velocity : (S, E, ne) arrays
        Deflections for the same draws, m, and their rates, m/s.
    innovations : (E, ny) array
        Normalised innovations after the colour was taken out; nan where there was no reading.
    colour : ResidualAR
        Colour that the innovations had.
    checks : tuple of Check
        Posterior predictive checks.
    """

    recording: Recording
    line: PreparedRecording
    free: FreeRun
    ensemble: Array
    travel: Array
    velocity: Array
    innovations: Array
    colour: ResidualAR
    checks: tuple[Check, ...]


@dataclass(frozen=True)
class Estimate:
    """A posterior and what it stands on.

    Parameters
    ----------
    verdict : str
        ``ok``, ``not_converged`` or ``refused``.
    reasons, warnings : tuple of str
        Why it was refused; what to know otherwise.
    vehicle : Vehicle
        The car as given.
    car : CarModel
        Its model.
    draws : dict of str to (4, S) array
        Draws of every parameter of the model that is not exact and of what is derived from them,
        SI units, one row an ensemble; empty when refused.
    nuisance : dict of str to (4, S) array
        Draws of noise deviations (m/s²) and of the filtered share of the noise's variance.
    log_posterior : (4, S) array
        Not normalised; of several runs as :mod:`bayes_asv.posterior.shared_posterior` has it.
    rhat_max, ess_bulk_min, ess_tail_min : float
        Worst of all coordinates; nan when refused.
    runs : tuple of RunFit
        One a recording; empty when refused.
    space : ParameterSpace or None
        Coordinates and priors.
    width : UncertaintyBudget or None
        What makes each answer as wide as it is; only with an answer, and only when runs agree.
    agreement : RunConsistency or None
        One run against another; None with a single run.  Where it says ``disagree`` the draws
        are those of its mean car, and each run is explained at its own posterior.
    joint : dict of str to array
        Draws of the same car if all runs were alike; empty unless they disagree.
    likelihood : str
        Which likelihood was used: ``coloured`` in a band where the sensors' noise does not
        explain what is left.
    below : float or None
        Upper edge of the band that was used, Hz; None at full band.
    effects : dict of Site to dict of str to array
        Draws of the parameters of every effect in the model, SI units.
    dampers : tuple of DampingRates
        Rates of every damper whose force is not proportional to speed.
    springs : tuple of SpringCurve
        Curves of every spring that has a free one.
    doubt : Doubt or None
        Why the input is probably wrong or the model does not hold, so that no verdict on a damper
        may rest on this estimate; None where nothing speaks against it.
    logs : tuple of LogEvents
        What was found in recordings that are too long to be taken whole, one each; the runs are
        then the events that were used.
    seconds : float
        Time it took.
    seed : int
        Of the draws.
    sampler : str
        How the draws were made: ``ensembles`` of emcee, ``weighted draws``, ``normal
        approximation`` at a mode that the model's error moves, or ``random effects``.
    """

    verdict: str
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]
    vehicle: Vehicle
    car: CarModel
    recordings: tuple[Recording, ...]
    likelihood: str
    seed: int
    seconds: float
    draws: dict[str, Array] = field(default_factory=dict)
    nuisance: dict[str, Array] = field(default_factory=dict)
    log_posterior: Array = field(default_factory=lambda: np.zeros((0, 0)))
    rhat_max: float = math.nan
    ess_bulk_min: float = math.nan
    ess_tail_min: float = math.nan
    acceptance: float = math.nan
    sampler: str = "ensembles"
    runs: tuple[RunFit, ...] = ()
    space: ParameterSpace | None = None
    width: UncertaintyBudget | None = None
    agreement: RunConsistency | None = None
    joint: dict[str, Array] = field(default_factory=dict)
    below: float | None = None
    effects: dict[Site, dict[str, Array]] = field(default_factory=dict)
    dampers: tuple[DampingRates, ...] = ()
    springs: tuple[SpringCurve, ...] = ()
    doubt: Doubt | None = None
    logs: tuple[LogEvents, ...] = ()

    @property
    def count(self) -> int:
        """Number of draws in all."""
        return int(next(iter(self.draws.values())).size) if self.draws else 0

    @property
    def answers(self) -> tuple[str, ...]:
        """Names of the draws that were asked for: all but those of the given values."""
        given = {p.name for p in self.car.parameters if p.kind != "estimated"}
        return tuple(name for name in self.draws if name not in given)

    @property
    def nominal(self) -> dict[str, float]:
        """Nominal value of each parameter and of what is derived from them, SI units."""
        values = self.car.nominal
        derived = {} if self.car.derived is None else self.car.derived(values)
        return {name: float(x[0]) for name, x in {**values, **derived}.items()}

    @cached_property
    def nominal_damping(self) -> NominalDamping | None:
        """Whether nominal damping is mistaken; None where there is no verdict on the dampers."""
        rates = {element.damping for element in self.car.elements}
        if self.doubt is not None or not rates <= set(self.draws):
            return None
        values = {name: float(np.median(self.draws[name])) for name in rates}
        return nominal_damping(self.car, values)

    def probability_below_nominal(self, name: str) -> float:
        """Return the probability that a quantity is below nominal, which may be mistaken."""
        p = float(np.mean(self.draws[name] < self.nominal[name]))
        return p if self.nominal_damping is None else self.nominal_damping.below(name, p)


def estimate(
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    *,
    likelihood: str = "innovations",
    below: float | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    sites: tuple[Site, ...] = (),
    car: str = "half",
) -> Estimate:
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
    sites : tuple of Site
        Effects that the car and its sensors have.
    car : str
        Name of the car model, see :data:`bayes_asv.models.cars.CARS`.

    Returns
    -------
    Estimate
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
        return _estimate_prepared(runs, vehicle, likelihood, below, seed, progress, sites, car)
    model = car_model(car, vehicle)
    empty = tuple(_nothing_in(log) for log in logs if not any(event.used for event in log.events))
    warnings = tuple(text for log in logs for text in log.recording.warnings)
    if not runs:
        found = Estimate(
            "refused", empty, (), vehicle, model, (), likelihood, seed, 0.0, below=below
        )
    else:
        found = _estimate_prepared(runs, vehicle, likelihood, below, seed, progress, sites, car)
        warnings += empty
    return replace(
        found,
        recordings=tuple(recordings),
        warnings=(*warnings, *found.warnings),
        logs=logs,
        seconds=time.perf_counter() - began,
    )


def select_runs(
    recordings: Sequence[Recording], vehicle: Vehicle, below: float | None = None, car: str = "half"
) -> tuple[tuple[Recording, ...], tuple[LogEvents, ...]]:
    """Undo resampling, and take the best events of long recordings and all others whole.

    Parameters
    ----------
    recordings, vehicle, below, car
        As for :func:`estimate`.

    Returns
    -------
    runs : tuple of Recording
        In order; a long recording is replaced by its events in order of time.
    logs : tuple of LogEvents
        What was found in each long recording; empty where none is long.
    """
    model = car_model(car, vehicle)
    recordings = tuple(at_own_rate(recording) for recording in recordings)
    long = [is_long(recording, below) for recording in recordings]
    if not any(long):
        return recordings, ()
    found = [
        find_events(recording, vehicle, model, below)
        for recording, cut in zip(recordings, long, strict=True)
        if cut
    ]
    rows = sum(len(one.time) for one, cut in zip(recordings, long, strict=True) if not cut)
    logs = choose(found, rows, below)
    of_log = iter(logs)
    runs: list[Recording] = []
    for recording, cut in zip(recordings, long, strict=True):
        events = next(of_log).events if cut else ()
        runs += [event.recording for event in events if event.used] if cut else [recording]
    return tuple(runs), logs


def _nothing_in(log: LogEvents) -> str:
    """Say that a log has no event to use, and why."""
    source = log.recording.source or "the recording"
    reasons = list(dict.fromkeys(event.reason for event in log.events))
    if not reasons:
        return (
            f"the wheels hardly move anywhere in {source}; drive over bumps, parking stops or a "
            "rough road"
        )
    return (
        f"none of the {len(log.events)} events of {source} can be used, as {' or '.join(reasons)}; "
        "drive slower over lower bumps"
    )


def _estimate_prepared(
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    likelihood: str,
    below: float | None,
    seed: int,
    progress: Progress | None,
    sites: tuple[Site, ...],
    car: str,
) -> Estimate:
    """Estimate from recordings that are taken whole."""
    began = time.perf_counter()
    tell = progress or (lambda share, words: None)
    model = car_model(car, vehicle)
    clocks, sites = _clocks(recordings, vehicle, sites)
    lines, reasons, warnings = prepare_runs(recordings, vehicle, below, car)
    found, agreement, timed = None, None, None
    unidentified: tuple[str, ...] = ()
    if not reasons:
        tell(0.0, "checking what the recordings can tell")
        unidentified = unidentified_before_fit(lines, vehicle)
        if clocks:
            tell(0.0, "comparing the clocks")
            timed = synchronised(recordings, vehicle, clocks, below, car, likelihood)
            lines = timed.lines
        tell(0.0, "looking for the best fit")
        with ThreadPoolExecutor(1) as other:
            # emcee takes a second to load, most of it while compiled code climbs to the mode
            loading = other.submit(importlib.import_module, "bayes_asv.posterior.sampler")
            if (
                len(lines) > 1
                and likelihood == "innovations"
                and not sites
                and len(model.estimated) <= MAX_COMPARED
            ):  # the other form claims too much
                alone = [fit_single_run(line, vehicle, seed) for line in lines]
                agreement = compare_runs(alone, math.prod(_APART), seed)
            if agreement is not None and agreement.apart:
                reasons, warnings = agreement.reasons, warnings + agreement.warnings
            else:
                found = (
                    best_fit(lines, vehicle, likelihood, sites)
                    if timed is None
                    else fitted(timed, sites)
                )
                reasons = found.reasons
                # At the mode the same is known better than at nominal values.
                unidentified = () if found.mode.converged else unidentified
            sampler = loading.result()
    whole = below is None and likelihood == "innovations" and timed is None
    lacking = None
    if whole and found is not None and (found.faults or sites):
        found, lacking = _with_model_error(found, vehicle)
        reasons = found.reasons
    doubt = None
    if below is None and not sites and lines:
        tell(0.05, "checking the input")
        at_mode = recordings if timed is None else timed.recordings
        doubt = check_input(at_mode, vehicle, car, refused=bool(reasons))
    if whole and found is not None and lacking is None and doubt and not doubt.model_holds:
        found, lacking = _with_model_error(found, vehicle)
    warnings += (*(() if found is None else found.warnings), *unidentified)
    if timed is not None and timed.ambiguity is not None:
        warnings += (timed.ambiguity,)
        doubt = doubt or Doubt((), timed.ambiguity)
    if agreement is not None and found is None and not reasons:
        tell(0.9, "the runs do not agree")
        told = _estimate_random_effects(agreement, recordings, vehicle, warnings, seed)
        tell(1.0, "done")
        return replace(told, doubt=doubt, seconds=time.perf_counter() - began)
    if reasons or found is None:
        if doubt is not None and doubt.mistakes:
            reasons = (doubt.sentence, *reasons)
        return Estimate(
            "refused", reasons, warnings, vehicle, model, tuple(recordings),
            likelihood, seed, time.perf_counter() - began, agreement=agreement, below=below,
            doubt=doubt,
        )  # fmt: skip
    if doubt is not None:
        warnings = (doubt.sentence, *warnings)
    where, target = found.space, found.target
    tell(0.1, "sampling")
    if lacking is not None:
        rng, spread = np.random.default_rng([seed, 29]), found.mode.covariance + lacking
        cars = draw_cars(where, found.mode.z, spread, math.prod(_APART), rng)
        ensembles = sampler.independent_draws(target, cars.reshape(*_APART, -1))
    else:
        # the parameters of a force law are too far from linear for an expansion at the mode
        exact_form = timed is None or bool(sites)
        ensembles = sampler.sample_runs(
            target if exact_form else target.expanded(found.mode.z, found.mode.covariance),
            found.mode,
            seed,
            None if progress is None else lambda share, words: tell(0.1 + 0.85 * share, words),
            _STEPS_IN_DOUBT if doubt is not None and doubt.mistakes else sampler.MAX_STEPS,
        )
    if any(site.effect.free_form for site in sites):
        ensembles = ensembles.thinned(MAX_DRAWS)
    flat = ensembles.draws.reshape(-1, where.dimension)
    by_ensemble = ensembles.log_posterior.shape
    draws = {n: x.reshape(by_ensemble) for n, x in where.quantities(flat, seed).items()}
    nuisance = {n: x.reshape(by_ensemble) for n, x in where.nuisance(flat).items()}
    if not ensembles.converged:
        warnings += (
            f"the ensembles had not agreed after {ensembles.draws.shape[1]} draws each "
            f"(R̂ {ensembles.rhat_max:.3f}, effective draws "
            f"{min(ensembles.ess_bulk_min, ensembles.ess_tail_min):.0f}); do not trust the "
            "intervals: the recordings may hold motion that the model does not describe",
        )
    runs = tuple(
        _run_fit(recording, target, flat, run, seed) for run, recording in enumerate(recordings)
    )
    exact = timed is None or not any(timed.modes)
    budget = ensembles.converged and exact and not sites and lacking is None
    dampers = damping_rates(target, found.mode.z, flat, draws)
    springs = spring_curves(target, found.mode.z, flat, draws)
    draws = with_equal_power(draws, dampers)
    warnings += tuple(_no_single_rate(damper) for damper in dampers if damper.free_form)
    width = find_budget(target, found.mode, vehicle) if budget else None
    tell(1.0, "done")
    return Estimate(
        verdict="ok" if ensembles.converged else "not_converged",
        reasons=(),
        warnings=warnings,
        vehicle=vehicle,
        car=model,
        recordings=tuple(recordings),
        likelihood=where.likelihood,
        seed=seed,
        seconds=time.perf_counter() - began,
        draws=draws,
        nuisance=nuisance,
        log_posterior=ensembles.log_posterior,
        rhat_max=ensembles.rhat_max,
        ess_bulk_min=ensembles.ess_bulk_min,
        ess_tail_min=ensembles.ess_tail_min,
        acceptance=ensembles.acceptance,
        sampler=ensembles.sampler,
        runs=runs,
        space=where,
        width=width,
        agreement=agreement,
        below=below,
        dampers=dampers,
        springs=springs,
        doubt=doubt,
        effects={
            site: {n: x.reshape(by_ensemble) for n, x in values.items()}
            for site, values in where.effect_draws(flat).items()
        },
    )


def _with_model_error(found: MapFit, vehicle: Vehicle) -> tuple[MapFit, Array | None]:
    """Fit again with noise levels near the declared ones, and say how far that mode may be off.

    Returns the fit as it was where that one explains too little, or lacks nothing.  A climb through
    a misfit settles less closely than one through noise: what it leaves is far below the error of
    the model.
    """
    near = fit_near_declared_noise(found, vehicle)
    assert near.near is not None
    error = model_error(near.near)
    return (found, None) if near.reasons or not error.any() else (near, error)


def _no_single_rate(damper: DampingRates) -> str:
    return (
        f"the curve of the {damper.element.replace('_', ' ')} damper is free, so that it has no "
        "single rate to hold against the nominal one; the rate above is that of equal power at the "
        f"speeds driven, {damper.speed:.2g} m/s in root mean square"
    )


def _clocks(
    recordings: Sequence[Recording], vehicle: Vehicle, sites: tuple[Site, ...]
) -> tuple[tuple[Clock, ...], tuple[Site, ...]]:
    """Clocks that are declared or asked for as an effect, and the other effects."""
    declared = declared_clocks(recordings, vehicle)
    names = {name for recording in recordings for name in recording.channels}
    known = [names.intersection(clock.channels) for clock in declared]
    asked = [clock_of_group(site.where) for site in sites if site.effect is CLOCK_OFFSET]
    new = [clock for clock in asked if names.intersection(clock.channels) not in known]
    clocks = (*declared, *new)
    check_clocks(clocks, "--with clock_offset")
    return clocks, tuple(site for site in sites if site.effect is not CLOCK_OFFSET)


def _estimate_random_effects(
    agreement: RunConsistency,
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    warnings: tuple[str, ...],
    seed: int,
) -> Estimate:
    """Answer where runs do not agree: the mean car, and each run at its own posterior."""
    from bayes_asv.posterior.sampler import diagnose

    found = agreement.population
    together = agreement.joint(math.prod(_APART), seed)
    rhat, bulk, tail = diagnose(found.centre.reshape(_APART[0], _APART[1], 1, -1))
    return Estimate(
        verdict="ok",
        reasons=(),
        warnings=warnings,
        vehicle=vehicle,
        car=agreement.space.car,
        recordings=tuple(recordings),
        likelihood=agreement.space.likelihood,
        seed=seed,
        seconds=math.nan,
        draws={n: x.reshape(_APART) for n, x in agreement.quantities(found.centre, seed).items()},
        nuisance=agreement.nuisance(_APART, seed),
        log_posterior=found.log_density.reshape(_APART),
        rhat_max=rhat,
        ess_bulk_min=bulk,
        ess_tail_min=tail,
        sampler="random effects",
        runs=tuple(
            _run_fit(recording, alone.fit.target, alone.z, 0, seed + run)
            for run, (recording, alone) in enumerate(zip(recordings, agreement.runs, strict=True))
        ),
        space=agreement.space,
        agreement=agreement,
        below=agreement.space.timelines[0].below,
        joint=agreement.quantities(together, seed),
    )


def _run_fit(recording: Recording, target: Posterior, flat: Array, run: int, seed: int) -> RunFit:
    """Simulate one recording at the posterior's centre and at a few of its draws."""
    line = target.space.timelines[run]
    centre = flat.mean(axis=0)
    picked = flat[np.linspace(0, len(flat) - 1, 24).astype(int)]
    elements = len(line.car.elements)
    each = [free_run(target, z, run) for z in picked]
    innovations = target.innovations(centre, run)
    innovations[line.kind != 1] = np.nan
    return RunFit(
        recording=recording,
        line=line,
        free=free_run(target, centre, run),
        ensemble=np.stack([one.output for one in each]),
        travel=np.stack([one.states[:, 0 : 2 * elements : 2] for one in each]),
        velocity=np.stack([one.states[:, 1 : 2 * elements : 2] for one in each]),
        innovations=innovations,
        colour=target.colours[run],
        # Replicates know the sensors' noise alone; where it explains little there is nothing
        # to check.
        checks=()
        if target.space.likelihood == "coloured" or target.space.sites
        else predictive_checks(target, flat, run, seed),
    )
