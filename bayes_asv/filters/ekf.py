"""The innovations recursion of a half car whose suspension is not linear, compiled.

The model is that of :mod:`.innovations` with an excess force f of each axle, which is whatever
its springs, dampers and stops do beyond −k δ − c δ̇::

    x⁺ = Φ x + ∫ Φ(h−s) (B û(s) + M φ(s)) ds + …      φ' = λ (f − φ)      y = C x + M φ + b + v

All four readings passed the sensors' filter with pole λ.  A linear car does not notice: its
filtered motions obey the same equations.  A force that is not linear acts on the motion before
the filter, δ + δ̇/λ and δ̇ + δ̈/λ, and is then filtered itself: φ is what passed.  This is
exact for one pole; where no filter is declared λ is above what the samples can show.

Forces enter a step as straight lines between its ends (second-order exponential integrator;
Hochbruck & Ostermann 2010, Acta Numerica 19, eq. 2.39), the second end from a predictor.  The
covariance follows the slopes along that path: an extended Kalman filter, exact for a linear car.
The state is (x, φ, b, w, v), twelve in all.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.discretization import OPTIONS, ORDER, TAYLOR, series, transition
from bayes_asv.filters.ekf_steps import (
    BIAS,
    CHASSIS,
    STATES,
    WHEELS,
    carry,
    compliance,
    follow,
    force_weights,
    forces,
    seen,
)
from bayes_asv.filters.kalman import AT_LEAST, MISSING, VALUE
from bayes_asv.filters.tails import upper_tail

__all__ = ["free_run", "log_likelihood", "residuals"]

_LOG_2PI = math.log(2.0 * math.pi)

Array = NDArray[np.float64]


@njit(**OPTIONS)
def _run(
    car: Array,
    noise: Array,
    table: Array,
    pole: float,
    step: Array,
    moments: Array,
    spread: Array,
    kind: NDArray[np.int8],
    reading: Array,
    extra: Array,
    start: Array,
    wheel: Array,
    elapsed: Array,
    added: Array,
    free: bool,
    begin: Array,
    kept: Array,
    logs: Array,
    states: Array,
) -> float:
    """One pass; see :func:`log_likelihood` for the arguments.

    ``free`` leaves the readings out: from ``begin`` (12,) on, states and predicted readings
    follow the wheels alone.
    """
    C = np.empty((2, 4))
    powers = np.empty((TAYLOR + 1, 4, 4))
    drive = np.empty((2, ORDER, 4))
    series(car, C, powers, drive)
    ff, fr, rr = compliance(car)
    M = np.empty((2, 2))
    M[0, 0], M[0, 1], M[1, 0], M[1, 1] = ff, fr, fr, rr
    plain = np.empty((2, 4))
    for b in range(4):
        plain[0, b], plain[1, b] = powers[1, 1, b], powers[1, 3, b]
    gain = np.ones(4)
    if car.shape[0] > 8:
        for a in range(4):
            gain[a] = car[8 + a]
    slow = noise[4:8].copy()
    poles = noise[8:12].copy()

    mean = begin.copy()
    P = np.zeros((STATES, STATES))
    if not free:
        for a in range(4):
            P[a, a] = start[a]
        P[BIAS, BIAS], P[BIAS + 1, BIAS + 1] = start[4], start[5]
        for a in range(4):
            P[WHEELS + a, WHEELS + a] = slow[a]

    phi = np.zeros((4, 4))
    gamma = np.zeros((4, 2))
    qf = np.zeros((4, 4))
    qr = np.zeros((4, 4))
    decay = np.ones(6)
    through = np.zeros((6, 2))
    W0 = np.zeros((6, 2))
    W1 = np.zeros((6, 2))
    H = np.zeros((2, 6))
    for axle in range(2):
        for b in range(4):
            H[axle, b] = C[axle, b]
        H[axle, 4] = gain[1 + 2 * axle] * M[axle, 0]
        H[axle, 5] = gain[1 + 2 * axle] * M[axle, 1]
    J = np.zeros((6, 8))
    base = np.zeros((6, 8))
    T = np.empty((6, STATES))
    PC = np.empty(STATES)
    ahead = np.empty(6)
    now = np.zeros(2)
    then = np.zeros(2)
    bent = table.shape[0] > 0  # where no law is bent there is no force, and nothing to follow
    g0 = np.zeros((2, 8))
    g1 = np.zeros((2, 8))
    w = np.zeros(2)
    u = np.zeros(2)
    total = 0.0
    h_known = -1.0
    length = elapsed[-1]

    for k in range(step.shape[0]):
        h = step[k]
        if h > 0.0:
            if abs(h - h_known) > 1e-12:
                h_known = h
                transition(h, powers, poles, phi, gamma, qf, qr, decay)
                force_weights(h, powers, M, pole, through, W0, W1)
                for a in range(4):
                    for b in range(4):
                        base[a, b] = phi[a, b]
                    base[a, 6] = gamma[a, 0]
                    base[a, 7] = gamma[a, 1]
                for a in range(6):
                    base[a, 4] = through[a, 0]
                    base[a, 5] = through[a, 1]
                if not bent:
                    J[:] = base
            w[0], w[1] = mean[WHEELS], mean[WHEELS + 1]
            now[0] = now[1] = 0.0
            if bent:
                u[0], u[1] = wheel[k - 1, 0] / gain[0], wheel[k - 1, 1] / gain[2]
                time = elapsed[k - 1]
                forces(table, car, plain, M, pole, mean, w, u, time, time / length, now, g0)
            now[0] += added[k - 1, 0]
            now[1] += added[k - 1, 1]
            for a in range(6):
                acc = base[a, 6] * w[0] + base[a, 7] * w[1]
                for b in range(6):
                    acc += base[a, b] * mean[b]
                ahead[a] = acc
            for j in range(ORDER):
                for a in range(4):
                    ahead[a] += drive[0, j, a] * moments[k, 0, j]
                    ahead[a] += drive[1, j, a] * moments[k, 1, j]
            for a in range(6):
                ahead[a] += W0[a, 0] * now[0] + W0[a, 1] * now[1]
            then[0] = then[1] = 0.0
            if bent:
                u[0], u[1] = wheel[k, 0] / gain[0], wheel[k, 1] / gain[2]
                time = elapsed[k]
                forces(table, car, plain, M, pole, ahead, w, u, time, time / length, then, g1)
            then[0] += added[k, 0]
            then[1] += added[k, 1]
            for a in range(6):
                mean[a] = ahead[a]
                for axle in range(2):
                    mean[a] += W1[a, axle] * (then[axle] - now[axle])
            if bent and not free:
                follow(base, W0, W1, g0, g1, J)
            for a in range(2, 6):
                mean[6 + a] *= decay[a]
            if not free:
                one = noise[0] * spread[k, 0] + spread[k, 2]
                two = noise[1] * spread[k, 1] + spread[k, 3]
                carry(P, T, J, qf, qr, decay, one, two, slow)

        for axle in range(2):
            expected = mean[BIAS + axle] + mean[CHASSIS + axle]
            for a in range(6):
                expected += H[axle, a] * mean[a]
            if free:
                kept[k, axle] = expected
                continue
            what = kind[k, axle]
            if what == MISSING:
                continue
            S = seen(axle, H, P, PC) + noise[2 + axle] + extra[k, axle]
            root = math.sqrt(S)
            if what == VALUE:
                shift = (reading[k, axle] - expected) / S
                shrink = 1.0 / S
                nu = shift * root
                total -= 0.5 * (_LOG_2PI + math.log(S) + nu * nu)
                kept[k, axle] = nu
                logs[k, axle] = math.log(S)
            else:
                sign = 1.0 if what == AT_LEAST else -1.0
                z = sign * (reading[k, axle] - expected) / root
                log_tail, hazard = upper_tail(z)
                total += log_tail
                shift = sign * hazard / root
                shrink = hazard * (hazard - z) / S
            for a in range(STATES):
                mean[a] += PC[a] * shift
            for a in range(STATES):
                scaled = PC[a] * shrink
                for b in range(STATES):
                    P[a, b] -= scaled * PC[b]
        for a in range(6):
            states[k, a] = mean[a]
    return total


@njit(**OPTIONS)
def log_likelihood(
    cars: Array,
    noises: Array,
    tables: Array,
    pole: float,
    step: Array,
    moments: Array,
    spread: Array,
    kind: NDArray[np.int8],
    reading: Array,
    extra: Array,
    start: Array,
    wheel: Array,
    elapsed: Array,
    added: Array,
    out: Array,
) -> None:
    """Add the log-likelihood of one recording for each of W parameter sets to ``out``.

    Parameters
    ----------
    cars, noises, step, moments, spread, kind, reading, extra, start, out
        As :func:`bayes_asv.filters.kalman.log_likelihood` takes them.
    tables : (W, K, 6) array
        Laws of each set, as :func:`bayes_asv.filters.force_laws.excess` takes them.
    pole : float
        Pole of the filter that all readings passed, rad/s.
    wheel : (N, 2) array
        Wheel accelerations at the instants, m/s².
    elapsed : (N,) array
        Ends of the steps since the recording's beginning, s.
    added : (N, 2) array
        Forces on the chassis at the axles, of whatever origin, N.
    """
    kept = np.empty((len(step), 2))
    logs = np.empty((len(step), 2))
    states = np.empty((len(step), 6))
    begin = np.zeros(STATES)
    for n in range(cars.shape[0]):
        out[n] += _run(
            cars[n], noises[n], tables[n], pole, step, moments, spread, kind, reading, extra,
            start, wheel, elapsed, added, False, begin, kept, logs, states,
        )  # fmt: skip


@njit(**OPTIONS)
def residuals(
    car: Array,
    noise: Array,
    table: Array,
    pole: float,
    step: Array,
    moments: Array,
    spread: Array,
    kind: NDArray[np.int8],
    reading: Array,
    extra: Array,
    start: Array,
    wheel: Array,
    elapsed: Array,
    added: Array,
    kept: Array,
    logs: Array,
    states: Array,
) -> float:
    """One pass that fills normalised innovations (N, 2), log variances (N, 2) and states (N, 6).

    Returns log p.  Where there is no value ``kept`` and ``logs`` are left alone.
    """
    value: float = _run(
        car, noise, table, pole, step, moments, spread, kind, reading, extra, start, wheel,
        elapsed, added, False, np.zeros(STATES), kept, logs, states,
    )  # fmt: skip
    return value


@njit(**OPTIONS)
def free_run(
    car: Array,
    table: Array,
    pole: float,
    step: Array,
    moments: Array,
    wheel: Array,
    elapsed: Array,
    begin: Array,
    kept: Array,
    states: Array,
) -> None:
    """Fill predicted readings (N, 2) and states (N, 6) of a car that follows its wheels alone.

    ``begin`` (6,) holds δ_f, δ̇_f, δ_r, δ̇_r and both biases at the first instant.
    """
    first = np.zeros(STATES)
    for a in range(4):
        first[a] = begin[a]
    first[BIAS], first[BIAS + 1] = begin[4], begin[5]
    none = np.zeros((len(step), 2))
    nothing = np.zeros((len(step), 4))
    kinds = np.zeros((len(step), 2), np.int8)
    _run(
        car, np.zeros(12), table, pole, step, moments, nothing, kinds, none, none, np.zeros(6),
        wheel, elapsed, none, True, first, kept, np.zeros((len(step), 2)), states,
    )  # fmt: skip
