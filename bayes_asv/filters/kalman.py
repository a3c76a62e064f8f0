"""The innovations recursion of the half car, compiled.

The model, for one recording (a step of length h ends at an instant of observation)::

    x = (δ_f, δ̇_f, δ_r, δ̇_r)      x⁺ = Φ x + ∫ Φ(h−s) B û(s) ds + Γ w + white, intensity q
    w = wheel-sensor noise that passed the sensor's filter    w⁺ = ρ w + …
    v = chassis-sensor noise that passed the sensor's filter  v⁺ = ρ v + …
    b = bias of the chassis against the wheel channel         b⁺ = b
    y = C x + b + v + white, variance r

û is the interpolated wheel acceleration; the noise in it drives x.  The state of the filter
is (x, b, w, v), ten in all.  What it computes is the exact Gaussian marginal likelihood with
initial state and biases integrated out; a reading at its rail enters as a bound, its effect
on the state matched in two moments.  For noise that has a colour see :mod:`.coloured`.
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
from bayes_asv.filters.tails import upper_tail

__all__ = ["AT_LEAST", "AT_MOST", "MISSING", "ORDER", "VALUE", "log_likelihood", "residuals"]

_LOG_2PI = math.log(2.0 * math.pi)

MISSING, VALUE, AT_LEAST, AT_MOST = 0, 1, 2, 3  # kinds of reading

Array = NDArray[np.float64]


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

    mean = np.zeros(10)
    P = np.zeros((10, 10))
    for a in range(6):
        P[a, a] = start[a]
    for a in range(4):
        P[6 + a, 6 + a] = slow[a]

    phi = np.zeros((4, 4))
    gamma = np.zeros((4, 2))
    qf = np.zeros((4, 4))
    qr = np.zeros((4, 4))
    decay = np.ones(6)
    T = np.empty((4, 10))
    PC = np.empty(10)
    fresh = np.empty(4)
    total = 0.0
    h_known = -1.0

    for k in range(step.shape[0]):
        h = step[k]
        if h > 0.0:
            if abs(h - h_known) > 1e-12:
                h_known = h
                transition(h, powers, poles, phi, gamma, qf, qr, decay)
            for a in range(4):
                acc = gamma[a, 0] * mean[6] + gamma[a, 1] * mean[7]
                for b in range(4):
                    acc += phi[a, b] * mean[b]
                fresh[a] = acc
            for j in range(ORDER):  # lanes side by side, so that the compiler can use them
                for a in range(4):
                    fresh[a] += drive[0, j, a] * moments[k, 0, j]
                    fresh[a] += drive[1, j, a] * moments[k, 1, j]
            for a in range(4):
                mean[a] = fresh[a]
            for a in range(2, 6):
                mean[4 + a] *= decay[a]
            intensity_f = noise[0] * spread[k, 0] + spread[k, 2]
            intensity_r = noise[1] * spread[k, 1] + spread[k, 3]
            advance(P, T, phi, gamma, qf, qr, decay, intensity_f, intensity_r, slow)

        for axle in range(2):
            what = kind[k, axle]
            if what == MISSING:
                continue
            expected = mean[4 + axle] + mean[8 + axle]
            for a in range(4):
                expected += C[axle, a] * mean[a]
            S = project(axle, C, P, PC) + noise[2 + axle] + extra[k, axle]
            root = math.sqrt(S)
            if what == VALUE:
                shift = (reading[k, axle] - expected) / S
                shrink = 1.0 / S
                nu = shift * root
                total -= 0.5 * (_LOG_2PI + math.log(S) + nu * nu)
                if keep:
                    kept[k, axle] = nu
            else:
                sign = 1.0 if what == AT_LEAST else -1.0
                z = sign * (reading[k, axle] - expected) / root
                log_tail, hazard = upper_tail(z)
                total += log_tail
                shift = sign * hazard / root
                shrink = hazard * (hazard - z) / S
            for a in range(10):
                mean[a] += PC[a] * shift
            for a in range(10):
                scaled = PC[a] * shrink
                for b in range(10):
                    P[a, b] -= scaled * PC[b]
    return total


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
    out: Array,
) -> None:
    """Add the log-likelihood of one recording for each of W parameter sets to ``out``.

    Parameters
    ----------
    cars : (W, 8) or (W, 12) array
        c_f, c_r, i, m, l, wdf, k_f, k_r in SI units, and the gains (reading over truth) of front
        wheel, front chassis, rear wheel and rear chassis; one where there are eight.
    noises : (W, 12) array
        Variances (m²/s⁴) of one sample: white of the two wheel, then of the two chassis
        channels; filtered noise in the same order; its poles (rad/s) in the same order.
    step : (N,) array
        Time since the instant before, s; zero for the first.
    moments : (N, 2, ORDER) array
        ∫₀ʰ (h−s)ʲ/j! û(s) ds of the two wheel accelerations over each step.
    spread : (N, 4) array
        What turns a wheel sample's variance into an intensity (s), front and rear, and an
        intensity added for what the wheel did between its samples (m²/s³), front and rear.
    kind : (N, 2) int8 array
        0 missing, 1 a value, 2 at least, 3 at most.
    reading : (N, 2) array
        Chassis accelerations or rails, m/s².
    extra : (N, 2) array
        Variance added to single readings, m²/s⁴.
    start : (6,) array
        Prior variances of δ_f, δ̇_f, δ_r, δ̇_r and of the two biases.
    out : (W,) array
        Added to in place.
    """
    kept = np.empty((0, 2))
    for w in range(cars.shape[0]):
        out[w] += _run(
            cars[w],
            noises[w],
            step,
            moments,
            spread,
            kind,
            reading,
            extra,
            start,
            False,
            kept,
        )


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
    kept: Array,
) -> float:
    """One pass that also fills ``kept`` (N, 2) with normalised innovations; returns log p.

    Each stands at its own reading's instant; where there is no value ``kept`` is left alone.
    """
    value: float = _run(
        car, noise, step, moments, spread, kind, reading, extra, start, True, kept
    )  # fmt: skip
    return value
