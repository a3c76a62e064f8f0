"""Frames of the logger's serial line: COBS, CRC-16, addresses and kinds (firmware/PROTOCOL.md).

Pure: bytes in, frames out. What does not decode or fails its CRC is no frame.
"""

from __future__ import annotations

import struct
from binascii import crc_hqx
from enum import IntEnum
from typing import Final, NamedTuple

__all__ = [
    "LONGEST_BODY",
    "REPLY",
    "Address",
    "Frame",
    "Kind",
    "Result",
    "State",
    "decoded",
    "encoded",
    "stuffed",
    "unstuffed",
]

LONGEST_BODY: Final = 31
"""Bytes of the longest body: three of head, 26 of payload, two of CRC."""
REPLY: Final = 0x80
"""This bit of a kind says that the frame is a reply."""

_SHORTEST_BODY: Final = 5
_CRC_START: Final = 0xFFFF
_LONGEST_RUN: Final = 254  # bytes that one code byte can stand for


class Address(IntEnum):
    """Who sends and who is meant."""

    LAPTOP = 0
    SLAVE_1 = 1
    SLAVE_2 = 2
    MASTER = 3


class Kind(IntEnum):
    """What a frame is; commands go from the laptop to Slave 1."""

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
    """One frame without its CRC.

    Attributes
    ----------
    to, sender : int
        `Address` of either end.
    kind : int
        `Kind`, with `REPLY` in a reply.
    seq : int
        0 to 255.
    payload : bytes
        0 to 26 bytes.
    """

    to: int
    sender: int
    kind: int
    seq: int
    payload: bytes = b""


def stuffed(data: bytes) -> bytes:
    """Return data without zero bytes (COBS: Cheshire and Baker 1999, IEEE/ACM Trans. Netw. 7:2).

    A code byte n stands before n - 1 bytes that are not zero, and for a zero after them unless it
    is 255 or the last.
    """
    out = bytearray(b"\0")
    code = 0  # place of the code byte that is being counted
    for byte in data:
        if byte and len(out) - code == _LONGEST_RUN + 1:
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


def unstuffed(data: bytes) -> bytes | None:
    """Reverse `stuffed`; None where the data cannot come from it."""
    out, place = bytearray(), 0
    while place < len(data):
        code = data[place]
        end = place + code
        if code == 0 or end > len(data) or 0 in data[place + 1 : end]:
            return None
        out += data[place + 1 : end]
        if code != 255 and end < len(data):
            out.append(0)
        place = end
    return bytes(out)


def encoded(frame: Frame) -> bytes:
    """Return a frame as it goes on the serial line, its zero byte at the end."""
    body = bytes((frame.to << 4 | frame.sender, frame.kind, frame.seq)) + frame.payload
    return stuffed(body + struct.pack("<H", crc_hqx(body, _CRC_START))) + b"\0"


def decoded(chunk: bytes) -> Frame | None:
    """Return the frame between two zero bytes of the line; None when it is none or spoilt.

    CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, not reflected.
    """
    body = unstuffed(chunk)
    if body is None or not _SHORTEST_BODY <= len(body) <= LONGEST_BODY:
        return None
    if crc_hqx(body[:-2], _CRC_START) != int.from_bytes(body[-2:], "little"):
        return None
    return Frame(body[0] >> 4, body[0] & 0x0F, body[1], body[2], body[3:-2])
