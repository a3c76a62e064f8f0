"""Propagation of many half cars over the same step: sigma points in the lanes of a vector unit.

A lane holds one car with one state x = (δ_f, δ̇_f, δ_r, δ̇_r).  Over a step of length h with the
inputs' moments i_f, i_r its state becomes::

    x⁺ = Σ_j (A h)ʲ/j! (x + e_f i_fj + e_r i_rj)

evaluated by Horner's rule from the highest order down, eight lanes at a time.  Lane 0 is the
reference, lanes 1 + 2 i and 2 + 2 i are the sigma points at plus and minus the distance along
direction i.  Eight more lanes with the reference's parameters give the transition matrices: two
columns of Φ, both of Γ, and the two Gauss nodes of each axle's process noise (see
:func:`bayes_asv.filters.prediction.discretize`).  The other columns of Φ follow from
Φ e = e + ∫ Φ(s) A e ds, such as e + A0 Γ_f + A4 Γ_r.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.prediction import OPTIONS, ORDER, TAYLOR
from bayes_asv.filters.simd_layout import (
    A0,
    A1,
    A2,
    A3,
    A4,
    A5,
    A6,
    A7,
    BLOCK_SIZE,
    GF,
    GR,
    LANES,
    PARAMETERS,
    RATE,
    ROW,
    TRANSITION_LANES,
    UF,
    UR,
    V0,
    V1,
    V2,
    V3,
    WF,
    WIDTH,
    WR,
    X0,
    X1,
    X2,
    X3,
    ZERO,
    H,
    blocks,
    lane_offset,
)  # fmt: skip

__all__ = [
    "fill_lanes",
    "propagate",
    "set_parameters",
    "set_states",
    "transition_matrices",
    "unscented_moments",
]

Array = NDArray[np.float64]

_GAUSS = 1.0 / math.sqrt(3.0)
_SERIES_LIMIT = 1 / 16  # where x⁹/9! is 4e-17
_TRUNCATION = 1e-14  # first omitted term of the exponential series


@njit(**OPTIONS)
def _exp(x: float) -> float:
    """Exponential function, by nine terms of its series for small arguments.

    The series is exact to rounding there, and five times as fast as the library's function.
    """
    if abs(x) > _SERIES_LIMIT:
        return math.exp(x)
    square = x * x
    even = 1.0 + square * (1 / 2 + square * (1 / 24 + square * (1 / 720 + square * (1 / 40320))))
    odd = 1.0 + square * (1 / 6 + square * (1 / 120 + square * (1 / 5040)))
    return even + x * odd


@njit(**OPTIONS)
def fill_lanes(W: Array, p: int, base: Array) -> None:
    """Fill all lanes of p directions with one parameter vector, ``base`` (12,)."""
    for b in range(blocks(p)):
        row = np.uint64(b) * BLOCK_SIZE + PARAMETERS
        for c in range(12):
            for q in range(ZERO, WIDTH):
                W[row + q] = base[c]
            row += ROW


@njit(**OPTIONS)
def set_parameters(
    W: Array,
    mu: Array,
    D: Array,
    distance: float,
    element: NDArray[np.int64],
    log: NDArray[np.bool_],
    centre: Array,
    scale: Array,
) -> float:
    """Set the parameters of every lane; return a bound of all eigenvalues' magnitude (1/s).

    Parameters
    ----------
    W : (blocks(p) · BLOCK,) array
        Lanes, after :func:`fill_lanes`; changed in place.
    mu : (p + q,) array
        Coordinates of the reference; the last q have no effect on the parameters.
    D : (p + q, p + q) array
        Row i is direction i, zero before its i-th element.
    distance : float
        Distance of the sigma points in units of the directions.
    element, log, centre, scale : (p,) arrays
        Element ``element`` of the parameter vector is exp(centre + scale μ) where ``log``, else
        centre + scale μ.
    """
    p = element.shape[0]
    count = blocks(p)
    for k in range(p):
        row = PARAMETERS + np.uint64(element[k]) * ROW
        value = centre[k] + scale[k] * mu[k]
        if log[k]:
            value = math.exp(value)
        for b in range(count):
            at = np.uint64(b) * BLOCK_SIZE + row
            for q in range(ZERO, WIDTH):
                W[at + q] = value
        for i in range(k + 1):
            by = distance * scale[k] * D[i, k]
            if log[k]:
                W[lane_offset(1 + 2 * i) + row] = value * _exp(by)
                W[lane_offset(2 + 2 * i) + row] = value * _exp(-by)
            else:
                W[lane_offset(1 + 2 * i) + row] = value + by
                W[lane_offset(2 + 2 * i) + row] = value - by
    max_rate = 0.0
    for b in range(count):
        at = np.uint64(b) * BLOCK_SIZE
        _matrices(W, at)
        for q in range(ZERO, WIDTH):
            max_rate = max(max_rate, W[at + RATE + q])
    for lane in range(1 + 2 * p, count * LANES):  # no wheel input
        W[lane_offset(lane) + UF] = 0.0
        W[lane_offset(lane) + UR] = 0.0
    return max_rate


@njit(**OPTIONS)
def _matrices(W: Array, at: np.uint64) -> None:
    """Fill the system matrices of one block."""
    car = at + PARAMETERS
    for q in range(ZERO, WIDTH):
        c_f, c_r = W[car + q], W[car + ROW + q]
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
def propagate(
    W: Array,
    p: int,
    distance: float,
    x: Array,
    J: Array,
    h: float,
    moments: Array,
    inputs: Array,
    max_rate: float,
    with_transition: bool,
) -> None:
    """Propagate all lanes over one step.

    Parameters
    ----------
    W : (blocks(p) · BLOCK,) array
        Lanes with their parameters; the new states are read by :func:`unscented_moments`.
    p : int
        Number of directions.
    distance : float
        Distance of the sigma points in units of the directions.
    x : (10,) array
        State of the filter at the reference.
    J : (p, 10) array
        Its derivatives along the directions.
    h : float
        Length of the step, s.
    moments : (2, ORDER) array
        ∫₀ʰ (h−s)ʲ/j! û(s) ds of both wheels' acceleration.
    inputs : (2, TAYLOR + 1) array
        Workspace.
    max_rate : float
        From :func:`set_parameters`.
    with_transition : bool
        Whether the lanes of the transition matrices are propagated as well.
    """
    set_states(W, p, distance, x, J)
    sigma = 1 + 2 * p
    last = sigma
    for lane in range(sigma):
        W[lane_offset(lane) + H] = h
    if with_transition:
        last = sigma + TRANSITION_LANES
        for lane in range(sigma, last):
            at = lane_offset(lane)
            W[at + X0] = W[at + X1] = W[at + X2] = W[at + X3] = 0.0
            W[at + WF] = W[at + WR] = 0.0
            W[at + H] = h
        W[lane_offset(sigma) + X1] = W[lane_offset(sigma + 1) + X3] = 1.0
        W[lane_offset(sigma + 2) + WF] = W[lane_offset(sigma + 3) + WR] = 1.0
        for g in range(2):
            s = h * (0.5 + (g - 0.5) * _GAUSS)
            W[lane_offset(sigma + 4 + g) + X1] = W[lane_offset(sigma + 6 + g) + X3] = 1.0
            W[lane_offset(sigma + 4 + g) + H] = W[lane_offset(sigma + 6 + g) + H] = s
    order = 1
    term = max_rate * h
    while term > _TRUNCATION and order < TAYLOR:
        order += 1
        term *= max_rate * h / order
    # Moments scaled for Horner's rule: ∫ (1 − s/h)ʲ u ds, all of the magnitude of u h.
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
        _horner(W, np.uint64(b) * BLOCK_SIZE, inputs, order)


@njit(**OPTIONS)
def _horner(W: Array, at: np.uint64, inputs: Array, order: int) -> None:
    """Propagate one block over its step."""
    for q in range(ZERO, WIDTH):
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
        for q in range(ZERO, WIDTH):
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
def set_states(W: Array, p: int, distance: float, x: Array, J: Array) -> None:
    """Set the states of the sigma points: x and x ± distance · J along each direction."""
    W[X0], W[X1], W[X2], W[X3], W[WF], W[WR] = x[0], x[1], x[2], x[3], x[6], x[7]
    for i in range(p):
        up, down = lane_offset(1 + 2 * i), lane_offset(2 + 2 * i)
        b0, b1, b2, b3 = (
            distance * J[i, 0],
            distance * J[i, 1],
            distance * J[i, 2],
            distance * J[i, 3],
        )
        bf, br = distance * J[i, 6], distance * J[i, 7]
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
def unscented_moments(
    W: Array, p: int, distance: float, x: Array, J: Array, even_covariance: Array, workspace: Array
) -> None:
    """Unscented mean, derivatives and covariance of the propagated states.

    Parameters
    ----------
    W : array
        Lanes after :func:`propagate`.
    p : int
        Number of directions.
    distance : float
        Distance of the sigma points in units of the directions.
    x, J : (10,) and (p, 10) arrays
        Filled in their first four columns: mean, and odd part along each direction.
    even_covariance : (4, 4) array
        Filled with Σ e eᵀ/distance², e being the even part: the mean of both sigma points less the
        reference.
    workspace : (2, 4) array
        Workspace.
    """
    e, mean = workspace[0], workspace[1]
    for a in range(4):
        mean[a] = 0.0
        for b in range(4):
            even_covariance[a, b] = 0.0
    over = 1.0 / (distance * distance)
    half = 0.5 / distance
    for i in range(p):
        up, down = lane_offset(1 + 2 * i) + V0, lane_offset(2 + 2 * i) + V0
        middle = V0
        for a in range(4):
            plus, minus = W[up], W[down]
            J[i, a] = (plus - minus) * half
            e[a] = 0.5 * (plus + minus) - W[middle]
            mean[a] += e[a]
            up, down, middle = up + ROW, down + ROW, middle + ROW
        for a in range(4):
            for b in range(a + 1):
                even_covariance[a, b] += e[a] * e[b]
    middle = V0
    for a in range(4):
        x[a] = W[middle] + mean[a] * over
        middle += ROW
        for b in range(a + 1):
            even_covariance[a, b] *= over
            even_covariance[b, a] = even_covariance[a, b]


@njit(**OPTIONS)
def transition_matrices(
    W: Array, p: int, h: float, phi: Array, gamma: Array, qf: Array, qr: Array
) -> None:
    """Read Φ, Γ and both axles' process-noise matrices, as in ``discretization.transition``."""
    sigma = 1 + 2 * p
    row = V0
    for a in range(4):
        front, rear = W[lane_offset(sigma + 2) + row], W[lane_offset(sigma + 3) + row]
        gamma[a, 0], gamma[a, 1] = front, rear
        phi[a, 0] = W[A0] * front + W[A4] * rear
        phi[a, 1] = W[lane_offset(sigma) + row]
        phi[a, 2] = W[A2] * front + W[A6] * rear
        phi[a, 3] = W[lane_offset(sigma + 1) + row]
        other = V0
        for b in range(a + 1):
            qf[a, b] = qf[b, a] = (0.5 * h) * (
                W[lane_offset(sigma + 4) + row] * W[lane_offset(sigma + 4) + other]
                + W[lane_offset(sigma + 5) + row] * W[lane_offset(sigma + 5) + other]
            )
            qr[a, b] = qr[b, a] = (0.5 * h) * (
                W[lane_offset(sigma + 6) + row] * W[lane_offset(sigma + 6) + other]
                + W[lane_offset(sigma + 7) + row] * W[lane_offset(sigma + 7) + other]
            )
            other += ROW
        row += ROW
    phi[0, 0] += 1.0
    phi[2, 2] += 1.0
