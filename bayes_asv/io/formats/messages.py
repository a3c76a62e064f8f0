"""Logs of messages: ROS 1 and 2 bags by the package rosbags, MCAP by mcap and its decoders.

Each number of a message is a channel named by the path to it, with the topic as its source.  Its
stamp is that of the message's header, when the sensor was read, or else the time of the log.
"""

from __future__ import annotations

import io
import json
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.log import MAX_CHANNELS
from bayes_asv.domain.recording import MAX_SAMPLES
from bayes_asv.io.formats.format import Format, LogBuilder, library, listed

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import LogFile

__all__ = ["BAG", "BAG_2", "MCAP"]

_MAX_DEPTH: Final = 8
_MAX_ELEMENTS: Final = 36  # the covariance of a pose; longer arrays are images and clouds


def _read_bag(file: LogFile) -> Log:
    form = BAG if _is_bag(file.data[:HEAD_LENGTH]) else BAG_2
    with library(file, form):
        highlevel, typesys = import_module("rosbags.highlevel"), import_module("rosbags.typesys")
        path = Path(file.source)
        if form is BAG_2 and path.suffix != ".db3":
            raise InputError(file.source, "is an SQLite file", "name it .db3 if it is a ROS 2 bag")
        store = typesys.get_typestore(typesys.Stores.LATEST)
        with highlevel.AnyReader([path], default_typestore=store) as reader:
            return _log(
                LogBuilder(file, form.name),
                (
                    (one.topic, stamp, reader.deserialize(raw, one.msgtype))
                    for one, stamp, raw in reader.messages()
                ),
            )


def _read_mcap(file: LogFile) -> Log:
    factories: list[Any] = [_Json()]
    for name in ("mcap_ros1", "mcap_ros2", "mcap_protobuf"):
        if find_spec(name) is not None:
            factories.append(import_module(f"{name}.decoder").DecoderFactory())
    builder = LogBuilder(file, MCAP.name)
    skipped: set[str] = set()
    with library(file, MCAP):
        log = _log(builder, _mcap_messages(import_module("mcap.reader"), factories, file, skipped))
    if skipped:
        words = f"topics in an unknown encoding were left out: {listed(sorted(skipped))}"
        log = replace(log, warnings=(*log.warnings, words))
    return log


def _mcap_messages(
    reader: Any, factories: list[Any], file: LogFile, skipped: set[str]
) -> Iterator[tuple[str, int, Any]]:
    decoders: dict[int, Any] = {}
    stream = reader.make_reader(io.BytesIO(file.data))
    for schema, channel, message in stream.iter_messages(log_time_order=False):
        if channel.id not in decoders:
            made = (one.decoder_for(channel.message_encoding, schema) for one in factories)
            decoders[channel.id] = next((one for one in made if one is not None), None)
        decoder = decoders[channel.id]
        if decoder is None:
            skipped.add(channel.topic)
        else:
            yield channel.topic, message.log_time, decoder(message.data)


class _Json:
    """Decoder of messages in JSON, in the manner of the package mcap."""

    def decoder_for(self, encoding: str, schema: Any) -> Any:
        return json.loads if encoding == "json" else None


def _log(builder: LogBuilder, messages: Iterator[tuple[str, int, Any]]) -> Log:
    """Collect the numbers of messages (topic, stamp in ns, content) by topic and path."""
    columns: dict[tuple[str, str], tuple[list[int], list[float]]] = {}
    count = 0
    start: int | None = None
    for topic, logged, message in messages:
        stamp = _header_stamp(message) or logged
        if start is None:
            start = stamp
        for path, value in _numbers(message, "", 0):
            column = columns.setdefault((topic, path), ([], []))
            column[0].append(stamp - start)
            column[1].append(value)
            count += 1
        if count > MAX_SAMPLES or len(columns) > MAX_CHANNELS:
            builder.reserve(count)
            raise InputError(
                builder.file.source, f"has more than {MAX_CHANNELS} numbers in its messages",
                "record the topics of the sensors alone",
            )  # fmt: skip
    for (topic, path), (stamps, values) in columns.items():
        time = np.array(stamps, dtype=np.float64) * 1e-9
        order = np.argsort(time, kind="stable")
        builder.add(path, "", time[order], np.array(values)[order], topic)
    return builder.build()


def _header_stamp(message: Any) -> int | None:
    """Stamp in the header of a message, ns since 1970; None if there is none or it is zero."""
    header = _field(message, "header")
    stamp = _field(header if header is not None else message, "stamp") or _field(
        message, "timestamp"
    )
    for whole, part in (
        ("sec", "nanosec"),
        ("secs", "nsecs"),
        ("seconds", "nanos"),
        ("sec", "nsec"),
    ):
        seconds, rest = _field(stamp, whole), _field(stamp, part)
        if isinstance(seconds, int) and isinstance(rest, int):
            return (seconds * 1_000_000_000 + rest) or None
    return None


def _field(message: Any, name: str) -> Any:
    return message.get(name) if isinstance(message, dict) else getattr(message, name, None)


def _numbers(value: Any, path: str, depth: int) -> Iterator[tuple[str, float]]:
    """Numbers of a message with the path to each."""
    if isinstance(value, bool | int | float | np.number):
        yield path, float(value)
    elif isinstance(value, str | bytes) or value is None or depth > _MAX_DEPTH:
        return
    elif isinstance(value, np.ndarray | list | tuple) or (
        hasattr(value, "__getitem__") and not isinstance(value, dict)
    ):
        if len(value) <= _MAX_ELEMENTS:
            for place, one in enumerate(value):
                yield from _numbers(one, f"{path}[{place}]", depth + 1)
    else:
        for name, one in _fields(value):
            if name not in ("header", "timestamp", "stamp"):
                yield from _numbers(one, f"{path}.{name}" if path else name, depth + 1)


def _fields(message: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(message, dict):
        yield from message.items()
        return
    if hasattr(message, "DESCRIPTOR"):  # protobuf
        names = [field.name for field in message.DESCRIPTOR.fields]
    else:
        names = list(getattr(message, "__slots__", None) or vars(message))
    for name in names:
        if not name.startswith("_"):
            yield name, getattr(message, name)


HEAD_LENGTH: Final = 64


def _is_bag(head: bytes) -> bool:
    return head.startswith(b"#ROSBAG V2.0")


def _is_bag_2(head: bytes) -> bool:
    return head.startswith(b"SQLite format 3\0")


def _is_mcap(head: bytes) -> bool:
    return head.startswith(b"\x89MCAP0\r\n")


BAG = Format("ROS bag", (".bag",), _is_bag, _read_bag, "rosbags")
BAG_2 = Format("ROS 2 bag", (".db3",), _is_bag_2, _read_bag, "rosbags")
MCAP = Format("MCAP", (".mcap",), _is_mcap, _read_mcap, "mcap")
