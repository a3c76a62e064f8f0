"""``bayes-asv track``."""

from __future__ import annotations

from typing import Any, Literal

import click

from bayes_asv.cli import common
from bayes_asv.cli.live_options import live_options, live_settings

__all__ = ["command", "engine_option", "forget_option"]

forget_option = click.option(
    "--forget", type=click.FloatRange(0.0, min_open=True), metavar="SECONDS",
    help="Let the parameters change by 10 % (one standard deviation) in this time; constant by "
    "default.",
)  # fmt: skip
engine_option = click.option(
    "--engine", type=click.Choice(["compiled", "filterpy"]), default="compiled", show_default=True,
    help="The fast implementation of the filter, or the readable one; both give the same.",
)  # fmt: skip


@click.command("track")
@click.argument("recording", required=False, metavar="[REC]")
@common.vehicle_option
@common.car_option
@common.effects_option
@forget_option
@engine_option
@click.option("--trace", metavar="FILE.csv", help="Write the state after each row.")
@live_options
@common.json_option
@common.channels_option
@common.rate_option
@common.seed_option
def command(
    recording: str | None,
    vehicle: str,
    car: str | None,
    effects: tuple[str, ...],
    forget: float | None,
    engine: Literal["compiled", "filterpy"],
    trace: str | None,
    json_file: str | None,
    channel_map: str | None,
    rate: float | None,
    seed: int,
    **shown: Any,
) -> int:
    """Track damping rates and inertias row by row, through a recording or live from a port."""
    settings = live_settings(recording, **shown)
    keep = None if settings.port is None else settings.port.keep
    common.check_outputs((recording, vehicle, channel_map), json_file, trace, settings.gif, keep)
    import bayes_asv as asv
    from bayes_asv.library.live import track_live

    given = asv.read_vehicle(vehicle, channels=channel_map)
    run = (
        None
        if recording is None
        else asv.read_recording(recording, rate=rate, channels=given.channel_map)
    )
    if run is not None and not (settings.shown or settings.gif):
        result = asv.track(
            run, given, car=car, effects=effects, forget=forget, engine=engine, seed=seed
        )
    else:
        followed = track_live(
            settings, run, given, car=car, effects=effects, rate=rate, forget=forget, engine=engine,
            trace=trace is not None, seed=seed, say=common.say,
        )  # fmt: skip
        if followed is None:
            common.say("no rows were received, so there is no result")
            return common.EXIT_STATUS["refused"]
        result = followed
    if trace is not None:
        result.write_trace(trace)
    common.answer(result, json_file)
    return common.EXIT_STATUS[result.verdict]
