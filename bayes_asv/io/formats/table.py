"""Tables in text: finds the separator, the header, the row of units and the data by their content.

All formats of comma-separated values share this reader; what is special about one of them is in its
own file.  Nothing depends on the number of a line.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.log import check_size
from bayes_asv.io.formats.cells import (
    BLANKS,
    NUMBER,
    Layout,
    has_cells,
    is_missing,
    is_number,
    is_reading,
    split,
)
from bayes_asv.io.formats.header import Header, completed, find_header, metadata
from bayes_asv.io.formats.stamps import clock_seconds, is_clock, past_midnight

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

__all__ = ["Table", "decode_text", "first_cells", "first_line", "read_table"]

_CHUNK: Final = 20_000  # rows parsed at once, which bounds the memory of their cells
_SAMPLE: Final = 200
_SHORT: Final = 8  # lines; a shorter file is sampled as a whole
_FEWEST: Final = 1 / 3  # of the cells are numbers; a row of which fewer are is a sentence
_FEW: Final = 0.01
_MAX_LINE: Final = 1_000_000
_MAX_FIRST_LINE: Final = 4000
# Ties go to the earlier dialect: a comma between digits is a decimal comma only where something
# else separates the cells.
_DIALECTS: Final = (
    (";", "."), (";", ","), ("\t", "."), ("\t", ","), (",", "."), (BLANKS, "."), (BLANKS, ","),
)  # fmt: skip


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
    clock : list of W bool
        Whether the cells are times of day.
    metadata : list of (str, str)
        Pairs of the lines above the header.
    warnings : list of str
        What was left out.
    """

    header: Header
    named: bool
    columns: list[NDArray[np.float64]]
    wrong: list[int]
    clock: list[bool]
    metadata: list[tuple[str, str]]
    warnings: list[str]


def decode_text(data: bytes, source: str) -> str:
    """Decode text in UTF-8, in UTF-16 with a byte order mark, or else in Windows code page 1252.

    Where the power went, loggers leave zeros or ones behind the last line; they are left out.
    Zeros within the text, from a damaged memory card, make their cells unreadable.

    Raises
    ------
    InputError
        If it is no text: more than 1 % of it are zeros.
    """
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        text = data.decode("utf-16", errors="replace")
    else:
        data = data.rstrip(b"\0\xff\x1a")
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("cp1252", errors="replace")
    if text.count("\0") > _FEW * len(text):
        raise InputError(source, "is not a text file", "export it as text, CSV UTF-8")
    return text.replace("\0", "\N{REPLACEMENT CHARACTER}")


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
    layout, first = _layout(lines, source, ragged)
    check_size(layout.width, layout.width, source)
    check_size((len(lines) - first) * layout.width, 0, source)
    body = _Body(layout, source)
    for start in range(first, len(lines), _CHUNK):
        body.parse(lines[start : start + _CHUNK], start)
    columns = body.finish()
    preamble = lines[:first]
    if header is None:
        header, used, note = find_header(preamble, layout, body.last_is_empty)
        body.warnings += [note] if note else []
    else:
        used = len(preamble)
    return Table(
        completed(header or Header(()), layout.width),
        header is not None,
        columns,
        body.wrong,
        body.clock or [False] * layout.width,
        list(metadata(preamble[:used], layout.separator)),
        body.warnings,
    )


def _layout(lines: Sequence[str], source: str, ragged: bool) -> tuple[Layout, int]:
    """Find out how the rows are written, and the first line of data."""
    if max(map(len, lines)) > _MAX_LINE:
        raise InputError(
            source, f"has a line of more than {_MAX_LINE} characters", "check the file"
        )
    filled = [index for index, line in enumerate(lines) if has_cells(line)]
    # Data are at the end; the last line may be cut.
    later = filled[len(filled) // 2 :] if len(filled) > _SHORT else filled
    sample = later[: max(1, len(later) - 1) : max(1, len(later) // _SAMPLE)]
    best, best_score = None, 0.0
    for separator, decimal in _DIALECTS:
        rows = [split(lines[index], separator) for index in sample]
        width, score = _score(rows, decimal, ragged)
        if score > best_score:
            numeric = _numeric([cells for cells in rows if len(cells) == width], decimal)
            if sum(numeric) >= _FEWEST * width:
                best, best_score = Layout(separator, decimal, numeric, ragged), score
    for place, index in enumerate(filled):
        if best is not None and best.is_data(lines[index]):
            ahead = filled[place + 1 : place + 5]
            if sum(best.is_data(lines[one]) for one in ahead) >= (len(ahead) + 1) // 2:
                return best, index
    raise InputError(source, "has no table of numbers", "export it again as CSV")


def _score(rows: Sequence[list[str]], decimal: str, ragged: bool) -> tuple[int, float]:
    """Return the usual number of cells, and how many numbers the rows of that length hold."""
    counted: dict[int, float] = {}
    for cells in rows:
        numbers = sum(is_reading(cell, decimal) for cell in cells)
        if numbers:
            filled = sum(not is_missing(cell) for cell in cells)
            width = len(cells)
            counted[width] = counted.get(width, 0.0) + numbers * numbers / filled
    if not counted:
        return 0, 0.0
    width = max(counted) if ragged else max(counted, key=lambda one: counted[one])
    return width, sum(counted.values()) if ragged else counted[width]


def _numeric(rows: Sequence[list[str]], decimal: str) -> tuple[bool, ...]:
    """Whether nine of ten cells of a column are numbers, or else the most in any column are."""
    shares = []
    for column in zip(*rows, strict=True):
        filled = [cell for cell in column if not is_missing(cell)]
        shares.append(sum(is_reading(cell, decimal) for cell in filled) / max(1, len(filled)))
    return tuple(share >= min(0.9, max(shares)) for share in shares)


class _Body:
    """Parses the rows of data, some at a time."""

    def __init__(self, layout: Layout, source: str) -> None:
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
            separator != BLANKS
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
            if not has_cells(line):
                continue
            cells = self.layout.cells(line)
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
        return any(is_number(cell, decimal) for cell in cells) or all(map(is_missing, cells))

    def _numbers(self, cells: Sequence[str], column: int) -> NDArray[np.float64]:
        if self.clock and self.clock[column]:
            return np.fromiter(map(clock_seconds, cells), np.float64, len(cells))
        if self.layout.decimal == ",":
            cells = [cell.replace(",", ".") for cell in cells]
        result = self._converted(cells, column)
        return np.where(np.isfinite(result), result, np.nan)  # 1e999 is no reading

    def _converted(self, cells: Sequence[str], column: int) -> NDArray[np.float64]:
        try:
            joined = "".join(cells)
            if joined.isascii() and "_" not in joined:
                full = [cell or "nan" for cell in cells]
                return np.fromiter(map(float, full), np.float64, len(full))
        except ValueError:
            pass
        result = np.full(len(cells), np.nan)
        number = NUMBER["."]
        for row, cell in enumerate(cells):
            stripped = cell.strip()
            if number.fullmatch(stripped):
                result[row] = float(stripped)
            elif not is_missing(stripped):
                self.wrong[column] += 1
        return result


def _is_clock_column(cells: Sequence[str]) -> bool:
    filled = [cell for cell in cells if not is_missing(cell)]
    return bool(filled) and sum(map(is_clock, filled)) >= 0.9 * len(filled)
