"""Fit of one more effect, and of the effects that a user names.

A candidate is one effect at one place with one set of parameter values.  Where healthy cars have
the effect to some extent, the values are one tolerance.  Otherwise the candidate is a stop within
the travel that was used, or a force step at some time of one run; a force pulse is the difference
of two steps.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

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

# Gaps of candidate stops, shares of the travel used.
_STOP_GAPS = tuple(np.linspace(0.5, 0.95, 10).tolist())
_STOP_RATE = 1.0  # rate of a candidate stop, in mean spring rates of the car
# Onset of a candidate stop: the smaller of a length (m) and a share of the travel used.
_STOP_ONSET, _STOP_ONSET_SHARE = 0.003, 0.07
_STEP_SPACING = 0.01  # smallest time between candidate force steps, s
_MAX_STEPS = 500  # most candidate force steps of an axle, over all runs
_STEP_FORCE = 0.02  # size of a candidate force step, as a share of an element's static load
_ENDLESS = 1e4  # duration of a step, s: longer than any recording


@dataclass(frozen=True)
class Candidate:
    """An effect that the model may lack.

    Parameters
    ----------
    placed : PlacedEffect
        The effect and its place.
    values : mapping
        Values of its parameters (SI units), for a small size of the effect.
    tolerance : bool
        Whether the values are one standard deviation of a tolerance that every car may have.
    one_sided : bool
        The size cannot be negative.
    is_start : bool
        Whether a fit starts from these values only, not from the effect's own starting values.
    is_step : bool
        Whether it is a force that begins and never ends.
    """

    placed: PlacedEffect
    values: Mapping[str, float]
    tolerance: bool
    one_sided: bool
    is_start: bool = False
    is_step: bool = False


def _range_of_motion(model: FittedModel) -> Array:
    """Largest compression, extension (m) and speed (m/s) of each element, (ne, 3), all positive."""
    motion_range = np.zeros((len(model.space.car.elements), 3))
    for run in range(len(model.space.recordings)):
        _, states, _ = free_run(model.posterior, model.mode.z, run)
        for e in range(len(motion_range)):
            travel, speed = states[:, 2 * e], states[:, 2 * e + 1]
            reached = -travel.min(), travel.max(), np.abs(speed).max()
            motion_range[e] = np.maximum(motion_range[e], reached)
    return motion_range


def candidates(model: FittedModel, vehicle: Vehicle) -> list[Candidate]:
    """List the effects that may be added to a fitted model.

    Parameters
    ----------
    model : FittedModel
        Current model; effects already in it are skipped.
    vehicle : Vehicle
        Declared vehicle and sensors.
    """
    scale = model.space.sizes
    motion_range = _range_of_motion(model)
    out: list[Candidate] = []
    for effect in EFFECTS.values():
        if effect.on_request:
            continue
        for where in effect.places:
            placed = PlacedEffect(effect, where)
            elements = placed.elements(model.space.car)
            known = any(other.subsumes(placed) for other in model.placed_effects)
            if known or not _is_possible(placed, model, vehicle):
                continue
            if effect.tolerance_values is not None:
                # at several elements or channels, a tolerance is that of each by itself
                group = effect.acts == "reading" and where in GROUPS
                tolerance = len(elements) <= 1 and not group
                values = effect.tolerance_values_for(scale)
                if effect.scaled_to_range is not None:
                    reached = motion_range[list(elements)].max(axis=0)
                    values = effect.scaled_to_range(values, max(reached[0], reached[1]), reached[2])
                out.append(Candidate(placed, values, tolerance, effect.one_sided))
            elif effect.stops:
                travel = motion_range[
                    list(elements), 0 if effect.stops == "compression" else 1
                ].max()
                out += _stop_candidates(placed, travel, _STOP_RATE * scale.spring)
            elif not effect.in_one_run:
                first = effect.parameters[0]
                sizes = [start * first.size(scale) for start in first.initial_values]
                out += [Candidate(placed, {first.name: x}, False, effect.one_sided) for x in sizes]
            elif where != BOTH:
                out += _step_candidates(effect, where, model)
    return out


def _stop_candidates(placed: PlacedEffect, travel: float, rate: float) -> list[Candidate]:
    """List candidate stops within the travel that was used.

    Their onset is a small part of that travel: a stop of a light car that was just reached for
    15 ms had a score of 2.5 with an onset of 3 mm, most of its travel, and of 16 with 0.3 mm.
    """
    onset = min(_STOP_ONSET, _STOP_ONSET_SHARE * travel)
    return [
        Candidate(placed, {"gap": share * travel, "rate": rate, "onset": onset}, False, True)
        for share in _STOP_GAPS
        if share * travel > onset
    ]


def _step_candidates(effect: Effect, where: str, model: FittedModel) -> list[Candidate]:
    """List candidate forces that begin at some instant of a run and never end.

    A force step is missed if the nearest candidate is off by the response time of the car.  On a
    car with a fast response, a step half way between two candidates keeps a quarter of its squared
    score if the candidates are 30 ms apart, three fifths at 15 ms, and four fifths at 10 ms.  Long
    recordings have a coarser grid, because the threshold rises with the number of candidates.
    """
    element_load = model.space.sizes.load
    spans = [recording.elapsed[[0, -1]] for recording in model.space.recordings]
    grid = max(_STEP_SPACING, float(np.sum(np.diff(spans))) / _MAX_STEPS)
    out = []
    for run, span in enumerate(spans):
        placed = PlacedEffect(effect, where, run)
        for begin in np.arange(span[0], span[1], grid):
            values = {
                "force": _STEP_FORCE * element_load,
                "start": float(begin),
                "duration": _ENDLESS,
            }
            out.append(Candidate(placed, {**values, "rise": grid}, False, False, is_step=True))
    return out


def _is_possible(placed: PlacedEffect, model: FittedModel, vehicle: Vehicle) -> bool:
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

_STARTS = 2  # starting points from which an effect is fitted
_MAX_STARTS = 4  # starting points if the gain falls short of what the score predicts
_ENOUGH_GAIN = 0.7  # share of the predicted gain (nats) at which no further start is tried
# Offsets from the mode along a shape coordinate at which the density is evaluated, prior sd.
_SHAPE_OFFSETS = (-2.5, -1.5, -0.7, 0.7, 1.5, 2.5)
_MODE_MARGIN = 1.0  # nats by which another mode must exceed the current one
_SHAPE_ENDS = (-2.0, 2.0)  # far ends of a shape coordinate from which to start again, prior sd
_END_DISTANCE = 1.5  # least distance of a far end from the mode, prior sd
_MAX_END_LOSS = 10.0  # nats; a far end that costs more is excluded by the data
_MAX_EDGES = 8  # beginnings and ends of force pulses that are compared
_EDGE_DISTANCE = 0.05  # least time between two of them, s


def read_effect(text: str) -> PlacedEffect:
    """Read an effect as the command line takes it, ``name`` or ``name@where``.

    Raises
    ------
    InputError
        When there is no such effect or place.
    """
    name, _, where = text.partition("@")
    if name not in EFFECTS:
        raise InputError(text, "is not an effect", f"there are {', '.join(EFFECTS)}")
    try:
        return placed_effect(text)
    except KeyError:
        places = ", ".join(f"{name}@{w}" if w else name for w in EFFECTS[name].places)
        raise InputError(text, f"'{where}' is not a place for it", f"use {places}") from None


def with_effects(
    dataset: Dataset, placed_effects: Sequence[PlacedEffect], start: FittedModel | None = None
) -> tuple[Dataset, FittedModel]:
    """Fit a model with given effects, added one after another.

    Parameters
    ----------
    dataset : Dataset
        Recordings.
    placed_effects : sequence of PlacedEffect
        Effects in order.
    start : FittedModel, optional
        Model to which they are added; by default the car without effects.

    Returns
    -------
    Dataset, FittedModel
        The recordings with sensor corrections computed from the fitted model, and that model.

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
    """List starting values for an added effect, one group for each run that may have it."""
    if placed.effect.on_request:
        if not _is_possible(placed, model, dataset.vehicle):
            return []
        return [[Candidate(placed, values, False, True) for values in placed.effect.fit_starts]]
    if not placed.effect.in_one_run:
        return [[c for c in candidates(model, dataset.vehicle) if str(c.placed) == str(placed)]]
    runs = range(len(dataset.recordings)) if placed.run is None else (placed.run,)
    return [_best_pulses(model, dataset, replace(placed, run=run)) for run in runs]


def _best_pulses(model: FittedModel, dataset: Dataset, placed: PlacedEffect) -> list[Candidate]:
    """List the pulses of one run that gain most, as starting values.

    A pulse is the difference of two steps.  Only one that begins and ends near the true one finds
    it; therefore all pairs of the most informative steps are compared, those at which the gain of a
    step by itself has its peaks.
    """
    posterior = dataset.posterior((*model.placed_effects, placed))
    steps = [
        c
        for c in candidates(model, dataset.vehicle)
        if c.is_step and c.placed.where == _first_place(model) and c.placed.run == placed.run
    ]

    def gain(values: Mapping[str, float]) -> tuple[float, float]:
        """Gain (nats) of the best force for these times, to second order, and that force."""
        small = values["force"]
        z = [
            transfer_coordinates(
                model.space, model.mode.z, posterior.space, placed, {**values, "force": force}
            )
            for force in (-small, 0.0, small)
        ]
        below, at, above = posterior.log_posterior(np.array(z)).tolist()
        slope, curvature = 0.5 * (above - below), 2.0 * at - above - below
        if not curvature > 0.0:
            return 0.0, small
        return 0.5 * slope**2 / curvature, slope / curvature * small

    edges: list[float] = []
    for step in sorted(steps, key=lambda step: -gain(step.values)[0]):
        start = step.values["start"]
        if len(edges) < _MAX_EDGES and all(abs(start - x) >= _EDGE_DISTANCE for x in edges):
            edges.append(start)
    pulses = [
        {**steps[0].values, "start": start, "duration": end - start}
        for start, end in combinations(sorted(edges), 2)
    ]
    best = sorted(((*gain(values), values) for values in pulses), key=lambda one: -one[0])
    return [
        Candidate(placed, {**values, "force": force}, False, False, is_start=True)
        for _, force, values in best[:_MAX_STARTS]
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
    """Fit a model with one more effect, from the best of several starting points.

    Parameters
    ----------
    dataset : Dataset
        Recordings.
    model : FittedModel
        The model so far, at its mode.
    group : sequence of Candidate
        Starting values of one effect at its place.
    promised : float
        Gain that its score predicts to first order, nats.  A fit that gains much less is at another
        local maximum: a soft stop with a small gap where a hard one is just reached.
    floor : float
        Log-posterior that other candidates reach; a fit that stays far below is stopped early.
    """
    placed = group[0].placed
    placed_effects = (*model.placed_effects, placed)
    posterior = dataset.posterior(placed_effects)
    scale = posterior.space.sizes
    first = placed.effect.parameters[0]
    starts: list[tuple[float, int, Array]] = []
    for candidate in group:
        tried = [candidate.values]  # a small size of the effect, close to the current model
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
    for fits, (_, _, z) in enumerate(starts[:_MAX_STARTS], 1):
        fit = fit_model(posterior, z, floor)
        if best is None or fit.mode.log_posterior > best.mode.log_posterior:
            best = fit
        gained_enough = (
            best.mode.log_posterior
            > model.mode.log_posterior + _ENOUGH_GAIN * promised - _MODE_MARGIN
        )
        at_noise = best.mode.converged and float(np.mean(best.mode.slopes.nu**2)) < 1.2
        if gained_enough and (
            at_noise or fits >= _STARTS
        ):  # residuals at the noise cannot be smaller
            break
    assert best is not None
    return (
        _search_shape_modes(best)
        if placed.effect.acts != "reading"
        else _refit_sensor_effect(dataset, best)
    )


def _refit_sensor_effect(dataset: Dataset, model: FittedModel) -> FittedModel:
    """Fit a sensor effect again, with its corrections recomputed at the first fit."""
    better = update_corrections(dataset, model)
    return fit_model(better.posterior(model.placed_effects), model.mode.z)


def _search_shape_modes(model: FittedModel) -> FittedModel:
    """Search along every shape coordinate for a higher mode.

    The posterior may be multimodal in how sharply a force law bends: one mode has a corner that is
    rounded less than the motion can show, another one that is rounded more.  Where the data hardly
    constrain a shape, the other mode may be higher only after all other coordinates have been
    fitted as well; the search then starts again from the far ends of the prior.
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
    height = model.mode.log_posterior
    points = np.array([_with_coordinate(z, k, z[k] + by) for k in shapes for by in _SHAPE_OFFSETS])
    values = model.posterior.log_posterior(points)
    if float(values.max()) > height + _MODE_MARGIN:
        starts = points[[int(np.argmax(values))]]
    else:
        distant = [
            _with_coordinate(z, k, end)
            for k in shapes
            for end in _SHAPE_ENDS
            if abs(end - z[k]) > _END_DISTANCE
        ]
        ends = np.array(distant).reshape(-1, len(z))
        starts = ends[model.posterior.log_posterior(ends) > height - _MAX_END_LOSS]
    others = [fit_model(model.posterior, start, height + _MODE_MARGIN) for start in starts]
    return max((model, *others), key=lambda s: s.mode.log_posterior)


def _with_coordinate(z: Array, k: int, value: float) -> Array:
    out = z.copy()
    out[k] = value
    return out
