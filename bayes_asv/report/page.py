"""The content of a report in order, as plain data: HTML and PDF only set it in type."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from typing import Any, Final, TypeVar

from bayes_asv.report.schema import (
    CompareDocument,
    DiagnoseDocument,
    EstimateDocument,
    FleetDocument,
    PageDocument,
    TrackDocument,
)
from bayes_asv.report.sections import COMPARE, DIAGNOSIS, ESTIMATE, FLEET, TRACK
from bayes_asv.report.sections.blocks import About, Block, Figure, Section, Table, Text
from bayes_asv.report.sections.checks import (
    Answer,
    compare_checks,
    diagnosis_checks,
    estimate_checks,
    track_checks,
)
from bayes_asv.report.sections.compare import (
    compare_cards,
    compare_headline,
    compare_steps,
    compare_subtitle,
)
from bayes_asv.report.sections.diagnosis import (
    diagnosis_headline,
    diagnosis_lines,
    diagnosis_steps,
    diagnosis_subtitle,
)
from bayes_asv.report.sections.fleet import fleet_headline, fleet_steps, fleet_subtitle
from bayes_asv.report.sections.localization import residual_overview
from bayes_asv.report.sections.online_filter import (
    is_inconsistent,
    track_subtitle,
)
from bayes_asv.report.sections.parameters import given_table, parameter_table
from bayes_asv.report.sections.simulation import overview
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
from bayes_asv.report.words import MISSING, capitalized, number, plain

__all__ = ["limits", "page_texts", "provenance", "report_page"]

D = TypeVar("D")
Page = dict[str, Any]


@dataclass
class _Content:
    """A report before it becomes plain data."""

    page: Page
    """Texts of the first page."""
    gauges: Sequence[Panel]
    overview: Figure
    """The figure of the first page."""
    checks: Sequence[Answer] = ()
    main: list[Block] = field(default_factory=list)
    """What an engineer reads."""
    appendix: list[tuple[str, list[Block]]] = field(default_factory=list)
    """Titles and content of the parts of the appendix."""

    def add(self, sections: Iterable[Section[D]], document: D) -> None:
        """Add the content of sections, each to the main report or to the appendix."""
        for section in sections:
            blocks = [
                block
                for block in section.content(document)
                if not isinstance(block, Figure) or block.panels
            ]
            if section.title and blocks:
                self.appendix.append((section.title, blocks))
            else:
                self.main += blocks

    def take_overview(self) -> None:
        """Move the first block of the main report to the first page if it is a figure."""
        match self.main:
            case [Figure() as figure, *others]:
                self.overview, self.main = figure, others

    def panels(self) -> Iterator[Panel]:
        """All pictures."""
        yield from self.gauges
        blocks = [self.overview, *self.main, *(b for _, part in self.appendix for b in part)]
        for block in blocks:
            if isinstance(block, Figure):
                yield from block.panels


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
    document : EstimateDocument, DiagnoseDocument, TrackDocument, CompareDocument or FleetDocument
        An estimate may hold a diagnosis of the same recordings under ``diagnosis`` and a track
        under ``online``.  The report leaves out what the document has no data for.

    Returns
    -------
    page : dict
        Strings, lists and dicts only, ready for JSON.  ``overview`` is the figure of the first
        page, ``sections`` the texts, tables and figures of the main report in order, and
        ``appendix`` the parts of the appendix; figures name their pictures by key.
    pictures : dict of str to Panel
        The pictures.
    """
    # matplotlib takes half a second to import, and a refusal has no figures.
    with nullcontext() if document.verdict == "refused" else style():
        if isinstance(document, EstimateDocument):
            content = _estimate(document)
        elif isinstance(document, DiagnoseDocument):
            content = _diagnosis(document)
        elif isinstance(document, FleetDocument):
            content = _fleet(document)
        elif isinstance(document, CompareDocument):
            content = _comparison(document)
        else:
            content = _track(document)
    content.appendix.append(("Provenance", list(provenance(document))))
    page = content.page | _frame(document, content.page["headline"])
    page |= {
        "verdict": document.verdict,
        "reasons": [_sentence(split_reason(r)[0]) for r in document.reasons],
        "checks": [answer._asdict() for answer in content.checks],
        "overview": content.overview.to_dict() if content.overview.panels else None,
        "sections": [block.to_dict() for block in content.main],
        "appendix": [
            {"title": title, "id": f"appendix-{n}", "sections": _below(title, part)}
            for n, (title, part) in enumerate(content.appendix, start=1)
        ],
        "system": document.vehicle.units,
    }
    return _with_fixed_spaces(page), {panel.key: panel for panel in content.panels()}


def page_texts(document: EstimateDocument) -> Page:
    """Title and verdict of an estimate, as :func:`report_page` has them, without any picture."""
    made, _ = cards(document.parameters, reliable=document.verdict == "ok")
    page = {
        "subtitle": _subtitle(document),
        "badge": _BADGES[document.verdict],
        "tone": tone(document.verdict, made),
    }
    texts: Page = _with_fixed_spaces(page | _frame(document, headline(document)))
    return texts


def _frame(document: PageDocument, verdict: str) -> Page:
    """Title, headline and footer of a page."""
    name = plain(document.vehicle.name or "unnamed vehicle")
    # One sentence of the headline a line, so that a damper is found at a glance.
    *first, last = verdict.split(". ")
    return {
        "title": f"Suspension of {name}",
        "name": name,
        "headline": [*(f"{line}." for line in first), last],
        "footer": f"bayes_asv {plain(document.version)}, seed {document.seed}",
    }


def _below(title: str, blocks: Iterable[Block]) -> list[dict[str, Any]]:
    """Plain data of the blocks below a title, which they do not repeat."""
    made = [block.to_dict() for block in blocks]
    return [one | {"title": "" if one["title"] == title else one["title"]} for one in made]


def limits(document: EstimateDocument, about: About | None = None) -> list[str]:
    """State what limits an answer, as the sections of the report do.

    Parameters
    ----------
    document : EstimateDocument
        The estimate.
    about : {'precision', 'model', 'input'}, optional
        Of what the sentences speak, with the document's warnings among those about precision; by
        default all sentences.
    """
    found = [
        text
        for section in ESTIMATE
        if about in (None, section.about)
        for text in section.limits(document)
    ]
    if about in ("model", "input"):
        return found
    # The verdict states a doubt already.
    return [_sentence(w) for w in document.warnings if w != document.doubt] + found


def _no_figure() -> Figure:
    return Figure("overview", "", "", ())


def _estimate(document: EstimateDocument) -> _Content:
    reliable = document.verdict == "ok"
    made, gauges = cards(document.parameters, reliable=reliable)
    page = {
        "subtitle": _subtitle(document),
        "badge": _BADGES[document.verdict],
        "headline": headline(document),
        "tone": tone(document.verdict, made),
        "cards": made,
        "steps": next_steps(document),
        "limits": limits(document, "precision"),
    }
    checks = estimate_checks(document, limits(document, "model"), limits(document, "input"))
    content = _Content(page, gauges, overview(document), checks)
    content.add(ESTIMATE, document)
    diagnosis, track = document.diagnosis, document.online
    if diagnosis is not None:
        refused = diagnosis.verdict == "refused"
        lines = diagnosis_lines(diagnosis) if refused else [diagnosis_headline(diagnosis)]
        lines += [f"Note: {_sentence(note)}" for note in diagnosis.warnings if not refused]
        lines += [f"Next: {step}" for step in diagnosis_steps(diagnosis)]
        content.main.append(Text("What is missing?", lines))
        content.add(DIAGNOSIS, diagnosis)
    if track is not None and track.verdict != "refused":
        lines = [f"{track_subtitle(track)}.", track_headline(track)]
        content.main.append(Text("Online filter", lines))
        content.add(TRACK, track)
    return content


def _subtitle(document: EstimateDocument) -> str:
    files = [plain(r.file) for r in document.provenance.recordings]
    parts = [", ".join(files[:4]) + (f" and {len(files) - 4} more" if len(files) > 4 else "")]
    if document.runs:
        seconds = sum(run.seconds for run in document.runs)
        rates = sorted({round(run.rate) for run in document.runs})
        parts.append(f"{number(seconds, 0.1)} s at {' and '.join(map(str, rates))} Hz")
    return " · ".join(p for p in parts if p)


def _diagnosis(document: DiagnoseDocument) -> _Content:
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
    figure = _no_figure() if refused else residual_overview(document)
    content = _Content(page, gauges, figure, diagnosis_checks(document))
    content.add(DIAGNOSIS, document)
    return content


def _track(document: TrackDocument) -> _Content:
    ok = document.verdict == "ok"
    unreliable = ok and is_inconsistent(document)
    made, gauges = cards(document.parameters, reliable=not unreliable)
    page = {
        "subtitle": track_subtitle(document),
        "badge": "Verdict, not to be relied on" if unreliable else _BADGES[document.verdict],
        "headline": track_headline(document),
        "tone": "stop" if unreliable else tone(document.verdict, made),
        "cards": made,
        "steps": track_steps(document),
        "limits": [_sentence(w) for w in document.warnings if w != document.doubt],
    }
    content = _Content(page, gauges, _no_figure(), track_checks(document))
    content.add(TRACK, document)
    content.take_overview()  # the parameters against time
    if ok:
        content.main.append(parameter_table(document.parameters, "Parameters at the last row"))
        if document.known:
            content.appendix.insert(0, ("Given values", [given_table(document.known)]))
    return content


def _fleet(document: FleetDocument) -> _Content:
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
    content = _Content(page, gauges, _no_figure())
    content.add(FLEET, document)
    content.take_overview()  # the season
    return content


def _comparison(document: CompareDocument) -> _Content:
    """Pages of two sessions; their cards are the changes."""
    made, gauges = compare_cards(document)
    tones = [card["tone"] for card in made]
    stop = document.verdict in ("refused", "doubtful")
    page = {
        "subtitle": compare_subtitle(document),
        "badge": "Comparison: refused" if document.verdict == "refused" else "What changed?",
        "headline": compare_headline(document),
        "tone": "stop"
        if stop
        else next((t for t in ("below", "above", "muted") if t in tones), "good"),
        "cards": made,
        "steps": compare_steps(document),
        "limits": [_sentence(warning) for warning in document.warnings],
    }
    sessions = (("before", document.before), ("after", document.after))
    checks = compare_checks(document, {name: limits(one, "model") for name, one in sessions})
    content = _Content(page, gauges, _no_figure(), checks)
    content.add(COMPARE, document)
    content.take_overview()  # force over velocity
    return content


def _sentence(text: str) -> str:
    words = plain(text)
    if words.startswith(("the ", "only ")):  # anything else may be the name of a file
        words = capitalized(words)
    return words if words.endswith((".", "!", "?")) else f"{words}."


def _with_fixed_spaces(value: Any) -> Any:
    """Keep numbers and their units on one line, in all text of a page."""
    if isinstance(value, dict):
        return {k: _with_fixed_spaces(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_with_fixed_spaces(v) for v in value]
    return _SPACE.sub("\u00a0", value) if isinstance(value, str) else value


def provenance(document: PageDocument) -> Iterator[Block]:
    """List what is needed to repeat the computation."""
    origin = document.provenance
    files = [*origin.recordings, *([origin.vehicle] if origin.vehicle is not None else [])]
    rows = [[plain(f.file or MISSING), plain(f.sha256 or "no hash")] for f in files]
    if rows:
        yield Table("Provenance", ["file", "SHA-256"], rows, kind="hashes")
    versions = {"bayes_asv": document.version, "Python": origin.python, **origin.packages}
    shown = ", ".join(f"{plain(name)} {plain(v)}" for name, v in versions.items() if v)
    lines = [
        f"Versions: {shown}. Seed {document.seed}: the same files, versions and seed give the same "
        "numbers."
    ]
    if isinstance(document, EstimateDocument) and document.diagnostics.likelihood:
        car, likelihood = plain(document.car), plain(document.diagnostics.likelihood)
        lines[0] += f" Model of the car: {car}. Likelihood: {likelihood}."
    yield Text("", lines)
