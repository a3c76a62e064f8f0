"""Tables of a diagnosis: what is missing, the gap, and the parameters before and after."""

from __future__ import annotations

from typing import Any, Final

from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.report.diagnose_words import closed_words, is_exact, name_of, place, spread
from bayes_asv.report.readable import number, plain, probability, readable_unit
from bayes_asv.report.tables import table

__all__ = ["effect_table", "gap_table", "model_table", "moved_table", "preflight_table"]

Document = dict[str, Any]

_GAPS: Final = {"fit": "runs fitted", "holdout": "held out"}
_SHOWN: Final = ("c_f", "c_r", "i", "k_g", "zeta_f", "zeta_r")
_PREFLIGHT: Final = {
    "sensor_clipping": "readings at a rail",
    "dropped_samples": "samples that are missing",
    "uneven_clock": "uneven steps of the clock",
    "initial_state": "a start that is not at rest",
}


def effect_table(document: Document) -> Document | None:
    """Every effect with its probability, parameters and share of the gap."""
    rows = []
    for effect in document["effects"]:
        first = [f"{name_of(effect)}{place(effect)}", probability(effect["probability"])]
        told = list(effect["parameters"].items()) or [("", None)]
        for n, (name, value) in enumerate(told):
            rows.append([*(first if n == 0 else ["", ""]), *_size(plain(name), value)])
    if not rows:
        return None
    return table(
        "What is missing",
        ["effect", "probability", "parameter", "value", "95 % interval"],
        rows,
        "In the order in which they were added. What each parameter means stands in "
        "docs/effects.md; intervals allow for a little of every other effect.",
    )


def model_table(document: Document) -> Document | None:
    """Effects that an estimate's model was given, with their parameters."""
    rows = [
        [f"{name_of(effect)}{place(effect)}" if n == 0 else "", *_size(plain(name), value)]
        for effect in document.get("effects") or []
        for n, (name, value) in enumerate(effect["parameters"].items())
    ]
    if not rows:
        return None
    return table(
        "In the model beside the half car",
        ["effect", "parameter", "value", "95 % interval"],
        rows,
        "Added because they were asked for or named. What each parameter means stands in "
        "docs/effects.md.",
    )


def _size(name: str, value: Document | None) -> list[str]:
    if value is None:
        return ["–", "–", "–"]
    unit, sd = readable_unit(value.get("unit", "")), spread(value)
    low, high = value["eti95"]
    text = "–" if is_exact(value) else f"{number(low, sd)} to {number(high, sd)}"
    return [f"{name} [{unit}]" if unit else name, number(value["mean"], sd), text]


def gap_table(document: Document) -> Document | None:
    """Gap before and after on the runs fitted and held out, of everything and of each effect."""
    unit = readable_unit(document["gap"]["unit"])
    rows = _gap_rows("", document["gap"])
    if len(document["effects"]) > 1:
        for effect in document["effects"]:
            if effect["gap"]:
                rows += _gap_rows(f"{name_of(effect)}{place(effect)}, ", effect["gap"])
    if not rows:
        return None
    return table(
        "The gap",
        ["", f"before [{unit}]", f"after [{unit}]", f"noise alone [{unit}]", "share closed"],
        rows,
        "Root-mean-square of measured less simulated chassis acceleration. Noise alone is what the "
        "sensors would leave if the model were right; the share closed is that of the square above "
        "it. On what was held out everything is frozen but start, biases and noise levels.",
    )


def _gap_rows(of: str, gap: Document) -> list[list[str]]:
    rows = []
    for key, words in _GAPS.items():
        part = gap.get(key)
        if part:
            closed = part.get("closed")
            rows.append(
                [
                    f"{of}{words}",
                    *(number(part[k], 0.01 * part[k]) for k in ("before", "after", "floor")),
                    "it grew" if part.get("worse") else closed_words(closed),
                ]
            )
    return rows


def moved_table(document: Document) -> Document | None:
    """Parameters of the linear half car and with everything that was named."""
    before, after = document["parameters_before"], document["parameters_after"]
    rows = []
    for name in _SHOWN:
        if name not in before or name not in after:
            continue
        one, two = before[name], after[name]
        unit, label = readable_unit(two["unit"]), QUANTITIES[name][1]
        rows.append(
            [
                f"{label[:1].upper()}{label[1:]} [{unit}]" if unit else f"{label.capitalize()}",
                _interval(one),
                _interval(two),
                number(two.get("nominal")),
                probability(two.get("p_below_nominal")),
            ]
        )
    if not rows:
        return None
    return table(
        "Parameters before and after",
        ["parameter", "before, 95 %", "after, 95 %", "nominal", "P(below nominal) after"],
        rows,
        "Before: the linear half car. After: with everything that was named, and a little of "
        "everything else allowed for. Near the most probable values.",
    )


def _interval(told: Document) -> str:
    low, high = told["eti95"]
    return f"{number(low, told['sd'])} to {number(high, told['sd'])}"


def preflight_table(document: Document) -> Document | None:
    """List what was found before any fit."""
    rows = []
    for found in document.get("preflight") or []:
        name = plain(found["name"])
        rows.append([plain(found.get("source", "")), _PREFLIGHT.get(name, name), _amount(found)])
    if not rows:
        return None
    return table("Found before any fit", ["recording", "what", "how much"], rows)


def _amount(found: Document) -> str:
    """Say how much of it there is, where that is known."""
    samples, rms, times = (found.get(k) for k in ("samples", "rms_seconds", "times_noise"))
    if samples is not None:
        return f"{samples} samples"
    if rms:
        return f"{1e3 * rms:.3g} ms"
    return f"{times:.0f} times the sensor's noise" if times else "–"
