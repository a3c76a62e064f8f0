"""Synthetic blocks and raw streams, with the tests' own implementation of the protocol."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tests.firmware.frames import (
    BLOCK,
    EVENT,
    LAPTOP,
    SLAVE_1,
    Frame,
    Head,
    Times,
    cobs_encode,
    encode_body,
)

__all__ = ["BOARDS", "SyntheticBlock", "counts", "event_bytes", "frame_bytes", "stream"]

BOARDS = (1, 2)
_CYCLES = {50: (8, 10_000), 100: (1, 40_000), 200: (1, 20_000), 400: (1, 10_000), 800: (1, 5_000)}


def counts(board: int, rows: int = 800, seed: int = 0) -> NDArray[np.int64]:
    """Readings of one board, shape (rows, 2)."""
    rng = np.random.default_rng([seed, board])
    return rng.integers(0, 1024, size=(rows, 2))


@dataclass(frozen=True)
class SyntheticBlock:
    """A block to be sent.

    Attributes
    ----------
    ppm
        Error of the board's clock, positive if it runs fast.
    wait
        True seconds from the start mark to the first row, rounded to whole rows.
    """

    board: int
    rows: NDArray[np.int64]
    run: int = 1
    rate: int = 400
    ppm: float = 0.0
    wait: float = 0.0
    lead: int = 16_000
    overruns: int = 0
    saturated: int = 0
    elapsed: int | None = None
    changes: dict[str, int] = field(default_factory=dict)

    @property
    def payloads(self) -> list[bytes]:
        """Payloads of all frames in order."""
        prescale, cycles = _CYCLES[self.rate]
        hertz = 4e6 * (1 + 1e-6 * self.ppm) / prescale
        first_row = round(self.wait * self.rate)
        end = round((self.wait + len(self.rows) / self.rate + 0.05) * hertz)
        end = end if self.elapsed is None else self.elapsed
        bits = "".join(f"{value:010b}"[::-1] for value in self.rows.ravel())
        bits += "0" * (-len(bits) % 200)
        packed = bytes(int(bits[i : i + 8][::-1], 2) for i in range(0, len(bits), 8))
        parts = [packed[i : i + 25] for i in range(0, len(packed), 25)]
        mark = max((end - self.lead) // cycles, 0)
        times = struct.pack(
            Times.FORMAT, 1110, 2774, self.lead, first_row, end % 2**32, mark, -0x8000
        )
        fields = {
            "board": self.board, "run": self.run, "frames": 3 + len(parts), "rows": len(self.rows),
            "rate": self.rate, "prescale": prescale, "cycles": cycles, "readings": 4, "mode": 0,
            "synch": 0, "overruns": self.overruns, "saturated": self.saturated,
            "trigger_row": 0xFFFF, "crc": 0,
        } | self.changes  # fmt: skip
        head = struct.pack(Head.FORMAT, *fields.values())[:-4]
        after = [times, bytes(19), *parts]
        crc = zlib.crc32(head + b"".join(after)).to_bytes(4, "little")
        return [head + crc, *after]

    @property
    def frames(self) -> list[bytes]:
        """Bytes of all frames on the line."""
        return [
            frame_bytes(Frame(LAPTOP, self.board, BLOCK, number, payload))
            for number, payload in enumerate(self.payloads)
        ]


def frame_bytes(frame: Frame) -> bytes:
    """Bytes of a frame with a zero before and after."""
    return b"\0" + cobs_encode(encode_body(frame)) + b"\0"


def event_bytes(code: int, board: int, state: int, text: str, seq: int = 0) -> bytes:
    """Bytes of an EVENT frame."""
    payload = bytes((code, board, state)) + text.encode()
    return frame_bytes(Frame(LAPTOP, SLAVE_1, EVENT, seq, payload))


def stream(*blocks: SyntheticBlock) -> bytes:
    """Bytes of all frames of blocks, in order."""
    return b"".join(frame for block in blocks for frame in block.frames)
