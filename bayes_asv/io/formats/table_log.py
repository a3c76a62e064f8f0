"""Makes the channels of a log from a table: finds the column of time, and the rate without one."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

import numpy as np

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.log import utc
from bayes_asv.domain.recording import check_rate, parse_rate
from bayes_asv.io.formats.format import listed
from bayes_asv.io.formats.header import column_name
from bayes_asv.io.formats.stamps import repair, time_factor

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import LogBuilder
    from bayes_asv.io.formats.table import Table

__all__ = ["add_table", "log_of_table"]

_TOLERANCE: Final = 0.01  # between a rate that is given and that of the stamps
_TIME_NAME: Final = re.compile(
    r"time|zeit|temps|tiempo|tempo|stamp|milli|micro|elapsed|second|interval|uptime|clock|utc"
    r"|^t$|^ts$|^s$|^ms$|^us$|^µs$|^sec$|^t[_ ]?(?:s|ms|us|µs|ns)$|^x_value$",
    re.IGNORECASE,
)
_NOT_TIME: Final = re.compile(
    r"lap|best|diff|delta|split|predict|sector|temper|temporal", re.IGNORECASE
)
_INDEX_NAME: Final = re.compile(r"^(index|count|counter|sample|samples|n|nr|no|id|row|#)\.?$", re.I)


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
        names as the first column of times of day or of numbers that increase evenly.
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
        if table.clock[at]:
            factor = 1.0
        elif factor is None:
            factor = time_factor(unit) or time_factor(names[at], in_name=True)
        where = f"{file.source}: {names[at]}"
        repaired = repair(table.columns[at], factor, where, _same_as_before(table))
        stamp, kept = repaired.time, repaired.rows
        builder.warnings += repaired.warnings
        if start := utc(repaired.start):
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
        if index == at or (empty and names[index] == column_name(index)):
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


def log_of_table(
    builder: LogBuilder,
    table: Table,
    time: str | None = None,
    factor: float | None = None,
    rate: float | None = None,
) -> Log:
    """Return the log of one table; the parameters are those of `add_table`."""
    add_table(builder, table, time, factor, rate)
    return builder.build()


def _time_column(table: Table) -> int | None:
    names, units = table.header.names, table.header.units
    if not table.named:
        for index, column in enumerate(table.columns):
            if _increases(column, strict=not table.clock[index]):
                return index
        return None
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


def _same_as_before(table: Table) -> NDArray[np.bool_]:
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
        if declared is not None and abs(declared - given) > _TOLERANCE * given:
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
    if abs(actual - given) > _TOLERANCE * given:
        builder.warnings.append(
            f"the given rate is {given:g} Hz, but the time stamps give {actual:.6g} Hz; "
            "the stamps are used"
        )
