"""``bayes-asv compare``."""

from __future__ import annotations

import click

from bayes_asv.cli import common

__all__ = ["command"]

_STATUS = {"changed": 0, "consistent": 0, "unclear": 0, "refused": 3, "doubtful": 6}


@click.command("compare")
@click.argument("before", nargs=-1, required=True, metavar="BEFORE...")
@click.option(
    "--with", "after", multiple=True, required=True, metavar="AFTER",
    help="A recording made after the change; may be given several times.",
)  # fmt: skip
@common.vehicle_option
@click.option(
    "--vehicle-after", metavar="V.toml",
    help="The vehicle file of AFTER, where a mass, a spring or a sensor was changed on purpose.",
)  # fmt: skip
@common.car_option
@click.option(
    "--with-effect", "effects", multiple=True, metavar="EFFECT",
    help="An effect that the car has, such as bound_rebound@rear; may be given several times.",
)  # fmt: skip
@common.below_option
@click.option(
    "-o", "output", metavar="OUT", help="Write a report as well: an .html or a .pdf file."
)
@common.json_option
@common.channels_option
@common.rate_option
@common.seed_option
def command(
    before: tuple[str, ...],
    after: tuple[str, ...],
    vehicle: str,
    vehicle_after: str | None,
    car: str | None,
    effects: tuple[str, ...],
    below: float | None,
    output: str | None,
    json_file: str | None,
    channel_map: str | None,
    rate: float | None,
    seed: int,
) -> int:
    """Find out which damping rates or inertias changed between two sets of recordings.

    Errors that both have in common, of mass, springs, weight distribution and sensors, do not
    count (docs/compare.md).
    """
    if effects and below is not None:
        raise click.UsageError("effects need the whole band; leave out --below, or --with-effect")
    if output is not None:
        from bayes_asv.report.render import check_suffix

        check_suffix(output)
    read = (*before, *after, vehicle, vehicle_after, channel_map)
    common.check_outputs(read, output, json_file)
    import bayes_asv as asv

    cars = [
        None if path is None else asv.read_vehicle(path, channels=channel_map)
        for path in (vehicle, vehicle_after)
    ]
    mapped = [None if one is None else one.channel_map for one in (cars[0], cars[1] or cars[0])]
    first, second = (
        asv.read_recordings(paths, rate=rate, channels=channels)
        for paths, channels in zip((before, after), mapped, strict=True)
    )
    result = asv.compare(
        first, second, cars[0], vehicle_after=cars[1], effects=effects, below=below, car=car,
        seed=seed,
    )  # fmt: skip
    if output is not None:
        result.report(output)
    common.answer(result, json_file)
    if output is not None:
        click.echo(output, err=json_file == "-")
    return _STATUS[result.verdict]
