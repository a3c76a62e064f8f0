"""Fit of one more effect, and of the effects that a user names.

A candidate is one effect at one place with one set of values: a little of it where that makes
sense (a tolerance), and where nobody has a little of it a stop within the travel that was used,
or the edge of a push at some time of one run: a push is the difference of two of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.clocks import GROUPS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.effects import BOTH, EFFECTS, Effect, PlacedEffect, placed_effect
from bayes_asv.posterior.fitted_model import (
    Dataset,
    FittedModel,
    fit_again,
    fit_model,
    transfer_coordinates,
    update_corrections,
)
from bayes_asv.posterior.free_simulation import free_run

__all__ = ["Candidate", "candidates", "fit_with_effect", "read_effect", "with_effects"]

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
    placed : PlacedEffect
        What and where.
    values : mapping
        Values of its parameters (SI units) that stand for a little of it.
    tolerance : bool
        They are one deviation of what every car may have.
    one_sided : bool
        Less than nothing of it cannot be.
    is_start : bool
        A fit begins from these values; otherwise from the effect's own starts.
    is_step : bool
        A force that begins and never ends.
    """

    placed: PlacedEffect
    values: Mapping[str, float]
    tolerance: bool
    one_sided: bool
    is_start: bool = False
    is_step: bool = False


def _used(model: FittedModel) -> Array:
    """Largest compression, extension (m) and speed (m/s) of each element over all runs, (ne, 3).

    All positive.
    """
    used = np.zeros((len(model.space.car.elements), 3))
    for run in range(len(model.space.recordings)):
        _, states, _ = free_run(model.posterior, model.mode.z, run)
        for e in range(len(used)):
            travel, speed = states[:, 2 * e], states[:, 2 * e + 1]
            reached = -travel.min(), travel.max(), np.abs(speed).max()
            used[e] = np.maximum(used[e], reached)
    return used


def candidates(model: FittedModel, vehicle: Vehicle) -> list[Candidate]:
    """List what the recordings of a fitted model may be asked about.

    Parameters
    ----------
    model : FittedModel
        Where one stands; what it has already is left out.
    vehicle : Vehicle
        What it says is uncertain is in the model already.
    """
    scale = model.space.sizes
    used = _used(model)
    out: list[Candidate] = []
    for effect in EFFECTS.values():
        if effect.on_request:
            continue
        for where in effect.places:
            placed = PlacedEffect(effect, where)
            elements = placed.elements(model.space.car)
            known = any(other.subsumes(placed) for other in model.placed_effects)
            if known or not _possible(placed, model, vehicle):
                continue
            if effect.tolerance_values is not None:
                # at several elements or channels a tolerance is that of one and of the others
                group = effect.acts == "reading" and where in GROUPS
                tolerance = len(elements) <= 1 and not group
                values = effect.tolerance_values_for(scale)
                if effect.scaled_to_range is not None:
                    own = used[list(elements)].max(axis=0)
                    values = effect.scaled_to_range(values, max(own[0], own[1]), own[2])
                out.append(Candidate(placed, values, tolerance, effect.one_sided))
            elif effect.stops:
                travel = used[list(elements), 0 if effect.stops == "compression" else 1].max()
                out += _stops(placed, travel, _SOFT * scale.spring)
            elif not effect.in_one_run:
                first = effect.parameters[0]
                sizes = [start * first.size(scale) for start in first.initial_values]
                out += [Candidate(placed, {first.name: x}, False, effect.one_sided) for x in sizes]
            elif where != BOTH:
                out += _edges(effect, where, model)
    return out


def _stops(placed: PlacedEffect, travel: float, rate: float) -> list[Candidate]:
    """List stops within the travel that was used.

    They come in over a small part of it: a stop of a light car that was just reached for 15 ms had
    a score of 2.5 with an onset of 3 mm, most of the travel of that car, and of 16 with 0.3 mm.
    """
    onset = min(_ONSET, _SHARP * travel)
    return [
        Candidate(placed, {"gap": share * travel, "rate": rate, "onset": onset}, False, True)
        for share in _DEEP
        if share * travel > onset
    ]


def _edges(effect: Effect, where: str, model: FittedModel) -> list[Candidate]:
    """List forces that begin at some instant of a run and never end.

    Off by as long as a car's answer to an edge, a push looks like no push.  Half way between edges
    every 30 ms one keeps a quarter of its squared score on a car that answers fast, every 15 ms
    three fifths, every 10 ms four fifths.  Long recordings are asked less closely, for the number
    of questions has a price.
    """
    load = model.space.sizes.load
    spans = [recording.elapsed[[0, -1]] for recording in model.space.recordings]
    grid = max(_GRID, float(np.sum(np.diff(spans))) / _EDGES)
    out = []
    for run, span in enumerate(spans):
        placed = PlacedEffect(effect, where, run)
        for begin in np.arange(span[0], span[1], grid):
            values = {"force": _PUSH * load, "start": float(begin), "duration": _FOR_EVER}
            out.append(Candidate(placed, {**values, "rise": grid}, False, False, is_step=True))
    return out


def _possible(placed: PlacedEffect, model: FittedModel, vehicle: Vehicle) -> bool:
    """Whether a car and its sensors can have an effect."""
    car = model.space.car
    if placed.effect.acts == "reading":
        names = {channel.name for run in model.space.recordings for channel in run.channels}
        affected = placed.channels(sorted(names))
        corner = placed.effect.fault == "bandwidth"
        return 0 < len(affected) < len(names) and not (
            corner and vehicle.sensor(placed.where).bandwidth is None
        )
    if placed.where == BOTH:
        return len({element.axle for element in car.elements}) > 1
    return not placed.where or bool(placed.elements(car))


Array = NDArray[np.float64]

_TRIED = 2  # starts from which an effect is fitted
_AT_MOST = 4  # the same, where less is gained than its score promises
_KEPT = 0.7  # share of a promise that is enough
_LOOKED = (-2.5, -1.5, -0.7, 0.7, 1.5, 2.5)  # deviations along a shape
_HIGHER = 1.0  # nats
_ENDS = (-2.0, 2.0)  # the same of what is believed of a shape beforehand
_FAR = 1.5  # the same, from where a climb may find another hill
_KNOWN = 10.0  # nats that the far end of a shape costs where the data know it
_LENGTHS = (0.12, 0.35, 1.0)  # s, of a push that is asked for


def read_effect(text: str) -> PlacedEffect:
    """Read an effect as the command line takes it, ``name`` or ``name@where``.

    Raises
    ------
    InputError
        When there is no such effect or place.
    """
    name, _, where = text.partition("@")
    if name not in EFFECTS:
        raise InputError(text, "is no effect", f"there are {', '.join(EFFECTS)}")
    try:
        return placed_effect(text)
    except KeyError:
        places = ", ".join(f"{name}@{w}" if w else name for w in EFFECTS[name].places)
        raise InputError(text, f"'{where}' is no place for it", f"say {places}") from None


def with_effects(
    dataset: Dataset, placed_effects: Sequence[PlacedEffect], start: FittedModel | None = None
) -> tuple[Dataset, FittedModel]:
    """Fit a model with given effects, one added after the other.

    Parameters
    ----------
    dataset : Dataset
        Recordings.
    placed_effects : sequence of PlacedEffect
        Effects in order.
    start : FittedModel, optional
        What they are added to; the car without effects where it is left out.

    Returns
    -------
    Dataset, FittedModel
        With sensor corrections that stand on the fitted model, and its mode.

    Raises
    ------
    InputError
        For an effect that the car or its sensors cannot have.
    """
    if start is None:
        posterior = dataset.posterior(())
        model = fit_model(posterior, np.zeros(posterior.space.dimension))
    else:
        model = fit_again(dataset, start, start.placed_effects)
    dataset = update_corrections(dataset, model)
    for one in placed_effects:
        known = next((other for other in model.placed_effects if other.subsumes(one)), None)
        if known is not None:
            raise InputError(
                str(one), f"is in the model already, in {known}", "leave one of them out"
            )
        model = replace(
            model, posterior=replace(model.posterior, sensor_corrections=dataset.sensor_corrections)
        )
        groups = [group for group in _groups(model, dataset, one) if group]
        if not groups:
            raise InputError(
                str(one),
                f"is not possible on the {model.space.car.name} car with these sensors",
                "leave it out, or name another place",
            )
        model = max(
            (fit_with_effect(dataset, model, group) for group in groups),
            key=lambda s: s.mode.log_posterior,
        )
        dataset = update_corrections(dataset, model)
    return dataset, replace(
        model, posterior=replace(model.posterior, sensor_corrections=dataset.sensor_corrections)
    )


def _groups(model: FittedModel, dataset: Dataset, placed: PlacedEffect) -> list[list[Candidate]]:
    """Values from which to add an effect, one group a run that it may be in."""
    if placed.effect.on_request:
        if not _possible(placed, model, dataset.vehicle):
            return []
        return [[Candidate(placed, values, False, True) for values in placed.effect.fit_starts]]
    if not placed.effect.in_one_run:
        return [[c for c in candidates(model, dataset.vehicle) if str(c.placed) == str(placed)]]
    runs = range(len(dataset.recordings)) if placed.run is None else (placed.run,)
    edges = [
        c
        for c in candidates(model, dataset.vehicle)
        if c.is_step and c.placed.where == _first_place(model)
    ]
    return [
        [
            replace(
                c,
                placed=replace(placed, run=run),
                values={**c.values, "duration": lasts},
                is_step=False,
            )
            for c in edges
            for lasts in _LENGTHS
            if c.placed.run == run
        ]
        for run in runs
    ]


def _first_place(model: FittedModel) -> str:
    """Axle of the first suspension element."""
    return str(model.space.car.elements[0].axle)


def fit_with_effect(
    dataset: Dataset,
    model: FittedModel,
    group: Sequence[Candidate],
    promised: float = 0.0,
    floor: float = -math.inf,
) -> FittedModel:
    """Fit a model with one more effect, from the best of its starts.

    Parameters
    ----------
    dataset : Dataset
        Recordings.
    model : FittedModel
        The model so far, at its mode.
    group : sequence of Candidate
        Of one effect at its place: sets of values to begin from.
    promised : float
        Nats that a little of it would gain to first order.  A fit that gains much less has climbed
        another hill: a stop that is soft and early where a hard one is just reached.
    floor : float
        Log-posterior that others reach; what stays far below is not followed to its mode.
    """
    placed = group[0].placed
    placed_effects = (*model.placed_effects, placed)
    posterior = dataset.posterior(placed_effects)
    scale = posterior.space.sizes
    first = placed.effect.parameters[0]
    starts: list[tuple[float, int, Array]] = []
    for candidate in group:
        tried = [candidate.values]  # a little of it: next to where the model stands already
        if not candidate.is_start:
            two_sided = first.form in ("linear", "sinh")
            sizes = [s * first.size(scale) for s in first.initial_values]
            sizes += [-s for s in sizes if two_sided and s > 0.0]
            tried += [{**candidate.values, first.name: size} for size in sizes]
        for values in tried:
            z = transfer_coordinates(model.space, model.mode.z, posterior.space, placed, values)
            starts.append((float(posterior.log_posterior(z[None])[0]), len(starts), z))
    starts.sort(key=lambda b: (-b[0], b[1]))
    best: FittedModel | None = None
    for fits, (_, _, z) in enumerate(starts[:_AT_MOST], 1):
        one = fit_model(posterior, z, floor)
        if best is None or one.mode.log_posterior > best.mode.log_posterior:
            best = one
        kept = best.mode.log_posterior > model.mode.log_posterior + _KEPT * promised - _HIGHER
        at_noise = best.mode.converged and float(np.mean(best.mode.slopes.nu**2)) < 1.2
        if kept and (at_noise or fits >= _TRIED):  # at the noise no start can end lower
            break
    assert best is not None
    return _over_the_next_hill(best) if placed.effect.acts != "reading" else _again(dataset, best)


def _again(dataset: Dataset, model: FittedModel) -> FittedModel:
    """Fit a sensor's fault again, with what it does worked out where the first fit left the car."""
    better = update_corrections(dataset, model)
    return fit_model(better.posterior(model.placed_effects), model.mode.z)


def _over_the_next_hill(model: FittedModel) -> FittedModel:
    """Look along every shape for a higher place, and climb from there.

    How sharply a law bends has more than one hill: a corner that is rounded less than the motion
    shows, and one that is rounded more.  Where the data hardly know a shape the other hill may be
    higher only once everything else has moved along: then the far ends of what was believed
    beforehand are climbed from.
    """
    space, z = model.space, model.mode.z
    shapes = [
        space.names.index(placed.coordinate_name(p))
        for placed in model.placed_effects
        for p in placed.effect.parameters
        if p.shape and not placed.effect.free_form
    ]
    if not shapes:
        return model
    here = model.mode.log_posterior
    looked = np.array([_with(z, k, z[k] + by) for k in shapes for by in _LOOKED])
    values = model.posterior.log_posterior(looked)
    if float(values.max()) > here + _HIGHER:
        starts = looked[[int(np.argmax(values))]]
    else:
        far = [_with(z, k, end) for k in shapes for end in _ENDS if abs(end - z[k]) > _FAR]
        ends = np.array(far).reshape(-1, len(z))
        starts = ends[model.posterior.log_posterior(ends) > here - _KNOWN]
    others = [fit_model(model.posterior, start, here + _HIGHER) for start in starts]
    return max((model, *others), key=lambda s: s.mode.log_posterior)


def _with(z: Array, k: int, value: float) -> Array:
    out = z.copy()
    out[k] = value
    return out
