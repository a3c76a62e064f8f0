"""Recordings as CSV: a header with the unit of each column in brackets, then one row a sample.

::

    # sample_rate = 400 Hz
    time [s],front_wheel [in/s^2],front_chassis [in/s^2],rear_wheel [in/s^2],rear_chassis [in/s^2]
    0.0,1.5,,0.3,0.2

Columns may stand in any order, further ones are ignored and named in a warning. Separators are
comma, semicolon (then a decimal comma is understood) or tab. An empty cell or ``nan`` is missing.
"""

from __future__ import annotations

import csv
import re
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from bayes_asv.domain.channels import CHANNELS, ROLL_CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import closest, write_whole
from bayes_asv.domain.recording import COUNTS, acceleration_factor, parse_rate
from bayes_asv.domain.units import si_factor
from bayes_asv.io.text import check_cells, check_time, column, finish, metadata_lines

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from bayes_asv.domain.files import PathLike
    from bayes_asv.domain.recording import Recording
    from bayes_asv.io.text import Text

__all__ = ["read", "write_csv"]

_HEADER: Final = (
    "time [s],front_wheel [m/s^2],front_chassis [m/s^2],rear_wheel [m/s^2],rear_chassis [m/s^2]"
)
_COUNTS: Final = frozenset({"counts", "count", "raw"})
_MOST_COLUMNS: Final = 10_000
_MOST_NAMED: Final = 8


class _Column(NamedTuple):
    name: str
    unit: str | None
    place: int


def read(text: Text, rate: float | None) -> Recording:
    """Read a recording from the lines of a CSV file.

    Parameters
    ----------
    text : Text
        Lines, with their numbers.
    rate : float or None
        Hz; used only when there is no time column.

    Returns
    -------
    Recording
        In the units of the file.

    Raises
    ------
    InputError
        With the line and the mend.
    """
    if not text.lines:
        raise InputError(text.source, "holds no data", "export it again")
    separator = _separator(text.lines[0])
    header = _split(text.lines[0], separator, text.at(0))
    columns, ignored = _columns(header, text.at(0))
    channels = tuple(name for name in columns if name != "time")
    units = _units(columns, text.at(0))
    rows = len(text.lines) - 1
    if rows < 2:
        raise InputError(text.source, f"has {rows} rows of data", "a recording needs two at least")
    check_cells(rows, len(header), text.source)
    cells = _cells(text, separator, len(header))
    if separator == ";":
        cells = [
            [cell.replace(",", ".") for cell in own] if _is_used(place, columns) else own
            for place, own in enumerate(cells)
        ]
    values = np.empty((len(channels), rows))
    for row, name in enumerate(channels):
        values[row] = column(cells[columns[name].place], text, 1, name)
    time = _time(columns, cells, text, rate, rows)
    warnings = []
    if ignored:
        more = f" and {len(ignored) - _MOST_NAMED} more" if len(ignored) > _MOST_NAMED else ""
        warnings.append(f"columns ignored: {', '.join(ignored[:_MOST_NAMED])}{more}")
    return finish(text, time, values, units, text.metadata, rate, warnings, channels)


def write_csv(recording: Recording, path: PathLike) -> None:
    """Write a recording as CSV, whole or not at all; reading it gives identical arrays.

    Parameters
    ----------
    recording : Recording
        What to write, in its own units; time in s.
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
    write_whole(path, "\n".join(lines).encode("utf-8"))


def _separator(header: str) -> str:
    for candidate in (";", "\t"):
        if header.count(candidate) >= len(CHANNELS) - 1:
            return candidate
    return ","


def _split(line: str, separator: str, where: str) -> list[str]:
    if '"' not in line:
        return line.split(separator)
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    except (csv.Error, StopIteration):
        raise InputError(where, "has a quoted cell without end", "close the quote") from None


def _columns(header: Sequence[str], where: str) -> tuple[dict[str, _Column], list[str]]:
    """Return the columns by name in the channels' order, and the names of those not used.

    Channels of single corners make it a recording of a car that rolls.
    """
    if len(header) > _MOST_COLUMNS:
        raise InputError(where, f"has {len(header)} columns", "keep time and the channels")
    cells = [re.fullmatch(r"([^\[\]()]*)(?:[\[(]([^\[\]]*)[\])])?", c.strip()) for c in header]
    given = [
        re.sub(r"[\s_-]+", "_", (match[1] if match else cell).strip().lower())
        for match, cell in zip(cells, header, strict=True)
    ]
    corners = sum(name in ROLL_CHANNELS for name in given)
    wanted = ROLL_CHANNELS if corners > sum(name in CHANNELS for name in given) else CHANNELS
    found: dict[str, _Column] = {}
    ignored = []
    for place, (cell, match, name) in enumerate(zip(header, cells, given, strict=True)):
        if match is None or name not in ("time", *wanted):
            if name:
                ignored.append(cell.strip()[:40])
            continue
        if name in found:
            raise InputError(where, f"column {name} stands twice", "keep one of them")
        found[name] = _Column(name, match[2], place)
    missing = [name for name in wanted if name not in found]
    if len(missing) == len(wanted):
        raise InputError(where, "is not the header of a recording", f"write: {_HEADER}")
    if missing:
        names = {cell.split("[")[0].strip().lower(): cell for cell in ignored}
        near = closest(missing[0], names)
        hint = f"rename {names[near]} to {missing[0]}" if near else "add it with its unit"
        raise InputError(where, f"column {missing[0]} is missing", hint)
    order = [name for name in ("time", *wanted) if name in found]
    return {name: found[name] for name in order}, ignored


def _units(columns: dict[str, _Column], where: str) -> tuple[str, ...]:
    units = []
    for name, own in columns.items():
        if name == "time":
            continue
        unit = own.unit
        if unit is None or not unit.strip():
            raise InputError(where, f"column {name} has no unit", f"write {name} [m/s^2]")
        unit = unit.strip()
        if unit.lower() in _COUNTS:
            unit = COUNTS
        else:
            acceleration_factor(unit, f"{where}: {name}")
        units.append(unit)
    return tuple(units)


def _cells(text: Text, separator: str, width: int) -> list[Sequence[str]]:
    """Return the cells of the data rows by column."""
    lines = text.lines[1:]
    marks = width - 1
    body = separator.join(lines)
    if '"' not in body and all(line.count(separator) == marks for line in lines):
        flat = body.split(separator)
        return [flat[place::width] for place in range(width)]
    rows = [_odd_row(line, separator, width, text.at(row)) for row, line in enumerate(lines, 1)]
    return list(zip(*rows, strict=True))


def _odd_row(line: str, separator: str, width: int, where: str) -> list[str]:
    cells = _split(line, separator, where)
    while len(cells) > width and not cells[-1].strip():
        cells.pop()  # trailing separators
    if len(cells) != width:
        raise InputError(
            where, f"has {len(cells)} cells, the header {width}", "complete the row or delete it"
        )
    return cells


def _is_used(place: int, columns: dict[str, _Column]) -> bool:
    return any(used.place == place for used in columns.values())


def _time(
    columns: dict[str, _Column],
    cells: Sequence[Sequence[str]],
    text: Text,
    rate: float | None,
    rows: int,
) -> NDArray[np.float64]:
    """Stamps in s, from their column or, without one, from the rate."""
    stamp = columns.get("time")
    if stamp is None:
        said = [value for key, value in text.metadata if key.strip() == "sample_rate"]
        if rate is None and said:
            rate = parse_rate(said[-1], f"{text.source}: # sample_rate")
        if rate is None:
            raise InputError(
                text.at(0), "there is no column time [s]", "add it, or give the rate (--rate)"
            )
        return np.arange(rows) / rate
    if stamp.unit is None or not stamp.unit.strip():
        raise InputError(text.at(0), "column time has no unit", "write time [s]")
    try:
        factor = si_factor(stamp.unit.strip(), "time")
    except InputError as exc:
        raise InputError(
            f"{text.at(0)}: time", f"{exc.where} {exc.what}", "write time [s]"
        ) from None
    time = column(cells[stamp.place], text, 1, "time") * factor
    check_time(time, text, 1)
    return time
