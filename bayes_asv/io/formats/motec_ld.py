"""MoTeC ``.ld``: a binary file with a linked list of channels, each with its own rate.

The layout is not published; what is used here is known from files and other readers.  All numbers
are little-endian.  The header begins with 0x40 and holds at byte 8 the place of the first channel.
A channel is a record of 84 bytes or more:

======= ======== =============================================================
byte    type     content
======= ======== =============================================================
0, 4    uint32   place of the previous and of the next channel, 0 for none
8, 12   uint32   place of the data, number of readings
18, 20  uint16   kind (7 float; 0, 3, 5 integer), bytes a reading
22      uint16   rate, Hz
24 – 31 4 int16  shift, multiplier, scale, decimals
32      32 bytes name
64      8 bytes  short name
72      12 bytes unit
======= ======== =============================================================

A value is (raw / scale · 10^−decimals + shift) · multiplier.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.log import MAX_CHANNELS
from bayes_asv.io.formats.format import Format, LogBuilder, listed

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import LogFile

__all__ = ["FORMAT"]

_CHANNEL: Final = struct.Struct("<IIII2xHHHhhhh32s8s12s")
_FLOAT: Final = 7
_INTEGER: Final = (0, 3, 5)
_DTYPES: Final = {(True, 2): "<f2", (True, 4): "<f4", (False, 2): "<i2", (False, 4): "<i4"}
# Place and length of texts in the header.
_HEADER: Final = {
    "date": (0x5E, 16), "time": (0x7E, 16), "driver": (0x9E, 64), "vehicle": (0xDE, 64),
    "venue": (0x15E, 64), "comment": (0x624, 64),
}  # fmt: skip


class _Channel(NamedTuple):
    previous: int
    next: int
    data: int
    readings: int
    kind: int
    size: int
    rate: int
    shift: int
    multiplier: int
    scale: int
    decimals: int
    name: bytes
    short_name: bytes
    unit: bytes


def _recognises(head: bytes) -> bool:
    return head.startswith(b"\x40\0\0\0") and len(head) > 0x70 and head[4:8] == b"\0\0\0\0"


def _read(file: LogFile) -> Log:
    builder = LogBuilder(file, FORMAT.name)
    for key, (place, length) in _HEADER.items():
        builder.metadata.append((key, _text(file.data[place : place + length])))
    builder.metadata = [(key, value) for key, value in builder.metadata if value]
    unknown = []
    for channel in _channels(file):
        name = _text(channel.name) or _text(channel.short_name)
        builder.reserve(min(channel.readings, len(file.data) // 2))
        values = _values(channel, file)
        if values is None or not channel.rate:
            unknown.append(name)
            continue
        builder.add_uniform(name, _text(channel.unit), channel.rate, values)
        if values.size < channel.readings:
            builder.warnings.append(
                f"{name} ends after {values.size} of {channel.readings} readings; the file is cut"
            )
    if unknown:
        builder.warnings.append(f"channels of an unknown type were left out: {listed(unknown)}")
    return builder.build()


def _channels(file: LogFile) -> list[_Channel]:
    """Follow the linked list of channels."""
    data = file.data
    channels: list[_Channel] = []
    place = int.from_bytes(data[8:12], "little")
    seen: set[int] = set()
    while place:
        if place in seen or place + _CHANNEL.size > len(data) or len(seen) >= MAX_CHANNELS:
            if channels and place not in seen:
                break  # the file is cut short within the list
            raise InputError(file.source, "has a damaged list of channels", "copy it again")
        seen.add(place)
        channels.append(_Channel(*_CHANNEL.unpack_from(data, place)))
        place = channels[-1].next
    return channels


def _values(channel: _Channel, file: LogFile) -> NDArray[np.float64] | None:
    """Return the readings in the unit of the channel, or None for an unknown type."""
    known = channel.kind == _FLOAT or channel.kind in _INTEGER
    dtype = _DTYPES.get((channel.kind == _FLOAT, channel.size)) if known else None
    if dtype is None or channel.scale == 0 or abs(channel.decimals) > 15:
        return None
    count = max(0, min(channel.readings, (len(file.data) - channel.data) // channel.size))
    raw = np.frombuffer(file.data, dtype, count, channel.data if count else 0)
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = raw.astype(np.float64) / channel.scale * 10.0**-channel.decimals
        result: NDArray[np.float64] = (scaled + channel.shift) * channel.multiplier
    return result


def _text(data: bytes) -> str:
    return data.split(b"\0", 1)[0].decode("cp1252", errors="replace").strip()


FORMAT = Format("MoTeC .ld", (".ld",), _recognises, _read)
