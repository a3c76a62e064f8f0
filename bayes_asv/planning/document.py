"""The document a plan is told in: plain data, ready for JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv import __version__
from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.units import display_units, from_si
from bayes_asv.planning.grounds import Ground
from bayes_asv.planning.pairs import ALWAYS, pairs
from bayes_asv.planning.plan import Judged, Plan
from bayes_asv.planning.widths import ANSWERS, GIVEN
from bayes_asv.planning.words import (
    always_words,
    assumption_lines,
    common_reasons,
    drive_words,
    ground_words,
    length,
    limit_lines,
    limit_words,
    never_words,
    pair_words,
    speed,
    times_words,
)

__all__ = ["PASSES", "SCHEMA", "plan_document"]

Document = dict[str, Any]

SCHEMA = "bayes_asv/plan/1"

PASSES = (1, 2, 3, 5, 10)
"""Numbers of passes for which widths are listed."""

_MEANING = (
    "one posterior deviation over the value, in percent; the 95 % interval reaches 1.96 times as "
    "far to either side"
)


def plan_document(plan: Plan) -> Document:
    """Tell a plan as plain data.

    Parameters
    ----------
    plan : Plan
        From :func:`bayes_asv.planning.plan.plan`.

    Returns
    -------
    dict
        Schema ``bayes_asv/plan/1``, described in ``docs/plan.md``.
    """
    places = {id(one): k for k, one in enumerate(plan.judged)}
    return {
        "schema": SCHEMA,
        "verdict": plan.verdict,
        "reasons": _reasons(plan),
        "warnings": assumption_lines(plan),
        "vehicle": {
            "name": plan.vehicle.name,
            "units": plan.vehicle.units,
            "sha256": plan.vehicle.sha256,
        },
        "tyres": {
            "assumed": not plan.tyres_told,
            "rate": _axles(plan, plan.tyres.rate, "stiffness"),
            "unsprung_mass": _axles(plan, plan.tyres.mass, "mass"),
        },
        "width": _MEANING,
        "want_percent": _percent(plan.want),
        "most_passes": plan.most_passes,
        "recommended": _recommended(plan, places, plan.chosen),
        "nearest": None if plan.chosen else _recommended(plan, places, plan.best),
        "floor_percent": _percent(plan.floor),
        "given_percent": {n: 100.0 * plan.before.log_sd[n] for n in GIVEN},
        "limits": [
            {
                "parameter": what.answer,
                "needed_percent": _percent(what.needed),
                "words": limit_words(what, plan),
            }
            for what in plan.limits
        ],
        "inseparable": [
            {"of": list(names), "words": words}
            for (names, _), words in zip(ALWAYS, always_words(), strict=True)
        ],
        "drives": [_drive(plan, one) for one in plan.judged],
        "version": __version__,
        "seed": plan.seed,
    }


def _reasons(plan: Plan) -> list[str]:
    if plan.chosen is not None:
        return []
    return limit_lines(plan) or common_reasons(plan.judged)


def _recommended(plan: Plan, places: Mapping[int, int], one: Judged | None) -> Document | None:
    if one is None:
        return None
    words = drive_words(one.trial.drive, plan.vehicle.units)
    return {
        "drive": places[id(one)],
        "passes": plan.passes,
        "width_percent": _percent(plan.promised(one, plan.passes)),
        "words": f"Drive {times_words(plan.passes)} {words}.",
    }


def _drive(plan: Plan, one: Judged) -> Document:
    trial, units = one.trial, plan.vehicle.units
    needed = dict(zip(ANSWERS, one.needed, strict=True))
    out: Document = {
        "road": _road(trial.drive.ground, units),
        "speed": _quantity(trial.drive.speed, speed(trial.drive.speed, units)),
        "rate": trial.drive.rate,
        "seconds": trial.drive.seconds,
        "usable": trial.usable,
        "reasons": list(trial.reasons),
        "notes": list(trial.notes),
        "gentle": trial.gentle,
        "passes_needed": needed,
        "why_never": {n: never_words(plan, one, n) for n in ANSWERS if needed[n] is None},
        "width_percent": None,
        "inseparable": [],
        "largest_reading": _readings(plan, one),
        "travel": _travel(one, units),
        "off_the_ground_seconds": {
            axle: float(time)
            for axle, time in zip(("front", "rear"), trial.flight, strict=True)
        },
    }  # fmt: skip
    if trial.usable:
        out["width_percent"] = {str(n): _percent(plan.promised(one, n)) for n in PASSES}
        out["inseparable"] = [
            {"pair": list(p.names), "correlation": p.correlation, "times_wider": p.blindness,
             "words": pair_words(p)}
            for p in pairs(trial.information)
        ]  # fmt: skip
    return out


def _road(ground: Ground, units: str) -> Document:
    out: Document = {"kind": ground.kind, "words": ground_words(ground, units)}
    if ground.kind == "rough":
        return {**out, "iso_8608": ground.iso}
    long = "gap" if ground.kind == "stops" else "pitch" if ground.kind == "rollers" else "length"
    return {
        **out,
        "count": ground.count,
        "height": _quantity(ground.height, length(ground.height, units)),
        long: _quantity(ground.length, length(ground.length, units)),
    }


def _quantity(si: float, shown: tuple[float, str]) -> Document:
    return {"value": shown[0], "unit": shown[1], "si": si}


def _readings(plan: Plan, one: Judged) -> Document:
    unit = display_units(plan.vehicle.units)["acceleration"]
    values = {
        name: from_si(float(value), unit, "acceleration")
        for name, value in zip(CHANNELS, one.trial.largest, strict=True)
    }
    return {"unit": unit, **values}


def _travel(one: Judged, units: str) -> Document:
    unit = display_units(units)["deflection"]
    names = ("front_bump", "front_droop", "rear_bump", "rear_droop")
    values = {
        name: from_si(float(value), unit, "deflection")
        for name, value in zip(names, one.trial.travel, strict=True)
    }
    return {"unit": unit, **values}


def _axles(plan: Plan, values: NDArray[np.float64], dimension: str) -> Document:
    unit = display_units(plan.vehicle.units)[dimension]
    front, rear = (from_si(float(value), unit, dimension) for value in values)
    return {"unit": unit, "front": front, "rear": rear}


def _percent(shares: Mapping[str, float]) -> dict[str, float | None]:
    return {n: 100.0 * s if math.isfinite(s) else None for n, s in shares.items()}
