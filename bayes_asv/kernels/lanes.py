"""Many half cars side by side, each over the same step: sigma points in the lanes of a vector unit.

A lane holds one car with one state x = (δ_f, δ̇_f, δ_r, δ̇_r).  Over a step of length h its state
goes to::

    x⁺ = Σ_j (A h)ʲ/j! (x + e_f i_fj + e_r i_rj)

which Horner's rule takes from the highest order down, eight lanes at a time.  Lane 0 is the car
at the reference, lanes 1 + 2 i and 2 + 2 i are those at plus and minus the spread along direction
i, and behind them stand ten of the reference car that give Φ, Γ and the two Gauss nodes of the
process noise (see :func:`bayes_asv.kernels.steps.transition`).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.kernels.steps import OPTIONS, ORDER, TAYLOR

__all__ = [
    "BLOCK", "blocks", "crossed", "moved", "odd_parts", "output_matrix", "outputs",
    "place_cars", "spread", "step", "structure_of",
]  # fmt: skip

Array = NDArray[np.float64]

LANES = 8  # in a block
_ROWS = 38  # of a block
BLOCK = _ROWS * LANES
_STRUCTURE = 10  # lanes behind the sigma points
_GAUSS = 1.0 / math.sqrt(3.0)
_LEFT_OUT = 1e-14  # of the exponential series, the term after the last one that is taken


def _row(number: int) -> np.uint64:
    """Where a row of a block begins.

    One array with fixed offsets, so that the compiler sees that rows do not overlap; without a
    sign, so that it need not think of places counted from the end.  Either would cost it the
    vector unit, and eight times the time.
    """
    return np.uint64(number * LANES)


_A0, _A1, _A2, _A3 = _row(0), _row(1), _row(2), _row(3)  # δ̈_f by the four states
_A4, _A5, _A6, _A7 = _row(4), _row(5), _row(6), _row(7)  # δ̈_r
_X0, _X1, _X2, _X3 = _row(8), _row(9), _row(10), _row(11)  # states before
_V0, _V1, _V2, _V3 = _row(12), _row(13), _row(14), _row(15)  # states after
_WF, _WR = _row(16), _row(17)  # steady input, m/s²
_UF, _UR = _row(18), _row(19)  # share of the wheels' input
_H = _row(20)  # length of the step, s
_YF, _YR = _row(21), _row(22)  # chassis readings
_GF, _GR = _row(23), _row(24)  # reading over truth of the chassis sensors
_RATE = _row(25)  # no motion of the car is faster, 1/s
_CAR = _row(26)  # the twelve numbers of a car
_ONE = _row(1)
_NONE, _EIGHT = np.uint64(0), np.uint64(LANES)
_SIZE = np.uint64(BLOCK)


@njit(**OPTIONS)
def blocks(p: int) -> int:
    """Count the blocks that p directions take."""
    return (1 + 2 * p + _STRUCTURE + LANES - 1) // LANES


@njit(**OPTIONS)
def _at(lane: int) -> np.uint64:
    """Place of a lane in the first row of its block."""
    return np.uint64(lane >> 3) * _SIZE + np.uint64(lane & 7)


@njit(**OPTIONS)
def place_cars(
    W: Array,
    mu: Array,
    D: Array,
    reach: float,
    base: Array,
    which: NDArray[np.int64],
    log: NDArray[np.bool_],
    centre: Array,
    scale: Array,
) -> float:
    """Give every lane its car; return a rate (1/s) that no motion of theirs exceeds.

    Parameters
    ----------
    W : (blocks(p) · BLOCK,) array
        Lanes, filled in place.
    mu : (p + q,) array
        Coordinates of the reference; the last q change no car.
    D : (p + q, p + q) array
        Row i is direction i, zero before its i-th number.
    reach : float
        Distance of the sigma points in units of the directions.
    base : (12,) array
        Car and gains where no coordinate says otherwise.
    which, log, centre, scale : (p,) arrays
        Number k of the car is exp(centre + scale μ) where ``log``, else centre + scale μ.
    """
    p = which.shape[0]
    count = blocks(p)
    for b in range(count):
        row = np.uint64(b) * _SIZE + _CAR
        for c in range(12):
            for q in range(_NONE, _EIGHT):
                W[row + q] = base[c]
            row += _ONE
    for k in range(p):
        row = _CAR + np.uint64(which[k]) * _ONE
        value = centre[k] + scale[k] * mu[k]
        if log[k]:
            value = math.exp(value)
        for b in range(count):
            at = np.uint64(b) * _SIZE + row
            for q in range(_NONE, _EIGHT):
                W[at + q] = value
        for i in range(k + 1):
            by = reach * scale[k] * D[i, k]
            if log[k]:
                factor = math.exp(by)
                W[_at(1 + 2 * i) + row] = value * factor
                W[_at(2 + 2 * i) + row] = value / factor
            else:
                W[_at(1 + 2 * i) + row] = value + by
                W[_at(2 + 2 * i) + row] = value - by
    fastest = 0.0
    for b in range(count):
        at = np.uint64(b) * _SIZE
        _matrices(W, at)
        for q in range(_NONE, _EIGHT):
            fastest = max(fastest, W[at + _RATE + q])
    for lane in range(1 + 2 * p, count * LANES):  # no wheel drives these
        W[_at(lane) + _UF] = 0.0
        W[_at(lane) + _UR] = 0.0
    return fastest


@njit(**OPTIONS)
def _matrices(W: Array, at: np.uint64) -> None:
    """Fill the system matrices of one block."""
    car = at + _CAR
    for q in range(_NONE, _EIGHT):
        c_f, c_r = W[car + q], W[car + _ONE + q]
        over_i = 1.0 / W[car + _A2 + q]
        over_m = 1.0 / W[car + _A3 + q]
        l, wdf = W[car + _A4 + q], W[car + _A5 + q]
        k_f, k_r = W[car + _A6 + q], W[car + _A7 + q]
        l_f = l * (1.0 - wdf)
        l_r = l * wdf
        ff = over_m + l_f * l_f * over_i
        fr = over_m - l_f * l_r * over_i
        rr = over_m + l_r * l_r * over_i
        W[at + _A0 + q] = -ff * k_f
        W[at + _A1 + q] = -ff * c_f
        W[at + _A2 + q] = -fr * k_r
        W[at + _A3 + q] = -fr * c_r
        W[at + _A4 + q] = -fr * k_f
        W[at + _A5 + q] = -fr * c_f
        W[at + _A6 + q] = -rr * k_r
        W[at + _A7 + q] = -rr * c_r
        damping = max(ff * c_f, rr * c_r) + abs(fr) * max(c_f, c_r)
        stiffness = max(ff * k_f, rr * k_r) + abs(fr) * max(k_f, k_r)
        W[at + _RATE + q] = damping + math.sqrt(stiffness)
        W[at + _UF + q] = 1.0 / W[car + _X0 + q]
        W[at + _GF + q] = W[car + _X1 + q]
        W[at + _UR + q] = 1.0 / W[car + _X2 + q]
        W[at + _GR + q] = W[car + _X3 + q]


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
        As in :func:`bayes_asv.kernels.innovations.log_likelihood`.
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
        W[_at(lane) + _H] = h
    if structure:
        last = sigma + _STRUCTURE
        for lane in range(sigma, last):
            at = _at(lane)
            W[at + _X0] = W[at + _X1] = W[at + _X2] = W[at + _X3] = 0.0
            W[at + _WF] = W[at + _WR] = 0.0
            W[at + _H] = h
        W[_at(sigma) + _X0] = W[_at(sigma + 1) + _X1] = 1.0
        W[_at(sigma + 2) + _X2] = W[_at(sigma + 3) + _X3] = 1.0
        W[_at(sigma + 4) + _WF] = W[_at(sigma + 5) + _WR] = 1.0
        for g in range(2):
            s = h * (0.5 + (g - 0.5) * _GAUSS)
            W[_at(sigma + 6 + g) + _X1] = W[_at(sigma + 8 + g) + _X3] = 1.0
            W[_at(sigma + 6 + g) + _H] = W[_at(sigma + 8 + g) + _H] = s
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
        _horner(W, np.uint64(b) * _SIZE, inputs, order)


@njit(**OPTIONS)
def _horner(W: Array, at: np.uint64, inputs: Array, order: int) -> None:
    """Carry one block over its step."""
    for q in range(_NONE, _EIGHT):
        m = at + q
        h = W[m + _H] / (order + 1)
        W[m + _V0] = W[m + _X0]
        W[m + _V2] = W[m + _X2]
        W[m + _V1] = W[m + _X1] + W[m + _UF] * inputs[0, order] + W[m + _WF] * h
        W[m + _V3] = W[m + _X3] + W[m + _UR] * inputs[1, order] + W[m + _WR] * h
    for j in range(order - 1, -1, -1):
        front = inputs[0, j]
        rear = inputs[1, j]
        share = 1.0 / (j + 1)
        for q in range(_NONE, _EIGHT):
            m = at + q
            h = W[m + _H] * share
            v0, v1, v2, v3 = W[m + _V0], W[m + _V1], W[m + _V2], W[m + _V3]
            front_rate = W[m + _WF] + W[m + _A0] * v0 + W[m + _A1] * v1
            front_rate += W[m + _A2] * v2 + W[m + _A3] * v3
            rear_rate = W[m + _WR] + W[m + _A4] * v0 + W[m + _A5] * v1
            rear_rate += W[m + _A6] * v2 + W[m + _A7] * v3
            W[m + _V0] = W[m + _X0] + h * v1
            W[m + _V1] = W[m + _X1] + W[m + _UF] * front + h * front_rate
            W[m + _V2] = W[m + _X2] + h * v3
            W[m + _V3] = W[m + _X3] + W[m + _UR] * rear + h * rear_rate


@njit(**OPTIONS)
def spread(W: Array, p: int, reach: float, x: Array, J: Array) -> None:
    """Give the sigma points their states: x and x ± reach J along each direction."""
    W[_X0], W[_X1], W[_X2], W[_X3], W[_WF], W[_WR] = x[0], x[1], x[2], x[3], x[6], x[7]
    for i in range(p):
        up, down = _at(1 + 2 * i), _at(2 + 2 * i)
        b0, b1, b2, b3 = reach * J[i, 0], reach * J[i, 1], reach * J[i, 2], reach * J[i, 3]
        bf, br = reach * J[i, 6], reach * J[i, 7]
        W[up + _X0], W[up + _X1], W[up + _X2], W[up + _X3] = (
            x[0] + b0,
            x[1] + b1,
            x[2] + b2,
            x[3] + b3,
        )
        W[down + _X0], W[down + _X1], W[down + _X2], W[down + _X3] = (
            x[0] - b0,
            x[1] - b1,
            x[2] - b2,
            x[3] - b3,
        )
        W[up + _WF], W[up + _WR] = x[6] + bf, x[7] + br
        W[down + _WF], W[down + _WR] = x[6] - bf, x[7] - br


@njit(**OPTIONS)
def moved(W: Array, p: int, reach: float, x: Array, J: Array, bent: Array) -> None:
    """Read the states of the car after a step.

    ``x`` and ``J`` get mean and odd part; ``bent`` (4, 4) gets the variance that is in the even
    part, Σ e eᵀ/reach², with e half the sum of both sigma points less the reference.
    """
    e = np.empty(4)
    mean = np.zeros(4)
    bent[:] = 0.0
    over = 1.0 / (reach * reach)
    for i in range(p):
        up, down = _at(1 + 2 * i) + _V0, _at(2 + 2 * i) + _V0
        middle = _V0
        for a in range(4):
            plus, minus = W[up], W[down]
            J[i, a] = (plus - minus) * (0.5 / reach)
            e[a] = 0.5 * (plus + minus) - W[middle]
            mean[a] += e[a] * over
            up, down, middle = up + _ONE, down + _ONE, middle + _ONE
        for a in range(4):
            for b in range(4):
                bent[a, b] += e[a] * e[b] * over
    x[0], x[1] = W[_V0] + mean[0], W[_V1] + mean[1]
    x[2], x[3] = W[_V2] + mean[2], W[_V3] + mean[3]


@njit(**OPTIONS)
def structure_of(
    W: Array, p: int, h: float, phi: Array, gamma: Array, qf: Array, qr: Array
) -> None:
    """Read Φ, Γ and the two process-noise matrices, as in ``steps.transition``."""
    sigma = 1 + 2 * p
    row = _V0
    for a in range(4):
        for b in range(4):
            phi[a, b] = W[_at(sigma + b) + row]
        gamma[a, 0] = W[_at(sigma + 4) + row]
        gamma[a, 1] = W[_at(sigma + 5) + row]
        other = _V0
        for b in range(a + 1):
            qf[a, b] = qf[b, a] = (0.5 * h) * (
                W[_at(sigma + 6) + row] * W[_at(sigma + 6) + other]
                + W[_at(sigma + 7) + row] * W[_at(sigma + 7) + other]
            )
            qr[a, b] = qr[b, a] = (0.5 * h) * (
                W[_at(sigma + 8) + row] * W[_at(sigma + 8) + other]
                + W[_at(sigma + 9) + row] * W[_at(sigma + 9) + other]
            )
            other += _ONE
        row += _ONE


@njit(**OPTIONS)
def outputs(W: Array, p: int, y: Array) -> None:
    """Fill ``y`` (1 + 2 p, 2) with the chassis readings at all sigma points."""
    for b in range((2 * p + LANES) // LANES):
        at = np.uint64(b) * _SIZE
        for q in range(_NONE, _EIGHT):
            m = at + q
            x0, x1, x2, x3 = W[m + _X0], W[m + _X1], W[m + _X2], W[m + _X3]
            front = W[m + _A0] * x0 + W[m + _A1] * x1 + W[m + _A2] * x2 + W[m + _A3] * x3
            rear = W[m + _A4] * x0 + W[m + _A5] * x1 + W[m + _A6] * x2 + W[m + _A7] * x3
            W[m + _YF] = W[m + _GF] * front
            W[m + _YR] = W[m + _GR] * rear
    for lane in range(1 + 2 * p):
        y[lane, 0] = W[_at(lane) + _YF]
        y[lane, 1] = W[_at(lane) + _YR]


@njit(**OPTIONS)
def odd_parts(W: Array, p: int, reach: float, odd: Array) -> None:
    """Fill ``odd`` (p, 8): how δ̈_f and δ̈_r by the four states change along each direction."""
    half = 0.5 / reach
    for i in range(p):
        up, down = _at(1 + 2 * i), _at(2 + 2 * i)
        for a in range(8):
            odd[i, a] = half * (W[up] - W[down])
            up, down = up + _ONE, down + _ONE


@njit(**OPTIONS)
def crossed(odd: Array, Pi: Array, B: Array) -> None:
    """Fill B (2, 2): variance of δ̈_f and δ̈_r that needs both parameters and state to be off.

    A reading is a product of parameters and state.  Points along one axis at a time do not see
    Σ_i A_i Π A_iᵀ, with A_i the odd part of the last rows of A along direction i.
    """
    ff, fr, rr = 0.0, 0.0, 0.0
    for i in range(odd.shape[0]):
        for a in range(4):
            front = 0.0
            rear = 0.0
            for b in range(4):
                front += Pi[a, b] * odd[i, b]
                rear += Pi[a, b] * odd[i, 4 + b]
            ff += odd[i, a] * front
            fr += odd[i, 4 + a] * front
            rr += odd[i, 4 + a] * rear
    B[0, 0], B[0, 1], B[1, 0], B[1, 1] = ff, fr, fr, rr


@njit(**OPTIONS)
def output_matrix(W: Array, C: Array, gain: Array) -> None:
    """Fill C (2, 4), chassis readings by the reference car's states, and their gains (2,)."""
    gain[0], gain[1] = W[_GF], W[_GR]
    row = _A0
    for a in range(4):
        C[0, a] = gain[0] * W[row]
        C[1, a] = gain[1] * W[row + _A4]
        row += _ONE
