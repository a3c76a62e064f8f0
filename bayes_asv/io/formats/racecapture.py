"""RaceCapture logs: a header cell is ``"Name"|"unit"|min|max|rate``, most cells are empty.

The logger appends to an open file and may write its header again.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bayes_asv.domain.errors import InputError
from bayes_asv.io.formats.format import Format, LogBuilder
from bayes_asv.io.formats.header import Header
from bayes_asv.io.formats.table import decode_text, read_table
from bayes_asv.io.formats.table_log import log_of_table

if TYPE_CHECKING:
    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import LogFile

__all__ = ["FORMAT"]


def _recognises(head: bytes) -> bool:
    cells = head.lstrip(b"\xef\xbb\xbf \r\n").split(b"\n", 1)[0].split(b",")
    return len(cells) > 1 and all(cell.count(b"|") >= 2 for cell in cells)


def _read(file: LogFile) -> Log:
    text = decode_text(file.data, file.source)
    headers = {line.strip() for line in text.split("\n") if line.count("|") >= 4}
    if len(headers) > 1:
        raise InputError(
            file.source, "holds runs with different channels", "split it before each header line"
        )
    cells = [cell.replace('"', "").split("|") for cell in headers.pop().split(",")]
    header = Header(
        tuple(cell[0].strip() for cell in cells),
        tuple(cell[1].strip() if len(cell) > 1 else "" for cell in cells),
    )
    builder = LogBuilder(file, FORMAT.name)
    for name, rate in zip(header.names, (cell[-1] for cell in cells), strict=True):
        builder.metadata.append((f"rate {name}", f"{rate.strip()} Hz"))
    return log_of_table(builder, read_table(text, file.source, header)._replace(metadata=[]))


FORMAT = Format("RaceCapture log", (".log", ".csv"), _recognises, _read)
