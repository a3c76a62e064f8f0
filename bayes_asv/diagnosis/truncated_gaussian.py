"""What normal coordinates are worth that cannot lie beyond some bounds.

With pull p and information G (what other coordinates imitate left out) a likelihood gains
pᵀt − ½ tᵀGt at t, and t has a standard normal prior cut off at its bounds.  The integral of the
product is taken about its highest place inside the bounds.  A coordinate that is held by a bound is
integrated along its marginal's tail, one that is free over what the bounds leave of its
marginal: exact for one coordinate and for independent ones.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear
from scipy.special import erfcx, log_ndtr, ndtr

__all__ = ["TruncatedGaussian", "bounded"]

Array = NDArray[np.float64]


class TruncatedGaussian(NamedTuple):
    """Bounded coordinates after the data.

    Parameters
    ----------
    gain : float
        Logarithm of the integral of likelihood times prior, against the likelihood at t = 0.
    at : (K,) array
        The highest place inside the bounds.
    covariance : (K, K) array
        About it, bounds left out.
    held : (K,) bool array
        Which of them would lie beyond a bound.
    """

    gain: float
    at: Array
    covariance: Array
    held: NDArray[np.bool_]


def bounded(pull: Array, gram: Array, low: Array, high: Array) -> TruncatedGaussian:
    """Integrate bounded coordinates out.

    Parameters
    ----------
    pull : (K,) array
        Slope of the log-likelihood at t = 0.
    gram : (K, K) array
        Its curvature, the sign turned.
    low, high : (K,) arrays
        Bounds.
    """
    precision = gram + np.eye(len(pull))
    root = np.linalg.cholesky(precision)
    covariance = np.asarray(np.linalg.inv(precision), np.float64)
    free = covariance @ pull
    at = free
    if np.any((free < low) | (free > high)):
        found = lsq_linear(root.T, np.linalg.solve(root, pull), bounds=(low, high), method="bvls")
        at = np.clip(found.x, low, high)
    sd = np.sqrt(np.diag(covariance))
    left = pull - precision @ at
    # along a marginal whose mode lies beyond a bound, in its deviations
    beyond = np.abs(left) * sd
    above, below = (at >= high - 1e-9) & (left > 0.0), (at <= low + 1e-9) & (left < 0.0)
    at = np.where(above, high, np.where(below, low, at))  # least squares stop a digit short of it
    held = above | below
    b, w = beyond[held], ((high - low) / sd)[held]
    far = np.exp(-b * w - 0.5 * w**2) * erfcx((b + w) / np.sqrt(2.0))
    tails = np.log(0.5 * (erfcx(b / np.sqrt(2.0)) - far))
    open_ = ~held
    room = _between((low - at)[open_] / sd[open_], (high - at)[open_] / sd[open_])
    gain = float(pull @ at - 0.5 * at @ precision @ at - np.log(np.diag(root)).sum())
    gain += float(tails.sum() + room.sum() - _between(low, high).sum())
    return TruncatedGaussian(gain, at, covariance, held)


def _between(low: Array, high: Array) -> Array:
    """Logarithm of a standard normal's share between bounds that hold zero."""
    return np.asarray(log_ndtr(high) + np.log1p(-ndtr(low) / ndtr(high)))
