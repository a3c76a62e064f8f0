"""Reader of a recording that arrives as text in pieces.

It reads what the readers of :mod:`bayes_asv.io` read from files: CSV with its header, or the
logger's rows of five integers, with ``# key = value`` lines before them.  A line that is not a row
is counted and left out, since a port may lose bytes and a file may not.
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

__all__ = ["RESTART_GAP", "RowBlock", "TextStreamReader"]

Array = NDArray[np.float64]
Row = tuple[float, ...]

RESTART_GAP: Final = 5.0
"""Gap between old and new rows where the stamps start again, s."""

_FIRST_ROWS: Final = 20  # rows from which the rate of a stream with stamps is determined
_MAX_HEADER_LINES: Final = 200  # unreadable lines before the first row until the stream is refused
_MAX_STEP: Final = 1.0  # s: a stamp that steps further, or back, has to be confirmed by the next
_MAX_PAUSE: Final = 3600.0  # s: a clock that jumps further was set
_MAX_LINE: Final = 10_000  # bytes without a line end
_MAX_METADATA: Final = 200  # lines


class RowBlock(NamedTuple):
    """Rows that arrived together.

    Attributes
    ----------
    time : (n,) array
        Stamps, s, increasing within and across blocks.
    values : (4, n) array
        Readings in the stream's units; NaN where a cell is missing.
    """

    time: Array
    values: Array


class _RowLayout(NamedTuple):
    """Positions of time and channels in a row."""

    separator: str | None  # None: any white space
    width: int
    time: int | None  # None: rows are counted
    channels: tuple[int, ...]
    seconds: float  # per unit of the stamps, or per row
    origin: float  # stamp of time zero, in that unit


class TextStreamReader:
    """Converts bytes to rows.

    Parameters
    ----------
    source : str
        Name of the stream for messages.
    rate : float or None
        Rows per second, Hz, for streams without stamps.

    Attributes
    ----------
    unreadable : int
        Lines that were not rows, and rows with an impossible stamp.
    restarts : int
        Number of times the stamps started again.
    """

    def __init__(self, source: str, rate: float | None = None) -> None:
        self.unreadable = 0
        self.restarts = 0
        self._source = source
        self._given_rate = rate
        self._bytes = b""
        self._preamble: list[str] = []
        self._error: InputError | None = None  # of the last line that looked like a header
        self._layout: _RowLayout | None = None
        self._probe: Recording | None = None
        self._counted = 0
        self._early: list[Row] = []  # rows before the rate is known
        self._rate: float | None = None
        self._last: float | None = None  # last accepted stamp, as received
        self._unconfirmed: Row | None = None
        self._shift = 0.0

    @property
    def rate(self) -> float | None:
        """Rows per second, Hz, by the first stamps or as given; None before them."""
        return self._rate

    @property
    def units(self) -> tuple[str, ...] | None:
        """Unit of each channel; None before the first row."""
        return None if self._probe is None else self._probe.units

    @property
    def metadata(self) -> tuple[tuple[str, str], ...]:
        """Keys and values before the first row."""
        return () if self._probe is None else self._probe.metadata

    def feed(self, data: bytes) -> RowBlock:
        """Read the next bytes.

        Parameters
        ----------
        data : bytes
            As received; lines may be split anywhere.

        Returns
        -------
        RowBlock
            Rows of the lines that are complete; none before the rate is known.

        Raises
        ------
        InputError
            If the stream cannot be a recording: no rate, a header without one of the channels, or
            nothing but unreadable lines.
        """
        *lines, self._bytes = (self._bytes + data).split(b"\n")
        if len(self._bytes) > _MAX_LINE:
            self._bytes = b""
            self.unreadable += 1
        rows = [row for line in lines for row in self._read_line(line)]
        if self._rate is None:
            self._early += rows
            rows = self._release_early()
        table = np.array(rows, dtype=float).reshape(-1, 1 + len(CHANNELS))
        return RowBlock(table[:, 0], table[:, 1:].T)

    def finish(self) -> RowBlock:
        """Read the last line, which may lack its end."""
        return self.feed(b"\n" if self._bytes else b"")

    def _read_line(self, line: bytes) -> list[Row]:
        """Read a line: usually one row, two when it confirms an earlier one, or none."""
        text = line.decode("utf-8", "replace").strip("\r\0 ")
        if not text.strip():
            return []
        if text.lstrip().startswith("#"):
            if self._layout is None and len(self._preamble) < _MAX_METADATA:
                self._preamble.append(text)
            return []
        if self._layout is None and not self._read_first_line(text):
            return []
        row = None if self._layout is None else _parse_row(text, self._layout)
        if row is None:
            self.unreadable += 1
            return []
        if self._layout is not None and self._layout.time is None:
            row = (self._counted * self._layout.seconds, *row[1:])
            self._counted += 1
        return self._check_order(row)

    def _read_first_line(self, text: str) -> bool:
        """Determine the layout from a line; return whether it is a row rather than a header."""
        if logger.is_logger_text(TextFile(text, self._source, "")):
            self._find_layout(1 + len(CHANNELS), " ", None)
            return True
        self.unreadable += 1  # perhaps the rest of a line that was being sent when reading began
        if any(ch.isalpha() for ch in text):
            separator = next((s for s in ";\t" if text.count(s) >= len(CHANNELS) - 1), ",")
            try:
                self._find_layout(len(text.split(separator)), separator, text)
            except InputError as error:  # a boot message of a board is not a header either
                self._error = error
            else:
                self.unreadable -= 1
                return False
        if self.unreadable >= _MAX_HEADER_LINES:
            raise self._error or InputError(
                self._source, "sends no rows of a recording", "check the logger and --baud"
            )
        return False

    def _find_layout(self, width: int, separator: str, header: str | None) -> None:
        """Let the file reader determine the column of each channel.

        It reads two rows whose cells count upwards, so that what it returns for a channel is the
        channel's position.  There is thus one reader of headers, not two.
        """
        rows = [
            separator.join(str(start + cell) for cell in range(width)) for start in (1, 1 + width)
        ]
        lines = [*self._preamble, *([] if header is None else [header]), *rows]
        reader = logger.read if header is None else csv.read
        probe = reader(TextFile("\n".join(lines), self._source, ""), self._given_rate)
        require_half_car(probe)
        start, step = float(probe.time[0]), float(probe.time[1] - probe.time[0])
        if header is None:  # the index counts from one
            row_separator, column, seconds, origin = None, 0, step / width, 1.0
        elif start > 0.0:
            row_separator, seconds, origin = separator, step / width, 0.0
            column = round(start / seconds) - 1
        else:
            row_separator, column, seconds, origin = separator, None, step, 0.0
        if header is None or column is None:
            self._rate = 1.0 / seconds
        self._probe = probe
        channels = tuple(int(v) - 1 for v in probe.values[:, 0])
        self._layout = _RowLayout(row_separator, width, column, channels, seconds, origin)

    def _check_order(self, row: Row) -> list[Row]:
        """Return the row if its stamp follows; an odd stamp waits until the next confirms it."""
        last, unconfirmed = self._last, self._unconfirmed
        if last is None or 0.0 < row[0] - last <= _MAX_STEP:
            self.unreadable += unconfirmed is not None
            self._unconfirmed = None
            accepted = [row]
        elif unconfirmed is not None and 0.0 < row[0] - unconfirmed[0] <= _MAX_STEP:
            if not last < unconfirmed[0] <= last + _MAX_PAUSE:
                self.restarts += 1
                self._shift += last + RESTART_GAP - unconfirmed[0]
            self._unconfirmed = None
            accepted = [unconfirmed, row]
        else:
            self.unreadable += unconfirmed is not None
            self._unconfirmed = row
            return []
        self._last = row[0]
        return [(r[0] + self._shift, *r[1:]) for r in accepted]

    def _release_early(self) -> list[Row]:
        """Return the early rows once they determine the rate."""
        if self._rate is None:
            if len(self._early) < _FIRST_ROWS or self._probe is None:
                return []
            time = np.array([row[0] for row in self._early])
            self._rate = nominal_rate(
                Recording(time, np.zeros((len(CHANNELS), len(time))), self._probe.units)
            )
        early, self._early = self._early, []
        return early


def _parse_row(text: str, layout: _RowLayout) -> Row | None:
    """Time in s and the four readings of a line, or None if it is not a row."""
    cells = text.split(layout.separator)
    while len(cells) > layout.width and not cells[-1].strip():
        cells.pop()  # trailing separators
    if len(cells) != layout.width:
        return None
    decimal_comma = layout.separator == ";"
    integers = layout.separator is None
    numbers = []
    for column in ((0,) if layout.time is None else (layout.time,)) + layout.channels:
        cell = cells[column].strip().strip('"')
        if decimal_comma:
            cell = cell.replace(",", ".")
        try:
            if not cell.isascii() or "_" in cell:
                return None
            number = float(int(cell)) if integers else float(cell or "nan")
        except ValueError:
            return None
        if abs(number) > MAX_MAGNITUDE:
            return None
        numbers.append(number)
    time = 0.0 if layout.time is None else (numbers[0] - layout.origin) * layout.seconds
    return (time, *numbers[1:]) if math.isfinite(time) else None
