"""A board's block: its frames as they arrive, and their content (firmware/PROTOCOL.md, Blocks)."""

from __future__ import annotations

import struct
import zlib
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.acquire.frames import Frame

__all__ = ["CPU", "MAX_ROWS", "ROWS_PER_FRAME", "Block", "Head", "Quality", "Times"]

CPU: Final = 4e6
"""Cycles per second of a board's own crystal."""
ROWS_PER_FRAME: Final = 10
MAX_ROWS: Final = 800
"""Capacity of a board's memory."""

_HEAD: Final = struct.Struct("<BBBHHHHBBBHBHI")
_TIMES: Final = struct.Struct("<HHHIIIh")
_QUALITY: Final = struct.Struct("<HHHHBHHHHBB")
_HEAD_FRAMES: Final = 3
_ROWS_SIZE: Final = 25  # bytes
_CRC_SIZE: Final = 4  # bytes
_PRESCALES: Final = (1, 8, 64, 256, 1024)
_NO_ROW: Final = 0xFFFF
_BITS: Final = 10
_WRAP: Final = 2.0**32
_MASK_BITS: Final = 32  # of GET


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
        """Rows per second of the board's own clock, Hz."""
        return CPU / (self.prescale * self.cycles)

    @property
    def trigger(self) -> int | None:
        """Row of the block at which the trigger came."""
        return None if self.trigger_row == _NO_ROW else self.trigger_row


class Times(NamedTuple):
    """Frame 1: times of the rows on the board's clock; a tick is `Head.prescale` cycles."""

    wheel_delay: int
    chassis_delay: int
    lead: int
    first_row: int
    elapsed: int
    mark_row: int
    difference: int


class Quality(NamedTuple):
    """Frame 2: the board's own checks; means and standard deviations times 16."""

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
    """Frames received of one board's block.

    Parameters
    ----------
    board : int
        Address of the board.

    Attributes
    ----------
    conflicts : int
        Frames that were received twice with different content; neither was kept.
    discards : int
        Times that all frames were discarded because the CRC-32 differed.
    """

    def __init__(self, board: int) -> None:
        self.board = board
        self.conflicts = 0
        self.discards = 0
        self._payloads: dict[int, bytes] = {}

    def add(self, frame: Frame) -> bool:
        """Add a BLOCK frame of this board; return whether it belongs to the block.

        A different HEAD restarts the block: either it or the earlier frames are of another run. Of
        two other frames with the same number but different content neither is kept, unless the
        block is verified: then the later one is wrong.
        """
        number, payload = frame.seq, frame.payload
        if not self._is_valid(number, payload):
            return False
        held = self._payloads.get(number)
        if held == payload:
            return True
        if held is not None and number == 0:
            self._payloads = {}
        elif held is not None and self.verified:
            return False
        elif held is not None:
            self.conflicts += 1
            del self._payloads[number]
            return True
        self._payloads[number] = payload
        if number == 0:  # frames beyond the block's end belong to another one
            count = payload[2]
            self._payloads = {k: v for k, v in self._payloads.items() if k < count}
        return True

    def discard(self) -> None:
        """Discard all frames."""
        self.discards += 1
        self._payloads = {}

    @property
    def head(self) -> Head | None:
        """Frame 0, if received."""
        payload = self._payloads.get(0)
        return None if payload is None else Head._make(_HEAD.unpack(payload))

    @property
    def times(self) -> Times | None:
        """Frame 1, if received."""
        payload = self._payloads.get(1)
        return None if payload is None else Times._make(_TIMES.unpack(payload))

    @property
    def quality(self) -> Quality | None:
        """Frame 2, if received."""
        payload = self._payloads.get(2)
        return None if payload is None else Quality._make(_QUALITY.unpack(payload))

    @property
    def received(self) -> int:
        """Number of frames held."""
        return len(self._payloads)

    @property
    def expected(self) -> int | None:
        """Number of frames of the block; None before its HEAD."""
        head = self.head
        return None if head is None else head.frames

    def missing(self, limit: int) -> list[int]:
        """Return up to `limit` missing frames, within 32 numbers of the first of them."""
        total = self.expected or limit
        numbers = [k for k in range(total) if k not in self._payloads][:limit]
        return [k for k in numbers if k < numbers[0] + _MASK_BITS]

    @property
    def complete(self) -> bool:
        """Whether every frame is held."""
        return self.expected == len(self._payloads)

    @property
    def crc(self) -> int:
        """CRC-32 of the frames held, computed as that in HEAD was of the frames sent."""
        total = zlib.crc32(self._payloads[0][:-_CRC_SIZE])
        for number in sorted(self._payloads)[1:]:
            total = zlib.crc32(self._payloads[number], total)
        return total

    @property
    def verified(self) -> bool:
        """Whether every frame is held and the CRC-32 agrees."""
        head = self.head
        return head is not None and self.complete and self.crc == head.crc

    def readings(self) -> NDArray[np.float64]:
        """Return wheel and chassis in counts, NaN where the frame is missing.

        A complete block that fails its CRC-32 has a wrong frame, and it is unknown which: all its
        readings are NaN.

        Returns
        -------
        ndarray of float, shape (rows, 2)
            No rows without HEAD.
        """
        head = self.head
        result = np.full((0 if head is None else head.rows, 2), np.nan)
        if head is None or (self.complete and not self.verified):
            return result
        for number, payload in self._payloads.items():
            if number < _HEAD_FRAMES:
                continue
            first = (number - _HEAD_FRAMES) * ROWS_PER_FRAME
            rows = _unpack(payload)[: head.rows - first]
            result[first : first + len(rows)] = rows
        return result

    def elapsed(self) -> float | None:
        """Ticks from the start mark to the end mark, unwrapped; None if unknown.

        `Times.elapsed` is modulo 2^32; the last row before the end mark gives the number of wraps.
        """
        head, times = self.head, self.times
        if head is None or times is None or times.elapsed == 0:
            return None
        estimate = times.lead + times.mark_row * head.cycles
        return times.elapsed + _WRAP * round((estimate - times.elapsed) / _WRAP)

    def _is_valid(self, number: int, payload: bytes) -> bool:
        """Whether a payload has the size, and plausible content, for its number."""
        if number >= _HEAD_FRAMES:
            count = self.expected or _frame_count(MAX_ROWS)
            return len(payload) == _ROWS_SIZE and number < count
        if number != 0:
            return len(payload) == (_TIMES.size if number == 1 else _QUALITY.size)
        if len(payload) != _HEAD.size:
            return False
        head = Head._make(_HEAD.unpack(payload))
        return (
            head.board == self.board
            and 0 < head.rows <= MAX_ROWS
            and head.frames == _frame_count(head.rows)
            and head.prescale in _PRESCALES
            and head.cycles > 0
        )


def _frame_count(rows: int) -> int:
    return _HEAD_FRAMES + -(-rows // ROWS_PER_FRAME)


def _unpack(payload: bytes) -> NDArray[np.float64]:
    """Ten rows of two ten-bit readings, packed from the lowest bit up."""
    bits = np.unpackbits(np.frombuffer(payload, np.uint8), bitorder="little")
    values = bits.reshape(-1, _BITS) @ (1 << np.arange(_BITS))
    return values.reshape(-1, 2).astype(np.float64)
