"""Document of an estimate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv import __version__
from bayes_asv.analysis.prior_sensitivity import log_priors, prior_sensitivity
from bayes_asv.analysis.uncertainty_budget import EstimandBudget, UncertaintyBudget
from bayes_asv.domain.quantities import NORMAL_975, QUANTITIES
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.estimate_result import EstimationResult
from bayes_asv.models.car_model import CarModel, CarParameter
from bayes_asv.preprocessing.events import NO_TIME, NOT_NEEDED, LogEvents
from bayes_asv.report.documents.quantities import (
    Units,
    damper_rates,
    effects,
    parameter,
    possible_mistakes,
    provenance,
    spring_curve,
    summary,
    without_single_rate,
)
from bayes_asv.report.documents.runs import pooled_fit, run_consistency, run_document
from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.schema import estimate as schema
from bayes_asv.report.schema.parts import Known, Summary, TravelLimits, VehicleInfo
from bayes_asv.report.sections.uncertainty_budget import remedy_sentence

__all__ = ["estimate_document", "vehicle_info"]

Array = NDArray[np.float64]

_MAX_DRAWS: Final = 1000  # of a parameter
_PACKAGES: Final = ("numpy", "scipy", "emcee", "numba", "arviz-stats")
_STOPS: Final = ("front_bump", "front_droop", "rear_bump", "rear_droop")


def estimate_document(result: EstimationResult) -> EstimateDocument:
    """Document of an estimate from :func:`bayes_asv.estimation.estimate`, of any verdict."""
    vehicle, car = result.vehicle, result.car
    units, nominal = Units(vehicle.units), result.nominal
    free_form = without_single_rate(result.dampers)
    origin = provenance(
        ((r.source, r.sha256) for r in result.recordings), vehicle, _PACKAGES, result.seed
    )
    return EstimateDocument(
        schema="bayes_asv/estimate/1",
        verdict=result.verdict,
        reasons=list(result.reasons),
        warnings=list(result.warnings),
        doubt="" if result.input_check is None else result.input_check.sentence,
        doubt_about="input" if result.input_check is None else result.input_check.about,
        nominal_mistakes=possible_mistakes(result.nominal_damping),
        car=car.name,
        elements={
            e.name: schema.Element(axle=e.axle, side=e.side, damping=e.damping, spring=e.spring)
            for e in car.elements
        },
        parameters={
            n: parameter(n, result.draws[n], vehicle, nominal[n]).model_copy(
                update={
                    "withheld": result.input_check is not None or n in free_form,
                    "p_below_nominal": result.probability_below_nominal(n),
                }
            )
            for n in result.estimands
        },
        left_over_right=_side_ratios(car, result.draws),
        known={
            p.name: _known(p, result)
            for p in car.parameters
            if p.kind != "estimated" and p.nominal != 0.0  # a bar that is not there
        },
        prior={n: _prior(n, result) for n in car.estimated} if result.draws else {},
        diagnostics=schema.Diagnostics(
            rhat_max=result.rhat_max,
            ess_bulk_min=result.ess_bulk_min,
            ess_tail_min=result.ess_tail_min,
            acceptance=result.acceptance,
            draws=result.count,
            likelihood=result.likelihood,
            band=None if result.below is None else [0.0, result.below],
            sampler=result.sampler,
        ),
        width=None
        if result.uncertainty_budget is None
        else _uncertainty_budget(result.uncertainty_budget, result),
        agreement=run_consistency(result),
        effects=effects(result.effects, vehicle),
        dampers=[damper_rates(one, units) for one in result.dampers],
        springs=[
            spring_curve(one, float(car.nominal[one.parameter][0]), units)
            for one in result.springs
        ],
        clocks=_clocks(result),
        fit=pooled_fit(result.runs),
        fit_by_run=[pooled_fit((run,), run.prepared.source) for run in result.runs],
        noise=_noise(result),
        runs=[run_document(run, vehicle.units) for run in result.runs],
        logs=[_long_log(log) for log in result.long_logs],
        forces=_forces(result),
        sensitivity=_sensitivity(result),
        draws={
            n: units.curve(_thinned(x), QUANTITIES[n][0]) for n, x in result.draws.items()
        },
        vehicle=vehicle_info(vehicle),
        provenance=origin.model_copy(update={"order": list(car.names)}),
        seconds=result.seconds,
        version=__version__,
        seed=result.seed,
    )  # fmt: skip


def _forces(result: EstimationResult) -> dict[str, schema.DamperForce]:
    """Force of every damper over the velocities driven, by its element."""
    units, nominal, forces = Units(result.vehicle.units), result.nominal, {}
    own = {damper.element: damper for damper in result.dampers}
    for e, element in enumerate(result.car.elements):
        if not result.runs or element.damping not in result.draws:
            continue
        if element.name in own:
            velocity = own[element.name].velocity
            curves = np.quantile(own[element.name].force, [0.025, 0.5, 0.975], axis=0)
        else:  # a line through zero
            driven = np.concatenate([fit.free.states[:, 2 * e + 1] for fit in result.runs])
            velocity = np.array([driven.min(), 0.0, driven.max()])
            rate = np.quantile(result.draws[element.damping], [0.025, 0.5, 0.975])
            curves = np.sort(rate[:, None] * velocity, axis=0)
        low, median, high = (units.curve(curve, "force") for curve in curves)
        forces[element.name] = schema.DamperForce(
            velocity=units.curve(velocity, "velocity"),
            unit=units.unit("velocity"),
            force_unit=units.unit("force"),
            median=median,
            band95=[low, high],
            nominal=units.curve(nominal[element.damping] * velocity, "force")
            if element.damping in nominal
            else None,
        )
    return forces


def _sensitivity(result: EstimationResult) -> dict[str, schema.PriorSensitivity]:
    """Sensitivity of the estimates to each prior; empty if runs differ or nothing was drawn."""
    if result.space is None or result.pooled_draws or not result.draws:
        return {}
    draws = {name: result.draws[name] for name in result.estimands}
    free_form = without_single_rate(result.dampers)
    return {
        name: schema.PriorSensitivity(
            label=QUANTITIES[name][1], pareto_k=one.pareto_k, sensitivity=one.sensitivity
        )
        for name, one in prior_sensitivity(
            log_priors(result.space, result.draws, {}), draws
        ).items()
        if name in QUANTITIES and name not in free_form
    }


def _long_log(log: LogEvents) -> schema.LongLog:
    time = log.recording.time
    return schema.LongLog(
        source=Path(log.recording.source).name,
        seconds=float(time[-1] - time[0]),
        events=[
            schema.LogEvent(
                kind=event.kind,
                begin=event.begin,
                end=event.end,
                used=event.used,
                reason=event.reason,
                unfit=event.reason not in ("", NO_TIME, NOT_NEEDED),
            )
            for event in log.events
        ],
        rest=log.states,
        time=[float(f"{t:.6g}") for t in log.time],
        level=[float(f"{x:.3g}") for x in log.level],
    )


def _side_ratios(car: CarModel, draws: Mapping[str, Array]) -> dict[str, schema.SideRatio]:
    """Ratio of left to right damping rate of each axle with two dampers."""
    rates = {(e.axle, e.side): draws[e.damping] for e in car.elements if e.damping in draws}
    ratios = {}
    for (axle, side), left in rates.items():
        if side == "left":
            ratio = left / rates[axle, "right"]
            p = float(np.mean(ratio < 1.0))
            ratios[str(axle)] = schema.SideRatio(**summary(ratio), p_left_softer=p)
    return ratios


def _sd(given: CarParameter) -> float:
    """Prior standard deviation, SI units; of a positive value that of its log-normal prior."""
    variance = sum((coefficient * sd) ** 2 for _, coefficient, sd in given.terms)
    if given.kind == "fraction":
        return math.sqrt(variance)
    sd = given.nominal * math.sqrt(math.exp(variance) * math.expm1(variance))
    return float(f"{sd:.12g}")  # the prior was rounded as a logarithm


def _known(given: CarParameter, result: EstimationResult) -> Known:
    units, name = Units(result.vehicle.units), given.name
    known = Known(
        label=QUANTITIES[name][1],
        unit=units.unit_of(name),
        value=units.convert_parameter(given.nominal, name),
        sd=units.convert_parameter(_sd(given), name),
    )
    if name in result.draws:
        known.posterior = Summary(**summary(units.convert_parameter(result.draws[name], name)))
    return known


def _prior(name: str, result: EstimationResult) -> schema.Prior:
    assert result.space is not None
    mean, sd = result.space.log_prior_of(name)
    units = Units(result.vehicle.units)
    low, median, high = (
        units.convert_parameter(math.exp(mean + z * sd), name)
        for z in (-NORMAL_975, 0.0, NORMAL_975)
    )
    return schema.Prior(
        kind="log-normal", median=median, factor=math.exp(sd), log_sd=sd, eti95=[low, high]
    )


def _noise(result: EstimationResult) -> list[schema.Noise]:
    """Posterior of each run's noise levels, and the share of the noise that passed the filter."""
    units, entries = Units(result.vehicle.units), []
    for n, fit in enumerate(result.runs):
        levels = {}
        for channel, given in zip(fit.prepared.channels, fit.prepared.noise, strict=True):
            draws = result.nuisance.get(f"noise {channel.name} {n}")
            if draws is None:
                continue
            dimension = channel.dimension
            level = schema.NoiseLevel(
                **summary(units.convert(draws, dimension)),
                given=None if given is None else units.convert(given, dimension),
            )
            if dimension != "acceleration":
                level.unit = units.unit(dimension)
            levels[channel.name] = level
        noise = schema.Noise(
            source=fit.prepared.source, unit=units.unit("acceleration"),
            colour_order=int(fit.residual_ar.order), **levels,
        )  # fmt: skip
        share = result.nuisance.get(f"filtered share {n}")
        if share is not None:
            noise.filtered_share = Summary(**summary(share))
        entries.append(noise)
    return entries


def _clocks(result: EstimationResult) -> list[schema.ClockErrors]:
    """Posterior of the offset of each clock in each run, and of its drift."""
    found = []
    for name, draws in result.nuisance.items():
        of_clock, _, kind = name.partition(" ")
        if of_clock != "clock":
            continue
        kind, _, clock = kind.partition(" ")
        named, _, run = clock.rpartition(" ")
        source = ""
        if named and run.isdigit() and int(run) < len(result.runs):
            clock, source = named, result.runs[int(run)].prepared.source
        found.append(
            schema.ClockErrors(name=clock, source=source, **{kind: Summary(**summary(draws))})
        )
    return found


def _thinned(draws: Array) -> Array:
    x = draws.ravel()
    thinned: Array = x[np.linspace(0, len(x) - 1, min(_MAX_DRAWS, len(x))).astype(int)]
    return thinned


def vehicle_info(vehicle: Vehicle) -> VehicleInfo:
    """Describe the vehicle file in a document."""
    units = Units(vehicle.units)
    limits = {name: getattr(vehicle.travel, name) for name in _STOPS}
    return VehicleInfo(
        name=vehicle.name,
        units=vehicle.units,
        source=Path(vehicle.source).name,
        sha256=vehicle.sha256,
        travel=TravelLimits(
            unit=units.unit("deflection"),
            **{n: None if x is None else units.convert(x, "deflection") for n, x in limits.items()},
        ),
    )


def _uncertainty_budget(
    width: UncertaintyBudget, result: EstimationResult
) -> schema.UncertaintyBudget:
    budgets = {
        name: _parameter_budget(name, budget, width, result)
        for name, budget in width.estimands.items()
    }
    faults = {}
    for shift in width.shifts:
        faults[f"{shift.kind} {shift.where}"] = schema.Fault(
            kind=shift.kind,
            where=shift.where,
            size=float(shift.size),
            larger_shows=bool(shift.shows),
            shift={
                name: schema.Shift(percent=100.0 * value, sd=value / width.estimands[name].sd)
                for name, value in width.by_parameter(shift.moved).items()
            },
        )
    return schema.UncertaintyBudget(
        **budgets, faults=faults, white=bool(width.white), runs=width.runs
    )


def _parameter_budget(
    name: str, budget: EstimandBudget, width: UncertaintyBudget, result: EstimationResult
) -> schema.ParameterBudget:
    halve = []
    for remedy in budget.remedies:
        measures = [_measure(source, remedy.times, width, result) for source in remedy.sources]
        halve.append(
            schema.Remedy(
                what=" + ".join(measure.what for measure in measures),
                measures=measures,
                sentence=remedy_sentence(measures, [name], width.runs),
            )
        )
    return schema.ParameterBudget(
        sd_percent=100.0 * budget.sd,
        posterior_sd_percent=100.0 * float(np.log(result.draws[name]).std(ddof=1)),
        shares=budget.shares,
        noises=budget.noises,
        exact_sd_percent={source: 100.0 * sd for source, sd in budget.exact.items()},
        better_sd_percent={source: 100.0 * sd for source, sd in budget.better.items()},
        twice_the_runs_sd_percent=100.0 * budget.twice,
        halve=halve,
        runs_to_halve=budget.runs_to_halve,
    )


def _measure(
    source: int, times: float, width: UncertaintyBudget, result: EstimationResult
) -> schema.Measure:
    """How well a source has to be known for `times` as much information."""
    if source < 0:
        further = max(math.ceil((times - 1.0) * width.runs - 1e-2), 1)
        return schema.Measure(what="runs", further=further)
    name = width.parameters[source]
    given = next((p for p in result.car.parameters if p.name == name), None)
    if given is None:  # the scale of a sensor, or what several parameters have in common
        now = percent = 100.0 * float(width.given_sd[source])
        unit = ""
    else:
        units = Units(result.vehicle.units)
        percent, unit = 100.0 * _sd(given) / given.nominal, units.unit_of(name)
        now = units.convert_parameter(_sd(given), name)
    return schema.Measure(
        what=name,
        now_sd_percent=percent,
        needed_sd_percent=percent / math.sqrt(times),
        now_sd=now,
        needed_sd=now / math.sqrt(times),
        unit=unit,
    )
