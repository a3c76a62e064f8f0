"""Sufni suspension telemetry ``.SST``: travel sensors of fork and shock, little-endian.

Versions up to 3: ``SST``, version, rate (uint16), padding, Unix time (int64), then pairs of uint16.
Version 4: ``SST``, version, padding (4 bytes), Unix time (int64), then chunks of a type (uint8), a
length (uint16) and data: the rates, travel, and inertial units with their counts per g and per
deg/s.  Travel is in counts of the angle sensor, 4096 a turn; 65535 throughout means none.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final

import numpy as np

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.log import utc
from bayes_asv.io.formats.format import Format, LogBuilder

if TYPE_CHECKING:
    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import LogFile

__all__ = ["FORMAT"]

_HEADER: Final = 16
_RATES, _TRAVEL, _IMU, _IMU_META = 0, 1, 3, 4
_ABSENT: Final = 0xFFFF
_PLACES: Final = ("frame", "fork", "rear")
_PARTS: Final = {_RATES: 3, _TRAVEL: 4, _IMU: 12, _IMU_META: 9}  # bytes of a record


def _recognises(head: bytes) -> bool:
    return head.startswith(b"SST") and len(head) > _HEADER and 1 <= head[3] <= 9


def _read(file: LogFile) -> Log:
    if len(file.data) < _HEADER:
        raise InputError(file.source, "is shorter than the header of an SST file", "copy it again")
    builder = LogBuilder(file, FORMAT.name)
    version = file.data[3]
    start = utc(float(struct.unpack_from("<q", file.data, 8)[0]))
    builder.metadata += [("version", version), ("start", start or "")]
    if version <= 3:
        rate = struct.unpack_from("<H", file.data, 4)[0]
        _add_travel(builder, rate, file.data[_HEADER:])
    else:
        _add_chunks(builder, file)
    return builder.build()


def _add_travel(builder: LogBuilder, rate: float, data: bytes) -> None:
    pairs = np.frombuffer(data, "<u2", len(data) // 4 * 2).reshape(-1, 2)
    for name, counts in zip(("fork", "shock"), pairs.T, strict=True):
        if counts.size and not (counts == _ABSENT).all():
            builder.add_uniform(name, "counts", rate, counts)


def _add_chunks(builder: LogBuilder, file: LogFile) -> None:
    data = file.data
    parts: dict[int, list[bytes]] = {}
    place = _HEADER
    while place + 3 <= len(data):
        kind, length = struct.unpack_from("<BH", data, place)
        parts.setdefault(kind, []).append(data[place + 3 : place + 3 + length])
        place += 3 + length
    chunks = {kind: b"".join(parts.get(kind, ())) for kind in _PARTS}
    if place != len(data):
        builder.warnings.append("the last part of the file is cut short")
    rates = dict(struct.iter_unpack("<BH", _whole(chunks[_RATES], _PARTS[_RATES])))
    if chunks[_TRAVEL]:
        _add_travel(builder, rates.get(_TRAVEL, 0), chunks[_TRAVEL])
    meta = list(struct.iter_unpack("<Bff", _whole(chunks[_IMU_META], _PARTS[_IMU_META])))
    if chunks[_IMU] and meta:
        data = _whole(chunks[_IMU], _PARTS[_IMU] * len(meta))
        table = np.frombuffer(data, "<i2").reshape(-1, len(meta), 6)
        for unit, (place, per_g, per_dps) in enumerate(meta):
            name = _PLACES[place] if place < len(_PLACES) else f"sensor {place}"
            for axis, label in enumerate(("ax", "ay", "az", "gx", "gy", "gz")):
                scale, words = (per_g, "g") if axis < 3 else (per_dps, "deg/s")
                if scale > 0:
                    values = table[:, unit, axis] / scale
                    builder.add_uniform(label, words, rates.get(_IMU, 0), values, name)


def _whole(data: bytes, size: int) -> bytes:
    return data[: len(data) // size * size]


FORMAT = Format("Sufni SST", (".SST",), _recognises, _read)
