"""``bayes-asv plan``."""

from __future__ import annotations

import math

import click

from bayes_asv.cli import common
from bayes_asv.domain.errors import InputError

__all__ = ["command"]

_ANSWERS = ("c_f", "c_r", "i", "k_g")
_KINDS = ("bump", "stops", "rollers", "rough")
_USUAL = 5.0  # percent


@click.command("plan")
@common.vehicle_option
@click.option(
    "--want", "wanted", multiple=True, metavar="PERCENT",
    help="Wanted width of every parameter, one deviation in percent of the value, or of one: "
    "--want 5 --want c_f=2.  [default: 5]",
)  # fmt: skip
@click.option(
    "--rate", "rates", type=click.FloatRange(10.0, 10_000.0), multiple=True, metavar="HZ",
    help="Rate of the logger; may be given several times.  [default: 100, 200, 400 and 800]",
)  # fmt: skip
@click.option(
    "--road", "kinds", type=click.Choice(_KINDS), multiple=True,
    help="Kind of road; may be given several times.  [default: all]",
)  # fmt: skip
@click.option("--speed-limit", "top", metavar="TEXT", help="Such as '12 mph' or '20 km/h'.")
@click.option(
    "--tyre-rate", metavar="TEXT",
    help="Of an axle, both tyres together, such as '300 lbf/in'; guessed otherwise.",
)  # fmt: skip
@click.option(
    "--unsprung", metavar="TEXT",
    help="Mass of an axle that is not on springs, such as '65 lbm'; guessed otherwise.",
)  # fmt: skip
@click.option(
    "--passes", type=click.IntRange(1, 1000), default=10, show_default=True,
    help="The most passes that you will drive.",
)  # fmt: skip
@common.json_option
@common.seed_option
def command(
    vehicle: str,
    wanted: tuple[str, ...],
    rates: tuple[float, ...],
    kinds: tuple[str, ...],
    top: str | None,
    tyre_rate: str | None,
    unsprung: str | None,
    passes: int,
    json_file: str | None,
    seed: int,
) -> int:
    """Which road, speed, rate and passes give each parameter as well as wanted."""
    want = _want(wanted)
    limit = _quantity("--speed-limit", top, "velocity", "12 mph")
    limit = math.inf if limit is None else limit
    rate = _quantity("--tyre-rate", tyre_rate, "stiffness", "300 lbf/in")
    mass = _quantity("--unsprung", unsprung, "mass", "65 lbm")
    common.check_outputs((vehicle,), json_file)
    from bayes_asv.domain.vehicle import read_vehicle

    car = read_vehicle(vehicle)
    from bayes_asv.planning.document import plan_document
    from bayes_asv.planning.drives import RATES, speeds
    from bayes_asv.planning.plan import plan
    from bayes_asv.planning.text import plan_lines

    slowest = min(speeds(kind, car.units)[0] for kind in kinds or _KINDS)
    if limit < slowest:
        raise click.UsageError(
            f"--speed-limit {top}: no drive of the plan is that slow; the slowest goes at "
            f"{slowest:.2f} m/s"
        )
    with common.progress_bar() as progress:
        result = plan(
            car,
            want,
            rates=sorted(set(rates)) or RATES,
            kinds=[kind for kind in _KINDS if kind in (kinds or _KINDS)],
            speed_limit=limit,
            max_passes=passes,
            tyre_rate=rate,
            unsprung=mass,
            seed=seed,
            progress=progress,
        )
    common.write_json(plan_document(result), json_file)
    click.echo("\n".join(plan_lines(result)), err=json_file == "-")
    return common.EXIT_STATUS[result.verdict]


def _want(texts: tuple[str, ...]) -> dict[str, float]:
    """Wanted shares by parameter: ``5``, ``5 %`` and ``c_f=2`` are understood."""
    want = dict.fromkeys(_ANSWERS, _USUAL / 100.0)
    named: dict[str, float] = {}
    for text in texts:
        name, equals, number = text.rpartition("=")
        try:
            share = float(number.strip().removesuffix("%")) / 100.0
        except ValueError:
            share = 0.0
        if (equals and name.strip() not in _ANSWERS) or not 1e-6 <= share <= 1.0:
            raise click.UsageError(
                f"--want {text}: write a percentage between 0.0001 and 100, alone or after one of "
                f"{', '.join(_ANSWERS)} and an equals sign"
            )
        if equals:
            named[name.strip()] = share
        else:
            want = dict.fromkeys(_ANSWERS, share)
    return {**want, **named}


def _quantity(option: str, text: str | None, dimension: str, example: str) -> float | None:
    """Value of an option in SI units, above zero; None where it was not given."""
    if text is None:
        return None
    from bayes_asv.domain.units import parse_quantity, to_si

    try:
        value = to_si(*parse_quantity(text), dimension)
    except InputError as fault:
        words = f"{option}: {fault.where} {fault.what}; write '{example}'"
        raise click.UsageError(words) from None
    if not 0.0 < value < math.inf:
        raise click.UsageError(f"{option} has to be above zero")
    return value
