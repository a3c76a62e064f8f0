"""``bayes-asv greybox``."""

from __future__ import annotations

import click

from bayes_asv.cli import common

__all__ = ["command"]


@click.command("greybox")
@click.argument("recording", metavar="REC")
@common.vehicle_option
@click.option(
    "--coordinates", type=click.Choice(("both", "deflection", "integrated")), default="both",
    show_default=True,
    help="Accelerations as they are, or integrated twice as in the reference.",
)  # fmt: skip
@click.option(
    "--initial", type=click.Choice(("estimated", "zero")), default="estimated", show_default=True,
    help="Initial state.",
)  # fmt: skip
@click.option(
    "--remove", type=click.Choice(("trend", "constant", "rest", "none")), default="trend",
    show_default=True,
    help="What is subtracted before the integration: the linear trend, the constant that makes "
    "displacements end at zero, the mean of the first 0.1 s, or nothing.",
)  # fmt: skip
@click.option(
    "--hold", type=click.Choice(("held", "straight")), default="held", show_default=True,
    help="Integrated inputs between samples: constant or linear.",
)  # fmt: skip
@common.channels_option
@common.rate_option
@common.json_option
@common.seed_option
def command(
    recording: str,
    vehicle: str,
    coordinates: str,
    initial: str,
    remove: str,
    hold: str,
    channel_map: str | None,
    rate: float | None,
    json_file: str | None,
    seed: int,
) -> int:
    """Estimate the parameters by prediction errors, the reference's own method."""
    common.check_outputs((recording, vehicle, channel_map), json_file)
    import bayes_asv as asv
    from bayes_asv.library.reference import greybox
    from bayes_asv.reference.text import greybox_lines

    car = asv.read_vehicle(vehicle, channels=channel_map)
    document = greybox(
        asv.read_recording(recording, rate=rate, channels=car.channel_map),
        car,
        coordinates=coordinates,
        initial=initial,
        detrending=remove,
        hold=hold,
        seed=seed,
    )
    common.output(document, greybox_lines(document), json_file)
    return common.EXIT_STATUS[document["verdict"]]
