"""Common parts of the line-based formats: lines, ``# key = value`` metadata and checks."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.log import MAX_SAMPLES
from bayes_asv.domain.recording import (
    MAX_MAGNITUDE,
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
_RATE_TOLERANCE: Final = 0.01
_TYPICAL_RATES: Final = (1.0, 1e5)  # Hz; outside this range the unit of time is probably wrong


class TextFile:
    """Lines of a text file, metadata separate from data.

    Attributes
    ----------
    lines : list of str
        Lines that are neither blank nor metadata.
    numbers : list of int
        Line number of each of them in the file, from 1.
    metadata : list of (str, str)
        Lines ``# key = value``; a remark without ``=`` has the key ``comment``.
    """

    def __init__(self, text: str, source: str, sha256: str) -> None:
        self.source = source
        self.sha256 = sha256
        self.lines: list[str] = []
        self.numbers: list[int] = []
        self.metadata: list[tuple[str, str]] = []
        # splitlines() would also break lines at form feeds and other characters in a remark.
        unified = text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text
        for number, line in enumerate(unified.split("\n"), 1):
            stripped = line.strip()
            if not stripped:
                continue
            if stripped[0] == "#":
                key, equals, value = stripped[1:].partition("=")
                if equals and key.strip():
                    self.metadata.append((key, value))
                elif stripped[1:].strip():
                    self.metadata.append(("comment", stripped[1:].replace("=", " ").strip()))
            else:
                self.lines.append(line)
                self.numbers.append(number)

    def at(self, row: int) -> str:
        """Return ``file:line`` of one of `lines`."""
        return f"{self.source}:{self.numbers[row]}"


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
            where, f"{name} is {value:g}, which no sensor reads", "leave a missing cell empty"
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
    warnings: Sequence[str],
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
    notes = list(warnings)
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
