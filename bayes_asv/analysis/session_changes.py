"""What changed between two sessions of one car: the joint posterior of both, and its hypotheses.

Each session was estimated by itself.  Its posterior, with the prior taken out, is a Gaussian
likelihood over the coordinates y_s of its car and of the scales of its sensors, all of which are
standard normal a priori.  Both sessions together are one linear Gaussian model ::

    y_before = M₁ x          y_after = o + M₂ x + B u          x ~ N(0, I)

x holds the unknowns of both: the values of c_f, c_r, i, … before, and the errors of the given
values and of the scales of the sensors.  An error that both sessions have, because the same value
is given for both, is one unknown; a value that was changed on purpose has one unknown a session,
and the offset o says how far the two given values are apart.  u are the changes of the logarithms
of c_f, c_r, i.  Integrating x out leaves a Gaussian likelihood of u alone, exp(ηᵀu − ½ uᵀΛu), which
is that of sampling both sessions together as far as each session's likelihood is normal.

**Hypotheses.**  Every parameter is by itself unchanged with probability :data:`UNCHANGED`, u_k = 0,
and otherwise u_k ~ N(0, ω²) with ω = :data:`CHANGE_SD`.  A set S of parameters that changed has the
evidence ::

    p(data | S) ∝ |I + ω² Λ_SS|^(−½) exp ½ η_Sᵀ (Λ_SS + ω⁻² I)⁻¹ η_S

and given S, u_S is normal.  The sums over all sets are the probabilities of a change, of a fall and
of a rise.  This is the spike-and-slab prior of Mitchell & Beauchamp (1988).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc, ndtr

from bayes_asv.analysis.random_effects import (
    SAME,
    HomogeneityTest,
    RunLikelihood,
    likelihood_of_run,
    pseudo_inverse,
)
from bayes_asv.analysis.trends import CHANGE_SD
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.car_model import CarModel
from bayes_asv.posterior.parameters import ParameterSpace

__all__ = ["CHANGE_SD", "UNCHANGED", "Session", "SessionChanges", "session", "session_changes"]

Array = NDArray[np.float64]

UNCHANGED = SAME
"""Prior probability that a parameter is the same after as before, for each by itself."""

_NOTHING_KNOWN = 0.1
"""Information about a change, in that of its prior, below which its test is not computed."""


@dataclass(frozen=True)
class Session:
    """What the runs of one session say together.

    Parameters
    ----------
    space : ParameterSpace
        Coordinates of the car and their prior.
    gains : mapping of str to tuple
        Channels whose scale is uncertain, in the order of the coordinates: everything that is
        declared of each sensor.
    likelihood : RunLikelihood
        Over the coordinates of the car and of those scales.
    """

    space: ParameterSpace
    gains: Mapping[str, tuple[object, ...]]
    likelihood: RunLikelihood


def session(
    space: ParameterSpace, vehicle: Vehicle, car: Array, gains: Mapping[str, Array]
) -> Session:
    """Summarise the posterior of one session, without its prior.

    Parameters
    ----------
    space : ParameterSpace
        Of the session.
    vehicle : Vehicle
        The car with its sensors.
    car : (N, n) array
        Draws of the coordinates of the car.
    gains : mapping of str to (N,) array
        The same of the scales of sensors, by the name of their coordinate; those that are missing
        are unknowns of this session alone.
    """
    known = [one for one in space.coordinates if one.kind == "gain" and one.name in gains]
    own = [(np.log(gains[one.name]) - one.centre) / one.scale for one in known]
    z = np.column_stack([car, *own])
    covariance = np.cov(z, rowvar=False).reshape(2 * z.shape[1:])
    return Session(
        space,
        {one.channel: (vehicle.sensor(one.channel), one.centre, one.scale) for one in known},
        likelihood_of_run(z.mean(axis=0), covariance),
    )


@dataclass(frozen=True)
class SessionChanges:
    """Posterior of the changes u of the logarithms of p parameters.

    Parameters
    ----------
    names : tuple of str
        The parameters.
    mean, sd : (p,) arrays
        Moments of u if all of them changed.
    lower, higher : (p,) arrays
        Probabilities that a parameter changed and is lower, or higher, after; what is left is the
        probability that it did not change.
    nothing : float
        Probability that none of them changed.
    p_values : (p,) array
        Of the test that one parameter is the same, with the others free to differ; nan where the
        recordings do not show it.
    p_value : float
        Of the test that all are the same; nan where the recordings show none.
    rest : Contrast
        Test that everything else that both sessions share is the same: given values and scales.
    """

    names: tuple[str, ...]
    mean: Array
    sd: Array
    lower: Array
    higher: Array
    nothing: float
    p_values: Array
    p_value: float
    rest: HomogeneityTest


def session_changes(before: Session, after: Session) -> SessionChanges:
    """Find what changed between two sessions.

    Parameters
    ----------
    before, after : Session
        Of the same model of a car; whatever both vehicles give alike is the same in both.
    """
    names, precision, linear, rest = likelihood_of_changes(before, after)
    count, ω2 = len(names), CHANGE_SD**2
    sets = [np.flatnonzero(one) for one in product((False, True), repeat=count)]
    log_evidence = np.empty(len(sets))
    means, sds = np.zeros((len(sets), count)), np.zeros((len(sets), count))
    for n, S in enumerate(sets):
        inner = precision[np.ix_(S, S)]
        covariance = np.linalg.inv(inner + np.eye(len(S)) / ω2)
        mean = covariance @ linear[S]
        means[n, S], sds[n, S] = mean, np.sqrt(np.diag(covariance))
        size = np.linalg.slogdet(np.eye(len(S)) + ω2 * inner)[1]
        prior = len(S) * math.log(1.0 - UNCHANGED) + (count - len(S)) * math.log(UNCHANGED)
        log_evidence[n] = prior - 0.5 * size + 0.5 * float(linear[S] @ mean)
    weight = np.exp(log_evidence - log_evidence.max())
    weight /= weight.sum()
    there = sds > 0.0
    below = np.where(there, ndtr(-means / np.where(there, sds, 1.0)), 0.0)
    p_values, p_value = _tests(precision, linear)
    return SessionChanges(
        names, means[-1], sds[-1], weight @ below, weight @ (there - below), float(weight[0]),
        p_values, p_value, rest,
    )  # fmt: skip


def _tests(precision: Array, linear: Array) -> tuple[Array, float]:
    """p-values of likelihood-ratio tests of u_k = 0, one by one and all together."""
    eigen, vectors = np.linalg.eigh(precision)
    seen = eigen > _NOTHING_KNOWN / CHANGE_SD**2
    if not np.any(seen):
        return np.full(len(linear), np.nan), math.nan
    square = (vectors.T @ linear)[seen] ** 2 / eigen[seen]
    whole = float(gammaincc(0.5 * np.count_nonzero(seen), 0.5 * square.sum()))
    covariance = (vectors / np.maximum(eigen, 1e-12 * eigen[-1])) @ vectors.T
    variance = np.diag(covariance)
    known = variance < CHANGE_SD**2 / _NOTHING_KNOWN
    z = np.where(known, covariance @ linear, np.nan) / np.sqrt(variance)
    return np.asarray(2.0 * ndtr(-np.abs(z))), whole


class ChangeLikelihood(NamedTuple):
    """Gaussian likelihood exp(ηᵀu − ½ uᵀΛu) of the changes of p parameters.

    Parameters
    ----------
    names : tuple of str
        Parameters that are estimated in both sessions.
    precision, linear : (p, p) and (p,) arrays
        Λ and η.
    rest : Contrast
        Test of what both share, with the parameters free to differ.
    """

    names: tuple[str, ...]
    precision: Array
    linear: Array
    rest: HomogeneityTest


def likelihood_of_changes(before: Session, after: Session) -> ChangeLikelihood:
    """Integrate out everything but the changes."""
    rows = [_derivatives(before, 0, after), _derivatives(after, 1, before)]
    names = tuple(
        name for name in before.space.car.estimated if all(("value", name) in r for r in rows)
    )
    keys = dict.fromkeys(key for r in rows for key in r)
    columns = {key: n for n, key in enumerate([*keys, *(("change", name) for name in names)])}
    changes, others = np.arange(len(keys), len(columns)), np.arange(len(keys))
    precision, linear = np.zeros(2 * (len(columns),)), np.zeros(len(columns))
    apart, rank = 0.0, 0
    for one, slopes_by in zip((before, after), rows, strict=True):
        M = np.zeros((len(one.likelihood.linear), len(columns)))
        offset = np.zeros(len(M))
        for key, slopes in slopes_by.items():
            M[:, columns[key]] = slopes
        for name in names if one is after else ():
            # The value of the parameter is that before, and the change comes on top.
            (mean, sd), (first, first_sd) = (of.space.log_prior_of(name) for of in (after, before))
            slopes = slopes_by["value", name] / sd
            M[:, columns["change", name]] = slopes
            M[:, columns["value", name]] = slopes * first_sd
            offset += slopes * (first - mean)
        H, h = one.likelihood.around(offset)
        inverse, found = pseudo_inverse(H)
        apart += float(h @ inverse @ h)
        rank += found
        precision += M.T @ H @ M
        linear += M.T @ h
    inverse, found = pseudo_inverse(precision)
    rest = HomogeneityTest(apart - float(linear @ inverse @ linear), rank - found)
    whole = precision[np.ix_(others, others)] + np.eye(len(others))
    cross = precision[np.ix_(changes, others)]
    solved = np.linalg.solve(whole, np.column_stack([cross.T, linear[others]]))
    return ChangeLikelihood(
        names,
        precision[np.ix_(changes, changes)] - cross @ solved[:, :-1],
        linear[changes] - cross @ solved[:, -1],
        rest,
    )


Key = tuple[object, ...]


def _derivatives(one: Session, number: int, other: Session) -> dict[Key, Array]:
    """Differentiate the coordinates of a session by the unknowns, standard normal a priori.

    The key of an unknown is the same in both sessions where it is one unknown.
    """
    space, n = one.space, len(one.likelihood.linear)
    terms, others = _terms(space.car), _terms(other.space.car)
    identified = space.prior.identified
    out: dict[Key, Array] = {}
    for row, (term, use) in enumerate(terms.items()):
        slopes = np.zeros(n)
        slopes[: identified.shape[1]] = identified[row]
        estimated = term in space.car.estimated
        shared = () if use == others.get(term) else (number,)
        out[("value", term) if estimated else ("given", term, *shared)] = slopes
    alone = {p.name: p for p in other.space.car.parameters}
    for k, coordinate in enumerate(space.coordinates[: space.car_dimension]):
        if coordinate.kind == "fraction":
            mine = next(p for p in space.car.parameters if p.name == coordinate.name)
            shared = () if mine == alone.get(mine.name) else (number,)
            out["given", coordinate.name, *shared] = np.eye(n)[k]
    for k, (channel, sensor) in enumerate(one.gains.items()):
        shared = () if sensor == other.gains.get(channel) else (number,)
        out["scale", channel, *shared] = np.eye(n)[space.car_dimension + k]
    return out


def _terms(car: CarModel) -> dict[str, tuple[tuple[str, float, float, float], ...]]:
    """Unknowns of a car in the order of its prior, with all parameters that depend on each."""
    uses: dict[str, list[tuple[str, float, float, float]]] = {}
    for p in car.parameters:
        if p.kind == "fraction" or p.nominal == 0.0:
            continue
        for term, coefficient, sd in p.terms:
            if sd > 0.0:
                uses.setdefault(term, []).append((p.name, p.nominal, coefficient, sd))
    return {term: tuple(uses[term]) for term in sorted(uses)}
