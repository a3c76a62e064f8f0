"""A posterior in half a second, and where the truth lies in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr

from bayes_asv.posterior.importance import WeightedDraws, importance_sample
from bayes_asv.posterior.map_fit import MapFit
from bayes_asv.posterior.sampler import sample_mcmc
from benchmarks.calibration.quantities import Conditional

__all__ = ["ENOUGH", "Posterior", "place", "posterior", "spread"]

Array = NDArray[np.float64]

# Draws are added until so many are effective; beyond the last count the ensembles take over.
ENOUGH = 120.0
_COUNTS = (512, 2048, 8192)
_NORMAL_95 = 1.959964


@dataclass(frozen=True)
class Posterior:
    """Weighted draws and how they were made.

    Parameters
    ----------
    draws : Weighted
        Coordinates and weights.
    how : str
        Number of weighted draws, or ``ensembles``.
    converged : bool
        False when the ensembles did not agree: the product would not have answered.
    """

    draws: WeightedDraws
    how: str
    converged: bool = True


def posterior(fit: MapFit, seed: int) -> Posterior:
    """Draw from the posterior at a fit.

    Parameters
    ----------
    fit : MapFit
        Mode, curvature and density.
    seed : int
        Same seed, same draws.

    Returns
    -------
    Posterior
        Weighted draws, at least :data:`ENOUGH` of them effective; of the ensembles where no
        number of weighted draws would do.
    """
    if fit.mode.converged:
        for count in _COUNTS:
            draws = importance_sample(fit.posterior, fit.mode, count, seed)
            if draws.effective >= ENOUGH:
                return Posterior(draws, str(count))
    chains = sample_mcmc(fit.posterior, fit.mode, seed)
    z = chains.draws.reshape(-1, fit.space.dimension)
    return Posterior(
        WeightedDraws(z, np.full(len(z), 1.0 / len(z)), float("nan")), "ensembles", chains.converged
    )


def place(draws: WeightedDraws, what: Conditional) -> float:
    """Posterior probability that a quantity lies below its truth."""
    if what.sd == 0.0:
        return draws.probability_below(what.mean, what.truth)
    return draws.mean(np.asarray(ndtr((what.truth - what.mean) / what.sd)))


def spread(draws: WeightedDraws, what: Conditional) -> float:
    """Width of the equal-tailed 95 % interval as a deviation: a normal's width over 2 · 1.96."""
    shares = np.array([0.025, 0.975])
    if what.sd == 0.0:
        low, high = draws.quantile(what.mean, shares)
    else:
        reach = 8.0 * what.sd
        ends = (float(what.mean.min()) - reach, float(what.mean.max()) + reach)

        def beyond(x: float, share: float) -> float:
            return draws.mean(np.asarray(ndtr((x - what.mean) / what.sd))) - share

        low, high = (brentq(beyond, *ends, args=(share,)) for share in shares)
    return float(high - low) / (2.0 * _NORMAL_95)
