"""``bayes-asv modes``."""

from __future__ import annotations

from typing import Any

import click

from bayes_asv.cli import common

__all__ = ["command"]

_RECORDS = 50


@click.command("modes")
@click.argument("recording", required=False, metavar="[REC]")
@common.vehicle_option
@click.option(
    "--car", "which", type=click.Choice(["half", "quarter", "half4", "full7", "roll"]),
    default="half", show_default=True,
    help="Another car than the half car: with wheels and tyres, or rolling (docs/cars.md).",
)  # fmt: skip
@click.option(
    "--white-noise", is_flag=True,
    help="Also try to read the modes from drives over white noise with both axles damped to "
    "10, 30 and 70 %.",
)  # fmt: skip
@common.rate_option
@common.json_option
@common.seed_option
def command(
    recording: str | None,
    vehicle: str,
    which: str,
    white_noise: bool,
    rate: float | None,
    json_file: str | None,
    seed: int,
) -> int:
    """Eigenvalue modes of the nominal car, and the spectrum of a recording."""
    common.check_outputs((recording, vehicle), json_file)
    if which != "half":
        if recording is not None or white_noise:
            raise click.UsageError("a recording and --white-noise need the half car")
        return _other_car(vehicle, which, json_file)
    runs, car = common.read_inputs(() if recording is None else (recording,), vehicle, rate)
    from bayes_asv import __version__
    from bayes_asv.models.modes import modes
    from bayes_asv.reference.document import (
        MODES_SCHEMA,
        mode_document,
        nan_to_none,
        study_document,
    )
    from bayes_asv.reference.greybox import nominal_car
    from bayes_asv.reference.modal import printed_modes
    from bayes_asv.reference.modes_document import spectrum_document
    from bayes_asv.reference.text import modes_lines

    nominal = nominal_car(car)
    spectrum = spectrum_document(runs[0], car) if runs else None
    studies = []
    if white_noise:
        from bayes_asv.reference.spectral import DAMPINGS, spectral_study

        with common.progress_bar() as progress:
            for k, damping in enumerate(DAMPINGS):
                if progress is not None:
                    progress(k / len(DAMPINGS), f"damped to {100 * damping:.0f} %")
                studies.append(study_document(spectral_study(nominal, damping, _RECORDS, seed)))
    document: dict[str, Any] = nan_to_none(
        {
            "schema": MODES_SCHEMA,
            "verdict": "ok",
            "vehicle": car.name,
            "modes": [mode_document(mode) for mode in modes(nominal)],
            "as_app_c1": [
                {"natural_hz": f.natural, "damped_hz": f.damped, "ratio": f.ratio}
                for f in printed_modes(nominal)
            ],
            "spectral": studies,
            "recording": spectrum,
            "seed": seed,
            "version": __version__,
        }
    )
    common.write_json(document, json_file)
    click.echo("\n".join(modes_lines(document)), err=json_file == "-")
    return common.EXIT_STATUS["ok"]


def _other_car(vehicle: str, which: str, json_file: str | None) -> int:
    """Tell the modes of a car beyond the half car."""
    from bayes_asv.domain.vehicle import read_vehicle
    from bayes_asv.reference.modes_document import car_modes_document, car_modes_lines

    document = car_modes_document(read_vehicle(vehicle), which)
    common.write_json(document, json_file)
    click.echo("\n".join(car_modes_lines(document)), err=json_file == "-")
    return common.EXIT_STATUS["ok"]
