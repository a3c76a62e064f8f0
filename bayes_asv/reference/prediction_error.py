"""Prediction-error estimates by Levenberg and Marquardt's method.

The model is ŷ = s(θ) + D(θ) β, with θ the logarithms of c_f, c_r and i and β linear unknowns
(initial state, biases).  The criterion for several outputs is log det of the residuals' covariance
Λ, which is maximum likelihood with unknown Gaussian noise (Ljung 1999, section 15.2) and what
the reference's ``pem`` minimises.  Its Gauss-Newton curvature is Jᵀ Λ⁻¹ J, with Λ of the
step before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Fitted", "minimise"]

Array = NDArray[np.float64]
Model = Callable[[Array], tuple[Array, Array]]

_STEPS = 200
_SETTLED = 1e-5  # gain in log-likelihood, far below the ½ that one deviation makes
_LAST = 2  # such gains in a row
_DIFFERENCE = 1e-5  # of a logarithm, central
_FLOOR = 1e-20  # of the outputs' variance: an exact model leaves nothing to weigh by
_REACH = 12.0  # logarithms: a factor of 10^5, beyond which no car is


@dataclass(frozen=True)
class Fitted:
    """A minimum of the criterion.

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
        Whether steps and weights settled.
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
        """Largest Gaussian log-likelihood."""
        n, q = self.residual.shape
        sign, size = np.linalg.slogdet(self.noise)
        return float(-0.5 * n * (q * np.log(2.0 * np.pi) + q + (size if sign > 0 else -np.inf)))

    @property
    def unknowns(self) -> int:
        """Number of estimated numbers, noise covariance left out."""
        return len(self.theta) + len(self.beta)

    @property
    def aic(self) -> float:
        """Akaike's criterion, 2p − 2 log L."""
        return 2.0 * self.unknowns - 2.0 * self.log_likelihood

    @property
    def bic(self) -> float:
        """Schwarz's criterion, p log N − 2 log L."""
        return self.unknowns * float(np.log(len(self.residual))) - 2.0 * self.log_likelihood


def minimise(model: Model, measured: Array, start: Array) -> Fitted:
    """Fit a model to measured outputs.

    Parameters
    ----------
    model : callable
        Takes θ (P,); returns s (N, q) and D (N, q, L).
    measured : (N, q) array
        Outputs; a row with a nan in it does not count.
    start : (P,) array
        Where to begin.

    Returns
    -------
    Fitted
        Residuals of rows that count.
    """
    rows = np.all(np.isfinite(measured), axis=1)
    y = measured[rows]

    def outputs(theta: Array) -> tuple[Array, Array]:
        s, D = model(theta)
        return s[rows], D[rows]

    floor = np.diag(_FLOOR * np.var(y, axis=0) + 1e-300)

    def spread(left: Array) -> Array:
        return np.asarray(left.T @ left / len(y) + floor)

    def size(left: Array) -> float:
        return float(np.linalg.slogdet(spread(left))[1])

    theta, p = start.copy(), len(start)
    parts = outputs(theta)
    beta = _linear(*parts, y, np.diag(np.var(y, axis=0) + 1e-300))
    now, damping, small, settled = size(y - _at(parts, beta)), 1e-3, 0, False
    J, left = _jacobian(outputs, y, theta, beta)
    for _ in range(_STEPS):
        weight = np.linalg.inv(spread(left))
        weighted = J.reshape(-1, J.shape[2]).T @ (weight @ J).reshape(-1, J.shape[2])
        g = np.einsum("nqa,qr,nr->a", J, weight, left, optimize=True)
        H = weighted + damping * np.diag(np.diag(weighted) + 1e-300)
        step = np.linalg.lstsq(H, g, rcond=None)[0]
        shorter = min(1.0, 1.0 / max(float(np.max(np.abs(step[:p]))), 1e-300))
        trial, free = theta + shorter * step[:p], beta + shorter * step[p:]
        parts = outputs(trial)
        if shorter < 1.0 and len(free):  # far away the linear unknowns are better found anew
            free = _linear(*parts, y, spread(left))
        after = size(y - _at(parts, free))
        if after <= now:
            small = small + 1 if 0.5 * len(y) * (now - after) < _SETTLED else 0
            theta, beta, now = trial, free, after
            damping = max(0.1 * damping, 1e-12)
            J, left = _jacobian(outputs, y, theta, beta)
        else:
            damping *= 10.0
        # damped to nothing: there is nothing to be gained in any direction
        settled = small >= _LAST or damping > 1e10
        if settled:
            break
    noise = spread(left)
    information = np.einsum("nqa,qr,nrb->ab", J, np.linalg.inv(noise), J, optimize=True)
    return Fitted(
        theta=theta,
        beta=beta,
        covariance=np.asarray(np.linalg.pinv(information, hermitian=True)),
        residual=left,
        output=y - left,
        noise=noise,
        converged=settled and bool(np.all(np.abs(theta - start) < _REACH)),
    )


def _jacobian(outputs: Model, y: Array, theta: Array, beta: Array) -> tuple[Array, Array]:
    """Differentiate the outputs: (N, q, P + L), and the residual (N, q)."""
    base, design = outputs(theta)
    columns = []
    for k in range(len(theta)):
        ahead, behind = theta.copy(), theta.copy()
        ahead[k] += _DIFFERENCE
        behind[k] -= _DIFFERENCE
        columns.append(
            (_at(outputs(ahead), beta) - _at(outputs(behind), beta)) / (2.0 * _DIFFERENCE)
        )
    J = np.concatenate([np.stack(columns, axis=2), design], axis=2)
    return J, y - _at((base, design), beta)


def _at(parts: tuple[Array, Array], beta: Array) -> Array:
    base, design = parts
    return np.asarray(base + design @ beta)


def _linear(base: Array, design: Array, y: Array, noise: Array) -> Array:
    """Best linear unknowns (L,) at one θ."""
    if design.shape[2] == 0:
        return np.zeros(0)
    root = np.linalg.inv(np.linalg.cholesky(noise))
    X = np.einsum("qr,nrl->nql", root, design).reshape(-1, design.shape[2])
    z = ((y - base) @ root.T).ravel()
    return np.asarray(np.linalg.lstsq(X, z, rcond=None)[0])
