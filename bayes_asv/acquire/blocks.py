"""A board's block: its frames as they come, and what they say (firmware/PROTOCOL.md, Blocks)."""

from __future__ import annotations

import struct
import zlib
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.acquire.frames import Frame

__all__ = ["CPU", "MOST_ROWS", "ROWS_A_FRAME", "Block", "Head", "Quality", "Times"]

CPU: Final = 4e6
"""Cycles a second of a board's own crystal."""
ROWS_A_FRAME: Final = 10
MOST_ROWS: Final = 800
"""What a board's store holds."""

_HEAD: Final = struct.Struct("<BBBHHHHBBBHBHI")
_TIMES: Final = struct.Struct("<HHHIIIh")
_QUALITY: Final = struct.Struct("<HHHHBHHHHBB")
_HEAD_FRAMES: Final = 3
_ROWS_SIZE: Final = 25
_CRC_SIZE: Final = 4
_PRESCALES: Final = (1, 8, 64, 256, 1024)
_NO_ROW: Final = 0xFFFF
_NOT_MEASURED: Final = -0x8000
_BITS: Final = 10
_WRAP: Final = 2.0**32


class Head(NamedTuple):
    """Frame 0: how the run was taken."""

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

    @property
    def actual_rate(self) -> float:
        """Rows a second of the board's own seconds, Hz."""
        return CPU / (self.prescale * self.cycles)

    @property
    def trigger(self) -> int | None:
        """Row of the block at which the trigger came."""
        return None if self.trigger_row == _NO_ROW else self.trigger_row


class Times(NamedTuple):
    """Frame 1: where the rows lie on the board's clock; ticks are `Head.prescale` cycles."""

    wheel_delay: int
    chassis_delay: int
    lead: int
    first_row: int
    elapsed: int
    mark_row: int
    difference: int

    @property
    def measured_difference(self) -> int | None:
        """What steps 3 and 4 of the synchronisation measured, ticks."""
        return None if self.difference == _NOT_MEASURED else self.difference


class Quality(NamedTuple):
    """Frame 2: what the board thinks of its signals; means and deviations times 16."""

    wheel_low: int
    wheel_high: int
    wheel_mean16: int
    wheel_sd16: int
    wheel_flags: int
    chassis_low: int
    chassis_high: int
    chassis_mean16: int
    chassis_sd16: int
    chassis_flags: int
    verdict: int


class Block:
    """The frames of one board's block that have come.

    Parameters
    ----------
    board : int
        Address of the board.

    Attributes
    ----------
    disputed : int
        Frames that came twice and differed; neither was believed.
    dropped : int
        Times that all frames were dropped because the CRC-32 differed.
    """

    def __init__(self, board: int) -> None:
        self.board = board
        self.disputed = 0
        self.dropped = 0
        self._payloads: dict[int, bytes] = {}

    def take(self, frame: Frame) -> bool:
        """Take a BLOCK frame of this board; whether it belongs to the block.

        Another HEAD begins the block anew: it is of another run, or what came before is. Of two
        other frames with one number that differ none is kept, unless the block is verified: then
        the later one is wrong.
        """
        number, payload = frame.seq, frame.payload
        if not self._fits(number, payload):
            return False
        held = self._payloads.get(number)
        if held == payload:
            return True
        if held is not None and number == 0:
            self._payloads = {}
        elif held is not None and self.verified:
            return False
        elif held is not None:
            self.disputed += 1
            del self._payloads[number]
            return True
        self._payloads[number] = payload
        if number == 0:  # numbers beyond the block's end are of another one
            last = payload[2]
            self._payloads = {k: v for k, v in self._payloads.items() if k < last}
        return True

    def drop(self) -> None:
        """Forget all frames."""
        self.dropped += 1
        self._payloads = {}

    @property
    def head(self) -> Head | None:
        """Frame 0, where it has come."""
        payload = self._payloads.get(0)
        return None if payload is None else Head._make(_HEAD.unpack(payload))

    @property
    def times(self) -> Times | None:
        """Frame 1, where it has come."""
        payload = self._payloads.get(1)
        return None if payload is None else Times._make(_TIMES.unpack(payload))

    @property
    def quality(self) -> Quality | None:
        """Frame 2, where it has come."""
        payload = self._payloads.get(2)
        return None if payload is None else Quality._make(_QUALITY.unpack(payload))

    @property
    def come(self) -> int:
        """Frames held."""
        return len(self._payloads)

    @property
    def expected(self) -> int | None:
        """Frames of the block; None before its HEAD has come."""
        head = self.head
        return None if head is None else head.frames

    def missing(self, most: int) -> list[int]:
        """Return up to `most` frames to be asked for, within 32 numbers of the first of them."""
        total = self.expected or most
        wanted = [k for k in range(total) if k not in self._payloads][:most]
        return [k for k in wanted if k < wanted[0] + 32]

    @property
    def complete(self) -> bool:
        """Whether every frame is held."""
        return self.expected == len(self._payloads)

    @property
    def crc(self) -> int:
        """CRC-32 over what is held, as HEAD's was made over what was sent."""
        total = zlib.crc32(self._payloads[0][:-_CRC_SIZE])
        for number in sorted(self._payloads)[1:]:
            total = zlib.crc32(self._payloads[number], total)
        return total

    @property
    def verified(self) -> bool:
        """Whether every frame is held and the CRC-32 over all of them agrees."""
        head = self.head
        return head is not None and self.complete and self.crc == head.crc

    def readings(self) -> NDArray[np.float64]:
        """Return wheel and chassis in counts, NaN where the frame has not come.

        A block that is complete and yet fails its CRC-32 holds a wrong frame, and nobody knows
        which: none of its readings is given.

        Returns
        -------
        ndarray of float, shape (rows, 2)
            Without HEAD it has no rows.
        """
        head = self.head
        result = np.full((0 if head is None else head.rows, 2), np.nan)
        if head is None or (self.complete and not self.verified):
            return result
        for number, payload in self._payloads.items():
            if number < _HEAD_FRAMES:
                continue
            first = (number - _HEAD_FRAMES) * ROWS_A_FRAME
            rows = _unpacked(payload)[: head.rows - first]
            result[first : first + len(rows)] = rows
        return result

    def elapsed(self) -> float | None:
        """End mark in ticks after the start mark, its wraps undone; None where it is not known.

        `elapsed` is modulo 2^32; the last row that had begun at the mark says how often it wrapped.
        """
        head, times = self.head, self.times
        if head is None or times is None or times.elapsed == 0:
            return None
        about = times.lead + times.mark_row * head.cycles
        return times.elapsed + _WRAP * round((about - times.elapsed) / _WRAP)

    def _fits(self, number: int, payload: bytes) -> bool:
        """Whether a payload has the size and the sense of its number."""
        if number >= _HEAD_FRAMES:
            last = self.expected or _frames_for(MOST_ROWS)
            return len(payload) == _ROWS_SIZE and number < last
        if number != 0:
            return len(payload) == (_TIMES.size if number == 1 else _QUALITY.size)
        if len(payload) != _HEAD.size:
            return False
        head = Head._make(_HEAD.unpack(payload))
        return (
            head.board == self.board
            and 0 < head.rows <= MOST_ROWS
            and head.frames == _frames_for(head.rows)
            and head.prescale in _PRESCALES
            and head.cycles > 0
        )


def _frames_for(rows: int) -> int:
    return _HEAD_FRAMES + -(-rows // ROWS_A_FRAME)


def _unpacked(payload: bytes) -> NDArray[np.float64]:
    """Ten rows of two ten-bit readings, packed from the lowest bit up."""
    bits = np.unpackbits(np.frombuffer(payload, np.uint8), bitorder="little")
    values = bits.reshape(-1, _BITS) @ (1 << np.arange(_BITS))
    return values.reshape(-1, 2).astype(np.float64)
