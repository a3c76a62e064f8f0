"""The content of a report in order, as plain data: HTML and PDF only set it in type."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import nullcontext
from typing import Any, Final, TypeVar

from bayes_asv.report.schema import (
    DiagnoseDocument,
    EstimateDocument,
    FleetDocument,
    PageDocument,
    TrackDocument,
)
from bayes_asv.report.sections import DIAGNOSIS, ESTIMATE, FLEET, TRACK
from bayes_asv.report.sections.blocks import Block, Figure, Section, Text
from bayes_asv.report.sections.diagnosis import (
    diagnosis_headline,
    diagnosis_lines,
    diagnosis_steps,
    diagnosis_subtitle,
)
from bayes_asv.report.sections.fleet import fleet_headline, fleet_steps, fleet_subtitle
from bayes_asv.report.sections.online_filter import (
    consistency_lines,
    is_inconsistent,
    track_subtitle,
)
from bayes_asv.report.sections.parameters import given_table, parameter_table
from bayes_asv.report.sections.provenance import provenance
from bayes_asv.report.sections.verdict import (
    cards,
    headline,
    next_steps,
    split_reason,
    tone,
    track_headline,
    track_steps,
)
from bayes_asv.report.svg import Panel, style
from bayes_asv.report.words import number, plain

__all__ = ["limits", "report_page"]

D = TypeVar("D")
Page = dict[str, Any]

_BADGES: Final = {
    "ok": "Verdict",
    "refused": "Verdict: refused",
    "not_converged": "Verdict: not converged",
}
_DIAGNOSIS_TONES: Final = {"agreement": "good", "named": "above", "unexplained": "muted"}
_SPACE: Final = re.compile(r"(?<=[\d<>±]) (?=[%±\d]|[A-Za-z]+[·/²]|(?:in|m|mm|kg|s|sd|Hz)\b)")


def report_page(document: PageDocument) -> tuple[Page, dict[str, Panel]]:
    """Compose a report.

    Parameters
    ----------
    document : EstimateDocument, DiagnoseDocument, TrackDocument or FleetDocument
        An estimate may hold a diagnosis of the same recordings under ``diagnosis`` and a track
        under ``online``.  The report leaves out what the document has no data for.

    Returns
    -------
    page : dict
        Strings, lists and dicts only, ready for JSON.  ``sections`` holds texts, tables and
        figures in order; figures name their pictures by key.
    pictures : dict of str to Panel
        The pictures.
    """
    # matplotlib takes half a second to import, and a refusal has no figures.
    with nullcontext() if document.verdict == "refused" else style():
        if isinstance(document, EstimateDocument):
            page, gauges, blocks = _estimate(document)
        elif isinstance(document, DiagnoseDocument):
            page, gauges, blocks = _diagnosis(document)
        elif isinstance(document, FleetDocument):
            page, gauges, blocks = _fleet(document)
        else:
            page, gauges, blocks = _track(document)
        sections = [block for block in blocks if not isinstance(block, Figure) or block.panels]
    name = plain(document.vehicle.name or "unnamed vehicle")
    page |= {
        "title": f"Suspension of {name}",
        "name": name,
        "verdict": document.verdict,
        "reasons": [_sentence(split_reason(r)[0]) for r in document.reasons],
        "sections": [block.to_dict() for block in sections],
        "system": document.vehicle.units,
        "footer": f"bayes_asv {plain(document.version)}, seed {document.seed}",
    }
    # One sentence of the headline a line, so that a damper is found at a glance.
    *first, last = page["headline"].split(". ")
    page["headline"] = [*(f"{line}." for line in first), last]
    panels = [panel for block in sections if isinstance(block, Figure) for panel in block.panels]
    return _with_fixed_spaces(page), {panel.key: panel for panel in (*gauges, *panels)}


def limits(document: EstimateDocument) -> list[str]:
    """State what limits the answer: warnings of the document, then sentences of the sections."""
    found = [_sentence(warning) for warning in document.warnings]
    return found + [text for section in ESTIMATE for text in section.limits(document)]


def _content(sections: Iterable[Section[D]], document: D) -> Iterator[Block]:
    for section in sections:
        yield from section.content(document)


Composed = tuple[Page, Sequence[Panel], Iterable[Block]]


def _estimate(document: EstimateDocument) -> Composed:
    reliable = document.verdict == "ok"
    made, gauges = cards(document.parameters, reliable=reliable)
    page = {
        "subtitle": _subtitle(document),
        "badge": _BADGES[document.verdict],
        "headline": headline(document),
        "tone": tone(document.verdict, made),
        "cards": made,
        "steps": next_steps(document),
        "limits": limits(document),
    }

    def blocks() -> Iterator[Block]:
        yield from _content(ESTIMATE, document)
        diagnosis, track = document.diagnosis, document.online
        if diagnosis is not None:
            refused = diagnosis.verdict == "refused"
            lines = diagnosis_lines(diagnosis) if refused else [diagnosis_headline(diagnosis)]
            lines += [f"Next: {step}" for step in diagnosis_steps(diagnosis)]
            yield Text("What is missing?", lines)
            yield from _content(DIAGNOSIS, diagnosis)
        if track is not None and track.verdict != "refused":
            yield Text("Online filter", [f"{track_subtitle(track)}.", track_headline(track)])
            yield from _content(TRACK, track)
        yield from provenance(document)

    return page, gauges, blocks()


def _subtitle(document: EstimateDocument) -> str:
    files = [plain(r.file) for r in document.provenance.recordings]
    parts = [", ".join(files[:4]) + (f" and {len(files) - 4} more" if len(files) > 4 else "")]
    if document.runs:
        seconds = sum(run.seconds for run in document.runs)
        rates = sorted({round(run.rate) for run in document.runs})
        parts.append(f"{number(seconds, 0.1)} s at {' and '.join(map(str, rates))} Hz")
    return " · ".join(p for p in parts if p)


def _diagnosis(document: DiagnoseDocument) -> Composed:
    """Pages of a diagnosis alone; its cards are the parameters with the named effects."""
    refused = document.verdict == "refused"
    made, gauges = cards({} if refused else document.parameters_after)
    page = {
        "subtitle": diagnosis_subtitle(document),
        "badge": "Verdict: refused" if refused else "What is missing?",
        "headline": diagnosis_headline(document),
        "tone": _DIAGNOSIS_TONES.get(document.verdict, "stop"),
        "cards": made,
        "steps": diagnosis_steps(document),
        "limits": [_sentence(warning) for warning in document.warnings],
    }
    return page, gauges, (*_content(DIAGNOSIS, document), *provenance(document))


def _track(document: TrackDocument) -> Composed:
    ok = document.verdict == "ok"
    unreliable = ok and is_inconsistent(document)
    made, gauges = cards(document.parameters, reliable=not unreliable)
    at_fault = document.consistency.verdict != "consistent"
    page = {
        "subtitle": track_subtitle(document),
        "badge": "Verdict, not to be relied on" if unreliable else _BADGES[document.verdict],
        "headline": track_headline(document),
        "tone": "stop" if unreliable else tone(document.verdict, made),
        "cards": made,
        "steps": track_steps(document),
        "limits": [
            *(consistency_lines(document)[1:] if ok and at_fault else []),
            *(_sentence(warning) for warning in document.warnings),
        ],
    }

    def blocks() -> Iterator[Block]:
        if ok:
            yield parameter_table(document.parameters, "Parameters at the last row")
            if document.known:
                yield given_table(document.known)
        yield from _content(TRACK, document)
        yield from provenance(document)

    return page, gauges, blocks()


def _fleet(document: FleetDocument) -> Composed:
    """Pages of a season; its cards are the levels at the last recording."""
    made, gauges = cards({name: trend.latest for name, trend in document.trends.items()})
    page = {
        "subtitle": fleet_subtitle(document),
        "badge": "Season: refused" if document.verdict == "refused" else "Season, and latest level",
        "headline": fleet_headline(document),
        "tone": tone(document.verdict, made) if made or document.verdict != "ok" else "muted",
        "cards": made,
        "steps": fleet_steps(document),
        "limits": [
            *(_sentence(warning) for warning in document.warnings),
            *(text for section in FLEET for text in section.limits(document)),
        ],
    }
    return page, gauges, (*_content(FLEET, document), *provenance(document))


def _sentence(text: str) -> str:
    words = plain(text)
    if words.startswith("the "):  # anything else may be the name of a file
        words = f"The {words[4:]}"
    return words if words.endswith((".", "!", "?")) else f"{words}."


def _with_fixed_spaces(value: Any) -> Any:
    """Keep numbers and their units on one line, in all text of a page."""
    if isinstance(value, dict):
        return {k: _with_fixed_spaces(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_with_fixed_spaces(v) for v in value]
    return _SPACE.sub("\u00a0", value) if isinstance(value, str) else value
