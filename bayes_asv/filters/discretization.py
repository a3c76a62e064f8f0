"""Parts of the recursions over a recording, compiled into each of them.

A is the half car's matrix in deflections, (δ_f, δ̇_f, δ_r, δ̇_r); its first and third rows are
unit vectors and its others are C.  The filter's state is (x, b, w, v): the four states of the
car, two biases, and the slow noise of wheel and chassis sensors, front before rear.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["INLINE", "OPTIONS", "ORDER", "TAYLOR", "advance", "project", "series", "transition"]

ORDER = 8  # input moments kept, and
TAYLOR = 12  # powers of A h: what they leave out bounds the step, see the timeline

OPTIONS = {"cache": True, "nogil": True, "fastmath": {"contract"}, "error_model": "numpy"}

INLINE = {**OPTIONS, "inline": "always"}
"""For what is called at every step: a call takes as long as most of what is called."""

Array = NDArray[np.float64]


@njit(**OPTIONS)
def series(car: Array, C: Array, powers: Array, drive: Array) -> None:
    """Fill C (2, 4), Aʲ/j! (TAYLOR + 1, 4, 4) and Aʲ B for both wheels (2, ORDER, 4).

    ``car`` holds eight parameters, and the gains of the four sensors after them if there are
    twelve numbers: C then gives readings and the drive takes them.
    """
    c_f, c_r, i, m, l, wdf, k_f, k_r = (
        car[0], car[1], car[2], car[3], car[4], car[5], car[6], car[7],
    )  # fmt: skip
    l_f = l * (1.0 - wdf)
    l_r = l * wdf
    ff = 1.0 / m + l_f * l_f / i
    fr = 1.0 / m - l_f * l_r / i
    rr = 1.0 / m + l_r * l_r / i
    C[0, 0], C[0, 1], C[0, 2], C[0, 3] = -ff * k_f, -ff * c_f, -fr * k_r, -fr * c_r
    C[1, 0], C[1, 1], C[1, 2], C[1, 3] = -fr * k_f, -fr * c_f, -rr * k_r, -rr * c_r
    for a in range(4):
        for b in range(4):
            powers[0, a, b] = 1.0 if a == b else 0.0
    for j in range(1, TAYLOR + 1):
        for b in range(4):
            powers[j, 0, b] = powers[j - 1, 1, b] / j
            powers[j, 2, b] = powers[j - 1, 3, b] / j
            front = 0.0
            rear = 0.0
            for a in range(4):
                front += C[0, a] * powers[j - 1, a, b]
                rear += C[1, a] * powers[j - 1, a, b]
            powers[j, 1, b] = front / j
            powers[j, 3, b] = rear / j
    factorial = 1.0
    for j in range(ORDER):
        if j > 0:
            factorial *= j
        for a in range(4):
            drive[0, j, a] = -powers[j, a, 1] * factorial
            drive[1, j, a] = -powers[j, a, 3] * factorial
    if car.shape[0] > 8:  # readings over truth: what a wheel read is divided, a chassis multiplied
        for a in range(4):
            C[0, a] *= car[9]
            C[1, a] *= car[11]
            for j in range(ORDER):
                drive[0, j, a] /= car[8]
                drive[1, j, a] /= car[10]


@njit(**OPTIONS)
def transition(
    h: float,
    powers: Array,
    poles: Array,
    phi: Array,
    gamma: Array,
    qf: Array,
    qr: Array,
    decay: Array,
) -> None:
    """Fill what one step of length h needs.

    ``phi`` is Φ(h), ``gamma`` ∫ Φ(s) e ds with e the unit vector of δ̇ of each axle, ``qf`` and
    ``qr`` ∫ Φ(s) e eᵀ Φ(s)ᵀ ds, and ``decay`` what is left of biases and slow noise.
    """
    fresh = np.empty(4)
    for a in range(4):
        for b in range(4):
            acc = powers[TAYLOR, a, b]
            for j in range(TAYLOR - 1, -1, -1):
                acc = acc * h + powers[j, a, b]
            phi[a, b] = acc
    for a in range(4):
        for b in range(2):
            acc = powers[TAYLOR, a, 2 * b + 1] / (TAYLOR + 1)
            for j in range(TAYLOR - 1, -1, -1):
                acc = acc * h + powers[j, a, 2 * b + 1] / (j + 1)
            gamma[a, b] = acc * h
    # The integral by two-point Gauss: exact to the fourth power of h.
    for a in range(4):
        for b in range(4):
            qf[a, b] = 0.0
            qr[a, b] = 0.0
    for g in range(2):
        s = h * (0.5 + (g - 0.5) / math.sqrt(3.0))
        for axle in range(2):
            for a in range(4):
                acc = powers[TAYLOR, a, 2 * axle + 1]
                for j in range(TAYLOR - 1, -1, -1):
                    acc = acc * s + powers[j, a, 2 * axle + 1]
                fresh[a] = acc
            for a in range(4):
                for b in range(4):
                    if axle == 0:
                        qf[a, b] += 0.5 * h * fresh[a] * fresh[b]
                    else:
                        qr[a, b] += 0.5 * h * fresh[a] * fresh[b]
    decay[0] = decay[1] = 1.0
    for a in range(4):
        decay[2 + a] = math.exp(-poles[a] * h)


@njit(**OPTIONS)
def advance(
    P: Array,
    T: Array,
    phi: Array,
    gamma: Array,
    qf: Array,
    qr: Array,
    decay: Array,
    intensity_f: float,
    intensity_r: float,
    slow: Array,
) -> None:
    """Carry the covariance P (10, 10) over one step in place; T (4, 10) is room to work in."""
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
    for a in range(4):
        P[6 + a, 6 + a] += slow[a] * (1.0 - decay[2 + a] * decay[2 + a])


@njit(**OPTIONS)
def project(axle: int, C: Array, P: Array, PC: Array) -> float:
    """Fill P hᵀ (10,) for the chassis reading h of an axle; return h P hᵀ."""
    for a in range(10):  # rows of the symmetric P, so that reads are in order
        PC[a] = (
            C[axle, 0] * P[0, a]
            + C[axle, 1] * P[1, a]
            + C[axle, 2] * P[2, a]
            + C[axle, 3] * P[3, a]
            + P[4 + axle, a]
            + P[8 + axle, a]
        )
    value: float = (
        C[axle, 0] * PC[0]
        + C[axle, 1] * PC[1]
        + C[axle, 2] * PC[2]
        + C[axle, 3] * PC[3]
        + PC[4 + axle]
        + PC[8 + axle]
    )
    return value
