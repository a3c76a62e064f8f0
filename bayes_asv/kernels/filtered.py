"""Parts of the recursion of a car that is not linear, compiled into it.

The state is (x, φ, b, w, v): four states of the car, two filtered excess forces, two biases, and
the slow noise of wheel and chassis sensors.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.kernels.forces import excess
from bayes_asv.kernels.steps import OPTIONS, TAYLOR

__all__ = [
    "BIAS",
    "CHASSIS",
    "STATES",
    "WHEELS",
    "carry",
    "compliance",
    "force_weights",
    "forces",
    "seen",
]

STATES = 12
BIAS, WHEELS, CHASSIS = 6, 8, 10  # where biases and the slow noise of wheels and chassis begin

Array = NDArray[np.float64]


@njit(**OPTIONS)
def compliance(car: Array) -> tuple[float, float, float]:
    """Chassis acceleration at the axles for a newton there: own front, across, own rear."""
    i, m, l, wdf = car[2], car[3], car[4], car[5]
    l_f, l_r = l * (1.0 - wdf), l * wdf
    return 1.0 / m + l_f * l_f / i, 1.0 / m - l_f * l_r / i, 1.0 / m + l_r * l_r / i


@njit(**OPTIONS)
def force_weights(
    h: float, powers: Array, M: Array, pole: float, through: Array, W0: Array, W1: Array
) -> None:
    """Fill what one step of length h makes of filtered and of new forces.

    ``through`` (6, 2) carries φ at the step's beginning, ``W0`` (6, 2) a force that is steady
    over the step, ``W1`` (6, 2) one that grows from zero to one newton.
    """
    term = np.empty(6)
    fresh = np.empty(6)
    for axle in range(2):
        for a in range(6):
            term[a] = 0.0
            through[a, axle] = W0[a, axle] = W1[a, axle] = 0.0
        term[4 + axle] = 1.0  # Aʲ e_φ hʲ / j!, j = 0
        for j in range(TAYLOR + 8):
            for a in range(6):
                through[a, axle] += term[a]
                W0[a, axle] += term[a] * pole * h / (j + 1)
                W1[a, axle] += term[a] * pole * h / ((j + 1) * (j + 2))
            fresh[0] = term[1]
            fresh[2] = term[3]
            for row in range(2):
                value = M[row, 0] * term[4] + M[row, 1] * term[5]
                for b in range(4):
                    value += powers[1, 1 + 2 * row, b] * term[b]
                fresh[1 + 2 * row] = value
                fresh[4 + row] = -pole * term[4 + row]
            for a in range(6):
                term[a] = fresh[a] * h / (j + 1)


@njit(**OPTIONS)
def forces(
    table: Array,
    car: Array,
    plain: Array,
    M: Array,
    pole: float,
    mean: Array,
    slow: Array,
    wheel: Array,
    time: float,
    share: float,
    out: Array,
    slopes: Array,
) -> None:
    """Fill excess forces (2,) and their slopes (2, 8) in x, φ and w.

    ``plain`` (2, 4) holds true accelerations for a state, gains left out.
    """
    value = np.empty(3)
    for axle in range(2):
        d, v = 2 * axle, 2 * axle + 1
        bend = M[axle, 0] * mean[4] + M[axle, 1] * mean[5] - wheel[axle] + slow[axle]
        for b in range(4):
            bend += plain[axle, b] * mean[b]
        delta, rate = mean[d] + mean[v] / pole, mean[v] + bend / pole
        excess(table, axle, car[axle], car[6 + axle], delta, rate, time, share, value)
        out[axle] = value[0]
        for b in range(4):
            slopes[axle, b] = value[2] * plain[axle, b] / pole
        slopes[axle, 4] = value[2] * M[axle, 0] / pole
        slopes[axle, 5] = value[2] * M[axle, 1] / pole
        slopes[axle, 6] = slopes[axle, 7] = 0.0
        slopes[axle, 6 + axle] = value[2] / pole
        slopes[axle, d] += value[1]
        slopes[axle, v] += value[1] / pole + value[2]


@njit(**OPTIONS)
def carry(
    P: Array,
    T: Array,
    J: Array,
    qf: Array,
    qr: Array,
    decay: Array,
    front: float,
    rear: float,
    slow: Array,
) -> None:
    """Carry the covariance P (12, 12) over one step in place; T (6, 12) is room to work in."""
    for a in range(6):
        for b in range(STATES):
            acc = J[a, 6] * P[WHEELS, b] + J[a, 7] * P[WHEELS + 1, b]
            for c in range(6):
                acc += J[a, c] * P[c, b]
            T[a, b] = acc
    for a in range(6):
        for b in range(a, 6):
            acc = T[a, WHEELS] * J[b, 6] + T[a, WHEELS + 1] * J[b, 7]
            for c in range(6):
                acc += T[a, c] * J[b, c]
            if b < 4:
                acc += front * qf[a, b] + rear * qr[a, b]
            P[a, b] = acc
            P[b, a] = acc
        for b in range(6):
            acc = T[a, 6 + b] * decay[b]
            P[a, 6 + b] = acc
            P[6 + b, a] = acc
    for a in range(6):
        for b in range(6):
            P[6 + a, 6 + b] *= decay[a] * decay[b]
    for a in range(4):
        P[WHEELS + a, WHEELS + a] += slow[a] * (1.0 - decay[2 + a] * decay[2 + a])


@njit(**OPTIONS)
def seen(axle: int, H: Array, P: Array, PC: Array) -> float:
    """Fill P hᵀ (12,) for the chassis reading h of an axle; return h P hᵀ."""
    for a in range(STATES):
        acc = P[BIAS + axle, a] + P[CHASSIS + axle, a]
        for b in range(6):
            acc += H[axle, b] * P[b, a]
        PC[a] = acc
    value: float = PC[BIAS + axle] + PC[CHASSIS + axle]
    for b in range(6):
        value += H[axle, b] * PC[b]
    return value
