"""The header of a table in text: names, units and sources of the columns, and what is above."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from bayes_asv.io.formats.cells import BLANKS, COMMENT, is_number, split, uncommented
from bayes_asv.io.formats.stamps import time_factor
from bayes_asv.io.formats.unit_words import is_unit, split_unit

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from bayes_asv.io.formats.cells import Layout

__all__ = ["Header", "column_name", "completed", "find_header", "metadata"]

_HEADER_ROWS: Final = 4
_SPARE: Final = 2  # names of columns whose cells are missing in all rows, or a shifted row
_STAMP_NAME: Final = re.compile(r"time|timestamp|zeit|temps", re.IGNORECASE)
_KEY: Final = re.compile(r"[^:]{1,40}:\s")


@dataclass(frozen=True, slots=True)
class Header:
    """Names, units and sources of the columns, where a format writes them in a way of its own."""

    names: tuple[str, ...]
    units: tuple[str, ...] = ()
    sources: tuple[str, ...] = ()


def find_header(
    preamble: Sequence[str], layout: Layout, last_is_empty: bool
) -> tuple[Header | None, int, str]:
    """Find names, units and sources in the lines above the data.

    Parameters
    ----------
    preamble : sequence of str
        All lines above the data.
    layout : Layout
        Of the data.
    last_is_empty : bool
        Whether the last column has no cell that is filled, and so may have no name.

    Returns
    -------
    tuple of (Header or None, int, str)
        The header, the number of lines above it, and a warning or nothing.
    """
    width = layout.width
    rows: list[tuple[int, list[str]]] = []
    for index in range(len(preamble) - 1, -1, -1):
        line = preamble[index]
        if not line.strip():
            continue
        # A remark names the columns only if nothing else does.
        cells = None if rows and COMMENT.match(line) else _header_cells(line, layout)
        if cells is None or len(rows) == _HEADER_ROWS:
            break
        rows.append((index, cells))
    # Bottom up: the sources, if any, stand between the units and the data.
    place = next((i for i, (_, cells) in enumerate(rows[:2]) if _is_unit_row(cells)), None)
    if place is not None and place + 1 == len(rows):
        place = None
    index, names = rows[0 if place is None else place + 1] if rows else (len(preamble), [])
    if len(names) < width - last_is_empty or (len(names) > width and place is not None):
        note = f"the line above the data does not name {width} columns" if rows else ""
        return None, len(preamble), note
    note = ""
    if len(names) > width:
        note = f"the columns {', '.join(names[width : width + 8])} have no cells"
    if place is None:
        return _header_with_units_in_names(names, width), index, note
    units = _aligned(rows[place][1], names, width)
    if units is None:
        note = "the row of units does not fit the names and is not used"
    sources = rows[0][1] if place == 1 else []
    return Header(tuple(names), tuple(units or ()), tuple(sources)), index, note


def _header_cells(line: str, layout: Layout) -> list[str] | None:
    """Cells of a line that may be a part of the header, or None."""
    width = layout.width
    for separator in dict.fromkeys((layout.separator, ",", ";", "\t")):
        cells = split(uncommented(line), separator)
        while len(cells) > width and not cells[-1]:
            cells.pop()
        if max(width - 1, 1) <= len(cells) <= width + _SPARE and any(cells):
            numbers = sum(is_number(cell, layout.decimal) for cell in cells)
            if 2 * numbers < sum(map(bool, cells)):
                return cells
    return None


def _fitted(cells: Sequence[str], width: int) -> list[str]:
    return [*cells, *[""] * width][:width]


def _is_unit_row(cells: Sequence[str]) -> bool:
    filled = [cell.strip("[]()") for cell in cells if cell]
    return bool(filled) and 2 * sum(map(is_unit, filled)) > len(filled)


def _aligned(units: Sequence[str], names: Sequence[str], width: int) -> list[str] | None:
    """Units below their names, a row that is shifted by one cell put right; None if none fits."""
    time = next((i for i, name in enumerate(names) if _STAMP_NAME.fullmatch(name)), None)
    units = [cell.strip("[]()") for cell in units]
    for moved in (list(units), ["", *units], list(units[1:])):
        if any(moved[width:]):
            continue
        moved = _fitted(moved, width)
        if time is None or not moved[time] or time_factor(moved[time]) is not None:
            return moved
    return None


def _header_with_units_in_names(names: Sequence[str], width: int) -> Header:
    pairs = [split_unit(name) for name in _fitted(names, width)]
    return Header(
        tuple(one.name for one in pairs),
        tuple(one.unit for one in pairs),
        tuple(one.source for one in pairs),
    )


def completed(header: Header, width: int) -> Header:
    """Return a header with a name, a unit and a source for each column."""
    names = _fitted(header.names, width)
    return Header(
        tuple(name or column_name(one) for one, name in enumerate(names)),
        tuple(_fitted(header.units, width)),
        tuple(_fitted(header.sources, width)),
    )


def column_name(column: int) -> str:
    """Return the name of a column that has none."""
    return f"column {column + 1}"


def metadata(lines: Iterable[str], separator: str) -> Iterable[tuple[str, str]]:
    """Pairs such as ``# key = value``, ``key: value`` and ``"key","value"``, several in a line."""
    for line in list(lines)[:1000]:
        text = uncommented(line).strip()
        key, equals, value = text.partition("=")
        if equals and len(key) < 60:
            yield key, value
            continue
        cells = [""] if not text else split(text, separator if separator != BLANKS else ",")
        group: list[str] = []
        for cell in [*cells, ""]:
            if cell:
                group.append(cell)
            elif group:
                if all(_KEY.match(one) for one in group):
                    yield from ((one.partition(":")[0], one.partition(":")[2]) for one in group)
                elif len(group) > 1:
                    yield group[0], " ".join(group[1:])
                elif len(cells) == 1:
                    yield "comment", group[0]
                group = []
