"""``bayes-asv plan``."""

from __future__ import annotations

import click

from bayes_asv.cli import common
from bayes_asv.domain.errors import InputError

__all__ = ["command"]

_PARAMETERS = ("c_f", "c_r", "i", "k_g")
_ROADS = ("bump", "stops", "rollers", "rough")


@click.command("plan")
@common.vehicle_option
@click.option(
    "--want", "wanted", multiple=True, metavar="PERCENT",
    help="Wanted standard deviation in percent of the value, of every parameter or of one: "
    "--want 5 --want c_f=2.  [default: 5]",
)  # fmt: skip
@click.option(
    "--rate", "rates", type=click.FloatRange(10.0, 10_000.0), multiple=True, metavar="HZ",
    help="Sampling rate of the logger; may be given several times.  [default: 100, 200, 400 and "
    "800]",
)  # fmt: skip
@click.option(
    "--road", "roads", type=click.Choice(_ROADS), multiple=True,
    help="Kind of road; may be given several times.  [default: all]",
)  # fmt: skip
@click.option(
    "--speed-limit", callback=common.quantity("velocity", "12 mph"), metavar="TEXT",
    help="Such as '12 mph' or '20 km/h'.",
)  # fmt: skip
@click.option(
    "--tyre-rate", callback=common.quantity("stiffness", "300 lbf/in"), metavar="TEXT",
    help="Both tyres of an axle together, such as '300 lbf/in'; a typical value by default.",
)  # fmt: skip
@click.option(
    "--unsprung", callback=common.quantity("mass", "65 lbm"), metavar="TEXT",
    help="Unsprung mass of an axle, such as '65 lbm'; a typical value by default.",
)  # fmt: skip
@click.option(
    "--passes", type=click.IntRange(1, 1000), default=10, show_default=True,
    help="Largest number of passes that will be driven.",
)  # fmt: skip
@common.json_option
@common.seed_option
def command(
    vehicle: str,
    wanted: tuple[str, ...],
    rates: tuple[float, ...],
    roads: tuple[str, ...],
    speed_limit: str | None,
    tyre_rate: str | None,
    unsprung: str | None,
    passes: int,
    json_file: str | None,
    seed: int,
) -> int:
    """Find the road, speed, rate and passes that determine the parameters as well as wanted."""
    common.check_outputs((vehicle,), json_file)
    want = _percentages(wanted)
    import bayes_asv as asv

    result = asv.plan(
        asv.read_vehicle(vehicle),
        want=want,
        rates=rates,
        roads=roads,
        speed_limit=speed_limit,
        tyre_rate=tyre_rate,
        unsprung=unsprung,
        passes=passes,
        seed=seed,
    )
    common.output(result.document, result.lines(), json_file)
    return common.EXIT_STATUS[result.verdict]


def _percentages(texts: tuple[str, ...]) -> dict[str, float]:
    """Wanted percentages by parameter: ``5``, ``5 %`` and ``c_f=2`` are understood."""
    from bayes_asv.library.plans import wanted_deviations

    common_to_all: dict[str, float] = {}
    named: dict[str, float] = {}
    for text in texts:
        name, equals, number = text.rpartition("=")
        try:
            percent = float(number.strip().removesuffix("%"))
            given = {name.strip(): percent} if equals else dict.fromkeys(_PARAMETERS, percent)
            wanted_deviations(given)
        except (InputError, ValueError):
            raise click.UsageError(
                f"--want {text}: write a percentage between 0.0001 and 100, alone or after one of "
                f"{', '.join(_PARAMETERS)} and an equals sign"
            ) from None
        if equals:
            named |= given
        else:
            common_to_all = given
    return {**common_to_all, **named}
