"""Changes between two sessions of one car: their joint posterior, and hypotheses about it.

Each session was estimated alone.  Its posterior, divided by the prior, is a Gaussian likelihood
over the coordinates y_s of its car and of the scales of its sensors, all of which are standard
normal a priori.  Both sessions together are one linear Gaussian model ::

    y_before = M₁ x          y_after = o + M₂ x + B u          x ~ N(0, I)

x contains the unknowns of both: the values of c_f, c_r, i, … before, and the errors of the given
values and of the scales of the sensors.  An error that both sessions share, because the same value
is given for both, is one unknown; a value that was changed on purpose has one unknown per session,
and the offset o is the difference between the two given values.  u are the changes of the
logarithms of c_f, c_r, i.  Integrating x out leaves a Gaussian likelihood of u alone,
exp(ηᵀu − ½ uᵀΛu).  If the likelihood of each session is normal, the result is the same as that of
sampling both sessions together.

**Hypotheses.**  Each parameter is independently unchanged with probability :data:`UNCHANGED`,
u_k = 0, and otherwise u_k ~ N(0, ω²) with ω = :data:`CHANGE_SD`.  A set S of parameters that
changed has the evidence ::

    p(data | S) ∝ |I + ω² Λ_SS|^(−½) exp ½ η_Sᵀ (Λ_SS + ω⁻² I)⁻¹ η_S

and given S, u_S is normal.  Sums over all sets give the probabilities of a change, a decrease and
an increase.  This is the spike-and-slab prior of Mitchell & Beauchamp (1988).
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
    MIN_INFORMATION,
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
"""Prior probability that a parameter did not change, independently for each one."""


@dataclass(frozen=True)
class Session:
    """Joint likelihood of the runs of one session.

    Parameters
    ----------
    space : ParameterSpace
        Coordinates of the car and their prior.
    gains : mapping of str to tuple
        For each channel with an uncertain scale, in the order of the coordinates, the declaration
        of its sensor.
    likelihood : RunLikelihood
        Gaussian likelihood over the coordinates of the car and of those scales.
    """

    space: ParameterSpace
    gains: Mapping[str, tuple[object, ...]]
    likelihood: RunLikelihood


def session(
    space: ParameterSpace, vehicle: Vehicle, car: Array, gains: Mapping[str, Array]
) -> Session:
    """Convert the posterior of one session to a likelihood.

    Parameters
    ----------
    space : ParameterSpace
        Parameter space of the session.
    vehicle : Vehicle
        The car with its sensors.
    car : (N, n) array
        Draws of the coordinates of the car.
    gains : mapping of str to (N,) array
        Corresponding draws of the scales of sensors, by the name of their coordinate; missing ones
        are unknowns of this session alone.
    """
    uncertain_gains = [one for one in space.coordinates if one.kind == "gain" and one.name in gains]
    gain_coordinates = [
        (np.log(gains[one.name]) - one.centre) / one.scale for one in uncertain_gains
    ]
    z = np.column_stack([car, *gain_coordinates])
    covariance = np.cov(z, rowvar=False).reshape(2 * z.shape[1:])
    return Session(
        space,
        {
            one.channel: (vehicle.sensor(one.channel), one.centre, one.scale)
            for one in uncertain_gains
        },
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
        Mean and standard deviation of u if all parameters changed.
    lower, higher : (p,) arrays
        Probabilities that a parameter decreased, or increased; the remaining probability is that it
        did not change.
    nothing : float
        Probability that no parameter changed.
    p_values : (p,) array
        p-values of the test that one parameter is the same, with the others free to differ; nan if
        the recordings do not determine it.
    p_value : float
        p-value of the test that all parameters are the same; nan if none is determined.
    rest : HomogeneityTest
        Test that all other shared unknowns are the same: given values and scales.
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
        Sessions of the same car model; values that both vehicle files give alike are shared.
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
    changed = sds > 0.0
    below = np.where(changed, ndtr(-means / np.where(changed, sds, 1.0)), 0.0)
    p_values, p_value = _tests(precision, linear)
    return SessionChanges(
        names, means[-1], sds[-1], weight @ below, weight @ (changed - below), float(weight[0]),
        p_values, p_value, rest,
    )  # fmt: skip


def _tests(precision: Array, linear: Array) -> tuple[Array, float]:
    """p-values of likelihood-ratio tests of u_k = 0, one by one and all together."""
    eigen, vectors = np.linalg.eigh(precision)
    informative = eigen > MIN_INFORMATION / CHANGE_SD**2
    if not np.any(informative):
        return np.full(len(linear), np.nan), math.nan
    square = (vectors.T @ linear)[informative] ** 2 / eigen[informative]
    p_all = float(gammaincc(0.5 * np.count_nonzero(informative), 0.5 * square.sum()))
    covariance = (vectors / np.maximum(eigen, 1e-12 * eigen[-1])) @ vectors.T
    variance = np.diag(covariance)
    determined = variance < CHANGE_SD**2 / MIN_INFORMATION
    z = np.where(determined, covariance @ linear, np.nan) / np.sqrt(variance)
    return np.asarray(2.0 * ndtr(-np.abs(z))), p_all


class ChangeLikelihood(NamedTuple):
    """Gaussian likelihood exp(ηᵀu − ½ uᵀΛu) of the changes of p parameters.

    Parameters
    ----------
    names : tuple of str
        Parameters that are estimated in both sessions.
    precision, linear : (p, p) and (p,) arrays
        Λ and η.
    rest : HomogeneityTest
        Test of the shared unknowns, with the parameters free to differ.
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
    separate, rank = 0.0, 0
    for one, slopes_by in zip((before, after), rows, strict=True):
        M = np.zeros((len(one.likelihood.linear), len(columns)))
        offset = np.zeros(len(M))
        for key, slopes in slopes_by.items():
            M[:, columns[key]] = slopes
        for name in names if one is after else ():
            # the parameter is the value before, plus the change
            (mean, sd), (first, first_sd) = (of.space.log_prior_of(name) for of in (after, before))
            slopes = slopes_by["value", name] / sd
            M[:, columns["change", name]] = slopes
            M[:, columns["value", name]] = slopes * first_sd
            offset += slopes * (first - mean)
        H, h = one.likelihood.around(offset)
        inverse, found_rank = pseudo_inverse(H)
        separate += float(h @ inverse @ h)
        rank += found_rank
        precision += M.T @ H @ M
        linear += M.T @ h
    inverse, found_rank = pseudo_inverse(precision)
    rest = HomogeneityTest(separate - float(linear @ inverse @ linear), rank - found_rank)
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

    An unknown that both sessions share has the same key in both.
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
    other_parameters = {p.name: p for p in other.space.car.parameters}
    for k, coordinate in enumerate(space.coordinates[: space.car_dimension]):
        if coordinate.kind == "fraction":
            parameter = next(p for p in space.car.parameters if p.name == coordinate.name)
            shared = () if parameter == other_parameters.get(parameter.name) else (number,)
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
