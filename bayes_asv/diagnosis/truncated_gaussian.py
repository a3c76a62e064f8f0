"""Integral of a Gaussian likelihood times a truncated standard normal prior.

Along coordinates t a quadratic log-likelihood gains gᵀt − ½ tᵀIt, with gradient g and information I
(nuisance parameters projected out), and each t has a standard normal prior truncated to its bounds.
The integral of the product is expanded about the constrained mode.  A coordinate that a bound holds
is integrated along the tail of its marginal, any other over what the bounds leave of its marginal:
exact for one coordinate and for independent ones.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear
from scipy.special import erfcx, log_ndtr, ndtr

__all__ = ["TruncatedGaussian", "integrate_truncated"]

Array = NDArray[np.float64]


class TruncatedGaussian(NamedTuple):
    """Posterior of truncated coordinates.

    Parameters
    ----------
    log_integral : float
        Logarithm of the integral of likelihood times prior, relative to the likelihood at t = 0.
    mode : (K,) array
        Mode inside the bounds.
    covariance : (K, K) array
        About the mode, bounds ignored.
    at_bound : (K,) bool array
        Coordinates whose unconstrained mode lies beyond a bound.
    """

    log_integral: float
    mode: Array
    covariance: Array
    at_bound: NDArray[np.bool_]


def integrate_truncated(
    gradient: Array, information: Array, lower: Array, upper: Array
) -> TruncatedGaussian:
    """Integrate truncated standard normal coordinates out of a quadratic log-likelihood.

    Parameters
    ----------
    gradient : (K,) array
        Gradient of the log-likelihood at t = 0.
    information : (K, K) array
        Its negative curvature.
    lower, upper : (K,) arrays
        Bounds.
    """
    precision = information + np.eye(len(gradient))
    root = np.linalg.cholesky(precision)
    covariance = np.asarray(np.linalg.inv(precision), np.float64)
    mode = covariance @ gradient
    if np.any((mode < lower) | (mode > upper)):
        fit = lsq_linear(
            root.T, np.linalg.solve(root, gradient), bounds=(lower, upper), method="bvls"
        )
        mode = np.clip(fit.x, lower, upper)
    sd = np.sqrt(np.diag(covariance))
    slope = gradient - precision @ mode
    # in standard deviations of the marginal, whose mode lies beyond the bound
    excess = np.abs(slope) * sd
    above, below = (mode >= upper - 1e-9) & (slope > 0.0), (mode <= lower + 1e-9) & (slope < 0.0)
    mode = np.where(above, upper, np.where(below, lower, mode))  # bvls stops a digit short of it
    at_bound = above | below
    b, width = excess[at_bound], ((upper - lower) / sd)[at_bound]
    beyond_width = np.exp(-b * width - 0.5 * width**2) * erfcx((b + width) / np.sqrt(2.0))
    tails = np.log(0.5 * (erfcx(b / np.sqrt(2.0)) - beyond_width))
    free = ~at_bound
    inside = _log_probability((lower - mode)[free] / sd[free], (upper - mode)[free] / sd[free])
    value = float(gradient @ mode - 0.5 * mode @ precision @ mode - np.log(np.diag(root)).sum())
    value += float(tails.sum() + inside.sum() - _log_probability(lower, upper).sum())
    return TruncatedGaussian(value, mode, covariance, at_bound)


def _log_probability(lower: Array, upper: Array) -> Array:
    """Log-probability of a standard normal between bounds that enclose zero."""
    return np.asarray(log_ndtr(upper) + np.log1p(-ndtr(lower) / ndtr(upper)))
