"""Frames of the logger's serial line: COBS, CRC-16, addresses and kinds (firmware/PROTOCOL.md)."""

from __future__ import annotations

import re
import struct
from binascii import crc_hqx
from enum import IntEnum
from typing import Final, NamedTuple

__all__ = [
    "MAX_BODY",
    "REPLY",
    "Address",
    "Frame",
    "Kind",
    "Result",
    "State",
    "StreamDecoder",
    "cobs_decode",
    "cobs_encode",
    "decode",
    "encode",
]

MAX_BODY: Final = 31
"""Bytes of the longest body: three of header, 26 of payload, two of CRC."""
REPLY: Final = 0x80
"""Bit of a kind that marks a reply."""

_MIN_BODY: Final = 5
_CRC_START: Final = 0xFFFF
_MAX_RUN: Final = 254  # bytes after one code byte
_MAX_CHUNK: Final = 128  # bytes; no frame (32) and no line (100) is longer
_LINE: Final = re.compile(rb"([\x20-\x7e]+)\r?\n")


class Address(IntEnum):
    """Sender or receiver."""

    LAPTOP = 0
    SLAVE_1 = 1
    SLAVE_2 = 2
    MASTER = 3


class Kind(IntEnum):
    """Kind of a frame; commands go from the laptop to Slave 1."""

    HELLO = 0x01
    CONFIG = 0x02
    START = 0x03
    TRIGGER = 0x04
    STOP = 0x05
    SEND = 0x06
    GET = 0x07
    DONE = 0x08
    STATUS = 0x09
    DUMP = 0x0A
    NAP = 0x0B
    HEARD = 0x0C
    BLOCK = 0x40
    EVENT = 0x41


class Result(IntEnum):
    """First byte of most replies."""

    DONE = 0
    NOT_NOW = 1
    BAD_VALUE = 2
    DIFFERS = 3
    NO_ANSWER = 4
    BUSY = 5


class State(IntEnum):
    """States of Slave 1."""

    STANDBY = 0
    SYNCHRONISING = 1
    ARMED = 2
    TAKING = 3
    CLOSING = 4
    WAITING = 5
    SENDING_FRONT = 6
    FETCHING = 7
    SENDING_REAR = 8
    STARTING = 9


class Frame(NamedTuple):
    """A frame without its CRC.

    Attributes
    ----------
    to, sender : int
        `Address` of either end.
    kind : int
        `Kind`, with `REPLY` in a reply.
    seq : int
        Sequence number, 0 to 255.
    payload : bytes
        0 to 26 bytes.
    """

    to: int
    sender: int
    kind: int
    seq: int
    payload: bytes = b""


def cobs_encode(data: bytes) -> bytes:
    """Encode data without zero bytes (COBS: Cheshire and Baker 1999, IEEE/ACM Trans. Netw. 7:2).

    A code byte n precedes n - 1 bytes that are not zero, and stands for a zero after them unless it
    is 255 or the last.
    """
    out = bytearray(b"\0")
    code = 0  # index of the current code byte
    for byte in data:
        if byte and len(out) - code == _MAX_RUN + 1:
            out[code] = 255
            code = len(out)
            out.append(0)
        if byte:
            out.append(byte)
        else:
            out[code] = len(out) - code
            code = len(out)
            out.append(0)
    out[code] = len(out) - code
    return bytes(out)


def cobs_decode(data: bytes) -> bytes | None:
    """Reverse `cobs_encode`; None for data that it cannot have produced."""
    out, start = bytearray(), 0
    while start < len(data):
        code = data[start]
        end = start + code
        if code == 0 or end > len(data) or 0 in data[start + 1 : end]:
            return None
        out += data[start + 1 : end]
        if code != 255 and end < len(data):
            out.append(0)
        start = end
    return bytes(out)


def encode(frame: Frame) -> bytes:
    """Return the bytes of a frame on the serial line, with the zero byte at its end."""
    body = bytes((frame.to << 4 | frame.sender, frame.kind, frame.seq)) + frame.payload
    return cobs_encode(body + struct.pack("<H", crc_hqx(body, _CRC_START))) + b"\0"


def decode(chunk: bytes) -> Frame | None:
    """Return the frame between two zero bytes of the line, or None if it is invalid.

    CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, not reflected.
    """
    body = cobs_decode(chunk)
    if body is None or not _MIN_BODY <= len(body) <= MAX_BODY:
        return None
    if crc_hqx(body[:-2], _CRC_START) != int.from_bytes(body[-2:], "little"):
        return None
    return Frame(body[0] >> 4, body[0] & 0x0F, body[1], body[2], body[3:-2])


class StreamDecoder:
    """Converts the bytes of the serial line, in any chunks, to frames and lines of text.

    A zero byte ends a frame. Printable characters up to a line feed are a line: no frame to the
    laptop starts like that, since its address byte is not printable. All else is counted as
    corrupted.

    Attributes
    ----------
    corrupted : int
        Pieces that were neither frame nor line.
    """

    def __init__(self) -> None:
        self.corrupted = 0
        self._bytes = bytearray()

    def feed(self, data: bytes) -> list[Frame | str]:
        """Add bytes; return the frames and lines that are complete with them, in order."""
        self._bytes += data
        pieces: list[Frame | str] = []
        while self._bytes:
            line = _LINE.match(self._bytes)
            if line is not None:
                pieces.append(line[1].decode("ascii"))
                del self._bytes[: line.end()]
                continue
            end = self._bytes.find(0)
            if end < 0:
                if len(self._bytes) > _MAX_CHUNK:
                    self._resynchronise()
                    continue
                break
            if end > MAX_BODY + 1 and self._bytes.find(b"\n", 0, end) >= 0:
                self._resynchronise()  # no frame is as long: there are lines of text in it
                continue
            chunk = bytes(self._bytes[:end])
            del self._bytes[: end + 1]
            if chunk:
                pieces += self._decode(chunk)
        return pieces

    def _decode(self, chunk: bytes) -> list[Frame | str]:
        # Noise without a zero byte, such as half a line, may precede a frame; where the frame
        # starts is then unknown, and the chunk counts as corrupted.
        frame = decode(chunk) if len(chunk) <= MAX_BODY + 1 else None
        if frame is None:
            self.corrupted += 1
            return []
        return [frame]

    def _resynchronise(self) -> None:
        """Drop bytes that can be neither frame nor line, up to the next possible start."""
        self.corrupted += 1
        end = self._bytes.find(b"\n")
        del self._bytes[: end + 1 if end >= 0 else len(self._bytes)]
