"""Parts of the recursion of a car that is not linear, compiled into it.

The state is (x, φ, b, w, v): four states of the car, two filtered excess forces, two biases, and
the slow noise of wheel and chassis sensors.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.discretization import INLINE, OPTIONS, TAYLOR
from bayes_asv.filters.force_laws import excess

__all__ = [
    "BIAS",
    "CHASSIS",
    "STATES",
    "WHEELS",
    "carry",
    "compliance",
    "follow",
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


@njit(**INLINE)
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
    lag = 1.0 / pole
    for axle in range(2):
        d, v = 2 * axle, 2 * axle + 1
        bend = M[axle, 0] * mean[4] + M[axle, 1] * mean[5] - wheel[axle] + slow[axle]
        for b in range(4):
            bend += plain[axle, b] * mean[b]
        delta, rate = mean[d] + lag * mean[v], mean[v] + lag * bend
        out[axle], by_delta, by_rate = excess(
            table, axle, car[axle], car[6 + axle], delta, rate, time, share
        )
        late = lag * by_rate
        for b in range(4):
            slopes[axle, b] = late * plain[axle, b]
        slopes[axle, 4] = late * M[axle, 0]
        slopes[axle, 5] = late * M[axle, 1]
        slopes[axle, 6] = slopes[axle, 7] = 0.0
        slopes[axle, 6 + axle] = late
        slopes[axle, d] += by_delta
        slopes[axle, v] += lag * by_delta + by_rate


@njit(**INLINE)
def follow(base: Array, W0: Array, W1: Array, g0: Array, g1: Array, J: Array) -> None:
    """Fill the slopes J (6, 8) of a step in x, φ and w with forces that change along it.

    ``base`` (6, 8) holds those of a linear car, ``g0`` and ``g1`` (2, 8) those of the forces at
    the step's beginning and at its predicted end.
    """
    for b in range(8):
        early, late = g0[0, b], g0[1, b]
        then_f, then_r = -early, -late
        for a in range(6):
            slope = base[a, b] + W0[a, 0] * early + W0[a, 1] * late
            J[a, b] = slope
            then_f += g1[0, a] * slope
            then_r += g1[1, a] * slope
        if b >= 6:
            then_f += g1[0, b]
            then_r += g1[1, b]
        for a in range(6):
            J[a, b] += W1[a, 0] * then_f + W1[a, 1] * then_r


@njit(**INLINE)
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
    """Carry the covariance P (12, 12) over one step in place; T (6, 12) is room to work in.

    Sums are written out along whole rows, which compiles to vectors: as loops within loops a step
    took twice as long.
    """
    for a in range(6):
        j0, j1, j2, j3 = J[a, 0], J[a, 1], J[a, 2], J[a, 3]
        j4, j5, j6, j7 = J[a, 4], J[a, 5], J[a, 6], J[a, 7]
        for b in range(STATES):
            T[a, b] = (
                j6 * P[WHEELS, b] + j7 * P[WHEELS + 1, b]
                + j0 * P[0, b] + j1 * P[1, b] + j2 * P[2, b]
                + j3 * P[3, b] + j4 * P[4, b] + j5 * P[5, b]
            )  # fmt: skip
    for a in range(6):
        t0, t1, t2, t3, t4, t5 = T[a, 0], T[a, 1], T[a, 2], T[a, 3], T[a, 4], T[a, 5]
        t6, t7 = T[a, WHEELS], T[a, WHEELS + 1]
        for b in range(a, 6):
            P[a, b] = (
                t6 * J[b, 6] + t7 * J[b, 7] + t0 * J[b, 0] + t1 * J[b, 1]
                + t2 * J[b, 2] + t3 * J[b, 3] + t4 * J[b, 4] + t5 * J[b, 5]
            )  # fmt: skip
        for b in range(6):
            P[a, 6 + b] = T[a, 6 + b] * decay[b]
    for a in range(4):
        for b in range(a, 4):
            P[a, b] += front * qf[a, b] + rear * qr[a, b]
    for a in range(6):
        for b in range(6):
            P[6 + a, 6 + b] *= decay[a] * decay[b]
    for a in range(4):
        P[WHEELS + a, WHEELS + a] += slow[a] * (1.0 - decay[2 + a] * decay[2 + a])
    for a in range(6):
        for b in range(a + 1, STATES):
            P[b, a] = P[a, b]


@njit(**INLINE)
def seen(axle: int, H: Array, P: Array, PC: Array) -> float:
    """Fill P hᵀ (12,) for the chassis reading h of an axle; return h P hᵀ."""
    h0, h1, h2 = H[axle, 0], H[axle, 1], H[axle, 2]
    h3, h4, h5 = H[axle, 3], H[axle, 4], H[axle, 5]
    for a in range(STATES):
        PC[a] = (
            P[BIAS + axle, a] + P[CHASSIS + axle, a] + h0 * P[0, a] + h1 * P[1, a]
            + h2 * P[2, a] + h3 * P[3, a] + h4 * P[4, a] + h5 * P[5, a]
        )  # fmt: skip
    value: float = PC[BIAS + axle] + PC[CHASSIS + axle]
    for b in range(6):
        value += H[axle, b] * PC[b]
    return value
