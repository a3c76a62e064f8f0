"""Fit of one more effect, and of the effects that a user names."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.errors import InputError
from bayes_asv.models.effects import EFFECTS, Site, site
from bayes_asv.posterior.effect_candidates import Candidate, candidates
from bayes_asv.posterior.fitted_model import (
    Dataset,
    FittedModel,
    fitted,
    transfer_coordinates,
    update_patterns,
)

__all__ = ["added", "read_site", "with_effects"]

Array = NDArray[np.float64]

_TRIED = 2  # starts from which a site is fitted
_AT_MOST = 4  # the same, where less is gained than its score promises
_KEPT = 0.7  # share of a promise that is enough
_LOOKED = (-2.5, -1.5, -0.7, 0.7, 1.5, 2.5)  # deviations along a shape
_HIGHER = 1.0  # nats
_ENDS = (-2.0, 2.0)  # the same of what is believed of a shape beforehand
_FAR = 1.5  # the same, from where a climb may find another hill
_KNOWN = 10.0  # nats that the far end of a shape costs where the data know it
_LENGTHS = (0.12, 0.35, 1.0)  # s, of a push that is asked for


def read_site(text: str) -> Site:
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
        return site(text)
    except KeyError:
        places = ", ".join(f"{name}@{w}" if w else name for w in EFFECTS[name].places)
        raise InputError(text, f"'{where}' is no place for it", f"say {places}") from None


def with_effects(where: Dataset, sites: Sequence[Site]) -> tuple[Dataset, FittedModel]:
    """Fit a model with given effects, one added after the other.

    Parameters
    ----------
    where : Dataset
        Recordings.
    sites : sequence of Site
        Effects in order.

    Returns
    -------
    Setting, FittedModel
        With patterns that stand on the fitted model, and its mode.

    Raises
    ------
    InputError
        For an effect that the car or its sensors cannot have.
    """
    target = where.target(())
    stage = fitted(target, np.zeros(target.space.dimension))
    where = update_patterns(where, stage)
    for one in sites:
        stage = replace(stage, target=replace(stage.target, patterns=where.patterns))
        groups = [group for group in _groups(stage, where, one) if group]
        if not groups:
            raise InputError(
                str(one),
                f"is not possible on the {stage.space.car.name} car with these sensors",
                "leave it out, or name another place",
            )
        stage = max(
            (added(where, stage, group) for group in groups), key=lambda s: s.mode.log_posterior
        )
        where = update_patterns(where, stage)
    return where, replace(stage, target=replace(stage.target, patterns=where.patterns))


def _groups(stage: FittedModel, where: Dataset, site: Site) -> list[list[Candidate]]:
    """Values from which to add an effect, one group a run that it may be in."""
    if not site.effect.in_one_run:
        return [[c for c in candidates(stage, where.vehicle) if str(c.site) == str(site)]]
    runs = range(len(where.lines)) if site.run is None else (site.run,)
    edges = [
        c
        for c in candidates(stage, where.vehicle)
        if c.edge and c.site.where == _first_place(stage)
    ]
    return [
        [
            replace(
                c,
                site=replace(site, run=run),
                values={**c.values, "duration": lasts},
                edge=False,
            )
            for c in edges
            for lasts in _LENGTHS
            if c.site.run == run
        ]
        for run in runs
    ]


def _first_place(stage: FittedModel) -> str:
    """Axle of the first suspension element."""
    return str(stage.space.car.elements[0].axle)


def added(
    where: Dataset,
    stage: FittedModel,
    group: Sequence[Candidate],
    promised: float = 0.0,
    floor: float = -math.inf,
) -> FittedModel:
    """Fit a model with one more effect, from the best of its starts.

    Parameters
    ----------
    where : Dataset
        Recordings.
    stage : FittedModel
        The model so far, at its mode.
    group : sequence of Candidate
        Of one site: sets of values to begin from.
    promised : float
        Nats that a little of it would gain to first order.  A fit that gains much less has climbed
        another hill: a stop that is soft and early where a hard one is just reached.
    floor : float
        Log-posterior that others reach; what stays far below is not followed to its mode.
    """
    site = group[0].site
    sites = (*stage.sites, site)
    target = where.target(sites)
    scale = target.space.sizes
    first = site.effect.parameters[0]
    begun: list[tuple[float, int, Array]] = []
    for candidate in group:
        tried = [candidate.values]  # a little of it: next to where the model stands already
        if not candidate.begin:
            two_sided = first.form in ("linear", "sinh")
            sizes = [s * first.size(scale) for s in first.starts]
            sizes += [-s for s in sizes if two_sided and s > 0.0]
            tried += [{**candidate.values, first.name: size} for size in sizes]
        for values in tried:
            z = transfer_coordinates(stage.space, stage.mode.z, target.space, site, values)
            begun.append((float(target.log_posterior(z[None])[0]), len(begun), z))
    begun.sort(key=lambda b: (-b[0], b[1]))
    best: FittedModel | None = None
    for fits, (_, _, z) in enumerate(begun[:_AT_MOST], 1):
        one = fitted(target, z, floor)
        if best is None or one.mode.log_posterior > best.mode.log_posterior:
            best = one
        kept = best.mode.log_posterior > stage.mode.log_posterior + _KEPT * promised - _HIGHER
        at_noise = best.mode.converged and float(np.mean(best.mode.slopes.nu**2)) < 1.2
        if kept and (at_noise or fits >= _TRIED):  # at the noise no start can end lower
            break
    assert best is not None
    return _over_the_next_hill(best) if site.effect.acts != "reading" else _again(where, best)


def _again(where: Dataset, stage: FittedModel) -> FittedModel:
    """Fit a sensor's fault again, with what it does worked out where the first fit left the car."""
    better = update_patterns(where, stage)
    return fitted(better.target(stage.sites), stage.mode.z)


def _over_the_next_hill(stage: FittedModel) -> FittedModel:
    """Look along every shape for a higher place, and climb from there.

    How sharply a law bends has more than one hill: a corner that is rounded less than the motion
    shows, and one that is rounded more.  Where the data hardly know a shape the other hill may be
    higher only once everything else has moved along: then the far ends of what was believed
    beforehand are climbed from.
    """
    space, z = stage.space, stage.mode.z
    shapes = [
        space.names.index(site.coordinate_name(p))
        for site in stage.sites
        for p in site.effect.parameters
        if p.shape
    ]
    if not shapes:
        return stage
    here = stage.mode.log_posterior
    looked = np.array([_with(z, k, z[k] + by) for k in shapes for by in _LOOKED])
    values = stage.target.log_posterior(looked)
    if float(values.max()) > here + _HIGHER:
        starts = looked[[int(np.argmax(values))]]
    else:
        far = [_with(z, k, end) for k in shapes for end in _ENDS if abs(end - z[k]) > _FAR]
        ends = np.array(far).reshape(-1, len(z))
        starts = ends[stage.target.log_posterior(ends) > here - _KNOWN]
    others = [fitted(stage.target, start, here + _HIGHER) for start in starts]
    return max((stage, *others), key=lambda s: s.mode.log_posterior)


def _with(z: Array, k: int, value: float) -> Array:
    out = z.copy()
    out[k] = value
    return out
