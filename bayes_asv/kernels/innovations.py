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
on the state matched in two moments.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.kernels.tails import upper_tail

__all__ = ["ORDER", "log_likelihood", "residuals"]

ORDER = 8  # input moments kept, and
_TAYLOR = 12  # powers of A h: what they leave out bounds the step, see the timeline
_LOG_2PI = math.log(2.0 * math.pi)

MISSING, VALUE, AT_LEAST, AT_MOST = 0, 1, 2, 3  # kinds of reading

_OPTIONS = {"cache": True, "nogil": True, "fastmath": {"contract"}, "error_model": "numpy"}


@njit(**_OPTIONS)
def _run(
    car: NDArray[np.float64],
    noise: NDArray[np.float64],
    step: NDArray[np.float64],
    moments: NDArray[np.float64],
    spread: NDArray[np.float64],
    kind: NDArray[np.int8],
    closes: NDArray[np.bool_],
    reading: NDArray[np.float64],
    extra: NDArray[np.float64],
    start: NDArray[np.float64],
    ar: NDArray[np.float64],
    ar_root: NDArray[np.float64],
    keep: bool,
    kept: NDArray[np.float64],
) -> float:
    """One pass; see :func:`log_likelihood` for the arguments."""
    c_f, c_r, i, m, l, wdf, k_f, k_r = (
        car[0], car[1], car[2], car[3], car[4], car[5], car[6], car[7],
    )  # fmt: skip
    l_f = l * (1.0 - wdf)
    l_r = l * wdf
    ff = 1.0 / m + l_f * l_f / i
    fr = 1.0 / m - l_f * l_r / i
    rr = 1.0 / m + l_r * l_r / i
    C = np.empty((2, 4))
    C[0, 0], C[0, 1], C[0, 2], C[0, 3] = -ff * k_f, -ff * c_f, -fr * k_r, -fr * c_r
    C[1, 0], C[1, 1], C[1, 2], C[1, 3] = -fr * k_f, -fr * c_f, -rr * k_r, -rr * c_r

    # Powers A^j / j! for Φ(h), and A^j B for the moments of the input.
    powers = np.zeros((_TAYLOR + 1, 4, 4))
    for a in range(4):
        powers[0, a, a] = 1.0
    for j in range(1, _TAYLOR + 1):
        for b in range(4):
            # A has ones at (0,1) and (2,3); its other two rows are C.
            powers[j, 0, b] = powers[j - 1, 1, b] / j
            powers[j, 2, b] = powers[j - 1, 3, b] / j
            front = 0.0
            rear = 0.0
            for a in range(4):
                front += C[0, a] * powers[j - 1, a, b]
                rear += C[1, a] * powers[j - 1, a, b]
            powers[j, 1, b] = front / j
            powers[j, 3, b] = rear / j
    drive = np.empty((2, ORDER, 4))
    factorial = 1.0
    for j in range(ORDER):
        if j > 0:
            factorial *= j
        for a in range(4):
            drive[0, j, a] = -powers[j, a, 1] * factorial
            drive[1, j, a] = -powers[j, a, 3] * factorial

    white_wheel_f, white_wheel_r = noise[0], noise[1]  # variances of one sample
    white_f, white_r = noise[2], noise[3]
    slow_wheel_f, slow_wheel_r = noise[4], noise[5]
    slow_f, slow_r = noise[6], noise[7]
    pole_wheel_f, pole_wheel_r = noise[8], noise[9]  # rad/s
    pole_f, pole_r = noise[10], noise[11]

    mean = np.zeros(10)
    P = np.zeros((10, 10))
    for a in range(6):
        P[a, a] = start[a]
    P[6, 6], P[7, 7], P[8, 8], P[9, 9] = slow_wheel_f, slow_wheel_r, slow_f, slow_r

    phi = np.zeros((4, 4))
    gamma = np.zeros((4, 2))
    qf = np.zeros((4, 4))
    qr = np.zeros((4, 4))
    T = np.empty((4, 10))
    PC = np.empty(10)
    fresh = np.empty(4)
    decay = np.ones(6)
    lags = ar.shape[0]
    history = np.zeros((max(lags, 1), 2))
    nu = np.zeros(2)
    seen = np.zeros(2, np.bool_)
    own = np.zeros(2, np.int64)
    lone = 1.0
    if ar.shape[0] > 0:  # inverse deviation of the rear when the front is missing
        lone = ar_root[1, 1] / math.sqrt(1.0 + (ar_root[1, 0] / ar_root[0, 0]) ** 2)
    total = 0.0
    h_known = -1.0
    n = step.shape[0]

    for k in range(n):
        h = step[k]
        if h > 0.0:
            if abs(h - h_known) > 1e-12:
                h_known = h
                for a in range(4):
                    for b in range(4):
                        acc = powers[_TAYLOR, a, b]
                        for j in range(_TAYLOR - 1, -1, -1):
                            acc = acc * h + powers[j, a, b]
                        phi[a, b] = acc
                for a in range(4):
                    for b in range(2):
                        # ∫ Φ(s) e ds, e the unit vector of δ̇
                        acc = powers[_TAYLOR, a, 2 * b + 1] / (_TAYLOR + 1)
                        for j in range(_TAYLOR - 1, -1, -1):
                            acc = acc * h + powers[j, a, 2 * b + 1] / (j + 1)
                        gamma[a, b] = acc * h
                # ∫ Φ(s) e eᵀ Φ(s)ᵀ ds by two-point Gauss: exact to the fourth power of h
                for a in range(4):
                    for b in range(4):
                        qf[a, b] = 0.0
                        qr[a, b] = 0.0
                for g in range(2):
                    s = h * (0.5 + (g - 0.5) / math.sqrt(3.0))
                    for axle in range(2):
                        for a in range(4):
                            acc = powers[_TAYLOR, a, 2 * axle + 1]
                            for j in range(_TAYLOR - 1, -1, -1):
                                acc = acc * s + powers[j, a, 2 * axle + 1]
                            fresh[a] = acc
                        for a in range(4):
                            for b in range(4):
                                if axle == 0:
                                    qf[a, b] += 0.5 * h * fresh[a] * fresh[b]
                                else:
                                    qr[a, b] += 0.5 * h * fresh[a] * fresh[b]
                decay[2] = math.exp(-pole_wheel_f * h)
                decay[3] = math.exp(-pole_wheel_r * h)
                decay[4] = math.exp(-pole_f * h)
                decay[5] = math.exp(-pole_r * h)

            # mean
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

            # covariance: T = [Φ Γ] P, then T [Φ Γ]ᵀ, and the decays of the noise states
            for a in range(4):
                for b in range(10):
                    T[a, b] = (
                        phi[a, 0] * P[0, b]
                        + phi[a, 1] * P[1, b]
                        + phi[a, 2] * P[2, b]
                        + phi[a, 3] * P[3, b]
                        + gamma[a, 0] * P[6, b]
                        + gamma[a, 1] * P[7, b]
                    )
            intensity_f = white_wheel_f * spread[k, 0] + spread[k, 2]
            intensity_r = white_wheel_r * spread[k, 1] + spread[k, 3]
            for a in range(4):
                for b in range(a, 4):
                    acc = (
                        T[a, 0] * phi[b, 0]
                        + T[a, 1] * phi[b, 1]
                        + T[a, 2] * phi[b, 2]
                        + T[a, 3] * phi[b, 3]
                        + T[a, 6] * gamma[b, 0]
                        + T[a, 7] * gamma[b, 1]
                        + intensity_f * qf[a, b]
                        + intensity_r * qr[a, b]
                    )
                    P[a, b] = acc
                    P[b, a] = acc
                for b in range(6):
                    acc = T[a, 4 + b] * decay[b]
                    P[a, 4 + b] = acc
                    P[4 + b, a] = acc
            for a in range(6):
                for b in range(6):
                    P[4 + a, 4 + b] *= decay[a] * decay[b]
            P[6, 6] += slow_wheel_f * (1.0 - decay[2] * decay[2])
            P[7, 7] += slow_wheel_r * (1.0 - decay[3] * decay[3])
            P[8, 8] += slow_f * (1.0 - decay[4] * decay[4])
            P[9, 9] += slow_r * (1.0 - decay[5] * decay[5])

        for axle in range(2):
            what = kind[k, axle]
            if what == MISSING:
                continue
            expected = mean[4 + axle] + mean[8 + axle]
            for a in range(4):
                expected += C[axle, a] * mean[a]
            for a in range(10):  # rows of the symmetric P, so that reads are in order
                PC[a] = (
                    C[axle, 0] * P[0, a]
                    + C[axle, 1] * P[1, a]
                    + C[axle, 2] * P[2, a]
                    + C[axle, 3] * P[3, a]
                    + P[4 + axle, a]
                    + P[8 + axle, a]
                )
            S = (
                C[axle, 0] * PC[0]
                + C[axle, 1] * PC[1]
                + C[axle, 2] * PC[2]
                + C[axle, 3] * PC[3]
                + PC[4 + axle]
                + PC[8 + axle]
                + (white_f if axle == 0 else white_r)
                + extra[k, axle]
            )
            root = math.sqrt(S)
            if what == VALUE:
                shift = (reading[k, axle] - expected) / S
                shrink = 1.0 / S
                nu[axle] = shift * root
                seen[axle] = True
                own[axle] = k
                total -= 0.5 * (_LOG_2PI + math.log(S))
                if lags == 0:
                    total -= 0.5 * nu[axle] * nu[axle]
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

        if not closes[k]:
            continue
        if lags > 0:
            # colour that the model does not know: a vector autoregression on the innovations
            p0 = 0.0
            p1 = 0.0
            for j in range(lags):
                p0 += ar[j, 0, 0] * history[j, 0] + ar[j, 0, 1] * history[j, 1]
                p1 += ar[j, 1, 0] * history[j, 0] + ar[j, 1, 1] * history[j, 1]
            for j in range(lags - 1, 0, -1):
                history[j, 0] = history[j - 1, 0]
                history[j, 1] = history[j - 1, 1]
            # what is missing is remembered as it was predicted
            history[0, 0] = nu[0] if seen[0] else p0
            history[0, 1] = nu[1] if seen[1] else p1
            w0 = 0.0
            w1 = 0.0
            if seen[0]:
                w0 = ar_root[0, 0] * (nu[0] - p0)
                total += math.log(ar_root[0, 0]) - 0.5 * w0 * w0
            if seen[1]:
                if seen[0]:
                    w1 = ar_root[1, 0] * (nu[0] - p0) + ar_root[1, 1] * (nu[1] - p1)
                    total += math.log(ar_root[1, 1]) - 0.5 * w1 * w1
                else:
                    w1 = lone * (nu[1] - p1)
                    total += math.log(lone) - 0.5 * w1 * w1
            if keep:
                if seen[0]:
                    kept[own[0], 0] = w0
                if seen[1]:
                    kept[own[1], 1] = w1
        elif keep:
            if seen[0]:
                kept[own[0], 0] = nu[0]
            if seen[1]:
                kept[own[1], 1] = nu[1]
        nu[0] = 0.0
        nu[1] = 0.0
        seen[0] = False
        seen[1] = False
    return total


@njit(**_OPTIONS)
def log_likelihood(
    cars: NDArray[np.float64],
    noises: NDArray[np.float64],
    step: NDArray[np.float64],
    moments: NDArray[np.float64],
    spread: NDArray[np.float64],
    kind: NDArray[np.int8],
    closes: NDArray[np.bool_],
    reading: NDArray[np.float64],
    extra: NDArray[np.float64],
    start: NDArray[np.float64],
    ar: NDArray[np.float64],
    ar_root: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Add the log-likelihood of one recording for each of W parameter sets to ``out``.

    Parameters
    ----------
    cars : (W, 8) array
        c_f, c_r, i, m, l, wdf, k_f, k_r in SI units.
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
    closes : (N,) bool array
        True at the last instant of a pair of readings; two boards with two clocks make two
        instants a pair.
    reading : (N, 2) array
        Chassis accelerations or rails, m/s².
    extra : (N, 2) array
        Variance added to single readings, m²/s⁴.
    start : (6,) array
        Prior variances of δ_f, δ̇_f, δ_r, δ̇_r and of the two biases.
    ar, ar_root : (p, 2, 2) and (2, 2) arrays
        Vector autoregression on the normalised innovations, and the lower-triangular inverse
        root of the covariance of what it leaves; p = 0 for none.
    out : (W,) array
        Added to in place.
    """
    kept = np.empty((0, 2))
    for w in range(cars.shape[0]):
        out[w] += _run(
            cars[w], noises[w], step, moments, spread, kind, closes, reading, extra, start,
            ar, ar_root, False, kept,
        )  # fmt: skip


@njit(**_OPTIONS)
def residuals(
    car: NDArray[np.float64],
    noise: NDArray[np.float64],
    step: NDArray[np.float64],
    moments: NDArray[np.float64],
    spread: NDArray[np.float64],
    kind: NDArray[np.int8],
    closes: NDArray[np.bool_],
    reading: NDArray[np.float64],
    extra: NDArray[np.float64],
    start: NDArray[np.float64],
    ar: NDArray[np.float64],
    ar_root: NDArray[np.float64],
    kept: NDArray[np.float64],
) -> float:
    """One pass that also fills ``kept`` (N, 2) with normalised innovations; returns log p.

    Each stands at its own reading's instant; where there is no value ``kept`` is left alone.
    """
    value: float = _run(
        car, noise, step, moments, spread, kind, closes, reading, extra, start,
        ar, ar_root, True, kept,
    )  # fmt: skip
    return value
