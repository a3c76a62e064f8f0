"""The posterior of one parameter, as numbers with a unit."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.units import display_units, from_si

__all__ = ["Parameter", "from_draws", "from_log_normal"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Parameter:
    """Posterior of one parameter.

    Parameters
    ----------
    name, label : str
        Such as ``c_f`` and ``front damping rate``.
    unit : str
        Of all values; empty for a number without a unit.
    mean, median, sd : float
        Of the posterior.
    nominal : float
        Value of the vehicle file.
    probability_below_nominal : float
        That the parameter is below nominal.  Where an estimate reports mistakes of nominal damping
        that would explain the same, it counts them.
    draws : (N,) array or None
        Equally weighted draws; None where the posterior is known by its moments alone.
    """

    name: str
    label: str
    unit: str
    mean: float
    median: float
    sd: float
    nominal: float
    probability_below_nominal: float
    draws: Array | None = field(repr=False, compare=False)
    _quantile: Callable[[float], float] = field(repr=False, compare=False)

    def interval(self, probability: float = 0.95) -> tuple[float, float]:
        """Return the equal-tailed interval that holds the parameter with a probability.

        Parameters
        ----------
        probability : float
            Between 0 and 1.

        Returns
        -------
        low, high : float
            With ``(1 - probability) / 2`` of the posterior below and above.
        """
        if not 0.0 < probability < 1.0:
            raise InputError(
                f"interval({probability!r})", "is not a probability", "write interval(0.95)"
            )
        tail = 0.5 * (1.0 - probability)
        return self._quantile(tail), self._quantile(1.0 - tail)

    def to(self, units: str) -> Parameter:
        """Return the same posterior in other units.

        Parameters
        ----------
        units : str
            ``"SI"``, ``"US"``, or a unit of the same dimension, such as ``"N*s/m"``.

        Raises
        ------
        InputError
            If the unit is unknown or of another dimension.
        """
        dimension = QUANTITIES[self.name][0]
        unit = display_units(units)[dimension] if units in ("SI", "US") else units
        factor = from_si(1.0, unit, dimension) / from_si(1.0, self.unit, dimension)
        return self._scaled(factor, unit)

    def _scaled(self, factor: float, unit: str) -> Parameter:
        quantile = self._quantile
        return replace(
            self,
            unit=unit,
            mean=factor * self.mean,
            median=factor * self.median,
            sd=factor * self.sd,
            nominal=factor * self.nominal,
            draws=None if self.draws is None else factor * self.draws,
            _quantile=lambda p: factor * quantile(p),
        )

    def __repr__(self) -> str:
        low, high = self.interval()
        return (
            f"<{self.name}: {self.mean:.4g} {self.unit}".rstrip()
            + f", 95 %: {low:.4g} to {high:.4g}, nominal {self.nominal:.4g}>"
        )


def from_draws(
    name: str,
    draws: Array,
    nominal: float,
    units: str,
    weights: Array | None = None,
    below: float | None = None,
) -> Parameter:
    """Summarise draws of a parameter.

    Parameters
    ----------
    name : str
        One of :data:`bayes_asv.domain.quantities.QUANTITIES`.
    draws : (N,) array
        SI units.
    nominal : float
        SI units.
    units : {'SI', 'US'}
        System of units of the result.
    weights : (N,) array, optional
        Of the draws, summing to one; equal by default.
    below : float, optional
        Probability that it is below nominal; by default the share of the draws.
    """
    x = np.asarray(draws, dtype=float).ravel()
    if weights is None:
        mean, sd, share = float(x.mean()), float(x.std(ddof=1)), float(np.mean(x < nominal))
        kept = x

        def quantile(p: float) -> float:
            return float(np.quantile(x, p))
    else:
        order = np.argsort(x)
        above = np.cumsum(weights[order])
        middle = (above - 0.5 * weights[order]) / above[-1]
        mean = float(weights @ x)
        sd = float(np.sqrt(weights @ (x - mean) ** 2))
        share = float(weights @ (x < nominal))
        # systematic resampling in the order of the draws, so that parameters stay paired
        places = (np.arange(len(x)) + 0.5) / len(x)
        kept = x[np.searchsorted(np.cumsum(weights) / weights.sum(), places)]

        def quantile(p: float) -> float:
            return float(np.interp(p, middle, x[order]))

    si = Parameter(
        name, QUANTITIES[name][1], display_units("SI")[QUANTITIES[name][0]], mean, quantile(0.5),
        sd, nominal, share if below is None else below, kept, quantile,
    )  # fmt: skip
    return si.to(units)


def from_log_normal(
    name: str, median: float, log_sd: float, nominal: float, units: str, below: float
) -> Parameter:
    """Return a parameter with a log-normal posterior.

    Parameters
    ----------
    name : str
        One of :data:`bayes_asv.domain.quantities.QUANTITIES`.
    median, nominal : float
        SI units.
    log_sd : float
        Standard deviation of the logarithm.
    units : {'SI', 'US'}
        System of units of the result.
    below : float
        Probability that it is below nominal.
    """
    normal = NormalDist()

    def quantile(p: float) -> float:
        return median * math.exp(log_sd * normal.inv_cdf(p))

    mean = median * math.exp(0.5 * log_sd**2)
    si = Parameter(
        name, QUANTITIES[name][1], display_units("SI")[QUANTITIES[name][0]], mean, median,
        mean * math.sqrt(math.expm1(log_sd**2)), nominal, below, None, quantile,
    )  # fmt: skip
    return si.to(units)
