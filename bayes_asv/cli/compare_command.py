"""``bayes-asv compare``."""

from __future__ import annotations

import click

from bayes_asv.cli import common

__all__ = ["command"]

_STATUS = {"changed": 0, "consistent": 0, "refused": 3}


@click.command("compare")
@click.argument("before", nargs=-1, required=True, metavar="BEFORE...")
@click.option(
    "--with", "after", multiple=True, required=True, metavar="AFTER",
    help="A recording made after the change; may be given several times.",
)  # fmt: skip
@common.vehicle_option
@common.json_option
@common.channels_option
@common.rate_option
@common.seed_option
def command(
    before: tuple[str, ...],
    after: tuple[str, ...],
    vehicle: str,
    json_file: str | None,
    channel_map: str | None,
    rate: float | None,
    seed: int,
) -> int:
    """Test whether damping rates or pitch inertia changed between two sets of recordings.

    Errors of mass, springs and weight distribution are common to both and do not count.
    """
    common.check_outputs((*before, *after, vehicle, channel_map), json_file)
    import bayes_asv as asv
    from bayes_asv.library.inputs import check_inputs

    car = asv.read_vehicle(vehicle, channels=channel_map)
    first, second = (
        asv.read_recordings(paths, rate=rate, channels=car.channel_map) for paths in (before, after)
    )
    check_inputs("compare", (*first, *second), car)
    result = asv.compare(*(asv.estimate(runs, car, seed=seed) for runs in (first, second)))
    common.output(result.to_dict(), result.lines(), json_file)
    return _STATUS[result.verdict]
