"""The plan as a document of schema ``bayes_asv/plan/1``, ready for JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv import __version__
from bayes_asv.domain.units import display_units, from_si
from bayes_asv.planning.drive_information import correlated_pairs, inseparable_groups
from bayes_asv.planning.drives import RoadProfile
from bayes_asv.planning.plan import PlanResult, RatedDrive
from bayes_asv.planning.text import (
    assumption_lines,
    common_reasons,
    drive_text,
    length,
    limit_lines,
    limit_sentence,
    pair_text,
    road_text,
    speed,
    times_text,
    unidentifiable_lines,
    unidentified_lines,
    unreachable_reason,
)

__all__ = ["PASSES", "SCHEMA", "plan_document"]

Document = dict[str, Any]

SCHEMA = "bayes_asv/plan/1"

PASSES = (1, 2, 3, 5, 10)
"""Numbers of passes for which standard deviations are listed."""

_WIDTH_MEANING = (
    "posterior standard deviation over the value, in percent; the 95 % interval extends 1.96 times "
    "that to either side"
)


def plan_document(plan: PlanResult) -> Document:
    """Convert a plan to a document.

    Parameters
    ----------
    plan : PlanResult
        From :func:`bayes_asv.planning.plan.plan`.

    Returns
    -------
    dict
        Schema ``bayes_asv/plan/1``, described in ``docs/plan.md``.
    """
    indices = {id(one): k for k, one in enumerate(plan.rated)}
    return {
        "schema": SCHEMA,
        "verdict": plan.verdict,
        "reasons": _reasons(plan),
        "warnings": assumption_lines(plan),
        "car": plan.measured.car.name,
        "channels": [channel.name for channel in plan.measured.channels],
        "vehicle": {
            "name": plan.vehicle.name,
            "units": plan.vehicle.units,
            "sha256": plan.vehicle.sha256,
        },
        "tyres": {
            "assumed": not plan.tyres_given,
            "rate": _axles(plan, plan.tyres.rate, "stiffness"),
            "unsprung_mass": _axles(plan, plan.tyres.mass, "mass"),
        },
        "width": _WIDTH_MEANING,
        "want_percent": _percent(plan.want),
        "most_passes": plan.max_passes,
        "recommended": _recommendation(plan, indices, plan.chosen),
        "nearest": None if plan.chosen else _recommendation(plan, indices, plan.best),
        "floor_percent": _percent(plan.sd_floor),
        "given_percent": {n: 100.0 * plan.prior.sd(n) for n in plan.prior.given},
        "unidentified": unidentified_lines(plan),
        "limits": [
            {
                "parameter": limiting.parameter,
                "needed_percent": _percent(limiting.required_sd),
                "words": limit_sentence(limiting, plan),
            }
            for limiting in plan.limits
        ],
        "inseparable": [
            {"of": list(group.names), "words": words}
            for group, words in zip(
                inseparable_groups(plan.prior), unidentifiable_lines(plan), strict=True
            )
        ],
        "drives": [_drive_document(plan, one) for one in plan.rated],
        "version": __version__,
        "seed": plan.seed,
    }


def _reasons(plan: PlanResult) -> list[str]:
    if plan.chosen is not None:
        return []
    return limit_lines(plan) or common_reasons(plan.rated)


def _recommendation(
    plan: PlanResult, indices: Mapping[int, int], one: RatedDrive | None
) -> Document | None:
    if one is None:
        return None
    words = drive_text(one.evaluation.drive, plan.vehicle.units)
    return {
        "drive": indices[id(one)],
        "passes": plan.passes,
        "width_percent": _percent(plan.sd_after(one, plan.passes)),
        "words": f"Drive {times_text(plan.passes)} {words}.",
    }


def _drive_document(plan: PlanResult, one: RatedDrive) -> Document:
    evaluation, units = one.evaluation, plan.vehicle.units
    required = dict(one.required_passes)
    out: Document = {
        "road": _road_document(evaluation.drive.road, units),
        "speed": _quantity(evaluation.drive.speed, speed(evaluation.drive.speed, units)),
        "rate": evaluation.drive.rate,
        "seconds": evaluation.drive.seconds,
        "usable": evaluation.usable,
        "reasons": list(evaluation.reasons),
        "notes": list(evaluation.notes),
        "gentle": evaluation.gentle,
        "passes_needed": required,
        "why_never": {
            n: unreachable_reason(plan, one, n) for n in plan.estimands if required[n] is None
        },
        "width_percent": None,
        "inseparable": [],
        "largest_reading": _largest_readings(plan, one),
        "travel": _travel(one, units),
        "off_the_ground_seconds": evaluation.airborne,
    }  # fmt: skip
    if evaluation.usable:
        out["width_percent"] = {str(n): _percent(plan.sd_after(one, n)) for n in PASSES}
        out["inseparable"] = [
            {"pair": list(p.names), "correlation": p.correlation, "times_wider": p.sd_inflation,
             "words": pair_text(p)}
            for p in correlated_pairs(evaluation.information, plan.prior)
        ]  # fmt: skip
    return out


def _road_document(road: RoadProfile, units: str) -> Document:
    out: Document = {"kind": road.kind, "words": road_text(road, units)}
    if road.kind == "rough":
        return {**out, "iso_8608": road.iso}
    length_key = "gap" if road.kind == "stops" else "pitch" if road.kind == "rollers" else "length"
    return {
        **out,
        "count": road.count,
        "height": _quantity(road.height, length(road.height, units)),
        length_key: _quantity(road.length, length(road.length, units)),
    }


def _quantity(si: float, shown: tuple[float, str]) -> Document:
    return {"value": shown[0], "unit": shown[1], "si": si}


def _largest_readings(plan: PlanResult, one: RatedDrive) -> Document:
    """Largest reading of each channel, in one unit for accelerations and another for the others."""
    units = display_units(plan.vehicle.units)
    out: Document = {"unit": units["acceleration"]}
    others: dict[str, Document] = {}
    for channel, value in zip(plan.measured.channels, one.evaluation.largest, strict=True):
        unit = units[channel.dimension]
        shown = from_si(float(value), unit, channel.dimension)
        if channel.quantity == "acceleration":
            out[channel.name] = shown
        else:
            others[channel.name] = {"value": shown, "unit": unit}
    return {**out, "others": others} if others else out


def _travel(one: RatedDrive, units: str) -> Document:
    unit = display_units(units)["deflection"]
    values = {n: from_si(x, unit, "deflection") for n, x in one.evaluation.travel.items()}
    return {"unit": unit, **values}


def _axles(plan: PlanResult, values: NDArray[np.float64], dimension: str) -> Document:
    """Add up the elements of each axle."""
    unit, car = display_units(plan.vehicle.units)[dimension], plan.measured.car
    sums = {a: float(values[list(car.elements_at(a))].sum()) for a in car.axles}
    return {"unit": unit, **{a: from_si(x, unit, dimension) for a, x in sums.items()}}


def _percent(fractions: Mapping[str, float]) -> dict[str, float | None]:
    return {n: 100.0 * f if math.isfinite(f) else None for n, f in fractions.items()}
