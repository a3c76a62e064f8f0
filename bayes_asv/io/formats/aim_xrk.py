"""AiM ``.xrk`` and ``.xrz`` by the package libxrk; each channel has its own stamps, ms.

Of the two parsers of the package the one in Rust is taken: the other fails on files without GPS.
"""

from __future__ import annotations

import zlib
from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np

from bayes_asv.io.formats.format import Format, LogBuilder, library

if TYPE_CHECKING:
    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import LogFile

__all__ = ["FORMAT"]


def _recognises(head: bytes) -> bool:
    """Whether it begins with an AiM message; an xrz is that, compressed by zlib."""
    if head.startswith(b"<h"):
        return True
    if head[:1] != b"\x78":
        return False
    try:
        return zlib.decompressobj().decompress(head, 64).startswith(b"<h")
    except zlib.error:
        return False


def _read(file: LogFile) -> Log:
    builder = LogBuilder(file, FORMAT.name)
    with library(file, FORMAT):
        log = import_module("libxrk._aim_xrk_rs").aim_xrk(file.data)
        builder.metadata += [(key, value) for key, value in log.metadata.items()]
        for name, table in log.channels.items():
            builder.reserve(table.num_rows)
            units = (table.schema.field(name).metadata or {}).get(b"units", b"")
            time = table.column("timecodes").to_numpy() / 1000.0
            values = np.asarray(table.column(name).to_numpy(), dtype=np.float64)
            builder.add(name, units.decode("utf-8", "replace"), time, values)
    return builder.build()


FORMAT = Format("AiM .xrk", (".xrk", ".xrz"), _recognises, _read, "libxrk", "aim")
