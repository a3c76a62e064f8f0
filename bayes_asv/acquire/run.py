"""One run from the logger to the laptop: started or waited for, fetched, acknowledged.

The logger's state decides at each turn what is to be done, so it does not matter in which state it
is found, after a pulled cable or in a second attempt.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from bayes_asv.acquire.blocks import MOST_ROWS, Block
from bayes_asv.acquire.dump import DUMP_END, agreed, dumps_in
from bayes_asv.acquire.frames import Address, Kind, Result, State
from bayes_asv.acquire.laptop import Laptop, SilentError
from bayes_asv.acquire.messages import STATES, Code, Event, Settings, Status

__all__ = ["LEAVES_A_RUN", "Request", "bring", "bring_text"]

LEAVES_A_RUN: Final = (State.WAITING, State.SENDING_FRONT, State.FETCHING, State.SENDING_REAR)
"""States in which the logger holds rows."""

_MOST_DROPS: Final = 3  # times that a block whose CRC-32 differs is fetched again
_LOOK: Final = 3.0  # s between looks at the state while nothing is said
_LAST_WORDS: Final = 2.5  # s: an event is repeated every 2 s
_DUMP_SILENCE: Final = 6.0  # s without a line after which a dump has broken off
_MOST_DUMPS: Final = 4
_MOST_REFUSALS: Final = 5
_FRONT, _REAR = Address.SLAVE_1, Address.SLAVE_2


@dataclass(frozen=True)
class Request:
    """What the user wants of the logger.

    Parameters
    ----------
    settings : Settings or None
        For CONFIG; None leaves them.
    start : bool
        Whether the laptop starts the run, or the button does.
    trigger : float or None
        s after arming at which the laptop triggers; None leaves it to bump and button.
    wait : float or None
        s to wait for a run that the button starts; None as long as it takes.
    resumed : bool
        Whether frames of an earlier session are held already.
    discard : bool
        Whether a run that the logger holds already is given up.
    text : bool
        Whether the run is to come as text, twice, instead of in frames.
    """

    settings: Settings | None = None
    start: bool = False
    trigger: float | None = None
    wait: float | None = None
    resumed: bool = False
    discard: bool = False
    text: bool = False


@dataclass
class _Course:
    """What has happened so far."""

    started: bool = False  # by us
    begun: bool = False  # a run is under way, by whomever
    triggered: bool = False
    configured: bool = False
    refused: int = 0  # STARTs
    seen: int | None = None
    faults: list[str] = field(default_factory=list)


def bring(laptop: Laptop, request: Request, say: Callable[[str], None]) -> tuple[str, ...]:
    """Bring one run to the laptop; its frames are in ``laptop.blocks`` afterwards.

    Parameters
    ----------
    laptop : Laptop
        At the line; its blocks may hold frames of an earlier session.
    request : Request
        What is wanted.
    say : callable
        Told what happens, a sentence at a time.

    Returns
    -------
    tuple of str
        Why nothing or not everything came; empty when both blocks are acknowledged. What of a
        block is missing is not among them.

    Raises
    ------
    SilentError
        If nothing answers any more.
    """
    course = _Course()
    since = laptop.port.clock()
    settled = False
    while not course.faults:
        status = laptop.status()
        state = status.state
        if state != course.seen:
            course.seen = state
            say(f"logger: {_state(status)}")
        if state in LEAVES_A_RUN:
            course.begun = True
            if not settled:
                settled = True
                _settle(laptop, request, course, say)
            elif request.text and state in (State.WAITING, State.SENDING_FRONT):
                bring_text(laptop)
                break
            elif _transfer(laptop, State(state), course):
                break
        elif state == State.STANDBY:
            if _resumed_whole(laptop, request):
                break
            if course.begun:
                course.faults.append(_why_lost(laptop))
            elif request.start:
                _start(laptop, request, course)
            else:
                _await_button(laptop, request, since, course)
        else:
            course.begun |= state != State.STARTING
            _follow(laptop, request, State(state) if state in tuple(State) else None, course)
    return tuple(course.faults)


def bring_text(laptop: Laptop, most: int = _MOST_DUMPS) -> None:
    """Let the logger dump a waiting run as text until every row has come twice alike.

    The text has no check of its own, so one dump is held against the others.
    """
    laptop.lines.clear()
    for _ in range(most):
        if not _dumped(laptop) or len(agreed(dumps_in(laptop.lines))) == MOST_ROWS:
            return


def _dumped(laptop: Laptop) -> bool:
    """Let the logger dump once; whether it ended."""
    before = len(laptop.lines)

    def ended() -> bool:
        return DUMP_END in laptop.lines[before:]

    laptop.send(Kind.DUMP)
    last = laptop.port.clock()
    while not ended() and laptop.port.clock() - last < _DUMP_SILENCE:
        held = len(laptop.lines)
        laptop.listen(0.5, ended)
        if len(laptop.lines) > held:
            last = laptop.port.clock()
    laptop.listen(0.5)  # its reply comes behind the text
    return ended()


def _settle(laptop: Laptop, request: Request, course: _Course, say: Callable[[str], None]) -> None:
    """Decide about a run before its transfer: whether it is wanted, and what is held of it."""
    run = laptop.hello().run
    for board, block in laptop.blocks.items():
        if block.come and (block.head is None or block.head.run != run):
            laptop.blocks[board] = Block(board)  # of another run, from an earlier session
    if course.started or request.resumed or not (request.start or request.discard):
        return
    if request.discard:
        laptop.order(Kind.STOP)
        say("the run that the logger held is given up")
        course.begun = False
    else:
        say("the logger holds a run already: it is fetched, and none started (--discard drops it)")


def _transfer(laptop: Laptop, state: State, course: _Course) -> bool:
    """Do what a state that leaves a run asks for; whether that was the last of it."""
    if state == State.WAITING:
        laptop.order(Kind.SEND)
        return False
    if state == State.FETCHING:
        laptop.listen(_LOOK, _event_since(laptop, Code.BLOCK_READY, _REAR))
        return False
    board = _FRONT if state == State.SENDING_FRONT else _REAR
    block = laptop.blocks[board]
    fetched = _fetch(laptop, block)
    if fetched != Result.DONE:
        return False  # its state has changed: look again
    if not block.verified:
        course.faults.append(
            f"the CRC-32 of board {int(board)} differed after {block.dropped} fetches"
        )
        return True
    answered = laptop.done(block)
    if answered == Result.DIFFERS:
        block.drop()
    if answered == Result.DONE and board == _REAR:
        laptop.listen(_LAST_WORDS, _event_since(laptop, Code.ALL_SENT, _FRONT))
        return True
    return False


def _fetch(laptop: Laptop, block: Block) -> Result:
    """GET until the block is verified, refused, or wrong for good."""
    last = laptop.port.clock()
    while not block.verified:
        held = block.come
        if block.complete:
            block.drop()
            if block.dropped >= _MOST_DROPS:
                return Result.DONE
        answered = laptop.get(block)
        if answered != Result.DONE:
            return answered
        now = laptop.port.clock()
        if block.come != held:
            last = now
        elif now - last > laptop.patience:
            raise SilentError(f"no frame of the block for {laptop.patience:g} s")
    return Result.DONE


def _configure(laptop: Laptop, request: Request, course: _Course) -> bool:
    """Send the settings, once; whether they hold."""
    if request.settings is None or course.configured:
        return True
    answered = laptop.order(Kind.CONFIG, request.settings.payload())
    if answered == Result.BAD_VALUE:
        course.faults.append(
            "the logger refuses these settings; a row's readings have to fit into its period "
            "(4 at 400 and 800 Hz)"
        )
    course.configured = answered == Result.DONE
    return course.configured


def _start(laptop: Laptop, request: Request, course: _Course) -> None:
    laptop.begin_run()
    if not _configure(laptop, request, course):
        return  # wrong, or its state has changed: look again
    answered = laptop.order(Kind.START)
    course.started = course.begun = answered == Result.DONE
    course.refused += not course.started
    if course.refused >= _MOST_REFUSALS:
        words = answered.name.lower().replace("_", " ")
        course.faults.append(f"the logger stands by, but refuses to start ({words})")


def _await_button(laptop: Laptop, request: Request, since: float, course: _Course) -> None:
    if not _configure(laptop, request, course):
        return
    begun = _event_since(laptop, Code.RUN_STARTED, _FRONT)
    told = len(laptop.events)

    def over() -> bool:
        return begun() or any(event.ends_run for event in laptop.events[told:])

    course.begun |= laptop.listen(_LOOK, over)
    if request.wait is not None and laptop.port.clock() - since > request.wait:
        course.faults.append(f"no run was started within {request.wait:g} s")


def _follow(laptop: Laptop, request: Request, state: State | None, course: _Course) -> None:
    """Listen while a run is on its way, and trigger it where that is wanted."""
    if state == State.ARMED and request.trigger is not None and not course.triggered:
        laptop.listen(request.trigger, _event_since(laptop, Code.TRIGGERED, _FRONT))
        laptop.order(Kind.TRIGGER)
        course.triggered = True
    told = len(laptop.events)
    laptop.listen(_LOOK, lambda: any(e.ends_run or e.code == Code.RUN_DONE
                                     for e in laptop.events[told:]))  # fmt: skip


def _event_since(laptop: Laptop, code: Code, board: int) -> Callable[[], bool]:
    """Whether an event has come since this was called."""
    told = len(laptop.events)
    return lambda: any((e.code, e.board) == (code, board) for e in laptop.events[told:])


def _why_lost(laptop: Laptop) -> str:
    """Why a run that was under way has come to nothing."""

    def last() -> Event | None:
        ends = [event for event in laptop.events if event.ends_run]
        return ends[-1] if ends else None

    laptop.listen(_LAST_WORDS, lambda: last() is not None)
    event = last()
    if event is not None:
        return event.said
    return (
        "the front board (Slave 1) has lost the run: it was reset, or somebody stopped it; "
        "what had come is kept"
    )


def _resumed_whole(laptop: Laptop, request: Request) -> bool:
    return request.resumed and all(block.verified for block in laptop.blocks.values())


def _state(status: Status) -> str:
    words = STATES.get(State(status.state)) if status.state in tuple(State) else None
    rate = 4e6 / (status.prescale * status.cycles) if status.prescale and status.cycles else 0.0
    return f"{words or f'in state {status.state}'} ({rate:g} Hz)"
