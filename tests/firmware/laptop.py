"""The laptop's side of ``firmware/PROTOCOL.md``, for tests of the firmware.

Everything goes over a port with ``read``, ``write`` and a clock
(`tests.firmware.emulated.VirtualPort`).
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from tests.firmware.frames import (
    BLOCK,
    CONFIG,
    DONE,
    DUMP,
    EVENT,
    GET,
    HEARD,
    LAPTOP,
    SLAVE_1,
    SLAVE_2,
    STATUS,
    Block,
    Frame,
    Head,
    block_of,
    cobs_decode,
    cobs_encode,
    decode_body,
    encode_body,
)

__all__ = ["Laptop", "NoAnswerError"]

REPEATS = 5.0  # s: an event that comes again within is a repeat
CLOCK_STEP = 1e-6  # s: a shorter wait is none


class NoAnswerError(Exception):
    """The logger did not answer in time."""


class Port(Protocol):
    """What a `Laptop` needs of a serial port."""

    timeout: float

    def read(self, size: int = 1) -> bytes:
        """Up to `size` bytes within `timeout`."""
        ...

    def write(self, data: bytes) -> int:
        """Send bytes."""
        ...

    def clock(self) -> float:
        """Time in seconds."""
        ...

    @property
    def in_waiting(self) -> int:
        """Bytes to be read without waiting."""
        ...


@dataclass
class Laptop:
    """A laptop that speaks with the logger.

    Attributes
    ----------
    port
        The line.
    patience
        Seconds until a command is sent again.
    events
        Texts of the events that came, in order.
    repeats
        Number of commands that were sent again.
    """

    port: Port
    patience: float = 1.0
    events: list[str] = field(default_factory=list)
    repeats: int = 0
    spoilt: int = 0
    _seq: int = 0
    _buffer: bytearray = field(default_factory=bytearray)
    _heard: dict[tuple[int, bytes], float] = field(default_factory=dict)

    @property
    def last_seq(self) -> int:
        """`seq` of the last command."""
        return self._seq

    def _write(self, frame: Frame) -> None:
        self.port.write(cobs_encode(encode_body(frame)) + b"\0")

    def _take(self, end: float) -> Frame | None:
        """The next whole frame until the clock says `end`."""
        while True:
            if 0 in self._buffer:
                raw, _, rest = bytes(self._buffer).partition(b"\0")
                self._buffer = bytearray(rest)
                body = cobs_decode(raw) if raw else None
                frame = decode_body(body) if body else None
                if frame is not None:
                    return frame
                self.spoilt += bool(raw)
                continue
            left = end - self.port.clock()
            if left <= CLOCK_STEP:
                return None
            self.port.timeout = left
            self._buffer += self.port.read(max(1, self.port.in_waiting))

    def _next(self, end: float) -> Frame | None:
        """The next frame that is no event; events are acknowledged and kept."""
        while (frame := self._take(end)) is not None:
            if frame.kind != EVENT:
                return frame
            self._write(Frame(frame.sender, LAPTOP, HEARD, frame.seq))
            # Repeats come every 2 s; a logger that was reset counts from 0 again.
            said, now = (frame.seq, frame.payload), self.port.clock()
            if now - self._heard.get(said, -np.inf) > REPEATS:
                self.events.append(frame.payload[3:].decode("ascii"))
            self._heard[said] = now
        return None

    def ask(
        self,
        kind: int,
        payload: bytes = b"",
        to: int = SLAVE_1,
        within: float = 60.0,
    ) -> bytes:
        """Send a command until its reply comes; the reply's payload.

        Raises
        ------
        NoAnswerError
            When none came `within` so many seconds.
        """
        self._seq = (self._seq + 1) % 256
        give_up = self.port.clock() + within
        first = True
        while self.port.clock() < give_up:
            self.repeats += not first
            first = False
            self._write(Frame(to, LAPTOP, kind, self._seq, payload))
            end = self.port.clock() + self.patience
            while (frame := self._next(end)) is not None:
                if frame.kind == kind | 0x80 and frame.seq == self._seq:
                    return frame.payload
        raise NoAnswerError(f"no answer to command {kind:#04x} within {within:g} s")

    def dump(self, within: float = 60.0) -> str:
        """DUMP; the plain text from its first line to ``# end``, frames in between left out.

        Raises
        ------
        NoAnswerError
            When the text has not ended in time.
        """
        self._seq = (self._seq + 1) % 256
        self._write(Frame(SLAVE_1, LAPTOP, DUMP, self._seq))
        raw, end = bytes(self._buffer), self.port.clock() + within
        self._buffer.clear()
        while b"# end" not in raw:
            if self.port.clock() > end - CLOCK_STEP:
                raise NoAnswerError(f"no text within {within:g} s")
            self.port.timeout = 1.0
            raw += self.port.read(max(1, self.port.in_waiting))
        parts = [
            p for p in raw.split(b"\0") if (body := cobs_decode(p)) is None or not decode_body(body)
        ]
        return max(parts, key=len).decode("ascii")

    def listen(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Hear events for a time, or until a condition holds."""
        end = self.port.clock() + seconds
        while self.port.clock() < end - CLOCK_STEP and not until():
            self._next(min(end, self.port.clock() + 0.1))

    def wait_for(self, text: str, within: float) -> None:
        """Listen until an event with this text has come.

        Raises
        ------
        NoAnswerError
            When it has not come in time.
        """
        self.listen(within, lambda: text in self.events)
        if text not in self.events:
            raise NoAnswerError(f'no event "{text}" within {within:g} s; came: {self.events}')

    def state(self) -> int:
        """The state of Slave 1."""
        return self.ask(STATUS)[0]

    def configure(
        self,
        rate: int = 0,
        mode: int = 0,
        synch: int = 0,
        readings: int = 4,
        pre: int = 200,
        threshold: int = 20,
    ) -> tuple[int, int, int]:
        """CONFIG; result, prescale, cycles."""
        sent = struct.pack("<HBBBHH", rate, mode, synch, readings, pre, threshold)
        result, prescale, cycles = struct.unpack("<BHH", self.ask(CONFIG, sent))
        return result, prescale, cycles

    def fetch(self, board: int, within: float = 120.0, batch: int = 16) -> Block:
        """All frames of a board's block by GET, as often as it takes.

        Raises
        ------
        NoAnswerError
            When it is not complete in time.
        """
        payloads: dict[int, bytes] = {}
        give_up = self.port.clock() + within
        total = batch
        while len(payloads) < total:
            if self.port.clock() > give_up:
                raise NoAnswerError(f"{len(payloads)} of {total} frames of board {board}")
            wanted = [i for i in range(total) if i not in payloads][:batch]
            wanted = [i for i in wanted if i < wanted[0] + 32]
            self._get(board, wanted, payloads)
            if 0 in payloads:
                total = struct.unpack(Head.FORMAT, payloads[0])[2]
        return block_of(payloads)

    def _get(self, board: int, wanted: list[int], payloads: dict[int, bytes]) -> None:
        self._seq = (self._seq + 1) % 256
        first = wanted[0]
        mask = sum(1 << i - first for i in wanted)
        sent = struct.pack("<BBI", board, first, mask)
        self._write(Frame(SLAVE_1, LAPTOP, GET, self._seq, sent))
        # The first frame takes the way there and back; between frames 0.6 s are silence enough.
        end = self.port.clock() + 1.0
        while (frame := self._next(end)) is not None:
            if frame.kind == GET | 0x80 and frame.seq == self._seq:
                self.listen(0.3)  # refused: not ready yet
                return
            if frame.kind == BLOCK and frame.sender == board:
                payloads[frame.seq] = frame.payload
                if frame.seq == wanted[-1]:
                    return
            end = self.port.clock() + 0.6

    def done(self, board: int, block: Block) -> int:
        """DONE with the block's CRC-32; the result."""
        return self.ask(DONE, struct.pack("<BI", board, block.head.crc))[0]

    def transfer(self, within: float = 240.0) -> tuple[Block, Block]:
        """Both blocks, from state 5 to state 0."""
        front = self.fetch(SLAVE_1, within)
        if (result := self.done(SLAVE_1, front)) != 0:
            raise NoAnswerError(f"DONE for board 1 was refused with {result}")
        rear = self.fetch(SLAVE_2, within)
        if (result := self.done(SLAVE_2, rear)) != 0:
            raise NoAnswerError(f"DONE for board 2 was refused with {result}")
        return front, rear
