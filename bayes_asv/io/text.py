"""Common parts of the line-based formats: lines, ``# key = value`` metadata and checks."""

from __future__ import annotations

import math
import warnings
from array import array
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import (
    MAX_MAGNITUDE,
    MAX_SAMPLES,
    Recording,
    declared_rate,
    first_unsorted_row,
    nominal_rate,
    timing,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

__all__ = [
    "MAX_CELLS",
    "MAX_FILE_SIZE",
    "TextFile",
    "build_recording",
    "metadata_lines",
    "parse_column",
]

MAX_FILE_SIZE: Final = 1_000_000_000
MAX_CELLS: Final = MAX_SAMPLES
_CHUNK: Final = 1 << 22  # characters that are parsed at once
_RATE_TOLERANCE: Final = 0.01
_TYPICAL_RATES: Final = (1.0, 1e5)  # Hz; outside this range the unit of time is probably wrong


class TextFile:
    """Lines of a text file, metadata separate from data.

    A file of a million rows is split into lines only where somebody asks for them.

    Attributes
    ----------
    source, sha256 : str
        Name and hash of the file.
    header : str
        First line of data; empty without one.
    """

    def __init__(self, text: str, source: str, sha256: str) -> None:
        self.source = source
        self.sha256 = sha256
        # splitlines() would also break lines at form feeds and other characters in a remark.
        self._text = text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text
        self._top: list[tuple[str, str]] = []
        self.header = ""
        self._above = 0  # lines above the header
        self._body = 0  # where the line after the header begins
        while self._body < len(self._text):
            end = self._text.find("\n", self._body)
            end = len(self._text) if end < 0 else end
            line, self._body = self._text[self._body : end], end + 1
            if line.strip() and line.lstrip()[0] != "#":
                self.header = line
                break
            self._above += 1
            if line.strip():
                _read_metadata(line, self._top)

    @property
    def metadata(self) -> list[tuple[str, str]]:
        """Lines ``# key = value``; a remark without ``=`` has the key ``comment``."""
        return self._split[2] if self._text.find("#", self._body) >= 0 else self._top

    @property
    def lines(self) -> list[str]:
        """Lines that are neither blank nor metadata."""
        return self._split[0]

    @cached_property
    def _split(self) -> tuple[list[str], array[int], list[tuple[str, str]]]:
        """Lines of data, the number of each in the file, from 1, and the metadata."""
        lines, numbers, metadata = [], array("l"), list[tuple[str, str]]()
        for number, line in enumerate(self._text.split("\n"), 1):
            stripped = line.strip()
            if not stripped:
                continue
            if stripped[0] == "#":
                _read_metadata(line, metadata)
            else:
                lines.append(line)
                numbers.append(number)
        return lines, numbers, metadata

    def at(self, row: int) -> str:
        """Return ``file:line`` of one of `lines`."""
        number = self._above + 1 if row == 0 else self._split[1][row]
        return f"{self.source}:{number}"

    def table(
        self, separator: str, width: int, columns: Sequence[int]
    ) -> NDArray[np.float64] | None:
        """Parse the rows below the header at once, where all their cells are plain numbers.

        Parameters
        ----------
        separator : str
            Between cells; a semicolon implies decimal commas.
        width : int
            Cells in a row.
        columns : sequence of int
            Columns to return.

        Returns
        -------
        (len(columns), N) array or None
            Bit for bit what `parse_column` makes of the cells.  None for anything unusual, from
            remarks between the rows to a fault: then the lines have to be read one by one.
        """
        end = len(self._text)
        while end > self._body and self._text[end - 1] == "\n":
            end -= 1
        rows = self._text.count("\n", self._body, end) + 1
        if end <= self._body or rows * width > MAX_CELLS:
            return None
        out = np.empty((len(columns), rows))
        begin, row = self._body, 0
        while begin < end:
            stop = end
            if end - begin > _CHUNK:
                stop = self._text.find("\n", begin + _CHUNK, end)
                stop = end if stop < 0 else stop
            cells = _numbers(self._text[begin:stop], separator, width)
            if cells is None:
                return None
            out[:, row : row + len(cells)] = cells[:, columns].T
            begin, row = stop + 1, row + len(cells)
        with np.errstate(invalid="ignore"):
            return out if row == rows and not (np.abs(out) > MAX_MAGNITUDE).any() else None


def _read_metadata(line: str, metadata: list[tuple[str, str]]) -> None:
    """Append what a line that begins with ``#`` says."""
    remark = line.strip()[1:]
    key, equals, value = remark.partition("=")
    if equals and key.strip():
        metadata.append((key, value))
    elif remark.strip():
        metadata.append(("comment", remark.replace("=", " ").strip()))


def _numbers(text: str, separator: str, width: int) -> NDArray[np.float64] | None:
    """Parse whole rows of plain numbers (N, width); None where a cell or a row is anything else."""
    try:
        data = text.encode("ascii")
    except UnicodeEncodeError:
        return None
    plain = b"0123456789+-.eEnaN\n " + separator.encode()
    if data.translate(None, plain + (b"," if separator == ";" else b"")):
        return None
    if separator == ";":
        data = data.replace(b",", b".")
    data = data.replace(separator.encode(), b",").replace(b", ", b",")
    if b" " in data:
        return None
    marks = np.frombuffer(data, np.uint8)
    breaks = np.append(np.flatnonzero(marks == ord("\n")), len(marks))
    commas = np.flatnonzero(marks == ord(","))
    rows = len(breaks)
    # the cells of every row, not of all rows together
    if not np.array_equal(np.searchsorted(commas, breaks), (width - 1) * np.arange(1, rows + 1)):
        return None
    data = data.replace(b"\n", b",")
    if b",," in data or data.startswith(b",") or data.endswith(b","):
        data = b"," + data + b","
        data = data.replace(b",,", b",nan,").replace(b",,", b",nan,")[1:-1]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # how older versions of NumPy say it
            cells = np.fromstring(data, sep=",")
    except (ValueError, DeprecationWarning):
        return None
    return cells.reshape(rows, width) if cells.size == rows * width else None


def parse_column(
    cells: Sequence[str], text: TextFile, first: int, name: str
) -> NDArray[np.float64]:
    """Convert the cells of one column, which begins in row `first` of `text`, to floats.

    Empty cells and ``nan`` become NaN.

    Raises
    ------
    InputError
        With the line of the first cell that is not a number or is too large.
    """
    result = None
    try:
        # float() accepts 1_000 and infinity, which no logger writes
        joined = "".join(cells)
        if joined.isascii() and "_" not in joined:
            full = [cell or "nan" for cell in cells] if "" in cells else cells
            result = np.fromiter(map(float, full), np.float64, len(full))
    except ValueError:
        pass
    if result is None or (np.abs(result) > MAX_MAGNITUDE).any():
        result = np.array(
            [_parse_cell(cell, text.at(first + row), name) for row, cell in enumerate(cells)],
            dtype=np.float64,
        )
    return result


def _parse_cell(cell: str, where: str, name: str) -> float:
    stripped = cell.strip()
    if not stripped:
        return math.nan
    try:
        value = float(stripped) if stripped.isascii() and "_" not in stripped else None
    except ValueError:
        value = None
    if value is None:
        raise InputError(
            where,
            f"{name} is '{stripped[:40]}', not a number",
            "correct it or leave the cell empty",
        )
    if abs(value) > MAX_MAGNITUDE:
        raise InputError(
            where,
            f"{name} is {value:g}, which is implausible for a "
            + ("stamp" if name == "time" else "sensor"),
            "give the unit of the stamps in the header, such as time [ms]"
            if name == "time"
            else "leave a missing cell empty",
        )
    return value


def check_table_size(rows: int, columns: int, source: str) -> None:
    """Check that a table fits into the memory of a laptop."""
    if rows * columns > MAX_CELLS:
        raise InputError(
            source,
            f"has {rows} rows of {columns} columns",
            f"split it into files of less than {MAX_CELLS} cells",
        )


def check_time(time: NDArray[np.float64], text: TextFile, first: int) -> None:
    """Check that the time stamps are present and increase; an error names the line."""
    row = first_unsorted_row(time)
    if row is None:
        return
    where = text.at(first + row)
    if not math.isfinite(time[row]):
        raise InputError(where, "has no time", "delete the row or add its time")
    raise InputError(
        where,
        f"time {float(time[row])!r} s does not come after {float(time[row - 1])!r} s",
        "sort the rows and delete duplicates; the time column needs enough decimals",
    )


def build_recording(
    text: TextFile,
    time: NDArray[np.float64],
    values: NDArray[np.float64],
    units: tuple[str, ...],
    metadata: Sequence[tuple[str, str]],
    rate: float | None,
    notes: Sequence[str],
    channels: tuple[str, ...] = CHANNELS,
) -> Recording:
    """Build the recording and check it as a whole.

    Raises
    ------
    InputError
        If a channel has no reading, or metadata about clocks cannot be read.
    """
    for channel, readings in zip(channels, values, strict=True):
        if np.isnan(readings).all():
            raise InputError(
                text.source, f"{channel} has no readings", "check the wiring of the sensor"
            )
    notes = list(notes)
    recording = Recording(
        time, values, units, tuple(metadata), text.source, text.sha256, channels=channels
    )
    timing(recording)  # report an unreadable clock or delay now rather than during an estimate
    declared = declared_rate(recording)
    actual = nominal_rate(recording)
    if not _TYPICAL_RATES[0] <= actual <= _TYPICAL_RATES[1]:
        notes.append(f"the sampling rate is {actual:.6g} Hz; check the unit of the time column")
    for expected, name in ((declared, "sample_rate"), (rate, "the given rate")):
        if expected is not None and abs(actual - expected) > _RATE_TOLERANCE * expected:
            notes.append(
                f"{name} is {expected:g} Hz, but the time stamps give {actual:.6g} Hz; "
                "the stamps are used"
            )
    return replace(recording, warnings=tuple(notes))


def metadata_lines(recording: Recording) -> list[str]:
    """Return the metadata as lines of text."""
    return [f"# {key} = {value}".rstrip() for key, value in recording.metadata]
