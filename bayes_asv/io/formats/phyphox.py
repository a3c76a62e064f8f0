"""phyphox: quoted names with units in a CSV, or a zip of such files, one a sensor.

The header of each is ``"Time (s)","Acceleration x (m/s^2)"``; the app writes commas, semicolons or
tabs with a decimal point or a decimal comma.  The zip has a folder ``meta`` with keys and values.
"""

from __future__ import annotations

import io
import re
import zipfile
from typing import TYPE_CHECKING, Final

from bayes_asv.domain.errors import InputError
from bayes_asv.io.formats.format import Format, LogBuilder, library
from bayes_asv.io.formats.table import decode_text, first_line, read_table
from bayes_asv.io.formats.table_log import add_table, log_of_table
from bayes_asv.io.text import MAX_FILE_SIZE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import LogFile

__all__ = ["FORMAT", "ZIP_FORMAT"]

_HEADER: Final = re.compile(r'"[^"]*\btime[^"]*\(s\)"([,;\t]"[^"]*\([^"]*\)")+', re.IGNORECASE)
_MAX_TABLES: Final = 200


def _recognises(head: bytes) -> bool:
    return _HEADER.fullmatch(first_line(head)) is not None


def _read(file: LogFile) -> Log:
    table = read_table(decode_text(file.data, file.source), file.source)
    return log_of_table(LogBuilder(file, FORMAT.name), table)


def _recognises_zip(head: bytes) -> bool:
    # The name of the first member follows 30 bytes of header.
    if not head.startswith(b"PK\x03\x04") or len(head) < 30:
        return False
    name = head[30 : 30 + int.from_bytes(head[26:28], "little")]
    return name.lower().endswith((b".csv", b".txt"))


def _read_zip(file: LogFile) -> Log:
    builder = LogBuilder(file, ZIP_FORMAT.name)
    for name, data in _members(file):
        folder, _, base = name.rpartition("/")
        text = decode_text(data, f"{file.source}/{name}")
        if folder == "meta" or folder.endswith("/meta"):
            builder.metadata += _properties(text)
        elif text.strip():
            table = read_table(text, f"{file.source}/{name}")
            add_table(builder, table, group=base.rpartition(".")[0])
    return builder.build()


def _members(file: LogFile) -> Iterator[tuple[str, bytes]]:
    with library(file, ZIP_FORMAT):
        archive = zipfile.ZipFile(io.BytesIO(file.data))
        members = [
            one for one in archive.infolist() if one.filename.lower().endswith((".csv", ".txt"))
        ]
    size = sum(one.file_size for one in members)
    if size > MAX_FILE_SIZE or len(members) > _MAX_TABLES:
        raise InputError(
            file.source, f"holds {len(members)} tables of {size} bytes", "unzip it and choose one"
        )
    for one in members:
        with library(file, ZIP_FORMAT):
            data = archive.read(one)
        yield one.filename, data


def _properties(text: str) -> Iterator[tuple[str, str]]:
    for line in text.splitlines()[1:]:
        cells = [cell.strip('"') for cell in re.split('[,;\t](?=")', line)]
        if len(cells) > 1 and cells[1] not in ("", "null"):
            yield cells[0], " ".join(cells[1:])


FORMAT = Format("phyphox CSV", (".csv",), _recognises, _read)
ZIP_FORMAT = Format("zip of CSV files, as phyphox writes", (".zip",), _recognises_zip, _read_zip)
