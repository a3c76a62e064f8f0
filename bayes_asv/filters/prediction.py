"""Prediction step of a linear state-space model with smooth inputs, compiled into each filter.

The model of one recording, over a step of length h that ends at an instant of observation::

    x⁺ = Φ x + ∫ Φ(h−s) B û(s) ds − Γ (N d + w) + white noise      Φ = exp(A h),  Γ = ∫ Φ(s) B ds
    w⁺ = ρ w + …      d⁺ = d      b⁺ = b      v⁺ = ρ v + …

û is a spline through the measured inputs, entered through its moments ∫ (h−s)ʲ/j! û(s) ds; d are
the biases of the input sensors along the columns of N, w and v the noise that passed the filters of
input and output sensors, b the biases of the outputs.  The order of the filter's state is
(x, d, w, b, v); the first three groups drive x, so Φ, Γ N and Γ stand side by side in ``carry``.

Every array ends in an axis of L lanes, each of which holds one set of parameters: the compiler
takes lanes side by side.  Sizes are arguments that each filter fixes when it is compiled.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = [
    "INLINE", "IN_PLACE", "OPTIONS", "ORDER", "TAYLOR", "advance_mean", "decays", "discretize",
    "power_series", "predict_covariance",
]  # fmt: skip

ORDER = 8
"""Input moments that are kept; with `TAYLOR` it bounds the step, see the time line."""
TAYLOR = 12
"""Powers of A h that are kept."""

OPTIONS = {"cache": True, "nogil": True, "fastmath": {"contract"}, "error_model": "numpy"}
INLINE = {**OPTIONS, "forceinline": True}
"""Of functions whose sizes become constants of the filter that calls them."""
IN_PLACE = {**OPTIONS, "inline": "always"}
"""Of functions that become part of the filter that calls them before anything is optimised."""

Array = NDArray[np.float64]


@njit(**INLINE)
def power_series(
    nx: int, nu: int, lanes: int, A: Array, B: Array, powers: Array, drive: Array
) -> None:
    """Fill Aʲ/j! (TAYLOR + 1, nx, nx, L) and Aʲ B (nu, ORDER, nx, L)."""
    for a in range(nx):
        for b in range(nx):
            for q in range(lanes):
                powers[0, a, b, q] = 1.0 if a == b else 0.0
    for j in range(1, TAYLOR + 1):
        for a in range(nx):
            for b in range(nx):
                for q in range(lanes):
                    total = 0.0
                    for c in range(nx):
                        total += A[a, c, q] * powers[j - 1, c, b, q]
                    powers[j, a, b, q] = total / j
    factorial = 1.0
    for j in range(ORDER):
        if j > 0:
            factorial *= j
        for u in range(nu):
            for a in range(nx):
                for q in range(lanes):
                    total = 0.0
                    for c in range(nx):
                        total += powers[j, a, c, q] * B[c, u, q]
                    drive[u, j, a, q] = total * factorial


@njit(**INLINE)
def discretize(
    nx: int,
    nd: int,
    nu: int,
    ahead: int,
    lanes: int,
    h: float,
    powers: Array,
    B: Array,
    N: Array,
    carry: Array,
    Q: Array,
    work: Array,
    impulse: Array,
) -> None:
    """Fill what one step of length h needs.

    ``carry`` (…, ahead + nd + nu, L) gets Φ, −Γ N and −Γ in its first nx rows, ``Q``
    (nu, nx, nx, L) ∫ Φ B Bᵀ Φᵀ ds for each input by two-point Gauss quadrature, exact to the
    fourth power of h.
    Columns nx … ahead of ``carry`` are left alone.  ``work`` (nx, nx, L) and ``impulse``
    (nx, nu, L) are room to work in.
    """
    for a in range(nx):
        for b in range(nx):
            for q in range(lanes):
                carry[a, b, q] = powers[TAYLOR, a, b, q]
                work[a, b, q] = powers[TAYLOR, a, b, q] * (h / (TAYLOR + 1))
    for j in range(TAYLOR - 1, -1, -1):
        for a in range(nx):
            for b in range(nx):
                for q in range(lanes):
                    carry[a, b, q] = carry[a, b, q] * h + powers[j, a, b, q]
                    work[a, b, q] = (work[a, b, q] + powers[j, a, b, q] / (j + 1)) * h
    for a in range(nx):
        for u in range(nu):
            for q in range(lanes):
                total = 0.0
                for c in range(nx):
                    total -= work[a, c, q] * B[c, u, q]
                carry[a, ahead + nd + u, q] = total
        for d in range(nd):
            for q in range(lanes):
                total = 0.0
                for u in range(nu):
                    total += carry[a, ahead + nd + u, q] * N[u, d]
                carry[a, ahead + d, q] = total
    Q[:] = 0.0
    for g in range(2):
        s = h * (0.5 + (g - 0.5) / math.sqrt(3.0))
        for a in range(nx):
            for b in range(nx):
                for q in range(lanes):
                    work[a, b, q] = powers[TAYLOR, a, b, q]
        for j in range(TAYLOR - 1, -1, -1):
            for a in range(nx):
                for b in range(nx):
                    for q in range(lanes):
                        work[a, b, q] = work[a, b, q] * s + powers[j, a, b, q]
        for a in range(nx):
            for u in range(nu):
                for q in range(lanes):
                    total = 0.0
                    for c in range(nx):
                        total += work[a, c, q] * B[c, u, q]
                    impulse[a, u, q] = total
        for u in range(nu):
            for a in range(nx):
                for b in range(nx):
                    for q in range(lanes):
                        Q[u, a, b, q] += 0.5 * h * impulse[a, u, q] * impulse[b, u, q]


@njit(**INLINE)
def decays(
    coupled: int, nu: int, ny: int, lanes: int, h: float, poles: Array, decay: Array
) -> None:
    """Fill what a step of length h leaves of filtered noise, exp(−λ h), in ``decay`` (n, L).

    ``poles`` (nu + ny, L) are those of inputs, then outputs; biases keep one.
    """
    for u in range(nu):
        for q in range(lanes):
            decay[coupled - nu + u, q] = math.exp(-poles[u, q] * h)
    for y in range(ny):
        for q in range(lanes):
            decay[coupled + ny + y, q] = math.exp(-poles[nu + y, q] * h)


@njit(**INLINE)
def advance_mean(
    nx: int,
    nu: int,
    rows: int,
    coupled: int,
    lanes: int,
    carry: Array,
    drive: Array,
    k: int,
    moments: Array,
    mean: Array,
    ahead: Array,
) -> None:
    """Fill ``ahead`` (rows, L), the mean of the first rows of the state after step k.

    ``moments`` (N, nu, ORDER) are those of the inputs over all steps.
    """
    for a in range(rows):
        for q in range(lanes):
            total = 0.0
            for c in range(nx):
                total += carry[a, c, q] * mean[c, q]
            for c in range(nx, rows):
                total += carry[a, c, q] * mean[c, q]
            for c in range(rows, coupled):
                total += carry[a, c, q] * mean[c, q]
            ahead[a, q] = total
    for a in range(nx):
        for u in range(nu):
            for q in range(lanes):
                total = ahead[a, q]
                for j in range(ORDER):
                    total += drive[u, j, a, q] * moments[k, u, j]
                ahead[a, q] = total


@njit(**INLINE)
def predict_covariance(
    nx: int,
    nu: int,
    ny: int,
    rows: int,
    coupled: int,
    lanes: int,
    carry: Array,
    Q: Array,
    decay: Array,
    intensity: Array,
    filtered: Array,
    P: Array,
    T: Array,
) -> None:
    """Carry the covariance P (n, n, L) over one step in place.

    Parameters
    ----------
    nx, nu, ny, rows, coupled, lanes : int
        States of the car, inputs, outputs; states that are carried by a full matrix (nx, and the
        filtered forces of a nonlinear car behind them); states that drive those; lanes.
    carry : (rows, coupled, L) array
        From the first states to the carried ones.
    Q : (nu, nx, nx, L) array
        Covariance for an input of unit intensity.
    decay : (n, L) array
        What is left of each of the other states.
    intensity : (nu, L) array
        Of the white noise of each input, m²/s³.
    filtered : (nu + ny, L) array
        Stationary variances of the filtered noise.
    P, T : (n, n, L) and (rows, n, L) arrays
        Covariance, and room to work in.
    """
    n = coupled + 2 * ny
    for a in range(rows):
        for b in range(n):
            for q in range(lanes):
                total = 0.0
                for c in range(nx):  # short loops, which the compiler unrolls
                    total += carry[a, c, q] * P[c, b, q]
                for c in range(nx, rows):
                    total += carry[a, c, q] * P[c, b, q]
                for c in range(rows, coupled):
                    total += carry[a, c, q] * P[c, b, q]
                T[a, b, q] = total
    for a in range(rows):
        for b in range(a, nx):
            for q in range(lanes):
                total = 0.0
                for c in range(nx):
                    total += T[a, c, q] * carry[b, c, q]
                for c in range(nx, rows):
                    total += T[a, c, q] * carry[b, c, q]
                for c in range(rows, coupled):
                    total += T[a, c, q] * carry[b, c, q]
                for u in range(nu):
                    total += intensity[u, q] * Q[u, a, b, q]
                P[a, b, q] = total
                P[b, a, q] = total
        for b in range(max(a, nx), rows):
            for q in range(lanes):
                total = 0.0
                for c in range(nx):
                    total += T[a, c, q] * carry[b, c, q]
                for c in range(nx, rows):
                    total += T[a, c, q] * carry[b, c, q]
                for c in range(rows, coupled):
                    total += T[a, c, q] * carry[b, c, q]
                P[a, b, q] = total
                P[b, a, q] = total
        for b in range(rows, n):
            for q in range(lanes):
                value = T[a, b, q] * decay[b, q]
                P[a, b, q] = value
                P[b, a, q] = value
    for a in range(rows, n):
        for b in range(rows, n):
            for q in range(lanes):
                P[a, b, q] *= decay[a, q] * decay[b, q]
    for u in range(nu):
        k = coupled - nu + u
        for q in range(lanes):
            P[k, k, q] += filtered[u, q] * (1.0 - decay[k, q] * decay[k, q])
    for y in range(ny):
        k = coupled + ny + y
        for q in range(lanes):
            P[k, k, q] += filtered[nu + y, q] * (1.0 - decay[k, q] * decay[k, q])
