"""AiM Race Studio 2 and 3 CSV: a block of keys and values, then names, units and numbers.

The first line is ``"Format","AIM CSV File"``.  The export has one common rate, as that of MoTeC.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bayes_asv.io.formats.format import Format, LogBuilder
from bayes_asv.io.formats.motec_csv import COMMON_RATE
from bayes_asv.io.formats.table import decode_text, first_cells, read_table
from bayes_asv.io.formats.table_log import log_of_table

if TYPE_CHECKING:
    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import LogFile

__all__ = ["FORMAT"]


def _recognises(head: bytes) -> bool:
    return first_cells(head)[:2] == ["format", "aim csv file"]


def _read(file: LogFile) -> Log:
    builder = LogBuilder(file, FORMAT.name, [COMMON_RATE])
    return log_of_table(builder, read_table(decode_text(file.data, file.source), file.source))


FORMAT = Format("AiM Race Studio CSV", (".csv",), _recognises, _read)
