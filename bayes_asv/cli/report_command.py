"""``bayes-asv report``."""

from __future__ import annotations

import click

from bayes_asv.cli import common

__all__ = ["command"]


@click.command("report")
@click.argument("recordings", nargs=-1, metavar="[REC...]")
@click.option("--vehicle", "-v", metavar="V.toml", help="What is known of the car.")
@click.option("-o", "output", required=True, metavar="OUT", help="An .html or a .pdf file.")
@click.option(
    "--from", "saved", multiple=True, metavar="FILE", help="JSON that a command wrote before."
)
@common.json_option
@common.rate_option
@common.seed_option
def command(
    recordings: tuple[str, ...],
    vehicle: str | None,
    output: str,
    saved: tuple[str, ...],
    json_file: str | None,
    rate: float | None,
    seed: int,
) -> int:
    """Write a report of recordings, HTML or PDF by the suffix of OUT.

    What was saved with --json by estimate is taken with --from and not computed again.
    """
    from bayes_asv.report.render import check_suffix, write_report
    from bayes_asv.report.saved import read_saved
    from bayes_asv.report.words import headline

    check_suffix(output)
    if len(saved) > 1:
        raise click.UsageError("a report tells one estimate; give --from once")
    if saved and (recordings or vehicle is not None):
        raise click.UsageError("give recordings and --vehicle, or --from, not both")
    common.check_outputs((*recordings, vehicle, *saved), output, json_file)
    if saved:
        document = read_saved(saved[0])
    else:
        if not recordings or vehicle is None:
            raise click.UsageError("give recordings and --vehicle, or --from a saved estimate")
        runs, car = common.read_inputs(recordings, vehicle, rate)
        with common.progress_bar() as progress:
            from bayes_asv.inference.estimate import estimate
            from bayes_asv.report.document import estimate_document

            document = estimate_document(estimate(runs, car, seed=seed, progress=progress))
    write_report(document, output)
    common.write_json(document, json_file)
    click.echo(f"{headline(document)}\n{output}", err=json_file == "-")
    return common.EXIT_STATUS[document["verdict"]]
