"""``bayes-asv watch``."""

from __future__ import annotations

import time

import click

from bayes_asv.cli import common
from bayes_asv.cli.live_options import baud_option
from bayes_asv.cli.track_command import engine_option
from bayes_asv.live.port import BAUD

__all__ = ["command"]

_STATUS = {**common.EXIT_STATUS, "alarm": 5}


@click.command("watch")
@click.argument("recording", required=False, metavar="[REC]")
@common.vehicle_option
@common.car_option
@common.effects_option
@click.option(
    "--below", type=click.FloatRange(1.0, 99.0), default=80.0, show_default=True,
    metavar="PERCENT", help="Share of its nominal rate below which a damper counts as worn.",
)  # fmt: skip
@click.option(
    "--sure", type=click.FloatRange(50.0, 99.999), default=99.0, show_default=True,
    metavar="PERCENT", help="Probability of wear above which the alarm is raised.",
)  # fmt: skip
@click.option(
    "--hold", type=click.FloatRange(0.0, 3600.0), default=1.0, show_default=True,
    metavar="SECONDS", help="Time for which the probability has to be above it.",
)  # fmt: skip
@click.option(
    "--forget", type=click.FloatRange(0.0, min_open=True), default=60.0, show_default=True,
    metavar="SECONDS",
    help="Let the parameters change by 10 % (one standard deviation) in this time.",
)  # fmt: skip
@engine_option
@click.option("--port", metavar="P", help="A serial port instead of a recording.")
@baud_option(BAUD)
@click.option(
    "--keep", metavar="FILE",
    help="File for every byte of the port.  [default: watch-DATE-TIME.txt]",
)  # fmt: skip
@common.json_option
@common.channels_option
@common.rate_option
@common.seed_option
def command(
    recording: str | None,
    vehicle: str,
    car: str | None,
    effects: tuple[str, ...],
    below: float,
    sure: float,
    hold: float,
    forget: float,
    engine: str,
    port: str | None,
    baud: int,
    keep: str | None,
    json_file: str | None,
    channel_map: str | None,
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
    common.check_outputs((recording, vehicle, channel_map), json_file, keep)
    import bayes_asv as asv
    from bayes_asv.library.live import SerialPort, watch

    given = asv.read_vehicle(vehicle, channels=channel_map)
    result = watch(
        None
        if recording is None
        else asv.read_recording(recording, rate=rate, channels=given.channel_map),
        given,
        car=car,
        effects=effects,
        port=None if port is None or keep is None else SerialPort(port, keep, baud),
        below=below,
        probability=sure,
        hold=hold,
        forget=forget,
        engine=engine,
        rate=rate,
        seed=seed,
        say=common.say,
    )
    if result is None:
        common.say("no rows were received, so there is no result")
        return common.EXIT_STATUS["refused"]
    common.output(result.document.to_dict(), result.lines(), json_file)
    return _STATUS[result.verdict]
