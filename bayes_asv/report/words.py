"""The verdict in words, alike for the command line, HTML and PDF: pure functions of a document."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

from bayes_asv.report.budget_words import width_steps
from bayes_asv.report.consistency_words import (
    agreement_headline,
    agreement_lines,
    agreement_steps,
)
from bayes_asv.report.readable import number, percent, plain, probability, readable_unit

__all__ = [
    "Comparison",
    "compare",
    "convergence_lines",
    "headline",
    "likelihood_words",
    "next_steps",
    "sentence",
    "split_reason",
    "verdict_lines",
]

Document = dict[str, Any]

SHOWN: Final = ("c_f", "c_r", "i", "k_g")
"""Parameters that the verdict speaks about, in this order."""

LABELS: Final = {
    "c_f": "front damping rate",
    "c_r": "rear damping rate",
    "i": "pitch inertia",
    "k_g": "radius of gyration",
    "zeta_f": "front damping ratio",
    "zeta_r": "rear damping ratio",
}

RHAT_WANTED: Final = 1.01
ESS_WANTED: Final = 1000.0  # what the sampler asks of itself before it calls an answer ready

_SLIGHT: Final = 0.05  # share of nominal: a sure difference that need not matter
_ALARM: Final = ("below", "above", "unclear", "agrees")
_WIDE: Final = 0.10  # one deviation as a share of the mean

# Mastrandrea et al., Guidance Note for Lead Authors of the IPCC Fifth Assessment Report on
# Consistent Treatment of Uncertainties (2010), table 1, with the additional terms below it.
_SCALE: Final = (
    (0.99, "virtually certain"),
    (0.95, "extremely likely"),
    (0.90, "very likely"),
    (0.66, "likely"),
)
_MIRRORED: Final = (
    (0.01, "exceptionally unlikely"),
    (0.05, "extremely unlikely"),
    (0.10, "very unlikely"),
    (0.33, "unlikely"),
)


class Comparison(NamedTuple):
    """A parameter held against its nominal value.

    Attributes
    ----------
    sense : str
        ``below`` or ``above``; ``agrees`` when nominal lies within the 95 % interval; ``unclear``
        when it does only because the interval is wide.
    words : str
        The same for a person: ``9 % softer than nominal``.
    share : float
        Posterior mean over nominal, less one.
    p_below : float
        Probability of lying below nominal.
    """

    sense: str
    words: str
    share: float
    p_below: float

    @property
    def p_side(self) -> float:
        """Probability of lying on the side of nominal on which the mean lies."""
        return self.p_below if self.share < 0.0 else 1.0 - self.p_below

    @property
    def side(self) -> str:
        """``below`` or ``above``, also where the difference is within the uncertainty."""
        return "below" if self.share < 0.0 else "above"


def likelihood_words(p: float) -> str:
    """Say a probability on the calibrated scale of the IPCC.

    Parameters
    ----------
    p : float
        Between 0 and 1.

    Returns
    -------
    str
        From ``exceptionally unlikely`` (below 1 %) by ``about as likely as not`` (33 to 66 %) to
        ``virtually certain`` (above 99 %).

    Raises
    ------
    ValueError
        If `p` is no probability.
    """
    if not 0.0 <= p <= 1.0:
        raise ValueError(f"{p} is not a probability")
    for bound, words in _SCALE:
        if p > bound:
            return words
    for bound, words in _MIRRORED:
        if p < bound:
            return words
    return "about as likely as not"


def compare(name: str, parameter: Document) -> Comparison | None:
    """Hold a parameter against nominal.

    Parameters
    ----------
    name : str
        ``c_f``, ``c_r``, ``i``, …
    parameter : dict
        Its entry in the document.

    Returns
    -------
    Comparison or None
        None where there is no usable nominal value.
    """
    mean, nominal, p = (parameter.get(k) for k in ("mean", "nominal", "p_below_nominal"))
    if mean is None or p is None or not nominal:
        return None
    low, high = parameter["eti95"]
    share = mean / nominal - 1.0
    if low <= nominal <= high:
        if parameter["sd"] > _WIDE * abs(mean):
            return Comparison("unclear", "too uncertain to tell from nominal", share, p)
        return Comparison("agrees", "agrees with nominal", share, p)
    side = "below" if share < 0.0 else "above"
    damper = name.startswith(("c_", "zeta"))
    if damper:
        word = "softer" if side == "below" else "stiffer"
    else:
        word = "smaller" if side == "below" else "larger"
    if abs(share) < _SLIGHT:
        words = f"slightly {word} than nominal ({difference(share)})"
    else:
        words = f"{difference(share)} {word} than nominal"
    return Comparison(side, words, share, p)


def difference(share: float) -> str:
    """Size of a difference from nominal, without its sign."""
    return "less than 1 %" if abs(share) < 0.01 else percent(abs(share))


def quantity(value: float | None, sd: float | None, unit: str, digits: int = 1) -> str:
    """Write a number with its unit."""
    return f"{number(value, sd, digits)} {readable_unit(unit)}".strip()


def interval(parameter: Document, digits: int = 1) -> str:
    """Write the 95 % interval of a parameter, ``7.7 to 8.1``."""
    low, high = parameter["eti95"]
    return f"{number(low, parameter['sd'], digits)} to {number(high, parameter['sd'], digits)}"


def sentence(name: str, parameter: Document) -> str:
    """Tell one parameter: value, interval, and how it stands to nominal with what probability.

    Parameters
    ----------
    name : str
        ``c_f``, ``c_r``, ``i``, …
    parameter : dict
        Its entry in the document.

    Returns
    -------
    str
        One sentence.
    """
    label = LABELS.get(name, plain(parameter.get("label", name)))
    value = quantity(parameter["mean"], parameter["sd"], parameter["unit"])
    start = f"The {label} is {value} (95 %: {interval(parameter)})"
    found = compare(name, parameter)
    if found is None:
        return f"{start}."
    nominal = number(parameter["nominal"])
    chance = (
        f"it is {likelihood_words(found.p_side)} ({probability(found.p_side)}) that it is "
        f"{found.side} nominal"
    )
    if found.sense == "agrees":
        return (
            f"{start}, which agrees with the nominal {nominal}: the difference of "
            f"{difference(found.share)} is within the uncertainty; {chance}."
        )
    if found.sense == "unclear":
        return f"{start}, too uncertain to tell from the nominal {nominal}; {chance}."
    return f"{start}, {difference(found.share)} {found.side} the nominal {nominal}; {chance}."


def headline(document: Document) -> str:
    """Say the verdict in one sentence that needs no other.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/estimate/1``.

    Returns
    -------
    str
        The sentence.
    """
    verdict = document["verdict"]
    if verdict == "refused":
        several = len(document.get("provenance", {}).get("recordings", ())) > 1
        which = "these recordings" if several else "this recording"
        return f"No answer: {which} cannot tell how the suspension behaves."
    if verdict == "not_converged":
        return "No answer to rely on: the sampling did not converge."
    return f"{agreement_headline(document)} {_dampers(document['parameters'])}".strip()


def _dampers(parameters: Document) -> str:
    found = {
        axle: compare(name, parameters[name])
        for axle, name in (("front", "c_f"), ("rear", "c_r"))
        if name in parameters
    }
    known = {axle: c for axle, c in found.items() if c is not None}
    if not known:
        return "The damping rates were estimated; there is nothing to hold them against."
    senses = {c.sense for c in known.values()}
    if len(known) == 2 and len(senses) == 1:
        sense = senses.pop()
        if sense == "agrees":
            return "Both dampers agree with nominal."
        if sense == "unclear":
            return "Neither damper is known well enough to tell it from nominal."
        word = "softer" if sense == "below" else "stiffer"
        sizes = ", ".join(f"{axle} {difference(c.share)}" for axle, c in known.items())
        return f"Both dampers are {word} than nominal: {sizes}."
    # What is softer comes first: it is what people ask about.
    order = sorted(known.items(), key=lambda item: _ALARM.index(item[1].sense))
    return " ".join(f"{axle.capitalize()} damper: {c.words}." for axle, c in order)


def split_reason(reason: str) -> tuple[str, str]:
    """Split a reason into what is wrong and what to do, either of which may be empty."""
    text = plain(reason)
    for mark in ("; ", ": drive "):
        what, found, mend = text.partition(mark)
        if found:
            return what, f"{found[2:]}{mend}"
    return text, ""


def next_steps(document: Document) -> list[str]:
    """Say what to do next, the most useful first.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/estimate/1``.

    Returns
    -------
    list of str
        Whole sentences.
    """
    verdict = document["verdict"]
    if verdict == "refused":
        mends = dict.fromkeys(split_reason(r)[1] for r in document["reasons"])
        steps = [f"{m[0].upper()}{m[1:]}." for m in mends if m]
        return [*steps, "Record again, then run the same command on the new file."]
    if verdict == "not_converged":
        return [
            "Look where measurement and simulation part in the figures: the car may do something "
            "that the half car does not know (a stop reached, a loose sensor, a worn bush).",
            "Record again over a single, clean bump and give both files to the same command.",
            "Run once more with another --seed; an answer that moves is none.",
        ]
    narrower = width_steps(document)
    return [*agreement_steps(document), *_steps_when_ok(document["parameters"], narrower)]


def _steps_when_ok(parameters: Document, narrower: list[str]) -> list[str]:
    steps = []
    for side, advice in (
        ("below", "Look at the {} first: oil, seals, gas charge, mounts and adjuster setting."),
        ("above", "At the {}, check the adjuster setting, the oil and the nominal rate itself."),
    ):
        axles = [
            axle
            for axle, name in (("front", "c_f"), ("rear", "c_r"))
            if (c := compare(name, parameters.get(name, {}))) is not None and c.sense == side
        ]
        if axles:
            where = " and ".join(axles) + (" dampers" if len(axles) > 1 else " damper")
            steps.append(advice.format(where))
    if not steps:
        steps.append("Nothing to do at the dampers; keep this file to compare the next run with.")
    inertia = compare("i", parameters.get("i", {}))
    if inertia is not None and inertia.sense != "agrees" and abs(inertia.share) >= _SLIGHT:
        steps.append(
            f"The pitch inertia is {difference(inertia.share)} {inertia.side} nominal: check "
            "driver, fuel and ballast, or take the estimate into the vehicle file."
        )
    steps += narrower
    for name in SHOWN[:3]:
        p = parameters.get(name)
        if not narrower and p and p["mean"] and p["sd"] / abs(p["mean"]) > _WIDE:
            steps.append(
                f"The {LABELS[name]} is known to ±{percent(p['sd'] / abs(p['mean']))} only: add a "
                "recording over a higher or faster bump and give all files to the same command."
            )
    steps.append("Record again after any change and compare.")
    return steps


def verdict_lines(document: Document) -> list[str]:
    """Tell the whole verdict, a line a thought, the headline first.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/estimate/1``.

    Returns
    -------
    list of str
        Text without markup; foreign text in it is on one line and without control characters.
    """
    lines = [headline(document)]
    parameters = document["parameters"]
    provisional = "Not to be relied on: " if document["verdict"] == "not_converged" else ""
    lines += [provisional + sentence(n, parameters[n]) for n in SHOWN if n in parameters]
    lines += agreement_lines(document)
    lines += [f"Why: {plain(reason)}." for reason in document["reasons"]]
    lines += [f"Note: {plain(warning)}." for warning in document["warnings"]]
    # Each reason of a refusal carries its own mend already.
    steps = next_steps(document)
    lines += [f"Next: {step}" for step in (steps[-1:] if document["reasons"] else steps)]
    return lines


def convergence_lines(diagnostics: Document) -> list[str]:
    """Say in words whether the sampling is good enough to quote.

    Parameters
    ----------
    diagnostics : dict
        The document's entry of that name.

    Returns
    -------
    list of str
        Whole sentences; empty where nothing was sampled.
    """
    lines = []
    rhat = diagnostics.get("rhat_max")
    if rhat is not None and math.isfinite(rhat):
        good = rhat < RHAT_WANTED
        lines.append(
            f"Independent ensembles {'agree' if good else 'do not agree'}: the largest R̂ is "
            f"{rhat:.3f}, and below {RHAT_WANTED} is wanted."
        )
    sizes = [diagnostics.get(k) for k in ("ess_bulk_min", "ess_tail_min")]
    if all(s is not None and math.isfinite(s) for s in sizes):
        bulk, tail = (float(s) for s in sizes if s is not None)
        good = min(bulk, tail) >= ESS_WANTED
        lines.append(
            f"The {diagnostics.get('draws', 0)} draws are worth {bulk:.0f} independent ones for "
            f"the middle and {tail:.0f} for the ends of the intervals: "
            f"{'enough' if good else 'too few'}, {ESS_WANTED:.0f} are wanted."
        )
    acceptance = diagnostics.get("acceptance")
    if acceptance is not None and math.isfinite(acceptance):
        usual = 0.1 <= acceptance <= 0.9
        lines.append(
            f"{percent(acceptance)} of the proposed moves were taken, "
            f"{'as usual' if usual else 'which is unusual'}."
        )
    return lines
