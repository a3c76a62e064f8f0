"""``bayes-asv calibrate``."""

from __future__ import annotations

import click

from bayes_asv.cli import common

__all__ = ["command"]


@click.command("calibrate")
@click.argument("log", metavar="FILE")
@click.option(
    "--columns", required=True, metavar="NAMES",
    help="A column, or the three axes of an accelerometer, separated by commas.",
)  # fmt: skip
@click.option(
    "--values", metavar="LIST",
    help="For one column: the value of each position in the order of time, '1 g, -1 g' or "
    "'0 mm, 25 mm, 50 mm'.",
)  # fmt: skip
@click.option(
    "--angles", metavar="LIST",
    help="For one accelerometer instead: its angle from upright in each position, degrees.",
)  # fmt: skip
@common.json_option
@common.rate_option
def command(
    log: str,
    columns: str,
    values: str | None,
    angles: str | None,
    json_file: str | None,
    rate: float | None,
) -> int:
    """Calibrate a sensor from a log in which it was held still.

    Three axes need no known positions: hold the sensor still for two seconds with each of its six
    faces down.  The lines that are printed belong in the channel map.
    """
    common.check_outputs((log,), json_file)
    from bayes_asv.library.logs import calibrate

    try:
        degrees = [float(angle) for angle in (angles or "").split(",") if angle.strip()]
    except ValueError:
        raise click.UsageError("--angles takes numbers, such as '0, 30, 60, 90'") from None
    result = calibrate(
        log,
        [name.strip() for name in columns.split(",")],
        values=[value.strip() for value in (values or "").split(",") if value.strip()],
        angles=degrees,
        rate=rate,
    )
    common.output(result.to_dict(), result.lines(), json_file)
    return common.EXIT_STATUS["ok"]
