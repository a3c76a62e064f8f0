"""What line-based formats share: lines, ``# key = value`` metadata, and checks of the result."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import (
    LARGEST_NUMBER,
    Recording,
    declared_rate,
    nominal_rate,
    timing,
    unsorted_row,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

__all__ = ["LARGEST_FILE", "MOST_CELLS", "Text", "column", "finish", "metadata_lines"]

LARGEST_FILE: Final = 1_000_000_000
MOST_CELLS: Final = 50_000_000
_RATE_TOLERANCE: Final = 0.01
_USUAL_RATES: Final = (1.0, 1e5)  # Hz; outside it is likelier that the unit of time is wrong


class Text:
    """Lines of a file, metadata apart from data.

    Attributes
    ----------
    lines : list of str
        Lines that are neither blank nor metadata.
    numbers : list of int
        Line number in the file of each of them, from 1.
    metadata : list of (str, str)
        ``# key = value``; a remark without ``=`` has the key ``comment``.
    """

    def __init__(self, text: str, source: str, sha256: str) -> None:
        self.source = source
        self.sha256 = sha256
        self.lines: list[str] = []
        self.numbers: list[int] = []
        self.metadata: list[tuple[str, str]] = []
        # Not splitlines(): it also breaks at form feeds and at other marks inside a remark.
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
        """``file:line`` of one of `lines`."""
        return f"{self.source}:{self.numbers[row]}"


def column(cells: Sequence[str], text: Text, first: int, name: str) -> NDArray[np.float64]:
    """Convert the cells of one column, the first of which stands in row `first` of `text`.

    Empty cells and ``nan`` become NaN.

    Raises
    ------
    InputError
        Naming the line of the first cell that is not a number, or not a believable one.
    """
    result = None
    try:
        # float() takes 1_000 and infinity, which no logger means
        joined = "".join(cells)
        if joined.isascii() and "_" not in joined:
            full = [cell or "nan" for cell in cells] if "" in cells else cells
            result = np.fromiter(map(float, full), np.float64, len(full))
    except ValueError:
        pass
    if result is None or (np.abs(result) > LARGEST_NUMBER).any():
        result = np.array(
            [_cell(cell, text.at(first + row), name) for row, cell in enumerate(cells)],
            dtype=np.float64,
        )
    return result


def _cell(cell: str, where: str, name: str) -> float:
    stripped = cell.strip()
    if not stripped:
        return math.nan
    try:
        value = float(stripped) if stripped.isascii() and "_" not in stripped else None
    except ValueError:
        value = None
    if value is None:
        raise InputError(
            where, f"{name} is '{stripped[:40]}', not a number", "correct it or leave it empty"
        )
    if abs(value) > LARGEST_NUMBER:
        raise InputError(
            where, f"{name} is {value:g}, beyond any reading", "leave a missing cell empty"
        )
    return value


def check_cells(rows: int, columns: int, source: str) -> None:
    """Refuse a table that would fill the memory of a laptop."""
    if rows * columns > MOST_CELLS:
        raise InputError(
            source, f"has {rows} rows of {columns} columns", f"split it below {MOST_CELLS} cells"
        )


def check_time(time: NDArray[np.float64], text: Text, first: int) -> None:
    """Refuse stamps that are missing, repeated or out of order, naming the line."""
    row = unsorted_row(time)
    if row is None:
        return
    where = text.at(first + row)
    if not math.isfinite(time[row]):
        raise InputError(where, "has no time", "delete the row or give its time")
    raise InputError(
        where,
        f"time {float(time[row])!r} s does not come after {float(time[row - 1])!r} s",
        "sort the rows and delete repeated ones; time needs enough decimals",
    )


def finish(
    text: Text,
    time: NDArray[np.float64],
    values: NDArray[np.float64],
    units: tuple[str, ...],
    metadata: Sequence[tuple[str, str]],
    rate: float | None,
    warnings: Sequence[str],
    channels: tuple[str, ...] = CHANNELS,
) -> Recording:
    """Make the recording and look at it as a whole.

    Raises
    ------
    InputError
        If a channel holds no reading at all, or metadata on time cannot be read.
    """
    for channel, readings in zip(channels, values, strict=True):
        if np.isnan(readings).all():
            raise InputError(text.source, f"{channel} holds no reading", "check the sensor's wire")
    noticed = list(warnings)
    made = Recording(
        time, values, units, tuple(metadata), text.source, text.sha256, channels=channels
    )
    timing(made)  # a clock or delay that cannot be read is told now, not hours later
    declared = declared_rate(made)
    actual = nominal_rate(made)
    if not _USUAL_RATES[0] <= actual <= _USUAL_RATES[1]:
        noticed.append(f"the rows run at {actual:.6g} Hz; check the unit of the time column")
    for said, whose in ((declared, "sample_rate"), (rate, "the given rate")):
        if said is not None and abs(actual - said) > _RATE_TOLERANCE * said:
            noticed.append(
                f"{whose} is {said:g} Hz but the stamps run at {actual:.6g} Hz; the stamps govern"
            )
    return Recording(
        made.time,
        made.values,
        units,
        made.metadata,
        text.source,
        text.sha256,
        tuple(noticed),
        channels,
    )


def metadata_lines(recording: Recording) -> list[str]:
    """Metadata as they are written."""
    return [f"# {key} = {value}".rstrip() for key, value in recording.metadata]
