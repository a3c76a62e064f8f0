"""Coverage counted, and what may be concluded from a count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta, binomtest

__all__ = ["LEVELS", "Coverage", "coverage", "holm"]

Array = NDArray[np.float64]

LEVELS = (0.5, 0.8, 0.9, 0.95)
_ROUNDING = 1e-9  # an end of an interval belongs to it


@dataclass(frozen=True)
class Coverage:
    """How often an interval held the truth.

    Parameters
    ----------
    level : float
        What it states.
    hits, runs : int
        How often it did, out of how many.
    """

    level: float
    hits: int
    runs: int

    @property
    def share(self) -> float:
        """Share of runs."""
        return self.hits / self.runs

    @property
    def p(self) -> float:
        """Exact two-sided binomial test of the stated level."""
        return float(binomtest(self.hits, self.runs, self.level).pvalue)

    @property
    def interval(self) -> tuple[float, float]:
        """Jeffreys' 95 % interval of the true coverage (Brown, Cai & DasGupta 2001)."""
        a, b = self.hits + 0.5, self.runs - self.hits + 0.5
        low = 0.0 if self.hits == 0 else float(beta.ppf(0.025, a, b))
        high = 1.0 if self.hits == self.runs else float(beta.ppf(0.975, a, b))
        return low, high


def coverage(places: Array, level: float) -> Coverage:
    """Count equal-tailed intervals that hold the truth.

    Parameters
    ----------
    places : (N,) array
        Posterior probability below the truth, one a run.
    level : float
        Of the interval.
    """
    tail = 0.5 * (1.0 - level) - _ROUNDING
    hits = int(np.count_nonzero((places >= tail) & (places <= 1.0 - tail)))
    return Coverage(level, hits, len(places))


def holm(p: list[float]) -> list[float]:
    """Holm's (1979) adjusted p-values: reject those below the family's level."""
    order = np.argsort(p, kind="stable")
    out = [0.0] * len(p)
    worst = 0.0
    for rank, k in enumerate(order):
        worst = max(worst, min(1.0, (len(p) - rank) * p[k]))
        out[k] = worst
    return out
