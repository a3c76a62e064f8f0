"""Drives that a team with an afternoon can do: what lies on the ground, how fast, how long."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from bayes_asv.models.half_car import HalfCar
from bayes_asv.models.modes import modes
from bayes_asv.planning.grounds import KINDS, Ground
from bayes_asv.planning.motion import LEAD

__all__ = ["RATES", "Planned", "drives", "grounds", "speeds"]

RATES = (100.0, 200.0, 400.0, 800.0)
"""Rows a second that loggers offer."""

_INCH, _FOOT, _MPH, _KMH = 0.0254, 0.3048, 0.44704, 1.0 / 3.6
_ROUGH_SECONDS = 4.0
_REST = 1.0  # s after the last wheel has left the obstacle, at least
_PERIODS = 1.5  # of the slowest mode, if that is longer
_LONGEST = 12.0  # s


class Planned(NamedTuple):
    """One drive of the grid.

    Parameters
    ----------
    ground : Ground
        What it goes over.
    speed : float
        m/s.
    rate : float
        Rows a second.
    seconds : float
        Length of the recording, :data:`~bayes_asv.planning.motion.LEAD` before the obstacle
        included.
    """

    ground: Ground
    speed: float
    rate: float
    seconds: float


def grounds(units: str) -> tuple[Ground, ...]:
    """Grounds to lay out or find, in round numbers of the vehicle's units."""
    if units == "US":
        heights, lengths = [2 * _INCH, 3 * _INCH, 4 * _INCH], [3 * _FOOT, 5 * _FOOT]
        stops, gap = [3 * _INCH, 4 * _INCH], 12 * _INCH
        waves = [(1.5 * _INCH, 3 * _FOOT), (2 * _INCH, 5 * _FOOT)]
    else:
        heights, lengths = [0.05, 0.075, 0.10], [0.9, 1.5]
        stops, gap = [0.075, 0.10], 0.30
        waves = [(0.04, 0.9), (0.05, 1.5)]
    return (
        *(Ground("bump", h, l, 1) for h in heights for l in lengths),
        *(Ground("stops", h, gap, 2) for h in stops),
        *(Ground("rough", iso=iso) for iso in "DE"),
        *(Ground("rollers", h, pitch, 8) for h, pitch in waves),
    )


def speeds(kind: str, units: str) -> tuple[float, ...]:
    """Speeds (m/s) over a kind of ground, in round numbers of the vehicle's units."""
    if units == "US":
        round_numbers = {
            "bump": (4, 6, 8, 10, 12, 15, 20),
            "stops": (3, 4, 5, 6, 7, 8, 10),
            "rough": (5, 8, 12, 16, 20),
            "rollers": (4, 6, 8, 10, 12, 15),
        }
        return tuple(v * _MPH for v in round_numbers[kind])
    round_numbers = {
        "bump": (6, 10, 13, 16, 20, 25, 32),
        "stops": (5, 6, 8, 10, 11, 13, 16),
        "rough": (8, 13, 20, 25, 32),
        "rollers": (6, 10, 13, 16, 20, 25),
    }
    return tuple(v * _KMH for v in round_numbers[kind])


def drives(
    car: HalfCar,
    units: str,
    rates: Sequence[float] = RATES,
    kinds: Sequence[str] = KINDS,
    speed_limit: float = math.inf,
) -> list[Planned]:
    """All drives to try.

    Parameters
    ----------
    car : HalfCar
        Its wheel base and slowest mode say how long a recording has to be.
    units : str
        ``US`` or ``SI``: which numbers are round.
    rates, kinds : sequences of float and str
        Rows a second, and kinds of ground.
    speed_limit : float
        m/s; nothing faster is tried.

    Returns
    -------
    list of Planned
        By ground, speed and rate.
    """
    slowest = modes(car)[0].natural
    return [
        Planned(ground, speed, rate, _seconds(ground, speed, car.l, slowest))
        for ground in grounds(units)
        if ground.kind in kinds
        for speed in speeds(ground.kind, units)
        if speed <= speed_limit * (1.0 + 1e-6)
        for rate in rates
    ]


def _seconds(ground: Ground, speed: float, wheelbase: float, slowest: float) -> float:
    """Length of a recording, s, in tenths."""
    if math.isinf(ground.extent):
        seconds = max(_ROUGH_SECONDS, _PERIODS / slowest)
    else:
        seconds = LEAD + (ground.extent + wheelbase) / speed + max(_REST, _PERIODS / slowest)
    return min(math.ceil(10.0 * seconds - 1e-9) / 10.0, _LONGEST)
