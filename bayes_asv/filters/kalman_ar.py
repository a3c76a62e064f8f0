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
    STEP_LENGTHS,
    STEP_SERIES,
    TAYLOR,
    VALUE,
    decays,
    find_step,
    gained_noise,
    power_series,
    step_weights,
)
from bayes_asv.filters.vector_code import LANES, lanes_last
from bayes_asv.filters.vector_steps import (
    advance_mean_vectors,
    condition_vectors,
    discretize_vectors,
    predict_vectors,
    project_vectors,
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
def _compiled(nx: int, nd: int, nu: int, ny: int) -> Callable[..., None]:
    lanes = LANES
    coupled = nx + nd + nu
    n = coupled + 2 * ny
    unknown = nx + nd + ny
    columns = 1 + unknown  # the readings', and those of each unknown

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
        ends_group: NDArray[np.bool_],
        ar: Array,
        root: Array,
        used: int,
        keep: bool,
        total: Array,
        kept: Array,
    ) -> None:
        powers = np.empty((TAYLOR + 1, nx, nx, lanes))
        drive = np.empty((nu, ORDER, nx, lanes))
        power_series(nx, nu, lanes, A, B, powers, drive)
        # Column 0 is the mean of the state, the others its derivatives by the unknowns.
        mean = np.zeros((n, columns, lanes))
        P = np.zeros((n, n, lanes))
        for q in range(lanes):
            for a in range(nx + nd):
                mean[a, 1 + a, q] = 1.0
            for y in range(ny):
                mean[coupled + y, 1 + nx + nd + y, q] = 1.0
                P[coupled + ny + y, coupled + ny + y, q] = filtered[nu + y, q]
            for u in range(nu):
                P[nx + nd + u, nx + nd + u, q] = filtered[u, q]
        lengths = np.full(STEP_LENGTHS, -1.0)
        kept_carry = np.zeros((STEP_LENGTHS, nx, coupled, lanes))
        kept_Q = np.zeros((STEP_LENGTHS, nu, nx, nx, lanes))
        kept_decay = np.ones((STEP_LENGTHS, n, lanes))
        kept_gained = np.empty((STEP_LENGTHS, nu + ny, lanes))
        PC = np.empty((n, lanes))
        S = np.empty(lanes)
        shrink = np.empty(lanes)
        shift = np.empty((columns, lanes))
        weights = np.empty((STEP_SERIES, TAYLOR + 1))
        intensity = np.empty((nu, lanes))
        ahead = np.empty((nx, columns, lanes))
        nus = np.zeros((ny, columns, lanes))
        w = np.zeros((ny, columns, lanes))
        # whitening knows no lanes: it does the same to all columns of all lanes
        nus_flat, w_flat = nus.reshape(ny, columns * lanes), w.reshape(ny, columns * lanes)
        history = np.zeros((max(ar.shape[0], 1), ny, columns * lanes))
        there = np.zeros(ny, np.bool_)
        own = np.zeros(ny, np.int64)
        G = np.zeros((unknown, unknown, lanes))
        right = np.zeros((unknown, lanes))
        solution = np.zeros((unknown, lanes))
        store = np.zeros((step.shape[0] if keep else 0, ny, columns, used))
        jacobian = 0.0
        oldest = 0
        for k in range(step.shape[0]):
            h = step[k]
            if h > 0.0:
                slot, known, oldest = find_step(h, lengths, oldest)
                carry, Q = kept_carry[slot], kept_Q[slot]
                decay, gained = kept_decay[slot], kept_gained[slot]
                if not known:
                    step_weights(h, weights)
                    discretize_vectors(nx, nd, nu, nx, coupled, weights, powers, B, N, carry, Q)
                    decays(coupled, nu, ny, lanes, h, poles, decay)
                    gained_noise(coupled, nu, ny, lanes, filtered, decay, gained)
                advance_mean_vectors(
                    nx, nu, nx, coupled, n, columns, carry, drive, moments[k], mean, ahead
                )
                for c in range(columns):
                    for q in range(lanes):
                        for a in range(nx):
                            mean[a, c, q] = ahead[a, c, q]
                        for a in range(nx + nd, n):
                            mean[a, c, q] *= decay[a, q]
                for u in range(nu):
                    for q in range(lanes):
                        intensity[u, q] = white[u, q] * spread[k, u] + spread[k, nu + u]
                predict_vectors(nx, nu, ny, nx, coupled, carry, Q, decay, intensity, gained, P)
            for y in range(ny):
                if kind[k, y] != VALUE:
                    continue
                project_vectors(y, nx, coupled, ny, columns, C, P, mean, PC, S, shift)
                for q in range(lanes):
                    variance = S[q] + white[nu + y, q] + extra[k, y]
                    shrink[q] = 1.0 / variance
                    S[q] = 1.0 / math.sqrt(variance)
                    total[q] -= 0.5 * (LOG_2PI + math.log(variance))
                for c in range(columns):
                    for q in range(lanes):
                        left = reading[k, y] - shift[c, q] if c == 0 else -shift[c, q]
                        nus[y, c, q] = left * S[q]
                        shift[c, q] = left * shrink[q]
                condition_vectors(n, columns, PC, shift, shrink, mean, P)
                there[y] = True
                own[y] = k
            if not ends_group[k]:
                continue
            jacobian += _whiten(there, nus_flat, ar, root, history, w_flat)
            for y in range(ny):
                if not there[y]:
                    continue
                for q in range(lanes):
                    total[q] -= 0.5 * w[y, 0, q] * w[y, 0, q]
                for a in range(unknown):
                    for q in range(lanes):
                        right[a, q] -= w[y, 1 + a, q] * w[y, 0, q]
                    for b in range(a + 1):
                        for q in range(lanes):
                            G[a, b, q] += w[y, 1 + a, q] * w[y, 1 + b, q]
                if keep:
                    for c in range(columns):
                        for q in range(used):
                            store[own[y], y, c, q] = w[y, c, q]
                there[y] = False
        inverse = np.linalg.inv(start)
        jacobian += 0.5 * math.log(np.linalg.det(inverse))
        for q in range(used):
            total[q] += jacobian - 0.5 * _solve(G[:, :, q] + inverse, right[:, q], solution[:, q])
            for a in range(unknown):
                total[q] += 0.5 * solution[a, q] * right[a, q]
            if keep:
                for k in range(step.shape[0]):
                    for y in range(ny):
                        if kind[k, y] == VALUE:
                            value = store[k, y, 0, q]
                            for a in range(unknown):
                                value += store[k, y, 1 + a, q] * solution[a, q]
                            kept[q, k, y] = value

    return run  # type: ignore[no-any-return]


def _passes(
    system: StateSpace,
    noise: SensorNoise,
    data: Measurements,
    ends_group: NDArray[np.bool_],
    ar: Array,
    root: Array,
    keep: bool,
) -> tuple[Array, Array]:
    """Run all parameter sets; return log-likelihoods (W,) and what is kept (W, N, ny)."""
    W, nx, nu = system.B.shape
    run = _compiled(nx, system.N.shape[1], nu, system.C.shape[1])
    A, B, C, *noises = (lanes_last(x) for x in (system.A, system.B, system.C, *noise))
    total = np.zeros((len(A), LANES))
    kept = np.zeros((W, *data.kind.shape)) if keep else np.zeros((W, 0, 0))
    for b in range(len(A)):
        first = b * LANES
        run(
            A[b], B[b], C[b], system.N, *(x[b] for x in noises), *data, ends_group, ar, root,
            min(LANES, W - first), keep, total[b], kept[first : first + LANES],
        )  # fmt: skip
    return total.ravel()[:W], kept


def log_likelihood(
    system: StateSpace,
    noise: SensorNoise,
    data: Measurements,
    ends_group: NDArray[np.bool_],
    ar: Array,
    root: Array,
) -> Array:
    """Log-likelihood (W,) of one recording for W parameter sets.

    Parameters
    ----------
    system, noise, data : StateSpace, SensorNoise and Measurements
        As :func:`bayes_asv.filters.kalman.log_likelihood` takes them.
    ends_group : (N,) bool array
        True at the last instant of a group of readings that belong together; boards with clocks of
        their own make several instants a group.
    ar, root : (p, ny, ny) and (ny, ny) arrays
        Vector autoregression on the normalised innovations, and the lower triangular inverse root
        of the covariance of what it leaves; p = 0 for none.
    """
    return _passes(system, noise, data, ends_group, ar, root, keep=False)[0]


def innovations(
    system: StateSpace,
    noise: SensorNoise,
    data: Measurements,
    ends_group: NDArray[np.bool_],
    ar: Array,
    root: Array,
) -> Array:
    """Whitened innovations (W, N, ny) of W parameter sets, zero where there is no value.

    They are taken at the most probable initial state and biases.
    """
    return _passes(system, noise, data, ends_group, ar, root, keep=True)[1]
