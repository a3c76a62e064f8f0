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
    help="A recording to prove it on, not fitted; may be given several times.",
)
@common.json_option
@common.rate_option
@common.seed_option
def command(
    recordings: tuple[str, ...],
    vehicle: str,
    holdout: tuple[str, ...],
    json_file: str | None,
    rate: float | None,
    seed: int,
) -> int:
    """Where simulation and measurement disagree, what is missing, and the gap before and after.

    Without --holdout the last recording is held out, or the second half of the only one.
    """
    common.check_outputs((*recordings, *holdout, vehicle), json_file)
    runs, car = common.read_inputs((*recordings, *holdout), vehicle, rate)
    fit, held = runs[: len(recordings)], runs[len(recordings) :]
    with common.progress_bar() as progress:
        from bayes_asv.diagnosis.workflow import diagnose

        found = diagnose(fit, held, car, seed, progress)
    from bayes_asv.report.diagnose_document import diagnose_document
    from bayes_asv.report.diagnose_words import diagnosis_lines

    document = diagnose_document(found, runs)
    common.write_json(document, json_file)
    click.echo("\n".join(diagnosis_lines(document)), err=json_file == "-")
    return 3 if document["verdict"] == "refused" else 0
