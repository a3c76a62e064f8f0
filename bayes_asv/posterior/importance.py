"""A posterior by weighted draws: as good as the ensembles where it is nearly normal, and faster.

For work that needs thousands of posteriors (calibration, planning) or a run at a time.  The
weights say themselves when they cannot be trusted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import chi2, qmc

from bayes_asv.posterior.newton import Mode
from bayes_asv.posterior.sampler import DEGREES_OF_FREEDOM, Density, Proposal

__all__ = ["WeightedDraws", "importance_sample"]

Array = NDArray[np.float64]

_INFLATION = 1.2  # of the curvature's covariance, so that no tail is left out


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

    def below(self, value: Array, truth: float) -> float:
        """Posterior probability that a function of the draws (S,) lies below a truth."""
        share = self.weight @ (value < truth) + 0.5 * self.weight @ (value == truth)
        return min(1.0, float(share))  # weights sum to one but for rounding

    def quantile(self, value: Array, share: Array) -> Array:
        """Quantiles of a function of the draws (S,)."""
        order = np.argsort(value)
        reached = np.cumsum(self.weight[order]) - 0.5 * self.weight[order]
        return np.asarray(np.interp(share, reached, value[order]))

    def sd(self, value: Array) -> float:
        """Deviation of a function of the draws (S,)."""
        return float(np.sqrt(self.weight @ (value - self.mean(value)) ** 2))


def importance_sample(target: Density, mode: Mode, count: int, seed: int) -> WeightedDraws:
    """Draw evenly from a Student t at the mode and weigh by the posterior.

    Parameters
    ----------
    target : Density
        The posterior.
    mode : Mode
        Its mode and curvature.
    count : int
        Number of draws, a power of two: scrambled Sobol points, which fill space more evenly
        than chance does.
    seed : int
        Same seed, same draws.

    Returns
    -------
    Weighted
    """
    proposal = Proposal.around(mode, _INFLATION)
    d = len(mode.z)
    even = qmc.Sobol(d + 1, rng=np.random.default_rng(seed)).random(count)
    stretch = np.sqrt(DEGREES_OF_FREEDOM / chi2.ppf(even[:, d:], DEGREES_OF_FREEDOM))
    z = proposal.skewed(ndtri(even[:, :d]) * stretch)
    log_ratio = target.log_posterior(z) - proposal.log_density(z)
    top = float(np.max(log_ratio))
    weight = np.exp(log_ratio - top)
    total = float(weight.sum())
    return WeightedDraws(z, weight / total, top + float(np.log(total / count)))
