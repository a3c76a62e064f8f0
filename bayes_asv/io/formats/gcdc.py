"""CSV of the accelerometers of Gulf Coast Data Concepts: ``;`` before each line of the header.

Readings are in counts.  The user manuals of the X16 series give 2048 counts per g; loggers with
several sensors state a sensitivity in counts per unit.  Where neither applies, counts remain.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from bayes_asv.domain.errors import InputError
from bayes_asv.io.formats.format import Format, LogBuilder
from bayes_asv.io.formats.header import Header
from bayes_asv.io.formats.table import decode_text, read_table
from bayes_asv.io.formats.table_log import log_of_table

if TYPE_CHECKING:
    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import LogFile

__all__ = ["FORMAT"]

_X16: Final = 2048.0  # counts per g
_SENSORS: Final = {"accel": "A", "gyro": "G", "mag": "M"}  # and the first letter of their columns


def _recognises(head: bytes) -> bool:
    return head.lstrip(b"\xef\xbb\xbf").startswith(b";Title") and b"gcdataconcepts" in head[:300]


def _read(file: LogFile) -> Log:
    text = decode_text(file.data, file.source)
    lines = [line[1:].strip() for line in text.splitlines()[:100] if line.startswith(";")]
    rows = [[cell.strip() for cell in line.split(",")] for line in lines]
    names = next(
        (row[1:] if row[0].lower() == "headers" else row for row in reversed(rows)
         if row[0].lower() in ("time", "headers")), None,
    )  # fmt: skip
    if not names:
        raise InputError(file.source, "has no line ;Time, Ax, Ay, Az", "copy it again")
    scales = _scales(rows)
    table = read_table(
        text,
        file.source,
        Header(tuple(names), tuple(scales.get(name[:1], (1.0, "counts"))[1] for name in names)),
        ragged=True,
    )
    units = ["s" if name.lower() == "time" else unit for name, unit in _units(table.header)]
    for index, name in enumerate(table.header.names):
        if name[1:] in ("x", "y", "z") and name[0] in scales:
            table.columns[index] /= scales[name[0]][0]
    table = table._replace(header=Header(table.header.names, tuple(units), table.header.sources))
    builder = LogBuilder(file, FORMAT.name)
    builder.metadata += [
        (row[0], ", ".join(row[1:])) for row in rows if row[0].lower() != "headers"
    ]
    return log_of_table(builder, table._replace(metadata=[]), time=names[0], factor=1.0)


def _units(header: Header) -> list[tuple[str, str]]:
    """Names and units; what is no axis of a sensor has none that the file states."""
    return [
        (name, unit if re.fullmatch("[AGM][xyz]", name) else "")
        for name, unit in zip(header.names, header.units, strict=True)
    ]


def _scales(rows: list[list[str]]) -> dict[str, tuple[float, str]]:
    """Return counts per unit, and the unit, by the first letter of the columns."""
    result: dict[str, tuple[float, str]] = {}
    if re.search(r"\bX16-", ", ".join(rows[0])):
        result["A"] = (_X16, "g")
    for row in rows:
        letter = _SENSORS.get(row[0].lower())
        if (
            letter
            and len(row) == 5
            and re.fullmatch(r"\d{1,9}(\.\d{1,9})?", row[2])
            and float(row[2])
        ):
            result[letter] = (float(row[2]), row[4])
    return result


FORMAT = Format("GCDC CSV", (".csv",), _recognises, _read)
