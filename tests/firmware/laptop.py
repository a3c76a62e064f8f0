"""The laptop's side of ``firmware/PROTOCOL.md``, for tests of the firmware.

Written from the protocol alone and on purpose apart from ``bayes_asv.acquisition``, so that the two
can be held against each other.  Everything goes over a port with ``read``, ``write`` and a clock
(`tests.firmware.emulated.VirtualPort`).
"""

from __future__ import annotations

import struct
import zlib
from binascii import crc_hqx
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Block",
    "Frame",
    "Head",
    "Laptop",
    "NoAnswerError",
    "Times",
    "cobs_decode",
    "cobs_encode",
    "decode_body",
    "encode_body",
]

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
REPEATS = 5.0  # s: an event that comes again within is a repeat
CLOCK_STEP = 1e-6  # s: a shorter wait is none
FIRST_ROWS = 3


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


# ---- the laptop ----


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
