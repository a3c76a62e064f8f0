"""Sensitivity of the innovations of a run to the car's parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.models.car_model import CarModel
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.posterior.parameters import CarPrior, Coordinate

__all__ = ["answer_slopes", "in_logs", "information", "jacobian", "moved", "parameters", "prior_sd"]

Array = NDArray[np.float64]

_STEP = 1e-5  # relative: one-sided differences are good to about as much


def _terms(car: CarModel) -> tuple[str, ...]:
    """Independent unknowns of a car, in the order of its parameters."""
    return tuple(dict.fromkeys(term[0] for p in car.parameters for term in p.terms))


def _fractions(car: CarModel) -> tuple[str, ...]:
    return tuple(p.name for p in car.parameters if p.kind == "fraction")


def parameters(target: Posterior) -> tuple[str, ...]:
    """Names of what an answer may depend on: unknowns of the car, and gains that are uncertain."""
    gains = (c.name for c in target.space.coordinates if c.kind == "gain")
    return (*_terms(target.space.car), *gains)


def in_logs(target: Posterior, z: Array) -> tuple[Posterior, Array]:
    """Return the same posterior with relative changes of the car's unknowns for coordinates.

    Parameters
    ----------
    target : Posterior
        In whitened coordinates, where a value given as exact has none.
    z : (D,) array
        Where the changes are to be zero.

    Returns
    -------
    target : Posterior
        Its first coordinates are changes of the logarithms of the car's unknowns, then relative
        changes of its fractions, then logarithms of gains; the others are as they were.  Its prior
        means nothing.
    z : (D',) array
        The same point there.
    """
    space = target.space
    car, prior = space.car, space.prior
    values = {name: float(x[0]) for name, x in space.values(z[None]).items()}
    fractions = _fractions(car)
    terms = [name for name in _terms(car) if name not in fractions]
    root = np.zeros((len(prior.logs), len(terms)))
    by_name = {p.name: p for p in car.parameters}
    for a, name in enumerate(prior.logs):
        for term, coefficient, _ in by_name[name].terms:
            root[a, terms.index(term)] += coefficient
    turned = CarPrior(
        car, prior.logs, np.log([values[name] for name in prior.logs]), root,
        np.eye(len(terms)), np.zeros((len(terms), 0)),
    )  # fmt: skip
    coordinates = [Coordinate("car", f"car-{k}") for k in range(len(terms))]
    coordinates += [Coordinate("fraction", n, values[n], values[n]) for n in fractions]
    start = [0.0] * len(coordinates)
    for k, one in enumerate(space.coordinates):
        if one.kind in ("car", "fraction"):
            continue
        gain = one.kind == "gain"
        coordinates.append(replace(one, scale=1.0) if gain else one)
        start.append(float(z[k]) * (one.scale if gain else 1.0))
    moved_space = replace(space, coordinates=tuple(coordinates), prior=turned)
    return replace(target, space=moved_space), np.array(start)


def jacobian(target: Posterior, z: Array, run: int) -> Array:
    """Relative derivatives of one run's normalised innovations.

    Parameters
    ----------
    target, z : Posterior, (D,) array
        From :func:`in_logs`.
    run : int
        Which run.

    Returns
    -------
    (ny E, P) array
        ∂ν/∂log θ in the order of :func:`parameters`.
    """
    middle = target.innovations(z, run).ravel()
    count = len(parameters(target))
    out = np.zeros((len(middle), count))
    for k in range(count):
        away = np.zeros(count)
        away[k] = _STEP
        out[:, k] = (target.innovations(moved(target, z, away), run).ravel() - middle) / _STEP
    return out


def moved(target: Posterior, z: Array, away: Array) -> Array:
    """Move a point of :func:`in_logs` by relative changes (P,) of :func:`parameters`."""
    car = target.space.car
    fractions = _fractions(car)
    terms = [name for name in _terms(car) if name not in fractions]
    order = (*terms, *fractions, *parameters(target)[len(_terms(car)) :])
    out = z.copy()
    for name, change in zip(parameters(target), away, strict=True):
        out[order.index(name)] += change
    return out


def information(slopes: Sequence[Array]) -> Array:
    """Information (P, P) of all runs from their Jacobians."""
    return np.asarray(np.sum([j.T @ j for j in slopes], axis=0))


def prior_sd(target: Posterior, z: Array) -> Array:
    """Relative prior standard deviation (P,) of each parameter, zero where it is exact.

    Parameters
    ----------
    target, z : Posterior, (D,) array
        In whitened coordinates, at the mode.
    """
    space = target.space
    sd = {term[0]: term[2] for p in space.car.parameters for term in p.terms}
    values = space.values(z[None])
    for name in _fractions(space.car):
        sd[name] /= float(values[name][0])
    sd |= {c.name: c.scale for c in space.coordinates if c.kind == "gain"}
    return np.array([sd[name] for name in parameters(target)])


def answer_slopes(target: Posterior) -> dict[str, Array]:
    """Return derivatives (P,) of the logarithm of each answer by those of :func:`parameters`."""
    car = target.space.car
    known = parameters(target)
    by_name = {p.name: p for p in car.parameters}
    answers = {name: {name: 1.0} for name in car.estimated} | dict(car.ratios)
    out = {}
    for answer, parts in answers.items():
        g = np.zeros(len(known))
        for name, weight in parts.items():
            for term, coefficient, _ in by_name[name].terms:
                g[known.index(term)] += weight * coefficient
        out[answer] = g
    return out
