"""A track in words."""

from __future__ import annotations

from typing import Any

from bayes_asv.report.readable import number, percent, plain
from bayes_asv.report.words import headline, sentence

__all__ = ["consistency_lines", "track_headline", "track_lines"]

Document = dict[str, Any]

_SHOWN = ("c_f", "c_r", "i", "k_g")

_FAULTS = {
    "swollen": (
        "The noise had to be raised to {level} times what the vehicle file says: a sensor was at "
        "fault, a value given as exact is off, or something moves that a half car does not know."
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

_DOUBTS = {
    "recovered": " Something was amiss on the way, and the filter has recovered since.",
    "inconsistent": " The filter is not consistent: do not rely on its intervals.",
}


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
    return words + _DOUBTS.get(document["consistency"]["verdict"], "")


def consistency_lines(document: Document) -> list[str]:
    """Say whether the filter's predictions missed by as much as they said, a sentence a line."""
    found = document["consistency"]
    if not found["readings"]:
        return ["No reading was left to hold the filter's predictions against."]
    low, high = found["nis_band95"]
    mean = number(found["nis_mean"], 0.01)
    lines = [
        f"The innovations' normalised squares have a mean of {mean} over {found['readings']} "
        f"readings (95 % of filters that are right: {number(low, 0.01)} to {number(high, 0.01)}), "
        f"and {percent(found['share_of_time'])} of the time nothing was amiss."
    ]
    level = number(found["largest_noise_level"], 0.1)
    lines += [_FAULTS[fault].format(level=level) for fault in found["faults"]]
    resets = (document.get("filter") or {}).get("resets") or []
    if resets:
        shown = ", ".join(f"{number(t, 0.1)}" for t in resets[:5])
        more = f" and {len(resets) - 5} times more" if len(resets) > 5 else ""
        lines.append(
            f"At {shown} s{more} something broke; motion and biases were begun anew, and what was "
            "learnt of the car just before was taken back."
        )
    if not found["faults"] and not resets:
        lines.insert(0, "The filter is consistent: its predictions miss by as much as they say.")
    return lines


def track_lines(document: Document) -> list[str]:
    """Say everything a terminal needs: verdict, parameters, consistency, warnings."""
    if document["verdict"] == "refused":
        return [track_headline(document), *(f"Why: {plain(r)}." for r in document["reasons"])]
    parameters = document["parameters"]
    lines = [track_headline(document)]
    lines += [sentence(n, parameters[n]) for n in _SHOWN if n in parameters]
    lines += consistency_lines(document)
    lines += [f"Note: {plain(w)}." for w in document["warnings"]]
    return lines
