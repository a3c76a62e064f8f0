"""What a report says, in order, as plain text and tables: HTML and PDF only set it in type."""

from __future__ import annotations

import re
from typing import Any, Final

from bayes_asv.report.budget_tables import budget_table, fault_table
from bayes_asv.report.budget_words import halving_lines, width_limits
from bayes_asv.report.consistency_tables import agreement_table, check_table
from bayes_asv.report.consistency_words import agreement_lines, check_limits, independent_lines
from bayes_asv.report.diagnose_content import (
    diagnose_limits,
    diagnose_sections,
    diagnose_subtitle,
    is_diagnosis,
)
from bayes_asv.report.diagnose_tables import model_table
from bayes_asv.report.diagnose_words import diagnose_headline, diagnose_steps
from bayes_asv.report.figures import MOST_RUNS, Figure, figures
from bayes_asv.report.readable import number, plain, probability
from bayes_asv.report.svg import Panel, gauge
from bayes_asv.report.tables import (
    fit_table,
    known_table,
    noise_table,
    parameter_table,
    provenance_tables,
    travel_table,
)
from bayes_asv.report.track_content import is_track, track_sections, track_subtitle
from bayes_asv.report.track_words import (
    DOUBTED_STEPS,
    consistency_lines,
    is_doubted,
    track_headline,
)
from bayes_asv.report.words import (
    LABELS,
    SHOWN,
    compare,
    convergence_lines,
    headline,
    interval,
    likelihood_words,
    next_steps,
    quantity,
    split_reason,
)

__all__ = ["content", "limits"]

Document = dict[str, Any]
Page = dict[str, Any]

BADGES: Final = {
    "ok": "Verdict",
    "refused": "Verdict: refused",
    "not_converged": "Verdict: not converged",
}
TONES: Final = {"below": "below", "above": "above", "agrees": "good", "unclear": "muted"}

_SIGNS: Final = (
    "Signs: up is positive for accelerations, extension is positive for travel, and bound is "
    "compression, a negative damper velocity."
)
_REACHES: Final = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
_COLOURED: Final = 0.01  # whiteness probability below which the intervals are doubted
_GAP: Final = re.compile(r"(?<=[\d<>±]) (?=[%±\d]|[A-Za-z]+[·/²]|(?:in|m|mm|kg|s|sd|Hz)\b)")
_NEAR: Final = 0.95  # share of a travel limit that counts as reached


def content(document: Document) -> tuple[Page, dict[str, Panel]]:
    """Set out a report.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/estimate/1``, with a diagnosis of the same recordings under ``diagnosis``
        and a track under ``online`` or without; or schema ``bayes_asv/diagnose/1`` or
        ``bayes_asv/track/1`` alone. What is not of the stable interface may be absent; the report
        then leaves out what it would have shown.

    Returns
    -------
    page : dict
        Strings, lists and dicts only, ready for JSON. ``sections`` holds text, tables and
        figures in order; figures name their pictures by key.
    pictures : dict of str to Panel
        The pictures.
    """
    if is_diagnosis(document):
        return _diagnosis(document)
    if is_track(document):
        return _track(document)
    verdict = document["verdict"]
    vehicle = document.get("vehicle", {})
    pictures: dict[str, Panel] = {}
    cards = _cards(document, pictures)
    name = plain(vehicle.get("name") or "unnamed vehicle")
    page: Page = {
        "title": f"Suspension of {name}",
        "name": name,
        "subtitle": _subtitle(document),
        "verdict": verdict,
        "badge": BADGES.get(verdict, plain(verdict)),
        "headline": headline(document).split(". "),
        "tone": _tone(verdict, cards),
        "cards": cards,
        "reasons": [_sentence(split_reason(r)[0]) for r in document["reasons"]],
        "steps": next_steps(document),
        "limits": limits(document),
        "sections": [],
        "system": vehicle.get("units", "SI"),
        "footer": f"bayes_asv {plain(document.get('version', ''))}, seed {document.get('seed')}",
    }  # fmt: skip
    sections: list[Document] = page["sections"]
    if verdict != "refused":
        _results(document, sections, pictures)
    known = known_table(document)
    if known is not None and verdict == "refused":
        sections.append(known)
    if document.get("diagnosis"):
        sections += diagnose_sections(document["diagnosis"], pictures)
    if document.get("online"):
        sections += track_sections(document["online"], pictures)
    sections += provenance_tables(document)
    return _finished(page), pictures


def _finished(page: Page) -> Page:
    """Set a sentence of the headline a line, so that the eye finds its damper sooner; tie units."""
    *first, last = page["headline"]
    tied: Page = _tied({**page, "headline": [*(f"{line}." for line in first), last]})
    return tied


def _diagnosis(document: Document) -> tuple[Page, dict[str, Panel]]:
    """Pages of a diagnosis alone; its cards are the parameters with what was named."""
    verdict = document["verdict"]
    vehicle = document.get("vehicle", {})
    pictures: dict[str, Panel] = {}
    refused = verdict == "refused"
    after = {} if refused else document["parameters_after"]
    cards = _cards({"verdict": "ok", "parameters": after}, pictures)
    name = plain(vehicle.get("name") or "unnamed vehicle")
    tones = {"agreement": "good", "named": "above", "unexplained": "muted"}
    sections = diagnose_sections(document, pictures, alone=True)
    page: Page = {
        "title": f"Suspension of {name}",
        "name": name,
        "subtitle": diagnose_subtitle(document),
        "verdict": verdict,
        "badge": "Verdict: refused" if refused else "What is missing?",
        "headline": diagnose_headline(document).split(". "),
        "tone": tones.get(verdict, "stop"),
        "cards": cards,
        "reasons": [_sentence(split_reason(r)[0]) for r in document["reasons"]],
        "steps": diagnose_steps(document),
        "limits": [_sentence(w) for w in document["warnings"]],
        "sections": [*sections, *provenance_tables(document)],
        "system": vehicle.get("units", "SI"),
        "footer": f"bayes_asv {plain(document.get('version', ''))}, seed {document.get('seed')}",
    }
    return _finished(page), pictures


def _amiss(document: Document) -> bool:
    return bool(document["verdict"] == "ok" and document["consistency"]["verdict"] != "consistent")


def _track(document: Document) -> tuple[Page, dict[str, Panel]]:
    """Pages of a track alone."""
    verdict = document["verdict"]
    vehicle = document.get("vehicle", {})
    pictures: dict[str, Panel] = {}
    doubtful = verdict == "ok" and is_doubted(document)
    cards = _cards({**document, "verdict": "not_converged"} if doubtful else document, pictures)
    name = plain(vehicle.get("name") or "unnamed vehicle")
    page: Page = {
        "title": f"Suspension of {name}",
        "name": name,
        "subtitle": track_subtitle(document),
        "verdict": verdict,
        "badge": "Verdict, not to be relied on" if doubtful else BADGES[verdict],
        "headline": track_headline(document).split(". "),
        "tone": "stop" if doubtful else _tone(verdict, cards),
        "cards": cards,
        "reasons": [_sentence(split_reason(r)[0]) for r in document["reasons"]],
        "steps": list(DOUBTED_STEPS) if doubtful else next_steps(document),
        "limits": [
            *(consistency_lines(document)[1:] if _amiss(document) else []),
            *(_sentence(w) for w in document["warnings"]),
        ],
        "sections": [
            *track_sections(document, pictures, alone=True), *provenance_tables(document),
        ],
        "system": vehicle.get("units", "SI"),
        "footer": f"bayes_asv {plain(document.get('version', ''))}, seed {document.get('seed')}",
    }  # fmt: skip
    return _finished(page), pictures


def _tied(value: Any) -> Any:
    """Keep numbers and their units on one line, in all text of a page."""
    if isinstance(value, dict):
        return {k: _tied(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_tied(v) for v in value]
    return _GAP.sub("\u00a0", value) if isinstance(value, str) else value


def limits(document: Document) -> list[str]:
    """Say what limits the answer: the document's warnings, and what a look at its runs adds.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/estimate/1``.

    Returns
    -------
    list of str
        Sentences; empty when nothing was found.
    """
    found = [_sentence(w) for w in document["warnings"]]
    if document.get("diagnosis"):
        found += diagnose_limits(document["diagnosis"])
    found += check_limits(document)
    if document["verdict"] == "ok":
        found += width_limits(document)
    stops = (document.get("vehicle", {}).get("travel")) or {}
    for run in document.get("runs", []):
        source = plain(run["source"])
        for axle in ("front", "rear"):
            curve = run["travel"].get(axle) or {}
            for side in ("bump", "droop"):
                limit, most = stops.get(f"{axle}_{side}"), curve.get(f"largest_{side}")
                if limit and most is not None and most >= _NEAR * limit:
                    found.append(
                        f"The {axle} suspension reached its {side} limit in {source}; the half "
                        "car has no stops, so drive lower or slower, or use another run."
                    )
            p = run["chassis"].get(f"{axle}_chassis", {}).get("whiteness_p")
            if p is not None and p < _COLOURED:
                found.append(
                    f"The {axle} residuals of {source} are not white (probability "
                    f"{probability(p)}): something moves that the half car does not know, and "
                    "the intervals are narrower than they should be."
                )
    return found


def _sentence(text: str) -> str:
    words = plain(text)
    if words.startswith("the "):  # nothing else: it may be the name of a file
        words = f"The {words[4:]}"
    return words if words.endswith((".", "!", "?")) else f"{words}."


def _subtitle(document: Document) -> str:
    runs = document.get("runs", [])
    files = [plain(r["file"]) for r in document.get("provenance", {}).get("recordings", [])]
    parts = [", ".join(files[:4]) + (f" and {len(files) - 4} more" if len(files) > 4 else "")]
    if runs:
        seconds = sum(r["seconds"] for r in runs)
        rates = sorted({round(r["rate"]) for r in runs})
        parts.append(f"{number(seconds, 0.1)} s at {' and '.join(str(r) for r in rates)} Hz")
    return " · ".join(p for p in parts if p)


def _cards(document: Document, pictures: dict[str, Panel]) -> list[Document]:
    """One card a parameter: value, gauge against nominal, and what that means in words."""
    parameters = document["parameters"]
    there = [(n, parameters[n]) for n in SHOWN if n in parameters]
    found = {n: compare(n, p) for n, p in there}
    spans = [
        max(abs(v / p["nominal"] - 1.0) for v in (*p["eti95"], p["mean"]))
        for n, p in there
        if found[n] is not None
    ]
    most = max(spans, default=0.1)
    # One scale for all cards, so that the eye may compare them.
    reach = next((r for r in _REACHES if most <= r), _REACHES[-1])
    cards = []
    for name, p in there:
        c = found[name]
        card = {
            "name": name,
            "label": LABELS[name].capitalize(),
            "value": quantity(p["mean"], p["sd"], p["unit"]),
            "interval": f"95 %: {interval(p)}",
            "nominal": f"nominal {number(p.get('nominal'))}",
            "sense": "", "words": "", "tone": "muted", "gauge": "", "alt": "",
        }  # fmt: skip
        if c is not None:
            colour = TONES[c.sense] if document["verdict"] == "ok" else "muted"
            low, high = (v / p["nominal"] - 1.0 for v in p["eti95"])
            picture = gauge(f"gauge-{name.replace('_', '-')}", c.share, low, high, reach, colour)
            pictures[picture.key] = picture
            card |= {"gauge": picture.key, "alt": picture.alt}
            if document["verdict"] == "ok":
                mark = {"agrees": "✓", "below": "▼", "above": "▲", "unclear": "?"}[c.sense]
                card |= {
                    "tone": TONES[c.sense],
                    "sense": f"{mark} {c.words}",
                    "words": f"{likelihood_words(c.p_side)} {c.side} nominal "
                    f"({probability(c.p_side)})",
                }
            else:
                card |= {"sense": "not to be relied on"}
        cards.append(card)
    return cards


def _tone(verdict: str, cards: list[Document]) -> str:
    if verdict != "ok":
        return "stop"
    tones = [c["tone"] for c in cards if c["name"] in ("c_f", "c_r")]
    return next((t for t in ("below", "above", "muted") if t in tones), "good")


def _results(document: Document, sections: list[Document], pictures: dict[str, Panel]) -> None:
    """Tables and figures of an answer."""
    units = document.get("vehicle", {}).get("units", "SI")
    parameters = document["parameters"]
    if parameters:
        title = "Parameters" if document["verdict"] == "ok" else "Parameters, not to be relied on"
        sections.append(parameter_table(parameters, si=False, title=title))
        if units != "SI" and all("si" in p for p in parameters.values()):
            sections.append(parameter_table(parameters, si=True, title=f"{title}, in SI units"))
    sections += [
        t
        for t in (
            model_table(document), known_table(document), budget_table(document),
            fault_table(document),
        )
        if t is not None
    ]  # fmt: skip
    lines = halving_lines(document)
    if lines:
        sections.append({"kind": "text", "title": "What would halve each width", "lines": lines})
    sections += [t for t in (agreement_table(document),) if t is not None]
    agreed = agreement_lines(document)
    if agreed:
        sections.append({"kind": "text", "title": "", "lines": agreed})
    found: list[Figure] = figures(document)
    if found:
        sections.append({"kind": "heading", "title": "Figures", "text": _SIGNS})
    for figure in found:
        pictures.update({p.key: p for p in figure.panels})
        sections.append(
            {
                "kind": "figure",
                "key": figure.key,
                "title": figure.title,
                "caption": figure.caption,
                "panels": [{"key": p.key, "alt": p.alt, "wide": p.wide} for p in figure.panels],
            }
        )
    left_out = len(document.get("runs", [])) - MOST_RUNS
    if left_out > 0:
        sections.append(
            {"kind": "text", "title": "", "lines": [
                f"Figures of {left_out} further recordings are left out; the tables hold all."]}
        )  # fmt: skip
    sections += [
        t for t in (fit_table(document), travel_table(document), noise_table(document))
        if t is not None
    ]  # fmt: skip
    sections += [t for t in (check_table(document),) if t is not None]
    diagnostics = document.get("diagnostics", {})
    lines = independent_lines(diagnostics) or convergence_lines(diagnostics)
    if lines:
        sections.append({"kind": "text", "title": "Is the sampling good enough?", "lines": lines})
