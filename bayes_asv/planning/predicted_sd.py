"""Predicted posterior standard deviations of a plan, and what limits them.

They follow from the Fisher information of one pass and the priors of the vehicle file
(:mod:`bayes_asv.posterior.information`), relative to the values: a standard deviation s of the
logarithm is √(exp s² − 1) of the value, as for a log-normal.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.posterior import information as fisher
from bayes_asv.posterior.information import ParameterPrior

__all__ = [
    "MAX_PASSES",
    "LimitingValues",
    "limiting_values",
    "predicted_sd",
    "required_passes",
    "sd_floors",
]

Array = NDArray[np.float64]

MAX_PASSES = 1000
"""Largest number of passes considered."""


def _relative(log_sd: Mapping[str, float]) -> dict[str, float]:
    return {name: math.sqrt(math.expm1(min(sd**2, 50.0))) for name, sd in log_sd.items()}


def predicted_sd(
    information: Array, passes: float, parameter_prior: ParameterPrior
) -> dict[str, float]:
    """Predict the relative posterior standard deviation of every parameter of interest.

    Parameters
    ----------
    information : (nT, nT) array
        Fisher information of one pass.
    passes : float
        Number of passes.
    parameter_prior : ParameterPrior
        Parameters with their prior standard deviations.
    """
    return _relative(
        fisher.predicted_sd(information, passes, parameter_prior, parameter_prior.estimands)
    )


def sd_floors(parameter_prior: ParameterPrior) -> dict[str, float]:
    """Compute the relative standard deviations in the limit of infinitely many passes."""
    return _relative(fisher.sd_floor(parameter_prior, parameter_prior.estimands))


def required_passes(
    information: Array, parameter_prior: ParameterPrior, want: Mapping[str, float]
) -> dict[str, int | None]:
    """Compute the smallest number of passes that reaches each wanted standard deviation.

    Parameters
    ----------
    information : (nT, nT) array
        Fisher information of one pass.
    parameter_prior : ParameterPrior
        Parameters with their prior standard deviations.
    want : mapping of str to float
        Wanted relative standard deviation of each parameter of interest.

    Returns
    -------
    dict of str to int or None
        None where :data:`MAX_PASSES` passes do not suffice.
    """
    passes: dict[str, int | None] = {}
    for name in parameter_prior.estimands:

        def enough(n: int, name: str = name) -> bool:
            return predicted_sd(information, n, parameter_prior)[name] <= want[name]

        if not enough(MAX_PASSES):
            passes[name] = None
            continue
        low, high = 0, 1  # low never suffices, unless the prior does
        while not enough(high):
            low, high = high, min(2 * high, MAX_PASSES)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if enough(middle) else (middle, high)
        passes[name] = high
    return passes


_MIN_GAIN = 0.02  # relative gain of an exact given value below which it is not reported
_SMALLEST_SD = 1e-4  # least relative standard deviation to require of a given value


class LimitingValues(NamedTuple):
    """Given values that limit one parameter.

    Parameters
    ----------
    parameter : str
        The parameter whose standard deviation stays too large.
    required_sd : dict of str to float
        Relative standard deviation that each of these given values needs; empty when even exact
        given values would not suffice.
    """

    parameter: str
    required_sd: dict[str, float]


def limiting_values(
    information: Array, passes: int, prior: ParameterPrior, parameter: str, want: float
) -> LimitingValues | None:
    """Find the given values whose uncertainty limits one parameter.

    Parameters
    ----------
    information : (nT, nT) array
        Fisher information of one pass.
    passes : int
        Largest acceptable number of passes.
    prior : ParameterPrior
        Parameters with their prior standard deviations.
    parameter : str
        A parameter of interest.
    want : float
        Wanted relative standard deviation.

    Returns
    -------
    LimitingValues or None
        None if the parameter reaches the wanted value.  If improving one given value suffices, the
        one that has to improve least; otherwise all that matter, each by the same factor.
    """

    def sd_with(changed: ParameterPrior) -> float:
        return predicted_sd(information, passes, changed)[parameter]

    current = sd_with(prior)
    if current <= want:
        return None
    if sd_with(prior.with_exact_given()) > want:
        return LimitingValues(parameter, {})
    relevant = [
        name
        for name in prior.given
        if prior.sd(name) > 0.0
        and sd_with(prior.replaced({name: 0.0})) < (1.0 - _MIN_GAIN) * current
    ]
    single_factors = {}
    for name in relevant:
        factor = _largest_factor(sd_with, prior, (name,), want)
        if factor > 0.0:
            single_factors[name] = factor
    if single_factors:
        best = max(single_factors, key=lambda name: single_factors[name])
        return LimitingValues(parameter, {best: single_factors[best] * prior.sd(best)})
    uncertain = tuple(name for name in prior.given if prior.sd(name) > 0.0)
    factor = _largest_factor(sd_with, prior, uncertain, want)
    return LimitingValues(
        parameter, {name: factor * prior.sd(name) for name in relevant or uncertain}
    )


def _largest_factor(
    sd_with: Callable[[ParameterPrior], float],
    prior: ParameterPrior,
    names: tuple[str, ...],
    want: float,
) -> float:
    """Find the largest factor on these prior deviations that reaches `want`; 0 if none does."""

    def sd_at(factor: float) -> float:
        return sd_with(prior.replaced({n: factor * prior.sd(n) for n in names}))

    least = _SMALLEST_SD / max(prior.sd(n) for n in names)
    if least >= 1.0 or sd_at(least) > want:
        return 0.0
    low, high = math.log(least), 0.0  # low suffices, high does not
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if sd_at(math.exp(middle)) <= want else (low, middle)
    return math.exp(low)
