"""Cells of a line of text, and which of them are numbers."""

from __future__ import annotations

import csv
import re
from typing import Final, NamedTuple

from bayes_asv.io.formats.stamps import is_clock

__all__ = [
    "BLANKS", "COMMENT", "NUMBER", "Layout", "has_cells", "is_missing", "is_number", "is_reading",
    "split", "uncommented",
]  # fmt: skip

BLANKS: Final = " "
"""The separator that stands for any run of blanks."""
NUMBER: Final = {
    ".": re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII),
    ",": re.compile(r"[+-]?(?:\d+,?\d*|,\d+)(?:[eE][+-]?\d+)?", re.ASCII),
}
"""A number, by the decimal sign."""
COMMENT: Final = re.compile(r"\s*(?:#|//|%|;(?=\s*[A-Za-z]))+\s?")
"""What marks a line as a remark."""

_MISSING: Final = frozenset(
    ["", "nan", "-nan", "+nan", "nan(ind)", "-nan(ind)", "inf", "-inf", "+inf", "infinity", "null",
     "(null)", "na", "n/a", "none", "-", "--", "---", "ovf", "#n/a"]
)  # fmt: skip


class Layout(NamedTuple):
    """How the rows of a table are written.

    Attributes
    ----------
    separator, decimal : str
        Between the cells, and within numbers.
    numeric : tuple of bool
        Whether the cells of a column are numbers or times of day.
    ragged : bool
        Whether rows may lack cells at their end.
    """

    separator: str
    decimal: str
    numeric: tuple[bool, ...]
    ragged: bool = False

    @property
    def width(self) -> int:
        """Number of cells."""
        return len(self.numeric)

    def cells(self, line: str) -> list[str]:
        """Return the cells of a row."""
        return split(line, self.separator)

    def is_data(self, line: str) -> bool:
        """Whether a line has a number wherever the rows of the table have one."""
        cells = self.cells(line)
        if not (len(cells) == self.width or (self.ragged and 1 < len(cells) < self.width)):
            return False
        readings = [
            None if is_missing(cell) else is_reading(cell, self.decimal)
            for cell, numeric in zip(cells, self.numeric, strict=False)
            if numeric
        ]
        return True in readings and False not in readings


def has_cells(line: str) -> bool:
    """Whether a line is neither blank nor a remark."""
    stripped = line.strip()
    return bool(stripped) and COMMENT.match(stripped) is None


def uncommented(line: str) -> str:
    """Return a line without the mark of a remark."""
    match = COMMENT.match(line)
    return line[match.end() :] if match else line


def split(line: str, separator: str) -> list[str]:
    """Split a line into its cells, without quotes and blanks around them."""
    if '"' not in line:
        if separator == BLANKS:
            return line.split()
        return [cell.strip() for cell in line.split(separator)]
    text = line.strip() if separator == BLANKS else line
    try:
        cells = next(csv.reader([text], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:
        cells = text.replace('"', "").split(separator)
    return [cell.strip() for cell in cells if separator != BLANKS or cell]


def is_number(cell: str, decimal: str) -> bool:
    """Whether a cell is a number with this decimal sign."""
    return NUMBER[decimal].fullmatch(cell) is not None


def is_reading(cell: str, decimal: str) -> bool:
    """Whether a cell is a number or a time of day."""
    return is_number(cell, decimal) or is_clock(cell)


def is_missing(cell: str) -> bool:
    """Whether a cell is empty or a word for a missing reading."""
    return cell.strip().lower() in _MISSING
