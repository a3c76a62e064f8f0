"""Vector autoregression of the residuals, fitted to the innovations.

An engine shakes the frame, a body panel resonates, a road differs from side to side: motion that
the car model does not contain makes the innovations autocorrelated.  A vector autoregression on
the normalised innovations of all outputs describes it; its order is chosen by the Bayesian
information criterion, and is zero if the innovations are white.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from bayes_asv.posterior.likelihood import WHITE, ResidualAR

__all__ = ["chance_factor", "fit_residual_ar", "long_run_variance", "portmanteau"]

Array = NDArray[np.float64]

_ORDERS = (0, 1, 2, 3, 4, 6, 8, 12, 16, 24)  # orders that are compared
# Log-likelihood margin (nats) for an autoregression over white innovations, beyond the information
# criterion; its false-alarm rate is a few per thousand.
_MARGIN = 5.0
# Time over which innovations of a wrong model may be correlated, s: a period of the car's modes.
_MEMORY = 0.1


def fit_residual_ar(nu: Array, least: int = 0, most: int = _ORDERS[-1]) -> ResidualAR:
    """Fit an autoregression whose order the information criterion chooses.

    Parameters
    ----------
    nu : (N, ny) array
        Normalised innovations of one run, in time order; nan where a reading was missing.
    least, most : int
        Lowest and highest order to consider.

    Returns
    -------
    ResidualAR
        :data:`~bayes_asv.posterior.likelihood.WHITE` if no order is better than zero.
    """
    n, ny = nu.shape
    orders = [p for p in _ORDERS if least <= p <= most and 20 * p <= n]
    longest = max(orders, default=0)
    if longest == 0:
        return WHITE
    response = nu[longest:]
    lagged = np.concatenate([nu[longest - j : n - j] for j in range(1, longest + 1)], axis=1)
    best, best_score = 0, math.inf
    for p in orders:
        rows, design = _complete_rows(response, lagged[:, : ny * p])
        if len(rows) < max(20 * p, 50):
            break  # too few rows without a gap
        residuals = rows - design @ _solve(design, rows) if p > 0 else rows
        # per row, since higher orders have fewer complete rows
        score = _criterion(residuals, p) / len(rows)
        if p == 0:
            score -= 2.0 * _MARGIN / len(rows)
        if score < best_score:
            best, best_score = p, score
    if best == 0:
        return WHITE
    rows, design = _complete_rows(response, lagged[:, : ny * best])
    weights = _solve(design, rows)
    residuals = rows - design @ weights
    covariance = residuals.T @ residuals / (len(rows) - ny * best)
    root = np.linalg.inv(np.linalg.cholesky(covariance))
    coefficients = weights.T.reshape(ny, best, ny).transpose(1, 0, 2)
    return ResidualAR(np.ascontiguousarray(coefficients), np.ascontiguousarray(root))


def _complete_rows(response: Array, lagged: Array) -> tuple[Array, Array]:
    """Rows without a missing value."""
    complete = np.isfinite(response).all(axis=1) & np.isfinite(lagged).all(axis=1)
    return response[complete], lagged[complete]


def _solve(design: Array, response: Array) -> Array:
    gram = design.T @ design
    gram[np.diag_indices_from(gram)] += 1e-9 * np.trace(gram) / len(gram)
    return np.asarray(np.linalg.solve(gram, design.T @ response))


def _criterion(residuals: Array, p: int) -> float:
    """Bayesian information criterion (Schwarz) of a vector autoregression of order p."""
    n, ny = residuals.shape
    _, log_det = np.linalg.slogdet(residuals.T @ residuals / n)
    return float(n * log_det + ny**2 * p * math.log(n))


def long_run_variance(innovations: Array, use: NDArray[np.bool_], instants: Array) -> float:
    """Long-run variance of normalised innovations: N times the variance of their mean.

    The largest of all outputs, by the estimator of Newey & West (1987).

    Parameters
    ----------
    innovations : (E, ny) array
        Normalised innovations of one run.
    use : (E, ny) array of bool
        Whether there is an innovation.
    instants : (E,) array
        Their times, s.
    """
    out = []
    for y in range(innovations.shape[1]):
        series = innovations[use[:, y], y]
        step = float(np.median(np.diff(instants[use[:, y]])))
        lags = min(max(round(_MEMORY / step), 1), len(series) - 1)
        weights = 1.0 - np.arange(1, lags + 1) / (lags + 1)  # Newey & West 1987
        products = [float(series[k:] @ series[:-k]) for k in range(1, lags + 1)]
        out.append((float(series @ series) + 2.0 * float(weights @ products)) / len(series))
    return max(out)


def chance_factor(use: NDArray[np.bool_], instants: Array, level: float) -> float:
    """Factor that the estimate of :func:`long_run_variance` exceeds by chance alone.

    With L lags of Bartlett's weights and N innovations, the relative variance of the estimate is
    (4/3) L/N (Priestley 1981, Spectral Analysis and Time Series, table 6.1), that of χ² with
    1.5 N/L degrees of freedom.

    Parameters
    ----------
    use, instants
        As for :func:`long_run_variance`.
    level : float
        Probability that the estimate exceeds the true value by more than the factor.
    """
    count = int(np.min(np.count_nonzero(use, axis=0)))
    step = float(np.ptp(instants)) / max(count - 1, 1)
    freedom = max(1.5 * count * step / _MEMORY, 1.0)
    return float(chdtri(freedom, level)) / freedom


def portmanteau(series: Array, lags: int, fitted: int = 0) -> float:
    """Ljung–Box p-value of one series of innovations; small if it is not white.

    Parameters
    ----------
    series : (N,) array
        Innovations.
    lags : int
        Number of lags tested together.
    fitted : int
        Order of an autoregression that was fitted to the same series.

    Returns
    -------
    float
        Probability of at least as much autocorrelation in white noise (Ljung & Box 1978).
    """
    from scipy.special import gammaincc

    x = series - series.mean()
    n = len(x)
    power = float(x @ x)
    if power == 0.0 or n <= lags + 1:
        return 1.0
    r = np.array([float(x[j:] @ x[:-j]) / power for j in range(1, lags + 1)])
    q = n * (n + 2.0) * float(np.sum(r**2 / (n - np.arange(1, lags + 1))))
    return float(gammaincc(0.5 * (lags - fitted), 0.5 * q))
