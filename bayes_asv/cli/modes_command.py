"""``bayes-asv modes``."""

from __future__ import annotations

import click

from bayes_asv.cli import common

__all__ = ["command"]


@click.command("modes")
@click.argument("recording", required=False, metavar="[REC]")
@common.vehicle_option
@click.option(
    "--car", "which", type=click.Choice(["half", "quarter", "half4", "full7", "roll"]),
    default="half", show_default=True,
    help="Model of the car: other cars have wheels and tyres, or roll (docs/cars.md).",
)  # fmt: skip
@click.option(
    "--white-noise", is_flag=True,
    help="Also read the modes from simulated drives over white noise, with both axles damped to "
    "10, 30 and 70 %.",
)  # fmt: skip
@common.channels_option
@common.rate_option
@common.json_option
@common.seed_option
def command(
    recording: str | None,
    vehicle: str,
    which: str,
    white_noise: bool,
    channel_map: str | None,
    rate: float | None,
    json_file: str | None,
    seed: int,
) -> int:
    """Compute the eigenvalue modes of the nominal car, and the spectrum of a recording."""
    common.check_outputs((recording, vehicle, channel_map), json_file)
    if which != "half" and (recording is not None or white_noise):
        raise click.UsageError("a recording and --white-noise need the half car")
    import bayes_asv as asv

    car = asv.read_vehicle(vehicle, channels=channel_map)
    if which != "half":
        from bayes_asv.reference.modes_document import car_modes_document, car_modes_lines

        document = car_modes_document(car, which)
        common.output(document, car_modes_lines(document), json_file)
        return common.EXIT_STATUS["ok"]
    from bayes_asv.library.reference import modes
    from bayes_asv.reference.text import modes_lines

    run = (
        None
        if recording is None
        else asv.read_recording(recording, rate=rate, channels=car.channel_map)
    )
    document = modes(car, run, white_noise=white_noise, seed=seed)
    common.output(document, modes_lines(document), json_file)
    return common.EXIT_STATUS["ok"]
