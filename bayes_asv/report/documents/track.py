"""Documents of ``track`` and ``watch``, and the trace of a track as CSV."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv import __version__
from bayes_asv.domain.quantities import NORMAL_975, QUANTITIES
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.car_model import CarParameter
from bayes_asv.report.documents.quantities import (
    SummaryFields,
    Units,
    effect_unit,
    effects,
    possible_mistakes,
    provenance,
)
from bayes_asv.report.documents.runs import MAX_POINTS
from bayes_asv.report.schema import TrackDocument, WatchDocument
from bayes_asv.report.schema import track as schema
from bayes_asv.report.schema.parts import Element, Known, Parameter, Quantity, Summary, VehicleInfo
from bayes_asv.report.sections.online_filter import consistency_lines
from bayes_asv.tracking.alarm import Alarm, AlarmMonitor
from bayes_asv.tracking.consistency import LAGS, WINDOW
from bayes_asv.tracking.effects import EffectParameter
from bayes_asv.tracking.frames import Frames
from bayes_asv.tracking.parameters import Coordinates
from bayes_asv.tracking.track import TrackResult
from bayes_asv.tracking.tracker import Tracker

__all__ = ["Trace", "track_document", "watch_document"]

Array = NDArray[np.float64]

_PACKAGES: Final = ("numpy", "scipy", "numba", "filterpy")
_PIECE: Final = 1 << 20  # bytes


def track_document(result: TrackResult, trace: str | None = None, seed: int = 0) -> TrackDocument:
    """Document of a track.

    Parameters
    ----------
    result : TrackResult
        From :func:`bayes_asv.tracking.track.track`.
    trace : str, optional
        File to which the trace was written.
    seed : int
        As given; the filter draws nothing.
    """
    vehicle, ok = result.vehicle, result.verdict == "ok"
    car = result.coordinates.car
    parameters = (*result.coordinates.estimands, *result.derived)
    given = [p for p in car.parameters if p.kind != "estimated" and p.terms]
    document = TrackDocument(
        schema="bayes_asv/track/1",
        car=car.name,
        elements={
            e.name: Element(axle=e.axle, side=e.side, damping=e.damping, spring=e.spring)
            for e in car.elements
        },
        channels=[channel.name for channel in result.channels],
        verdict=result.verdict,
        reasons=list(result.reasons),
        warnings=list(result.warnings),
        doubt="" if result.doubt is None else result.doubt.sentence,
        nominal_mistakes=possible_mistakes(result.nominal_damping),
        parameters={n: _parameter(n, result) for n in parameters} if ok else {},
        effects=effects(result.effects, vehicle) if ok else [],
        consistency=_consistency(result),
        known={p.name: _known(p, result) for p in given},
        track=_curves(result) if ok else None,
        filter=schema.Filter(
            engine=result.engine,
            forget_seconds=result.forget,
            rate=result.rate,
            rows=result.rows,
            seconds=max(result.end - result.begin, 0.0),
            resets=list(result.resets),
        ),
        vehicle=VehicleInfo(
            name=vehicle.name,
            units=vehicle.units,
            source=Path(vehicle.source).name,
            sha256=vehicle.sha256,
        ),
        provenance=provenance([(result.source, result.sha256)], vehicle, _PACKAGES, seed),
        seconds=result.seconds,
        version=__version__,
        seed=seed,
    )
    if trace is not None:
        document.trace = trace
    document.consistency.words = consistency_lines(document)
    return document


def _log_normal(log_mean: float, log_sd: float, factor: float) -> SummaryFields:
    """Summary of a log-normal distribution in other units."""
    mean, sd = (float(v) for v in _moments(np.array(log_mean), np.array(log_sd)))
    low, median, high = (math.exp(log_mean + z * log_sd) for z in (-NORMAL_975, 0.0, NORMAL_975))
    return {
        "mean": factor * mean, "median": factor * median, "sd": factor * sd,
        "eti95": [factor * low, factor * high],
    }  # fmt: skip


def _parameter(name: str, result: TrackResult) -> Parameter:
    """One parameter of interest after the last row, log-normal."""
    log_mean, log_sd = result.log_moments(name)
    nominal = result.nominal[name]
    units, si = Units(result.vehicle.units), Units("SI")
    factor = units.convert_parameter(1.0, name)
    return Parameter(
        label=QUANTITIES[name][1],
        unit=units.unit_of(name),
        **_log_normal(log_mean, log_sd, factor),
        nominal=units.convert_parameter(nominal, name),
        p_below_nominal=result.probability_below_nominal(name),
        withheld=result.doubt is not None,
        si=Quantity(unit=si.unit_of(name), **_log_normal(log_mean, log_sd, 1.0), nominal=nominal),
    )


def _known(given: CarParameter, result: TrackResult) -> Known:
    """One given value, and its posterior."""
    units, coordinates, name = Units(result.vehicle.units), result.coordinates, given.name
    declared = getattr(result.vehicle, name, None)  # of one side of an axle there is none
    log_sd = math.sqrt(sum((weight * sd) ** 2 for _, weight, sd in given.terms))
    sd = given.nominal * log_sd if declared is None else declared.sd
    known = Known(
        label=QUANTITIES[name][1],
        unit=units.unit_of(name),
        value=units.convert_parameter(given.nominal, name),
        sd=units.convert_parameter(sd, name),
    )
    if name in coordinates.names and result.verdict == "ok":
        k = coordinates.names.index(name)
        mean = coordinates.centre[k] + coordinates.scale[k] * float(result.mean[k])
        sd = coordinates.scale[k] * math.sqrt(result.covariance[k, k])
        factor = units.convert_parameter(1.0, name)
        if coordinates.log[k]:
            known.posterior = Summary(**_log_normal(mean, sd, factor))
        else:
            ends = [factor * (mean + side * NORMAL_975 * sd) for side in (-1.0, 1.0)]
            known.posterior = Summary(mean=factor * mean, sd=factor * sd, eti95=ends)
    return known


def _consistency(result: TrackResult) -> schema.Consistency:
    consistency = result.consistency
    outputs = [channel.name for channel in result.channels if not channel.is_input]
    by_output = dict(zip(outputs, consistency.correlation.tolist(), strict=True))
    return schema.Consistency(
        nis_mean=consistency.nis_mean,
        nis_band95=list(consistency.nis_band95),
        verdict=consistency.verdict,
        faults=list(consistency.faults),
        readings=consistency.readings,
        share_of_time=consistency.consistent_share,
        largest_noise_level=math.sqrt(consistency.max_noise_factor),
        colour=consistency.max_box_pierce,
        autocorrelation=schema.Autocorrelation(
            front=by_output.get("front_chassis", []),
            rear=by_output.get("rear_chassis", []),
            outputs=by_output,
            band95=NORMAL_975 / math.sqrt(max(consistency.readings // len(by_output), 1)),
            lags=LAGS,
            lag_seconds=1.0 / result.rate,
        ),
        window_seconds=WINDOW,
    )


def _curves(result: TrackResult) -> schema.TrackCurves:
    frames, units = result.frames, Units(result.vehicle.units)
    keep = np.unique(np.linspace(0, len(frames) - 1, MAX_POINTS).astype(int))
    # An inconsistency between two points of a curve is kept as well.
    since = np.append(0, keep[:-1] + 1)
    parameters = {}
    for k, name in enumerate(result.coordinates.estimands):
        median, sd = frames.median[keep, k], frames.log_sd[keep, k]
        dimension = QUANTITIES[name][0]
        parameters[name] = schema.ParameterCurve(
            unit=units.unit_of(name),
            median=units.curve(median, dimension),
            band95=[
                units.curve(median * np.exp(side * NORMAL_975 * sd), dimension)
                for side in (-1.0, 1.0)
            ],
        )
    laws = {}
    for k, effect in _shown_effects(result.coordinates):
        mean, sd = frames.effect[keep, k], frames.effect_sd[keep, k]
        factor, unit = effect_unit(effect.parameter.unit, units)
        low, median, high = (
            units.curve(factor * effect.values(mean + side * NORMAL_975 * sd))
            for side in (-1.0, 0.0, 1.0)
        )
        laws[_effect_label(effect)] = schema.ParameterCurve(
            unit=unit, median=median, band95=[low, high]
        )
    return schema.TrackCurves(
        effects=laws,
        time=units.curve(frames.time[keep] - result.begin),
        parameters=parameters,
        nis=schema.NisCurve(
            mean=units.curve(frames.nis_mean[keep]),
            band95=[units.curve(frames.nis_low[keep]), units.curve(frames.nis_high[keep])],
        ),
        inflation=units.curve(np.maximum.reduceat(frames.inflation, since)),
        consistent=np.logical_and.reduceat(frames.consistent, since).tolist(),
    )


def watch_document(
    tracker: Tracker, monitor: AlarmMonitor, alarm: Alarm | None, source: str, seed: int = 0
) -> WatchDocument:
    """Document of a watch.

    Parameters
    ----------
    tracker : Tracker
        After the last row.
    monitor : AlarmMonitor
        Settings of the alarm, and its last state.
    alarm : Alarm or None
        The alarm that was raised.
    source : str
        Recording or port.
    seed : int
        As given; nothing is drawn.
    """
    name = Path(source).name
    reasons = [] if alarm else tracker.unanswered(name)
    summary = tracker.consistency.summary()
    if not alarm and not reasons and (summary.verdict == "inconsistent" or not summary.readings):
        reasons = [
            f"whether a damper is worn cannot be told from {name}: the errors of the filter do not "
            "match its stated uncertainty; run 'bayes-asv track' to see when and 'bayes-asv "
            "diagnose' to find why"
            if summary.readings
            else f"whether a damper is worn cannot be told from {name}: no reading tested the "
            "filter; drive over bumps"
        ]
    doubt = tracker.input_doubt(name, refused=bool(reasons))
    if doubt is not None and doubt.mistakes:
        # What looks like a worn damper may be the mistake.
        alarm, reasons = None, [doubt.sentence, *reasons]
    return WatchDocument(
        schema="bayes_asv/watch/1",
        car=tracker.coordinates.car.name,
        verdict="alarm" if alarm else "refused" if reasons else "ok",
        reasons=list(reasons),
        warnings=[] if doubt is None or reasons else [doubt.sentence],
        doubt="" if doubt is None else doubt.sentence,
        asked=schema.AlarmSettings(
            share=monitor.share, probability=monitor.threshold, hold_seconds=monitor.hold
        ),
        alarm=None
        if alarm is None
        else schema.AlarmInfo(
            axle=alarm.axle,
            time=alarm.time,
            since=alarm.since,
            probability=alarm.probability,
            share_of_nominal=alarm.median,
            eti95=[alarm.low, alarm.high],
        ),
        probability={
            place: float(p) for place, p in zip(monitor.places, monitor.probability, strict=True)
        },
        seconds_watched=monitor.rows / tracker.rate,
        share_of_time=monitor.rows_consistent / max(monitor.rows, 1),
        recording=name,
        version=__version__,
        seed=seed,
    )  # fmt: skip


def _shown_effects(coordinates: Coordinates) -> list[tuple[int, EffectParameter]]:
    """Parameters of force laws that are reported, with their places in the frames."""
    return [(k, e) for k, e in enumerate(coordinates.law_effects) if not e.parameter.shape]


def _effect_label(effect: EffectParameter) -> str:
    return f"{effect.placed} {effect.parameter.name}"


class Trace:
    """State of the filter after each row, as CSV in the vehicle's units.

    Columns are ``time [s]``, ``c_f mean``, ``c_f sd``, … of all parameters of interest and of the
    parameters of force laws (``bound_rebound@front ratio mean``), then ``nis mean`` (one before the
    first reading that counts), ``inflation`` and ``consistent`` (1 or 0).  The rows are kept in an
    unnamed temporary file and not in memory.

    Parameters
    ----------
    vehicle : Vehicle
        Determines the units.
    coordinates : Coordinates
        Of the filter.
    """

    def __init__(self, vehicle: Vehicle, coordinates: Coordinates) -> None:
        self._names = coordinates.estimands
        self._effects = _shown_effects(coordinates)
        self._units = Units(vehicle.units)
        self._file = tempfile.TemporaryFile()  # noqa: SIM115 # lives as long as the trace
        shown = [*self._names, *(_effect_label(effect) for _, effect in self._effects)]
        names = [f"{name} {what}" for name in shown for what in ("mean", "sd")]
        columns = ["time [s]", *names, "nis mean", "inflation", "consistent"]
        self._file.write((",".join(columns) + "\n").encode())

    def append(self, frames: Frames) -> None:
        """Append the frames that follow."""
        values = [frames.time]
        for k, name in enumerate(self._names):
            for value in _moments(np.log(frames.median[:, k]), frames.log_sd[:, k]):
                values.append(self._units.convert_parameter(value, name))
        for k, effect in self._effects:
            factor, _ = effect_unit(effect.parameter.unit, self._units)
            values += [
                factor * moment
                for moment in effect.moments(frames.effect[:, k], frames.effect_sd[:, k])
            ]
        values += [frames.nis_mean, frames.inflation, frames.consistent.astype(float)]
        rows = np.column_stack(values).tolist()
        self._file.writelines((",".join(f"{v:.9g}" for v in row) + "\n").encode() for row in rows)

    def close(self) -> None:
        """Delete the temporary file; may be called twice."""
        self._file.close()

    def pieces(self) -> Iterator[bytes]:
        """Yield the whole file, from the header on."""
        self._file.seek(0)
        while piece := self._file.read(_PIECE):
            yield piece


def _moments(log_mean: Array, log_sd: Array) -> tuple[Array, Array]:
    """Mean and standard deviation of a log-normal distribution."""
    mean = np.exp(log_mean + 0.5 * log_sd**2)
    return mean, mean * np.sqrt(np.expm1(log_sd**2))
