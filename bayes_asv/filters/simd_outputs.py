"""Measurement functions of the lanes: chassis readings of all sigma points, and interactions."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.prediction import OPTIONS
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
    ROW,
    WIDTH,
    X0,
    X1,
    X2,
    X3,
    YF,
    YR,
    ZERO,
    lane_offset,
)  # fmt: skip

__all__ = ["interaction_variance", "odd_parts", "output_matrix", "outputs"]

Array = NDArray[np.float64]


@njit(**OPTIONS)
def outputs(W: Array, p: int, y: Array) -> None:
    """Fill ``y`` (1 + 2 p, 2) with the chassis readings at all sigma points."""
    for b in range((2 * p + LANES) // LANES):
        at = np.uint64(b) * BLOCK_SIZE
        for q in range(ZERO, WIDTH):
            m = at + q
            x0, x1, x2, x3 = W[m + X0], W[m + X1], W[m + X2], W[m + X3]
            front = W[m + A0] * x0 + W[m + A1] * x1 + W[m + A2] * x2 + W[m + A3] * x3
            rear = W[m + A4] * x0 + W[m + A5] * x1 + W[m + A6] * x2 + W[m + A7] * x3
            W[m + YF] = W[m + GF] * front
            W[m + YR] = W[m + GR] * rear
    for lane in range(1 + 2 * p):
        y[lane, 0] = W[lane_offset(lane) + YF]
        y[lane, 1] = W[lane_offset(lane) + YR]


@njit(**OPTIONS)
def odd_parts(W: Array, p: int, distance: float, odd: Array) -> None:
    """Fill ``odd`` (p, 8): derivatives of A's rows δ̈_f and δ̈_r along each direction."""
    half = 0.5 / distance
    for i in range(p):
        up, down = lane_offset(1 + 2 * i), lane_offset(2 + 2 * i)
        for a in range(8):
            odd[i, a] = half * (W[up] - W[down])
            up, down = up + ROW, down + ROW


@njit(**OPTIONS)
def interaction_variance(odd: Array, Pi: Array, B: Array) -> None:
    """Fill B (2, 2): variance of δ̈_f and δ̈_r due to uncertain parameters times uncertain state.

    δ̈ is bilinear in parameters and state.  Sigma points along the axes do not see the variance
    Σ_i A_i Π A_iᵀ, with A_i the odd part of these rows of A along direction i.
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
    """Fill C (2, 4), chassis readings by the states at the reference, and the gains (2,)."""
    gain[0], gain[1] = W[GF], W[GR]
    row = A0
    for a in range(4):
        C[0, a] = gain[0] * W[row]
        C[1, a] = gain[1] * W[row + A4]
        row += ROW
