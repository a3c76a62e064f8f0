"""The innovations recursion of the car that rolls, compiled.

The model of :mod:`.innovations` with four wheels and three chassis channels.  For one recording
(a step of length h ends at an instant of observation)::

    x = (δ, δ̇) of four corners      x⁺ = Φ x + ∫ Φ(h−s) B û(s) ds + Γ (n d + w) + white
    d = bias of the wheel sensors along n, which no motion of the chassis follows     d⁺ = d
    b = bias of each chassis channel against the wheel channels                       b⁺ = b
    w, v = noise that passed the filters of wheel and chassis sensors                 w⁺ = ρ w + …
    y = C x + b + v + white, variance r

The state of the filter is (x, b, d, w, v), nineteen in all.  Of the seven biases the other three
are taken up by b: accelerations of a whole rigid chassis, added to all channels alike, leave the
relation between them as it is.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.discretization import OPTIONS, ORDER, TAYLOR
from bayes_asv.filters.kalman import AT_LEAST, MISSING, VALUE
from bayes_asv.filters.tails import upper_tail

__all__ = ["STATES", "rolling_pass"]

STATES = 19
_X, _Y, _U = 8, 3, 4  # states of the car, chassis channels, wheels
_B, _D, _W, _V = 8, 11, 12, 16  # where biases, drift and filtered noise begin
_LOG_2PI = math.log(2.0 * math.pi)

Array = NDArray[np.float64]


@njit(**OPTIONS)
def _transition(h: float, powers: Array, phi: Array, gamma: Array, q: Array) -> None:
    """Fill Φ(h) (8, 8), ∫ Φ e ds (8, 4) and ∫ Φ e eᵀ Φᵀ ds (4, 8, 8), e the unit vectors of δ̇."""
    fresh = np.empty((_X, _U))
    for a in range(_X):
        for b in range(_X):
            acc = powers[TAYLOR, a, b]
            for j in range(TAYLOR - 1, -1, -1):
                acc = acc * h + powers[j, a, b]
            phi[a, b] = acc
        for b in range(_U):
            acc = powers[TAYLOR, a, _U + b] / (TAYLOR + 1)
            for j in range(TAYLOR - 1, -1, -1):
                acc = acc * h + powers[j, a, _U + b] / (j + 1)
            gamma[a, b] = acc * h
    # The integral by two-point Gauss: exact to the fourth power of h.
    q[:] = 0.0
    for g in range(2):
        s = h * (0.5 + (g - 0.5) / math.sqrt(3.0))
        for a in range(_X):
            for b in range(_U):
                acc = powers[TAYLOR, a, _U + b]
                for j in range(TAYLOR - 1, -1, -1):
                    acc = acc * s + powers[j, a, _U + b]
                fresh[a, b] = acc
        for b in range(_U):
            for a in range(_X):
                for c in range(_X):
                    q[b, a, c] += 0.5 * h * fresh[a, b] * fresh[c, b]


@njit(**OPTIONS)
def _advance(P: Array, T: Array, carry: Array, decay: Array, q: Array, intensity: Array) -> None:
    """Carry P (19, 19) over one step in place.

    ``carry`` (8, 19) takes the whole state to the car's, ``decay`` (19,) is what is left of each
    of the others, and T (8, 19) is room to work in.
    """
    for a in range(_X):
        for b in range(STATES):
            T[a, b] = 0.0
        for c in range(STATES):
            weight = carry[a, c]
            if weight != 0.0:
                for b in range(STATES):
                    T[a, b] += weight * P[c, b]
    for a in range(_X):
        for b in range(a, _X):
            acc = 0.0
            for c in range(STATES):
                acc += T[a, c] * carry[b, c]
            for u in range(_U):
                acc += intensity[u] * q[u, a, b]
            P[a, b] = acc
            P[b, a] = acc
        for b in range(_X, STATES):
            acc = T[a, b] * decay[b]
            P[a, b] = acc
            P[b, a] = acc
    for a in range(_X, STATES):
        for b in range(_X, STATES):
            P[a, b] *= decay[a] * decay[b]


@njit(**OPTIONS)
def rolling_pass(
    A: Array,
    C: Array,
    n: Array,
    noise: Array,
    poles: Array,
    step: Array,
    moments: Array,
    spread: Array,
    kind: NDArray[np.int8],
    reading: Array,
    start: Array,
    nu: Array,
    logs: Array,
) -> float:
    """Log-likelihood of one recording for one car.

    Parameters
    ----------
    A : (8, 8) array
        ẋ = A x − (0, ü), x = (δ, δ̇), SI units.
    C : (3, 8) array
        Chassis accelerations per state.
    n : (4,) array
        Unit vector of wheel motion that no chassis follows.
    noise : (2, 7) array
        Variances (m²/s⁴) of one sample, white and filtered, wheels before chassis.
    poles : (7,) array
        Of the sensors' filters, rad/s.
    step : (N,) array
        Time since the instant before, s; zero for the first.
    moments : (N, 4, ORDER) array
        ∫₀ʰ (h−s)ʲ/j! û(s) ds of the wheel accelerations over each step.
    spread : (N, 8) array
        What turns a wheel sample's variance into an intensity (s), then an intensity for what the
        wheels did between their samples (m²/s³).
    kind : (N, 3) int8 array
        0 missing, 1 a value, 2 at least, 3 at most.
    reading : (N, 3) array
        Chassis accelerations or rails, m/s².
    start : (19, 19) array
        Prior covariance of the state.
    nu, logs : (N, 3) arrays
        Filled with normalised innovations and logarithms of their variances; left alone where
        there is no value.

    Returns
    -------
    float
    """
    powers = np.zeros((TAYLOR + 1, _X, _X))
    for a in range(_X):
        powers[0, a, a] = 1.0
    for j in range(1, TAYLOR + 1):
        for a in range(_X):
            for c in range(_X):
                weight = A[a, c] / j
                if weight != 0.0:
                    for b in range(_X):
                        powers[j, a, b] += weight * powers[j - 1, c, b]
    drive = np.empty((_U, ORDER, _X))
    factorial = 1.0
    for j in range(ORDER):
        if j > 0:
            factorial *= j
        for u in range(_U):
            for a in range(_X):
                drive[u, j, a] = -powers[j, a, _U + u] * factorial

    mean = np.zeros(STATES)
    P = start.copy()
    phi = np.zeros((_X, _X))
    gamma = np.zeros((_X, _U))
    q = np.zeros((_U, _X, _X))
    carry = np.zeros((_X, STATES))
    decay = np.ones(STATES)
    T = np.empty((_X, STATES))
    PC = np.empty(STATES)
    fresh = np.empty(_X)
    intensity = np.empty(_U)
    total = 0.0
    known = -1.0
    for k in range(step.shape[0]):
        h = step[k]
        if h > 0.0:
            if abs(h - known) > 1e-12:
                known = h
                _transition(h, powers, phi, gamma, q)
                for a in range(_X):
                    drift = 0.0
                    for b in range(_X):
                        carry[a, b] = phi[a, b]
                    for u in range(_U):
                        carry[a, _W + u] = gamma[a, u]
                        drift += gamma[a, u] * n[u]
                    carry[a, _D] = drift
                for c in range(_U + _Y):
                    decay[_W + c] = math.exp(-poles[c] * h)
            for a in range(_X):
                acc = 0.0
                for c in range(STATES):
                    acc += carry[a, c] * mean[c]
                for u in range(_U):
                    for j in range(ORDER):
                        acc += drive[u, j, a] * moments[k, u, j]
                fresh[a] = acc
            for a in range(_X):
                mean[a] = fresh[a]
            for a in range(_W, STATES):
                mean[a] *= decay[a]
            for u in range(_U):
                intensity[u] = noise[0, u] * spread[k, u] + spread[k, _U + u]
            _advance(P, T, carry, decay, q, intensity)
            for c in range(_U + _Y):
                P[_W + c, _W + c] += noise[1, c] * (1.0 - decay[_W + c] * decay[_W + c])

        for y in range(_Y):
            what = kind[k, y]
            if what == MISSING:
                continue
            expected = mean[_B + y] + mean[_V + y]
            for a in range(_X):
                expected += C[y, a] * mean[a]
            for b in range(STATES):
                acc = P[_B + y, b] + P[_V + y, b]
                for a in range(_X):
                    acc += C[y, a] * P[a, b]
                PC[b] = acc
            S = PC[_B + y] + PC[_V + y] + noise[0, _U + y]
            for a in range(_X):
                S += C[y, a] * PC[a]
            root = math.sqrt(S)
            if what == VALUE:
                shift = (reading[k, y] - expected) / S
                shrink = 1.0 / S
                nu[k, y] = shift * root
                logs[k, y] = math.log(S)
                total -= 0.5 * (_LOG_2PI + logs[k, y] + nu[k, y] * nu[k, y])
            else:
                sign = 1.0 if what == AT_LEAST else -1.0
                z = sign * (reading[k, y] - expected) / root
                log_tail, hazard = upper_tail(z)
                total += log_tail
                shift = sign * hazard / root
                shrink = hazard * (hazard - z) / S
            for a in range(STATES):
                mean[a] += PC[a] * shift
                scaled = PC[a] * shrink
                for b in range(STATES):
                    P[a, b] -= scaled * PC[b]
    return total
