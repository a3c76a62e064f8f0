"""Power-scaling sensitivity: how much each parameter of interest depends on each prior.

A prior is raised to powers near one by importance weights of the draws.  The sensitivity is the
cumulative Jensen–Shannon distance by which the posterior of a parameter changes, per doubling of
the power; Kallioinen, Paananen, Bürkner & Vehtari, Detecting and diagnosing prior and likelihood
sensitivity with power-scaling, Statistics and Computing 34:57 (2024).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.posterior.parameters import ParameterSpace

__all__ = ["PriorSensitivity", "log_priors", "prior_sensitivity"]

Array = NDArray[np.float64]

_POWERS = (0.99, 1.01)  # powers of the paper, for a derivative at one


class PriorSensitivity(NamedTuple):
    """Sensitivity of the parameters of interest to one prior.

    Parameters
    ----------
    sensitivity : dict of str to float
        Sensitivity by parameter; above 0.05 a parameter depends on the prior.
    pareto_k : float
        Pareto k̂ of the importance weights; above 0.7 the sensitivities are not reliable.
    """

    sensitivity: dict[str, float]
    pareto_k: float


def log_priors(
    space: ParameterSpace, draws: Mapping[str, Array], nuisance: Mapping[str, Array]
) -> dict[str, Array]:
    """Log prior density of each variable at its draws; for positive ones, that of the logarithm.

    Parameters
    ----------
    space : ParameterSpace
        Parameter space with the priors.
    draws, nuisance : mapping of str to array
        Draws of the car's parameters, and of noise levels and biases, SI units.

    Returns
    -------
    dict of str to array
        Log densities with the shape of the draws; variables without a prior are left out.
    """
    half_log_2pi = 0.5 * math.log(2.0 * math.pi)
    out = {}
    for name in space.prior.log_parameters:
        mean, sd = space.log_prior_of(name)
        if name in draws and sd > 0.0:
            u = (np.log(draws[name]) - mean) / sd
            out[name] = -0.5 * u**2 - half_log_2pi - math.log(sd)
    for one in space.coordinates:
        if one.kind == "fraction":
            value = draws[one.name]
        elif one.name in nuisance:
            value = nuisance[one.name]
        else:
            continue
        label = one.name.replace(" ", "_")
        if one.kind == "filtered_share":
            out[label] = np.zeros_like(value)  # uniform
            continue
        linear = one.kind in ("fraction", "clock")
        u = ((value if linear else np.log(value)) - one.centre) / one.scale
        out[label] = -0.5 * u**2 - half_log_2pi - math.log(one.scale)
    return out


def prior_sensitivity(
    log_prior: Mapping[str, Array], answers: Mapping[str, Array]
) -> dict[str, PriorSensitivity]:
    """Sensitivity of every parameter of interest to every prior.

    Parameters
    ----------
    log_prior : mapping of str to (chains, draws) array
        Log prior density at the draws, by prior.
    answers : mapping of str to (chains, draws) array
        Draws of the parameters of interest, by name.
    """
    from arviz_stats.base import array_stats

    out = {}
    for prior, density in log_prior.items():
        logs = [array_stats.power_scale_lw(density, power, axis=(-2, -1)) for power in _POWERS]
        lower, upper = (np.exp(log - log.max()) for log in logs)
        lower, upper = lower / lower.sum(), upper / upper.sum()
        log_ratios = [(power - 1.0) * density.ravel() for power in _POWERS]
        out[prior] = PriorSensitivity(
            {
                name: max(float(array_stats.power_scale_sense(x, lower, upper, *_POWERS)), 0.0)
                for name, x in answers.items()
            },
            max(float(array_stats.psislw(one)[1]) for one in log_ratios),
        )
    return out
