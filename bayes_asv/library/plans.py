"""``asv.plan``: which drive makes the parameters known well enough, before it is driven."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, overload

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike, write_atomically
from bayes_asv.library.estimates import check_seed
from bayes_asv.library.extras import import_extra
from bayes_asv.library.inputs import check_car, check_vehicle, positive_quantity
from bayes_asv.library.progress import Progress, progress_bar
from bayes_asv.library.result import html_table, json_text

if TYPE_CHECKING:
    import pandas as pd

    from bayes_asv.domain.vehicle import Vehicle
    from bayes_asv.planning.plan import PlanResult as EnginePlan

__all__ = [
    "DEFAULT_PERCENT", "Plan", "answers_of", "check_percentage", "plan", "wanted_deviations",
]  # fmt: skip

DEFAULT_PERCENT = 5.0
"""Wanted standard deviation where none is given."""


class Plan:
    """Drives compared before they are driven, from :func:`bayes_asv.plan`.

    ``verdict`` is ``"ok"``, or ``"refused"`` if no drive gives what is wanted; ``reasons`` say why.
    """

    def __init__(self, engine: EnginePlan):
        from bayes_asv.planning.document import plan_document

        self._engine = engine
        self.document: dict[str, Any] = plan_document(engine)
        self.vehicle = engine.vehicle

    @property
    def verdict(self) -> str:
        """``"ok"`` or ``"refused"``."""
        return self._engine.verdict

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why no drive suffices; empty otherwise."""
        return tuple(self.document["reasons"])

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was assumed."""
        return tuple(self.document["warnings"])

    @property
    def unidentified(self) -> tuple[str, ...]:
        """What the sensors at hand cannot tell, one sentence a parameter; empty if nothing."""
        return tuple(self.document["unidentified"])

    @property
    def recommended(self) -> dict[str, Any] | None:
        """The drive to take: ``words``, ``passes`` and the ``width_percent`` that it gives."""
        found: dict[str, Any] | None = self.document["recommended"]
        return found

    def summary(self) -> pd.DataFrame:
        """Return all drives as a table.

        Returns
        -------
        pandas.DataFrame
            One row a drive: ``road``, ``speed`` with its unit, ``rate`` (Hz), ``usable``,
            ``gentle``, the passes that reach the wanted deviation of each parameter, and
            ``passes`` that reach all; missing where no number does.
        """
        pandas = import_extra("pandas", "summary()")
        rows = []
        for drive in self.document["drives"]:
            needed = drive["passes_needed"]
            every = [n for n in needed.values() if n is not None]
            rows.append(
                {
                    "road": drive["road"]["words"],
                    "speed": drive["speed"]["value"],
                    "unit": drive["speed"]["unit"],
                    "rate": drive["rate"],
                    "usable": drive["usable"],
                    "gentle": drive["gentle"],
                    **needed,
                    "passes": max(every) if len(every) == len(needed) else None,
                }
            )
        return pandas.DataFrame(rows)

    @overload
    def to_json(self, path: None = None) -> str: ...
    @overload
    def to_json(self, path: PathLike) -> None: ...
    def to_json(self, path: PathLike | None = None) -> str | None:
        """Write the document that ``bayes-asv plan --json`` writes, or return its text."""
        text = json_text(self.document)
        if path is None:
            return text
        write_atomically(path, text.encode("utf-8", "replace"))
        return None

    def lines(self) -> list[str]:
        """State the plan in sentences, as the command line prints them."""
        from bayes_asv.planning.text import plan_lines

        return plan_lines(self._engine)

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        title, *notes = self.lines()
        return html_table(title, (), (), notes)

    def __repr__(self) -> str:
        drive = self.recommended or self.document["nearest"]
        words = drive["words"] if drive else "no drive can be used"
        return f"<Plan {self.verdict!r} for {self.vehicle.name[:60]}: {words[:300]}>"


def plan(
    vehicle: Vehicle,
    *,
    want: float | Mapping[str, float] = DEFAULT_PERCENT,
    car: str | None = None,
    channels: Sequence[str] | None = None,
    rates: Sequence[float] | None = None,
    roads: Sequence[str] | None = None,
    speed_limit: str | None = None,
    tyre_rate: str | None = None,
    unsprung: str | None = None,
    passes: int = 10,
    seed: int = 0,
    progress: Progress = None,
) -> Plan:
    """Compare drives by the standard deviations that they promise, and choose one.

    Parameters
    ----------
    vehicle : Vehicle
        Its nominal values are taken as true, its sensors as declared.
    want : float or mapping
        Wanted standard deviation in percent of the value, the same for all parameters of interest
        or for some of them: ``{"c_f": 2}``; 5 % for the others.  Those of the half car are c_f,
        c_r, i and k_g.
    car : {'half', 'quarter-front', 'quarter-rear', 'roll'}, optional
        Model of the car; by default that whose wheels are among the channels, or the half car.
    channels : sequence of str, optional
        Sensors at hand, such as ``["front_wheel", "rear_wheel", "front_travel"]``; by default
        accelerometers on all wheel hubs and on the body above them.
    rates : sequence of float, optional
        Sampling rates, Hz; 100, 200, 400 and 800 by default.
    roads : sequence of str, optional
        Kinds of road: ``bump``, ``stops``, ``rollers``, ``rough``; all by default.
    speed_limit, tyre_rate, unsprung : str, optional
        Quantities with a unit, such as ``"12 mph"``, ``"300 lbf/in"`` (both tyres of an axle) and
        ``"65 lbm"`` (mass of an axle that is not on springs); the last two are typical values by
        default.
    passes : int
        Largest number of passes that will be driven.
    seed : int
        The same seed gives the same answer.
    progress : bool or callable, optional
        As for :func:`bayes_asv.estimate`.

    Returns
    -------
    Plan

    Raises
    ------
    TypeError, InputError
        If an argument is of another type or does not fit; the message says what to write.
    """
    check_seed(seed)
    check_vehicle("plan", vehicle)
    check_car(car)
    from bayes_asv.planning import plan as engine
    from bayes_asv.planning.drives import KINDS, RATES, speeds

    wanted = wanted_deviations(want, answers_of(vehicle, car, channels))
    unknown = [road for road in roads or () if road not in KINDS]
    if unknown:
        raise InputError(f"road '{unknown[0]}'", "is unknown", f"give one of {', '.join(KINDS)}")
    limit = positive_quantity("speed_limit", speed_limit, "velocity", "12 mph")
    limit = math.inf if limit is None else limit
    slowest = min(speeds(kind, vehicle.units)[0] for kind in roads or KINDS)
    if limit < slowest:
        raise InputError(
            f"speed_limit={speed_limit!r}", "no drive of the plan is that slow",
            f"the slowest goes at {slowest:.2f} m/s",
        )  # fmt: skip
    with progress_bar(progress) as report:
        result = engine.plan(
            vehicle,
            wanted,
            car=_car_of(car, channels),
            channels=None if channels is None else tuple(dict.fromkeys(channels)),
            rates=sorted(set(rates)) if rates else RATES,
            kinds=[kind for kind in KINDS if kind in (roads or KINDS)],
            speed_limit=limit,
            max_passes=passes,
            tyre_rate=positive_quantity("tyre_rate", tyre_rate, "stiffness", "300 lbf/in"),
            unsprung=positive_quantity("unsprung", unsprung, "mass", "65 lbm"),
            seed=seed,
            progress=report,
        )
    return Plan(result)


def answers_of(
    vehicle: Vehicle, car: str | None, channels: Sequence[str] | None
) -> tuple[str, ...]:
    """Names of the parameters that a plan of a car predicts."""
    from bayes_asv.models.cars import car_model

    model = car_model(_car_of(car, channels), vehicle)
    return (*model.estimated, *model.ratios)


def _car_of(car: str | None, channels: Sequence[str] | None) -> str:
    """Model of the car: as given, or the one whose wheels are among the channels."""
    from bayes_asv.domain.channels import KNOWN_CHANNELS
    from bayes_asv.models.cars import cars_with

    strange = [name for name in channels or () if name not in KNOWN_CHANNELS]
    if strange:
        raise InputError(
            f"channel {strange[0]!r}", "is unknown", f"give some of {', '.join(KNOWN_CHANNELS)}"
        )
    return car or next(iter(cars_with(channels or ())), "half")


def wanted_deviations(
    want: float | Mapping[str, float], answers: Sequence[str]
) -> dict[str, float]:
    """Wanted standard deviations of parameters as shares of the values, from percentages."""
    given = dict(want) if isinstance(want, Mapping) else dict.fromkeys(answers, want)
    for name, percent in given.items():
        if name not in answers:
            raise InputError(
                f"want {name!r}", "is not a planned parameter", f"name {', '.join(answers)}"
            )
        check_percentage(f"want {name}", percent)
    return {name: given.get(name, DEFAULT_PERCENT) / 100.0 for name in answers}


def check_percentage(where: str, percent: float) -> None:
    """Raise an InputError if a wanted deviation is not a percentage."""
    if not 1e-4 <= percent <= 100.0:
        raise InputError(
            where, f"{percent:g} % is not possible", "give a percentage between 0.0001 and 100"
        )
