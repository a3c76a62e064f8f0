"""Recordings as CSV: a header with the unit of each column in brackets, one row per sample.

::

    # sample_rate = 400 Hz
    time [s],front_wheel [in/s^2],front_chassis [in/s^2],rear_wheel [in/s^2],rear_chassis [in/s^2]
    0.0,1.5,,0.3,0.2

Columns may be in any order; other columns are ignored with a warning.  The separator is a comma, a
semicolon (which implies decimal commas) or a tab.  An empty cell or ``nan`` is a missing value.
"""

from __future__ import annotations

import csv
import re
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from bayes_asv.domain.channels import KNOWN_CHANNELS, channel, missing_inputs
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import closest, write_atomically
from bayes_asv.domain.recording import COUNT_UNITS, COUNTS, check_unit, parse_rate
from bayes_asv.domain.units import si_factor
from bayes_asv.io.text import (
    build_recording,
    check_table_size,
    check_time,
    metadata_lines,
    parse_column,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from bayes_asv.domain.files import PathLike
    from bayes_asv.domain.recording import Recording
    from bayes_asv.io.text import TextFile

__all__ = ["read", "write_csv"]

_HEADER: Final = (
    "time [s],front_wheel [m/s^2],front_chassis [m/s^2],rear_wheel [m/s^2],rear_chassis [m/s^2]"
)
_MAX_COLUMNS: Final = 10_000
_MAX_LISTED: Final = 8
_BLOCK: Final = 50_000  # rows that are split into cells at a time


class _Column(NamedTuple):
    name: str
    unit: str | None
    position: int


def read(text: TextFile, rate: float | None) -> Recording:
    """Read a recording from the lines of a CSV file.

    Parameters
    ----------
    text : Text
        Lines with their line numbers.
    rate : float or None
        Sampling rate, Hz; used only without a time column.

    Returns
    -------
    Recording
        In the units of the file.

    Raises
    ------
    InputError
        With the line and the fix.
    """
    if not text.header:
        raise InputError(text.source, "contains no data", "export it again")
    separator = _separator(text.header)
    header = _split(text.header, separator, text.at(0))
    columns, ignored = _columns(header, text.at(0))
    channels = tuple(name for name in columns if name != "time")
    units = _units(columns, text.at(0))
    # The stamps come last: of several faults that of a reading is reported.
    wanted = [columns[name] for name in (*channels, "time") if name in columns]
    table = text.table(separator, len(header), [column.position for column in wanted])
    if table is None or table.shape[1] < 2:
        table = _row_by_row(text, separator, len(header), wanted)
    values = table[: len(channels)]
    time = _time(columns.get("time"), table[-1], text, rate)
    warnings = []
    if ignored:
        more = f" and {len(ignored) - _MAX_LISTED} more" if len(ignored) > _MAX_LISTED else ""
        warnings.append(f"columns ignored: {', '.join(ignored[:_MAX_LISTED])}{more}")
    return build_recording(text, time, values, units, text.metadata, rate, warnings, channels)


def write_csv(recording: Recording, path: PathLike) -> None:
    """Write a recording as CSV, atomically; reading it back gives identical arrays.

    Parameters
    ----------
    recording : Recording
        Written in its own units, time in s.
    path : str or os.PathLike
        The file.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    header = ",".join(
        ["time [s]"]
        + [
            f"{name} [{unit}]"
            for name, unit in zip(recording.channels, recording.units, strict=True)
        ]
    )
    columns = [list(map(repr, recording.time.tolist()))]
    for readings in recording.values:
        columns.append(["" if cell == "nan" else cell for cell in map(repr, readings.tolist())])
    lines = [*metadata_lines(recording), header, *map(",".join, zip(*columns, strict=True)), ""]
    write_atomically(path, "\n".join(lines).encode("utf-8"))


def _separator(header: str) -> str:
    return max(",;\t", key=header.count)


def _split(line: str, separator: str, where: str) -> list[str]:
    if '"' not in line:
        return line.split(separator)
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    except (csv.Error, StopIteration):
        raise InputError(where, "has an unterminated quoted cell", "close the quote") from None


def _columns(header: Sequence[str], where: str) -> tuple[dict[str, _Column], list[str]]:
    """Return the columns by name in channel order, and the names of the ignored columns."""
    if len(header) > _MAX_COLUMNS:
        raise InputError(where, f"has {len(header)} columns", "keep time and the channels")
    cells = [re.fullmatch(r"([^\[\]()]*)(?:[\[(]([^\[\]]*)[\])])?", c.strip()) for c in header]
    given = [
        re.sub(r"[\s_-]+", "_", (match[1] if match else cell).strip().lower())
        for match, cell in zip(cells, header, strict=True)
    ]
    columns: dict[str, _Column] = {}
    ignored = []
    for index, (cell, match, name) in enumerate(zip(header, cells, given, strict=True)):
        if match is None or name not in ("time", *KNOWN_CHANNELS):
            if name:
                ignored.append(cell.strip()[:40])
            continue
        if name in columns:
            raise InputError(where, f"column {name} occurs twice", "keep one of them")
        columns[name] = _Column(name, match[2], index)
    found = [name for name in columns if name != "time"]
    if not found:
        raise InputError(
            where, "is not the header of a recording",
            f"write: {_HEADER}; or make a channel map: bayes-asv inspect FILE -o channels.toml, "
            "then --channels channels.toml",
        )  # fmt: skip
    missing = missing_inputs(found)
    if missing:
        names = {cell.split("[")[0].strip().lower(): cell for cell in ignored}
        near = closest(missing[0], names)
        fix = f"rename {names[near]} to {missing[0]}" if near else "add it with its unit"
        raise InputError(where, f"column {missing[0]} is missing", fix)
    order = [name for name in ("time", *KNOWN_CHANNELS) if name in columns]
    return {name: columns[name] for name in order}, ignored


def _units(columns: dict[str, _Column], where: str) -> tuple[str, ...]:
    units = []
    for name, column in columns.items():
        if name == "time":
            continue
        unit = column.unit
        if unit is None or not unit.strip():
            raise InputError(
                where, f"column {name} has no unit", f"write {name} [{channel(name).si_unit}]"
            )
        unit = unit.strip()
        if unit.lower() in COUNT_UNITS:
            unit = COUNTS
        else:
            check_unit(name, unit, f"{where}: {name}")
        units.append(unit)
    return tuple(units)


def _row_by_row(
    text: TextFile, separator: str, width: int, wanted: Sequence[_Column]
) -> NDArray[np.float64]:
    """Parse columns (len(wanted), N) from the lines; an error names the line."""
    rows = len(text.lines) - 1
    if rows < 2:
        raise InputError(text.source, f"has {rows} rows of data", "a recording needs at least two")
    check_table_size(rows, width, text.source)
    table = np.empty((len(wanted), rows))
    for first in range(1, rows + 1, _BLOCK):
        cells = _cells(text, separator, width, first)
        for out, column in zip(table, wanted, strict=True):
            own = cells[column.position]
            if separator == ";":
                own = [cell.replace(",", ".") for cell in own]
            out[first - 1 : first - 1 + len(own)] = parse_column(own, text, first, column.name)
    return table


def _cells(text: TextFile, separator: str, width: int, first: int) -> list[Sequence[str]]:
    """Return the cells of a block of rows by column."""
    lines = text.lines[first : first + _BLOCK]
    body = separator.join(lines)
    if '"' not in body and all(line.count(separator) == width - 1 for line in lines):
        flat = body.split(separator)
        return [flat[index::width] for index in range(width)]
    rows = [
        _split_ragged_row(line, separator, width, text.at(row))
        for row, line in enumerate(lines, first)
    ]
    return list(zip(*rows, strict=True))


def _split_ragged_row(line: str, separator: str, width: int, where: str) -> list[str]:
    cells = _split(line, separator, where)
    while len(cells) > width and not cells[-1].strip():
        cells.pop()  # trailing separators
    if len(cells) != width:
        raise InputError(
            where, f"has {len(cells)} cells, the header {width}", "complete the row or delete it"
        )
    return cells


def _time(
    stamp: _Column | None, stamps: NDArray[np.float64], text: TextFile, rate: float | None
) -> NDArray[np.float64]:
    """Time in s from the stamps of the time column, or else from the sampling rate."""
    if stamp is None:
        declared = [value for key, value in text.metadata if key.strip() == "sample_rate"]
        if rate is None and declared:
            rate = parse_rate(declared[-1], f"{text.source}: # sample_rate")
        if rate is None:
            raise InputError(
                text.at(0), "there is no column time [s]", "add it, or give the rate (--rate)"
            )
        return np.arange(len(stamps)) / rate
    if stamp.unit is None or not stamp.unit.strip():
        raise InputError(text.at(0), "column time has no unit", "write time [s]")
    try:
        factor = si_factor(stamp.unit.strip(), "time")
    except InputError as exc:
        raise InputError(
            f"{text.at(0)}: time", f"{exc.where} {exc.what}", "write time [s]"
        ) from None
    time = stamps * factor
    check_time(time, text, 1)
    return time
