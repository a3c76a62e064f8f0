"""A laptop at the logger's line: commands with repeats, events acknowledged, frames collected."""

from __future__ import annotations

import secrets
import struct
from collections.abc import Callable
from typing import Final, Protocol

from bayes_asv.acquire.blocks import Block
from bayes_asv.acquire.frames import REPLY, Address, Frame, Kind, Result, encoded
from bayes_asv.acquire.messages import Event, Hello, Status, event_of, hello_of, status_of
from bayes_asv.acquire.splitter import Splitter
from bayes_asv.domain.errors import BayesAsvError

__all__ = ["Laptop", "Port", "SilentError"]

_GET: Final = struct.Struct("<BBI")
_DONE: Final = struct.Struct("<BI")
_BATCH: Final = 16  # frames a GET: what PROTOCOL.md calls a good number
_FIRST_FRAME: Final = 1.0  # s: the way there and back through two modems, and a frame
_SILENCE: Final = 0.6  # s after which no further frame of a GET is to be expected
_ANSWER: Final = 1.0  # s until a command is sent again
_REFUSED: Final = 0.3  # s before a refused GET is worth another
_SAME_EVENT: Final = 5.0  # s: events are repeated every 2 s until they are acknowledged
_SHORTEST: Final = 1e-6  # s: a shorter wait is none


class SilentError(BayesAsvError):
    """Nothing came from the logger for as long as one was willing to wait."""


class Port(Protocol):
    """What is needed of a serial port; its clock may stand still while the port is away."""

    timeout: float

    def read(self, size: int = 1) -> bytes:
        """Up to `size` bytes, what has come within `timeout` seconds."""
        ...

    def write(self, data: bytes) -> int:
        """Send bytes."""
        ...

    def clock(self) -> float:
        """Seconds."""
        ...

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read at once."""
        ...


class Laptop:
    """Speaks with Slave 1 over a port.

    Parameters
    ----------
    port : Port
        The line.
    heard : callable, optional
        Told every event once.
    grown : callable, optional
        Told the block whenever a frame of it has come.
    patience : float
        Seconds without a word after which one gives up.
    seq : int, optional
        Number of the first command; at random without it, lest it repeats an earlier session's.

    Attributes
    ----------
    events : list of Event
        In their order.
    lines : list of str
        Lines of text.
    blocks : dict of int to Block
        By board.
    repeats : int
        Commands that were sent again.
    """

    def __init__(
        self,
        port: Port,
        heard: Callable[[Event], None] | None = None,
        grown: Callable[[Block], None] | None = None,
        *,
        patience: float = 60.0,
        seq: int | None = None,
    ) -> None:
        self.port = port
        self.patience = patience
        self.events: list[Event] = []
        self.lines: list[str] = []
        self.blocks: dict[int, Block] = {}
        self.repeats = 0
        self.begin_run()
        self._splitter = Splitter()
        self._waiting: list[Frame | str] = []
        self._heard, self._grown = heard, grown
        self._seq = secrets.randbelow(256) if seq is None else seq
        self._told: dict[tuple[int, bytes], float] = {}

    @property
    def spoilt(self) -> int:
        """Pieces of the line that were neither frame nor text."""
        return self._splitter.spoilt

    def begin_run(self) -> None:
        """Forget blocks, events and lines of an earlier run."""
        self.blocks = {b: Block(b) for b in (Address.SLAVE_1, Address.SLAVE_2)}
        self.events.clear()
        self.lines.clear()

    def replay(self, data: bytes) -> None:
        """Take bytes that came earlier; nothing is answered and nobody is told."""
        for piece in self._splitter.feed(data):
            if isinstance(piece, str):
                self.lines.append(piece)
            elif piece.kind == Kind.BLOCK and piece.sender in self.blocks:
                self.blocks[piece.sender].take(piece)
            elif piece.kind == Kind.EVENT and (event := event_of(piece)) is not None:
                self.events.append(event)

    def ask(self, kind: Kind, payload: bytes = b"", to: int = Address.SLAVE_1) -> bytes:
        """Send a command until its reply comes; the reply's payload.

        Raises
        ------
        SilentError
            When none came within `patience`.
        """
        self._next_seq()
        give_up = self.port.clock() + self.patience
        while True:
            self._write(Frame(to, Address.LAPTOP, kind, self._seq, payload))
            end = self.port.clock() + _ANSWER
            while (frame := self._next(end)) is not None:
                if frame.kind == kind | REPLY and frame.seq == self._seq:
                    return frame.payload
            if self.port.clock() >= give_up - _SHORTEST:
                raise SilentError(f"no answer to {kind.name} for {self.patience:g} s")
            self.repeats += 1

    def order(self, kind: Kind, payload: bytes = b"") -> Result:
        """Send a command whose reply begins with a result."""
        reply = self.ask(kind, payload)
        try:
            return Result(reply[0])
        except (IndexError, ValueError):
            return Result.BAD_VALUE

    def hello(self, to: int = Address.SLAVE_1) -> Hello:
        """Ask who is there."""
        hello = hello_of(self.ask(Kind.HELLO, to=to))
        if hello is None:
            raise SilentError("what answers is no logger of this kind")
        return hello

    def status(self) -> Status:
        """Ask for the state."""
        status = status_of(self.ask(Kind.STATUS))
        if status is None:
            raise SilentError("what answers is no logger of this kind")
        return status

    def done(self, block: Block) -> Result:
        """Acknowledge a block by the CRC-32 of what is kept."""
        return self.order(Kind.DONE, _DONE.pack(block.board, block.crc))

    def get(self, block: Block) -> Result:
        """Ask once for frames that a block lacks, and collect what comes.

        Returns
        -------
        Result
            DONE, or why the logger refused.
        """
        self._next_seq()
        wanted = block.missing(_BATCH)
        mask = sum(1 << number - wanted[0] for number in wanted)
        payload = _GET.pack(block.board, wanted[0], mask)
        self._write(Frame(Address.SLAVE_1, Address.LAPTOP, Kind.GET, self._seq, payload))
        end = self.port.clock() + _FIRST_FRAME
        while (frame := self._next(end)) is not None:
            if frame.kind == Kind.GET | REPLY and frame.seq == self._seq:
                self.listen(_REFUSED)
                known = frame.payload[:1] and frame.payload[0] in tuple(Result)
                return Result(frame.payload[0]) if known else Result.BAD_VALUE
            if frame.kind == Kind.BLOCK and frame.sender == block.board:
                if frame.seq == wanted[-1]:
                    break
                end = self.port.clock() + _SILENCE
        return Result.DONE

    def send(self, kind: Kind) -> None:
        """Send a command once and wait for nothing."""
        self._next_seq()
        self._write(Frame(Address.SLAVE_1, Address.LAPTOP, kind, self._seq))

    def listen(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Take what comes for a time, or until a condition holds; whether it holds."""
        end = self.port.clock() + seconds
        while not until() and self.port.clock() < end - _SHORTEST:
            self._next(min(end, self.port.clock() + 0.1))
        return until()

    def _next_seq(self) -> None:
        self._seq = (self._seq + 1) % 256

    def _write(self, frame: Frame) -> None:
        self.port.write(encoded(frame))

    def _next(self, end: float) -> Frame | None:
        """Wait for the next frame that is no event, until the clock says `end`."""
        while True:
            while self._waiting:
                piece = self._waiting.pop(0)
                if isinstance(piece, str):
                    self.lines.append(piece)
                elif piece.kind == Kind.EVENT:
                    self._hear(piece)
                else:
                    self._collect(piece)
                    return piece
            left = end - self.port.clock()
            if left <= _SHORTEST:
                return None
            self.port.timeout = left
            self._waiting += self._splitter.feed(self.port.read(max(1, self.port.in_waiting)))

    def _collect(self, frame: Frame) -> None:
        if frame.kind != Kind.BLOCK or frame.sender not in self.blocks:
            return
        block = self.blocks[frame.sender]
        if block.take(frame) and self._grown is not None:
            self._grown(block)

    def _hear(self, frame: Frame) -> None:
        event = event_of(frame)
        if event is None:
            return
        self._write(Frame(frame.sender, Address.LAPTOP, Kind.HEARD, frame.seq))
        key, now = (frame.seq, frame.payload), self.port.clock()
        # A logger that was reset counts from 0 again: an old number alone is no repeat.
        again = key in self._told and now - self._told[key] < _SAME_EVENT
        self._told[key] = now
        if not again:
            self.events.append(event)
            if self._heard is not None:
                self._heard(event)
