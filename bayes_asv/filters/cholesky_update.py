"""Filter updates in factored covariance form, with parameters and state kept apart.

With a reference μ, directions D (row i is direction i, zero before its i-th element) and a state
that is linear given the parameters::

    θ = μ + Dᵀ d,    d ~ N(m, Fᵀ F),    s = x + Jᵀ d + η,    η ~ N(0, Π)

F is triangular like D: Dᵀ and Fᵀ are lower Cholesky factors, so that the covariance of the
parameters is never formed and stays positive.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.prediction import IN_PLACE, INLINE

__all__ = [
    "FARTHEST", "add_parameter_noise", "measurement_update", "parameter_variance", "recentre",
]  # fmt: skip

Array = NDArray[np.float64]

FARTHEST = 10.0
"""Prior standard deviations from its centre at which a coordinate stops."""


@njit(**IN_PLACE)
def measurement_update(
    ns: int,
    y: float,
    predicted: float,
    g: Array,
    PC: Array,
    variance_given_d: float,
    x: Array,
    J: Array,
    m: Array,
    F: Array,
    Pi: Array,
    Fg: Array,
    workspace: Array,
    learn: bool,
) -> None:
    """Condition on one reading y = predicted + g d + c η + noise.

    Parameters
    ----------
    ns : int
        Number of states.
    y, predicted : float
        Reading, and its mean at d = 0.
    g : (p,) array
        Derivatives of the reading by d.
    PC : (ns,) array
        Π cᵀ.
    variance_given_d : float
        Variance of y given d.
    x, J, m, F, Pi : arrays
        Belief; changed in place.
    Fg : (p,) array
        F g, from :func:`parameter_variance`.
    workspace : (p,) array
        Workspace.
    learn : bool
        Whether d is updated as well; otherwise the state given d alone.
    """
    p = g.shape[0]
    S = variance_given_d
    for i in range(p):
        S += Fg[i] * Fg[i]
    nu = y - predicted
    for k in range(p):
        nu -= g[k] * m[k]
    over = 1.0 / variance_given_d
    by = (y - predicted) * over
    for a in range(ns):
        x[a] += PC[a] * by
    for i in range(p):
        by = g[i] * over
        for a in range(ns):
            J[i, a] -= PC[a] * by
    for a in range(ns):
        by = PC[a] * over
        for b in range(ns):
            Pi[a, b] -= by * PC[b]
    if not learn:
        return
    # The covariance of d becomes Fᵀ (1 − F g gᵀ Fᵀ / S) F; the bracket is factored from its last
    # column, without cancellation (Carlson 1973).
    for k in range(p):
        workspace[k] = 0.0
    partial = variance_given_d
    for i in range(p - 1, -1, -1):
        previous = partial
        partial = previous + Fg[i] * Fg[i]
        scale = 1.0 / math.sqrt(partial * previous)
        keep = previous * scale
        gain = Fg[i] * scale
        for k in range(i, p):
            old = F[i, k]
            F[i, k] = keep * old - gain * workspace[k]
            workspace[k] += old * Fg[i]
    by = nu / S
    for k in range(p):
        m[k] += workspace[k] * by


@njit(**INLINE)
def parameter_variance(g: Array, F: Array, Fg: Array) -> float:
    """Fill ``Fg`` with F g; return its squared norm, the reading's variance due to d."""
    p = g.shape[0]
    total = 0.0
    for i in range(p):
        acc = 0.0
        for k in range(i, p):
            acc += F[i, k] * g[k]
        Fg[i] = acc
        total += acc * acc
    return total


@njit(**INLINE)
def recentre(ns: int, mu: Array, D: Array, x: Array, J: Array, m: Array, F: Array) -> None:
    """Move the reference to the estimate, or towards it as far as no coordinate leaves `FARTHEST`.

    Readings of a broken sensor would else drive a parameter to where numbers overflow.
    """
    p = mu.shape[0]
    share = 1.0
    for a in range(p):
        move = 0.0
        for k in range(a + 1):
            move += m[k] * D[k, a]
        room = max(FARTHEST - mu[a] if move > 0.0 else FARTHEST + mu[a], 0.0)
        if abs(move) > room:
            share = min(share, room / abs(move))
    for k in range(p):
        by = share * m[k]
        m[k] = 0.0
        for a in range(k, p):
            mu[a] += by * D[k, a]
        for a in range(ns):
            x[a] += by * J[k, a]
    for i in range(p):
        own = F[i, i]
        for a in range(i, p):
            D[i, a] *= own
        for a in range(ns):
            J[i, a] *= own
        for k in range(i + 1, p):
            share = F[i, k]
            for a in range(k, p):
                D[i, a] += share * D[k, a]
            for a in range(ns):
                J[i, a] += share * J[k, a]
            F[i, k] = 0.0
        F[i, i] = 1.0


@njit(**INLINE)
def add_parameter_noise(ns: int, D: Array, J: Array, Pi: Array, variance: Array) -> float:
    """Add process noise to the parameters, the reference being at the estimate.

    The regression of the state on the parameters shrinks, and its residual goes to Π, so that the
    covariance of the state and its covariance with the parameters do not change.

    Parameters
    ----------
    ns : int
        Number of states.
    D, J, Pi : arrays
        Belief; changed in place.
    variance : (p,) array
        Variance to be added to each coordinate.

    Returns
    -------
    float
        Increase of the log-volume, Σ log D_ii.
    """
    p = D.shape[0]
    P = np.zeros((p, p))
    factor = np.zeros((p, p))
    for a in range(p):
        for b in range(a + 1):
            acc = variance[a] if a == b else 0.0
            for i in range(b + 1):
                acc += D[i, a] * D[i, b]
            P[a, b] = acc
    for a in range(p):  # lower Cholesky factor, stored by columns like D
        for b in range(a + 1):
            acc = P[a, b]
            for i in range(b):
                acc -= factor[i, a] * factor[i, b]
            if a == b:
                factor[a, a] = math.sqrt(acc)
            else:
                factor[b, a] = acc / factor[b, b]
    for a in range(ns):
        for b in range(a + 1):
            acc = 0.0
            for i in range(p):
                acc += J[i, a] * J[i, b]
            Pi[a, b] += acc
            if a != b:
                Pi[b, a] = Pi[a, b]
    # J becomes T J with D_newᵀ T = Dᵀ, all lower triangular: computed from the last row upwards.
    T = np.zeros((p, p))
    for i in range(p):  # column i of T
        for a in range(i, p):
            acc = D[i, a]
            for k in range(i, a):
                acc -= factor[k, a] * T[k, i]
            T[a, i] = acc / factor[a, a]
    for i in range(p - 1, -1, -1):
        for a in range(ns):
            acc = 0.0
            for k in range(i + 1):
                acc += T[i, k] * J[k, a]
            J[i, a] = acc
    for a in range(ns):
        for b in range(a + 1):
            acc = 0.0
            for i in range(p):
                acc += J[i, a] * J[i, b]
            Pi[a, b] -= acc
            if a != b:
                Pi[b, a] = Pi[a, b]
    growth = 0.0
    for i in range(p):
        growth += math.log(factor[i, i] / D[i, i])
        for a in range(p):
            D[i, a] = factor[i, a]
    return growth
