"""A minimal logger behind a port, with its own virtual time: PROTOCOL.md without firmware.

It uses the tests' own implementation of frames. The line may corrupt what it carries.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from tests.acquire.synthetic import SyntheticBlock, event_bytes
from tests.firmware.frames import (
    BLOCK,
    CONFIG,
    DONE,
    DUMP,
    FETCHING,
    GET,
    HEARD,
    HELLO,
    LAPTOP,
    SEND,
    SENDING_1,
    SENDING_2,
    SLAVE_1,
    STANDBY,
    START,
    STATUS,
    STOP,
    TAKING,
    WAITING,
    Frame,
    cobs_decode,
    cobs_encode,
    decode_body,
    encode_body,
)

__all__ = ["FakeLogger"]

BYTE = 10 / 9600  # s
Corrupt = Callable[[bytes], bytes]


@dataclass
class FakeLogger:
    """Slave 1 with its two blocks, as a port.

    Attributes
    ----------
    front, rear
        Blocks of a run.
    corrupt
        Corrupts a frame on its way to the laptop.
    run_takes
        Seconds from START to the end of the run.
    aborts
        Event (code, board, text) that ends the run instead.
    dump
        Text that DUMP sends.
    deaf
        Whether it receives nothing.
    refuses
        Results of commands that are refused.
    received
        Kinds of commands received.
    """

    front: SyntheticBlock
    rear: SyntheticBlock
    corrupt: Corrupt = bytes
    run_takes: float = 2.0
    state: int = STANDBY
    aborts: tuple[int, int, str] | None = None
    dump: bytes = b""
    deaf: bool = False
    refuses: dict[int, int] = field(default_factory=dict)
    timeout: float = 1.0
    received: list[int] = field(default_factory=list)
    settings: bytes = b""
    _now: float = 0.0
    _run_ends: float | None = None
    _fetch_ends: float | None = None
    _line: bytearray = field(default_factory=bytearray)
    _input: bytearray = field(default_factory=bytearray)
    _last: tuple[int, int] | None = None
    _reply: bytes = b""

    @property
    def in_waiting(self) -> int:
        return len(self._line)

    def clock(self) -> float:
        return self._now

    def read(self, size: int = 1) -> bytes:
        """Advance the time until something is there, `timeout` at most."""
        end = self._now + self.timeout
        self._advance()
        while not self._line and self._now < end:
            self._now = min(end, self._now + 0.05)
            self._advance()
        data = bytes(self._line[:size])
        del self._line[:size]
        self._now += BYTE * len(data)
        return data

    def write(self, data: bytes) -> int:
        self._input += data
        *chunks, rest = bytes(self._input).split(b"\0")
        self._input = bytearray(rest)
        for chunk in chunks:
            body = cobs_decode(chunk)
            frame = decode_body(body) if body else None
            if frame is not None and frame.to == SLAVE_1 and not self.deaf:
                self._execute(frame)
        return len(data)

    def _advance(self) -> None:
        if self._run_ends is not None and self._now >= self._run_ends:
            self._run_ends = None
            if self.aborts is None:
                self.state = WAITING
                self.send_event(3, 1, "Slave 1: run done")
            else:
                self.state = STANDBY
                self.send_event(*self.aborts)
        if self._fetch_ends is not None and self._now >= self._fetch_ends:
            self._fetch_ends = None
            self.state = SENDING_2
            self.send_event(7, 2, "Slave 2: block ready")

    def send_event(self, code: int, board: int, text: str) -> None:
        self._put(event_bytes(code, board, self.state, text, seq=code))

    def _put(self, data: bytes) -> None:
        self._line += self.corrupt(data)

    def _execute(self, frame: Frame) -> None:
        self.received.append(frame.kind)
        if frame.kind == HEARD:
            return
        if frame.kind == GET:
            self._get(frame)
            return
        if self._last != (frame.kind, frame.seq):
            self._last = (frame.kind, frame.seq)
            answer = Frame(LAPTOP, SLAVE_1, frame.kind | 0x80, frame.seq, self._answer(frame))
            self._reply = b"\0" + cobs_encode(encode_body(answer)) + b"\0"
        self._put(self._reply)

    def _answer(self, frame: Frame) -> bytes:
        if frame.kind == HELLO:
            return struct.pack("<BBBHBB", 1, 1, self.state, 700, self.front.run, 1)
        if frame.kind == STATUS:
            return struct.pack("<BHHHHHBBBBB", self.state, 400, 1, 10_000, 0, 0, 0, 0, 0, 0, 0)
        if frame.kind == CONFIG:
            self.settings = frame.payload
            return struct.pack("<BHH", self.refuses.get(CONFIG, 0), 1, 10_000)
        return bytes([self._result(frame)])

    def _result(self, frame: Frame) -> int:
        if frame.kind in self.refuses:
            return self.refuses[frame.kind]
        if frame.kind == START and self.state == STANDBY:
            self.state, self._run_ends = TAKING, self._now + self.run_takes
        elif frame.kind == SEND and self.state == WAITING:
            self.state = SENDING_1
        elif frame.kind == STOP:
            self.state = STANDBY
        elif frame.kind == DUMP and self.state == WAITING:
            self._line += self.dump
        elif frame.kind == DONE:
            return self._done(frame)
        else:
            return 1
        return 0

    def _done(self, frame: Frame) -> int:
        board, crc = struct.unpack("<BI", frame.payload)
        sending = {SENDING_1: self.front, SENDING_2: self.rear}.get(self.state)
        if sending is None or sending.board != board:
            return 1
        if crc != int.from_bytes(sending.payloads[0][-4:], "little"):
            return 3
        if board == 1:
            self.state, self._fetch_ends = FETCHING, self._now + 1.0
        else:
            self.state = STANDBY
            self.send_event(10, 1, "Slave 1: all sent")
        return 0

    def _get(self, frame: Frame) -> None:
        board, first, mask = struct.unpack("<BBI", frame.payload)
        sending = {SENDING_1: self.front, SENDING_2: self.rear}.get(self.state)
        if sending is None or sending.board != board:
            refusal = Frame(LAPTOP, SLAVE_1, GET | 0x80, frame.seq, b"\x01")
            self._put(b"\0" + cobs_encode(encode_body(refusal)) + b"\0")
            return
        payloads = sending.payloads
        for k in np.flatnonzero([mask >> k & 1 for k in range(32)]):
            number = first + int(k)
            if number < len(payloads):
                answer = Frame(LAPTOP, board, BLOCK, number, payloads[number])
                self._put(cobs_encode(encode_body(answer)) + b"\0")
