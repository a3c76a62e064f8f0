"""RaceChrono CSV, versions 2 and 3.

Both begin with the line "This file is created using RaceChrono".  Version 3 has rows of names,
units and sources; version 2 has names such as ``Speed (m/s) *gps``.  Names repeat, one source each.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bayes_asv.io.formats.format import Format, LogBuilder
from bayes_asv.io.formats.motec_csv import COMMON_RATE
from bayes_asv.io.formats.table import decode_text, read_table
from bayes_asv.io.formats.table_log import log_of_table

if TYPE_CHECKING:
    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import LogFile

__all__ = ["FORMAT"]


def _recognises(head: bytes) -> bool:
    return b"created using RaceChrono" in head[:200]


def _read(file: LogFile) -> Log:
    table = read_table(decode_text(file.data, file.source), file.source)
    builder = LogBuilder(file, FORMAT.name)
    if not any(np.isnan(column).any() for column in table.columns):
        builder.warnings.append(COMMON_RATE)
    return log_of_table(builder, table)


FORMAT = Format("RaceChrono CSV", (".csv",), _recognises, _read)
