"""Importance sampling with proposals that are shaped like the posterior.

If a posterior is nearly normal, weighted draws are as good as those of a Markov chain, and faster.
The distribution of the weights shows when they cannot be trusted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import chi2, qmc

from bayes_asv.posterior.newton import PosteriorMode

__all__ = [
    "DEGREES_OF_FREEDOM", "INFLATION", "Density", "Proposal", "WeightedDraws", "importance_sample",
]  # fmt: skip

Array = NDArray[np.float64]

DEGREES_OF_FREEDOM = 20.0  # of the Student t; its tails are a little wider than a normal's


class Proposal:
    """Independence proposal: a multivariate t with its own skew in each coordinate.

    A point z maps to y = (z − m)/s, with one scale s left of m and another one right of it; y has a
    Student t distribution with the given covariance.  Callable as emcee's MHMove requires.
    """

    def __init__(self, middle: Array, left: Array, right: Array, covariance: Array) -> None:
        self.middle, self.left, self.right = middle, left, right
        self.root = np.linalg.cholesky(covariance)
        self.inverse = np.linalg.inv(self.root)
        d = len(middle)
        self._log_constant = (
            math.lgamma(0.5 * (DEGREES_OF_FREEDOM + d))
            - math.lgamma(0.5 * DEGREES_OF_FREEDOM)
            - 0.5 * d * math.log(DEGREES_OF_FREEDOM * math.pi)
            - float(np.sum(np.log(np.diag(self.root))))
        )

    @classmethod
    def around(cls, mode: PosteriorMode, inflation: float) -> Proposal:
        """Create a proposal from the curvature at the mode."""
        sd = mode.sd
        return cls(mode.z, sd, sd, inflation * mode.covariance / np.outer(sd, sd))

    @classmethod
    def through(cls, points: Array, inflation: float, weight: Array | None = None) -> Proposal:
        """Create a proposal from draws (N, D) with weights (N,) that sum to one, or equal ones."""
        # Scales come from the tails: a walker gets stuck in a tail that is never proposed.
        if weight is None:
            weight = np.full(len(points), 1.0 / len(points))
        ends = (_quantiles(x, weight, np.array([0.05, 0.5, 0.95])) for x in points.T)
        low, middle, high = np.array(list(ends)).T
        left = np.maximum(middle - low, 1e-12) / 1.645
        right = np.maximum(high - middle, 1e-12) / 1.645
        skewed = (points - middle) / np.where(points < middle, left, right)
        d = points.shape[1]
        spread = (skewed.T * weight) @ skewed + 1e-6 * np.eye(d)
        return cls(middle, left, right, inflation * spread)

    def log_density(self, z: Array) -> Array:
        """Log density (N,) at points (N, D)."""
        scale = np.where(z < self.middle, self.left, self.right)
        u = ((z - self.middle) / scale) @ self.inverse.T
        power = 0.5 * (DEGREES_OF_FREEDOM + z.shape[1])
        radial = -power * np.log1p(np.sum(u**2, axis=1) / DEGREES_OF_FREEDOM)
        return np.asarray(self._log_constant + radial - np.sum(np.log(scale), axis=1))

    def draw(self, count: int, random: np.random.RandomState) -> Array:
        """Draw (count, D) points."""
        stretch = np.sqrt(
            DEGREES_OF_FREEDOM / random.chisquare(DEGREES_OF_FREEDOM, size=(count, 1))
        )
        return self.skewed(random.normal(size=(count, len(self.middle))) * stretch)

    def even(self, count: int, random: np.random.Generator) -> Array:
        """Draw (count, D) quasi-random points (scrambled Sobol); count is a power of two."""
        d = len(self.middle)
        uniform = qmc.Sobol(d + 1, rng=random).random(count)
        stretch = np.sqrt(DEGREES_OF_FREEDOM / chi2.ppf(uniform[:, d:], DEGREES_OF_FREEDOM))
        return self.skewed(ndtri(uniform[:, :d]) * stretch)

    def skewed(self, t: Array) -> Array:
        """Map standard Student t variables (N, D) to points (N, D)."""
        y = t @ self.root.T
        return np.asarray(self.middle + y * np.where(y < 0.0, self.left, self.right))

    def __call__(self, z: Array, random: np.random.RandomState) -> tuple[Array, Array]:
        """Propose (N, D) points, with the logarithms (N,) of their Metropolis–Hastings factors."""
        q = self.draw(len(z), random)
        return q, self.log_density(z) - self.log_density(q)


def _quantiles(value: Array, weight: Array, share: Array) -> Array:
    """Quantiles of weighted values (N,)."""
    order = np.argsort(value)
    reached = np.cumsum(weight[order]) - 0.5 * weight[order]
    return np.asarray(np.interp(share, reached, value[order]))


class Density(Protocol):
    """An object with a log density (W,) at points (W, D), finite or −inf."""

    def log_posterior(self, z: Array) -> Array:
        """Log density, not normalised."""
        ...


INFLATION = 1.2
"""Factor on the covariance of a proposal, so that it covers the tails."""


@dataclass(frozen=True)
class WeightedDraws:
    """Weighted draws of a posterior.

    Parameters
    ----------
    z : (S, D) array
        Coordinates.
    weight : (S,) array
        Weights, summing to one.
    log_evidence : float
        Logarithm of the integral of likelihood times prior.
    """

    z: Array
    weight: Array
    log_evidence: float

    @property
    def effective(self) -> float:
        """Effective number of draws, 1 / Σ w² (Kong 1992)."""
        return float(1.0 / np.sum(self.weight**2))

    def mean(self, value: Array) -> float:
        """Mean of a function of the draws (S,)."""
        return float(self.weight @ value)

    def probability_below(self, value: Array, truth: float) -> float:
        """Posterior probability that a function of the draws (S,) lies below a value."""
        share = self.weight @ (value < truth) + 0.5 * self.weight @ (value == truth)
        return min(1.0, float(share))  # rounding errors in the sum of weights

    def quantile(self, value: Array, share: Array) -> Array:
        """Quantiles of a function of the draws (S,)."""
        return _quantiles(value, self.weight, share)

    def sd(self, value: Array) -> float:
        """Return the standard deviation of a function of the draws (S,)."""
        return float(np.sqrt(self.weight @ (value - self.mean(value)) ** 2))


def importance_sample(
    posterior: Density, mode: PosteriorMode, count: int, seed: int
) -> WeightedDraws:
    """Draw quasi-random points from a Student t at the mode, weighted by the posterior.

    Parameters
    ----------
    posterior : Density
        The posterior.
    mode : PosteriorMode
        Its mode and curvature.
    count : int
        Number of draws, a power of two (scrambled Sobol points).
    seed : int
        Seed of the random numbers.

    Returns
    -------
    WeightedDraws
    """
    proposal = Proposal.around(mode, INFLATION)
    z = proposal.even(count, np.random.default_rng(seed))
    log_ratio = posterior.log_posterior(z) - proposal.log_density(z)
    top = float(np.max(log_ratio))
    weight = np.exp(log_ratio - top)
    total = float(weight.sum())
    return WeightedDraws(z, weight / total, top + float(np.log(total / count)))
