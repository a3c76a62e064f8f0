"""Kalman filter followed by an autoregression that whitens its innovations.

The filter of :mod:`.kalman` knows white noise and noise that passed a sensor's filter.  Whatever
else there is (a panel that rings, a road that is not flat from side to side) is in its innovations
ν.  A vector autoregression takes it out; its first coefficient is one, so the likelihood of what it
leaves is that of the readings.

With such noise the first filter must not settle its initial state on the first readings, which it
believes to be far better than they are.  It starts from a certain state instead, and the
innovations' derivatives by initial state and biases run beside it, through both filters; being
linear, these unknowns are integrated out at the end (Rosenberg 1973; de Jong 1991).  A reading at
its rail is left out here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.kalman import Measurements, SensorNoise, StateSpace
from bayes_asv.filters.prediction import (
    LOG_2PI,
    OPTIONS,
    ORDER,
    TAYLOR,
    VALUE,
    decays,
    discretize,
    power_series,
    predict_covariance,
    project,
    sizes_of_one_type,
)

__all__ = ["innovations", "log_likelihood"]

Array = NDArray[np.float64]


@njit(**OPTIONS)
def _solve(G: Array, right: Array, solution: Array) -> float:
    """Solve G β = right for a positive definite G (m, m), overwritten; return log det G."""
    n = G.shape[0]
    log_det = 0.0
    for a in range(n):
        for b in range(a + 1):
            total = G[a, b]
            for c in range(b):
                total -= G[a, c] * G[b, c]
            if a == b:
                G[a, a] = math.sqrt(total)
                log_det += 2.0 * math.log(G[a, a])
            else:
                G[a, b] = total / G[b, b]
    for a in range(n):
        total = right[a]
        for c in range(a):
            total -= G[a, c] * solution[c]
        solution[a] = total / G[a, a]
    for a in range(n - 1, -1, -1):
        total = solution[a]
        for c in range(a + 1, n):
            total -= G[c, a] * solution[c]
        solution[a] = total / G[a, a]
    return log_det


@njit(**OPTIONS)
def _whiten(
    there: NDArray[np.bool_], nu: Array, ar: Array, root: Array, history: Array, w: Array
) -> float:
    """Whiten one group of innovations ν (ny, R) into w (ny, R); return the log of its Jacobian.

    ``root`` (ny, ny) is the lower triangular inverse root of the covariance of what the
    autoregression leaves.  A missing innovation is remembered as predicted; what is there is
    whitened with the root of its own marginal covariance.
    """
    ny, series = nu.shape
    lags = ar.shape[0]
    left = np.empty((ny, series))
    for q in range(series):
        for y in range(ny):
            predicted = 0.0
            for j in range(lags):
                for z in range(ny):
                    predicted += ar[j, y, z] * history[j, z, q]
            left[y, q] = predicted
        for j in range(lags - 1, 0, -1):
            for y in range(ny):
                history[j, y, q] = history[j - 1, y, q]
        for y in range(ny):
            if lags > 0:
                history[0, y, q] = nu[y, q] if there[y] else left[y, q]
            left[y, q] = nu[y, q] - left[y, q]
    log_jacobian = 0.0
    count = 0
    for y in range(ny):
        count += there[y]
    if count == ny:
        for y in range(ny):
            log_jacobian += math.log(root[y, y])
            for q in range(series):
                total = 0.0
                for z in range(y + 1):
                    total += root[y, z] * left[z, q]
                w[y, q] = total
        return log_jacobian
    covariance = np.linalg.inv(root)
    covariance = covariance @ covariance.T
    factor = np.zeros((ny, ny))
    for y in range(ny):  # Cholesky factor of the part that is there, solved as it is built
        if not there[y]:
            continue
        for z in range(y + 1):
            if not there[z]:
                continue
            total = covariance[y, z]
            for c in range(z):
                if there[c]:
                    total -= factor[y, c] * factor[z, c]
            factor[y, z] = math.sqrt(total) if y == z else total / factor[z, z]
        log_jacobian -= math.log(factor[y, y])
        for q in range(series):
            total = left[y, q]
            for c in range(y):
                if there[c]:
                    total -= factor[y, c] * w[c, q]
            w[y, q] = total / factor[y, y]
    return log_jacobian


@lru_cache(maxsize=64)
def _compiled(nx: int, nd: int, nu: int, ny: int) -> Callable[..., float]:
    nx, nd, nu, ny = sizes_of_one_type(nx, nd, nu, ny)
    coupled = nx + nd + nu
    n = coupled + 2 * ny
    unknown = nx + nd + ny
    series = 1 + unknown  # the readings', and those of each unknown

    @njit(**OPTIONS)
    def run(
        A: Array,
        B: Array,
        C: Array,
        N: Array,
        white: Array,
        filtered: Array,
        poles: Array,
        step: Array,
        moments: Array,
        spread: Array,
        kind: NDArray[np.int8],
        reading: Array,
        extra: Array,
        start: Array,
        closes: NDArray[np.bool_],
        ar: Array,
        root: Array,
        keep: bool,
        kept: Array,
    ) -> float:
        powers = np.empty((TAYLOR + 1, nx, nx, 1))
        drive = np.empty((nu, ORDER, nx, 1))
        power_series(nx, nu, 1, A, B, powers, drive)
        # Column 0 is the mean of the state, the others its derivatives by the unknowns.
        mean = np.zeros((n, series))
        P = np.zeros((n, n, 1))
        for a in range(nx + nd):
            mean[a, 1 + a] = 1.0
        for y in range(ny):
            mean[coupled + y, 1 + nx + nd + y] = 1.0
            P[coupled + ny + y, coupled + ny + y, 0] = filtered[nu + y, 0]
        for u in range(nu):
            P[nx + nd + u, nx + nd + u, 0] = filtered[u, 0]
        carry = np.zeros((nx, coupled, 1))
        Q = np.zeros((nu, nx, nx, 1))
        decay = np.ones((n, 1))
        T = np.empty((nx, n, 1))
        PC = np.empty((n, 1))
        S = np.empty(1)
        work = np.empty((nx, nx, 1))
        impulse = np.empty((nx, nu, 1))
        intensity = np.empty((nu, 1))
        ahead = np.empty((nx, series))
        nus = np.zeros((ny, series))
        w = np.zeros((ny, series))
        history = np.zeros((max(ar.shape[0], 1), ny, series))
        there = np.zeros(ny, np.bool_)
        own = np.zeros(ny, np.int64)
        G = np.zeros((unknown, unknown))
        right = np.zeros(unknown)
        solution = np.zeros(unknown)
        store = np.zeros((step.shape[0] if keep else 0, ny, series))
        total = 0.0
        h_known = -1.0
        for k in range(step.shape[0]):
            h = step[k]
            if h > 0.0:
                if abs(h - h_known) > 1e-12:
                    h_known = h
                    discretize(nx, nd, nu, nx, 1, h, powers, B, N, carry, Q, work, impulse)
                    decays(coupled, nu, ny, 1, h, poles, decay)
                for a in range(nx):
                    for q in range(series):
                        value = 0.0
                        for c in range(coupled):
                            value += carry[a, c, 0] * mean[c, q]
                        ahead[a, q] = value
                    for u in range(nu):
                        for j in range(ORDER):
                            ahead[a, 0] += drive[u, j, a, 0] * moments[k, u, j]
                for q in range(series):
                    for a in range(nx):
                        mean[a, q] = ahead[a, q]
                    for a in range(nx, n):
                        mean[a, q] *= decay[a, 0]
                for u in range(nu):
                    intensity[u, 0] = white[u, 0] * spread[k, u] + spread[k, nu + u]
                predict_covariance(
                    nx, nu, ny, nx, coupled, 1, carry, Q, decay, intensity, filtered, P, T
                )
            for y in range(ny):
                if kind[k, y] != VALUE:
                    continue
                project(y, nx, coupled, ny, 1, C, P, PC, S)
                variance = S[0] + white[nu + y, 0] + extra[k, y]
                deviation = math.sqrt(variance)
                for q in range(series):
                    left = reading[k, y] if q == 0 else 0.0
                    left -= mean[coupled + y, q] + mean[coupled + ny + y, q]
                    for a in range(nx):
                        left -= C[y, a, 0] * mean[a, q]
                    nus[y, q] = left / deviation
                for a in range(n):
                    for q in range(series):
                        mean[a, q] += PC[a, 0] / deviation * nus[y, q]
                there[y] = True
                own[y] = k
                total -= 0.5 * (LOG_2PI + math.log(variance))
                for a in range(n):
                    for b in range(n):
                        P[a, b, 0] -= PC[a, 0] / variance * PC[b, 0]
            if not closes[k]:
                continue
            total += _whiten(there, nus, ar, root, history, w)
            for y in range(ny):
                if not there[y]:
                    continue
                total -= 0.5 * w[y, 0] * w[y, 0]
                for a in range(unknown):
                    right[a] -= w[y, 1 + a] * w[y, 0]
                    for b in range(a + 1):
                        G[a, b] += w[y, 1 + a] * w[y, 1 + b]
                if keep:
                    for q in range(series):
                        store[own[y], y, q] = w[y, q]
                there[y] = False
        inverse = np.linalg.inv(start)
        for a in range(unknown):
            for b in range(a + 1):
                G[a, b] += inverse[a, b]
        total += 0.5 * math.log(np.linalg.det(inverse)) - 0.5 * _solve(G, right, solution)
        for a in range(unknown):
            total += 0.5 * solution[a] * right[a]
        if keep:
            for k in range(step.shape[0]):
                for y in range(ny):
                    if kind[k, y] == VALUE:
                        value = store[k, y, 0]
                        for a in range(unknown):
                            value += store[k, y, 1 + a] * solution[a]
                        kept[k, y] = value
        return float(total)

    return run  # type: ignore[no-any-return]


def _pass(
    system: StateSpace,
    noise: SensorNoise,
    data: Measurements,
    closes: NDArray[np.bool_],
    ar: Array,
    root: Array,
    k: int,
    kept: Array,
) -> float:
    """Run parameter set k; innovations are kept where ``kept`` (N, ny) has room."""
    _, nx, nu = system.B.shape
    run = _compiled(nx, system.N.shape[1], nu, system.C.shape[1])
    one = [np.ascontiguousarray(x[k, ..., None]) for x in (system.A, system.B, system.C, *noise)]
    return float(run(*one[:3], system.N, *one[3:], *data, closes, ar, root, len(kept) > 0, kept))


def log_likelihood(
    system: StateSpace,
    noise: SensorNoise,
    data: Measurements,
    closes: NDArray[np.bool_],
    ar: Array,
    root: Array,
) -> Array:
    """Log-likelihood (W,) of one recording for W parameter sets.

    Parameters
    ----------
    system, noise, data : StateSpace, SensorNoise and Measurements
        As :func:`bayes_asv.filters.kalman.log_likelihood` takes them.
    closes : (N,) bool array
        True at the last instant of a group of readings that belong together; boards with clocks of
        their own make several instants a group.
    ar, root : (p, ny, ny) and (ny, ny) arrays
        Vector autoregression on the normalised innovations, and the lower triangular inverse root
        of the covariance of what it leaves; p = 0 for none.
    """
    nothing = np.zeros((0, 0))
    return np.array(
        [_pass(system, noise, data, closes, ar, root, k, nothing) for k in range(len(system.A))]
    )


def innovations(
    system: StateSpace,
    noise: SensorNoise,
    data: Measurements,
    closes: NDArray[np.bool_],
    ar: Array,
    root: Array,
) -> Array:
    """Whitened innovations (N, ny) of the first parameter set, zero where there is no value.

    They are taken at the most probable initial state and biases.
    """
    kept = np.zeros(data.kind.shape)
    _pass(system, noise, data, closes, ar, root, 0, kept)
    return kept
