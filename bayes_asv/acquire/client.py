"""Client of the logger: commands with retries, acknowledged events, and collected frames."""

from __future__ import annotations

import secrets
import struct
from collections.abc import Callable
from typing import Final, Protocol

from bayes_asv.acquire.blocks import Block
from bayes_asv.acquire.frames import (
    REPLY,
    Address,
    Frame,
    Kind,
    Result,
    StreamDecoder,
    encode,
)
from bayes_asv.acquire.messages import (
    Event,
    Hello,
    Status,
    parse_event,
    parse_hello,
    parse_status,
)
from bayes_asv.domain.errors import BayesAsvError

__all__ = ["LoggerClient", "NoResponseError", "Port"]

_GET: Final = struct.Struct("<BBI")
_DONE: Final = struct.Struct("<BI")
_BATCH: Final = 16  # frames per GET, as PROTOCOL.md recommends
_FIRST_FRAME: Final = 1.0  # s: both ways through two modems, and a frame
_NEXT_FRAME: Final = 0.6  # s after which no further frame of a GET is expected
_REPLY_TIMEOUT: Final = 1.0  # s until a command is sent again
_REFUSED_PAUSE: Final = 0.3  # s after a refused GET
_EVENT_REPEAT: Final = 5.0  # s: events are repeated every 2 s until they are acknowledged
_MIN_WAIT: Final = 1e-6  # s


class NoResponseError(BayesAsvError):
    """The logger has not responded for as long as the client waits."""


class Port(Protocol):
    """Interface of a serial port; its clock may stop while the port is disconnected."""

    timeout: float

    def read(self, size: int = 1) -> bytes:
        """Read up to `size` bytes, as many as arrive within `timeout` seconds."""
        ...

    def write(self, data: bytes) -> int:
        """Send bytes."""
        ...

    def clock(self) -> float:
        """Return the time, s."""
        ...

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read at once."""
        ...


class LoggerClient:
    """Communicates with Slave 1 over a port.

    Parameters
    ----------
    port : Port
        The serial port.
    on_event : callable, optional
        Called once with every event.
    on_block : callable, optional
        Called with the block whenever one of its frames has arrived.
    patience : float
        Time without a response after which a command fails, s.
    seq : int, optional
        Number before the first command's; random without it, so that it does not repeat an earlier
        session's.

    Attributes
    ----------
    events : list of Event
        In their order.
    lines : list of str
        Lines of text.
    blocks : dict of int to Block
        By board.
    retries : int
        Commands that were sent again.
    """

    def __init__(
        self,
        port: Port,
        on_event: Callable[[Event], None] | None = None,
        on_block: Callable[[Block], None] | None = None,
        *,
        patience: float = 60.0,
        seq: int | None = None,
    ) -> None:
        self.port = port
        self.patience = patience
        self.events: list[Event] = []
        self.lines: list[str] = []
        self.blocks: dict[int, Block] = {}
        self.retries = 0
        self.start_run()
        self._decoder = StreamDecoder()
        self._pending: list[Frame | str] = []
        self._on_event, self._on_block = on_event, on_block
        self._seq = secrets.randbelow(256) if seq is None else seq
        self._event_times: dict[tuple[int, bytes], float] = {}

    @property
    def corrupted(self) -> int:
        """Pieces of the stream that were neither frame nor text."""
        return self._decoder.corrupted

    def start_run(self) -> None:
        """Discard blocks, events and lines of an earlier run."""
        self.blocks = {b: Block(b) for b in (Address.SLAVE_1, Address.SLAVE_2)}
        self.events.clear()
        self.lines.clear()

    def replay(self, data: bytes) -> None:
        """Process bytes that were received earlier, without replies or callbacks."""
        for piece in self._decoder.feed(data):
            if isinstance(piece, str):
                self.lines.append(piece)
            elif piece.kind == Kind.BLOCK and piece.sender in self.blocks:
                self.blocks[piece.sender].add(piece)
            elif piece.kind == Kind.EVENT and (event := parse_event(piece)) is not None:
                self.events.append(event)

    def request(self, kind: Kind, payload: bytes = b"", to: int = Address.SLAVE_1) -> bytes:
        """Send a command until its reply comes; return the reply's payload.

        Raises
        ------
        NoResponseError
            When none came within `patience`.
        """
        self._next_seq()
        deadline = self.port.clock() + self.patience
        while True:
            self._write(Frame(to, Address.LAPTOP, kind, self._seq, payload))
            end = self.port.clock() + _REPLY_TIMEOUT
            while (frame := self._next(end)) is not None:
                if frame.kind == kind | REPLY and frame.seq == self._seq:
                    return frame.payload
            if self.port.clock() >= deadline - _MIN_WAIT:
                raise NoResponseError(f"no answer to {kind.name} for {self.patience:g} s")
            self.retries += 1

    def command(self, kind: Kind, payload: bytes = b"") -> Result:
        """Send a command; return the result in its reply."""
        reply = self.request(kind, payload)
        try:
            return Result(reply[0])
        except (IndexError, ValueError):
            return Result.BAD_VALUE

    def hello(self, to: int = Address.SLAVE_1) -> Hello:
        """Request the identification of a board."""
        hello = parse_hello(self.request(Kind.HELLO, to=to))
        if hello is None:
            raise NoResponseError("the device that answers is not this kind of logger")
        return hello

    def status(self) -> Status:
        """Request the state."""
        status = parse_status(self.request(Kind.STATUS))
        if status is None:
            raise NoResponseError("the device that answers is not this kind of logger")
        return status

    def acknowledge(self, block: Block) -> Result:
        """Acknowledge a block by its CRC-32."""
        return self.command(Kind.DONE, _DONE.pack(block.board, block.crc))

    def get(self, block: Block) -> Result:
        """Request missing frames of a block once, and collect what arrives.

        Returns
        -------
        Result
            DONE, or the logger's reason for a refusal.
        """
        self._next_seq()
        numbers = block.missing(_BATCH)
        mask = sum(1 << number - numbers[0] for number in numbers)
        payload = _GET.pack(block.board, numbers[0], mask)
        self._write(Frame(Address.SLAVE_1, Address.LAPTOP, Kind.GET, self._seq, payload))
        end = self.port.clock() + _FIRST_FRAME
        while (frame := self._next(end)) is not None:
            if frame.kind == Kind.GET | REPLY and frame.seq == self._seq:
                self.listen(_REFUSED_PAUSE)
                known = frame.payload[:1] and frame.payload[0] in tuple(Result)
                return Result(frame.payload[0]) if known else Result.BAD_VALUE
            if frame.kind == Kind.BLOCK and frame.sender == block.board:
                if frame.seq == numbers[-1]:
                    break
                end = self.port.clock() + _NEXT_FRAME
        return Result.DONE

    def send(self, kind: Kind) -> None:
        """Send a command once, without waiting for its reply."""
        self._next_seq()
        self._write(Frame(Address.SLAVE_1, Address.LAPTOP, kind, self._seq))

    def listen(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Receive for a time, or until a condition holds; return whether it holds."""
        end = self.port.clock() + seconds
        while not until() and self.port.clock() < end - _MIN_WAIT:
            self._next(min(end, self.port.clock() + 0.1))
        return until()

    def _next_seq(self) -> None:
        self._seq = (self._seq + 1) % 256

    def _write(self, frame: Frame) -> None:
        self.port.write(encode(frame))

    def _next(self, end: float) -> Frame | None:
        """Wait for the next frame that is not an event, until the clock reads `end`."""
        while True:
            while self._pending:
                piece = self._pending.pop(0)
                if isinstance(piece, str):
                    self.lines.append(piece)
                elif piece.kind == Kind.EVENT:
                    self._receive_event(piece)
                else:
                    self._receive_frame(piece)
                    return piece
            remaining = end - self.port.clock()
            if remaining <= _MIN_WAIT:
                return None
            self.port.timeout = remaining
            self._pending += self._decoder.feed(self.port.read(max(1, self.port.in_waiting)))

    def _receive_frame(self, frame: Frame) -> None:
        if frame.kind != Kind.BLOCK or frame.sender not in self.blocks:
            return
        block = self.blocks[frame.sender]
        if block.add(frame) and self._on_block is not None:
            self._on_block(block)

    def _receive_event(self, frame: Frame) -> None:
        event = parse_event(frame)
        if event is None:
            return
        self._write(Frame(frame.sender, Address.LAPTOP, Kind.HEARD, frame.seq))
        key, now = (frame.seq, frame.payload), self.port.clock()
        # A logger that was reset counts from 0 again, so that an old number alone is no repeat.
        repeated = key in self._event_times and now - self._event_times[key] < _EVENT_REPEAT
        self._event_times[key] = now
        if not repeated:
            self.events.append(event)
            if self._on_event is not None:
                self._on_event(event)
