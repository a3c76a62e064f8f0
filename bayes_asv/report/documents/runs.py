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
from bayes_asv.domain.channels import Channel
from bayes_asv.domain.quantities import NORMAL_975
from bayes_asv.estimate_result import EstimationResult, RunFit
from bayes_asv.filters.kalman import MISSING, VALUE
from bayes_asv.posterior.residual_ar import portmanteau
from bayes_asv.report.documents.quantities import Units, summary
from bayes_asv.report.schema import estimate as schema
from bayes_asv.report.schema.parts import Curve, Quantity, Summary

__all__ = ["MAX_POINTS", "pooled_fit", "run_consistency", "run_document"]

Array = NDArray[np.float64]

MAX_POINTS: Final = 1500  # of a curve
_LAGS: Final = 20
# m/s that divide low from high speed: J. Segers, "Shock speed histogram analysis".
_LOW_SPEED: Final = 0.025
_RANGES: Final = (
    ("compression", "high", -math.inf, -_LOW_SPEED),
    ("compression", "low", -_LOW_SPEED, 0.0),
    ("rebound", "low", 0.0, _LOW_SPEED),
    ("rebound", "high", _LOW_SPEED, math.inf),
)
_SHORTEST: Final = 64  # readings of which a transmissibility is worked out
_EXCITED: Final = 0.01  # of the wheel's largest spectral density: below it, the ratio is noise


def pooled_fit(runs: Sequence[RunFit], source: str | None = None) -> schema.Fits:
    """Normalised rms error of the simulation driven by the wheels, pooled over runs."""
    error: dict[str, float] = {}
    power: dict[str, float] = {}
    for run in runs:
        for y, channel in enumerate(_outputs(run)):
            use = run.prepared.kind[:, y] == VALUE
            reading, name = run.prepared.reading[use, y], channel.name
            left = float(np.sum((reading - run.free.output[use, y]) ** 2))
            error[name] = error.get(name, 0.0) + left
            power[name] = power.get(name, 0.0) + float(np.sum((reading - reading.mean()) ** 2))
    fits = {}
    for name in error:
        if power[name] > 0.0:
            nrmse = 100.0 * math.sqrt(error[name] / power[name])
            fits[name] = schema.Fit(nrmse_percent=nrmse, fit_percent=100.0 - nrmse)
    return schema.Fits.model_validate(fits if source is None else {"source": source, **fits})


def _outputs(fit: RunFit) -> list[Channel]:
    """Channels of the outputs, in the order of the columns of their arrays."""
    return [fit.prepared.channels[c] for c in fit.prepared.outputs]


def _on_chassis(channel: Channel) -> bool:
    """Whether a channel is the acceleration of the chassis above a wheel or an axle."""
    return channel.part == "body" and channel.axle is not None


def run_document(fit: RunFit, system: str) -> schema.Run:
    """One recording beside its simulation, in the units of a system."""
    prepared, units = fit.prepared, Units(system)
    # Groups of readings without a gap, or all where channels are never read together.
    whole = np.all(prepared.group_instants >= 0, axis=1)
    pairs = prepared.group_instants[whole] if np.any(whole) else prepared.group_instants
    pairs = pairs[np.unique(np.linspace(0, len(pairs) - 1, MAX_POINTS).astype(int))]
    rows = np.unique(np.linspace(0, prepared.times.shape[1] - 1, MAX_POINTS).astype(int))
    transmitted = _transmissibilities(fit, units)
    start, at = prepared.times[0, 0], np.where(pairs[:, 0] >= 0, pairs[:, 0], pairs.max(axis=1))
    outputs = _outputs(fit)
    curves = {c.name: _output(fit, y, pairs, units) for y, c in enumerate(outputs)}
    for name, transmissibility in transmitted.items():
        curves[name].transmissibility = transmissibility
    chassis = {c.name: curves.pop(c.name) for c in outputs if _on_chassis(c)}
    names = [channel.name for channel in prepared.channels]
    run = schema.Run(
        source=prepared.source,
        sha256=fit.recording.sha256,
        rate=1.0 / float(np.median(np.diff(prepared.times[0]))),
        seconds=float(prepared.times[0, -1] - start),
        rows=int(prepared.times.shape[1]),
        missing={n: int(np.sum(~np.isfinite(prepared.values[c]))) for c, n in enumerate(names)},
        clipped={n: int(prepared.clipped[c].sum()) for c, n in enumerate(names)},
        bias=_bias(fit, units),
        unit=units.unit("acceleration"),
        time=units.curve(prepared.instants[at] - start),
        chassis=chassis,
        wheels=schema.WheelCurves(
            time=units.curve(prepared.times[0, rows] - start),
            **{
                names[c]: units.curve(prepared.values[c, rows], "acceleration")
                for c in prepared.inputs
            },
        ),
        travel=schema.Travel(
            unit=units.unit("deflection"),
            velocity_unit=units.unit("velocity"),
            low_speed=units.convert(_LOW_SPEED, "velocity"),
            **{
                element.name: _travel(fit, e, at, units)
                for e, element in enumerate(prepared.car.elements)
            },
        ),
        checks=[_check(check, outputs[check.output], units) for check in fit.checks],
    )
    if curves:
        run.outputs = curves
    return run


def _bias(fit: RunFit, units: Units) -> schema.Bias:
    """Biases of the chassis channels; those of the outputs are the last of the beginning."""
    outputs = _outputs(fit)
    biases = {
        channel.name.removesuffix("_chassis"): units.convert(float(value), "acceleration")
        for value, channel in zip(fit.free.initial_state[-len(outputs) :], outputs, strict=True)
        if _on_chassis(channel)
    }
    return schema.Bias(unit=units.unit("acceleration"), **biases)


def _output(fit: RunFit, y: int, pairs: NDArray[np.integer], units: Units) -> schema.OutputCurves:
    prepared, keep, channel = fit.prepared, pairs[:, y], _outputs(fit)[y]
    simulated = fit.free.output[:, y]
    measured = np.where(prepared.kind[:, y] == MISSING, np.nan, prepared.reading[:, y])
    read = prepared.kind[:, y] == VALUE
    residual = prepared.reading[read, y] - simulated[read]
    sd = np.sqrt(fit.ensemble[:, :, y].var(axis=0) + np.mean(residual**2))
    x = prepared.paired(fit.innovations)[:, y]
    x = x[np.isfinite(x)]
    x = x - x.mean()
    power = float(x @ x) or 1.0
    order = int(fit.residual_ar.order)

    def curve(values: Array) -> Curve:
        return units.curve(np.where(keep >= 0, values[keep], np.nan), channel.dimension)

    curves = schema.OutputCurves(
        measured=curve(measured),
        simulated=curve(simulated),
        band95=[curve(simulated - NORMAL_975 * sd), curve(simulated + NORMAL_975 * sd)],
        autocorrelation=[float(x[j:] @ x[: len(x) - j]) / power for j in range(_LAGS + 1)],
        autocorrelation_band95=NORMAL_975 / math.sqrt(max(len(x), 1)),
        # The lags that whitened the innovations are no evidence of whiteness.
        whiteness_p=portmanteau(x, _LAGS, order) if order < _LAGS else None,
        lag_seconds=prepared.reading_step,
        spectrum=_spectrum(
            prepared.reading[read, y], residual, prepared.reading_step, channel, units
        ),
    )
    if not _on_chassis(channel):
        curves.unit = units.unit(channel.dimension)
    return curves


def _spectrum(
    signal: Array, residual: Array, step: float, channel: Channel, units: Units
) -> schema.Spectrum:
    from scipy.signal import welch

    length = min(256, len(signal))
    frequency, measured = welch(signal, 1.0 / step, nperseg=length)
    _, left = welch(residual, 1.0 / step, nperseg=length)
    factor = units.convert(1.0, channel.dimension) ** 2
    return schema.Spectrum(
        unit=f"({units.unit(channel.dimension)})^2/Hz",
        frequency=units.curve(frequency[1:]),
        measured=units.curve(factor * measured[1:]),
        residual=units.curve(factor * left[1:]),
    )


def _transmissibilities(fit: RunFit, units: Units) -> dict[str, schema.Transmissibility]:
    """Transmissibility to each chassis acceleration from the wheel below it, by its name.

    It is √(S_yy/S_uu) of the spectral densities of output and wheel acceleration (Welch), of the
    reading and of the simulation alike, so that motion from the other wheel is in both.
    """
    from scipy.signal import welch

    prepared, out = fit.prepared, {}
    names = [channel.name for channel in prepared.channels]
    for y, channel in enumerate(_outputs(fit)):
        wheel = channel.name.replace("_chassis", "_wheel")
        if not _on_chassis(channel) or wheel not in names:
            continue
        c = names.index(wheel)
        there = np.isfinite(prepared.values[c])
        read = prepared.kind[:, y] == VALUE
        if min(there.sum(), read.sum()) < _SHORTEST:
            continue
        first, last = (float(t) for t in prepared.instants[read][[0, -1]])
        time = np.arange(first, last, prepared.reading_step)
        length = min(256, len(time))
        densities = []
        for at, values in (
            (prepared.times[c, there], prepared.values[c, there]),
            (prepared.instants[read], prepared.reading[read, y]),
            (prepared.instants[read], fit.free.output[read, y]),
        ):
            signal = np.interp(time, at, values)
            frequency, density = welch(signal, 1.0 / prepared.reading_step, nperseg=length)
            densities.append(density[1:])
        driven, *answers = densities
        excited = driven > _EXCITED * driven.max()
        measured, simulated = (np.sqrt(a[excited] / driven[excited]) for a in answers)
        out[channel.name] = schema.Transmissibility(
            frequency=units.curve(frequency[1:][excited]),
            measured=units.curve(measured),
            simulated=units.curve(simulated),
        )
    return out


def _travel(
    fit: RunFit, element: int, keep: NDArray[np.integer], units: Units
) -> schema.TravelCurves:
    low, high = np.quantile(fit.travel[:, :, element], [0.025, 0.975], axis=0)
    deflection, velocity = fit.free.states[:, 2 * element], fit.free.states[:, 2 * element + 1]
    return schema.TravelCurves(
        deflection=units.curve(deflection[keep], "deflection"),
        band95=[units.curve(low[keep], "deflection"), units.curve(high[keep], "deflection")],
        velocity=units.curve(velocity[keep], "velocity"),
        largest_bump=units.convert(max(-float(deflection.min()), 0.0), "deflection"),
        largest_droop=units.convert(max(float(deflection.max()), 0.0), "deflection"),
        speed_shares=_speed_shares(fit.velocity[:, :, element], velocity),
    )


def _speed_shares(draws: Array, centre: Array) -> list[schema.SpeedShare]:
    """Shares of the time of an element's motion in the ranges of its velocity.

    Parameters
    ----------
    draws : (S, E) array
        Velocities for draws of the posterior, m/s.
    centre : (E,) array
        The same at its mean.
    """
    shares = []
    for side, speed, low, high in _RANGES:
        each = np.mean((draws > low) & (draws <= high), axis=1)
        mean = float(np.mean((centre > low) & (centre <= high)))
        ends = [float(q) for q in np.quantile(each, [0.025, 0.975])]
        shares.append(schema.SpeedShare(side=side, speed=speed, mean=mean, eti95=ends))
    return shares


def _check(check: Check, channel: Channel, units: Units) -> schema.Check:
    dimension = channel.dimension
    low, median, high = (units.convert(float(v), dimension) for v in check.replicated)
    return schema.Check(
        channel=channel.name,
        of=check.of,
        quantity=check.quantity,
        band=None if check.band is None else [float(edge) for edge in check.band],
        unit=units.unit(dimension),
        observed=units.convert(check.observed, dimension),
        replicated=schema.Replicated(median=median, eti95=[low, high]),
        p=check.p,
        p_larger=check.p_larger,
        p_family=check.p_family,
    )


def run_consistency(result: EstimationResult) -> schema.RunConsistency | None:
    """Comparison of the runs; None with a single run, or where they were not compared."""
    comparison, seed = result.run_consistency, result.seed
    if comparison is None:
        return None
    units = Units(result.vehicle.units)
    joint = result.pooled_draws or result.draws

    def quantities(draws: dict[str, Array]) -> dict[str, Quantity]:
        return {
            name: Quantity(
                unit=units.unit_of(name), **summary(units.convert_parameter(draws[name], name))
            )
            for name in (*comparison.compared, *comparison.space.car.ratios)
            if name in draws
        }

    return schema.RunConsistency(
        verdict=comparison.verdict,
        p=comparison.overall_test.p,
        contrasts=comparison.overall_test.freedom,
        disagree_below=DISAGREE_BELOW,
        each={name: schema.Test(p=test.p) for name, test in comparison.parameter_tests.items()},
        differing=list(comparison.differing) if comparison.verdict == "disagree" else [],
        spread_percent={name: _spread(comparison, name) for name in comparison.compared},
        own_percent={name: comparison.own_percent(name) for name in comparison.compared},
        runs=[
            schema.SingleRun(
                source=run.fit.space.recordings[0].source,
                effective_draws=run.effective,
                parameters=_own_values(comparison, n, units, seed),
            )
            for n, run in enumerate(comparison.runs)
        ],
        joint=quantities(joint),
        mean_car=quantities(comparison.quantities(comparison.population.centre, seed)),
        next_run=quantities(comparison.quantities(comparison.population.next_run, seed)),
    )


def _spread(comparison: Comparison, name: str) -> schema.Spread:
    low, median, high = (float(v) for v in comparison.spread_percent(name))
    p = float(np.mean(comparison.population.spread[:, comparison.compared.index(name)] > 0.0))
    return schema.Spread(median=median, eti95=[low, high], p_differs=p)


def _own_values(
    comparison: Comparison, n: int, units: Units, seed: int
) -> dict[str, schema.OwnValue]:
    """Posterior of run `n` by itself, and with the given values held."""
    run = comparison.runs[n]
    draws = run.fit.space.quantities(run.z, seed)
    values = {}
    for name in (*comparison.compared, *comparison.space.car.ratios):
        value = schema.OwnValue(
            unit=units.unit_of(name), **summary(units.convert_parameter(draws[name], name))
        )
        if name in comparison.compared:
            means, sds = comparison.estimates_of_runs(name)
            mean, sd = (units.convert_parameter(float(v[n]), name) for v in (means, sds))
            if math.isfinite(mean) and math.isfinite(sd):
                factor = math.exp(NORMAL_975 * sd / mean)
                value.own = Summary(mean=mean, sd=sd, eti95=[mean / factor, mean * factor])
        values[name] = value
    return values
