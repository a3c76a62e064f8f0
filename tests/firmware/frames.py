"""Frames and blocks of ``firmware/PROTOCOL.md``, for tests of the firmware and of the package.

Written from the protocol alone and on purpose apart from ``bayes_asv.acquire``, so that the two can
be held against each other.
"""

from __future__ import annotations

import struct
import zlib
from binascii import crc_hqx
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

CPU = 4e6  # Hz, nominal
LAPTOP, SLAVE_1, SLAVE_2, MASTER = 0, 1, 2, 3
HELLO, CONFIG, START, TRIGGER, STOP, SEND, GET, DONE, STATUS, DUMP = range(1, 11)
NAP, HEARD, BLOCK, EVENT = 0x0B, 0x0C, 0x40, 0x41
(
    STANDBY,
    SYNCHRONISING,
    ARMED,
    TAKING,
    CLOSING,
    WAITING,
    SENDING_1,
    FETCHING,
    SENDING_2,
    STARTING,
) = range(10)
SHORTEST, LONGEST = 5, 31
ROWS_A_FRAME = 10
FIRST_ROWS = 3


# ---- frames ----


def cobs_encode(data: bytes) -> bytes:
    """Data without zero bytes, by consistent overhead byte stuffing (Cheshire and Baker 1999)."""
    out = bytearray()
    for run in data.split(b"\0"):
        for first in range(0, max(len(run), 1), 254):
            part = run[first : first + 254]
            out += bytes([len(part) + 1]) + part
    return bytes(out)


def cobs_decode(data: bytes) -> bytes | None:
    """The reverse of `cobs_encode`; None when the data cannot come from it."""
    out, place = bytearray(), 0
    while place < len(data):
        code = data[place]
        part = data[place + 1 : place + code]
        if code == 0 or len(part) != code - 1 or 0 in part:
            return None
        out += part
        place += code
        if code < 255 and place < len(data):
            out.append(0)
    return bytes(out)


@dataclass(frozen=True)
class Frame:
    """One frame's body without its checksum."""

    to: int
    sender: int
    kind: int
    seq: int
    payload: bytes = b""


def encode_body(frame: Frame) -> bytes:
    """A frame's body with its CRC-16/CCITT-FALSE."""
    body = bytes([frame.to << 4 | frame.sender, frame.kind, frame.seq]) + frame.payload
    return body + struct.pack("<H", crc_hqx(body, 0xFFFF))


def decode_body(body: bytes) -> Frame | None:
    """A frame from its body; None when it is no frame."""
    if not SHORTEST <= len(body) <= LONGEST:
        return None
    if crc_hqx(body[:-2], 0xFFFF) != struct.unpack("<H", body[-2:])[0]:
        return None
    return Frame(body[0] >> 4, body[0] & 15, body[1], body[2], body[3:-2])


# ---- blocks ----


@dataclass(frozen=True)
class Head:
    """Frame 0 of a block."""

    board: int
    run: int
    frames: int
    rows: int
    rate: int
    prescale: int
    cycles: int
    readings: int
    mode: int
    synch: int
    overruns: int
    saturated: int
    trigger_row: int
    crc: int

    FORMAT = "<BBBHHHHBBBHBHI"


@dataclass(frozen=True)
class Times:
    """Frame 1 of a block; ticks are `Head.prescale` CPU cycles."""

    wheel_delay: int
    chassis_delay: int
    lead: int
    first_row: int
    elapsed: int
    mark_row: int
    difference: int

    FORMAT = "<HHHIIIh"


@dataclass(frozen=True)
class Block:
    """A board's block, checked.

    Attributes
    ----------
    rows
        Shape (rows, 2): wheel and chassis in counts.
    """

    head: Head
    times: Times
    quality: bytes
    rows: NDArray[np.int64]

    def ticks(self, channel: int) -> NDArray[np.float64]:
        """Middle of each reading on the board's own clock, in ticks from the start mark."""
        delay = (self.times.wheel_delay, self.times.chassis_delay)[channel] / self.head.prescale
        number = self.times.first_row + np.arange(self.head.rows)
        return np.asarray(self.times.lead + number * self.head.cycles + delay, dtype=np.float64)

    def elapsed(self) -> float:
        """The end mark in ticks, its wraps undone by the row that had begun."""
        about = self.times.lead + self.times.mark_row * self.head.cycles
        return self.times.elapsed + 2.0**32 * round((about - self.times.elapsed) / 2.0**32)


def _rows(frames: Iterable[bytes], count: int) -> NDArray[np.int64]:
    rows: list[tuple[int, int]] = []
    for payload in frames:
        number = int.from_bytes(payload, "little")
        values = [number >> 10 * j & 1023 for j in range(2 * ROWS_A_FRAME)]
        rows += zip(values[::2], values[1::2], strict=True)
    return np.array(rows[:count], dtype=np.int64).reshape(-1, 2)


def block_of(payloads: dict[int, bytes]) -> Block:
    """A block from the payloads of all its frames.

    Raises
    ------
    ValueError
        When the CRC-32 over all of it differs.
    """
    head = Head(*struct.unpack(Head.FORMAT, payloads[0]))
    everything = payloads[0][:-4] + b"".join(payloads[i] for i in range(1, head.frames))
    if zlib.crc32(everything) != head.crc:
        raise ValueError("the block's CRC-32 differs")
    times = Times(*struct.unpack(Times.FORMAT, payloads[1]))
    rows = _rows((payloads[i] for i in range(FIRST_ROWS, head.frames)), head.rows)
    return Block(head, times, payloads[2], rows)
