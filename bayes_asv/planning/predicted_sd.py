"""Predicted posterior standard deviations from the Fisher information and the vehicle's priors.

A drive informs about the logarithms of c/m, k/m, i/(m l²) and of the weight fraction.  The vehicle
file gives each quantity a prior.  In the logarithms of all eight quantities the posterior precision
after n passes is

    P(n) = diag(1/σ²) + n Sᵀ J S,

with J the information of one pass (:mod:`bayes_asv.planning.information`), σ the prior standard
deviations and S the map (ln c − ln m, ln i − ln m − 2 ln l, ln k − ln m, ln w).  Exact quantities
are left out.  With k_g² = i/m, ln k_g is half of ln i − ln m.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.cars import car_model
from bayes_asv.planning.information import IDENTIFIABLE

__all__ = [
    "GIVEN",
    "MAX_PASSES",
    "PARAMETERS",
    "LimitingValues",
    "PriorSd",
    "limiting_values",
    "predicted_sd",
    "prior_sd",
    "required_passes",
    "sd_floors",
]

Array = NDArray[np.float64]

PARAMETERS = ("c_f", "c_r", "i", "k_g")
"""Parameters whose posterior standard deviations are predicted."""

GIVEN = ("m", "l", "wdf", "k_f", "k_r")
"""Given values of the vehicle file."""

MAX_PASSES = 1000
"""Largest number of passes considered."""

_ALL = (*IDENTIFIABLE, "m", "l")


def _ratios() -> Array:
    """Return S (6, 8): the exponents of all quantities in the identifiable ratios."""
    out = np.zeros((len(IDENTIFIABLE), len(_ALL)))
    out[:, : len(IDENTIFIABLE)] = np.eye(len(IDENTIFIABLE))
    for row, name in enumerate(IDENTIFIABLE):
        if name != "wdf":
            out[row, _ALL.index("m")] = -1.0
    out[IDENTIFIABLE.index("i"), _ALL.index("l")] = -2.0
    return out


def _directions() -> Array:
    """Return (4, 8): the logarithm of each parameter in terms of those of all quantities."""
    out = np.zeros((len(PARAMETERS), len(_ALL)))
    for row, name in enumerate(PARAMETERS[:3]):
        out[row, _ALL.index(name)] = 1.0
    out[3, _ALL.index("i")], out[3, _ALL.index("m")] = 0.5, -0.5
    return out


_RATIOS, _DIRECTIONS = _ratios(), _directions()


@dataclass(frozen=True)
class PriorSd:
    """Prior standard deviations of the logarithms.

    Parameters
    ----------
    log_sd : Mapping of str to float
        Of c_f, c_r, i, k_f, k_r, wdf, m and l; zero where a value is exact.
    """

    log_sd: Mapping[str, float]

    def replaced(self, **log_sd: float) -> PriorSd:
        """Return a copy with some standard deviations replaced."""
        return PriorSd({**self.log_sd, **log_sd})

    def with_exact_given(self) -> PriorSd:
        """Return a copy with all given values exact."""
        return self.replaced(**dict.fromkeys(GIVEN, 0.0))


def prior_sd(vehicle: Vehicle) -> PriorSd:
    """Return the prior standard deviations that the estimator uses for a vehicle."""
    parameters = {p.name: p for p in car_model("half", vehicle).parameters}
    log_sd = {
        name: math.sqrt(sum((weight * sd) ** 2 for _, weight, sd in parameters[name].terms))
        for name in _ALL
    }
    log_sd["wdf"] /= parameters["wdf"].nominal  # a fraction's own deviation is absolute
    return PriorSd(log_sd)


def predicted_sd(information: Array, passes: float, prior: PriorSd) -> Array:
    """Predict the relative posterior standard deviations.

    Parameters
    ----------
    information : (6, 6) array
        Of one pass.
    passes : float
        Number of passes.
    prior : PriorSd
        Prior standard deviations.

    Returns
    -------
    (4,) array
        Posterior standard deviation over the value, of :data:`PARAMETERS`.  A standard deviation s
        of the logarithm is √(exp s² − 1) of the value, as for a log-normal.
    """
    sd = np.array([prior.log_sd[name] for name in _ALL])
    free = sd > 0.0
    # in units of the prior deviations, where the prior precision is the unit matrix
    scaled = _RATIOS[:, free] * sd[free]
    precision = np.eye(int(free.sum())) + passes * scaled.T @ information @ scaled
    directions = _DIRECTIONS[:, free] * sd[free]
    variance = np.sum(directions * np.linalg.solve(precision, directions.T).T, axis=1)
    return np.asarray(np.sqrt(np.expm1(np.minimum(variance, 50.0))))


def sd_floors(prior: PriorSd) -> Array:
    """Compute the relative standard deviations (4,) in the limit of infinitely many passes.

    Directions along which all identifiable ratios stay constant keep their prior.  A mass known to
    1 % leaves 1 % in every rate; springs known to 5 % add a little information about the mass.
    """
    sd = np.array([prior.log_sd[name] for name in _ALL])
    free = sd > 0.0
    _, singular, right = np.linalg.svd(_RATIOS[:, free] * sd[free])
    rank = int(np.count_nonzero(singular > 1e-9 * singular[0])) if singular.size else 0
    unidentifiable = (_DIRECTIONS[:, free] * sd[free]) @ right[rank:].T
    variance = np.sum(unidentifiable**2, axis=1)
    variance[variance < 1e-24] = 0.0  # rounding error of an identifiable direction
    return np.asarray(np.sqrt(np.expm1(variance)))


def required_passes(information: Array, prior: PriorSd, want: Array) -> tuple[int | None, ...]:
    """Compute the smallest number of passes that reaches each wanted standard deviation.

    Parameters
    ----------
    information : (6, 6) array
        Of one pass.
    prior : PriorSd
        Prior standard deviations.
    want : (4,) array
        Wanted relative standard deviations.

    Returns
    -------
    tuple of 4 int or None
        None where :data:`MAX_PASSES` passes do not suffice.
    """
    passes: list[int | None] = []
    for k in range(len(PARAMETERS)):

        def enough(n: int, k: int = k) -> bool:
            return bool(predicted_sd(information, n, prior)[k] <= want[k])

        if not enough(MAX_PASSES):
            passes.append(None)
            continue
        low, high = 0, 1  # low never suffices, unless the prior does
        while not enough(high):
            low, high = high, min(2 * high, MAX_PASSES)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if enough(middle) else (middle, high)
        passes.append(high)
    return tuple(passes)


_MIN_GAIN = 0.02  # relative gain of an exact given value below which it is not reported
_SMALLEST_SD = 1e-4  # relative standard deviation that no scale improves on


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
    information: Array, passes: int, prior: PriorSd, parameter: str, want: float
) -> LimitingValues | None:
    """Find the given values whose uncertainty limits one parameter.

    Parameters
    ----------
    information : (6, 6) array
        Of one pass.
    passes : int
        Largest acceptable number of passes.
    prior : PriorSd
        Prior standard deviations.
    parameter : str
        One of :data:`PARAMETERS`.
    want : float
        Wanted relative standard deviation.

    Returns
    -------
    LimitingValues or None
        None if the parameter reaches the wanted value.  If improving one given value suffices, the
        one that has to improve least; otherwise all that matter, each by the same factor.
    """
    index = PARAMETERS.index(parameter)

    def sd_with(changed: PriorSd) -> float:
        return float(predicted_sd(information, passes, changed)[index])

    current = sd_with(prior)
    if current <= want:
        return None
    if sd_with(prior.with_exact_given()) > want:
        return LimitingValues(parameter, {})
    relevant = [
        name
        for name in GIVEN
        if prior.log_sd[name] > 0.0
        and sd_with(prior.replaced(**{name: 0.0})) < (1.0 - _MIN_GAIN) * current
    ]
    alone = {}
    for name in relevant:
        factor = _largest_factor(sd_with, prior, (name,), want)
        if factor > 0.0:
            alone[name] = factor
    if alone:
        best = max(alone, key=lambda name: alone[name])
        return LimitingValues(parameter, {best: alone[best] * prior.log_sd[best]})
    every = tuple(name for name in GIVEN if prior.log_sd[name] > 0.0)
    factor = _largest_factor(sd_with, prior, every, want)
    return LimitingValues(
        parameter, {name: factor * prior.log_sd[name] for name in relevant or every}
    )


def _largest_factor(
    sd_with: Callable[[PriorSd], float], prior: PriorSd, names: tuple[str, ...], want: float
) -> float:
    """Find the largest factor on these prior deviations that reaches `want`; 0 if none does."""

    def sd_at(factor: float) -> float:
        return sd_with(prior.replaced(**{n: factor * prior.log_sd[n] for n in names}))

    least = _SMALLEST_SD / max(prior.log_sd[n] for n in names)
    if least >= 1.0 or sd_at(least) > want:
        return 0.0
    low, high = math.log(least), 0.0  # low suffices, high does not
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if sd_at(math.exp(middle)) <= want else (low, middle)
    return math.exp(low)
