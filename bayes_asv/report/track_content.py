"""A track in a report: a part of an estimate's pages, or pages of its own."""

from __future__ import annotations

from typing import Any

from bayes_asv.report.figures import Figure
from bayes_asv.report.readable import number, plain
from bayes_asv.report.svg import Panel, style
from bayes_asv.report.tables import known_table, parameter_table
from bayes_asv.report.track_words import consistency_lines, track_headline

__all__ = ["SCHEMA", "is_track", "track_sections", "track_subtitle"]

Document = dict[str, Any]

SCHEMA = "bayes_asv/track/1"


def is_track(document: Document) -> bool:
    """Whether a document is a track alone."""
    return document.get("schema") == SCHEMA


def track_subtitle(document: Document) -> str:
    """Say what was tracked, and with which filter."""
    files = [plain(r["file"]) for r in document.get("provenance", {}).get("recordings", [])]
    found = document.get("filter") or {}
    parts = [", ".join(files)]
    if found.get("rows"):
        seconds, rate = number(found.get("seconds"), 0.1), number(found.get("rate"), 10.0)
        parts.append(f"{seconds} s at {rate} Hz")
    forget = found.get("forget_seconds")
    parts.append(
        "online filter, parameters constant"
        if forget is None
        else f"online filter, parameters may wander by 10 % in {number(forget)} s"
    )
    return " · ".join(p for p in parts if p)


def track_sections(
    document: Document, pictures: dict[str, Panel], *, alone: bool = False
) -> list[Document]:
    """Set out a track.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/track/1``.
    pictures : dict of str to Panel
        The figures' pictures are added to it.
    alone : bool
        The page is the track's own and has said its headline already.

    Returns
    -------
    list of dict
        Sections as in :func:`bayes_asv.report.content.content`.
    """
    if document["verdict"] == "refused":
        return []
    lines = consistency_lines(document)
    if not alone:
        lines = [f"{track_subtitle(document)}.", track_headline(document), *lines]
    title = "Can the filter be trusted?" if alone else "Row by row: the online filter"
    sections: list[Document] = []
    if alone:
        shown = document["parameters"]
        sections.append(parameter_table(shown, si=False, title="Parameters at the last row"))
        known = known_table(document)
        sections += [known] if known is not None else []
    sections.append({"kind": "text", "title": title, "lines": lines})
    for figure in _figures(document):
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


def _figures(document: Document) -> list[Figure]:
    """Draw what there is data for."""
    from bayes_asv.report import plots_track

    if not document.get("track"):
        return []
    with style():
        found = [
            Figure(
                "track",
                "Parameters against time, from the online filter",
                "Look whether the band closes and stays: a curve that leaves its own band later "
                "says that the parameter changed, or that the filter was too sure. Bands are 95 %; "
                "the wide one of the beginning, when nothing is known, runs out of the picture. "
                "Red is time in which the filter was not consistent.",
                plots_track.parameters(document),
            ),
            Figure(
                "track-nis",
                "Do the filter's predictions miss by as much as they say?",
                "Look whether the curve stays in the green band: 95 % of the time it should. "
                "Above it the filter claims too much, below it too little. The lower curve says "
                "how far noise was widened to make good for it: about one while all is well.",
                (plots_track.consistency(document),),
            ),
            Figure(
                "track-lags",
                "Autocorrelation of the online filter's innovations",
                "Look for bars far outside the band: what one prediction missed then tells what "
                "the next will miss, so that something moves that the filter does not know.",
                plots_track.autocorrelations(document),
            ),
        ]
    return [figure for figure in found if figure.panels]
