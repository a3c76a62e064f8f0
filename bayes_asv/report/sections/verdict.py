"""The verdict on the first page and in the terminal: headline, parameter cards, next steps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.report import svg
from bayes_asv.report.schema import EstimateDocument, TrackDocument
from bayes_asv.report.schema.parts import Parameter
from bayes_asv.report.sections.effects import effect_lines
from bayes_asv.report.sections.long_logs import log_lines
from bayes_asv.report.sections.online_filter import (
    INCONSISTENT_STEPS,
    LAST_STATE,
    RECOVERED,
    UNEXPLAINED,
    consistency_lines,
    is_inconsistent,
    last_state,
)
from bayes_asv.report.sections.parameters import answers, side_lines
from bayes_asv.report.sections.run_consistency import consistency_headline, consistency_steps
from bayes_asv.report.sections.run_consistency import consistency_lines as run_consistency_lines
from bayes_asv.report.sections.uncertainty_budget import budget_steps
from bayes_asv.report.words import (
    LABELS,
    SMALL_DIFFERENCE,
    TONES,
    WIDE,
    capitalized,
    compare_parameter,
    difference,
    enumerated,
    estimate_text,
    interval,
    is_determined,
    likelihood_words,
    parameter_sentence,
    percent,
    plain,
    probability,
)

__all__ = [
    "MARKS",
    "cards",
    "headline",
    "next_steps",
    "split_reason",
    "tone",
    "track_headline",
    "track_lines",
    "track_steps",
    "verdict_lines",
]

_ORDER: Final = ("below", "above", "unclear", "agrees")  # senses of dampers in the headline
MARKS: Final = {"below": "▼", "above": "▲", "agrees": "✓", "unclear": "?"}
_COUNTS: Final = {2: "two", 3: "three", 4: "four"}

_NO_ANSWER: Final = "the suspension parameters cannot be determined from"
_NOT_CONVERGED: Final = "No reliable answer: the sampling did not converge."
_PROVISIONAL: Final = "Not to be relied on: "


def headline(document: EstimateDocument | TrackDocument) -> str:
    """State the verdict on the parameters in one or two sentences."""
    if document.verdict == "refused":
        if document.doubt:
            return f"No answer: {split_reason(document.doubt)[0]}."
        several = len(document.provenance.recordings) > 1
        return f"No answer: {_NO_ANSWER} {'these recordings' if several else 'this recording'}."
    if document.doubt:
        return f"No verdict on the dampers. {capitalized(split_reason(document.doubt)[0])}."
    if document.verdict == "not_converged":
        return _NOT_CONVERGED
    dampers = " ".join([_damper_sentences(document), *_other_explanations(document)])
    if isinstance(document, TrackDocument):
        return dampers
    free = [
        f"{place.capitalize()} damper: a free curve, without a single rate."
        for name, place in _dampers(document).items()
        if name in document.parameters and document.parameters[name].withheld
    ]
    if len(free) == len(document.elements):
        dampers = ""
    return " ".join(filter(None, [consistency_headline(document), *free, dampers]))


def _dampers(document: EstimateDocument | TrackDocument) -> dict[str, str]:
    """Place of each damper in words, by the name of its damping rate."""
    return {element.damping: name.replace("_", " ") for name, element in document.elements.items()}


def _damper_sentences(document: EstimateDocument | TrackDocument) -> str:
    compared = {
        place: comparison
        for name, place in _dampers(document).items()
        if name in document.parameters
        if (comparison := compare_parameter(name, document.parameters[name])) is not None
    }
    if not compared:
        return "The damping rates were estimated; there are no nominal values to compare them with."
    senses = {c.sense for c in compared.values()}
    count = len(compared)
    if count > 1 and len(senses) == 1:
        sense = senses.pop()
        every = "Both" if count == 2 else f"All {_COUNTS.get(count, count)}"
        if sense == "agrees":
            return f"{every} dampers agree with nominal."
        if sense == "unclear":
            return f"{every} dampers are too uncertain to compare with nominal."
        word = "softer" if sense == "below" else "stiffer"
        sizes = ", ".join(f"{place} {difference(c.share)}" for place, c in compared.items())
        return f"{every} dampers are {word} than nominal: {sizes}."
    # The softer damper first: most users look for a worn one.
    order = sorted(compared.items(), key=lambda item: _ORDER.index(item[1].sense))
    agreeing = sum(c.sense == "agrees" for c in compared.values())
    told = order[: count - agreeing] if agreeing > 1 else order
    sentences = [f"{place.capitalize()} damper: {c.words}." for place, c in told]
    if agreeing > 1:
        sentences.append(f"The other {_COUNTS.get(agreeing, agreeing)} agree with nominal.")
    return " ".join(sentences)


def _other_explanations(document: EstimateDocument | TrackDocument) -> list[str]:
    return [
        f"Or {plain(one.words)} (probability {probability(one.probability)})."
        for one in document.nominal_mistakes
    ]


def split_reason(reason: str) -> tuple[str, str]:
    """Split a reason into what is wrong and what to do, either of which may be empty."""
    text = plain(reason)
    for separator in ("; ", ": drive "):
        what, found, fix = text.partition(separator)
        if found:
            return what, f"{found[2:]}{fix}"
    return text, ""


def next_steps(document: EstimateDocument | TrackDocument) -> list[str]:
    """Say what to do next, the most useful first."""
    if document.verdict == "refused":
        fixes = dict.fromkeys(split_reason(r)[1] for r in document.reasons)
        steps = [f"{capitalized(fix)}." for fix in fixes if fix]
        return [*steps, "Record again, then run the same command on the new file."]
    if document.verdict == "not_converged":
        return [
            "See in the figures where measurement and simulation differ: the car may do something "
            "that the model does not describe (a stop reached, a loose sensor, a worn bush).",
            "Record again over a single, smooth bump and give both files to the same command.",
            "Run again with another --seed; an answer that changes is not reliable.",
        ]
    if document.doubt:
        what, fix = split_reason(document.doubt)
        return [f"{capitalized(fix or what)}.", "Then run the same command again."]
    if isinstance(document, TrackDocument):
        return _steps(document, [])
    return [*consistency_steps(document), *_steps(document, budget_steps(document))]


def _steps(document: EstimateDocument | TrackDocument, narrowing: list[str]) -> list[str]:
    parameters, dampers = document.parameters, _dampers(document)
    compared = {
        name: comparison
        for name, parameter in parameters.items()
        if (comparison := compare_parameter(name, parameter)) is not None
    }
    steps = [f"Check the nominal damping: {plain(m.fix)}." for m in document.nominal_mistakes[:1]]
    for sense, advice in (
        ("below", "Inspect the {} first: oil, seals, gas charge, mounts and adjuster setting."),
        ("above", "At the {}, check the adjuster setting, the oil and the nominal rate itself."),
    ):
        places = [w for n, w in dampers.items() if n in compared and compared[n].sense == sense]
        if places:
            plural = "s" if len(places) > 1 else ""
            steps.append(advice.format(f"{enumerated(places)} damper{plural}"))
    if not steps and not any(p.withheld for p in parameters.values()):
        steps.append("The dampers need no attention; keep this file to compare the next run with.")
    for name, c in compared.items():
        large = c.sense != "agrees" and abs(c.share) >= SMALL_DIFFERENCE
        if large and QUANTITIES[name][0] == "pitch_inertia":
            steps.append(
                f"The {LABELS[name]} is {difference(c.share)} {c.side} nominal: check "
                "driver, fuel and ballast, or enter the estimate in the vehicle file."
            )
    steps += narrowing
    for name, p in parameters.items():
        asked = QUANTITIES[name][0] in ("damping", "pitch_inertia")
        if not narrowing and asked and p.mean and p.sd / abs(p.mean) > WIDE:
            steps.append(
                f"The {LABELS[name]} is known only to ±{percent(p.sd / abs(p.mean))}: add a "
                "recording over a higher or faster bump and give all files to the same command."
            )
    steps.append("Record again after any change and compare.")
    return steps


def verdict_lines(document: EstimateDocument) -> list[str]:
    """State the whole verdict, one sentence or two a line, the headline first.

    Text without markup; foreign text in it is on one line and without control characters.
    """
    parameters = document.parameters
    prefix = _PROVISIONAL if document.verdict == "not_converged" else ""
    lines = [headline(document)]
    lines += [prefix + parameter_sentence(n, parameters[n]) for n in answers(parameters)]
    lines += side_lines(document)
    lines += log_lines(document)
    lines += run_consistency_lines(document)
    lines += [f"Why: {plain(reason)}." for reason in document.reasons]
    # The headline states a doubt already.
    lines += [f"Note: {plain(w)}." for w in document.warnings if w != document.doubt]
    # Each reason of a refusal carries its own fix already.
    steps = next_steps(document)
    return lines + [f"Next: {step}" for step in (steps[-1:] if document.reasons else steps)]


def track_headline(document: TrackDocument) -> str:
    """State the verdict of the online filter in one to three sentences."""
    words = headline(document)
    if document.verdict != "ok":
        return words
    if is_inconsistent(document):
        what = split_reason(document.doubt)[0] or UNEXPLAINED.format(car=document.car)
        return f"{_PROVISIONAL}{what}. {LAST_STATE}"
    if document.doubt:
        return words
    return f"{words} {RECOVERED}" if document.consistency.verdict == "recovered" else words


def track_steps(document: TrackDocument) -> list[str]:
    """Say what to do after a track."""
    if document.verdict == "ok" and is_inconsistent(document) and not document.doubt:
        return [step.format(car=document.car) for step in INCONSISTENT_STEPS]
    return next_steps(document)


def track_lines(document: TrackDocument) -> list[str]:
    """State the verdict of the online filter, its parameters, consistency and warnings."""
    if document.verdict == "refused":
        return [track_headline(document), *(f"Why: {plain(r)}." for r in document.reasons)]
    parameters = {n: document.parameters[n] for n in answers(document.parameters)}
    # Probabilities of an inconsistent filter would be wrong.
    sentence = last_state if is_inconsistent(document) else parameter_sentence
    lines = [track_headline(document), *(sentence(n, p) for n, p in parameters.items())]
    lines += effect_lines(document.effects)
    lines += consistency_lines(document)
    if is_inconsistent(document) or document.doubt:
        lines += [f"Next: {step}" for step in track_steps(document)]
    return lines + [f"Note: {plain(w)}." for w in document.warnings if w != document.doubt]


def cards(
    parameters: Mapping[str, Parameter], *, reliable: bool = True
) -> tuple[list[dict[str, Any]], list[svg.Panel]]:
    """One card a parameter: value, gauge with nominal, and, if `reliable`, the comparison.

    Plain data for the templates, and the pictures that they name.
    """
    shown = {name: parameters[name] for name in answers(parameters)}
    compared = {name: compare_parameter(name, p) for name, p in shown.items()}
    made: list[dict[str, Any]] = []
    gauges = []
    for name, p in shown.items():
        card = {
            "name": name,
            "label": capitalized(LABELS[name]),
            "value": estimate_text(p, p.unit),
            "interval": f"95 %: {interval(p, 1)}",
            "sense": "", "words": "", "tone": "muted",
        }  # fmt: skip
        if p.withheld:
            card["words"] = "not compared with the nominal value"
            card["sense"] = "" if reliable else "not to be relied on"
        comparison = compared[name]
        if comparison is not None:
            card["tone"] = TONES[comparison.sense] if reliable else "muted"
            card["sense"] = "not to be relied on"
            if reliable:
                p_side = comparison.p_side
                card["sense"] = f"{MARKS[comparison.sense]} {comparison.words}"
                card["words"] = (
                    f"{likelihood_words(p_side)} {comparison.side} nominal ({probability(p_side)})"
                )
        nominal, (low, high) = None if comparison is None else p.nominal, p.eti95
        mean = p.mean if is_determined(p.eti95) else None
        picture = svg.gauge(
            f"gauge-{name.replace('_', '-')}", mean, low, high, nominal, card["tone"]
        )
        gauges.append(picture)
        card |= {"gauge": picture.key, "alt": picture.alt}
        made.append(card)
    return made, gauges


def tone(verdict: str, made: list[dict[str, Any]]) -> str:
    """Colour of the verdict: that of the most conspicuous damper."""
    if verdict != "ok":
        return "stop"
    tones = [card["tone"] for card in made if QUANTITIES[card["name"]][0] == "damping"]
    return next((t for t in ("below", "above", "muted") if t in tones), "good")
