"""``bayes-asv simulate``."""

from __future__ import annotations

import math

import click

from bayes_asv.cli import common
from bayes_asv.simulation import ROADS

__all__ = ["command"]


def _factors(
    ctx: click.Context, param: click.Parameter, changes: tuple[str, ...]
) -> dict[str, float]:
    """Factors by parameter, from texts such as ``c_r=0.8``; of a name given twice the product."""
    factors: dict[str, float] = {}
    for change in changes:
        name, _, text = change.partition("=")
        try:
            factor = float(text)
        except ValueError:
            factor = 0.0
        if not name or not 0.01 <= factor <= 100.0:
            raise click.UsageError(
                f"--set {change}: write the name of a parameter, an equals sign and a factor "
                "between 0.01 and 100, such as c_r=0.8",
                ctx,
            )
        factors[name] = factors.get(name, 1.0) * factor
    return factors


@click.command("simulate")
@common.vehicle_option
@click.option("-o", "output", required=True, metavar="REC", help="The recording to write.")
@click.option(
    "--road", type=click.Choice(ROADS), default="stops", show_default=True,
    help="The road that is driven.",
)  # fmt: skip
@click.option(
    "--speed", callback=common.quantity("velocity", "8 mph", (0.1, 60.0)), metavar="TEXT",
    help="Such as '8 mph' or '3.5 m/s'; each road has its own by default.",
)  # fmt: skip
@click.option(
    "--rate", type=click.FloatRange(10.0, 10_000.0), default=400.0, show_default=True,
    help="Sampling rate, Hz.",
)  # fmt: skip
@click.option(
    "--seconds", type=click.FloatRange(0.1, 600.0), default=2.5, show_default=True,
    help="Length of the recording.",
)  # fmt: skip
@click.option(
    "--set", "change", callback=_factors, multiple=True, metavar="NAME=FACTOR",
    help="Factor on a nominal value, such as --set c_r=0.8; may be given several times.",
)  # fmt: skip
@click.option(
    "--car", type=click.Choice(common.CARS), default="half", show_default=True,
    help="Model of the car; 'roll' drives a left and a right track (docs/cars.md).",
)  # fmt: skip
@click.option(
    "--channels", metavar="NAMES",
    help="What is measured, separated by commas, such as front_wheel,rear_wheel,front_travel; by "
    "default the accelerations of wheel hubs and body.",
)  # fmt: skip
@click.option(
    "--skew", callback=common.quantity("length", "20 in", (0.0, 100.0)), metavar="TEXT",
    help="How much later the right wheels meet the road, such as '20 in', with a car that has "
    "some; by default half a metre, and a track of its own on a random road.",
)  # fmt: skip
@common.json_option
@common.seed_option
def command(
    vehicle: str,
    output: str,
    road: str,
    speed: str | None,
    rate: float,
    seconds: float,
    change: dict[str, float],
    car: str,
    channels: str | None,
    skew: str | None,
    json_file: str | None,
    seed: int,
) -> int:
    """Simulate a recording of the vehicle over a road."""
    common.check_outputs((vehicle,), output, json_file)
    if not (math.isfinite(rate) and math.isfinite(seconds)):
        raise click.UsageError("--rate and --seconds have to be numbers")
    import bayes_asv as asv
    from bayes_asv.library.simulations import simulate_drive

    drive = simulate_drive(
        asv.read_vehicle(vehicle),
        road,
        speed=speed,
        rate=rate,
        seconds=seconds,
        change=change,
        car=car,
        channels=None if channels is None else [n.strip() for n in channels.split(",")],
        skew=skew,
        seed=seed,
    )
    drive.recording.to_csv(output)
    document = {
        "schema": "bayes_asv/simulate/1",
        "verdict": "ok",
        "recording": output,
        "truth": drive.truth,
        "unit": "SI",
        "road": road,
        "speed": drive.speed,
        "rate": rate,
        "seed": seed,
    }
    common.output(document, [output], json_file)
    return 0
