"""``bayes-asv simulate``."""

from __future__ import annotations

import math

import click

from bayes_asv.cli import common
from bayes_asv.errors import InputError
from bayes_asv.simulation import ROADS

__all__ = ["command"]


@click.command("simulate")
@common.vehicle_option
@click.option("-o", "output", required=True, metavar="REC", help="The recording to write.")
@click.option(
    "--road", "name", type=click.Choice(ROADS), default="stops", show_default=True,
    help="What to drive over.",
)  # fmt: skip
@click.option("--speed", metavar="TEXT", help="Such as '8 mph' or '3.5 m/s'; a road has its own.")
@click.option(
    "--rate", type=click.FloatRange(10.0, 10_000.0), default=400.0, show_default=True,
    help="Rows a second.",
)  # fmt: skip
@click.option(
    "--seconds", type=click.FloatRange(0.1, 600.0), default=2.5, show_default=True, help="Length."
)
@click.option(
    "--set", "changes", multiple=True, metavar="NAME=FACTOR",
    help="Another car than the nominal one, such as --set c_r=0.8; may be given several times.",
)  # fmt: skip
@common.json_option
@common.seed_option
def command(
    vehicle: str,
    output: str,
    name: str,
    speed: str | None,
    rate: float,
    seconds: float,
    changes: tuple[str, ...],
    json_file: str | None,
    seed: int,
) -> int:
    """Write a recording of the vehicle driven over a road."""
    import numpy as np

    from bayes_asv.formats import write_recording
    from bayes_asv.model.halfcar import HalfCar
    from bayes_asv.simulation.roads import road
    from bayes_asv.simulation.simulate import simulate
    from bayes_asv.units import parse_quantity, to_si
    from bayes_asv.vehicle import read_vehicle

    if not (math.isfinite(rate) and math.isfinite(seconds)):
        raise click.UsageError("--rate and --seconds have to be numbers")
    common.check_outputs((vehicle,), output, json_file)
    given = read_vehicle(vehicle)
    car = HalfCar(*(getattr(given, field).value for field in HalfCar._fields))
    for change in changes:
        field, _, text = change.partition("=")
        try:
            factor = float(text)
        except ValueError:
            factor = 0.0
        if field not in HalfCar._fields or not 0.01 <= factor <= 100.0:
            raise click.UsageError(
                f"--set {change}: write one of {', '.join(HalfCar._fields)}, an equals sign and "
                "a factor between 0.01 and 100"
            )
        car = car._replace(**{field: getattr(car, field) * factor})
    try:
        pace = None if speed is None else to_si(*parse_quantity(speed), "velocity")
    except InputError as fault:
        raise click.UsageError(f"--speed: {fault.where} {fault.what}; write '8 mph'") from None
    if pace is not None and not 0.1 <= pace <= 60.0:
        raise click.UsageError("--speed has to lie between 0.1 and 60 m/s")
    if not 0.0 < car.wdf < 1.0:
        raise click.UsageError("--set wdf leaves no weight on one of the axles")
    where = road(name, np.random.default_rng([seed, 0]), pace)
    drive = simulate(given, where, rate=rate, seconds=seconds, seed=seed, car=car)
    write_recording(drive.recording, output)
    document = {
        "schema": "bayes_asv/simulate/1",
        "verdict": "ok",
        "recording": output,
        "truth": car._asdict(),
        "unit": "SI",
        "road": name,
        "speed": where.speed,
        "rate": rate,
        "seed": seed,
    }
    common.write_json(document, json_file)
    click.echo(output, err=json_file == "-")
    return 0
