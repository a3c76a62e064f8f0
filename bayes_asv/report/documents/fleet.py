"""Document of a season of recordings: dates, verdicts, and the trend of every damper."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv import __version__
from bayes_asv.analysis.random_effects import RunLikelihood
from bayes_asv.analysis.trends import FEWEST, Coordinates, Trend, find_trend, values_of_runs
from bayes_asv.batch.dates import date_of_file, date_of_name
from bayes_asv.domain.quantities import NORMAL_975, QUANTITIES
from bayes_asv.domain.units import from_si
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.car_model import CarModel
from bayes_asv.models.cars import car_model
from bayes_asv.report.documents.estimate import vehicle_info
from bayes_asv.report.documents.quantities import Units, provenance
from bayes_asv.report.schema.estimate import EstimateDocument
from bayes_asv.report.schema.fleet import (
    FleetChange,
    FleetDocument,
    FleetFile,
    FleetTrend,
    FleetValue,
    Ratio,
)
from bayes_asv.report.schema.parts import Parameter
from bayes_asv.report.words import plain

__all__ = ["SeasonFile", "fleet_document", "season_extract"]

Array = NDArray[np.float64]

_NOT_CONVERGED: Final = "the sampler did not converge"
_PACKAGES: Final = ("numpy", "scipy", "emcee", "numba")


class SeasonFile(NamedTuple):
    """A file of the season.

    Parameters
    ----------
    path : str
        As given.
    sha256 : str
        Of its content; empty where it cannot be read.
    key : str
        Of its answer; empty where it cannot be read,
    reason : str
        and why.
    """

    path: str
    sha256: str
    key: str
    reason: str = ""


def season_extract(document: EstimateDocument, recorded: str, vehicle: Vehicle) -> dict[str, Any]:
    """Take from the estimate of one recording what the season needs, as plain data.

    Parameters
    ----------
    document : EstimateDocument
        Of any verdict.
    recorded : str
        Date from the metadata of the recording, or empty.
    vehicle : Vehicle
        The car.
    """
    verdict = "doubtful" if document.doubt and document.verdict == "ok" else document.verdict
    found: dict[str, Any] = {
        "verdict": verdict,
        "reason": (document.reasons[0] if document.reasons else "")
        or document.doubt
        or (_NOT_CONVERGED if verdict == "not_converged" else ""),
        "recorded": recorded,
        "car": document.car,
        "parameters": {
            name: {"mean": p.mean, "sd": p.sd, "eti95": list(p.eti95)}
            for name, p in document.parameters.items()
        },
    }
    if verdict == "ok":
        draws = {
            name: np.array(curve) / from_si(1.0, document.parameters[name].unit, dimension)
            if name in document.parameters
            else np.array(curve) / from_si(1.0, document.known[name].unit, dimension)
            for name, curve in document.draws.items()
            for dimension in [QUANTITIES[name][0]]
            if name in document.parameters or name in document.known
        }
        likelihood = Coordinates(car_model(document.car, vehicle)).likelihood(draws)
        found["precision"] = likelihood.precision.tolist()
        found["linear"] = likelihood.linear.tolist()
    return found


def fleet_document(
    files: Sequence[SeasonFile],
    extracts: Mapping[str, dict[str, Any]],
    failures: Mapping[str, str],
    vehicle: Vehicle,
    seed: int,
) -> FleetDocument:
    """Put a season together.

    Parameters
    ----------
    files : sequence of SeasonFile
        In any order.
    extracts : mapping of str to dict
        By key, from :func:`season_extract`; with ``verdict`` and ``reason`` alone where there is no
        estimate.
    failures : mapping of str to str
        Why there is none, by the keys of files that have no extract.
    vehicle : Vehicle
        The car.
    seed : int
        Same seed, same draws.
    """
    rows: list[tuple[FleetFile, dict[str, Any]]] = []
    first: dict[str, str] = {}
    for file in files:
        if not file.key:
            extract: dict[str, Any] = {"verdict": "unreadable", "reason": file.reason}
        elif file.key in failures:
            extract = {"verdict": "failed", "reason": failures[file.key]}
        elif file.sha256 in first:
            extract = {"verdict": "duplicate", "reason": f"is a copy of {first[file.sha256]}"}
        else:
            extract = extracts[file.key]
            first[file.sha256] = file.path
        rows.append((_file_row(file, extract), extract))
    rows.sort(key=lambda row: (row[0].date, row[0].file))
    found = [row for row, _ in rows]
    counts = Counter(row.verdict for row in found)
    warnings = _date_warnings(found)
    used = [(row, extract) for row, extract in rows if row.verdict == "ok"]
    cars = Counter(row.car for row, _ in used)
    trends: dict[str, FleetTrend] = {}
    if cars:
        usual = cars.most_common(1)[0][0]
        if len(cars) > 1:
            warnings.append(
                f"the trends are those of the {cars[usual]} recordings with the model {usual}; "
                f"{len(used) - cars[usual]} have other channels"
            )
        used = [(row, extract) for row, extract in used if row.car == usual]
        trends, more = _trends(used, usual, vehicle, seed)
        warnings += more
    reasons = [] if counts["ok"] else ["no recording has a verdict on the dampers"]
    return FleetDocument(
        schema="bayes_asv/fleet/1",
        verdict="ok" if counts["ok"] else "refused",
        reasons=reasons,
        warnings=warnings,
        counts=dict(sorted(counts.items(), key=lambda one: -one[1])),
        trends=trends,
        files=found,
        vehicle=vehicle_info(vehicle),
        provenance=provenance((), vehicle, _PACKAGES, seed),
        version=__version__,
        seed=seed,
    )


def _file_row(file: SeasonFile, extract: Mapping[str, Any]) -> FleetFile:

    date, origin = _date(file.path, extract.get("recorded", ""))
    return FleetFile(
        file=plain(file.path),
        sha256=file.sha256,
        verdict=extract["verdict"],
        reason=plain(extract["reason"]),
        date=date.isoformat(timespec="seconds"),
        date_from=origin,
        answer=f"{file.key}.json" if "parameters" in extract else "",
        car=extract.get("car", ""),
        parameters={
            name: FleetValue(**values) for name, values in extract.get("parameters", {}).items()
        },
    )


def _date(path: str, recorded: str) -> tuple[datetime, str]:
    """Date of a recording, and where it is from."""
    if recorded:
        return datetime.fromisoformat(recorded), "metadata"
    named = date_of_name(path)
    if named is not None:
        return named, "name"
    try:
        return date_of_file(path), "file"
    except OSError:
        return datetime(1970, 1, 1), "file"


def _date_warnings(files: Sequence[FleetFile]) -> list[str]:
    guessed = sum(file.date_from == "file" and file.verdict == "ok" for file in files)
    if not guessed:
        return []
    have, their = ("recording has", "its") if guessed == 1 else ("recordings have", "their")
    return [
        f"{guessed} {have} no date in {their} metadata or name; the time at which {their} "
        "file was last written is used, and a copy may have changed it"
    ]


def _trends(
    used: Sequence[tuple[FleetFile, dict[str, Any]]], car: str, vehicle: Vehicle, seed: int
) -> tuple[dict[str, FleetTrend], list[str]]:
    """Find the trend of every damper of the recordings, which are in order of their dates."""
    model = car_model(car, vehicle)
    coordinates = Coordinates(model)
    runs = [
        RunLikelihood(np.array(extract["precision"]), np.array(extract["linear"]))
        for _, extract in used
    ]
    epoch = datetime(1970, 1, 1)
    dates = [datetime.fromisoformat(row.date) - epoch for row, _ in used]
    days = np.array([date.total_seconds() / 86400.0 for date in dates])
    value, sd, centre = values_of_runs(runs, coordinates.directions)
    value += coordinates.slopes @ centre
    found, warnings = {}, []
    for element in model.elements:
        name = element.damping
        k = model.estimated.index(name)
        known = [n for n, there in enumerate(np.isfinite(value[:, k])) if there]
        trend = find_trend(days[known], value[known, k], sd[known, k], seed)
        if trend is None:
            warnings.append(
                f"{QUANTITIES[name][1]}: a trend needs {FEWEST} recordings of at least two dates, "
                f"and there are {len(known)} that tell it"
            )
            continue
        rows = [used[n][0] for n in known]
        found[name] = _trend(name, trend, rows, value[known, k], sd[known, k], vehicle, model)
    return found, warnings


def _trend(
    name: str,
    trend: Trend,
    rows: Sequence[FleetFile],
    value: Array,
    sd: Array,
    vehicle: Vehicle,
    model: CarModel,
) -> FleetTrend:
    """Write a trend in the vehicle's units."""
    units = Units(vehicle.units)
    nominal = float(model.nominal[name][0])
    shown = units.convert_parameter(nominal, name)

    def rate(logs: Array) -> list[float | None]:
        return [float(f"{shown * math.exp(x):.6g}") for x in logs]

    def ratio(kind: type[Ratio], numbers: Sequence[float], **more: Any) -> Any:
        median, low, high = (float(x) for x in numbers)
        return kind(median=median, eti95=[low, high], **more)

    # The errors of the given values, which all recordings share, are in each one's own deviation.
    total = np.array([row.parameters[name].sd / row.parameters[name].mean for row in rows])
    shared = float(np.median(np.maximum(total**2 - sd**2, 0.0)))
    middle, low, high = trend.level[:, -1]
    log_sd = math.sqrt(((high - low) / (2.0 * NORMAL_975)) ** 2 + shared)
    median = shown * math.exp(middle)
    mean = median * math.exp(0.5 * log_sd**2)
    latest = Parameter(
        label=QUANTITIES[name][1], unit=units.unit_of(name), mean=mean, median=median,
        sd=mean * math.sqrt(math.expm1(log_sd**2)),
        eti95=[median * math.exp(s * NORMAL_975 * log_sd) for s in (-1.0, 1.0)],
        nominal=shown,
        p_below_nominal=0.5 * math.erfc(middle / (log_sd * math.sqrt(2.0))),
    )  # fmt: skip
    return FleetTrend(
        label=QUANTITIES[name][1],
        unit=units.unit_of(name),
        nominal=shown,
        kind=trend.kind,
        p_no_change=trend.no_change,
        p_gradual=trend.gradual,
        p_sudden=[float(p) for p in trend.sudden],
        p_value=trend.p_value,
        gradual=ratio(Ratio, trend.drift),
        changes=[
            ratio(
                FleetChange, (c.ratio, c.low, c.high), after=rows[c.first].date,
                before=rows[c.last].date, probability=c.probability,
            )
            for c in trend.changes
        ],
        scatter=ratio(Ratio, trend.scatter),
        latest=latest,
        date=[row.date for row in rows],
        value=rate(value),
        value95=[rate(value - NORMAL_975 * sd), rate(value + NORMAL_975 * sd)],
        level=rate(trend.level[0]),
        level95=[rate(trend.level[1]), rate(trend.level[2])],
    )  # fmt: skip
