"""Arithmetic of a filter that keeps parameters and states apart, compiled.

With a reference μ, directions D (row i is direction i, zero before its i-th number) and a state
that is linear given the parameters::

    θ = μ + Dᵀ d,    d ~ N(m, Fᵀ F),    s = x + Jᵀ d + η,    η ~ N(0, Π)

F has the shape of D: Dᵀ and Fᵀ are lower triangular factors, so the parameters' covariance is
never formed and cannot lose its sign.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.discretization import OPTIONS

__all__ = ["follow", "leverage", "take", "wander"]

Array = NDArray[np.float64]


@njit(**OPTIONS)
def take(
    y: float,
    expected: float,
    g: Array,
    PC: Array,
    rest: float,
    x: Array,
    J: Array,
    m: Array,
    F: Array,
    Pi: Array,
    weight: Array,
    moved_by: Array,
    learn: bool,
) -> None:
    """Take up one reading y = expected + g d + c η + noise.

    ``PC`` is Π cᵀ and ``rest`` the variance of y given d.  ``weight`` (p,) is F g, as
    :func:`leverage` leaves it; ``moved_by`` (p,) is room to work in.  Without ``learn`` the reading
    tells of the state given the parameters, and what is believed of these stays.
    """
    p = g.shape[0]
    S = rest
    for i in range(p):
        S += weight[i] * weight[i]
    nu = y - expected
    for k in range(p):
        nu -= g[k] * m[k]
    over = 1.0 / rest
    by = (y - expected) * over
    for a in range(10):
        x[a] += PC[a] * by
    for i in range(p):
        by = g[i] * over
        for a in range(10):
            J[i, a] -= PC[a] * by
    for a in range(10):
        by = PC[a] * over
        for b in range(10):
            Pi[a, b] -= by * PC[b]
    if not learn:
        return
    # F Fᵀ − F γ γᵀ Fᵀ / S, factored anew from the last column (Carlson 1973), with no difference
    # of large numbers anywhere.
    for k in range(p):
        moved_by[k] = 0.0
    above = rest
    for i in range(p - 1, -1, -1):
        below = above
        above = below + weight[i] * weight[i]
        scale = 1.0 / math.sqrt(above * below)
        stay = below * scale
        away = weight[i] * scale
        for k in range(i, p):
            old = F[i, k]
            F[i, k] = stay * old - away * moved_by[k]
            moved_by[k] += old * weight[i]
    by = nu / S
    for k in range(p):
        m[k] += moved_by[k] * by


@njit(**OPTIONS)
def leverage(g: Array, F: Array, weight: Array) -> float:
    """Fill ``weight`` with F g; return its square, what the parameters add to the variance."""
    p = g.shape[0]
    total = 0.0
    for i in range(p):
        acc = 0.0
        for k in range(i, p):
            acc += F[i, k] * g[k]
        weight[i] = acc
        total += acc * acc
    return total


@njit(**OPTIONS)
def follow(mu: Array, D: Array, x: Array, J: Array, m: Array, F: Array) -> None:
    """Move the reference to the estimate."""
    p = mu.shape[0]
    for k in range(p):
        by = m[k]
        m[k] = 0.0
        for a in range(k, p):
            mu[a] += by * D[k, a]
        for a in range(10):
            x[a] += by * J[k, a]
    for i in range(p):
        own = F[i, i]
        for a in range(i, p):
            D[i, a] *= own
        for a in range(10):
            J[i, a] *= own
        for k in range(i + 1, p):
            share = F[i, k]
            for a in range(k, p):
                D[i, a] += share * D[k, a]
            for a in range(10):
                J[i, a] += share * J[k, a]
            F[i, k] = 0.0
        F[i, i] = 1.0


@njit(**OPTIONS)
def wander(D: Array, J: Array, Pi: Array, variance: Array) -> float:
    """Let the parameters walk: add variances (p,) to their covariance, the reference moving.

    What the state owed to the parameters as they were, it owes only in part to what they are now;
    the difference goes to Π.  Returns by how much the logarithm of the parameters' volume grew.
    """
    p = D.shape[0]
    P = np.zeros((p, p))
    fresh = np.zeros((p, p))
    for a in range(p):
        for b in range(a + 1):
            acc = variance[a] if a == b else 0.0
            for i in range(b + 1):
                acc += D[i, a] * D[i, b]
            P[a, b] = acc
    for a in range(p):  # lower Cholesky factor, kept by columns as D is
        for b in range(a + 1):
            acc = P[a, b]
            for i in range(b):
                acc -= fresh[i, a] * fresh[i, b]
            if a == b:
                fresh[a, a] = math.sqrt(acc)
            else:
                fresh[b, a] = acc / fresh[b, b]
    for a in range(10):
        for b in range(a + 1):
            acc = 0.0
            for i in range(p):
                acc += J[i, a] * J[i, b]
            Pi[a, b] += acc
            if a != b:
                Pi[b, a] = Pi[a, b]
    # J becomes T J with T = fresh⁻¹ D, both lower triangular: solved row by row from the last.
    T = np.zeros((p, p))
    for i in range(p):  # column i of T
        for a in range(i, p):
            acc = D[i, a]
            for k in range(i, a):
                acc -= fresh[k, a] * T[k, i]
            T[a, i] = acc / fresh[a, a]
    for i in range(p - 1, -1, -1):
        for a in range(10):
            acc = 0.0
            for k in range(i + 1):
                acc += T[i, k] * J[k, a]
            J[i, a] = acc
    for a in range(10):
        for b in range(a + 1):
            acc = 0.0
            for i in range(p):
                acc += J[i, a] * J[i, b]
            Pi[a, b] -= acc
            if a != b:
                Pi[b, a] = Pi[a, b]
    grown = 0.0
    for i in range(p):
        grown += math.log(fresh[i, i] / D[i, i])
        for a in range(p):
            D[i, a] = fresh[i, a]
    return grown
