"""``bayes-asv acquire``."""

from __future__ import annotations

import os
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import click

from bayes_asv.acquire.messages import MODES, RATES, SYNCHS
from bayes_asv.cli import common
from bayes_asv.domain.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from bayes_asv.acquire.acquisition import Outcome
    from bayes_asv.acquire.blocks import Block
    from bayes_asv.acquire.tracking import TransferOnlineFilter
    from bayes_asv.acquire.transfer import RunRequest
    from bayes_asv.library.progress import Report

__all__ = ["command"]

_STATUS = {"ok": 0, "incomplete": 3, "refused": 3}
_FRAMES = 83  # of a full block, until its HEAD frame has come


@click.command("acquire")
@click.option("-o", "output", required=True, metavar="REC", help="The recording to write.")
@click.option("--port", metavar="P", help="The logger's port; by default the only one there is.")
@click.option("--start", is_flag=True, help="Start the run from here; otherwise wait for it.")
@click.option(
    "--frequency", type=click.Choice([str(rate) for rate in RATES]), metavar="HZ",
    help=f"Sampling rate: {', '.join(map(str, RATES))}; by default that of the logger's knob.",
)  # fmt: skip
@click.option(
    "--mode", type=click.Choice(MODES), help="Record from the start, or in a loop until a trigger."
)
@click.option(
    "--synch", type=click.Choice(SYNCHS),
    help="Clock synchronisation: six steps, the short form, or by radio.",
)  # fmt: skip
@click.option(
    "--readings", type=click.Choice(["1", "2", "4", "8", "16", "32"]), metavar="N",
    help="Conversions averaged to one reading.  [default: 4]",
)  # fmt: skip
@click.option(
    "--pre", type=click.IntRange(0, 600), metavar="ROWS",
    help="With --mode loop: rows kept from before the trigger.  [default: 200]",
)  # fmt: skip
@click.option(
    "--threshold", type=click.IntRange(1, 1023), metavar="COUNTS",
    help="With --mode loop: change of a reading that triggers.  [default: 20]",
)  # fmt: skip
@click.option(
    "--trigger", type=click.FloatRange(0.0, 3600.0), metavar="SECONDS",
    help="With --mode loop: trigger from here this long after arming.",
)  # fmt: skip
@click.option(
    "--wait", type=click.FloatRange(0.0), metavar="SECONDS",
    help="Give up when no run begins in this time.",
)  # fmt: skip
@click.option(
    "--patience", type=click.FloatRange(1.0), default=60.0, show_default=True, metavar="SECONDS",
    help="Give up after this long without an answer.",
)  # fmt: skip
@click.option(
    "--cable", type=click.FloatRange(0.0), default=600.0, show_default=True, metavar="SECONDS",
    help="Wait this long for a cable that was unplugged.",
)  # fmt: skip
@click.option("--discard", is_flag=True, help="Discard a run that the logger already holds.")
@click.option("--text", is_flag=True, help="Read the text dump, more than once, instead of frames.")
@click.option("--raw", metavar="FILE", help="File for every byte.  [default: REC.raw]")
@click.option("--resume", is_flag=True, help="Continue the run whose bytes are in the raw file.")
@click.option(
    "--watch", is_flag=True, help="Track c_f, c_r and i while rows arrive; needs --vehicle."
)
@click.option("--vehicle", "-v", metavar="V.toml", help="With --watch: the vehicle file.")
@click.option("--replay", metavar="FILE", help="Read a raw file again instead of a port.")
@common.rate_option
@common.json_option
def command(
    output: str,
    port: str | None,
    raw: str | None,
    resume: bool,
    replay: str | None,
    rate: float | None,
    json_file: str | None,
    watch: bool,
    vehicle: str | None,
    **options: Any,
) -> int:
    """Read a recording from the data logger over its serial port.

    Every byte is written to disk before it is read. Missing frames are requested again; what never
    arrives is missing in the recording, with a note, and the exit status is 3.
    """
    request = _request(resume=resume, **{k: options[k] for k in _REQUEST_OPTIONS})
    if replay is not None and (port is not None or resume or raw is not None or request.start):
        raise click.UsageError("--replay takes no port: leave out --port, --raw, --resume, --start")
    if watch != (vehicle is not None):
        raise click.UsageError("--watch and --vehicle belong together")
    raw_file = replay or raw or f"{output}.raw"
    common.check_outputs((replay, vehicle), output, json_file, None if replay else raw_file)
    from bayes_asv.acquire.acquisition import outcome_document, outcome_lines, replay_file
    from bayes_asv.io import write_recording

    watcher = None if vehicle is None else _watcher(vehicle)
    if replay is not None:
        outcome = replay_file(replay, rate, output)
    else:
        outcome = _acquire(
            port, raw_file, output, request, rate, options["patience"], options["cable"], watcher
        )  # fmt: skip
    report, messages = (
        outcome_document(outcome, output, raw_file),
        outcome_lines(outcome, output, raw_file),
    )
    if outcome.recording is not None:
        write_recording(outcome.recording, output)
        if watcher is not None:
            from bayes_asv.library.tracks import track_of

            track = track_of(watcher.finish(outcome.recording))
            report["track"] = track.document.to_dict()
            messages += track.lines()
    common.output(report, messages, json_file)
    return _STATUS[outcome.verdict]


_REQUEST_OPTIONS = (
    "start", "frequency", "mode", "synch", "readings", "pre", "threshold", "trigger", "wait",
    "discard", "text",
)  # fmt: skip


def _request(
    *,
    start: bool,
    frequency: str | None,
    mode: str | None,
    synch: str | None,
    readings: str | None,
    pre: int | None,
    threshold: int | None,
    trigger: float | None,
    wait: float | None,
    discard: bool,
    text: bool,
    resume: bool,
) -> RunRequest:
    """Combine the options, and refuse combinations that do not fit."""
    from bayes_asv.acquire.messages import Settings
    from bayes_asv.acquire.transfer import RunRequest

    loop = mode == "loop"
    for name, value in (("--pre", pre), ("--threshold", threshold), ("--trigger", trigger)):
        if value is not None and not loop:
            raise click.UsageError(f"{name} belongs to --mode loop")
    if resume and (start or discard):
        raise click.UsageError("--resume continues a run: leave out --start and --discard")
    given = (frequency, mode, synch, readings, pre, threshold)
    settings = None
    if any(value is not None for value in given):
        usual = Settings()
        settings = Settings(
            rate=int(frequency or 0),
            mode=int(loop),
            synch=SYNCHS.index(synch) if synch else usual.synch,
            readings=int(readings) if readings else usual.readings,
            pre=usual.pre if pre is None else pre,
            threshold=threshold or usual.threshold,
        )
    return RunRequest(settings, start, trigger, wait, resume, discard, text)


def _acquire(
    name: str | None,
    raw_file: str,
    output: str,
    request: RunRequest,
    rate: float | None,
    patience: float,
    cable: float,
    watcher: TransferOnlineFilter | None,
) -> Outcome:
    """Read a run over the port, with messages and a progress bar on standard error."""
    from bayes_asv.acquire.acquisition import acquire
    from bayes_asv.acquire.port import SavingPort, find_port
    from bayes_asv.library.progress import progress_bar

    held = _held(raw_file) if request.resumed else b""
    if not request.resumed and os.path.exists(raw_file):
        raise InputError(
            raw_file, "exists already", "give --resume to continue it, or another file with --raw"
        )
    chosen = name or find_port()
    with ExitStack() as stack:
        progress = stack.enter_context(progress_bar())
        port = stack.enter_context(
            SavingPort(chosen, raw_file, resume=request.resumed, patience=cable, say=common.say)
        )
        common.say(f"{chosen}: every byte is kept in {raw_file}")
        return acquire(
            port,
            request,
            patience=patience,
            held=held,
            source=output,
            rate=rate,
            say=common.say,
            on_block=_block_callback(progress, watcher),
        )


def _watcher(vehicle: str) -> TransferOnlineFilter:
    from bayes_asv.acquire.tracking import TransferOnlineFilter
    from bayes_asv.domain.vehicle import read_vehicle

    return TransferOnlineFilter(read_vehicle(vehicle), common.say)


def _block_callback(
    progress: Report | None, watcher: TransferOnlineFilter | None
) -> Callable[[Block], None]:
    """Make the function that is called with a block whenever a frame of it has arrived."""

    def on_block(block: Block) -> None:
        if watcher is not None:
            watcher.on_block(block)
        if progress is None:
            return
        share = block.received / (block.expected or _FRAMES)
        first = block.board == 1
        name, expected = "front" if first else "rear", block.expected or "?"
        words = f"{name} board, {block.received} of {expected} frames"
        progress(0.5 * share + (0.0 if first else 0.5), words)

    return on_block


def _held(raw_file: str) -> bytes:
    from bayes_asv.domain.files import read_bytes

    return read_bytes(raw_file, 50_000_000)
