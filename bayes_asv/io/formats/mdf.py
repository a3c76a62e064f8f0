"""ASAM MDF 3 and 4 by the package asammdf; the channels of a group share its stamps."""

from __future__ import annotations

import io
from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np

from bayes_asv.io.formats.format import Format, LogBuilder, library, listed

if TYPE_CHECKING:
    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import LogFile

__all__ = ["FORMAT"]


def _recognises(head: bytes) -> bool:
    return head.startswith((b"MDF     ", b"UnFinMF "))


def _read(file: LogFile) -> Log:
    builder = LogBuilder(file, FORMAT.name)
    text = []
    with library(file, FORMAT):
        mdf = import_module("asammdf").MDF(io.BytesIO(file.data))
        cycles = [group.channel_group.cycles_nr for group in mdf.groups]
        builder.reserve(
            sum(n * len(group.channels) for n, group in zip(cycles, mdf.groups, strict=True))
        )
        builder.metadata.append(("start", mdf.start_time))
        for number, group in enumerate(mdf.groups):
            if cycles[number] == 0:
                continue
            master = mdf.masters_db.get(number)
            for index, channel in enumerate(group.channels):
                if index == master:
                    continue
                signal = mdf.get(group=number, index=index, ignore_invalidation_bits=False)
                samples = np.asarray(signal.samples)
                if samples.ndim != 1 or samples.dtype.kind not in "iufb":
                    text.append(channel.name)
                    continue
                time = np.asarray(signal.timestamps, dtype=np.float64)
                source = group.channel_group.acq_name if mdf.version >= "4.00" else ""
                builder.add(
                    channel.name, signal.unit or "", time, samples, source or f"group {number + 1}"
                )
    if text:
        builder.warnings.append(f"channels that are no numbers were left out: {listed(text)}")
    return builder.build()


FORMAT = Format("MDF", (".mf4", ".mdf", ".dat"), _recognises, _read, "asammdf")
