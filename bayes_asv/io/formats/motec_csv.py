"""MoTeC i2 CSV: a block of keys and values, then names, units and quoted numbers.

The first line is ``"Format","MoTeC CSV File"``.  The export has one common rate; i2 repeats or
interpolates channels that were logged more slowly.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bayes_asv.io.formats.format import Format, LogBuilder
from bayes_asv.io.formats.table import decode_text, first_cells, read_table
from bayes_asv.io.formats.table_log import log_of_table

if TYPE_CHECKING:
    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import LogFile

__all__ = ["FORMAT"]

COMMON_RATE = (
    "the export has one common rate; channels that were logged more slowly are repeated "
    "or interpolated in it"
)


def _recognises(head: bytes) -> bool:
    return first_cells(head)[:2] == ["format", "motec csv file"]


def _read(file: LogFile) -> Log:
    builder = LogBuilder(file, FORMAT.name, [COMMON_RATE])
    return log_of_table(builder, read_table(decode_text(file.data, file.source), file.source))


FORMAT = Format("MoTeC CSV", (".csv",), _recognises, _read)
