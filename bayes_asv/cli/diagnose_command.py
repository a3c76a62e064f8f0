"""``bayes-asv diagnose``."""

from __future__ import annotations

import click

from bayes_asv.cli import common

__all__ = ["command"]


@click.command("diagnose")
@common.recordings_argument
@common.vehicle_option
@click.option(
    "--holdout",
    multiple=True,
    metavar="REC",
    help="A recording that is not fitted, for validation; may be given several times.",
)
@common.car_option
@common.json_option
@common.channels_option
@common.rate_option
@common.seed_option
def command(
    recordings: tuple[str, ...],
    vehicle: str,
    holdout: tuple[str, ...],
    car: str | None,
    json_file: str | None,
    channel_map: str | None,
    rate: float | None,
    seed: int,
) -> int:
    """Find where simulation and measurement disagree, and which effects the car lacks.

    Without --holdout the last recording is held out, or the second half of the only one.
    """
    common.check_outputs((*recordings, *holdout, vehicle, channel_map), json_file)
    import bayes_asv as asv

    described = asv.read_vehicle(vehicle, channels=channel_map)
    runs, held = (
        asv.read_recordings(paths, rate=rate, channels=described.channel_map)
        for paths in (recordings, holdout)
    )
    result = asv.diagnose(runs, described, holdout=held, car=car, seed=seed)
    common.answer(result, json_file)
    return common.EXIT_STATUS["refused" if result.verdict == "refused" else "ok"]
