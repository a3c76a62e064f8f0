"""``bayes-asv track``."""

from __future__ import annotations

import time
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

import click

from bayes_asv.cli import common
from bayes_asv.cli.live_options import followed, live_options, wishes

if TYPE_CHECKING:
    from bayes_asv.live.sources import About
    from bayes_asv.tracking.frames import Frames
    from bayes_asv.tracking.tracker import Tracker

__all__ = ["command", "engine_option", "forget_option"]

forget_option = click.option(
    "--forget", type=click.FloatRange(0.0, min_open=True), metavar="SECONDS",
    help="Let c_f, c_r and i wander by 10 % (one deviation) in this time; constant without it.",
)  # fmt: skip
engine_option = click.option(
    "--engine", type=click.Choice(["compiled", "filterpy"]), default="compiled", show_default=True,
    help="The fast form of the filter, or the one made to be read; both say the same.",
)  # fmt: skip


@click.command("track")
@click.argument("recording", required=False, metavar="[REC]")
@common.vehicle_option
@forget_option
@engine_option
@click.option("--trace", metavar="FILE.csv", help="Write what was known after each row.")
@live_options
@common.json_option
@common.rate_option
@common.seed_option
def command(
    recording: str | None,
    vehicle: str,
    forget: float | None,
    engine: str,
    trace: str | None,
    json_file: str | None,
    rate: float | None,
    seed: int,
    **shown: Any,
) -> int:
    """Track c_f, c_r and i through a recording, or live from the logger, row by row."""
    wanted = wishes(recording, **shown)
    common.check_outputs((recording, vehicle), json_file, trace, wanted.gif, wanted.keep)
    runs, car = common.read_inputs(() if recording is None else (recording,), vehicle, rate)
    began = time.perf_counter()
    trackers: list[Tracker] = []

    def make(about: About) -> Tracker:
        from bayes_asv.tracking.tracker import tracker_for

        trackers.append(
            tracker_for(about.start, car, rate=about.rate, forget=forget, engine=engine)
        )
        return trackers[0]

    # A bar would lie over the view, and of a port nobody knows how much is to come.
    quiet = wanted.shown or wanted.port is not None
    with nullcontext() if quiet else common.progress_bar() as progress:
        from bayes_asv.report.trace import Trace
        from bayes_asv.tracking.decimation import DecimatedFrames
        from bayes_asv.tracking.track import concluded, track

        rows = None if trace is None else Trace(car)
        if rows is not None:
            click.get_current_context().call_on_close(rows.close)
        # of a recording all is kept, as it is itself; a drive from a port may last for hours
        kept = DecimatedFrames(len(runs[0].time)) if runs else DecimatedFrames()

        def keep(frames: Frames) -> None:
            kept.append(frames)
            if rows is not None:
                rows.append(frames)

        if runs and not (wanted.shown or wanted.gif):
            result = track(runs[0], car, forget=forget, engine=engine, progress=progress)
            if rows is not None:
                rows.append(result.frames)
        else:
            followed(wanted, runs[0] if runs else None, car, make, keep, rate, progress)
            if not trackers:
                click.echo("nothing came in, so there is nothing to tell", err=True)
                return common.EXIT_STATUS["refused"]
            result = concluded(
                trackers[0],
                kept.frames(),
                runs[0].source if runs else str(wanted.port),
                runs[0].sha256 if runs else "",
                runs[0].warnings if runs else (),
                time.perf_counter() - began,
            )
    from bayes_asv.domain.files import write_atomically
    from bayes_asv.report.track_document import track_document
    from bayes_asv.report.track_words import track_lines

    document = track_document(result, trace, seed)
    if trace is not None and rows is not None:
        write_atomically(trace, rows.pieces())
    common.write_json(document, json_file)
    click.echo("\n".join(track_lines(document)), err=json_file == "-")
    return common.EXIT_STATUS[result.verdict]
