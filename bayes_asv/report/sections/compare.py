"""Two sessions of one car: what changed, by how much, and with which probability."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bayes_asv.report import svg
from bayes_asv.report.schema.compare import CompareDocument, ParameterChange
from bayes_asv.report.schema.estimate import EstimateDocument
from bayes_asv.report.schema.parts import Effect
from bayes_asv.report.sections.blocks import Block, Figure, Section, Table, Text
from bayes_asv.report.sections.damper_force import label_sides
from bayes_asv.report.sections.effects import effect_name, value_text
from bayes_asv.report.sections.simulation import motion_panels
from bayes_asv.report.words import (
    MISSING,
    WIDE,
    capitalized,
    enumerated,
    estimate_text,
    number,
    p_value,
    percent,
    plain,
    probability,
    readable_unit,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "DETAILS_SECTION", "SECTION", "change_rows", "change_sentence", "compare_cards",
    "compare_headline", "compare_lines", "compare_steps", "compare_subtitle", "sense",
    "terminal_rows",
]  # fmt: skip

_SURE: Final = 0.95
"""Probability from which a parameter is said to have changed."""
_LIKELY, _UNLIKELY = 0.66, 0.33  # as :func:`bayes_asv.report.words.likelihood_words` uses them


_FORCE: Final = (
    "Force of each damper over the velocities that were driven, with 95 % bands. The bands hold "
    "the errors of the given values, which move both curves alike: they may overlap where the "
    "change is beyond doubt. Extension is a positive velocity."
)
_MOTION: Final = (
    "The first recording of each session, before on the left and after on the right. The model is "
    "that of its session alone; the band should hold 95 % of the readings."
)
_NOTE: Final = (
    "The ratio is after over before if all parameters may have changed. The probabilities allow "
    "for no change: a priori each parameter is unchanged with a probability of {unchanged}, and a "
    "change is ±{size} at one standard deviation. The test asks how often a parameter that did not "
    "change would look as different."
)


def damper(change: ParameterChange) -> str:
    """Short name of what may have changed: ``front damper`` for a damping rate."""
    return plain(change.label).replace("damping rate", "damper")


def _is_damper(name: str) -> bool:
    return name.startswith("c_")


def _direction(name: str, change: ParameterChange) -> str:
    falls = change.ratio < 1.0
    if _is_damper(name):
        return "softer" if falls else "stiffer"
    return "lower" if falls else "higher"


def _size(change: ParameterChange) -> str:
    """Size of a change without its sign, in the digits that its uncertainty allows."""
    share = change.ratio - 1.0
    return f"{number(100.0 * abs(share), 100.0 * change.ratio * change.log_sd, 1)} %"


def _span(change: ParameterChange, *, unsigned: bool = False) -> str:
    """Write the interval in percent, without signs where ``unsigned`` and both ends have one."""
    low, high = (100.0 * (x - 1.0) for x in change.eti95)
    sd = 100.0 * change.ratio * change.log_sd
    if unsigned and low * high > 0.0:
        low, high = sorted((abs(low), abs(high)))
        return f"{number(low, sd, 1)} to {number(high, sd, 1)} %"
    return f"{_signed(low, sd)} to {_signed(high, sd)} %"


def _signed(value: float, sd: float) -> str:
    text = number(value, sd, 1)
    return text if text.startswith("−") or not text.strip("0.") else f"+{text}"


def _signed_size(change: ParameterChange) -> str:
    """Write a change in percent, with its sign."""
    return f"{_signed(100.0 * (change.ratio - 1.0), 100.0 * change.ratio * change.log_sd)} %"


def sense(change: ParameterChange) -> str:
    """Classify a change as ``changed``, ``probable``, ``same`` or ``unclear``."""
    if change.p_changed >= _SURE:
        return "changed"
    if change.p_changed > _LIKELY:
        return "probable"
    return "unclear" if change.p_changed > _UNLIKELY or change.log_sd > WIDE else "same"


def _statement(name: str, change: ParameterChange) -> str:
    """``Front damper: 5.0 % softer``."""
    found = sense(change)
    if found == "changed":
        text = f"{_size(change)} {_direction(name, change)}"
    elif found == "probable":
        text = f"probably {_size(change)} {_direction(name, change)}"
    else:
        text = "no change found" if found == "same" else "unclear whether it changed"
    return f"{capitalized(damper(change))}: {text}"


def change_sentence(name: str, change: ParameterChange) -> str:
    """State a change with its interval and the probability that there was one."""
    sized = sense(change) in ("changed", "probable")
    return (
        f"{_statement(name, change)} (95 %: {_span(change, unsigned=sized)}); probability of a "
        f"change {probability(change.p_changed)}."
    )


def compare_headline(document: CompareDocument) -> str:
    """State what changed, one sentence a parameter."""
    if document.verdict == "refused":
        return "No answer: these sessions cannot be compared."
    if document.verdict == "doubtful":
        return _doubtful(document)
    return " ".join(f"{_statement(name, c)}." for name, c in document.changes.items())


def _doubtful(document: CompareDocument) -> str:
    return f"Not to be relied on: {'; '.join(plain(doubt) for doubt in document.doubts)}."


def compare_subtitle(document: CompareDocument) -> str:
    """Name the recordings of both sessions."""
    return " · ".join(
        f"{side}: {_files(estimate)}"
        for side, estimate in (("before", document.before), ("after", document.after))
    )


def _files(estimate: EstimateDocument) -> str:
    files = [plain(file.file) for file in estimate.provenance.recordings]
    return ", ".join(files[:3]) + (f" and {len(files) - 3} more" if len(files) > 3 else "")


def compare_lines(document: CompareDocument) -> list[str]:
    """State the result in sentences."""
    if document.verdict == "refused":
        reasons = [f"Why: {plain(reason)}." for reason in document.reasons]
        return [compare_headline(document), *reasons]
    lines = [_head(document), *(change_sentence(n, c) for n, c in document.changes.items())]
    lines += _effect_lines(document)
    if document.different:
        lines.append(
            f"The vehicle files give other values of {enumerated(list(document.different))}."
        )
    lines += [f"Note: {plain(warning)}." for warning in document.warnings]
    return lines + [f"Next: {step}" for step in compare_steps(document)]


def _head(document: CompareDocument) -> str:
    if document.verdict == "doubtful":
        return _doubtful(document)
    p = "" if document.p_value is None else f" ({p_value(document.p_value)})"
    by_sense: dict[str, list[str]] = {}
    for change in document.changes.values():
        by_sense.setdefault(sense(change), []).append(f"the {damper(change)}")
    if "changed" in by_sense:
        return f"Changed: {enumerated(by_sense['changed'])}{p}."
    if "probable" in by_sense:
        return f"Probably changed: {enumerated(by_sense['probable'])}{p}."
    if "unclear" in by_sense:
        return f"It is unclear whether {enumerated(by_sense['unclear'], 'or')} changed{p}."
    return f"No change is found{p}."


def _effect_lines(document: CompareDocument) -> list[str]:
    """Parameters of the effects, before and after."""
    lines = []
    for name, before, after in _effect_pairs(document):
        for key, value in before.parameters.items():
            if key in after.parameters:
                first, second = value_text(value), value_text(after.parameters[key])
                lines.append(f"{capitalized(name)}, {plain(key)}: {first} before, {second} after.")
    return lines


def _effect_pairs(document: CompareDocument) -> Iterator[tuple[str, Effect, Effect]]:
    later = {(one.name, one.where): one for one in document.after.effects}
    for one in document.before.effects:
        if (one.name, one.where) in later:
            yield effect_name(one), one, later[one.name, one.where]


def compare_steps(document: CompareDocument) -> list[str]:
    """Say what to do next."""
    if document.verdict == "refused":
        return [
            "Estimate each session by itself (bayes-asv estimate): the messages there say what to "
            "do, and both have to have an answer."
        ]
    if document.verdict == "doubtful":
        return [
            "Estimate each session by itself (bayes-asv estimate, bayes-asv diagnose) and follow "
            "what is said there.",
            "Find what else changed: a mass (driver, fuel, ballast), a spring, the weight "
            "distribution or a sensor. Weigh the car as it was in each session, and give AFTER a "
            "vehicle file of its own (--vehicle-after).",
        ]
    steps = []
    weak = [damper(c) for c in document.changes.values() if sense(c) in ("probable", "unclear")]
    if weak:
        steps.append(
            f"Record each session again, or more runs of it, to decide about {enumerated(weak)}: "
            "a higher obstacle or a higher speed moves the suspension more."
        )
    if any(len(one.provenance.recordings) < 2 for one in (document.before, document.after)):
        steps.append(
            "Give several runs of each session: oil temperature, fuel and driver move the "
            "parameters of a sound car by a few per cent, and only runs of one session show it."
        )
    elif not weak:
        steps.append("Drive the same obstacle at the same speed after the next change as well.")
    return steps


def terminal_rows(document: CompareDocument) -> list[tuple[list[str], str]]:
    """Cells of each change for a terminal, and the tone of the last but one."""
    rows = []
    for name, change in document.changes.items():
        mark, tone = _mark(change)
        verdict = _statement(name, change).partition(": ")[2]
        if document.verdict == "doubtful":
            verdict, tone = "not to be relied on", ""
        else:
            verdict = f"{mark} {_direction(name, change) if '%' in verdict else verdict}"
        cells = [
            capitalized(damper(change)), _signed_size(change), _span(change), verdict,
            probability(change.p_changed),
        ]  # fmt: skip
        rows.append((cells, tone))
    return rows


def _mark(change: ParameterChange) -> tuple[str, str]:
    """Mark and tone of a change."""
    lower = change.ratio < 1.0
    return {
        "changed": ("▼", "below") if lower else ("▲", "above"), "same": ("✓", "good"),
    }.get(sense(change), ("?", "muted"))  # fmt: skip


def change_rows(document: CompareDocument) -> tuple[list[str], list[list[str]]]:
    """Head and rows of the table of changes."""
    head = [
        "", "before", "after", "change (95 %)", "P(changed)", "P(lower)", "P(higher)",
        "test of no change",
    ]  # fmt: skip
    rows = []
    for name, change in document.changes.items():
        first, second = document.before.parameters[name], document.after.parameters[name]
        rows.append(
            [
                capitalized(plain(change.label)),
                estimate_text(first, first.unit),
                estimate_text(second, second.unit),
                _span(change),
                *(probability(p) for p in (change.p_changed, change.p_lower, change.p_higher)),
                MISSING if change.p_value is None else p_value(change.p_value),
            ]
        )
    return head, rows


def compare_cards(document: CompareDocument) -> tuple[list[dict[str, Any]], list[svg.Panel]]:
    """One card a parameter: its change in percent on a scale that fits, and its probability."""
    made, gauges = [], []
    for name, change in document.changes.items():
        mark, tone = _mark(change)
        if document.verdict == "doubtful":
            tone = "muted"
        share, low, high = (100.0 * (x - 1.0) for x in (change.ratio, *change.eti95))
        key = f"change-{name.replace('_', '-')}"
        picture = svg.gauge(key, share, low, high, 0.0, tone, "no change")
        gauges.append(picture)
        first, second = document.before.parameters[name], document.after.parameters[name]
        made.append(
            {
                "name": name,
                "label": capitalized(damper(change)),
                "value": _signed_size(change),
                "interval": f"95 %: {_span(change)}",
                "sense": "not to be relied on"
                if document.verdict == "doubtful"
                else f"{mark} {_statement(name, change).partition(': ')[2]}",
                "words": f"probability of a change {probability(change.p_changed)}; "
                f"{number(first.mean, first.sd, 1)} → {estimate_text(second, second.unit)}",
                "tone": tone,
                "gauge": picture.key,
                "alt": picture.alt,
            }
        )
    return made, gauges


def _content(document: CompareDocument) -> Iterator[Block]:
    if not document.changes:
        return
    yield Figure("force-velocity", "Damper force before and after", _FORCE, _forces(document))
    prior = document.prior
    note = _NOTE.format(
        unchanged=probability(prior.unchanged), size=percent(float(np.expm1(prior.log_sd)))
    )
    head, rows = change_rows(document)
    yield Table("What changed", head, rows, note)
    pairs = list(_effect_pairs(document))
    if pairs:
        rows = [
            [name if n == 0 else "", plain(key), value_text(value),
             value_text(after.parameters[key]) if key in after.parameters else MISSING]
            for name, before, after in pairs
            for n, (key, value) in enumerate(before.parameters.items())
        ]  # fmt: skip
        yield Table(
            "Effects in the model", ["effect", "parameter", "before", "after"], rows,
            "Each session has its own; docs/effects.md defines the parameters.",
        )  # fmt: skip


def _details(document: CompareDocument) -> Iterator[Block]:
    if document.changes:
        yield Text("What both sessions share", _shared_lines(document))
        yield Figure("motion", "Measured and simulated motion", _MOTION, _motion(document))


def _shared_lines(document: CompareDocument) -> list[str]:
    lines = []
    if document.shared:
        lines.append(
            f"Errors of {enumerated([plain(one) for one in document.shared])} are the same in both "
            "sessions and are taken out of the changes."
        )
    if document.different:
        lines.append(
            f"The vehicle files give other values of "
            f"{enumerated([plain(one) for one in document.different])}, each with an error of its "
            "own, which is part of the changes."
        )
    return lines


def _forces(document: CompareDocument) -> tuple[svg.Panel, ...]:
    """Draw the force of every damper over velocity, before and after."""

    def draw(axes: Axes, place: str) -> str | None:
        before, after = (one.forces.get(place) for one in (document.before, document.after))
        if before is None or after is None:
            return None
        words = place.replace("_", " ")
        axes.axhline(0.0, color=svg.COLOURS["muted"], linewidth=0.8)
        axes.axvline(0.0, color=svg.COLOURS["muted"], linewidth=0.8)
        ink = svg.COLOURS["ink"]
        # Thick and pale below thin and strong: both are visible where they coincide.
        for label, curve, paint, width, alpha in (
            ("before", before, ink, 4.0, 0.3), ("after", after, svg.axle_colour(place), 1.3, 1.0),
        ):  # fmt: skip
            low, high = (svg.curve_array(side) for side in curve.band95)
            grid = svg.curve_array(curve.velocity)
            axes.fill_between(grid, low, high, color=paint, alpha=0.22, linewidth=0)
            axes.plot(
                grid, svg.curve_array(curve.median), color=paint, linewidth=width, alpha=alpha,
                label=label,
            )  # fmt: skip
        label_sides(axes, "compression", "rebound")
        axes.set(
            xlabel=f"{words} damper velocity [{readable_unit(before.unit)}]",
            ylabel=f"force [{readable_unit(before.force_unit)}]",
        )
        svg.legend_above(axes, 2)
        return f"{words} damper: force over velocity, before and after"

    places = dict.fromkeys([*document.before.forces, *document.after.forces])
    return svg.axle_panels("force-{}", draw, 2.4, places)


def _motion(document: CompareDocument) -> tuple[svg.Panel, ...]:
    if not (document.before.runs and document.after.runs):
        return ()
    runs = {"before": document.before.runs[0], "after": document.after.runs[0]}
    both = [motion_panels(run, f"motion-{name}", list(runs.values())) for name, run in runs.items()]
    return tuple(panel for pair in zip(*both, strict=False) for panel in pair)


SECTION: Final = Section(_content)
DETAILS_SECTION: Final = Section(_details, title="Both sessions")
