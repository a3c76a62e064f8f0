"""What a point estimate leaves: whether it is white, and whether it knows the input.

Ljung, System Identification: Theory for the User, 2nd ed. (1999), section 16.6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

__all__ = ["Independence", "Whiteness", "fit_percent", "independence", "whiteness"]

Array = NDArray[np.float64]

LAGS = 25
"""Lags that both tests look at."""


@dataclass(frozen=True)
class Whiteness:
    """Test that a residual is white: Q = N/R₀² Σ R(τ)² against χ² (eq. 16.63 there).

    Parameters
    ----------
    statistic, p : float
        Q and its probability under whiteness.
    autocorrelation : (LAGS,) array
        At lags 1 and on.
    band : float
        99 % band of each autocorrelation.
    """

    statistic: float
    p: float
    autocorrelation: Array
    band: float


@dataclass(frozen=True)
class Independence:
    """Test that a residual does not know one input's past (eq. 16.66 to 16.68 there).

    Parameters
    ----------
    statistic, p : float
        N rᵀ P⁻¹ r against χ², and its probability under independence.
    """

    statistic: float
    p: float


def fit_percent(measured: Array, simulated: Array) -> float:
    """100 (1 − |y − ŷ| / |y − ȳ|): 100 is perfect, 0 is no better than the mean."""
    spread = float(np.linalg.norm(measured - measured.mean()))
    if spread == 0.0:
        return float("nan")
    return 100.0 * (1.0 - float(np.linalg.norm(measured - simulated)) / spread)


def whiteness(residual: Array) -> Whiteness:
    """Test a residual (N,) for whiteness."""
    n = len(residual)
    R = _correlation(residual, residual, LAGS)
    rho = R[1:] / R[0]
    statistic = float(n * np.sum(rho**2))
    return Whiteness(statistic, float(chi2.sf(statistic, LAGS)), rho, 2.5758 / np.sqrt(n))


def independence(residual: Array, wheel: Array) -> Independence:
    """Test whether a residual (N,) goes with the past of an input (N,).

    The correlations r(τ), τ = 0 … M−1, have the covariance P(i, j) = Σ_k R_ε(k) R_u(k + i − j)/N
    when both are independent; the residual need not be white.  The correlations of the residual
    are tapered (Bartlett), so that P is positive definite.
    """
    n = len(residual)
    r = np.array([residual[k:] @ wheel[: n - k] / n for k in range(LAGS)])
    reach = 4 * LAGS
    own = _correlation(residual, residual, reach) * (1.0 - np.arange(reach + 1) / (reach + 1))
    drive = _correlation(wheel, wheel, reach + LAGS)
    both = np.arange(-reach, reach + 1)
    by_lag = np.array(
        [own[np.abs(both)] @ drive[np.abs(both + shift)] for shift in range(-LAGS + 1, LAGS)]
    )
    place = np.subtract.outer(np.arange(LAGS), np.arange(LAGS)) + LAGS - 1
    P = by_lag[place] / n
    # an input that moves slowly makes P nearly singular; what it does not excite does not count
    values, vectors = np.linalg.eigh(P)
    kept = values > 1e-8 * values[-1]
    parts = (vectors.T @ r)[kept]
    statistic = float(np.sum(parts**2 / values[kept]))
    return Independence(statistic, float(chi2.sf(statistic, int(np.count_nonzero(kept)))))


def _correlation(a: Array, b: Array, lags: int) -> Array:
    n = len(a)
    return np.array([a[k:] @ b[: n - k] / n if k < n else 0.0 for k in range(lags + 1)])
