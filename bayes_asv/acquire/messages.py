"""Payloads of commands, replies and events, and their text for the user (firmware/PROTOCOL.md)."""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import Final, NamedTuple

from bayes_asv.acquire.frames import Address, Frame, State

__all__ = [
    "MODES",
    "RATES",
    "STATES",
    "SYNCHS",
    "Code",
    "Event",
    "Hello",
    "Settings",
    "Status",
    "parse_event",
    "parse_hello",
    "parse_status",
]

RATES: Final = (50, 100, 200, 400, 800)
SYNCHS: Final = ("six", "short", "radio")
"""Methods of synchronisation, by their number in CONFIG."""
MODES: Final = ("fixed", "loop")

STATES: Final = {
    State.STANDBY: "in standby",
    State.SYNCHRONISING: "synchronising the boards",
    State.ARMED: "armed: waiting for a bump, the button or the trigger",
    State.TAKING: "taking data",
    State.CLOSING: "closing the run",
    State.WAITING: "holding a run that waits for its transfer",
    State.SENDING_FRONT: "sending the front board's block",
    State.FETCHING: "fetching the rear board's block by radio",
    State.SENDING_REAR: "sending the rear board's block",
    State.STARTING: "starting",
}

_HELLO: Final = struct.Struct("<BBBHBB")
_CONFIG: Final = struct.Struct("<HBBBHH")
_STATUS: Final = struct.Struct("<BHHHHHBBBBB")
_AXLES: Final = {1: "front", 2: "rear"}


class Code(IntEnum):
    """Code of an event."""

    RUN_STARTED = 1
    TRIGGERED = 2
    RUN_DONE = 3
    SATURATED = 4
    NO_ANSWER = 5
    NO_PULSE = 6
    BLOCK_READY = 7
    STOPPED = 8
    POOR_SIGNAL = 9
    ALL_SENT = 10
    OVERRUNS = 11
    RUN_LOST = 12


class Hello(NamedTuple):
    """Reply to HELLO."""

    version: int
    board: int
    state: int
    ram_free: int
    run: int
    modem: int


class Status(NamedTuple):
    """Reply to STATUS."""

    state: int
    rate: int
    prescale: int
    cycles: int
    rows: int
    overruns: int
    saturated_front: int
    saturated_rear: int
    verdict_front: int
    verdict_rear: int
    radio_lost: int


class Settings(NamedTuple):
    """Settings of the next run, set by CONFIG.

    Attributes
    ----------
    rate : int
        Rows per second, one of `RATES`; 0 for the logger's knob.
    mode, synch : int
        Indices into `MODES` and `SYNCHS`.
    readings : int
        Conversions averaged to one reading: 1, 2, 4, 8, 16 or 32.
    pre : int
        Rows kept from before the trigger, 0 to 600.
    threshold : int
        Mean deviation of the wheel, counts, that triggers.
    """

    rate: int = 0
    mode: int = 0
    synch: int = 0
    readings: int = 4
    pre: int = 200
    threshold: int = 20

    def payload(self) -> bytes:
        """Return the payload of CONFIG."""
        return _CONFIG.pack(*self)


class Event(NamedTuple):
    """A message that Slave 1 sends unasked."""

    code: int
    board: int
    state: int
    text: str

    @property
    def message(self) -> str:
        """The event for the user, with the board's name and what to do."""
        board = f"{_AXLES.get(self.board, 'a')} board (Slave {self.board})"
        match self.code:
            case Code.RUN_STARTED:
                return "the run has started"
            case Code.TRIGGERED:
                return "triggered"
            case Code.RUN_DONE:
                return "the run is done and waits for its transfer"
            case Code.SATURATED:
                return (
                    f"the {board} read 0 or 1023 ten times, so the run was aborted and discarded; "
                    "drive more gently or use a sensor with a wider range"
                )
            case Code.NO_ANSWER:
                return f"the {board} does not answer by radio; is it on and in range?"
            case Code.NO_PULSE:
                return (
                    f"the {board} did not see the synchronisation pulse; repair the wire or give "
                    "--synch radio"
                )
            case Code.BLOCK_READY:
                return f"the {board} has its block ready"
            case Code.STOPPED:
                return "the run was stopped and discarded"
            case Code.ALL_SENT:
                return "both blocks are acknowledged"
            case Code.OVERRUNS:
                return f"the {board} missed rows; use a lower rate or fewer readings"
            case Code.RUN_LOST:
                return f"the {board} has lost the run: it was reset or missed the start"
            case Code.POOR_SIGNAL:
                signal = self.text.rpartition(": ")[2]
                return f"poor signal on the {board}: {signal}; the data are kept"
            case _:
                return f"the {board} reports: {self.text}"

    @property
    def ends_run(self) -> bool:
        """Whether a run ended without data: sent in standby, and not after the transfer."""
        return self.state == State.STANDBY and self.code in (
            Code.SATURATED, Code.NO_ANSWER, Code.NO_PULSE, Code.STOPPED, Code.RUN_LOST,
        )  # fmt: skip


def parse_hello(payload: bytes) -> Hello | None:
    """Parse the reply to HELLO; None if it is invalid."""
    return Hello._make(_HELLO.unpack(payload)) if len(payload) == _HELLO.size else None


def parse_status(payload: bytes) -> Status | None:
    """Parse the reply to STATUS; None if it is invalid."""
    return Status._make(_STATUS.unpack(payload)) if len(payload) == _STATUS.size else None


def parse_event(frame: Frame) -> Event | None:
    """Parse an EVENT frame; None if it is invalid."""
    if len(frame.payload) < 3 or frame.sender != Address.SLAVE_1:
        return None
    code, board, state = frame.payload[:3]
    text = frame.payload[3:].decode("ascii", "replace")
    return Event(code, board, state, "".join(c if c.isprintable() else "?" for c in text))
