"""Transfer of one run from the logger: started or waited for, fetched, acknowledged.

The logger's state decides at each turn what to do next, so that it does not matter in which state
the logger is found, after an unplugged cable or in a second attempt.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from bayes_asv.acquire.blocks import CPU, MAX_ROWS, Block
from bayes_asv.acquire.client import LoggerClient, NoResponseError
from bayes_asv.acquire.frames import Address, Kind, Result, State
from bayes_asv.acquire.messages import STATES, Code, Event, Settings, Status
from bayes_asv.acquire.text_dump import DUMP_END, agreeing_rows, find_dumps

__all__ = ["HOLDS_RUN", "RunRequest", "transfer_run", "transfer_text"]

HOLDS_RUN: Final = (State.WAITING, State.SENDING_FRONT, State.FETCHING, State.SENDING_REAR)
"""States in which the logger holds rows."""

_MAX_DISCARDS: Final = 3  # fetches of a block whose CRC-32 differs
_POLL_INTERVAL: Final = 3.0  # s between status requests without events
_EVENT_WAIT: Final = 2.5  # s: an event is repeated every 2 s
_DUMP_TIMEOUT: Final = 6.0  # s without a line after which a dump has broken off
_MAX_DUMPS: Final = 4
_MAX_REFUSALS: Final = 5
_FRONT, _REAR = Address.SLAVE_1, Address.SLAVE_2


@dataclass(frozen=True)
class RunRequest:
    """What the user requests of the logger.

    Parameters
    ----------
    settings : Settings or None
        For CONFIG; None leaves the logger's.
    start : bool
        Whether the client starts the run; otherwise the button does.
    trigger : float or None
        Time after arming at which the client triggers, s; None leaves it to a bump or the button.
    wait : float or None
        Longest time to wait for a run that the button starts, s; None for any time.
    resumed : bool
        Whether frames of an earlier session are held.
    discard : bool
        Whether to discard a run that the logger already holds.
    text : bool
        Whether to transfer the run as text dumps instead of frames.
    """

    settings: Settings | None = None
    start: bool = False
    trigger: float | None = None
    wait: float | None = None
    resumed: bool = False
    discard: bool = False
    text: bool = False


@dataclass
class _Progress:
    """What has happened so far."""

    started: bool = False  # by this client
    running: bool = False  # a run exists, whoever started it
    triggered: bool = False
    configured: bool = False
    refusals: int = 0  # of START
    state: int | None = None
    faults: list[str] = field(default_factory=list)


def transfer_run(
    client: LoggerClient, request: RunRequest, say: Callable[[str], None]
) -> tuple[str, ...]:
    """Transfer one run; its frames are in ``client.blocks`` afterwards.

    Parameters
    ----------
    client : LoggerClient
        Its blocks may hold frames of an earlier session.
    request : RunRequest
        What to transfer.
    say : callable
        Called with a message about each change of state.

    Returns
    -------
    tuple of str
        Why nothing or not everything was transferred; empty when both blocks are acknowledged.
        Missing parts of a block are not included.

    Raises
    ------
    NoResponseError
        If the logger does not respond any more.
    """
    progress = _Progress()
    since = client.port.clock()
    checked = False
    while not progress.faults:
        status = client.status()
        state = status.state
        if state != progress.state:
            progress.state = state
            say(f"logger: {_state_text(status)}")
        if state in HOLDS_RUN:
            progress.running = True
            if not checked:
                checked = True
                _check_held_run(client, request, progress, say)
            elif request.text and state in (State.WAITING, State.SENDING_FRONT):
                transfer_text(client)
                break
            elif _advance_transfer(client, State(state), progress):
                break
        elif state == State.STANDBY:
            if _is_complete(client, request):
                break
            if progress.running:
                progress.faults.append(_loss_reason(client))
            elif request.start:
                _start(client, request, progress)
            else:
                _await_start(client, request, since, progress)
        else:
            progress.running |= state != State.STARTING
            _await_run(client, request, State(state) if state in tuple(State) else None, progress)
    return tuple(progress.faults)


def transfer_text(client: LoggerClient, max_dumps: int = _MAX_DUMPS) -> None:
    """Have the logger dump a waiting run as text until two dumps agree on every row.

    The text has no checksum, so that only repeated dumps can verify each other.
    """
    client.lines.clear()
    for _ in range(max_dumps):
        if not _dump(client) or len(agreeing_rows(find_dumps(client.lines))) == MAX_ROWS:
            return


def _dump(client: LoggerClient) -> bool:
    """Have the logger dump once; return whether the dump is complete."""
    before = len(client.lines)

    def complete() -> bool:
        return DUMP_END in client.lines[before:]

    client.send(Kind.DUMP)
    last = client.port.clock()
    while not complete() and client.port.clock() - last < _DUMP_TIMEOUT:
        count = len(client.lines)
        client.listen(0.5, complete)
        if len(client.lines) > count:
            last = client.port.clock()
    client.listen(0.5)  # the reply comes after the text
    return complete()


def _check_held_run(
    client: LoggerClient, request: RunRequest, progress: _Progress, say: Callable[[str], None]
) -> None:
    """Discard blocks of another run, and the run itself if the user requests it."""
    run = client.hello().run
    for board, block in client.blocks.items():
        if block.received and (block.head is None or block.head.run != run):
            client.blocks[board] = Block(board)  # of another run, from an earlier session
    if progress.started or request.resumed or not (request.start or request.discard):
        return
    if request.discard:
        client.command(Kind.STOP)
        say("the run that the logger held is discarded")
        progress.running = False
    else:
        say(
            "the logger already holds a run, which is fetched; none is started (--discard drops it)"
        )


def _advance_transfer(client: LoggerClient, state: State, progress: _Progress) -> bool:
    """Perform the next step of the transfer; return whether it was the last."""
    if state == State.WAITING:
        client.command(Kind.SEND)
        return False
    if state == State.FETCHING:
        client.listen(_POLL_INTERVAL, _event_since(client, Code.BLOCK_READY, _REAR))
        return False
    board = _FRONT if state == State.SENDING_FRONT else _REAR
    block = client.blocks[board]
    result = _fetch(client, block)
    if result != Result.DONE:
        return False  # the state has changed: request it again
    if not block.verified:
        progress.faults.append(
            f"the CRC-32 of board {int(board)} differed after {block.discards} fetches"
        )
        return True
    result = client.acknowledge(block)
    if result == Result.DIFFERS:
        block.discard()
    if result == Result.DONE and board == _REAR:
        client.listen(_EVENT_WAIT, _event_since(client, Code.ALL_SENT, _FRONT))
        return True
    return False


def _fetch(client: LoggerClient, block: Block) -> Result:
    """Request frames until the block is verified, refused, or has failed too often."""
    last = client.port.clock()
    while not block.verified:
        count = block.received
        if block.complete:
            block.discard()
            if block.discards >= _MAX_DISCARDS:
                return Result.DONE
        result = client.get(block)
        if result != Result.DONE:
            return result
        now = client.port.clock()
        if block.received != count:
            last = now
        elif now - last > client.patience:
            raise NoResponseError(f"no frame of the block for {client.patience:g} s")
    return Result.DONE


def _configure(client: LoggerClient, request: RunRequest, progress: _Progress) -> bool:
    """Send the settings once; return whether the logger accepted them."""
    if request.settings is None or progress.configured:
        return True
    result = client.command(Kind.CONFIG, request.settings.payload())
    if result == Result.BAD_VALUE:
        progress.faults.append(
            "the logger refuses these settings; the readings of a row have to fit into its period "
            "(4 at 400 and 800 Hz)"
        )
    progress.configured = result == Result.DONE
    return progress.configured


def _start(client: LoggerClient, request: RunRequest, progress: _Progress) -> None:
    client.start_run()
    if not _configure(client, request, progress):
        return  # refused, or the state has changed: request it again
    result = client.command(Kind.START)
    progress.started = progress.running = result == Result.DONE
    progress.refusals += not progress.started
    if progress.refusals >= _MAX_REFUSALS:
        words = result.name.lower().replace("_", " ")
        progress.faults.append(f"the logger is in standby, but refuses to start ({words})")


def _await_start(
    client: LoggerClient, request: RunRequest, since: float, progress: _Progress
) -> None:
    """Wait for the button."""
    if not _configure(client, request, progress):
        return
    started = _event_since(client, Code.RUN_STARTED, _FRONT)
    count = len(client.events)

    def over() -> bool:
        return started() or any(event.ends_run for event in client.events[count:])

    progress.running |= client.listen(_POLL_INTERVAL, over)
    if request.wait is not None and client.port.clock() - since > request.wait:
        progress.faults.append(f"no run was started within {request.wait:g} s")


def _await_run(
    client: LoggerClient, request: RunRequest, state: State | None, progress: _Progress
) -> None:
    """Wait for the end of a run, and trigger it if requested."""
    if state == State.ARMED and request.trigger is not None and not progress.triggered:
        client.listen(request.trigger, _event_since(client, Code.TRIGGERED, _FRONT))
        client.command(Kind.TRIGGER)
        progress.triggered = True
    count = len(client.events)
    client.listen(
        _POLL_INTERVAL,
        lambda: any(e.ends_run or e.code == Code.RUN_DONE for e in client.events[count:]),
    )


def _event_since(client: LoggerClient, code: Code, board: int) -> Callable[[], bool]:
    """Make a function that returns whether an event has come since now."""
    count = len(client.events)
    return lambda: any((e.code, e.board) == (code, board) for e in client.events[count:])


def _loss_reason(client: LoggerClient) -> str:
    """Why a run ended without data."""

    def last() -> Event | None:
        ends = [event for event in client.events if event.ends_run]
        return ends[-1] if ends else None

    client.listen(_EVENT_WAIT, lambda: last() is not None)
    event = last()
    if event is not None:
        return event.message
    return (
        "the front board (Slave 1) has lost the run: it was reset or stopped; what was received is "
        "kept"
    )


def _is_complete(client: LoggerClient, request: RunRequest) -> bool:
    return request.resumed and all(block.verified for block in client.blocks.values())


def _state_text(status: Status) -> str:
    text = STATES.get(State(status.state)) if status.state in tuple(State) else None
    rate = CPU / (status.prescale * status.cycles) if status.prescale and status.cycles else 0.0
    return f"{text or f'in state {status.state}'} ({rate:g} Hz)"
