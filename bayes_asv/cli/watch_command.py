"""``bayes-asv watch``."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

import click

from bayes_asv.cli import common
from bayes_asv.cli.track_command import engine_option

if TYPE_CHECKING:
    from bayes_asv.domain.vehicle import Vehicle
    from bayes_asv.live.sources import Source
    from bayes_asv.tracking.alarm import Alarm, AlarmMonitor
    from bayes_asv.tracking.tracker import Tracker

__all__ = ["command"]

_ALARM = 5
_BAUD = 115_200


@click.command("watch")
@click.argument("recording", required=False, metavar="[REC]")
@common.vehicle_option
@click.option(
    "--below", type=click.FloatRange(1.0, 99.0), default=80.0, show_default=True,
    metavar="PERCENT", help="Share of its nominal rate below which a damper counts as worn.",
)  # fmt: skip
@click.option(
    "--sure", type=click.FloatRange(50.0, 99.999), default=99.0, show_default=True,
    metavar="PERCENT", help="Probability of that which has to be passed.",
)  # fmt: skip
@click.option(
    "--hold", type=click.FloatRange(0.0, 3600.0), default=1.0, show_default=True,
    metavar="SECONDS", help="Time for which it has to be.",
)  # fmt: skip
@click.option(
    "--forget", type=click.FloatRange(0.0, min_open=True), default=60.0, show_default=True,
    metavar="SECONDS", help="Let c_f, c_r and i wander by 10 % (one deviation) in this time.",
)  # fmt: skip
@engine_option
@click.option("--port", metavar="P", help="A serial port instead of a recording.")
@click.option(
    "--baud", type=click.IntRange(300, 4_000_000), default=_BAUD, show_default=True, metavar="N",
    help="Bits a second of the port.",
)  # fmt: skip
@click.option(
    "--keep", metavar="FILE",
    help="Where every byte of the port is kept.  [default: watch-DATE-TIME.txt]",
)  # fmt: skip
@common.json_option
@common.rate_option
@common.seed_option
def command(
    recording: str | None,
    vehicle: str,
    below: float,
    sure: float,
    hold: float,
    forget: float,
    engine: str,
    port: str | None,
    baud: int,
    keep: str | None,
    json_file: str | None,
    rate: float | None,
    seed: int,
) -> int:
    """Track, and raise an alarm, exit status 5, when a damper has become too soft.

    It ends at the alarm, with the recording, or by Ctrl-C.
    """
    if (recording is None) == (port is None):
        raise click.UsageError("give either a recording or --port")
    if port is None and keep is not None:
        raise click.UsageError("--keep belongs to --port")
    if port is not None and keep is None:
        keep = time.strftime("watch-%Y%m%d-%H%M%S.txt")
    common.check_outputs((recording, vehicle), json_file, keep)
    runs, car = common.read_inputs(() if recording is None else (recording,), vehicle, rate)
    from bayes_asv.live.sources import PortSource, RecordingSource
    from bayes_asv.tracking.alarm import AlarmMonitor

    source: Source
    if runs:
        source = RecordingSource(runs[0], car)
    else:
        from bayes_asv.live.port import PortReader

        assert port is not None
        assert keep is not None
        source = PortSource(PortReader(port, keep, baud), port, car, rate)
        click.echo(f"Every byte of {port} is kept in {keep}; Ctrl-C ends it", err=True)
    dog = AlarmMonitor(car, below / 100.0, sure / 100.0, hold)
    tracker, alarm = _watch(source, dog, car, forget, engine)
    if tracker is None:
        click.echo("nothing came in, so there is nothing to tell", err=True)
        return common.EXIT_STATUS["refused"]
    from bayes_asv.report.watch_document import watch_document
    from bayes_asv.report.watch_words import watch_lines

    name = runs[0].source if runs else str(port)
    document = watch_document(tracker, dog, alarm, name, seed)
    common.write_json(document, json_file)
    click.echo("\n".join(watch_lines(document)), err=json_file == "-")
    return _ALARM if alarm is not None else common.EXIT_STATUS[document["verdict"]]


def _watch(
    source: Source, dog: AlarmMonitor, vehicle: Vehicle, forget: float, engine: str
) -> tuple[Tracker | None, Alarm | None]:
    """Follow a source until an alarm, its end, or Ctrl-C."""
    from bayes_asv.tracking.tracker import tracker_for

    stop = threading.Event()
    tracker: Tracker | None = None
    alarm: Alarm | None = None
    try:
        about = source.begin(stop)
        if about is None:
            return None, None
        tracker = tracker_for(about.start, vehicle, rate=about.rate, forget=forget, engine=engine)
        for rows in source.rows(stop):
            alarm = dog.look(tracker.feed(rows.time, rows.acceleration))
            if alarm is not None:
                return tracker, alarm
        alarm = dog.look(tracker.finish())
    except KeyboardInterrupt:
        pass  # whoever ends it wants to know how it stands
    finally:
        stop.set()
        source.close()
    return tracker, alarm
