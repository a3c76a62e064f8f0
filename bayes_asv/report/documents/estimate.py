"""Documents of the half car's and the roll car's estimates."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv import __version__
from bayes_asv.analysis.uncertainty_budget import Answer, UncertaintyBudget
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.estimation import ANSWERS, DERIVED, Estimate, RunFit
from bayes_asv.filters.kalman import VALUE
from bayes_asv.models.half_car import HalfCar
from bayes_asv.report.documents.quantities import (
    Z95,
    Units,
    effects,
    parameter,
    provenance,
    summary,
)
from bayes_asv.report.documents.runs import pooled_fit, run_consistency, run_document
from bayes_asv.report.schema import EstimateDocument, RollDocument
from bayes_asv.report.schema import estimate as schema
from bayes_asv.report.schema.parts import (
    Known,
    Parameter,
    Quantity,
    Summary,
    TravelLimits,
    VehicleInfo,
)
from bayes_asv.report.sections.uncertainty_budget import remedy_sentence

__all__ = ["estimate_document", "roll_document"]

Array = NDArray[np.float64]

_GIVEN: Final = ("m", "l", "wdf", "k_f", "k_r")
_MAX_DRAWS: Final = 1000  # of a parameter
_PACKAGES: Final = ("numpy", "scipy", "emcee", "numba", "arviz-stats")
_STOPS: Final = ("front_bump", "front_droop", "rear_bump", "rear_droop")
_SIDES: Final = {"front": ("c_fl", "c_fr"), "rear": ("c_rl", "c_rr")}


def estimate_document(result: Estimate) -> EstimateDocument:
    """Document of an estimate from :func:`bayes_asv.estimate.estimate`, of any verdict."""
    vehicle, agreement = result.vehicle, result.agreement
    names = [n for n in (*ANSWERS, *DERIVED) if n in result.draws]
    units = Units(vehicle.units)
    origin = provenance(
        ((r.source, r.sha256) for r in result.recordings), vehicle, _PACKAGES, result.seed
    )
    return EstimateDocument(
        schema="bayes_asv/estimate/1",
        verdict=result.verdict,
        reasons=list(result.reasons),
        warnings=list(result.warnings),
        parameters={n: parameter(n, result.draws[n], vehicle) for n in names},
        known={n: _known(n, result) for n in _GIVEN},
        prior={n: _prior(n, result) for n in ANSWERS} if names else {},
        diagnostics=schema.Diagnostics(
            rhat_max=result.rhat_max,
            ess_bulk_min=result.ess_bulk_min,
            ess_tail_min=result.ess_tail_min,
            acceptance=result.acceptance,
            draws=result.count,
            likelihood=result.likelihood,
            band=None if result.below is None else [0.0, result.below],
            sampler="random effects"
            if agreement is not None and agreement.verdict == "disagree"
            else "ensembles",
        ),
        width=None
        if result.width is None
        else _uncertainty_budget(result.width, result.draws, vehicle),
        agreement=run_consistency(result),
        effects=effects(result.effects, vehicle),
        fit=pooled_fit(result.runs),
        fit_by_run=[pooled_fit((run,), run.line.source) for run in result.runs],
        noise=_noise(result),
        runs=[run_document(run, vehicle.units) for run in result.runs],
        draws={
            n: units.curve(_thinned(x), QUANTITIES[n][0]) for n, x in result.draws.items()
        },
        vehicle=_vehicle(vehicle),
        provenance=origin.model_copy(update={"order": list(HalfCar._fields)}),
        seconds=result.seconds,
        version=__version__,
        seed=result.seed,
    )  # fmt: skip


def _known(name: str, result: Estimate) -> Known:
    units, given = Units(result.vehicle.units), getattr(result.vehicle, name)
    known = Known(
        label=QUANTITIES[name][1],
        unit=units.unit_of(name),
        value=units.convert_parameter(given.value, name),
        sd=units.convert_parameter(given.sd, name),
    )
    if name in result.draws:
        known.posterior = Summary(**summary(units.convert_parameter(result.draws[name], name)))
    return known


def _prior(name: str, result: Estimate) -> schema.Prior:
    assert result.space is not None
    mean, sd = result.space.log_prior_of(name)
    units = Units(result.vehicle.units)
    low, median, high = (
        units.convert_parameter(math.exp(mean + z * sd), name) for z in (-Z95, 0.0, Z95)
    )
    return schema.Prior(
        kind="log-normal", median=median, factor=math.exp(sd), log_sd=sd, eti95=[low, high]
    )


def _noise(result: Estimate) -> list[schema.Noise]:
    """Posterior of each run's noise levels, and the share of the noise that passed the filter."""
    units, entries = Units(result.vehicle.units), []
    for n, fit in enumerate(result.runs):
        noise = schema.Noise(source=fit.line.source, unit=units.unit("acceleration"))
        for channel, given in zip(fit.line.channels, fit.line.noise, strict=True):
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
            setattr(noise, channel.name, level)
        share = result.nuisance.get(f"filtered share {n}")
        if share is not None:
            noise.filtered_share = Summary(**summary(share))
        noise.colour_order = int(fit.colour.order)
        entries.append(noise)
    return entries


def _thinned(draws: Array) -> Array:
    x = draws.ravel()
    thinned: Array = x[np.linspace(0, len(x) - 1, min(_MAX_DRAWS, len(x))).astype(int)]
    return thinned


def _vehicle(vehicle: Vehicle) -> VehicleInfo:
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
    width: UncertaintyBudget, draws: Mapping[str, Array], vehicle: Vehicle
) -> schema.UncertaintyBudget:
    answers = {
        name: _answer_budget(name, answer, width, draws[name], vehicle)
        for name, answer in width.answers.items()
    }
    faults = {}
    for shift in width.shifts:
        faults[f"{shift.kind} {shift.where}"] = schema.Fault(
            kind=shift.kind,
            where=shift.where,
            size=float(shift.size),
            larger_shows=bool(shift.shows),
            shift={
                name: schema.Shift(percent=100.0 * value, sd=value / width.answers[name].sd)
                for name, value in width.by_answer(shift.moved).items()
            },
        )
    return schema.UncertaintyBudget(
        **answers, faults=faults, white=bool(width.white), runs=width.runs
    )


def _answer_budget(
    name: str, answer: Answer, width: UncertaintyBudget, draws: Array, vehicle: Vehicle
) -> schema.AnswerBudget:
    halve = []
    for remedy in answer.remedies:
        measures = [_measure(source, remedy.times, width, vehicle) for source in remedy.sources]
        halve.append(
            schema.Remedy(
                what=" + ".join(measure.what for measure in measures),
                measures=measures,
                sentence=remedy_sentence(measures, [name], width.runs),
            )
        )
    return schema.AnswerBudget(
        sd_percent=100.0 * answer.sd,
        posterior_sd_percent=100.0 * float(np.log(draws).std(ddof=1)),
        shares=answer.shares,
        noises=answer.noises,
        exact_sd_percent={source: 100.0 * sd for source, sd in answer.exact.items()},
        better_sd_percent={source: 100.0 * sd for source, sd in answer.better.items()},
        twice_the_runs_sd_percent=100.0 * answer.twice,
        halve=halve,
        runs_to_halve=answer.runs_to_halve,
    )


def _measure(
    source: int, times: float, width: UncertaintyBudget, vehicle: Vehicle
) -> schema.Measure:
    """How well a source has to be known for `times` as much information."""
    if source < 0:
        further = max(math.ceil((times - 1.0) * width.runs - 1e-2), 1)
        return schema.Measure(what="runs", further=further)
    name = width.parameters[source]
    if name.startswith("gain "):
        now = percent = 100.0 * float(width.given_sd[source])
        unit = ""
    else:
        given, units = getattr(vehicle, name), Units(vehicle.units)
        percent, unit = 100.0 * given.sd / given.value, units.unit_of(name)
        now = units.convert_parameter(given.sd, name)
    return schema.Measure(
        what=name,
        now_sd_percent=percent,
        needed_sd_percent=percent / math.sqrt(times),
        now_sd=now,
        needed_sd=now / math.sqrt(times),
        unit=unit,
    )


def roll_document(result: Estimate) -> RollDocument:
    """Document of an estimate of the roll car, of any verdict.

    ``left_over_right`` holds the ratio of the two dampers of each axle, which does not depend on
    the error of the mass.
    """
    vehicle, draws = result.vehicle, result.draws
    parameters, ratios = {}, {}
    if draws and result.space is not None:
        nominal = {p.name: p.nominal for p in result.space.car.parameters}
        parameters = {
            name: _roll_parameter(name, draws[name], nominal[name], vehicle)
            for name in result.space.car.estimated
        }
        for axle, (left, right) in _SIDES.items():
            ratio = draws[left] / draws[right]
            ratios[axle] = schema.SideRatio(
                **summary(ratio), p_left_softer=float(np.mean(ratio < 1.0))
            )
    effective = min(result.ess_bulk_min, result.ess_tail_min)
    return RollDocument(
        schema="bayes_asv/estimate_roll/1",
        verdict=result.verdict,
        reasons=list(result.reasons),
        warnings=list(result.warnings),
        parameters=parameters,
        left_over_right=ratios,
        diagnostics=schema.RollDiagnostics(
            likelihood=result.likelihood,
            sampler="ensembles",
            draws=result.count,
            effective_draws=effective if draws else None,
        ),
        fit_by_run=[_roll_fit(run) for run in result.runs],
        vehicle=VehicleInfo(name=vehicle.name, sha256=vehicle.sha256),
        recordings=[
            schema.RollRecording(source=r.source, sha256=r.sha256, rows=len(r.time))
            for r in result.recordings
        ],
        seconds=result.seconds,
        version=__version__,
        seed=result.seed,
    )


def _roll_fit(run: RunFit) -> schema.RollFits:
    """Rms of what a free run leaves of each output over the output's own."""
    line = run.line
    fits = {}
    for y, c in enumerate(line.outputs):
        use = line.kind[:, y] == VALUE
        reading = line.reading[use, y]
        share = math.sqrt(float(np.mean((reading - run.free.output[use, y]) ** 2) / reading.var()))
        fits[line.channels[c].name] = schema.Fit(nrmse_percent=100.0 * share)
    return schema.RollFits(source=run.recording.source, **fits)


def _roll_parameter(name: str, draws: Array, nominal: float, vehicle: Vehicle) -> Parameter:
    units, si = Units(vehicle.units), Units("SI")
    return Parameter(
        label=QUANTITIES[name][1],
        unit=units.unit_of(name),
        **summary(units.convert_parameter(draws, name)),
        nominal=units.convert_parameter(nominal, name),
        p_below_nominal=float(np.mean(draws < nominal)),
        si=Quantity(unit=si.unit_of(name), **summary(draws), nominal=nominal),
    )
