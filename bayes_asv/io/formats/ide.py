"""enDAQ and Mide ``.IDE`` by the package idelib; each sensor has its own rate."""

from __future__ import annotations

import io
from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np

from bayes_asv.io.formats.format import Format, LogBuilder, library

if TYPE_CHECKING:
    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import LogFile

__all__ = ["FORMAT"]


def _recognises(head: bytes) -> bool:
    return head.startswith(b"\x1a\x45\xdf\xa3") and b"mide" in head[:64]


def _read(file: LogFile) -> Log:
    builder = LogBuilder(file, FORMAT.name)
    with library(file, FORMAT):
        importer = import_module("idelib.importer")
        dataset = importer.openFile(io.BytesIO(file.data), quiet=True, name=file.source)
        importer.readData(dataset)
        builder.metadata += list(dataset.recorderInfo.items())
        for channel in dataset.channels.values():
            events = channel.getSession()
            if not len(events):
                continue
            builder.reserve(len(events) * len(channel.subchannels))
            table = np.asarray(events.arraySlice(), dtype=np.float64)
            time = table[0] * 1e-6  # microseconds since the recorder was started
            for row, one in enumerate(channel.subchannels, 1):
                unit = one.units[1] if one.units else ""
                builder.add(one.displayName, unit or "", time, table[row], channel.name)
    return builder.build()


FORMAT = Format("enDAQ IDE", (".ide",), _recognises, _read, "idelib")
