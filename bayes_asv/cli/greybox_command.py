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
    show_default=True, help="Accelerations as they are, or integrated twice as the reference does.",
)  # fmt: skip
@click.option(
    "--initial", type=click.Choice(("estimated", "zero")), default="estimated", show_default=True,
    help="Initial state.",
)  # fmt: skip
@click.option(
    "--remove", type=click.Choice(("trend", "constant", "rest", "none")), default="trend",
    show_default=True,
    help="What to take off before integrating: the linear trend, the constant that makes "
    "displacements end on zero, the mean of the first 0.1 s, or nothing.",
)  # fmt: skip
@click.option(
    "--hold", type=click.Choice(("held", "straight")), default="held", show_default=True,
    help="Integrated inputs between samples.",
)  # fmt: skip
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
    rate: float | None,
    json_file: str | None,
    seed: int,
) -> int:
    """Prediction-error point estimate, the reference's own method."""
    common.check_outputs((recording, vehicle), json_file)
    runs, car = common.read_inputs((recording,), vehicle, rate)
    from bayes_asv import __version__
    from bayes_asv.reference.document import GREYBOX_SCHEMA, greybox_document, nan_to_none
    from bayes_asv.reference.greybox import COORDINATES, grey_box
    from bayes_asv.reference.text import greybox_lines

    ways = COORDINATES if coordinates == "both" else (coordinates,)
    found = [
        grey_box(runs[0], car, coordinates=way, initial=initial, detrending=remove, hold=hold)
        for way in ways
    ]
    verdicts = [estimate.verdict for estimate in found]
    document = nan_to_none(
        {
            "schema": GREYBOX_SCHEMA,
            "verdict": next((v for v in ("refused", "not_converged") if v in verdicts), "ok"),
            "reasons": list(found[0].reasons),
            "warnings": list(found[0].warnings),
            "estimates": [greybox_document(estimate, car.units) for estimate in found],
            "seed": seed,  # nothing here is drawn; the same for every seed
            "version": __version__,
        }
    )
    common.write_json(document, json_file)
    click.echo("\n".join(greybox_lines(document)), err=json_file == "-")
    return common.EXIT_STATUS[document["verdict"]]
