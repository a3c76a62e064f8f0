"""``bayes-asv simulate``."""

from __future__ import annotations

import math
from typing import Literal

import click

from bayes_asv.cli import common
from bayes_asv.simulation import ROADS

__all__ = ["command"]


def _factors(
    ctx: click.Context, param: click.Parameter, changes: tuple[str, ...]
) -> dict[str, float]:
    """Factors by parameter, from texts such as ``c_r=0.8``; of a name given twice the product."""
    if not changes:
        return {}
    from bayes_asv.models.half_car import HalfCar
    from bayes_asv.models.roll_car import RollCar

    names = dict.fromkeys((*HalfCar._fields, *RollCar._fields))
    factors: dict[str, float] = {}
    for change in changes:
        name, _, text = change.partition("=")
        try:
            factor = float(text)
        except ValueError:
            factor = 0.0
        if name not in names or not 0.01 <= factor <= 100.0:
            raise click.UsageError(
                f"--set {change}: write one of {', '.join(names)}, an equals sign and a factor "
                "between 0.01 and 100",
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
    "--car", "which", type=click.Choice(["half", "roll"]), default="half", show_default=True,
    help="'roll' drives a left and a right track and records seven channels (docs/cars.md).",
)  # fmt: skip
@click.option(
    "--skew", callback=common.quantity("length", "20 in", (0.0, 100.0)), metavar="TEXT",
    help="With --car roll: how much later the right wheels meet the road, such as '20 in'; by "
    "default half a metre, and a track of its own on a random road.",
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
    which: Literal["half", "roll"],
    skew: str | None,
    json_file: str | None,
    seed: int,
) -> int:
    """Simulate a recording of the vehicle over a road."""
    common.check_outputs((vehicle,), output, json_file)
    if not (math.isfinite(rate) and math.isfinite(seconds)):
        raise click.UsageError("--rate and --seconds have to be numbers")
    if skew is not None and which != "roll":
        raise click.UsageError("--skew needs --car roll")
    import bayes_asv as asv
    from bayes_asv.library.simulations import simulate_drive

    drive = simulate_drive(
        asv.read_vehicle(vehicle),
        road,
        speed=speed,
        rate=rate,
        seconds=seconds,
        change=change,
        car=which,
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
