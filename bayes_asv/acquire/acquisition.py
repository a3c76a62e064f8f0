"""Acquisition of a run from the logger, or from the bytes of an earlier one, and its outcome."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bayes_asv import __version__
from bayes_asv.acquire.blocks import Block
from bayes_asv.acquire.client import LoggerClient, NoResponseError, Port
from bayes_asv.acquire.frames import Address, Kind
from bayes_asv.acquire.merge import MergedRun, merge_blocks
from bayes_asv.acquire.messages import Code, Event
from bayes_asv.acquire.port import PortLostError
from bayes_asv.acquire.text_dump import find_dumps, merge_dumps
from bayes_asv.acquire.transfer import RunRequest, transfer_run
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike, read_bytes
from bayes_asv.domain.recording import Recording

__all__ = ["Outcome", "acquire", "outcome_document", "outcome_lines", "replay_file"]

_MAX_RAW_SIZE = 50_000_000  # bytes: half a day of a busy serial line
_FIRST_ANSWER = 0.25  # share of the patience for the first answer


@dataclass(frozen=True)
class Outcome:
    """Result of an acquisition.

    Parameters
    ----------
    verdict : {'ok', 'incomplete', 'refused'}
        Complete; written with gaps; nothing to write.
    reasons, warnings : tuple of str
        Why it is incomplete; other notes.
    recording : Recording or None
        In counts.
    blocks : tuple of dict
        What was received of each board's block.
    drift, offset : float or None
        See :class:`bayes_asv.acquire.merge.MergedRun`.
    retries, corrupted : int
        Commands sent again; pieces of the stream that were neither frame nor text.
    events : tuple of str
        The logger's own messages.
    """

    verdict: str
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]
    recording: Recording | None
    blocks: tuple[dict[str, Any], ...]
    drift: float | None
    offset: float | None
    retries: int
    corrupted: int
    events: tuple[str, ...]


def acquire(
    port: Port,
    request: RunRequest,
    *,
    patience: float = 60.0,
    held: bytes = b"",
    source: str = "",
    rate: float | None = None,
    say: Callable[[str], None] = lambda text: None,
    on_block: Callable[[Block], None] | None = None,
    seq: int | None = None,
) -> Outcome:
    """Acquire one run over a port; whatever stops it, the outcome has what was received.

    Parameters
    ----------
    port : Port
        Open; the caller closes it.
    request : RunRequest
        What to request of the logger.
    patience : float
        Time without an answer after which the acquisition fails, s; a quarter of it for the first.
    held : bytes
        Bytes received in an earlier session of the same run.
    source : str
        Name of the recording.
    rate : float or None
        Rows per second, Hz, of a text dump that does not state it.
    say : callable
        Called with a message about what happens.
    on_block : callable, optional
        Called with a block whenever one of its frames has arrived.
    seq : int, optional
        Number before the first command's; random without it.
    """

    def on_event(event: Event) -> None:
        say(event.message)

    client = LoggerClient(port, on_event, on_block, patience=_FIRST_ANSWER * patience, seq=seq)
    client.replay(held)
    client.events[:] = [event for event in client.events if not event.ends_run]
    faults: tuple[str, ...] = ()
    try:
        _identify(client)
        client.patience = patience
        faults = transfer_run(client, request, say)
    except (NoResponseError, PortLostError, InputError) as error:  # the last: the disk is full
        faults = (str(error),)
    except KeyboardInterrupt:
        faults = ("interrupted",)
    warnings = _session_warnings(port, client, request)
    outcome = _conclude(client, faults, rate=rate, source=source, warnings=warnings)
    if request.text and outcome.verdict == "ok":
        # A text transfer has no acknowledgement: the logger would keep holding the run.
        with contextlib.suppress(NoResponseError, PortLostError, InputError):
            client.command(Kind.STOP)
    return outcome


def replay_file(path: PathLike, rate: float | None = None, source: str = "") -> Outcome:
    """Process the bytes that an earlier acquisition saved.

    Parameters
    ----------
    path : str or os.PathLike
        The file of raw bytes.
    rate : float or None
        Rows per second, Hz, of a text dump that does not state it.
    source : str
        Name of the recording.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    client = LoggerClient(_NullPort())
    client.replay(read_bytes(path, _MAX_RAW_SIZE))
    return _conclude(client, rate=rate, source=source)


def outcome_document(outcome: Outcome, recording: str, raw: str) -> dict[str, Any]:
    """Return the JSON document of schema ``bayes_asv/acquire/1``."""
    rows = 0 if outcome.recording is None else len(outcome.recording.time)
    rate = None if outcome.recording is None else outcome.recording.get("sample_rate")
    return {
        "schema": "bayes_asv/acquire/1",
        "verdict": outcome.verdict,
        "reasons": list(outcome.reasons),
        "warnings": list(outcome.warnings),
        "recording": None if outcome.recording is None else recording,
        "raw": raw,
        "rows": rows,
        "sample_rate": rate,
        "drift_ppm": None if outcome.drift is None else round(1e6 * outcome.drift, 4),
        "offset_us": None if outcome.offset is None else round(1e6 * outcome.offset, 3),
        "blocks": list(outcome.blocks),
        "events": list(outcome.events),
        "commands_repeated": outcome.retries,
        "frames_spoilt": outcome.corrupted,
        "version": __version__,
    }


def outcome_lines(outcome: Outcome, recording: str, raw: str) -> list[str]:
    """Describe an outcome for the user."""
    if outcome.recording is None:
        lines = [
            f"No recording was written: {outcome.reasons[0] if outcome.reasons else 'no rows'}."
        ]
        reasons = outcome.reasons[1:]
    else:
        run = outcome.recording
        seconds = float(run.time[-1] - run.time[0])
        verdict = "complete and verified" if outcome.verdict == "ok" else "INCOMPLETE"
        lines = [
            f"{recording}: {len(run.time)} rows at {run.get('sample_rate')}, {seconds:.3f} s, "
            f"{verdict}."
        ]
        if outcome.drift is not None:
            lines.append(
                f"The rear board's clock runs {1e6 * outcome.drift:+.2f} ppm against the front's; "
                "the recording's metadata correct it."
            )
        reasons = outcome.reasons
    lines += [f"Incomplete: {reason}." for reason in reasons]
    lines += [f"Note: {warning}." for warning in outcome.warnings]
    lines.append(f"Every byte received is in {raw}.")
    return lines


def _conclude(
    client: LoggerClient,
    faults: tuple[str, ...] = (),
    *,
    rate: float | None = None,
    source: str = "",
    warnings: tuple[str, ...] = (),
) -> Outcome:
    """Assemble the outcome of what a client has received.

    Parameters
    ----------
    client : LoggerClient
        After the transfer, or after a replay.
    faults : tuple of str
        What went wrong in the transfer.
    rate : float or None
        Rows per second, Hz, of a text dump that does not state it.
    source : str
        Name of the recording.
    warnings : tuple of str
        Other notes about the transfer.
    """
    front, rear = (client.blocks[b] for b in (Address.SLAVE_1, Address.SLAVE_2))
    dumps = find_dumps(client.lines)
    merged: MergedRun
    if front.received or rear.received or not dumps:
        merged = merge_blocks(front, rear, source)
    else:
        merged = merge_dumps(dumps, rate, source)
    signals = [e.message for e in client.events if e.code in (Code.POOR_SIGNAL, Code.NO_PULSE)]
    new = (signal for signal in dict.fromkeys(signals) if signal not in faults)
    # If nothing was received, the faults say why, and those of the blocks add nothing.
    nothing = not (front.received or rear.received or dumps)
    reasons = faults if nothing and faults else (*faults, *merged.faults)
    verdict = "refused" if merged.recording is None else "incomplete" if reasons else "ok"
    return Outcome(
        verdict,
        reasons,
        (*warnings, *merged.warnings, *new),
        _add_notes(merged.recording, (*faults, *warnings, *signals)),
        (_block_summary(front, "front"), _block_summary(rear, "rear")),
        merged.drift,
        merged.offset,
        client.retries,
        client.corrupted,
        tuple(event.text for event in client.events),
    )


def _add_notes(recording: Recording | None, notes: tuple[str, ...]) -> Recording | None:
    if recording is None:
        return None
    more = tuple(("note", note) for note in dict.fromkeys(notes))
    return Recording(
        recording.time,
        recording.values,
        recording.units,
        (*recording.metadata, *more),
        recording.source,
    )


def _block_summary(block: Block, name: str) -> dict[str, Any]:
    head = block.head
    return {
        "board": name,
        "run": None if head is None else head.run,
        "frames": block.received,
        "frames_expected": block.expected,
        "rows": None if head is None else head.rows,
        "verified": block.verified,
        "overruns": None if head is None else head.overruns,
        "readings_at_rail": None if head is None else head.saturated,
        "frames_disputed": block.conflicts,
        "fetched_again": block.discards,
    }


def _session_warnings(port: Port, client: LoggerClient, request: RunRequest) -> tuple[str, ...]:
    """Warn of a lost port, and of a rate that differs from the requested one."""
    warnings = []
    losses = getattr(port, "losses", 0)
    if losses:
        times = "once" if losses == 1 else f"{losses} times"
        warnings.append(f"the port was disconnected {times}; the transfer continued")
    head = client.blocks[Address.SLAVE_1].head
    requested = request.settings.rate if request.settings is not None else 0
    if head is not None and requested and head.rate != requested:
        warnings.append(f"{requested} Hz were requested, but the run was taken at {head.rate} Hz")
    return tuple(warnings)


def _identify(client: LoggerClient) -> None:
    """Check that the front board answers.

    Raises
    ------
    NoResponseError
        With what to check.
    """
    try:
        client.hello()
    except NoResponseError:
        try:
            client.hello(Address.MASTER)
        except NoResponseError:
            raise NoResponseError(
                "no logger answers at this port; is it on, in range, and is this its port?"
            ) from None
        raise NoResponseError(
            "the Master answers, but the front board (Slave 1) does not; is it on and in range?"
        ) from None


class _NullPort:
    """A port that is not connected."""

    timeout = 0.0
    in_waiting = 0

    def read(self, size: int = 1) -> bytes:
        return b""

    def write(self, data: bytes) -> int:
        return len(data)

    def clock(self) -> float:
        return 0.0
