"""Uncertainty budget of a posterior: sources, improvements, and biases by undeclared faults."""

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

_NUDGE = 0.1  # step of finite differences in the logarithm of a variance


@dataclass(frozen=True)
class EstimandBudget:
    """Uncertainty budget of one parameter of interest.  All standard deviations are relative.

    Parameters
    ----------
    sd : float
        Standard deviation.
    shares : dict of str to float
        Shares of the variance, which add up to one: given values by name, ``prior`` for the priors
        of c_f, c_r and i, and ``data``.
    noises : dict of str to float
        Division of ``data`` among the noise sources; empty with a residual autoregression, since
        sensor noise is then not the limit.
    exact : dict of str to float
        Standard deviation if one given value were exact.
    better : dict of str to float
        Standard deviation if one noise were smaller (half of a sensor's noise, no quantisation, no
        interpolation error), or if no chassis reading were clipped or missing (``lost readings``);
        the noises are left out with a residual autoregression.
    twice : float
        Standard deviation with twice as many runs.
    remedies : tuple of Remedy
        Improvements that halve the standard deviation; sources index the parameters, −1 is more
        runs.
    runs_to_halve : int or None
        Number of further runs like these that halve it; None if no number does.
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
    """Uncertainty budget of a posterior.

    Parameters
    ----------
    estimands : dict of str to EstimandBudget
        Budgets of the estimated parameters and of the car's ratios, by name.
    shifts : tuple of Shift
        Biases by undeclared faults.
    white : bool
        Whether there is no residual autoregression, so that the share of the data is due to sensor
        noise.
    runs : int
        Number of runs.
    parameters : tuple of str
        Parameters to which remedies and shifts refer: those of the car, and ``gain <channel>`` if a
        scale is uncertain.
    given_sd : (P,) array
        Relative prior standard deviation of each of them; zero if it is exact.
    slopes : dict of str to (P,) array
        Derivatives of the logarithm of each parameter of interest by those of the parameters.
    """

    estimands: dict[str, EstimandBudget]
    shifts: tuple[Shift, ...]
    white: bool
    runs: int
    parameters: tuple[str, ...]
    given_sd: Array
    slopes: dict[str, Array] = field(default_factory=dict)

    def by_parameter(self, moved: Array) -> dict[str, float]:
        """Relative shift of each parameter of interest, given shifts of the parameters (P,)."""
        return {name: float(g @ moved) for name, g in self.slopes.items()}


def find_budget(posterior: Posterior, mode: PosteriorMode, vehicle: Vehicle) -> UncertaintyBudget:
    """Compute the uncertainty budget of each parameter of interest.

    Parameters
    ----------
    posterior : Posterior
        The posterior.
    mode : PosteriorMode
        Its mode and curvature.
    vehicle : Vehicle
        Declared vehicle and sensors.

    Returns
    -------
    UncertaintyBudget
    """
    runs = range(len(posterior.space.recordings))
    logs, z = in_logs(posterior, mode.z)
    slopes = [jacobian(logs, z, run) for run in runs]
    budget = Budget(prior_sd(posterior, mode.z), information(slopes))
    names = parameters(logs)
    gains = sum(c.kind == "gain" for c in posterior.space.coordinates)
    car = posterior.space.car_dimension + gains
    noise_precision = np.asarray(np.linalg.inv(mode.covariance), np.float64)[car:, car:]
    white = all(colour.order == 0 for colour in posterior.residual_ars)
    noises = sources(logs) if white else []
    noise_slopes = {source.name: _information_slope(source, logs, z) for source in noises}
    improved = {
        source.name: _scaled_information(source, logs, z, source.better)
        for source in noises
        if source.better is not None
    }
    if any(lost_readings(recording).any() for recording in logs.space.recordings):
        improved["lost readings"] = _total_information(impute_lost_readings(logs, z), z)
    estimands = {}
    slopes_of = answer_slopes(logs)
    for name, g in slopes_of.items():
        estimands[name] = _estimand_budget(
            g, names, posterior.space.car.estimated, budget, noise_slopes, improved, len(runs)
        )
    shifts = find_biases(LinearizedPosterior(logs, z, slopes, budget, noise_precision), vehicle)
    return UncertaintyBudget(
        estimands, tuple(shifts), white, len(runs), names, budget.sd, slopes_of
    )


def _scaled_information(source: Source, logs: Posterior, z: Array, factor: float) -> Array:
    """Information (P, P) of all runs with the variance of one noise multiplied by a factor."""
    return _total_information(*source.scaled(logs, z, factor))


def _total_information(logs: Posterior, z: Array) -> Array:
    return information([jacobian(logs, z, run) for run in range(len(logs.space.recordings))])


def _information_slope(source: Source, logs: Posterior, z: Array) -> Array:
    """Differentiate the information by the logarithm of one noise's variance."""
    more = _scaled_information(source, logs, z, math.exp(_NUDGE))
    less = _scaled_information(source, logs, z, math.exp(-_NUDGE))
    return np.asarray((more - less) / (2.0 * _NUDGE))


def _estimand_budget(
    g: Array,
    parameter_names: tuple[str, ...],
    estimated: tuple[str, ...],
    budget: Budget,
    noise_slopes: dict[str, Array],
    improved: dict[str, Array],
    runs: int,
) -> EstimandBudget:
    """Budget of one parameter of interest."""
    names = [name for name in parameter_names if name not in estimated]
    given = {
        n: parameter_names.index(n) for n in names if budget.sd[parameter_names.index(n)] > 0.0
    }
    prior, data = budget.shares(g)
    shares = {name: float(prior[k]) for name, k in given.items()}
    shares["prior"] = float(sum(prior[parameter_names.index(name)] for name in estimated))
    shares["data"] = data
    alone = budget.halving(g, [-1])
    return EstimandBudget(
        sd=math.sqrt(budget.variance(g)),
        shares=shares,
        noises={name: budget.elasticity(g, slope) for name, slope in noise_slopes.items()},
        exact={n: math.sqrt(budget.variance(g, {k: math.inf})) for n, k in given.items()},
        better={
            name: math.sqrt(Budget(budget.sd, informed).variance(g))
            for name, informed in improved.items()
        },
        twice=math.sqrt(budget.variance(g, data=2.0)),
        remedies=tuple(budget.halving(g, [*given.values(), -1])),
        runs_to_halve=math.ceil((alone[0].times - 1.0) * runs - 1e-2) if alone else None,
    )
