"""``bayes-asv estimate``."""

from __future__ import annotations

from typing import Literal

import click

from bayes_asv.cli import common

__all__ = ["command"]


@click.command("estimate")
@common.recordings_argument
@common.vehicle_option
@common.car_option
@click.option(
    "--likelihood",
    type=click.Choice(["innovations", "output-error"]),
    default="innovations",
    show_default=True,
    help="With the noise of the wheel sensors in the covariance, or with white residuals.",
)
@common.below_option
@common.effects_option
@click.option(
    "--model",
    type=click.Choice(["linear", "auto"]),
    default="linear",
    show_default=True,
    help="'auto' adds the effects that diagnose finds more likely than not.",
)
@click.option("--netcdf", metavar="FILE", help="Write the draws as ArviZ InferenceData.")
@common.json_option
@common.channels_option
@common.rate_option
@common.seed_option
def command(
    recordings: tuple[str, ...],
    vehicle: str,
    car: str | None,
    likelihood: Literal["innovations", "output-error"],
    below: float | None,
    effects: tuple[str, ...],
    model: str,
    netcdf: str | None,
    json_file: str | None,
    channel_map: str | None,
    rate: float | None,
    seed: int,
) -> int:
    """Estimate damping rates and inertias from one or several recordings together."""
    bending = [name for name in effects if not name.startswith("clock_offset")]
    if (bending or model != "linear") and (below is not None or likelihood != "innovations"):
        raise click.UsageError(
            "effects need the whole band and the innovations likelihood; leave out --below and "
            "--likelihood, or --with and --model"
        )
    common.check_outputs((*recordings, vehicle, channel_map), json_file, netcdf)
    import bayes_asv as asv

    if netcdf is not None:
        from bayes_asv.library.extras import import_extra

        import_extra("h5netcdf", "--netcdf")
    described = asv.read_vehicle(vehicle, channels=channel_map)
    result = asv.estimate(
        asv.read_recordings(recordings, rate=rate, channels=described.channel_map),
        described,
        effects=(*effects, "auto") if model == "auto" else effects,
        likelihood=likelihood,
        below=below,
        car=car,
        seed=seed,
    )
    if netcdf is not None and result.parameters:
        result.to_netcdf(netcdf)
    elif netcdf is not None:
        common.say(f"bayes-asv: {netcdf} was not written because there are no draws")
    common.answer(result, json_file)
    return common.EXIT_STATUS[result.verdict]
