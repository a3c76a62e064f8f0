"""Payloads of commands, replies and events, and the words a person reads for them."""

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
    "event_of",
    "hello_of",
    "status_of",
]

RATES: Final = (50, 100, 200, 400, 800)
SYNCHS: Final = ("six", "short", "radio")
"""Names of the ways to synchronise, by their number in CONFIG."""
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
_PLACES: Final = {1: "front", 2: "rear"}


class Code(IntEnum):
    """What an event tells."""

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
    """What CONFIG sets for the next run.

    Attributes
    ----------
    rate : int
        Rows a second, one of `RATES`; 0 as the knob says.
    mode, synch : int
        Places in `MODES` and `SYNCHS`.
    readings : int
        Conversions averaged to one reading: 1, 2, 4, 8, 16 or 32.
    pre : int
        Rows kept from before the trigger, 0 to 600.
    threshold : int
        Counts of mean deviation of the wheel that count as a shake.
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
    """What Slave 1 told by itself."""

    code: int
    board: int
    state: int
    text: str

    @property
    def said(self) -> str:
        """One sentence that names the board and, where there is one, the mend."""
        whose = f"{_PLACES.get(self.board, 'a')} board (Slave {self.board})"
        match self.code:
            case Code.RUN_STARTED:
                return "the run has started"
            case Code.TRIGGERED:
                return "triggered"
            case Code.RUN_DONE:
                return "the run is done and waits for its transfer"
            case Code.SATURATED:
                return (
                    f"the {whose} read 0 or 1023 ten times, so the run was given up and nothing "
                    "kept; drive it softer or use a sensor of wider range"
                )
            case Code.NO_ANSWER:
                return f"the {whose} does not answer by radio; is it on and in range?"
            case Code.NO_PULSE:
                return (
                    f"the {whose} did not see the synchronisation pulse; mend the wire or give "
                    "--synch radio"
                )
            case Code.BLOCK_READY:
                return f"the {whose} has its block ready"
            case Code.STOPPED:
                return "the run was stopped; nothing is kept"
            case Code.ALL_SENT:
                return "both blocks are acknowledged"
            case Code.OVERRUNS:
                return f"the {whose} missed rows; take a lower rate or fewer readings"
            case Code.RUN_LOST:
                return f"the {whose} has lost the run: it was reset or missed the start"
            case Code.POOR_SIGNAL:
                signal = self.text.rpartition(": ")[2]
                return f"poor signal on the {whose}: {signal}; the data are kept"
            case _:
                return f"the {whose} says: {self.text}"

    @property
    def ends_run(self) -> bool:
        """Whether a run has come to nothing by it: told in standby, and not after the transfer."""
        return self.state == State.STANDBY and self.code in (
            Code.SATURATED, Code.NO_ANSWER, Code.NO_PULSE, Code.STOPPED, Code.RUN_LOST,
        )  # fmt: skip


def hello_of(payload: bytes) -> Hello | None:
    """Read the reply to HELLO; None when it is none."""
    return Hello._make(_HELLO.unpack(payload)) if len(payload) == _HELLO.size else None


def status_of(payload: bytes) -> Status | None:
    """Read the reply to STATUS; None when it is none."""
    return Status._make(_STATUS.unpack(payload)) if len(payload) == _STATUS.size else None


def event_of(frame: Frame) -> Event | None:
    """Read an EVENT frame; None when it is none."""
    if len(frame.payload) < 3 or frame.sender != Address.SLAVE_1:
        return None
    code, board, state = frame.payload[:3]
    text = frame.payload[3:].decode("ascii", "replace")
    return Event(code, board, state, "".join(c if c.isprintable() else "?" for c in text))
