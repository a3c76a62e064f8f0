"""The diagnosis in a report: a part of an estimate's pages, or pages of its own."""

from __future__ import annotations

from typing import Any

from bayes_asv.report.diagnose_figures import diagnose_figures
from bayes_asv.report.diagnose_tables import (
    effect_table,
    gap_table,
    moved_table,
    preflight_table,
)
from bayes_asv.report.diagnose_words import (
    diagnose_headline,
    diagnose_steps,
    diagnosis_lines,
    name_of,
    place,
)
from bayes_asv.report.readable import plain
from bayes_asv.report.svg import Panel

__all__ = ["SCHEMA", "diagnose_limits", "diagnose_sections", "diagnose_subtitle", "is_diagnosis"]

Document = dict[str, Any]

SCHEMA = "bayes_asv/diagnose/1"


def is_diagnosis(document: Document) -> bool:
    """Whether a document is a diagnosis alone."""
    return document.get("schema") == SCHEMA


def diagnose_subtitle(document: Document) -> str:
    """Say which runs were fitted and which were held out."""
    runs = document.get("runs") or {}
    fit, held = ([plain(source) for source in runs.get(k) or []] for k in ("fit", "holdout"))
    parts = [f"fitted: {', '.join(fit)}" if fit else "", ""]
    if held:
        same = held == fit
        parts[1] = "held out: its second half" if same else f"held out: {', '.join(held)}"
    return " · ".join(p for p in parts if p)


def diagnose_limits(document: Document) -> list[str]:
    """Say what a diagnosis means for an answer of the linear half car, or what limits it itself."""
    if document["verdict"] not in ("named", "unexplained"):
        return []
    effects = [f"{name_of(e)}{place(e)}" for e in document["effects"]]
    text = "The half car of this page is linear, and these recordings need more: "
    text += " and ".join(effects) if effects else "something that has no name"
    text += ". See 'What is missing?' for the parameters with it."
    return [text]


def diagnose_sections(
    document: Document, pictures: dict[str, Panel], *, alone: bool = False
) -> list[Document]:
    """Set out a diagnosis.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/diagnose/1``.
    pictures : dict of str to Panel
        The figures' pictures are added to it.
    alone : bool
        The page is the diagnosis' own and has said headline and steps already.

    Returns
    -------
    list of dict
        Sections as in :func:`bayes_asv.report.content.content`.
    """
    lines = diagnosis_lines(document)
    title = "What was found" if alone else "What is missing?"
    if not alone:
        lines = [diagnose_headline(document), *lines]
        lines += [f"Next: {step}" for step in diagnose_steps(document)]
    sections: list[Document] = [{"kind": "text", "title": title, "lines": lines}]
    if document["verdict"] == "refused":
        return sections if not alone else []
    sections += [
        t
        for t in (
            effect_table(document), gap_table(document), moved_table(document),
            preflight_table(document),
        )
        if t is not None
    ]  # fmt: skip
    figures = diagnose_figures(document)
    if figures:
        sections.append(
            {
                "kind": "heading",
                "title": "Figures" if alone else "Figures of what is missing",
                "text": "Before is the linear half car, after the model with everything that was "
                "named. Signs: up is positive for accelerations and forces on the chassis, "
                "extension is positive for deflection and velocity.",
            }
        )
    for figure in figures:
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
    return sections
