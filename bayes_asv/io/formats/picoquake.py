"""PicoQuake CSV: the rate is in a comment, and there is no time and no unit.

The columns are a count of samples, acceleration in g and angular rate in degrees per second.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from bayes_asv.domain.recording import parse_rate
from bayes_asv.io.formats.format import Format, LogBuilder
from bayes_asv.io.formats.header import Header
from bayes_asv.io.formats.table import decode_text, read_table
from bayes_asv.io.formats.table_log import log_of_table

if TYPE_CHECKING:
    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import LogFile

__all__ = ["FORMAT"]


def _recognises(head: bytes) -> bool:
    return b"PicoQuake Data" in head[:100]


def _read(file: LogFile) -> Log:
    text = decode_text(file.data, file.source)
    table = read_table(text, file.source)
    names = table.header.names
    units = tuple({"a": "g", "g": "deg/s"}.get(name.split("_")[0], "") for name in names)
    match = re.search(r"data_rate = ([\d.]{1,20} ?Hz)", text[:10_000])
    rate = parse_rate(match[1], file.source) if match else None
    table = table._replace(header=Header(names, units, table.header.sources))
    return log_of_table(LogBuilder(file, FORMAT.name), table, rate=rate)


FORMAT = Format("PicoQuake CSV", (".csv",), _recognises, _read)
