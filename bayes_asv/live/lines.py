"""A recording that comes in as text, piece by piece: complete lines are read, the rest waits.

What the readers of :mod:`bayes_asv.io` take as a file is taken here as a stream: CSV with its
header, or the logger's rows of five integers, with ``# key = value`` lines before them.  A line
that is no row is counted and left out, since a port may lose bytes and a file may not.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import MAX_MAGNITUDE, Recording, nominal_rate, require_half_car
from bayes_asv.io import csv
from bayes_asv.io import logger_text as logger
from bayes_asv.io.text import TextFile

__all__ = ["RESTART_GAP", "LineReader", "Piece"]

Array = NDArray[np.float64]
Row = tuple[float, ...]

RESTART_GAP: Final = 5.0
"""Where the stamps begin again, the new rows stand so many seconds after the old, s."""

_FIRST_ROWS: Final = 20  # rows that tell the rate of a stream with stamps
_MOST_STRANGE: Final = 200  # lines before the first row: then it is told what is wrong with them
_LONGEST_STEP: Final = (
    1.0  # s: a stamp that steps further, or back, has to be borne out by the next
)
_LONGEST_LINE: Final = 10_000  # bytes without an end: whatever this is, it is no row
_MOST_METADATA: Final = 200


class Piece(NamedTuple):
    """Rows that came in together.

    Attributes
    ----------
    time : (n,) array
        Stamps, s, each after the one before, across pieces as well.
    values : (4, n) array
        Readings in the stream's units; NaN where a cell is missing.
    """

    time: Array
    values: Array


class _Layout(NamedTuple):
    """Where time and channels stand in a row."""

    separator: str | None  # None: any white space
    width: int
    time: int | None  # None: rows are counted
    channels: tuple[int, ...]
    seconds: float  # in one unit of the stamps, or from one row to the next
    origin: float  # stamp of time zero, in that unit


class LineReader:
    """Turns bytes into rows.

    Parameters
    ----------
    source : str
        Name of the stream for messages.
    rate : float or None
        Rows a second, Hz, for streams without stamps.

    Attributes
    ----------
    unreadable : int
        Lines that were no row, and rows whose stamp made no sense.
    restarts : int
        How often the stamps began again.
    """

    def __init__(self, source: str, rate: float | None = None) -> None:
        self.unreadable = 0
        self.restarts = 0
        self._source = source
        self._asked_rate = rate
        self._bytes = b""
        self._preamble: list[str] = []
        self._fault: InputError | None = None  # of the last line that looked like a header
        self._layout: _Layout | None = None
        self._pattern: Recording | None = None
        self._counted = 0
        self._early: list[Row] = []  # rows from before the rate was known
        self._rate: float | None = None
        self._last: float | None = None  # newest stamp, as it came
        self._doubtful: Row | None = None
        self._shift = 0.0

    @property
    def rate(self) -> float | None:
        """Rows a second, Hz, as the first stamps run or as was given; None before them."""
        return self._rate

    @property
    def units(self) -> tuple[str, ...] | None:
        """Unit of each channel; None before a row has come."""
        return None if self._pattern is None else self._pattern.units

    @property
    def metadata(self) -> tuple[tuple[str, str], ...]:
        """Keys and values that stood before the first row."""
        return () if self._pattern is None else self._pattern.metadata

    def feed(self, data: bytes) -> Piece:
        """Take the next bytes.

        Parameters
        ----------
        data : bytes
            As they came; a line may be cut anywhere.

        Returns
        -------
        Piece
            Rows of the lines that are complete; none before the rate is known.

        Raises
        ------
        InputError
            If the stream cannot be a recording: no rate, a header that lacks a channel, or nothing
            but strange lines.
        """
        *lines, self._bytes = (self._bytes + data).split(b"\n")
        if len(self._bytes) > _LONGEST_LINE:
            self._bytes = b""
            self.unreadable += 1
        rows = [row for line in lines for row in self._line(line)]
        if self._rate is None:
            self._early += rows
            rows = self._when_known()
        table = np.array(rows, dtype=float).reshape(-1, 1 + len(CHANNELS))
        return Piece(table[:, 0], table[:, 1:].T)

    def finish(self) -> Piece:
        """Take the last line, which need not have an end."""
        return self.feed(b"\n" if self._bytes else b"")

    def _line(self, line: bytes) -> list[Row]:
        """Read one line: usually one row, two when it bears out a doubtful one, else none."""
        text = line.decode("utf-8", "replace").strip("\r\0 ")
        if not text.strip():
            return []
        if text.lstrip().startswith("#"):
            if self._layout is None and len(self._preamble) < _MOST_METADATA:
                self._preamble.append(text)
            return []
        if self._layout is None and not self._begin(text):
            return []
        row = None if self._layout is None else _row(text, self._layout)
        if row is None:
            self.unreadable += 1
            return []
        if self._layout is not None and self._layout.time is None:
            row = (self._counted * self._layout.seconds, *row[1:])
            self._counted += 1
        return self._in_order(row)

    def _begin(self, text: str) -> bool:
        """Take a line as the first; whether it is a row rather than a header."""
        if logger.is_logger_text(TextFile(text, self._source, "")):
            self._probe(1 + len(CHANNELS), " ", None)
            return True
        self.unreadable += 1  # perhaps the rest of a line that was under way when we came
        if any(ch.isalpha() for ch in text):
            separator = next((s for s in ";\t" if text.count(s) >= len(CHANNELS) - 1), ",")
            try:
                self._probe(len(text.split(separator)), separator, text)
            except InputError as fault:  # what a board says when it starts is no header either
                self._fault = fault
            else:
                self.unreadable -= 1
                return False
        if self.unreadable >= _MOST_STRANGE:
            raise self._fault or InputError(
                self._source, "sends no rows of a recording", "check the logger and --baud"
            )
        return False

    def _probe(self, width: int, separator: str, header: str | None) -> None:
        """Ask the file reader which column is what.

        It is handed two rows whose cells are their own places, so what it returns as a channel
        says where the channel stands; there is then one reader of headers, not two.
        """
        rows = [
            separator.join(str(start + place) for place in range(width)) for start in (1, 1 + width)
        ]
        lines = [*self._preamble, *([] if header is None else [header]), *rows]
        reader = logger.read if header is None else csv.read
        found = reader(TextFile("\n".join(lines), self._source, ""), self._asked_rate)
        require_half_car(found)
        start, step = float(found.time[0]), float(found.time[1] - found.time[0])
        if header is None:  # the index counts from one
            separates, place, seconds, origin = None, 0, step / width, 1.0
        elif start > 0.0:
            separates, seconds, origin = separator, step / width, 0.0
            place = round(start / seconds) - 1
        else:
            separates, place, seconds, origin = separator, None, step, 0.0
        if header is None or place is None:
            self._rate = 1.0 / seconds
        self._pattern = found
        channels = tuple(int(v) - 1 for v in found.values[:, 0])
        self._layout = _Layout(separates, width, place, channels, seconds, origin)

    def _in_order(self, row: Row) -> list[Row]:
        """Return the row, where its stamp follows; a strange stamp waits for the next to agree."""
        before, doubtful = self._last, self._doubtful
        if before is None or 0.0 < row[0] - before <= _LONGEST_STEP:
            self.unreadable += doubtful is not None
            self._doubtful = None
            good = [row]
        elif doubtful is not None and 0.0 < row[0] - doubtful[0] <= _LONGEST_STEP:
            if doubtful[0] <= before:
                self.restarts += 1
                self._shift += before + RESTART_GAP - doubtful[0]
            self._doubtful = None
            good = [doubtful, row]
        else:
            self.unreadable += doubtful is not None
            self._doubtful = row
            return []
        self._last = row[0]
        return [(r[0] + self._shift, *r[1:]) for r in good]

    def _when_known(self) -> list[Row]:
        """Return the early rows once they tell the rate."""
        if self._rate is None:
            if len(self._early) < _FIRST_ROWS or self._pattern is None:
                return []
            time = np.array([row[0] for row in self._early])
            self._rate = nominal_rate(
                Recording(time, np.zeros((len(CHANNELS), len(time))), self._pattern.units)
            )
        early, self._early = self._early, []
        return early


def _row(text: str, layout: _Layout) -> Row | None:
    """Time in s and the four readings of a line, or None where it is no row."""
    cells = text.split(layout.separator)
    while len(cells) > layout.width and not cells[-1].strip():
        cells.pop()  # trailing separators
    if len(cells) != layout.width:
        return None
    decimal_comma = layout.separator == ";"
    counted = layout.separator is None
    numbers = []
    for place in ((0,) if layout.time is None else (layout.time,)) + layout.channels:
        cell = cells[place].strip().strip('"')
        if decimal_comma:
            cell = cell.replace(",", ".")
        try:
            if not cell.isascii() or "_" in cell:
                return None
            number = float(int(cell)) if counted else float(cell or "nan")
        except ValueError:
            return None
        if abs(number) > MAX_MAGNITUDE:
            return None
        numbers.append(number)
    time = 0.0 if layout.time is None else (numbers[0] - layout.origin) * layout.seconds
    return (time, *numbers[1:]) if math.isfinite(time) else None
