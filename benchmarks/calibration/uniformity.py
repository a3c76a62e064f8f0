"""Are places uniform?  Simultaneous bands for empirical distribution functions.

Säilynoja, Bürkner & Vehtari (2022), *Graphical test for discrete uniformity and its applications
in goodness-of-fit evaluation and multiple sample comparison*, Statistics and Computing 32, 32:
pointwise binomial intervals, widened until the whole curve stays inside with the wanted
probability.  That probability is computed here exactly, by following the count of places below
each point in turn (a Markov chain of binomials), not by simulation.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import gammaln
from scipy.stats import binom

__all__ = ["bands", "departure", "differences", "histogram_band", "inside", "points", "probability"]

Array = NDArray[np.float64]

_MOST_POINTS = 100
_TINY = 1e-300


def points(count: int) -> Array:
    """Where curves of ``count`` places are compared: at most 100 even steps inside (0, 1)."""
    k = min(count, _MOST_POINTS)
    return np.arange(1, k) / k


def inside(count: int, gamma: float) -> tuple[Array, Array]:
    """Pointwise intervals of the number of places below each point.

    Parameters
    ----------
    count : int
        Number of places.
    gamma : float
        Probability left out at each point, half on either side.

    Returns
    -------
    low, high : (K,) arrays
        Counts inside the interval, ends included.
    """
    at = points(count)
    low, high = binom.ppf(0.5 * gamma, count, at), binom.isf(0.5 * gamma, count, at)
    return np.asarray(low), np.asarray(high)


def probability(count: int, gamma: float) -> float:
    """Probability that the curve of uniform places stays within :func:`inside` at every point."""
    at = points(count)
    low, high = (ends.astype(int) for ends in inside(count, gamma))
    reached, weight = np.zeros(1, int), np.ones(1)
    before = 0.0
    for k, z in enumerate(at):
        share = (z - before) / (1.0 - before)
        now = np.arange(low[k], high[k] + 1)
        weight = _moves(count, reached, now, share).T @ weight
        reached, before = now, float(z)
    return float(weight.sum())


def _moves(count: int, old: NDArray[np.int64], new: NDArray[np.int64], share: float) -> Array:
    """Probabilities (old, new) that counts grow so, each remaining place with one share."""
    left = count - old[:, None]
    grown = new[None, :] - old[:, None]
    ok = (grown >= 0) & (grown <= left)
    g = np.where(ok, grown, 0)
    log_p = gammaln(left + 1) - gammaln(g + 1) - gammaln(left - g + 1)
    log_p = log_p + g * math.log(max(share, _TINY)) + (left - g) * math.log1p(-share)
    return np.where(ok, np.exp(log_p), 0.0)


@lru_cache(maxsize=256)
def _gamma(count: int, alpha: float) -> float:
    """Pointwise level whose bands leave a share alpha of uniform curves out, or a little less.

    Counts are whole numbers, so the probability jumps; the level is taken from its safe side.
    """

    def excess(log_gamma: float) -> float:
        return probability(count, math.exp(log_gamma)) - (1.0 - alpha)

    low, high = math.log(alpha / (4.0 * _MOST_POINTS)), math.log(alpha)
    if excess(high) >= 0.0:
        return alpha
    root = float(brentq(excess, low, high, xtol=1e-3))
    while excess(root) < 0.0:
        root -= 1e-3
    return math.exp(root)


def bands(count: int, alpha: float) -> tuple[Array, Array]:
    """Simultaneous bands (K,) and (K,) of the curve's difference from the diagonal.

    Parameters
    ----------
    count : int
        Number of places.
    alpha : float
        Probability that uniform places leave them anywhere.
    """
    low, high = inside(count, _gamma(count, alpha))
    at = points(count)
    return low / count - at, high / count - at


def differences(places: Array) -> Array:
    """Empirical distribution function of places (N,) less the diagonal, at :func:`points`."""
    at = points(len(places))
    below = np.searchsorted(np.sort(places), at, side="right")
    return np.asarray(below / len(places) - at)


def departure(places: Array) -> float:
    """Probability that uniform places stray as far from the diagonal as these do somewhere.

    The farthest point decides: its pointwise two-sided level sets the bands, and what leaves
    those bands with it is counted.
    """
    n = len(places)
    at = points(n)
    below = np.rint((differences(places) + at) * n)
    level = 2.0 * np.minimum(binom.cdf(below, n, at), binom.sf(below - 1.0, n, at))
    worst = float(np.min(level))
    if worst >= 1.0:
        return 1.0
    # bands just inside which the farthest point no longer lies
    return 1.0 - probability(n, min(worst * (1.0 + 1e-9), 1.0))


def histogram_band(count: int, bins: int, alpha: float) -> tuple[float, float]:
    """Bounds that all bins of uniform places keep within, with probability 1 − alpha at least."""
    share = alpha / bins  # Bonferroni
    low = float(binom.ppf(0.5 * share, count, 1.0 / bins))
    high = float(binom.isf(0.5 * share, count, 1.0 / bins))
    return low, high
