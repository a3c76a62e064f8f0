"""The main job: a vehicle in, every drive of the grid judged, and the one to do."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.half_car import HalfCar
from bayes_asv.planning.grid import RATES, Planned, drives
from bayes_asv.planning.grounds import KINDS, Ground
from bayes_asv.planning.limits import Limit, limit
from bayes_asv.planning.motion import Motion, Pass, Tyres, assumed_tyres, drive_all
from bayes_asv.planning.sensing import with_assumed_noise
from bayes_asv.planning.trial import Trial, attempt
from bayes_asv.planning.widths import ANSWERS, Known, floors, known, passes_needed, widths

__all__ = ["Judged", "Plan", "plan"]

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]
Place = tuple[Ground, float]

_ROADS = 2  # rough roads averaged: one of a class is not like another
# A bump is laid out in a minute and is the same each time, a rough road is what it happens to be:
# the kind that is least trouble, unless its best drive leaves answers so many times wider than
# the best of all,
_WORTH_THE_TROUBLE = 3.0
# and of that kind the slowest drive of those about as good as its best.
_AS_GOOD = 1.3
_HARDLY_WORSE = 1.05  # in width


@dataclass(frozen=True)
class Judged:
    """A trial with its promises.

    Parameters
    ----------
    trial : Trial
        The drive and what it says.
    needed : tuple of 4 int or None
        Passes that bring each of :data:`~bayes_asv.planning.widths.ANSWERS` to its wanted width;
        None where no number does, or the drive cannot be used.
    quality : float
        Widest of the answers after one pass, in units of what is wanted, if all given values
        were exact: what the drive itself is worth.
    """

    trial: Trial
    needed: tuple[int | None, ...]
    quality: float

    @property
    def passes(self) -> int | None:
        """Passes that bring all answers to their wanted widths."""
        return None if None in self.needed else max(n for n in self.needed if n is not None)


@dataclass(frozen=True)
class Plan:
    """Everything a plan says.

    Parameters
    ----------
    vehicle : Vehicle
        As read.
    assumed_noise : tuple of str
        Channels whose noise the vehicle file does not give.
    tyres : Tyres
        What the car was driven on.
    tyres_told : bool
        Whether both their rate and the unsprung mass were given.
    want : Mapping of str to float
        Wanted width of each answer, share of one.
    most_passes : int
        The most that is recommended.
    before : Known
        What is known beforehand.
    judged : tuple of Judged
        Every drive of the grid.
    chosen : Judged or None
        The drive to do; None when none would do.
    best : Judged or None
        The drive to do, or the one that comes nearest; None when none can be used.
    passes : int
        How often to do it: until all answers are as wanted, or until more driving hardly helps;
        0 when no drive can be used.
    floor : dict of str to float
        Width that no amount of driving gets below, by answer.
    limits : tuple of Limit
        What to know better for each answer that stays too wide.
    seed : int
        Of rough roads and noise.
    """

    vehicle: Vehicle
    assumed_noise: tuple[str, ...]
    tyres: Tyres
    tyres_told: bool
    want: Mapping[str, float]
    most_passes: int
    before: Known
    judged: tuple[Judged, ...]
    chosen: Judged | None
    best: Judged | None
    passes: int
    floor: Mapping[str, float]
    limits: tuple[Limit, ...]
    seed: int

    @property
    def verdict(self) -> str:
        """``ok``, or ``refused`` when no drive of the grid would do."""
        return "ok" if self.chosen is not None else "refused"

    def promised(self, one: Judged, passes: int) -> Mapping[str, float]:
        """Widths of the answers after so many passes of a drive, shares of one."""
        found = widths(one.trial.information, passes, self.before)
        return dict(zip(ANSWERS, found.tolist(), strict=True))


def plan(
    vehicle: Vehicle,
    want: Mapping[str, float],
    *,
    rates: Sequence[float] = RATES,
    kinds: Sequence[str] = KINDS,
    speed_limit: float = math.inf,
    most_passes: int = 10,
    tyre_rate: float | None = None,
    unsprung: float | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Plan:
    """Judge every drive of the grid and choose one.

    Parameters
    ----------
    vehicle : Vehicle
        Nominal values are taken for true; sensors as declared.
    want : Mapping of str to float
        Wanted width of c_f, c_r, i and k_g, shares of one: one posterior deviation.
    rates, kinds : sequences of float and str
        Rows a second, and kinds of ground to try.
    speed_limit : float
        m/s.
    most_passes : int
        The most that anyone will drive.
    tyre_rate, unsprung : float, optional
        Of an axle, both sides together, N/m and kg; assumed where not known.
    seed : int
        Of rough roads and noise.
    progress : callable, optional
        Told the share done and a few words.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        When no real car moves as this vehicle would.
    """
    tell = progress or (lambda share, words: None)
    car = HalfCar(*(getattr(vehicle, name).value for name in HalfCar._fields))
    noisy, assumed = with_assumed_noise(vehicle)
    grid = drives(car, vehicle.units, rates, kinds, speed_limit)
    tell(0.0, "driving on paper")
    tyres = assumed_tyres(car, tyre_rate, unsprung)
    motions = _motions(car, tyres, grid, seed)
    tell(0.1, "asking what each drive says")
    trials: list[Trial] = []
    keys = list(motions)

    def ask(key: Place) -> list[Trial]:
        alike = [drive for drive in grid if (drive.ground, drive.speed) == key]
        return attempt(noisy, alike, motions[key], seed)

    with ThreadPoolExecutor(2) as pool:
        for each in pool.map(ask, keys):
            trials += each
            tell(0.1 + 0.85 * len(trials) / len(grid), "asking what each drive says")
    before = known(vehicle)
    wanted = np.array([want[name] for name in ANSWERS])
    judged = tuple(_judge(trial, before, wanted) for trial in trials)
    chosen = _choose(judged, most_passes)
    best = chosen or _nearest(judged, before, wanted, most_passes)
    found: list[Limit] = []
    if best is not None and chosen is None:
        for name in ANSWERS:
            what = limit(best.trial.information, most_passes, before, name, want[name])
            if what is not None:
                found.append(what)
    tell(1.0, "done")
    return Plan(
        vehicle=vehicle,
        assumed_noise=assumed,
        tyres=tyres,
        tyres_told=tyre_rate is not None and unsprung is not None,
        want=dict(want),
        most_passes=most_passes,
        before=before,
        judged=judged,
        chosen=chosen,
        best=best,
        passes=_passes(best, before, wanted, most_passes),
        floor=dict(zip(ANSWERS, floors(before).tolist(), strict=True)),
        limits=tuple(found),
        seed=seed,
    )


def _motions(
    car: HalfCar, tyres: Tyres, grid: Sequence[Planned], seed: int
) -> dict[Place, list[Motion]]:
    """Drive over each ground at each speed, whatever the rate."""
    passes: dict[Place, list[Pass]] = {}
    for drive in grid:
        roads = _ROADS if drive.ground.kind == "rough" else 1
        passes[drive.ground, drive.speed] = [
            Pass(drive.ground, drive.speed, drive.seconds, seed + k) for k in range(roads)
        ]
    flat = [one for each in passes.values() for one in each]
    driven = iter(drive_all(car, tyres, flat) if flat else [])
    return {key: [next(driven) for _ in each] for key, each in passes.items()}


def _judge(trial: Trial, before: Known, want: Array) -> Judged:
    if not trial.usable:
        return Judged(trial, (None,) * len(ANSWERS), math.inf)
    quality = float(np.max(widths(trial.information, 1, before.exactly()) / want))
    return Judged(trial, passes_needed(trial.information, before, want), quality)


def _choose(judged: Sequence[Judged], most: int) -> Judged | None:
    """Gentle drives first, then fewest passes, then what is easiest of what is about as good."""
    will_do = [(one, one.passes) for one in judged if one.trial.usable]
    enough = [(one, n) for one, n in will_do if n is not None and n <= most]
    for candidates in ([(o, n) for o, n in enough if o.trial.gentle], enough):
        if candidates:
            fewest = min(n for _, n in candidates)
            return _easiest([one for one, n in candidates if n == fewest])
    return None


def _easiest(candidates: Sequence[Judged]) -> Judged:
    """Least trouble of those that are about as good as the best, all given values exact."""
    best: dict[str, float] = {}
    for one in candidates:
        kind = one.trial.drive.ground.kind
        best[kind] = min(best.get(kind, math.inf), one.quality)
    worst = _WORTH_THE_TROUBLE * min(best.values())
    kind = next(kind for kind in KINDS if best.get(kind, math.inf) <= worst)
    near = [
        one
        for one in candidates
        if one.trial.drive.ground.kind == kind and one.quality <= _AS_GOOD * best[kind]
    ]

    def trouble(one: Judged) -> tuple[float, float, float]:
        drive = one.trial.drive
        return drive.speed, drive.ground.height, drive.rate

    return min(near, key=trouble)


def _worst(one: Judged, passes: int, before: Known, want: Array) -> float:
    """Widest answer in units of what is wanted."""
    return float(np.max(widths(one.trial.information, passes, before) / want))


def _nearest(judged: Sequence[Judged], before: Known, want: Array, most: int) -> Judged | None:
    """Choose what leaves the least to be wished for, gently if that is hardly worse."""
    usable = [(one, _worst(one, most, before, want)) for one in judged if one.trial.usable]
    if not usable:
        return None
    enough = _HARDLY_WORSE * min(worst for _, worst in usable)
    near = [one for one, worst in usable if worst <= enough]
    # where a given value is the limit all good drives come out alike: keep those that would do
    # once it is measured better
    near = [one for one in near if _alone(one, most) <= 1.0] or near
    return _easiest([one for one in near if one.trial.gentle] or near)


def _passes(best: Judged | None, before: Known, want: Array, most: int) -> int:
    """Fewest passes of the best drive after which more of them hardly help."""
    if best is None:
        return 0
    enough = max(1.0, _HARDLY_WORSE * _worst(best, most, before, want))
    alone = max(1.0, _alone(best, most))

    def will_do(n: int) -> bool:
        return _worst(best, n, before, want) <= enough and _alone(best, n) <= alone

    return next((n for n in range(1, most) if will_do(n)), most)


def _alone(one: Judged, passes: int) -> float:
    """Widest answer in units of what is wanted if all given values were exact."""
    return one.quality / math.sqrt(passes)
