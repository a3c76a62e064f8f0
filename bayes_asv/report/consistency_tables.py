"""Tables of one run against another and of the posterior predictive checks."""

from __future__ import annotations

from typing import Any, Final

from bayes_asv.report.consistency_words import (
    UNLIKELY,
    band_words,
    by_distance,
    spread_words,
    unlikely_checks,
)
from bayes_asv.report.readable import number, plain, probability, readable_unit

__all__ = ["agreement_table", "check_table"]

Document = dict[str, Any]

_COMPARED: Final = {
    "c_f": "front damping",
    "c_r": "rear damping",
    "i": "pitch inertia",
}
_STAR: Final = "✱"
_ROWS: Final = 3  # of one run where there are several


def agreement_table(document: Document) -> Document | None:
    """Each run's own values, the answers from all, and the spread from run to run."""
    found = document.get("agreement")
    if not found or not found["runs"]:
        return None
    names = [n for n in _COMPARED if any(n in run["parameters"] for run in found["runs"])]
    units = {n: readable_unit(found["mean_car"][n]["unit"]) for n in names}
    rows = [
        [plain(run["source"]), *(_own(run["parameters"].get(n) or {}) for n in names)]
        for run in found["runs"]
    ]
    if found["joint"]:
        rows.append(["all, if alike", *(_interval(found["joint"][n]) for n in names)])
    if found["verdict"] == "disagree":
        rows.append(["mean car", *(_interval(found["mean_car"][n]) for n in names)])
        rows.append(["a run to come", *(_interval(found["next_run"][n]) for n in names)])
        spread = found["spread_percent"]
        rows.append(["spread from run to run", *(spread_words(spread[n]) for n in names)])
    rows.append(["probability, if alike", *(probability(found["each"][n]["p"]) for n in names)])
    return {
        "kind": "table",
        "title": "One run against another",
        "columns": ["recording", *(f"{_COMPARED[n]} [{units[n]}]" for n in names)],
        "rows": rows,
        "note": "A run's value ± one deviation is its own, with the given values held at what all "
        "runs say of them: their errors are common to all runs and make no difference between "
        "them. Answers from all runs are 95 % intervals with everything in them. The last row is "
        "the probability of so much difference among runs that are alike.",
    }


def _own(parameter: Document) -> str:
    own = parameter.get("own")
    if not own:
        return "–"
    return f"{number(own['mean'], own['sd'])} ± {number(own['sd'], own['sd'])}"


def _interval(parameter: Document) -> str:
    low, high = parameter["eti95"]
    return f"{number(low, parameter['sd'])} to {number(high, parameter['sd'])}"


def check_table(document: Document) -> Document | None:
    """Set measurements beside what the model makes: all for one run, the farthest out of many."""
    runs = [run for run in document.get("runs") or [] if run.get("checks")]
    if not runs:
        return None
    rows = []
    for run in runs:
        far = by_distance(run["checks"])
        of = f"{plain(run['source'])}: " if len(runs) > 1 else ""
        shown = run["checks"] if len(runs) == 1 else unlikely_checks(run)[:_ROWS] or far[:1]
        rows += [[f"{of}{_label(check)}", *_cells(check)] for check in shown]
    unit = readable_unit(runs[0]["checks"][0]["unit"])
    note = (
        f"Of each run up to {_ROWS} that are marked, the farthest out first, or else the farthest "
        "out. "
        if len(runs) > 1
        else ""
    )
    return {
        "kind": "table",
        "title": "Would the model make such recordings?",
        "columns": ["what", f"measured [{unit}]", f"by the model [{unit}]", "p"],
        "rows": rows,
        "note": f"{note}The model's recordings are made with draws of the posterior, the measured "
        "wheels and fresh sensor noise; what is left is the difference to the simulation, whose "
        "start and biases are fitted to each recording alike. 95 % of them lie in the range given, "
        f"and p is the two-sided probability of one as far out; {_STAR} marks what stays below 1 % "
        f"when all {len(runs[0]['checks'])} checks of a run are counted.",
    }


def _label(check: Document) -> str:
    axle = check["channel"].partition("_")[0]
    of = "reading" if check["of"] == "reading" else "residual"
    return f"{axle} {of}, {band_words(check)}"


def _cells(check: Document) -> list[str]:
    low, high = check["replicated"]["eti95"]
    sd = 0.25 * (high - low)
    star = f" {_STAR}" if check["p_family"] < UNLIKELY else ""
    return [
        number(check["observed"], sd),
        f"{number(low, sd)} to {number(high, sd)}",
        f"{probability(check['p'])}{star}",
    ]
