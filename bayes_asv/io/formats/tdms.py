"""LabVIEW TDMS by the package npTDMS: the properties of a channel give its increment and unit."""

from __future__ import annotations

import io
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_asv.domain.errors import InputError
from bayes_asv.io.formats.format import Format, LogBuilder, library, listed
from bayes_asv.io.formats.stamps import time_factor

if TYPE_CHECKING:
    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import LogFile

__all__ = ["FORMAT"]


def _recognises(head: bytes) -> bool:
    return head.startswith(b"TDSm")


def _read(file: LogFile) -> Log:
    builder = LogBuilder(file, FORMAT.name)
    left_out: list[str] = []
    with library(file, FORMAT):
        nptdms = import_module("nptdms")
        described = nptdms.TdmsFile.read_metadata(io.BytesIO(file.data))
        builder.reserve(sum(len(one) for group in described.groups() for one in group.channels()))
        tdms = nptdms.TdmsFile.read(io.BytesIO(file.data))
        builder.metadata += list(tdms.properties.items())
        if tdms.file_status.incomplete_final_segment:
            builder.warnings.append(
                "the file is cut short; its last part was read as far as it goes"
            )
        for group in tdms.groups():
            _add_group(builder, group, left_out)
    if left_out:
        builder.warnings.append(
            f"channels without an increment or a channel of time were left out: {listed(left_out)}"
        )
    if left_out and not builder.has_channels:
        raise InputError(
            file.source, "has no increment and no channel of time", "give the rate (--rate 400)"
        )
    return builder.build()


def _add_group(builder: LogBuilder, group: Any, left_out: list[str]) -> None:
    channels = {one.name: np.asarray(one[:]) for one in group.channels()}
    stamps = next((name for name in channels if name.strip().lower() in _TIME_NAMES), None)
    for channel in group.channels():
        values, properties = channels[channel.name], channel.properties
        if values.dtype.kind not in "iufb" or channel.name == stamps:
            continue
        unit = str(properties.get("unit_string", ""))
        increment = properties.get("wf_increment")
        if increment is not None and float(increment) > 0:
            offset = float(properties.get("wf_start_offset", 0.0))
            rate = 1.0 / float(increment)
            builder.add_uniform(channel.name, unit, rate, values, group.name, offset)
        elif stamps is not None and channels[stamps].size == values.size:
            time = _seconds(channels[stamps], group[stamps].properties.get("unit_string", ""))
            builder.add(channel.name, unit, time, values, group.name)
        elif builder.file.rate is not None:
            builder.add_uniform(channel.name, unit, builder.file.rate, values, group.name)
        else:
            left_out.append(channel.name)


_TIME_NAMES = frozenset({"time", "timestamp", "t", "zeit", "time (s)", "time [s]"})


def _seconds(stamps: Any, unit: str) -> Any:
    if stamps.dtype.kind == "M":
        return (stamps - stamps[0]) / np.timedelta64(1, "s")
    return stamps.astype(np.float64) * (time_factor(str(unit)) or 1.0)


FORMAT = Format("LabVIEW TDMS", (".tdms",), _recognises, _read, "nptdms")
