"""A track in words."""

from __future__ import annotations

from typing import Any, Final

from bayes_asv.report.readable import number, percent, plain, readable_unit
from bayes_asv.report.words import LABELS, headline, sentence

__all__ = ["DOUBTED_STEPS", "consistency_lines", "is_doubted", "track_headline", "track_lines"]

Document = dict[str, Any]

_SHOWN = ("c_f", "c_r", "i", "k_g")

_MANY = 200.0

_FAULTS = {
    "swollen": (
        "The noise had to be raised to {level} what the vehicle file says: a sensor was at fault, "
        "a value given as exact is off, or something moves that a half car does not know."
    ),
    "coloured": (
        "What the predictions miss hangs together from reading to reading: the parameters changed, "
        "a given value is off, or the car does something that a half car does not know. While it "
        "lasts they are let go, so that the intervals are wider."
    ),
    "uneven": "For a part of the time the predictions missed by more or less than they said.",
    "optimistic": "The predictions missed by more than they said: the noise is larger than given.",
    "pessimistic": "The predictions missed by less than they said: the noise is smaller than "
    "given, and the intervals are wider than they need be.",
}

_RECOVERED = " Something was amiss on the way, and the filter has recovered since."
_DOUBTED = (
    "Not to be relied on: this recording is not one that the half car and the sensors of the "
    "vehicle file would make. The figures are where the filter ended."
)

DOUBTED_STEPS: Final = (
    "See whether a sensor is loose, or its noise is given too small in the vehicle file.",
    "Ask 'bayes-asv diagnose' what the half car lacks: a damper whose bound and rebound differ, "
    "a stop, friction.",
    "'bayes-asv estimate' learns the noise as well and says how much of the motion is explained.",
)
"""What to do where the filter was not consistent."""


def track_headline(document: Document) -> str:
    """Say the verdict in one sentence or two.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/track/1``.
    """
    words = headline(document)
    if document["verdict"] != "ok":
        return words
    if is_doubted(document):
        return _DOUBTED
    return words + (_RECOVERED if document["consistency"]["verdict"] == "recovered" else "")


def is_doubted(document: Document) -> bool:
    """Whether the filter was not consistent with what it saw, so that nothing can be claimed."""
    return bool(document["consistency"]["verdict"] == "inconsistent")


def consistency_lines(document: Document) -> list[str]:
    """Say whether the filter's predictions missed by as much as they said, a sentence a line."""
    found = document["consistency"]
    if not found["readings"]:
        return ["No reading was left to hold the filter's predictions against."]
    low, high = found["nis_band95"]
    mean = number(found["nis_mean"], 0.01)
    lines = [
        f"Normalised innovations squared (NIS): mean {mean} over {found['readings']} readings; "
        f"95 % of filters that are right lie between {number(low, 0.01)} and {number(high, 0.01)}. "
        f"For {percent(found['share_of_time'])} of the time nothing was amiss."
    ]
    raised = found["largest_noise_level"]
    level = f"{number(raised, 0.1 * raised)} times" if raised < _MANY else "hundreds of times"
    lines += [_FAULTS[fault].format(level=level) for fault in found["faults"]]
    resets = (document.get("filter") or {}).get("resets") or []
    if resets:
        shown = ", ".join(f"{number(t, 0.1)} s" for t in resets[:5])
        more = f" and {len(resets) - 5} times more" if len(resets) > 5 else ""
        lines.append(
            f"At {shown}{more} something broke; motion and biases were begun anew, and what was "
            "learnt of the car just before was taken back."
        )
    if not found["faults"] and not resets:
        lines.insert(0, "The filter is consistent: its predictions miss by as much as they say.")
    return lines


def track_lines(document: Document) -> list[str]:
    """Say everything a terminal needs: verdict, parameters, consistency, warnings."""
    if document["verdict"] == "refused":
        return [track_headline(document), *(f"Why: {plain(r)}." for r in document["reasons"])]
    parameters = {n: document["parameters"][n] for n in _SHOWN if n in document["parameters"]}
    lines = [track_headline(document)]
    if is_doubted(document):  # no probability is worth its digits here
        lines += [_ending(n, p) for n, p in parameters.items()]
    else:
        lines += [sentence(n, p) for n, p in parameters.items()]
    lines += consistency_lines(document)
    if is_doubted(document):
        lines += [f"Next: {step}" for step in DOUBTED_STEPS]
    lines += [f"Note: {plain(w)}." for w in document["warnings"]]
    return lines


def _ending(name: str, parameter: Document) -> str:
    """Say where a parameter ended, and claim nothing."""
    low, high = parameter["eti95"]
    return (
        f"{LABELS[name].capitalize()}: {number(parameter['median'], high - low)} "
        f"{readable_unit(parameter['unit'])} (nominal {number(parameter['nominal'])})."
    )
