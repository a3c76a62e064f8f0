"""Prediction-error estimation by the Levenberg–Marquardt method, and tests of its residuals.

The model is ŷ = s(θ) + D(θ) β, with θ the logarithms of c_f, c_r and i and β linear unknowns
(initial state, biases).  The criterion for several outputs is log det Λ of the residuals'
covariance, which is maximum likelihood with unknown Gaussian noise (Ljung 1999, section 15.2) and
the criterion of the reference's ``pem``.  Its Gauss–Newton curvature is Jᵀ Λ⁻¹ J, with Λ of the
previous step.

The residual tests follow Ljung, System Identification: Theory for the User, 2nd ed. (1999),
section 16.6.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

__all__ = [
    "IndependenceTest",
    "PredictionErrorFit",
    "WhitenessTest",
    "fit_percent",
    "independence_test",
    "minimise",
    "whiteness_test",
]

Array = NDArray[np.float64]
Model = Callable[[Array], tuple[Array, Array]]

_MAX_STEPS = 200
_MIN_GAIN = 1e-5  # in log-likelihood, far below the ½ of one standard deviation
_CONVERGED_STEPS = 2  # consecutive steps with a smaller gain
_DIFFERENCE = 1e-5  # of a logarithm, for central differences
_FLOOR = 1e-20  # relative to the outputs' variance, for residuals of an exact model
_MAX_CHANGE = 12.0  # of a logarithm, a factor of 10^5, beyond which no car is plausible


@dataclass(frozen=True)
class PredictionErrorFit:
    """The minimum of the criterion.

    Parameters
    ----------
    theta : (P,) array
        Logarithms of the parameters.
    beta : (L,) array
        Linear unknowns.
    covariance : (P + L, P + L) array
        Of (θ, β), from the curvature with white residuals: (Jᵀ Λ⁻¹ J)⁻¹.
    residual, output : (N, q) array
        y − ŷ and ŷ.
    noise : (q, q) array
        Λ, the residuals' covariance.
    converged : bool
        Whether the iteration converged.
    """

    theta: Array
    beta: Array
    covariance: Array
    residual: Array
    output: Array
    noise: Array
    converged: bool

    @property
    def log_likelihood(self) -> float:
        """Maximum of the Gaussian log-likelihood."""
        n, q = self.residual.shape
        sign, size = np.linalg.slogdet(self.noise)
        return float(-0.5 * n * (q * np.log(2.0 * np.pi) + q + (size if sign > 0 else -np.inf)))

    @property
    def unknowns(self) -> int:
        """Number of estimated parameters without the noise covariance."""
        return len(self.theta) + len(self.beta)

    @property
    def aic(self) -> float:
        """Akaike's criterion, 2p − 2 log L."""
        return 2.0 * self.unknowns - 2.0 * self.log_likelihood

    @property
    def bic(self) -> float:
        """Schwarz's criterion, p log N − 2 log L."""
        return self.unknowns * float(np.log(len(self.residual))) - 2.0 * self.log_likelihood


def minimise(model: Model, measured: Array, start: Array) -> PredictionErrorFit:
    """Fit a model to measured outputs.

    Parameters
    ----------
    model : callable
        Takes θ (P,); returns s (N, q) and D (N, q, L).
    measured : (N, q) array
        Outputs; rows that contain nan are ignored.
    start : (P,) array
        Initial θ.

    Returns
    -------
    PredictionErrorFit
        With the residuals of the rows without nan.
    """
    rows = np.all(np.isfinite(measured), axis=1)
    y = measured[rows]

    def outputs(theta: Array) -> tuple[Array, Array]:
        s, D = model(theta)
        return s[rows], D[rows]

    floor = np.diag(_FLOOR * np.var(y, axis=0) + 1e-300)

    def covariance(residual: Array) -> Array:
        return np.asarray(residual.T @ residual / len(y) + floor)

    def criterion(residual: Array) -> float:
        return float(np.linalg.slogdet(covariance(residual))[1])

    theta, p = start.copy(), len(start)
    parts = outputs(theta)
    beta = _linear_unknowns(*parts, y, np.diag(np.var(y, axis=0) + 1e-300))
    current, damping, small_gains, converged = criterion(y - _output(parts, beta)), 1e-3, 0, False
    J, residual = _jacobian(outputs, y, theta, beta)
    for _ in range(_MAX_STEPS):
        weight = np.linalg.inv(covariance(residual))
        weighted = J.reshape(-1, J.shape[2]).T @ (weight @ J).reshape(-1, J.shape[2])
        g = np.einsum("nqa,qr,nr->a", J, weight, residual, optimize=True)
        H = weighted + damping * np.diag(np.diag(weighted) + 1e-300)
        step = np.linalg.lstsq(H, g, rcond=None)[0]
        shortening = min(1.0, 1.0 / max(float(np.max(np.abs(step[:p]))), 1e-300))
        trial, free = theta + shortening * step[:p], beta + shortening * step[p:]
        parts = outputs(trial)
        if shortening < 1.0 and len(free):  # far from the minimum, solve for them instead
            free = _linear_unknowns(*parts, y, covariance(residual))
        after = criterion(y - _output(parts, free))
        if after <= current:
            gain = 0.5 * len(y) * (current - after)
            small_gains = small_gains + 1 if gain < _MIN_GAIN else 0
            theta, beta, current = trial, free, after
            damping = max(0.1 * damping, 1e-12)
            J, residual = _jacobian(outputs, y, theta, beta)
        else:
            damping *= 10.0
        # with extreme damping no direction improves the criterion any more
        converged = small_gains >= _CONVERGED_STEPS or damping > 1e10
        if converged:
            break
    noise = covariance(residual)
    information = np.einsum("nqa,qr,nrb->ab", J, np.linalg.inv(noise), J, optimize=True)
    return PredictionErrorFit(
        theta=theta,
        beta=beta,
        covariance=np.asarray(np.linalg.pinv(information, hermitian=True)),
        residual=residual,
        output=y - residual,
        noise=noise,
        converged=converged and bool(np.all(np.abs(theta - start) < _MAX_CHANGE)),
    )


def _jacobian(outputs: Model, y: Array, theta: Array, beta: Array) -> tuple[Array, Array]:
    """Return the Jacobian of the outputs (N, q, P + L) and the residual (N, q)."""
    base, design = outputs(theta)
    columns = []
    for k in range(len(theta)):
        ahead, behind = theta.copy(), theta.copy()
        ahead[k] += _DIFFERENCE
        behind[k] -= _DIFFERENCE
        columns.append(
            (_output(outputs(ahead), beta) - _output(outputs(behind), beta)) / (2.0 * _DIFFERENCE)
        )
    J = np.concatenate([np.stack(columns, axis=2), design], axis=2)
    return J, y - _output((base, design), beta)


def _output(parts: tuple[Array, Array], beta: Array) -> Array:
    base, design = parts
    return np.asarray(base + design @ beta)


def _linear_unknowns(base: Array, design: Array, y: Array, noise: Array) -> Array:
    """Solve for the linear unknowns (L,) at fixed θ, by weighted least squares."""
    if design.shape[2] == 0:
        return np.zeros(0)
    root = np.linalg.inv(np.linalg.cholesky(noise))
    X = np.einsum("qr,nrl->nql", root, design).reshape(-1, design.shape[2])
    z = ((y - base) @ root.T).ravel()
    return np.asarray(np.linalg.lstsq(X, z, rcond=None)[0])


LAGS = 25
"""Number of lags of both tests."""


@dataclass(frozen=True)
class WhitenessTest:
    """Whiteness test of a residual: Q = N/R₀² Σ R(τ)² against χ² (Ljung, eq. 16.63).

    Parameters
    ----------
    statistic, p : float
        Q and its p-value.
    autocorrelation : (LAGS,) array
        At lags 1 to LAGS.
    band : float
        99 % band of each autocorrelation.
    """

    statistic: float
    p: float
    autocorrelation: Array
    band: float


@dataclass(frozen=True)
class IndependenceTest:
    """Test of independence between a residual and past inputs (Ljung, eq. 16.66 to 16.68).

    Parameters
    ----------
    statistic, p : float
        N rᵀ P⁻¹ r against χ² and its p-value.
    """

    statistic: float
    p: float


def fit_percent(measured: Array, simulated: Array) -> float:
    """Return the fit 100 (1 − |y − ŷ| / |y − ȳ|) in percent."""
    scale = float(np.linalg.norm(measured - measured.mean()))
    if scale == 0.0:
        return float("nan")
    return 100.0 * (1.0 - float(np.linalg.norm(measured - simulated)) / scale)


def whiteness_test(residual: Array) -> WhitenessTest:
    """Test a residual (N,) for whiteness."""
    n = len(residual)
    R = _correlation(residual, residual, LAGS)
    rho = R[1:] / R[0]
    statistic = float(n * np.sum(rho**2))
    return WhitenessTest(statistic, float(chi2.sf(statistic, LAGS)), rho, 2.5758 / np.sqrt(n))


def independence_test(residual: Array, wheel: Array) -> IndependenceTest:
    """Test a residual (N,) for independence of the past of an input (N,).

    Under independence the cross-covariances r(τ), τ = 0 … M−1, have the covariance
    P(i, j) = Σ_k R_ε(k) R_u(k + i − j)/N; the residual need not be white.  A Bartlett taper on the
    residual's autocovariances makes P positive definite.
    """
    n = len(residual)
    r = np.array([residual[k:] @ wheel[: n - k] / n for k in range(LAGS)])
    reach = 4 * LAGS
    of_residual = _correlation(residual, residual, reach) * (
        1.0 - np.arange(reach + 1) / (reach + 1)
    )
    of_input = _correlation(wheel, wheel, reach + LAGS)
    lag = np.arange(-reach, reach + 1)
    by_lag = np.array(
        [
            of_residual[np.abs(lag)] @ of_input[np.abs(lag + shift)]
            for shift in range(-LAGS + 1, LAGS)
        ]
    )
    index = np.subtract.outer(np.arange(LAGS), np.arange(LAGS)) + LAGS - 1
    P = by_lag[index] / n
    # a slowly varying input makes P nearly singular; directions without excitation are dropped
    values, vectors = np.linalg.eigh(P)
    kept = values > 1e-8 * values[-1]
    parts = (vectors.T @ r)[kept]
    statistic = float(np.sum(parts**2 / values[kept]))
    return IndependenceTest(statistic, float(chi2.sf(statistic, int(np.count_nonzero(kept)))))


def _correlation(a: Array, b: Array, lags: int) -> Array:
    n = len(a)
    return np.array([a[k:] @ b[: n - k] / n if k < n else 0.0 for k in range(lags + 1)])
