"""Each recording beside its simulation, and the comparison of the recordings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.analysis.predictive_checks import Check
from bayes_asv.analysis.run_consistency import DISAGREE_BELOW
from bayes_asv.analysis.run_consistency import RunConsistency as Comparison
from bayes_asv.domain.channels import CHANNELS
from bayes_asv.estimation import Estimate, RunFit
from bayes_asv.posterior.residual_ar import portmanteau
from bayes_asv.report.documents.quantities import Z95, Units, summary
from bayes_asv.report.schema import estimate as schema
from bayes_asv.report.schema.parts import Curve, Quantity, Summary

__all__ = ["pooled_fit", "run_consistency", "run_document"]

Array = NDArray[np.float64]

_MAX_POINTS: Final = 1500  # of a curve
_LAGS: Final = 20
_CHASSIS: Final = ("front_chassis", "rear_chassis")


def pooled_fit(runs: Sequence[RunFit], source: str | None = None) -> schema.Fits:
    """Normalised rms error of the simulation driven by the wheels, pooled over runs."""
    fits = schema.Fits() if source is None else schema.Fits(source=source)
    for axle, name in enumerate(_CHASSIS):
        error, power = 0.0, 0.0
        for run in runs:
            use = run.line.kind[:, axle] == 1
            y = run.line.reading[use, axle]
            error += float(np.sum((y - run.free.output[use, axle]) ** 2))
            power += float(np.sum((y - y.mean()) ** 2))
        if power > 0.0:
            nrmse = 100.0 * math.sqrt(error / power)
            setattr(fits, name, schema.Fit(nrmse_percent=nrmse, fit_percent=100.0 - nrmse))
    return fits


def run_document(fit: RunFit, system: str) -> schema.Run:
    """One recording beside its simulation, in the units of a system."""
    line, recording, units = fit.line, fit.recording, Units(system)
    acceleration = units.unit("acceleration")
    pairs = line.pairs[np.all(line.pairs >= 0, axis=1)]
    pairs = pairs[np.unique(np.linspace(0, len(pairs) - 1, _MAX_POINTS).astype(int))]
    keep = pairs[:, 0]
    rows = np.unique(np.linspace(0, line.times.shape[1] - 1, _MAX_POINTS).astype(int))
    start = line.times[0, 0]
    return schema.Run(
        source=line.source,
        sha256=recording.sha256,
        rate=1.0 / float(np.median(np.diff(line.times[0]))),
        seconds=float(line.times[0, -1] - start),
        rows=int(line.times.shape[1]),
        missing={n: int(np.sum(~np.isfinite(line.values[c]))) for c, n in enumerate(CHANNELS)},
        clipped={n: int(line.clipped[c].sum()) for c, n in enumerate(CHANNELS)},
        bias=schema.Bias(
            unit=acceleration,
            front=units.convert(float(fit.free.begin[-2]), "acceleration"),
            rear=units.convert(float(fit.free.begin[-1]), "acceleration"),
        ),
        unit=acceleration,
        time=units.curve(line.instants[keep] - start),
        chassis={n: _chassis(fit, axle, pairs, units) for axle, n in enumerate(_CHASSIS)},
        wheels=schema.WheelCurves(
            time=units.curve(line.times[0, rows] - start),
            front_wheel=units.curve(line.values[0, rows], "acceleration"),
            rear_wheel=units.curve(line.values[2, rows], "acceleration"),
        ),
        travel=schema.Travel(
            unit=units.unit("deflection"),
            front=_travel(fit, 0, keep, units),
            rear=_travel(fit, 1, keep, units),
            velocity_unit=units.unit("velocity"),
        ),
        checks=[_check(check, units) for check in fit.checks],
    )


def _chassis(
    fit: RunFit, axle: int, pairs: NDArray[np.integer], units: Units
) -> schema.ChassisCurves:
    line, keep = fit.line, pairs[:, axle]
    simulated = fit.free.output[:, axle]
    measured = np.where(line.kind[:, axle] == 0, np.nan, line.reading[:, axle])
    read = line.kind[:, axle] == 1
    residual = line.reading[read, axle] - simulated[read]
    sd = np.sqrt(fit.ensemble[:, :, axle].var(axis=0) + np.mean(residual**2))
    x = line.paired(fit.innovations)[:, axle]
    x = x[np.isfinite(x)]
    x = x - x.mean()
    power = float(x @ x) or 1.0
    order = int(fit.colour.order)

    def curve(values: Array) -> Curve:
        return units.curve(values[keep], "acceleration")

    return schema.ChassisCurves(
        measured=curve(measured),
        simulated=curve(simulated),
        band95=[curve(simulated - 1.96 * sd), curve(simulated + 1.96 * sd)],
        autocorrelation=[float(x[j:] @ x[: len(x) - j]) / power for j in range(_LAGS + 1)],
        autocorrelation_band95=1.96 / math.sqrt(max(len(x), 1)),
        # The lags that whitened the innovations are no evidence of whiteness.
        whiteness_p=portmanteau(x, _LAGS, order) if order < _LAGS else None,
        lag_seconds=line.reading_step,
        spectrum=_spectrum(line.reading[read, axle], residual, line.reading_step, units),
    )


def _spectrum(signal: Array, residual: Array, step: float, units: Units) -> schema.Spectrum:
    from scipy.signal import welch

    length = min(256, len(signal))
    frequency, measured = welch(signal, 1.0 / step, nperseg=length)
    _, left = welch(residual, 1.0 / step, nperseg=length)
    factor = units.convert(1.0, "acceleration") ** 2
    return schema.Spectrum(
        unit=f"({units.unit('acceleration')})^2/Hz",
        frequency=units.curve(frequency[1:]),
        measured=units.curve(factor * measured[1:]),
        residual=units.curve(factor * left[1:]),
    )


def _travel(fit: RunFit, axle: int, keep: NDArray[np.integer], units: Units) -> schema.TravelCurves:
    low, high = np.quantile(fit.travel[:, :, axle], [0.025, 0.975], axis=0)
    deflection, velocity = fit.free.states[:, 2 * axle], fit.free.states[:, 2 * axle + 1]
    return schema.TravelCurves(
        deflection=units.curve(deflection[keep], "deflection"),
        band95=[units.curve(low[keep], "deflection"), units.curve(high[keep], "deflection")],
        velocity=units.curve(velocity[keep], "velocity"),
        largest_bump=units.convert(max(-float(deflection.min()), 0.0), "deflection"),
        largest_droop=units.convert(max(float(deflection.max()), 0.0), "deflection"),
    )


def _check(check: Check, units: Units) -> schema.Check:
    low, median, high = (units.convert(float(v), "acceleration") for v in check.replicated)
    return schema.Check(
        channel=_CHASSIS[check.axle],
        of=check.of,
        quantity=check.quantity,
        band=None if check.band is None else [float(edge) for edge in check.band],
        unit=units.unit("acceleration"),
        observed=units.convert(check.observed, "acceleration"),
        replicated=schema.Replicated(median=median, eti95=[low, high]),
        p=check.p,
        p_larger=check.p_larger,
        p_family=check.p_family,
    )


def run_consistency(result: Estimate) -> schema.RunConsistency | None:
    """Comparison of the runs; None with a single run, or where they were not compared."""
    found, seed = result.agreement, result.seed
    if found is None:
        return None
    units = Units(result.vehicle.units)
    joint = result.joint or result.draws

    def quantities(draws: dict[str, Array]) -> dict[str, Quantity]:
        return {
            name: Quantity(
                unit=units.unit_of(name), **summary(units.convert_parameter(draws[name], name))
            )
            for name in (*found.compared, "k_g")
            if name in draws
        }

    return schema.RunConsistency(
        verdict=found.verdict,
        p=found.whole.p,
        contrasts=found.whole.freedom,
        disagree_below=DISAGREE_BELOW,
        each={name: schema.Test(p=test.p) for name, test in found.each.items()},
        differing=list(found.differing) if found.verdict == "disagree" else [],
        spread_percent={name: _spread(found, name) for name in found.compared},
        own_percent={name: found.own_percent(name) for name in found.compared},
        runs=[
            schema.SingleRun(
                source=run.fit.space.timelines[0].source,
                effective_draws=run.effective,
                parameters=_own_values(found, n, units, seed),
            )
            for n, run in enumerate(found.runs)
        ],
        joint=quantities(joint),
        mean_car=quantities(found.quantities(found.population.centre, seed)),
        next_run=quantities(found.quantities(found.population.next_run, seed)),
    )


def _spread(found: Comparison, name: str) -> schema.Spread:
    low, median, high = (float(v) for v in found.spread_percent(name))
    p = float(np.mean(found.population.spread[:, found.compared.index(name)] > 0.0))
    return schema.Spread(median=median, eti95=[low, high], p_differs=p)


def _own_values(found: Comparison, n: int, units: Units, seed: int) -> dict[str, schema.OwnValue]:
    """Posterior of run `n` by itself, and with the given values held."""
    run = found.runs[n]
    draws = run.fit.space.quantities(run.z, seed)
    values = {}
    for name in (*found.compared, "k_g"):
        if name not in draws:
            continue
        value = schema.OwnValue(
            unit=units.unit_of(name), **summary(units.convert_parameter(draws[name], name))
        )
        if name in found.compared:
            means, sds = found.own_values(name)
            mean, sd = (units.convert_parameter(float(v[n]), name) for v in (means, sds))
            if math.isfinite(mean) and math.isfinite(sd):
                factor = math.exp(Z95 * sd / mean)
                value.own = Summary(mean=mean, sd=sd, eti95=[mean / factor, mean * factor])
        values[name] = value
    return values
