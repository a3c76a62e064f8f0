"""The error budget of an estimate as plain data, in percent and in the vehicle's units."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv.analysis.uncertainty_budget import Answer, Shift, UncertaintyBudget, by_answer
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.units import display_units, from_si
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.report.budget_words import remedy_sentence

__all__ = ["width_document"]

Array = NDArray[np.float64]
Document = dict[str, Any]


def width_document(width: UncertaintyBudget, draws: dict[str, Array], vehicle: Vehicle) -> Document:
    """Tell an error budget.

    Parameters
    ----------
    width : UncertaintyBudget
        Of an estimate.
    draws : dict of str to array
        Its draws by name, SI units.
    vehicle : Vehicle
        As given.

    Returns
    -------
    dict
        For each of c_f, c_r, i and k_g its deviation (``sd_percent``; what the draws say stands
        beside it), ``shares`` of its variance, ``noises`` that the share of the data is made of,
        its deviation if one thing were better, and what would ``halve`` it, the least demanding
        first. ``faults`` holds what undeclared ones would do, with sizes in SI units.
    """
    out: Document = {
        name: _answer(name, answer, width, draws[name], vehicle)
        for name, answer in width.answers.items()
    }
    out["faults"] = {f"{s.kind} {s.where}": _fault(s, width) for s in width.shifts}
    out["white"] = width.white
    out["runs"] = width.runs
    return out


def _answer(
    name: str, answer: Answer, width: UncertaintyBudget, draws: Array, vehicle: Vehicle
) -> Document:
    halve = []
    for remedy in answer.remedies:
        measures = [_measure(source, remedy.times, width, vehicle) for source in remedy.sources]
        sentence = remedy_sentence(measures, [name], width.runs)
        what = " + ".join(measure["what"] for measure in measures)
        halve.append({"what": what, "measures": measures, "sentence": sentence})
    return {
        "sd_percent": 100.0 * answer.sd,
        "posterior_sd_percent": 100.0 * float(np.log(draws).std(ddof=1)),
        "shares": answer.shares,
        "noises": answer.noises,
        "exact_sd_percent": _percents(answer.exact),
        "better_sd_percent": _percents(answer.better),
        "twice_the_runs_sd_percent": 100.0 * answer.twice,
        "halve": halve,
        "runs_to_halve": answer.runs_to_halve,
    }


def _percents(shares: dict[str, float]) -> dict[str, float]:
    return {name: 100.0 * share for name, share in shares.items()}


def _measure(source: int, times: float, width: UncertaintyBudget, vehicle: Vehicle) -> Document:
    """Tell how well one thing has to be known: information grows by `times`."""
    if source < 0:
        return {"what": "runs", "further": max(math.ceil((times - 1.0) * width.runs - 1e-2), 1)}
    name = width.parameters[source]
    if name.startswith("gain "):
        now = 100.0 * float(width.given_sd[source])
        needed = now / math.sqrt(times)
        return {
            "what": name, "now_sd_percent": now, "needed_sd_percent": needed,
            "now_sd": now, "needed_sd": needed, "unit": "",
        }  # fmt: skip
    given = getattr(vehicle, name)
    dimension, _ = QUANTITIES[name]
    unit = display_units(vehicle.units)[dimension]
    now = from_si(given.sd, unit, dimension)
    return {
        "what": name,
        "now_sd_percent": 100.0 * given.sd / given.value,
        "needed_sd_percent": 100.0 * given.sd / given.value / math.sqrt(times),
        "now_sd": now,
        "needed_sd": now / math.sqrt(times),
        "unit": unit,
    }


def _fault(shift: Shift, width: UncertaintyBudget) -> Document:
    moved = by_answer(shift.moved)
    return {
        "kind": shift.kind,
        "where": shift.where,
        "size": shift.size,
        "larger_shows": shift.shows,
        "shift": {
            name: {"percent": 100.0 * value, "sd": value / width.answers[name].sd}
            for name, value in moved.items()
        },
    }
