"""The innovations recursion where noise has a colour that an autoregression describes.

The filter of :mod:`.innovations` knows white noise and noise that passed a sensor's filter.
What else there is (a panel that rings, a road that is not flat from side to side) is in its
innovations ν.  A vector autoregression takes it out; its first coefficient is one, so the
likelihood of what it leaves is that of the readings.

With such noise the first filter must not settle its initial state on the first readings, which
it believes to be far better than they are.  It starts from a certain state instead, and the
innovations' derivatives by initial state and biases run beside it, through both filters; being
linear, these six are integrated out at the end (Rosenberg 1973; de Jong 1991).  A reading at
its rail is left out here.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.discretization import (
    OPTIONS,
    ORDER,
    TAYLOR,
    advance,
    project,
    series,
    transition,
)

__all__ = ["log_likelihood", "residuals"]

_LOG_2PI = math.log(2.0 * math.pi)
_VALUE = 1
_UNKNOWN = 6  # initial state and biases
_SERIES = 1 + _UNKNOWN  # the readings', and those of each unknown

Array = NDArray[np.float64]


@njit(**OPTIONS)
def _take_autoregression(
    seen: NDArray[np.bool_],
    nu: Array,
    ar: Array,
    root: Array,
    lone: float,
    history: Array,
    w: Array,
) -> None:
    """Whiten a pair ν (2, 7) into w (2, 7); what is missing is remembered as predicted."""
    lags = ar.shape[0]
    for q in range(_SERIES):
        p0 = 0.0
        p1 = 0.0
        for j in range(lags):
            p0 += ar[j, 0, 0] * history[j, 0, q] + ar[j, 0, 1] * history[j, 1, q]
            p1 += ar[j, 1, 0] * history[j, 0, q] + ar[j, 1, 1] * history[j, 1, q]
        for j in range(lags - 1, 0, -1):
            history[j, 0, q] = history[j - 1, 0, q]
            history[j, 1, q] = history[j - 1, 1, q]
        if lags > 0:
            history[0, 0, q] = nu[0, q] if seen[0] else p0
            history[0, 1, q] = nu[1, q] if seen[1] else p1
        if seen[0]:
            w[0, q] = root[0, 0] * (nu[0, q] - p0)
        if seen[1]:
            if seen[0]:
                w[1, q] = root[1, 0] * (nu[0, q] - p0) + root[1, 1] * (nu[1, q] - p1)
            else:
                w[1, q] = lone * (nu[1, q] - p1)


@njit(**OPTIONS)
def _solve(G: Array, right: Array, solution: Array) -> float:
    """Solve G β = right for a positive definite G (6, 6), overwritten; return log det G."""
    n = G.shape[0]
    log_det = 0.0
    for a in range(n):
        for b in range(a + 1):
            acc = G[a, b]
            for c in range(b):
                acc -= G[a, c] * G[b, c]
            if a == b:
                G[a, a] = math.sqrt(acc)
                log_det += 2.0 * math.log(G[a, a])
            else:
                G[a, b] = acc / G[b, b]
    for a in range(n):
        acc = right[a]
        for c in range(a):
            acc -= G[a, c] * solution[c]
        solution[a] = acc / G[a, a]
    for a in range(n - 1, -1, -1):
        acc = solution[a]
        for c in range(a + 1, n):
            acc -= G[c, a] * solution[c]
        solution[a] = acc / G[a, a]
    return log_det


@njit(**OPTIONS)
def _run(
    car: Array,
    noise: Array,
    step: Array,
    moments: Array,
    spread: Array,
    kind: NDArray[np.int8],
    reading: Array,
    extra: Array,
    start: Array,
    closes: NDArray[np.bool_],
    ar: Array,
    ar_root: Array,
    keep: bool,
    kept: Array,
) -> float:
    """One pass; see :func:`log_likelihood` for the arguments."""
    C = np.empty((2, 4))
    powers = np.empty((TAYLOR + 1, 4, 4))
    drive = np.empty((2, ORDER, 4))
    series(car, C, powers, drive)
    slow = noise[4:8].copy()
    poles = noise[8:12].copy()

    # Column 0 is the mean of the state, the others its derivatives by the six unknowns.
    mean = np.zeros((10, _SERIES))
    P = np.zeros((10, 10))
    for a in range(_UNKNOWN):
        mean[a, 1 + a] = 1.0
    for a in range(4):
        P[6 + a, 6 + a] = slow[a]

    phi = np.zeros((4, 4))
    gamma = np.zeros((4, 2))
    qf = np.zeros((4, 4))
    qr = np.zeros((4, 4))
    decay = np.ones(6)
    T = np.empty((4, 10))
    PC = np.empty(10)
    fresh = np.empty((4, _SERIES))
    nu = np.zeros((2, _SERIES))
    w = np.zeros((2, _SERIES))
    history = np.zeros((max(ar.shape[0], 1), 2, _SERIES))
    seen = np.zeros(2, np.bool_)
    own = np.zeros(2, np.int64)
    # inverse deviation of the rear when the front is missing
    lone = ar_root[1, 1] / math.sqrt(1.0 + (ar_root[1, 0] / ar_root[0, 0]) ** 2)
    G = np.zeros((_UNKNOWN, _UNKNOWN))
    right = np.zeros(_UNKNOWN)
    solution = np.zeros(_UNKNOWN)
    store = np.zeros((step.shape[0] if keep else 0, 2, _SERIES))
    total = 0.0
    h_known = -1.0

    for k in range(step.shape[0]):
        h = step[k]
        if h > 0.0:
            if abs(h - h_known) > 1e-12:
                h_known = h
                transition(h, powers, poles, phi, gamma, qf, qr, decay)
            for a in range(4):
                for q in range(_SERIES):
                    fresh[a, q] = (
                        phi[a, 0] * mean[0, q]
                        + phi[a, 1] * mean[1, q]
                        + phi[a, 2] * mean[2, q]
                        + phi[a, 3] * mean[3, q]
                        + gamma[a, 0] * mean[6, q]
                        + gamma[a, 1] * mean[7, q]
                    )
                for j in range(ORDER):
                    fresh[a, 0] += drive[0, j, a] * moments[k, 0, j]
                    fresh[a, 0] += drive[1, j, a] * moments[k, 1, j]
            for a in range(4):
                for q in range(_SERIES):
                    mean[a, q] = fresh[a, q]
                    mean[6 + a, q] *= decay[2 + a]
            intensity_f = noise[0] * spread[k, 0] + spread[k, 2]
            intensity_r = noise[1] * spread[k, 1] + spread[k, 3]
            advance(P, T, phi, gamma, qf, qr, decay, intensity_f, intensity_r, slow)

        for axle in range(2):
            if kind[k, axle] != _VALUE:
                continue
            S = project(axle, C, P, PC) + noise[2 + axle] + extra[k, axle]
            root = math.sqrt(S)
            for q in range(_SERIES):
                left = reading[k, axle] if q == 0 else 0.0
                left -= mean[4 + axle, q] + mean[8 + axle, q]
                for a in range(4):
                    left -= C[axle, a] * mean[a, q]
                nu[axle, q] = left / root
            for a in range(10):
                for q in range(_SERIES):
                    mean[a, q] += PC[a] / root * nu[axle, q]
            seen[axle] = True
            own[axle] = k
            total -= 0.5 * (_LOG_2PI + math.log(S))
            for a in range(10):
                scaled = PC[a] / S
                for b in range(10):
                    P[a, b] -= scaled * PC[b]

        if not closes[k]:
            continue
        _take_autoregression(seen, nu, ar, ar_root, lone, history, w)
        if seen[0]:
            total += math.log(ar_root[0, 0])
        if seen[1]:
            total += math.log(ar_root[1, 1] if seen[0] else lone)
        for axle in range(2):
            if not seen[axle]:
                continue
            total -= 0.5 * w[axle, 0] * w[axle, 0]
            for a in range(_UNKNOWN):
                right[a] -= w[axle, 1 + a] * w[axle, 0]
                for b in range(a + 1):
                    G[a, b] += w[axle, 1 + a] * w[axle, 1 + b]
            if keep:
                for q in range(_SERIES):
                    store[own[axle], axle, q] = w[axle, q]
            seen[axle] = False

    for a in range(_UNKNOWN):
        G[a, a] += 1.0 / start[a]
        total -= 0.5 * math.log(start[a])
    total -= 0.5 * _solve(G, right, solution)
    for a in range(_UNKNOWN):
        total += 0.5 * solution[a] * right[a]
    if keep:
        for k in range(step.shape[0]):
            for axle in range(2):
                if kind[k, axle] == _VALUE:
                    acc = store[k, axle, 0]
                    for a in range(_UNKNOWN):
                        acc += store[k, axle, 1 + a] * solution[a]
                    kept[k, axle] = acc
    return float(total)


@njit(**OPTIONS)
def log_likelihood(
    cars: Array,
    noises: Array,
    step: Array,
    moments: Array,
    spread: Array,
    kind: NDArray[np.int8],
    reading: Array,
    extra: Array,
    start: Array,
    closes: NDArray[np.bool_],
    ar: Array,
    ar_root: Array,
    out: Array,
) -> None:
    """Add the log-likelihood of one recording for each of W parameter sets to ``out``.

    Parameters
    ----------
    cars, noises, step, moments, spread, kind, reading, extra, start : as there
        See :func:`bayes_asv.filters.kalman.log_likelihood`.
    closes : (N,) bool array
        True at the last instant of a pair of readings; two boards with two clocks make two
        instants a pair.
    ar, ar_root : (p, 2, 2) and (2, 2) arrays
        Vector autoregression on the normalised innovations, and the lower-triangular inverse
        root of the covariance of what it leaves; p = 0 for none.
    out : (W,) array
        Added to in place.
    """
    kept = np.empty((0, 2))
    for w in range(cars.shape[0]):
        out[w] += _run(
            cars[w], noises[w], step, moments, spread, kind, reading, extra, start,
            closes, ar, ar_root, False, kept,
        )  # fmt: skip


@njit(**OPTIONS)
def residuals(
    car: Array,
    noise: Array,
    step: Array,
    moments: Array,
    spread: Array,
    kind: NDArray[np.int8],
    reading: Array,
    extra: Array,
    start: Array,
    closes: NDArray[np.bool_],
    ar: Array,
    ar_root: Array,
    kept: Array,
) -> float:
    """One pass that also fills ``kept`` (N, 2) with whitened innovations; returns log p.

    They are taken at the most probable initial state and biases.  Where there is no value
    ``kept`` is left alone.
    """
    value: float = _run(
        car, noise, step, moments, spread, kind, reading, extra, start,
        closes, ar, ar_root, True, kept,
    )  # fmt: skip
    return value
