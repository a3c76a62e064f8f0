"""``bayes-asv plan``."""

from __future__ import annotations

import click

from bayes_asv.cli import common
from bayes_asv.domain.errors import InputError

__all__ = ["command"]

_ROADS = ("bump", "stops", "rollers", "rough")


@click.command("plan")
@common.vehicle_option
@click.option(
    "--want", "wanted", multiple=True, metavar="PERCENT",
    help="Wanted standard deviation in percent of the value, of every parameter or of one: "
    "--want 5 --want c_f=2.  [default: 5]",
)  # fmt: skip
@common.car_option_of("the one whose wheels --channels names, or half")
@click.option(
    "--channels", metavar="NAMES",
    help="Sensors at hand, separated by commas, such as front_wheel,rear_wheel,front_travel; by "
    "default accelerometers on wheel hubs and body.",
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
    car: str | None,
    channels: str | None,
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
    alike, named = _percentages(wanted)
    import bayes_asv as asv
    from bayes_asv.library.plans import answers_of

    given = asv.read_vehicle(vehicle)
    sensors = None if channels is None else [n.strip() for n in channels.split(",")]
    result = asv.plan(
        given,
        want={**dict.fromkeys(answers_of(given, car, sensors), alike), **named},
        car=car,
        channels=sensors,
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


def _percentages(texts: tuple[str, ...]) -> tuple[float, dict[str, float]]:
    """Wanted percentage of all parameters, and of some: ``5``, ``5 %`` and ``c_f=2``."""
    from bayes_asv.library.plans import DEFAULT_PERCENT, check_percentage

    alike = DEFAULT_PERCENT
    named: dict[str, float] = {}
    for text in texts:
        name, equals, number = text.rpartition("=")
        try:
            percent = float(number.strip().removesuffix("%"))
            check_percentage(text, percent)
        except (InputError, ValueError):
            raise click.UsageError(
                f"--want {text}: write a percentage between 0.0001 and 100, alone or after the "
                "name of a parameter and an equals sign"
            ) from None
        if equals:
            named[name.strip()] = percent
        else:
            alike = percent
    return alike, named
