"""Candidate effects and the values from which their fit starts.

A candidate is one effect at one place with one set of values: a little of it where that makes
sense (a tolerance), and where nobody has a little of it a stop within the travel that was used,
or the edge of a push at some time of one run: a push is the difference of two of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.clocks import GROUPS
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.effects import BOTH, EFFECTS, Effect, Site
from bayes_asv.posterior.fitted_model import FittedModel
from bayes_asv.posterior.free_simulation import free_run

__all__ = ["Candidate", "candidates"]

Array = NDArray[np.float64]

_DEEP = tuple(np.linspace(0.5, 0.95, 10).tolist())  # shares of the travel used where a stop may be
_SOFT = 1.0  # rate of a stop that is looked for, in spring rates
_ONSET, _SHARP = 0.003, 0.07  # m, and as a share of the travel used, of the same
_GRID = 0.01  # s between edges that are looked for
_EDGES = 500  # edges that all runs together have at most, an axle
_PUSH = 0.02  # of the axle's load, of a push that is looked for
_FOR_EVER = 1e4  # s


@dataclass(frozen=True)
class Candidate:
    """An effect that may be missing.

    Parameters
    ----------
    site : Site
        What and where.
    values : mapping
        Values of its parameters (SI units) that stand for a little of it.
    tolerance : bool
        They are one deviation of what every car may have.
    signed : bool
        Less than nothing of it cannot be.
    begin : bool
        A fit begins from these values; otherwise from the effect's own starts.
    edge : bool
        A force that begins and never ends.
    """

    site: Site
    values: Mapping[str, float]
    tolerance: bool
    signed: bool
    begin: bool = False
    edge: bool = False


def _used(stage: FittedModel) -> Array:
    """Largest compression, extension (m) and speed (m/s) of each element over all runs, (ne, 3).

    All positive.
    """
    used = np.zeros((len(stage.space.car.elements), 3))
    for run in range(len(stage.space.timelines)):
        _, states, _ = free_run(stage.target, stage.mode.z, run)
        for e in range(len(used)):
            travel, speed = states[:, 2 * e], states[:, 2 * e + 1]
            reached = -travel.min(), travel.max(), np.abs(speed).max()
            used[e] = np.maximum(used[e], reached)
    return used


def candidates(stage: FittedModel, vehicle: Vehicle) -> list[Candidate]:
    """List what the recordings of a stage may be asked about.

    Parameters
    ----------
    stage : FittedModel
        Where one stands; what it has already is left out.
    vehicle : Vehicle
        What it says is uncertain is in the model already.
    """
    scale = stage.space.sizes
    used = _used(stage)
    out: list[Candidate] = []
    for effect in EFFECTS.values():
        for where in effect.places:
            site = Site(effect, where)
            elements = site.elements(stage.space.car)
            known = any(site.meets(other) for other in stage.sites)
            if known or not _possible(site, stage, vehicle):
                continue
            if effect.slight is not None:
                # at several elements or channels a tolerance is that of one and of the others
                group = effect.acts == "reading" and where in GROUPS
                tolerance = len(elements) <= 1 and not group
                values = effect.slightly(scale)
                if effect.straight is not None:
                    own = used[list(elements)].max(axis=0)
                    values = effect.straight(values, max(own[0], own[1]), own[2])
                out.append(Candidate(site, values, tolerance, effect.one_sided))
            elif effect.stops:
                travel = used[list(elements), 0 if effect.stops == "compression" else 1].max()
                out += _stops(site, travel, _SOFT * scale.spring)
            elif where != BOTH:
                out += _edges(effect, where, stage)
    return out


def _stops(site: Site, travel: float, rate: float) -> list[Candidate]:
    """List stops within the travel that was used.

    They come in over a small part of it: a stop of a light car that was just reached for 15 ms had
    a score of 2.5 with an onset of 3 mm, most of the travel of that car, and of 16 with 0.3 mm.
    """
    onset = min(_ONSET, _SHARP * travel)
    return [
        Candidate(site, {"gap": share * travel, "rate": rate, "onset": onset}, False, True)
        for share in _DEEP
        if share * travel > onset
    ]


def _edges(effect: Effect, where: str, stage: FittedModel) -> list[Candidate]:
    """List forces that begin at some instant of a run and never end.

    Off by as long as a car's answer to an edge, a push looks like no push.  Half way between edges
    every 30 ms one keeps a quarter of its squared score on a car that answers fast, every 15 ms
    three fifths, every 10 ms four fifths.  Long recordings are asked less closely, for the number
    of questions has a price.
    """
    load = stage.space.sizes.load
    spans = [line.elapsed[[0, -1]] for line in stage.space.timelines]
    grid = max(_GRID, float(np.sum(np.diff(spans))) / _EDGES)
    out = []
    for run, span in enumerate(spans):
        site = Site(effect, where, run)
        for begin in np.arange(span[0], span[1], grid):
            values = {"force": _PUSH * load, "start": float(begin), "duration": _FOR_EVER}
            out.append(Candidate(site, {**values, "rise": grid}, False, False, edge=True))
    return out


def _possible(site: Site, stage: FittedModel, vehicle: Vehicle) -> bool:
    """Whether a car and its sensors can have an effect."""
    car = stage.space.car
    if site.effect.acts == "reading":
        names = {channel.name for run in stage.space.timelines for channel in run.channels}
        affected = site.channels(sorted(names))
        corner = site.effect.fault == "bandwidth"
        return 0 < len(affected) < len(names) and not (
            corner and vehicle.sensor(site.where).bandwidth is None
        )
    if site.where == BOTH:
        return len({element.axle for element in car.elements}) > 1
    return not site.where or bool(site.elements(car))
