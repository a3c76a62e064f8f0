"""The verdict on a car that rolls in lines for a terminal: pure functions of a document."""

from __future__ import annotations

from typing import Any, Final

from bayes_asv.report.readable import plain
from bayes_asv.report.words import compare, interval, likelihood_words, quantity, sentence

__all__ = ["roll_lines"]

Document = dict[str, Any]

_DAMPERS: Final = {
    "c_fl": "front left", "c_fr": "front right", "c_rl": "rear left", "c_rr": "rear right",
}  # fmt: skip
_SURE: Final = 0.95


def roll_lines(document: Document) -> list[str]:
    """Tell an estimate, the headline first.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/estimate_roll/1``.
    """
    parameters = document["parameters"]
    lines = [_headline(document)]
    if document["verdict"] != "refused":
        provisional = "Not to be relied on: " if document["verdict"] == "not_converged" else ""
        lines += [provisional + sentence(name, parameters[name]) for name in parameters]
        lines += [_sides(axle, ratio) for axle, ratio in document["left_over_right"].items()]
    lines += [f"Why: {plain(reason)}." for reason in document["reasons"]]
    lines += [f"Note: {plain(warning)}." for warning in document["warnings"]]
    return lines


def _headline(document: Document) -> str:
    if document["verdict"] == "refused":
        return "Refused: these data cannot answer."
    if document["verdict"] == "not_converged":
        return "Not converged: the weights of the draws are too uneven to rely on."
    told = []
    for name, words in _DAMPERS.items():
        found = compare(name, document["parameters"][name])
        if found is not None:
            told.append(f"{words} {found.words}")
    return f"Dampers: {'; '.join(told)}."


def _sides(axle: str, ratio: Document) -> str:
    p = ratio["p_left_softer"]
    start = (
        f"The {axle} left damper has {quantity(ratio['mean'], ratio['sd'], '')} times the rate of "
        f"the right one (95 %: {interval(ratio)})"
    )
    if max(p, 1.0 - p) < _SURE:
        return f"{start}; the sides cannot be told apart."
    return f"{start}; it is {likelihood_words(max(p, 1.0 - p))} " + (
        "the softer one." if p > 0.5 else "the stiffer one."
    )
