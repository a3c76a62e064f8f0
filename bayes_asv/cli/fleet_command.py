"""``bayes-asv fleet``."""

from __future__ import annotations

from pathlib import Path

import click

from bayes_asv.cli import common

__all__ = ["command"]


@click.command("fleet")
@click.argument("recordings", nargs=-1, required=True, metavar="REC...")
@common.vehicle_option
@click.option(
    "-o", "--output", required=True, metavar="TABLE",
    help="Table with one row a recording, .parquet or .csv; the page is written beside it as "
    ".html, and the answers are kept in a folder .fleet.",
)  # fmt: skip
@click.option(
    "--jobs", type=click.IntRange(min=1), metavar="N",
    help="Number of processes; by default one a processor.",
)  # fmt: skip
@click.option(
    "--dask", metavar="ADDRESS", help="Use the Dask cluster of this scheduler instead of processes."
)
@common.car_option
@common.below_option
@common.json_option
@common.channels_option
@common.rate_option
@common.seed_option
def command(
    recordings: tuple[str, ...],
    vehicle: str,
    output: str,
    jobs: int | None,
    dask: str | None,
    car: str | None,
    below: float | None,
    json_file: str | None,
    channel_map: str | None,
    rate: float | None,
    seed: int,
) -> int:
    """Estimate a season of recordings, and find when a damper changed.

    REC are files or quoted patterns such as 'season/**/*.csv'.  A run that was interrupted, or
    one with more recordings, continues: what was done is kept.
    """
    page = Path(output).with_suffix(".html")
    common.check_outputs((*recordings, vehicle, channel_map), output, str(page), json_file)
    import bayes_asv as asv

    result = asv.fleet(
        recordings,
        asv.read_vehicle(vehicle, channels=channel_map),
        output=output,
        car=car,
        below=below,
        rate=rate,
        seed=seed,
        jobs=jobs,
        dask=dask,
    )
    common.output(result.to_dict(), result.lines(), json_file)
    common.say(f"Table: {output}. Page: {page}. Answers: {result.folder}.")
    return common.EXIT_STATUS[result.verdict]
