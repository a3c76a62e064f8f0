"""Racelogic VBOX text: sections ``[header]``, ``[channel units]``, ``[column names]``, ``[data]``.

Names in ``[header]`` may end with a unit ("velocity kmh"); the units of the last channels stand in
``[channel units]``, which may be shorter than the list of channels.  Time is the time of day as
HHMMSS.SS; latitude and longitude are minutes of arc, west positive, and stay so.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bayes_asv.domain.errors import InputError
from bayes_asv.io.formats.format import Format, LogBuilder
from bayes_asv.io.formats.header import Header
from bayes_asv.io.formats.stamps import past_midnight
from bayes_asv.io.formats.table import decode_text, read_table
from bayes_asv.io.formats.table_log import log_of_table
from bayes_asv.io.formats.unit_words import is_unit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import LogFile

__all__ = ["FORMAT"]


def _recognises(head: bytes) -> bool:
    lines = {line.strip().lower() for line in head.split(b"\n")}
    return b"[header]" in lines and bool(lines & {b"[column names]", b"[data]"})


def _read(file: LogFile) -> Log:
    sections = _sections(decode_text(file.data, file.source))
    if "data" not in sections:
        raise InputError(file.source, "has no section [data]", "copy it again")
    titles = sections.get("header", [])
    names = " ".join(sections.get("column names", [])).split() or titles
    table = read_table(
        "\n".join(sections["data"]),
        file.source,
        Header(tuple(names), _units(titles, names, sections)),
    )
    header = table.header
    time = next((i for i, name in enumerate(header.names) if name.lower() == "time"), None)
    if time is None or len(names) != len(header.names):
        raise InputError(
            file.source, f"names {len(names)} columns with time among them, "
            f"its data have {len(header.names)}", "export it again",
        )  # fmt: skip
    table.columns[time] = past_midnight(_seconds_of_day(table.columns[time]))
    builder = LogBuilder(file, FORMAT.name)
    for line in [*sections.get("", []), *sections.get("comments", [])]:
        key, _, value = line.partition(": ")
        builder.metadata.append((key, value) if value else ("comment", line))
    return log_of_table(builder, table._replace(metadata=[]), time=header.names[time], factor=1.0)


def _sections(text: str) -> dict[str, list[str]]:
    """Lines that are not blank, by section; those before the first section under ''."""
    result: dict[str, list[str]] = {"": []}
    lines = result[""]
    for raw in text.splitlines():
        line = raw.strip()
        if line.startswith("[") and line.endswith("]"):
            lines = result.setdefault(line[1:-1].strip().lower(), [])
        elif line:
            lines.append(line)
    return result


def _units(titles: list[str], names: list[str], sections: dict[str, list[str]]) -> tuple[str, ...]:
    if len(titles) != len(names):
        return ()
    words = [title.rsplit(None, 1) for title in titles]
    units = [pair[1] if len(pair) == 2 and is_unit(pair[1]) else "" for pair in words]
    listed = sections.get("channel units", [])[-len(units) :]
    for place, unit in enumerate(listed, len(units) - len(listed)):
        units[place] = units[place] or ("" if unit == "(null)" else unit)
    return tuple(units)


def _seconds_of_day(time: NDArray[np.float64]) -> NDArray[np.float64]:
    hours, rest = np.divmod(time, 10_000.0)
    minutes, seconds = np.divmod(rest, 100.0)
    return 3600.0 * hours + 60.0 * minutes + np.round(seconds, 6)


FORMAT = Format("VBOX", (".vbo",), _recognises, _read)
