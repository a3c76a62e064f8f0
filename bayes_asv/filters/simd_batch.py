"""Many half cars side by side, each over the same step: sigma points in the lanes of a vector unit.

A lane holds one car with one state x = (δ_f, δ̇_f, δ_r, δ̇_r).  Over a step of length h its state
goes to::

    x⁺ = Σ_j (A h)ʲ/j! (x + e_f i_fj + e_r i_rj)

which Horner's rule takes from the highest order down, eight lanes at a time.  Lane 0 is the car at
the reference, lanes 1 + 2 i and 2 + 2 i are those at plus and minus the spread along direction i,
and behind them stand eight of the reference car: two columns of Φ, the two of Γ, and the two Gauss
nodes of the process noise of each axle (see :func:`bayes_asv.filters.discretization.transition`).
The other columns of Φ are e + A0 Γ_f + A4 Γ_r and the like, since Φ e = e + ∫ Φ(s) A e ds."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.discretization import OPTIONS, ORDER, TAYLOR
from bayes_asv.filters.simd_layout import (
    A0,
    A1,
    A2,
    A3,
    A4,
    A5,
    A6,
    A7,
    CAR,
    EIGHT,
    GF,
    GR,
    LANES,
    NONE,
    ONE,
    RATE,
    SIZE,
    STRUCTURE,
    UF,
    UR,
    V0,
    V1,
    V2,
    V3,
    WF,
    WR,
    X0,
    X1,
    X2,
    X3,
    H,
    blocks,
    place,
)  # fmt: skip

__all__ = ["begin_cars", "moved", "place_cars", "spread", "step", "structure_of"]

Array = NDArray[np.float64]

_GAUSS = 1.0 / math.sqrt(3.0)
_NEAR = 1 / 16  # x⁹/9! is 4e-17
_LEFT_OUT = 1e-14  # of the exponential series, the term after the last one that is taken


@njit(**OPTIONS)
def _exp(x: float) -> float:
    """Exponential function; where the parameters are known, by nine terms of its series.

    What they leave out of it is below 4e-17, and the library's function takes five times as long.
    """
    if abs(x) > _NEAR:
        return math.exp(x)
    square = x * x
    even = 1.0 + square * (1 / 2 + square * (1 / 24 + square * (1 / 720 + square * (1 / 40320))))
    odd = 1.0 + square * (1 / 6 + square * (1 / 120 + square * (1 / 5040)))
    return even + x * odd


@njit(**OPTIONS)
def begin_cars(W: Array, p: int, base: Array) -> None:
    """Give all lanes of p directions the numbers of a car, ``base`` (12,), before any moves."""
    for b in range(blocks(p)):
        row = np.uint64(b) * SIZE + CAR
        for c in range(12):
            for q in range(NONE, EIGHT):
                W[row + q] = base[c]
            row += ONE


@njit(**OPTIONS)
def place_cars(
    W: Array,
    mu: Array,
    D: Array,
    reach: float,
    which: NDArray[np.int64],
    log: NDArray[np.bool_],
    centre: Array,
    scale: Array,
) -> float:
    """Give every lane its car; return a rate (1/s) that no motion of theirs exceeds.

    Parameters
    ----------
    W : (blocks(p) · BLOCK,) array
        Lanes as :func:`begin_cars` left them, filled in place.
    mu : (p + q,) array
        Coordinates of the reference; the last q change no car.
    D : (p + q, p + q) array
        Row i is direction i, zero before its i-th number.
    reach : float
        Distance of the sigma points in units of the directions.
    which, log, centre, scale : (p,) arrays
        Number k of the car is exp(centre + scale μ) where ``log``, else centre + scale μ.
    """
    p = which.shape[0]
    count = blocks(p)
    for k in range(p):
        row = CAR + np.uint64(which[k]) * ONE
        value = centre[k] + scale[k] * mu[k]
        if log[k]:
            value = math.exp(value)
        for b in range(count):
            at = np.uint64(b) * SIZE + row
            for q in range(NONE, EIGHT):
                W[at + q] = value
        for i in range(k + 1):
            by = reach * scale[k] * D[i, k]
            if log[k]:
                W[place(1 + 2 * i) + row] = value * _exp(by)
                W[place(2 + 2 * i) + row] = value * _exp(-by)
            else:
                W[place(1 + 2 * i) + row] = value + by
                W[place(2 + 2 * i) + row] = value - by
    fastest = 0.0
    for b in range(count):
        at = np.uint64(b) * SIZE
        _matrices(W, at)
        for q in range(NONE, EIGHT):
            fastest = max(fastest, W[at + RATE + q])
    for lane in range(1 + 2 * p, count * LANES):  # no wheel drives these
        W[place(lane) + UF] = 0.0
        W[place(lane) + UR] = 0.0
    return fastest


@njit(**OPTIONS)
def _matrices(W: Array, at: np.uint64) -> None:
    """Fill the system matrices of one block."""
    car = at + CAR
    for q in range(NONE, EIGHT):
        c_f, c_r = W[car + q], W[car + ONE + q]
        over_i = 1.0 / W[car + A2 + q]
        over_m = 1.0 / W[car + A3 + q]
        l, wdf = W[car + A4 + q], W[car + A5 + q]
        k_f, k_r = W[car + A6 + q], W[car + A7 + q]
        l_f = l * (1.0 - wdf)
        l_r = l * wdf
        ff = over_m + l_f * l_f * over_i
        fr = over_m - l_f * l_r * over_i
        rr = over_m + l_r * l_r * over_i
        W[at + A0 + q] = -ff * k_f
        W[at + A1 + q] = -ff * c_f
        W[at + A2 + q] = -fr * k_r
        W[at + A3 + q] = -fr * c_r
        W[at + A4 + q] = -fr * k_f
        W[at + A5 + q] = -fr * c_f
        W[at + A6 + q] = -rr * k_r
        W[at + A7 + q] = -rr * c_r
        damping = max(ff * c_f, rr * c_r) + abs(fr) * max(c_f, c_r)
        stiffness = max(ff * k_f, rr * k_r) + abs(fr) * max(k_f, k_r)
        W[at + RATE + q] = damping + math.sqrt(stiffness)
        W[at + UF + q] = 1.0 / W[car + X0 + q]
        W[at + GF + q] = W[car + X1 + q]
        W[at + UR + q] = 1.0 / W[car + X2 + q]
        W[at + GR + q] = W[car + X3 + q]


@njit(**OPTIONS)
def step(
    W: Array,
    p: int,
    reach: float,
    x: Array,
    J: Array,
    h: float,
    moments: Array,
    inputs: Array,
    fastest: float,
    structure: bool,
) -> None:
    """Carry all lanes over one step.

    Parameters
    ----------
    W : (blocks(p) · BLOCK,) array
        Lanes with their cars; what they arrive at is read by :func:`moved`.
    p : int
        Number of directions.
    reach : float
        Distance of the sigma points in units of the directions.
    x : (10,) array
        State of the filter at the reference.
    J : (p, 10) array
        Its derivative along each direction.
    h : float
        Length of the step, s.
    moments : (2, ORDER) array
        As in :func:`bayes_asv.filters.kalman.log_likelihood`.
    inputs : (2, TAYLOR + 1) array
        Room to work in.
    fastest : float
        What :func:`place_cars` returned.
    structure : bool
        Whether the lanes behind the sigma points are wanted as well.
    """
    spread(W, p, reach, x, J)
    sigma = 1 + 2 * p
    last = sigma
    for lane in range(sigma):
        W[place(lane) + H] = h
    if structure:
        last = sigma + STRUCTURE
        for lane in range(sigma, last):
            at = place(lane)
            W[at + X0] = W[at + X1] = W[at + X2] = W[at + X3] = 0.0
            W[at + WF] = W[at + WR] = 0.0
            W[at + H] = h
        W[place(sigma) + X1] = W[place(sigma + 1) + X3] = 1.0
        W[place(sigma + 2) + WF] = W[place(sigma + 3) + WR] = 1.0
        for g in range(2):
            s = h * (0.5 + (g - 0.5) * _GAUSS)
            W[place(sigma + 4 + g) + X1] = W[place(sigma + 6 + g) + X3] = 1.0
            W[place(sigma + 4 + g) + H] = W[place(sigma + 6 + g) + H] = s
    order = 1
    term = fastest * h
    while term > _LEFT_OUT and order < TAYLOR:
        order += 1
        term *= fastest * h / order
    # Moments in the form that Horner's rule takes: ∫ (1 − s/h)ʲ u ds, all of the size of u h.
    factor = 1.0
    over = 1.0 / h
    for j in range(order + 1):
        if j < ORDER:
            inputs[0, j] = -moments[0, j] * factor
            inputs[1, j] = -moments[1, j] * factor
            factor *= (j + 1) * over
        else:
            inputs[0, j] = inputs[1, j] = 0.0
    for b in range((last + LANES - 1) // LANES):
        _horner(W, np.uint64(b) * SIZE, inputs, order)


@njit(**OPTIONS)
def _horner(W: Array, at: np.uint64, inputs: Array, order: int) -> None:
    """Carry one block over its step."""
    for q in range(NONE, EIGHT):
        m = at + q
        h = W[m + H] / (order + 1)
        W[m + V0] = W[m + X0]
        W[m + V2] = W[m + X2]
        W[m + V1] = W[m + X1] + W[m + UF] * inputs[0, order] + W[m + WF] * h
        W[m + V3] = W[m + X3] + W[m + UR] * inputs[1, order] + W[m + WR] * h
    for j in range(order - 1, -1, -1):
        front = inputs[0, j]
        rear = inputs[1, j]
        share = 1.0 / (j + 1)
        for q in range(NONE, EIGHT):
            m = at + q
            h = W[m + H] * share
            v0, v1, v2, v3 = W[m + V0], W[m + V1], W[m + V2], W[m + V3]
            front_rate = W[m + WF] + W[m + A0] * v0 + W[m + A1] * v1
            front_rate += W[m + A2] * v2 + W[m + A3] * v3
            rear_rate = W[m + WR] + W[m + A4] * v0 + W[m + A5] * v1
            rear_rate += W[m + A6] * v2 + W[m + A7] * v3
            W[m + V0] = W[m + X0] + h * v1
            W[m + V1] = W[m + X1] + W[m + UF] * front + h * front_rate
            W[m + V2] = W[m + X2] + h * v3
            W[m + V3] = W[m + X3] + W[m + UR] * rear + h * rear_rate


@njit(**OPTIONS)
def spread(W: Array, p: int, reach: float, x: Array, J: Array) -> None:
    """Give the sigma points their states: x and x ± reach J along each direction."""
    W[X0], W[X1], W[X2], W[X3], W[WF], W[WR] = x[0], x[1], x[2], x[3], x[6], x[7]
    for i in range(p):
        up, down = place(1 + 2 * i), place(2 + 2 * i)
        b0, b1, b2, b3 = reach * J[i, 0], reach * J[i, 1], reach * J[i, 2], reach * J[i, 3]
        bf, br = reach * J[i, 6], reach * J[i, 7]
        W[up + X0], W[up + X1], W[up + X2], W[up + X3] = (
            x[0] + b0,
            x[1] + b1,
            x[2] + b2,
            x[3] + b3,
        )
        W[down + X0], W[down + X1], W[down + X2], W[down + X3] = (
            x[0] - b0,
            x[1] - b1,
            x[2] - b2,
            x[3] - b3,
        )
        W[up + WF], W[up + WR] = x[6] + bf, x[7] + br
        W[down + WF], W[down + WR] = x[6] - bf, x[7] - br


@njit(**OPTIONS)
def moved(W: Array, p: int, reach: float, x: Array, J: Array, bent: Array, room: Array) -> None:
    """Read the states of the car after a step.

    ``x`` and ``J`` get mean and odd part; ``bent`` (4, 4) gets the variance that is in the even
    part, Σ e eᵀ/reach², with e half the sum of both sigma points less the reference.  ``room``
    (2, 4) is to work in.
    """
    e, mean = room[0], room[1]
    for a in range(4):
        mean[a] = 0.0
        for b in range(4):
            bent[a, b] = 0.0
    over = 1.0 / (reach * reach)
    half = 0.5 / reach
    for i in range(p):
        up, down = place(1 + 2 * i) + V0, place(2 + 2 * i) + V0
        middle = V0
        for a in range(4):
            plus, minus = W[up], W[down]
            J[i, a] = (plus - minus) * half
            e[a] = 0.5 * (plus + minus) - W[middle]
            mean[a] += e[a]
            up, down, middle = up + ONE, down + ONE, middle + ONE
        for a in range(4):
            for b in range(a + 1):
                bent[a, b] += e[a] * e[b]
    middle = V0
    for a in range(4):
        x[a] = W[middle] + mean[a] * over
        middle += ONE
        for b in range(a + 1):
            bent[a, b] *= over
            bent[b, a] = bent[a, b]


@njit(**OPTIONS)
def structure_of(
    W: Array, p: int, h: float, phi: Array, gamma: Array, qf: Array, qr: Array
) -> None:
    """Read Φ, Γ and the two process-noise matrices, as in ``steps.transition``."""
    sigma = 1 + 2 * p
    row = V0
    for a in range(4):
        front, rear = W[place(sigma + 2) + row], W[place(sigma + 3) + row]
        gamma[a, 0], gamma[a, 1] = front, rear
        phi[a, 0] = W[A0] * front + W[A4] * rear
        phi[a, 1] = W[place(sigma) + row]
        phi[a, 2] = W[A2] * front + W[A6] * rear
        phi[a, 3] = W[place(sigma + 1) + row]
        other = V0
        for b in range(a + 1):
            qf[a, b] = qf[b, a] = (0.5 * h) * (
                W[place(sigma + 4) + row] * W[place(sigma + 4) + other]
                + W[place(sigma + 5) + row] * W[place(sigma + 5) + other]
            )
            qr[a, b] = qr[b, a] = (0.5 * h) * (
                W[place(sigma + 6) + row] * W[place(sigma + 6) + other]
                + W[place(sigma + 7) + row] * W[place(sigma + 7) + other]
            )
            other += ONE
        row += ONE
    phi[0, 0] += 1.0
    phi[2, 2] += 1.0
