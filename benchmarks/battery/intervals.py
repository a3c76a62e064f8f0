"""Confidence intervals of shares, medians and means of a few cases."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Share", "bootstrap", "count_true"]

Array = NDArray[np.float64]

_Z = 1.959964  # normal quantile of 97.5 %
_DRAWS = 2000
_SEED = 71


@dataclass(frozen=True)
class Share:
    """A share of cases.

    Parameters
    ----------
    hits, of : int
        Counts.
    """

    hits: int
    of: int

    @property
    def share(self) -> float:
        """Share of hits; nan without cases."""
        return self.hits / self.of if self.of else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's (1927) 95 % interval; from 0 to 1 without cases."""
        if self.of == 0:
            return 0.0, 1.0
        n, p = self.of, self.share
        middle = (p + _Z**2 / (2 * n)) / (1.0 + _Z**2 / n)
        half = _Z / (1.0 + _Z**2 / n) * math.sqrt(p * (1.0 - p) / n + _Z**2 / (4 * n * n))
        low = 0.0 if self.hits == 0 else middle - half
        high = 1.0 if self.hits == n else middle + half
        return low, high

    def __add__(self, other: Share) -> Share:
        """Pool both."""
        return Share(self.hits + other.hits, self.of + other.of)


def count_true(truths: Sequence[bool]) -> Share:
    """Count the true values."""
    return Share(sum(truths), len(truths))


def bootstrap(values: Array, statistic: Callable[[Array], Array]) -> tuple[float, float]:
    """95 % interval of a statistic of independent numbers, by 2000 bootstrap draws (seed 71).

    Parameters
    ----------
    values : (n,) array
        One value per case.
    statistic : callable
        From arrays (..., n) to statistics (...).
    """
    rng = np.random.default_rng(_SEED)
    draws = statistic(values[rng.integers(len(values), size=(_DRAWS, len(values)))])
    low, high = np.quantile(draws, [0.025, 0.975])
    return float(low), float(high)
