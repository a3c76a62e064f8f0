"""``bayes-asv report``."""

from __future__ import annotations

import click

from bayes_asv.cli import common

__all__ = ["command"]

_MAX_SAVED = 3  # an estimate, a diagnosis and a track


@click.command("report")
@click.argument("recordings", nargs=-1, metavar="[REC...]")
@click.option("--vehicle", "-v", metavar="V.toml", help="The vehicle file.")
@click.option("-o", "output", required=True, metavar="OUT", help="An .html or a .pdf file.")
@click.option(
    "--from", "saved", multiple=True, metavar="FILE",
    help="JSON that estimate, diagnose or track wrote before; once for each; or that of compare.",
)  # fmt: skip
@common.car_option
@common.below_option
@click.option(
    "--interactive", is_flag=True,
    help="Write a page to look at the recordings closely: zoom, two cursors, state plane.",
)  # fmt: skip
@click.option("--no-diagnosis", is_flag=True, help="Do not diagnose the recordings.")
@common.json_option
@common.channels_option
@common.rate_option
@common.seed_option
def command(
    recordings: tuple[str, ...],
    vehicle: str | None,
    output: str,
    saved: tuple[str, ...],
    car: str | None,
    below: float | None,
    interactive: bool,
    no_diagnosis: bool,
    json_file: str | None,
    channel_map: str | None,
    rate: float | None,
    seed: int,
) -> int:
    """Write a report of recordings, HTML or PDF by the suffix of OUT.

    What estimate, diagnose and track wrote with --json is taken with --from and not computed
    again; the rest is computed from the recordings and --vehicle.  What compare wrote has a report
    of its own.  With --below there is neither diagnosis nor track, which need the whole band.
    """
    from bayes_asv.report.render import check_suffix

    check_suffix(output, interactive=interactive)
    if len(saved) > _MAX_SAVED:
        raise click.UsageError(
            "a report holds one estimate, one diagnosis and one track; give --from once for each"
        )
    if not recordings and not saved:
        raise click.UsageError("give recordings and --vehicle, or --from a saved document")
    if vehicle is not None and not recordings:
        raise click.UsageError("--vehicle needs recordings; a saved document names its car")
    if recordings and vehicle is None and len(saved) < _MAX_SAVED:
        raise click.UsageError("recordings need --vehicle")
    common.check_outputs((*recordings, vehicle, channel_map, *saved), output, json_file)
    import bayes_asv as asv
    from bayes_asv.library.reports import report, short_lines

    described = None if vehicle is None else asv.read_vehicle(vehicle, channels=channel_map)
    mapped = None if described is None else described.channel_map
    document = report(
        output,
        asv.read_recordings(recordings, rate=rate, channels=mapped),
        described,
        saved=saved,
        diagnosis=not no_diagnosis,
        interactive=interactive,
        car=car,
        below=below,
        seed=seed,
    )
    common.output(document.to_dict(), [*short_lines(document), output], json_file)
    return common.EXIT_STATUS.get(document.verdict, 0)
