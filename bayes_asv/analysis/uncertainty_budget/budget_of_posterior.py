"""The width of each answer of a posterior: its error budget, its remedies, its blind spots."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bayes_asv.analysis.uncertainty_budget.budget import (
    Budget,
    Remedy,
    Source,
    answer_slopes,
    impute_lost_readings,
    in_logs,
    information,
    jacobian,
    lost_readings,
    parameters,
    prior_sd,
    sources,
)
from bayes_asv.analysis.uncertainty_budget.undeclared_faults import (
    LinearizedPosterior,
    Shift,
    find_biases,
)
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.posterior.newton import PosteriorMode

__all__ = ["EstimandBudget", "UncertaintyBudget", "find_budget"]

Array = NDArray[np.float64]

_NUDGE = 0.1  # in the logarithm of a variance, for derivatives


@dataclass(frozen=True)
class EstimandBudget:
    """What makes one answer as wide as it is.  All deviations are relative.

    Parameters
    ----------
    sd : float
        Deviation now.
    shares : dict of str to float
        Shares of the variance, adding up to one: a given value by its name, ``prior`` for what
        was believed of c_f, c_r and i, and ``data``.
    noises : dict of str to float
        What ``data`` is made of, by noise; empty where the innovations have a colour, because
        then it is not the sensors' noise that limits.
    exact : dict of str to float
        Deviation if one given value were exact.
    better : dict of str to float
        Deviation if one noise were better (half of a sensor's noise, no steps, nothing missed
        between samples) or no chassis reading were clipped or missing (``lost readings``);
        the noises are left out like ``noises``.
    twice : float
        Deviation with twice the runs.
    remedies : tuple of Remedy
        What would halve the deviation; sources index the parameters, −1 is more runs.
    runs_to_halve : int or None
        Further runs like these that would halve it alone, None where no number would.
    """

    sd: float
    shares: dict[str, float]
    noises: dict[str, float]
    exact: dict[str, float]
    better: dict[str, float]
    twice: float
    remedies: tuple[Remedy, ...]
    runs_to_halve: int | None


@dataclass(frozen=True)
class UncertaintyBudget:
    """Error budget of a posterior.

    Parameters
    ----------
    estimands : dict of str to EstimandBudget
        For c_f, c_r, i and k_g.
    shifts : tuple of Shift
        What undeclared faults would do.
    white : bool
        The innovations had no colour, so that the data's part is the sensors' noise.
    runs : int
        Number of runs it stands on.
    parameters : tuple of str
        What remedies and shifts count: the car's parameters, and ``gain <channel>`` where a
        scale is uncertain.
    given_sd : (P,) array
        Relative deviation of each beforehand; zero where it is exact.
    slopes : dict of str to (P,) array
        Derivatives of the logarithm of each answer by those of the parameters.
    """

    estimands: dict[str, EstimandBudget]
    shifts: tuple[Shift, ...]
    white: bool
    runs: int
    parameters: tuple[str, ...]
    given_sd: Array
    slopes: dict[str, Array] = field(default_factory=dict)

    def by_answer(self, moved: Array) -> dict[str, float]:
        """Relative shift of each answer from those of the parameters (P,)."""
        return {name: float(g @ moved) for name, g in self.slopes.items()}


def find_budget(posterior: Posterior, mode: PosteriorMode, vehicle: Vehicle) -> UncertaintyBudget:
    """Draw up the error budget of each answer.

    Parameters
    ----------
    posterior : Posterior
        The posterior.
    mode : Mode
        Its mode and curvature.
    vehicle : Vehicle
        As given.

    Returns
    -------
    UncertaintyBudget
    """
    runs = range(len(posterior.space.recordings))
    logs, z = in_logs(posterior, mode.z)
    slopes = [jacobian(logs, z, run) for run in runs]
    budget = Budget(prior_sd(posterior, mode.z), information(slopes))
    known = parameters(logs)
    gains = sum(c.kind == "gain" for c in posterior.space.coordinates)
    car = posterior.space.car_dimension + gains
    noise_precision = np.asarray(np.linalg.inv(mode.covariance), np.float64)[car:, car:]
    white = all(colour.order == 0 for colour in posterior.residual_ars)
    noises = sources(logs) if white else []
    nudged = {source.name: _slope(source, logs, z) for source in noises}
    bettered = {
        source.name: _informed(source, logs, z, source.better)
        for source in noises
        if source.better is not None
    }
    if any(lost_readings(recording).any() for recording in logs.space.recordings):
        bettered["lost readings"] = _all(impute_lost_readings(logs, z), z)
    answers = {}
    slopes_of = answer_slopes(logs)
    for name, g in slopes_of.items():
        answers[name] = _answer(
            g, known, posterior.space.car.estimated, budget, nudged, bettered, len(runs)
        )
    shifts = find_biases(LinearizedPosterior(logs, z, slopes, budget, noise_precision), vehicle)
    return UncertaintyBudget(answers, tuple(shifts), white, len(runs), known, budget.sd, slopes_of)


def _informed(source: Source, logs: Posterior, z: Array, factor: float) -> Array:
    """Information (8, 8) of all runs with one noise's variance multiplied."""
    return _all(*source.scaled(logs, z, factor))


def _all(logs: Posterior, z: Array) -> Array:
    return information([jacobian(logs, z, run) for run in range(len(logs.space.recordings))])


def _slope(source: Source, logs: Posterior, z: Array) -> Array:
    """Differentiate the information by the logarithm of one noise's variance."""
    more = _informed(source, logs, z, math.exp(_NUDGE))
    less = _informed(source, logs, z, math.exp(-_NUDGE))
    return np.asarray((more - less) / (2.0 * _NUDGE))


def _answer(
    g: Array,
    known: tuple[str, ...],
    estimated: tuple[str, ...],
    budget: Budget,
    nudged: dict[str, Array],
    bettered: dict[str, Array],
    runs: int,
) -> EstimandBudget:
    """Budget of one answer."""
    names = [name for name in known if name not in estimated]
    given = {n: known.index(n) for n in names if budget.sd[known.index(n)] > 0.0}
    prior, data = budget.shares(g)
    shares = {name: float(prior[k]) for name, k in given.items()}
    shares["prior"] = float(sum(prior[known.index(name)] for name in estimated))
    shares["data"] = data
    alone = budget.halving(g, [-1])
    return EstimandBudget(
        sd=math.sqrt(budget.variance(g)),
        shares=shares,
        noises={name: budget.elasticity(g, slope) for name, slope in nudged.items()},
        exact={n: math.sqrt(budget.variance(g, {k: math.inf})) for n, k in given.items()},
        better={
            name: math.sqrt(Budget(budget.sd, informed).variance(g))
            for name, informed in bettered.items()
        },
        twice=math.sqrt(budget.variance(g, data=2.0)),
        remedies=tuple(budget.halving(g, [*given.values(), -1])),
        runs_to_halve=math.ceil((alone[0].times - 1.0) * runs - 1e-2) if alone else None,
    )
