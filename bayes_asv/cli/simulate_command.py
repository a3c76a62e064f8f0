"""``bayes-asv simulate``."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeVar

import click

from bayes_asv.cli import common
from bayes_asv.domain.errors import InputError
from bayes_asv.simulation import ROADS

if TYPE_CHECKING:
    from bayes_asv.models.half_car import HalfCar
    from bayes_asv.models.roll_car import RollCar

    _Car = TypeVar("_Car", HalfCar, RollCar)

__all__ = ["command"]

_SKEW = 0.5  # m, a quarter of a small car's wheel base


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
@click.option(
    "--car", "which", type=click.Choice(["half", "roll"]), default="half", show_default=True,
    help="'roll' drives a left and a right track and records seven channels (docs/cars.md).",
)  # fmt: skip
@click.option(
    "--skew", metavar="TEXT",
    help="With --car roll: how much later the right wheels meet the road, such as '20 in'. Without "
    "it half a metre, and a track of its own on a random road.",
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
    which: str,
    skew: str | None,
    json_file: str | None,
    seed: int,
) -> int:
    """Write a recording of the vehicle driven over a road."""
    import numpy as np

    from bayes_asv.domain.vehicle import read_vehicle
    from bayes_asv.io import write_recording
    from bayes_asv.models.from_vehicle import roll_car
    from bayes_asv.models.half_car import HalfCar
    from bayes_asv.simulation.roads import road
    from bayes_asv.simulation.simulate import simulate, simulate_roll

    if not (math.isfinite(rate) and math.isfinite(seconds)):
        raise click.UsageError("--rate and --seconds have to be numbers")
    common.check_outputs((vehicle,), output, json_file)
    given = read_vehicle(vehicle)
    if skew is not None and which != "roll":
        raise click.UsageError("--skew needs --car roll")
    pace = _size("--speed", speed, "velocity", "8 mph", (0.1, 60.0), "m/s")
    apart = _size("--skew", skew, "length", "20 in", (0.0, 100.0), "m")
    where = road(name, np.random.default_rng([seed, 0]), pace)
    car: HalfCar | RollCar
    if which == "roll":
        rolling = _changed(roll_car(given), changes)
        right = where
        if apart is None:
            right = road(name, np.random.default_rng([seed, 2]), pace)
            apart = 0.0 if name in ("rough", "noise") else _SKEW
        recording = simulate_roll(
            given, (where, right), skew=apart, rate=rate, seconds=seconds, seed=seed, car=rolling
        ).recording
        car = rolling
    else:
        half = HalfCar(*(getattr(given, field).value for field in HalfCar._fields))
        half = _changed(half, changes)
        recording = simulate(
            given, where, rate=rate, seconds=seconds, seed=seed, car=half
        ).recording
        car = half
    write_recording(recording, output)
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


def _size(
    option: str, text: str | None, dimension: str, example: str, ends: tuple[float, float], si: str
) -> float | None:
    """Read a number with its unit, in SI, between two ends."""
    from bayes_asv.domain.units import parse_quantity, to_si

    if text is None:
        return None
    try:
        value = to_si(*parse_quantity(text), dimension)
    except InputError as fault:
        raise click.UsageError(f"{option}: {fault.where} {fault.what}; write '{example}'") from None
    if not ends[0] <= value <= ends[1]:
        raise click.UsageError(f"{option} has to lie between {ends[0]:g} and {ends[1]:g} {si}")
    return value


def _changed(car: _Car, changes: tuple[str, ...]) -> _Car:
    """Multiply fields of a car by factors such as ``c_r=0.8``."""
    for change in changes:
        field, _, text = change.partition("=")
        try:
            factor = float(text)
        except ValueError:
            factor = 0.0
        if field not in car._fields or not 0.01 <= factor <= 100.0:
            raise click.UsageError(
                f"--set {change}: write one of {', '.join(car._fields)}, an equals sign and "
                "a factor between 0.01 and 100"
            )
        car = car._replace(**{field: getattr(car, field) * factor})
    if not 0.0 < car.wdf < 1.0:
        raise click.UsageError("--set wdf leaves no weight on one of the axles")
    return car
