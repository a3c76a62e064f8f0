"""What a section of a report is made of: texts, tables and figures, as plain data."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar

from bayes_asv.report.svg import Panel

__all__ = ["About", "Block", "Figure", "Section", "Table", "Text"]

D = TypeVar("D")


@dataclass(frozen=True)
class Text:
    """Paragraphs below a title; without a title they continue what is above."""

    title: str
    lines: Sequence[str]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for the templates."""
        return {"kind": "text", "title": self.title, "lines": list(self.lines)}


@dataclass(frozen=True)
class Table:
    """Rows of text; the first column is a label, the others are right-aligned figures."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""
    kind: Literal["table", "hashes", "texts"] = "table"
    """``hashes`` sets the second column in a small monospaced font; ``texts`` breaks lines."""

    def to_dict(self) -> dict[str, Any]:
        """Plain data for the templates."""
        return {
            "kind": self.kind, "title": self.title, "columns": list(self.columns),
            "rows": [list(row) for row in self.rows], "note": self.note,
        }  # fmt: skip


@dataclass(frozen=True)
class Figure:
    """One or several pictures with a caption that says what to look for."""

    key: str
    """Unique in the report."""
    title: str
    caption: str
    panels: tuple[Panel, ...]
    columns: Literal[2, 3] = 2
    """Panels beside each other, where there is room; three of :data:`~bayes_asv.report.svg.SMALL`
    size."""

    def to_dict(self) -> dict[str, Any]:
        """Plain data for the templates, which take the pictures by their keys."""
        panels = [{"key": p.key, "alt": p.alt, "wide": p.wide} for p in self.panels]
        return {
            "kind": "figure", "key": self.key, "title": self.title, "caption": self.caption,
            "panels": panels, "columns": self.columns,
        }  # fmt: skip


Block = Text | Table | Figure
About = Literal["precision", "model", "input"]


def _no_limits(_: Any) -> list[str]:
    return []


@dataclass(frozen=True)
class Section(Generic[D]):
    """One subject of a report on a document of type D.

    Parameters
    ----------
    content : callable
        From the document to texts, tables and figures in their order; nothing where the document
        has no data for them.  A figure without panels is left out.
    limits : callable
        From the document to sentences for the first page.
    about : {'precision', 'model', 'input'}
        What the limits speak of: they are part of "What limits the answer", or of the answers to
        whether the model holds and whether the inputs agree.
    title : str
        Title of its part of the appendix, which is folded away; without one it is a section of
        the main report.
    """

    content: Callable[[D], Iterable[Block]]
    limits: Callable[[D], Sequence[str]] = _no_limits
    about: About = "precision"
    title: str = ""
