"""The answer of ``estimate``, ``track``, ``diagnose`` and ``compare`` in a terminal.

It is a verdict, a table and sentences.
A number that is in the table is in no sentence.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from bayes_asv.report.schema import (
    CompareDocument,
    DiagnoseDocument,
    EstimateDocument,
    TrackDocument,
)
from bayes_asv.report.schema.parts import Parameter, Quantity
from bayes_asv.report.sections.compare import change_sentence, terminal_rows
from bayes_asv.report.sections.online_filter import is_inconsistent, last_state
from bayes_asv.report.sections.parameters import answers, short_label
from bayes_asv.report.sections.simulation_error import asked, shift_sentence
from bayes_asv.report.sections.verdict import MARKS
from bayes_asv.report.words import (
    TONES,
    capitalized,
    compare_parameter,
    estimate_text,
    interval,
    number,
    parameter_sentence,
    plus_minus,
    probability,
)

if TYPE_CHECKING:
    from rich.console import RenderableType

__all__ = ["WIDTH", "answer_text"]

WIDTH: Final = 80
"""Columns of the text at most, and where it is piped."""

_STYLES: Final = {"below": "bold red", "above": "bold magenta", "good": "bold green"}
_PREFIXES: Final = {"Next": "bold", "Note": "bold yellow", "Why": "bold red"}
_INDENT: Final = "  "

Answer = EstimateDocument | TrackDocument | DiagnoseDocument | CompareDocument


def answer_text(document: Answer, lines: Sequence[str], width: int) -> list[RenderableType]:
    """Compose the text of an answer.

    Parameters
    ----------
    document : EstimateDocument, TrackDocument, DiagnoseDocument or CompareDocument
        The answer.
    lines : sequence of str
        The same in sentences, the verdict first.
    width : int
        Columns of the terminal.

    Returns
    -------
    list of renderable
        For rich.  Foreign text in it is no markup.
    """
    head, rows, said = _table(document)
    shown: list[RenderableType] = []
    for n, line in enumerate(line for line in lines if line not in said):
        shown.append(_paragraph(line, min(width, WIDTH), "bold" if n == 0 else ""))
        if n == 0 and rows:
            shown += ["", _grid(head, rows), ""]
    return shown


Row = tuple[list[str], str]
"""Cells, and the tone of the last but one."""


def _table(document: Answer) -> tuple[list[str], list[Row], set[str]]:
    """Head and rows of the table, and the sentences that say the same."""
    if isinstance(document, DiagnoseDocument):
        named = document.verdict == "named"
        return _before_and_after(document) if named else ([], [], set())
    if document.verdict == "refused":
        return [], [], set()
    if isinstance(document, CompareDocument):
        head = ["", "change", "95 % interval", "", "P(changed)"]
        said = {change_sentence(name, change) for name, change in document.changes.items()}
        return head, terminal_rows(document), said
    parameters = {name: document.parameters[name] for name in answers(document.parameters)}
    if isinstance(document, TrackDocument) and is_inconsistent(document):
        # Its intervals would be wrong.
        head = ["parameter", "last", "nominal"]
        rows = [
            ([_name(n), estimate_text(p, p.unit), number(p.nominal)], "")
            for n, p in parameters.items()
        ]
        return head, rows, {last_state(n, p) for n, p in parameters.items()}
    reliable = document.verdict == "ok"
    rows = [_row(name, p, reliable=reliable) for name, p in parameters.items()]
    said = {parameter_sentence(n, p) for n, p in parameters.items()}
    return (
        ["parameter", "mean", "95 % interval", "nominal", "", "P(below)"],
        rows,
        said | {f"Not to be relied on: {sentence}" for sentence in said},
    )


def _name(name: str) -> str:
    return capitalized(short_label(name))


def _row(name: str, p: Parameter, *, reliable: bool) -> Row:
    compared = compare_parameter(name, p)
    cells = [_name(name), estimate_text(p, p.unit), interval(p, 1), number(p.nominal)]
    if not reliable:
        return [*cells, "not to be relied on", ""], ""
    if compared is None:
        return [*cells, "", ""], ""
    verdict = f"{MARKS[compared.sense]} {compared.short}"
    return [*cells, verdict, probability(compared.p_below)], TONES[compared.sense]


def _before_and_after(document: DiagnoseDocument) -> tuple[list[str], list[Row], set[str]]:
    names = [name for name in asked(document) if name in document.parameters_before]
    rows = []
    for name in names:
        before: Quantity = document.parameters_before[name]
        after = document.parameters_after[name]
        rows.append(
            (
                [
                    _name(name), plus_minus(before), estimate_text(after, after.unit),
                    interval(after), number(after.nominal),
                ],
                "",
            )
        )  # fmt: skip
    head = ["parameter", "linear car", "with the effects", "95 % interval", "nominal"]
    return head, rows, {shift_sentence(name, document) for name in names}


def _grid(head: Sequence[str], rows: Sequence[Row]) -> RenderableType:
    from rich.table import Table
    from rich.text import Text

    # A column without content is left out, as that of the verdict where there is none.
    used = [n for n in range(len(head)) if any(cells[n] for cells, _ in rows)]
    grid = Table(box=None, padding=(0, 1), pad_edge=False, collapse_padding=True)
    for n in used:
        title = head[n]
        left = n == 0 or not title
        grid.add_column(
            Text(title, "dim"), justify="left" if left else "right", no_wrap=True, overflow="fold"
        )
    for cells, tone in rows:
        texts = [Text(cell) for cell in cells]
        if tone:
            texts[-2].stylize(_STYLES.get(tone, "bold"))
        grid.add_row(*(texts[n] for n in used))
    return grid


def _paragraph(line: str, width: int, style: str) -> RenderableType:
    """Wrap a sentence at words, with the lines after the first indented."""
    from rich.text import Text

    kept: Mapping[str, Any] = {"break_long_words": False, "break_on_hyphens": False}
    text = Text(textwrap.fill(line, width, subsequent_indent=_INDENT, **kept), style)
    prefix = line.partition(":")[0]
    if prefix in _PREFIXES:
        text.stylize(_PREFIXES[prefix], 0, len(prefix) + 1)
    return text
