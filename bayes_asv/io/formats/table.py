"""Tables in text: finds the separator, the header, the row of units and the data by their content.

All formats of comma-separated values share this reader; what is special about one of them is in its
own file.  Nothing depends on the number of a line.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.log import check_size, utc
from bayes_asv.domain.recording import check_rate, parse_rate
from bayes_asv.io.formats.format import listed
from bayes_asv.io.formats.stamps import (
    clock_seconds,
    is_clock,
    past_midnight,
    repair,
    time_factor,
)
from bayes_asv.io.formats.unit_words import is_unit, split_unit

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import LogBuilder

__all__ = [
    "Header", "Table", "add_table", "decode_text", "first_cells", "first_line", "log_of_table",
    "read_table",
]  # fmt: skip

_CHUNK: Final = 20_000  # rows parsed at once, which bounds the memory of their cells
_SAMPLE: Final = 200
_FEW: Final = 0.01
_HEADER_ROWS: Final = 4
_MAX_LINE: Final = 1_000_000
_MAX_FIRST_LINE: Final = 4000
_BLANKS: Final = " "
# Ties go to the earlier dialect: a comma between digits is a decimal comma only where something
# else separates the cells.
_DIALECTS: Final = (
    (";", "."), (";", ","), ("\t", "."), ("\t", ","), (",", "."), (_BLANKS, "."), (_BLANKS, ","),
)  # fmt: skip
_NUMBER: Final = {
    ".": re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII),
    ",": re.compile(r"[+-]?(?:\d+,?\d*|,\d+)(?:[eE][+-]?\d+)?", re.ASCII),
}
_MISSING: Final = frozenset(
    ["", "nan", "-nan", "+nan", "nan(ind)", "-nan(ind)", "inf", "-inf", "+inf", "infinity", "null",
     "(null)", "na", "n/a", "none", "-", "--", "---", "ovf", "#n/a"]
)  # fmt: skip
_COMMENT: Final = re.compile(r"\s*(?:#|//|%|;(?=\s*[A-Za-z]))+\s?")
_TIME_NAME: Final = re.compile(
    r"time|zeit|temps|tiempo|tempo|stamp|milli|micro|elapsed|second|interval|uptime|clock|utc"
    r"|^t$|^ts$|^s$|^ms$|^us$|^µs$|^sec$|^x_value$",
    re.IGNORECASE,
)
_STAMP_NAME: Final = re.compile(r"time|timestamp|zeit|temps", re.IGNORECASE)
_NOT_TIME: Final = re.compile(
    r"lap|best|diff|delta|split|predict|sector|temper|temporal", re.IGNORECASE
)
_KEY: Final = re.compile(r"[^:]{1,40}:\s")
_INDEX_NAME: Final = re.compile(r"^(index|count|counter|sample|samples|n|nr|no|id|row|#)\.?$", re.I)


@dataclass(frozen=True, slots=True)
class Header:
    """Names, units and sources of the columns, where a format writes them in a way of its own."""

    names: tuple[str, ...]
    units: tuple[str, ...] = ()
    sources: tuple[str, ...] = ()


class Table(NamedTuple):
    """A table of W columns and N rows.

    Attributes
    ----------
    header : Header
        W names, units and sources.
    named : bool
        Whether the file has names of columns.
    columns : list of W arrays of float, shape (N,)
        NaN where a cell is missing or no number; times of day in s.
    wrong : list of W int
        Number of cells that are text.
    metadata : list of (str, str)
        Pairs of the lines above the header.
    warnings : list of str
        What was left out.
    """

    header: Header
    named: bool
    columns: list[NDArray[np.float64]]
    wrong: list[int]
    metadata: list[tuple[str, str]]
    warnings: list[str]


def decode_text(data: bytes, source: str) -> str:
    """Decode text in UTF-8, in UTF-16 with a byte order mark, or else in Windows code page 1252.

    Raises
    ------
    InputError
        If it is no text.
    """
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        text = data.decode("utf-16", errors="replace")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("cp1252", errors="replace")
    if "\0" in text:
        raise InputError(source, "is not a text file", "export it as text, CSV UTF-8")
    return text


def first_line(head: bytes) -> str:
    """Return the first line of a text that is not blank."""
    text = head.decode("utf-8-sig", errors="replace").replace("\0", "").lstrip()
    return text.split("\n", 1)[0][:_MAX_FIRST_LINE].strip()


def first_cells(head: bytes) -> list[str]:
    """Return the cells of the first line in lower case."""
    return [cell.strip(' "').lower() for cell in re.split("[,;\t]", first_line(head)[:1000])]


def read_table(text: str, source: str, header: Header | None = None, ragged: bool = False) -> Table:
    """Read the one table of a text.

    Parameters
    ----------
    text : str
        The whole file.
    source : str
        Its name, for messages.
    header : Header, optional
        Given by formats that write it in a way of their own; otherwise it is found.
    ragged : bool
        Whether rows may lack cells at their end.

    Returns
    -------
    Table
        At least one column and two rows.

    Raises
    ------
    InputError
        If there is no table, or too many of its rows are broken.
    """
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    lines = text.split("\n")
    layout = _layout(lines, source, ragged)
    check_size(layout.width, layout.width, source)
    check_size((len(lines) - layout.first) * layout.width, 0, source)
    body = _Body(layout, source)
    for start in range(layout.first, len(lines), _CHUNK):
        body.parse(lines[start : start + _CHUNK], start)
    columns = body.finish()
    preamble = lines[: layout.first]
    found, used = (header, len(preamble)) if header else _header(preamble, layout, body)
    named = found is not None
    if found is None:
        found = Header(())
    return Table(
        _completed(found, layout.width),
        named,
        columns,
        body.wrong,
        list(_metadata(preamble[:used], layout.separator)),
        body.warnings,
    )


def add_table(
    builder: LogBuilder,
    table: Table,
    time: str | None = None,
    factor: float | None = None,
    rate: float | None = None,
    group: str = "",
) -> None:
    """Add the columns of a table to a log.

    Parameters
    ----------
    builder : LogBuilder
        Its file may give a rate, which a file with stamps is only checked against.
    table : Table
        As read.
    time : str, optional
        Name of the column of stamps; otherwise it is found by name and unit, or in a table without
        names as the one column that increases.
    factor : float, optional
        Unit of the stamps, s; otherwise as :mod:`bayes_asv.io.formats.stamps` says.
    rate : float, optional
        Sampling rate that the file declares, Hz, for a table without stamps.
    group : str
        Source of the channels that state none.

    Raises
    ------
    InputError
        If there is no time and no rate, or the stamps cannot be repaired.
    """
    file, names = builder.file, table.header.names
    builder.warnings += table.warnings
    builder.metadata += table.metadata
    rows = table.columns[0].size
    at = names.index(time) if time in names else _time_column(table)
    if at is not None:
        unit = table.header.units[at]
        if factor is None:
            factor = time_factor(unit) or time_factor(names[at], in_name=True)
        stamps = table.columns[at]
        repaired = repair(stamps, factor, f"{file.source}: {names[at]}", _same_as_before(table, at))
        stamp, kept, notes = repaired.time, repaired.rows, repaired.warnings
        builder.warnings += notes
        start = utc(float(stamps[kept[0]]) * (factor or 1.0)) if stamps[kept[0]] > 1e9 else None
        if start:
            builder.metadata.append(("start", start))
        note = ""
        _check_rate(builder, stamp, file.rate)
    else:
        rate = _rate(builder, table, rate)
        at = _index_column(table)
        count = np.arange(rows) if at is None else table.columns[at] - table.columns[at][0]
        stamp, kept = count / rate, np.arange(rows)
        note = f"time made from a rate of {rate:g} Hz"
    stamp.flags.writeable = False
    whole = kept.size == rows
    header = table.header
    text: list[str] = []
    partly: list[str] = []
    for index, column in enumerate(table.columns):
        empty = np.isnan(column).all()
        if index == at or (empty and names[index] == _name(index)):
            continue
        if table.wrong[index]:
            (text if empty else partly).append(names[index])
        if not (empty and table.wrong[index]):
            values = column if whole else column[kept]
            source = header.sources[index] or group
            builder.add(names[index], header.units[index], stamp, values, source, note)
    if text:
        builder.warnings.append(f"columns of text were left out: {listed(text)}")
    if partly:
        builder.warnings.append(f"cells that are no numbers were left out of {listed(partly)}")


def log_of_table(builder: LogBuilder, table: Table, **options: float | str | None) -> Log:
    """Return the log of one table; the options are those of `add_table`."""
    add_table(builder, table, **options)  # type: ignore[arg-type]
    return builder.build()


# Layout


class _Layout(NamedTuple):
    separator: str
    decimal: str
    width: int
    first: int  # index of the first line of data
    ragged: bool

    def split(self, line: str) -> list[str]:
        return _split(line, self.separator)

    def is_data(self, line: str) -> bool:
        """Whether at least half of the cells, and one, are numbers."""
        cells = self.split(line)
        if not (len(cells) == self.width or (self.ragged and 1 < len(cells) < self.width)):
            return False
        numbers = sum(_is_number(cell, self.decimal) for cell in cells)
        return numbers > 0 and 2 * numbers >= sum(not _is_missing(cell) for cell in cells)


def _layout(lines: Sequence[str], source: str, ragged: bool) -> _Layout:
    if max(map(len, lines)) > _MAX_LINE:
        raise InputError(
            source, f"has a line of more than {_MAX_LINE} characters", "check the file"
        )
    filled = [index for index, line in enumerate(lines) if _has_cells(line)]
    if len(filled) < 2:
        raise InputError(source, "has no table of numbers", "export it again")
    # Data are at the end; the last line may be cut.  A short file is sampled as a whole.
    later = filled[len(filled) // 2 :] if len(filled) > 2 * _SAMPLE else filled
    sample = later[: max(1, len(later) - 1) : max(1, len(later) // _SAMPLE)]
    best, best_score = None, 0.0
    for separator, decimal in _DIALECTS:
        width, score = _score(
            [_split(lines[index], separator) for index in sample], decimal, ragged
        )
        if score > best_score:
            best, best_score = _Layout(separator, decimal, width, 0, ragged), score
    if best is None:
        raise InputError(source, "has no table of numbers", "export it again as CSV")
    for place, index in enumerate(filled):
        if best.is_data(lines[index]):
            ahead = filled[place + 1 : place + 5]
            if sum(best.is_data(lines[one]) for one in ahead) >= (len(ahead) + 1) // 2:
                return best._replace(first=index)
    raise InputError(source, "has no table of numbers", "export it again as CSV")


def _score(rows: Sequence[list[str]], decimal: str, ragged: bool) -> tuple[int, float]:
    """Return the usual number of cells, and how many numbers the rows of that length hold."""
    counted: dict[int, float] = {}
    for cells in rows:
        numbers = sum(_is_number(cell, decimal) for cell in cells)
        if numbers:
            filled = sum(not _is_missing(cell) for cell in cells)
            width = len(cells)
            counted[width] = counted.get(width, 0.0) + numbers * numbers / filled
    if not counted:
        return 0, 0.0
    width = max(counted) if ragged else max(counted, key=lambda one: counted[one])
    return width, sum(counted.values()) if ragged else counted[width]


def _has_cells(line: str) -> bool:
    stripped = line.strip()
    return bool(stripped) and _COMMENT.match(stripped) is None


def _uncommented(line: str) -> str:
    match = _COMMENT.match(line)
    return line[match.end() :] if match else line


def _split(line: str, separator: str) -> list[str]:
    if '"' in line:
        try:
            cells = next(
                csv.reader(
                    [line.strip() if separator == _BLANKS else line],
                    delimiter=separator, skipinitialspace=True,
                ),
                [],
            )  # fmt: skip
        except csv.Error:
            cells = line.replace('"', "").split(separator)
        return [cell.strip() for cell in cells if separator != _BLANKS or cell]
    return (
        line.split() if separator == _BLANKS else [cell.strip() for cell in line.split(separator)]
    )


def _is_number(cell: str, decimal: str) -> bool:
    return _NUMBER[decimal].fullmatch(cell) is not None


def _is_missing(cell: str) -> bool:
    return cell.strip().lower() in _MISSING


# Data


class _Body:
    """Parses the rows of data, some at a time."""

    def __init__(self, layout: _Layout, source: str) -> None:
        self.layout = layout
        self.source = source
        self.warnings: list[str] = []
        self.pieces: list[list[NDArray[np.float64]]] = [[] for _ in range(layout.width)]
        self.wrong = [0] * layout.width
        self.clock: list[bool] | None = None
        self.broken: list[int] = []  # line numbers
        self.rows = 0
        self.last_is_empty = False

    def parse(self, lines: Sequence[str], start: int) -> None:
        layout = self.layout
        separator, width = layout.separator, layout.width
        filled = [line for line in lines if line and not line.isspace()]
        flat: Sequence[str]
        if (
            separator != _BLANKS
            and all(line.count(separator) == width - 1 for line in filled)
            and not any('"' in line or "#" in line for line in filled)
        ):
            flat = separator.join(filled).split(separator) if filled else []
        else:
            flat = self._cells(lines, start)
        rows = len(flat) // width
        if not rows:
            return
        self.rows += rows
        if self.clock is None:
            self.clock = [_is_clock_column(flat[one : 20 * width : width]) for one in range(width)]
        for one in range(width):
            self.pieces[one].append(self._numbers(flat[one::width], one))

    def finish(self) -> list[NDArray[np.float64]]:
        """Return the columns, and note the rows that were left out."""
        broken = self.broken
        if len(broken) > max(3, _FEW * (self.rows + len(broken))):
            raise InputError(
                f"{self.source}:{broken[0]}",
                f"does not have {self.layout.width} cells as the other rows do, like "
                f"{len(broken)} of {self.rows + len(broken)} rows",
                "export it again, or delete what is not a row of data",
            )
        if self.rows < 2:
            raise InputError(
                self.source, f"has {self.rows} rows of data", "a log needs at least two"
            )
        if broken:
            self.warnings.append(
                f"{len(broken)} lines that are not a row of {self.layout.width} cells "
                f"were left out, the first is line {broken[0]}"
            )
        columns = [np.concatenate(pieces) for pieces in self.pieces]
        self.pieces.clear()
        self.last_is_empty = bool(np.isnan(columns[-1]).all() and not self.wrong[-1])
        for one, is_clock_column in enumerate(self.clock or ()):
            if is_clock_column:
                columns[one] = past_midnight(columns[one])
        return columns

    def _cells(self, lines: Sequence[str], start: int) -> list[str]:
        """Cells of the rows that have the right number of them."""
        width, ragged = self.layout.width, self.layout.ragged
        flat: list[str] = []
        for number, line in enumerate(lines, start + 1):
            if not _has_cells(line):
                continue
            cells = self.layout.split(line)
            while len(cells) > width and not cells[-1]:
                cells.pop()
            if ragged and 1 < len(cells) < width:
                cells += [""] * (width - len(cells))
            if len(cells) == width and self._has_number(cells):
                flat += cells
            else:
                self.broken.append(number)
        return flat

    def _has_number(self, cells: Sequence[str]) -> bool:
        """Whether a row is not text alone, such as a header in the middle of the file."""
        decimal = self.layout.decimal
        return any(_is_number(cell, decimal) for cell in cells) or all(map(_is_missing, cells))

    def _numbers(self, cells: Sequence[str], column: int) -> NDArray[np.float64]:
        if self.clock and self.clock[column]:
            return np.fromiter(map(clock_seconds, cells), np.float64, len(cells))
        if self.layout.decimal == ",":
            cells = [cell.replace(",", ".") for cell in cells]
        try:
            joined = "".join(cells)
            if joined.isascii() and "_" not in joined:
                full = [cell or "nan" for cell in cells]
                return np.fromiter(map(float, full), np.float64, len(full))
        except ValueError:
            pass
        result = np.full(len(cells), np.nan)
        number = _NUMBER["."]
        for row, cell in enumerate(cells):
            stripped = cell.strip()
            if number.fullmatch(stripped):
                result[row] = float(stripped)
            elif not _is_missing(stripped):
                self.wrong[column] += 1
        return result


def _is_clock_column(cells: Sequence[str]) -> bool:
    filled = [cell for cell in cells if not _is_missing(cell)]
    return bool(filled) and sum(map(is_clock, filled)) >= 0.9 * len(filled)


# Header


def _header(preamble: Sequence[str], layout: _Layout, body: _Body) -> tuple[Header | None, int]:
    """Names and units above the data, and the number of lines above the names."""
    width = layout.width
    narrowest = width - 1 if body.last_is_empty else width
    rows: list[tuple[int, list[str]]] = []
    for index in range(len(preamble) - 1, -1, -1):
        if not preamble[index].strip():
            continue
        cells = _header_cells(preamble[index], layout)
        if cells is None or len(rows) == _HEADER_ROWS:
            break
        if rows and _COMMENT.match(preamble[index]):
            break  # a remark names the columns only if nothing else does
        rows.append((index, cells))
    if not rows:
        return None, len(preamble)
    # Bottom up: the sources, if any, stand between the units and the data.
    place = next((i for i, (_, cells) in enumerate(rows[:2]) if _is_unit_row(cells)), None)
    if place is None or place + 1 == len(rows):
        index, names = rows[0]
        if narrowest <= len(names) <= width:
            return _header_with_units_in_names(names, width), index
        return None, len(preamble)
    index, names = rows[place + 1]
    if not narrowest <= len(names) <= width:
        return None, len(preamble)
    units = _aligned(rows[place][1], names, width)
    if units is None:
        body.warnings.append("the row of units does not fit the names and is not used")
    sources = rows[0][1] if place == 1 else []
    return Header(tuple(names), tuple(units or ()), tuple(sources)), index


def _header_cells(line: str, layout: _Layout) -> list[str] | None:
    """Cells of a line that may be a part of the header, or None."""
    width = layout.width
    for separator in (layout.separator, ",", ";", "\t"):
        cells = _split(_uncommented(line), separator)
        while len(cells) > width and not cells[-1]:
            cells.pop()
        if width - 1 <= len(cells) <= width + 1 and any(cells):
            numbers = sum(_is_number(cell, layout.decimal) for cell in cells)
            if 2 * numbers < sum(map(bool, cells)):
                return cells
    return None


def _fitted(cells: Sequence[str], width: int) -> list[str]:
    return [*cells, *[""] * width][:width]


def _is_unit_row(cells: Sequence[str]) -> bool:
    filled = [cell for cell in cells if cell]
    return bool(filled) and 2 * sum(map(is_unit, filled)) > len(filled)


def _aligned(units: Sequence[str], names: Sequence[str], width: int) -> list[str] | None:
    """Units below their names, a row that is shifted by one cell put right; None if none fits."""
    time = next((i for i, name in enumerate(names) if _STAMP_NAME.fullmatch(name)), None)
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


def _completed(header: Header, width: int) -> Header:
    names = _fitted(header.names, width)
    return Header(
        tuple(name or _name(one) for one, name in enumerate(names)),
        tuple(_fitted(header.units, width)),
        tuple(_fitted(header.sources, width)),
    )


def _name(column: int) -> str:
    return f"column {column + 1}"


def _metadata(lines: Iterable[str], separator: str) -> Iterable[tuple[str, str]]:
    """Pairs such as ``# key = value``, ``key: value`` and ``"key","value"``, several in a line."""
    for line in list(lines)[:1000]:
        text = _uncommented(line).strip()
        key, equals, value = text.partition("=")
        if equals and len(key) < 60:
            yield key, value
            continue
        cells = [""] if not text else _split(text, separator if separator != _BLANKS else ",")
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


# Time


def _time_column(table: Table) -> int | None:
    names, units = table.header.names, table.header.units
    if not table.named:
        good = [one for one in range(len(names)) if _increases(table.columns[one], strict=True)]
        return good[0] if good else None
    for index, (name, unit) in enumerate(zip(names, units, strict=True)):
        timely = _TIME_NAME.search(name) and not _NOT_TIME.search(name)
        measured = not unit or time_factor(unit) is not None
        if ((timely and measured) or (time_factor(unit) and index == 0)) and _increases(
            table.columns[index]
        ):
            return index
    return None


def _increases(column: NDArray[np.float64], strict: bool = False) -> bool:
    """Whether a column rises as time does; `strict` asks for no step back and even steps."""
    finite = column[np.isfinite(column)]
    if finite.size < 2 or finite.size < 0.9 * column.size:
        return False
    steps = np.diff(finite)
    if not strict:
        return bool((steps >= 0).mean() >= 0.9 and (steps > 0).any())
    usual = np.median(steps)
    near = (np.abs(steps - usual) <= 0.5 * usual).mean()
    return bool((steps >= 0).all() and usual > 0 and near > 0.5 and not _counts(finite))


def _counts(column: NDArray[np.float64]) -> bool:
    return bool((np.diff(column) == 1).all() and column[0] in (0, 1))


def _index_column(table: Table) -> int | None:
    """Column that counts the samples, so that a row that is missing is a gap in time."""
    for index, (name, column) in enumerate(zip(table.header.names, table.columns, strict=True)):
        counting = _INDEX_NAME.match(name) or not table.named
        if counting and np.isfinite(column).all():
            steps = np.diff(column)
            if (steps >= 1).all() and (steps == np.round(steps)).all() and np.median(steps) == 1:
                return index
    return None


def _same_as_before(table: Table, time: int) -> NDArray[np.bool_]:
    same = np.ones(table.columns[0].size, dtype=bool)
    same[0] = False
    for column in table.columns:
        equal = (column[1:] == column[:-1]) | (np.isnan(column[1:]) & np.isnan(column[:-1]))
        same[1:] &= equal
    return same


def _rate(builder: LogBuilder, table: Table, declared: float | None) -> float:
    """Return the rate of a table without stamps, Hz: the given one or else the declared one."""
    source, given = builder.file.source, builder.file.rate
    if declared is None:
        for key, value in table.metadata:
            if re.fullmatch(r"sampl(e|ing)[ _]?(rate|frequency)", key.strip(), re.IGNORECASE):
                declared = parse_rate(value.strip(), f"{source}: {key.strip()}")
    if given is not None:
        if declared is not None and abs(declared - given) > _FEW * given:
            builder.warnings.append(
                f"the file declares {declared:g} Hz, but the given rate of {given:g} Hz is used"
            )
        return given
    if declared is None:
        raise InputError(source, "has no column of time", "give the sampling rate (--rate 400)")
    check_rate(declared, source)
    return declared


def _check_rate(builder: LogBuilder, time: NDArray[np.float64], given: float | None) -> None:
    if given is None or time.size < 2:
        return
    actual = 1.0 / float(np.median(np.diff(time)))
    if abs(actual - given) > _FEW * given:
        builder.warnings.append(
            f"the given rate is {given:g} Hz, but the time stamps give {actual:.6g} Hz; "
            "the stamps are used"
        )
