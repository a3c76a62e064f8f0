"""Predicted measurement of the unscented filter: readings of all sigma points, and their mean."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.prediction import INLINE, OPTIONS
from bayes_asv.filters.simd_batch import set_states
from bayes_asv.filters.simd_layout import LANES, Rows, Shape, accelerations, lane_offset
from bayes_asv.filters.ukf_state import Sizes

__all__ = [
    "SIGMA_DISTANCE",
    "interaction_variance",
    "odd_parts",
    "output_matrix",
    "outputs",
    "predict_measurement",
]


@njit(**OPTIONS)
def outputs(
    rows: Rows,
    shape: Shape,
    W: Array,
    p: int,
    output_row: NDArray[np.int64],
    by_row: Array,
    by_state: Array,
    reads_states: bool,
    y: Array,
) -> None:
    """Fill ``y`` (1 + 2 p, ny) with the readings at all sigma points."""
    size = np.uint64(rows.size)
    for b in range((2 * p + LANES) // LANES):
        accelerations(shape, W, np.uint64(b) * size)
    for o in range(by_row.shape[0]):
        row = np.uint64(rows.slope) + np.uint64(output_row[o]) * np.uint64(LANES)
        gain = np.uint64(rows.gain) + np.uint64(o) * np.uint64(LANES)
        by = by_row[o]
        for lane in range(1 + 2 * p):
            at = np.uint64(lane >> 3) * size + np.uint64(lane & 7)
            value = by * W[at + row]
            if reads_states:
                for a in range(by_state.shape[1]):
                    value += by_state[o, a] * W[at + np.uint64(rows.before + a * LANES)]
            y[lane, o] = W[at + gain] * value


@njit(**INLINE)
def odd_parts(sizes: Sizes, rows: Rows, W: Array, p: int, distance: float, odd: Array) -> None:
    """Fill ``odd`` (p, nR · 2 ne): derivatives of the accelerations along each direction."""
    half = 0.5 / distance
    for i in range(p):
        up, down = lane_offset(1 + 2 * i, rows.size), lane_offset(2 + 2 * i, rows.size)
        for a in range(sizes.rows * 2 * sizes.elements):
            row = np.uint64(rows.A + a * LANES)
            odd[i, a] = half * (W[up + row] - W[down + row])


@njit(**INLINE)
def interaction_variance(sizes: Sizes, odd: Array, Pi: Array, work: Array, B: Array) -> None:
    """Fill B (nR, nR): variance of accelerations due to uncertain parameters times uncertain state.

    Accelerations are bilinear in parameters and state.  Sigma points along the axes do not see the
    variance Σ_i A_i Π A_iᵀ, with A_i the odd part of their rows along direction i.  ``work``
    (2 ne,) is room to work in.
    """
    nc, nR = 2 * sizes.elements, sizes.rows
    for r in range(nR):
        for s in range(r + 1):
            B[r, s] = 0.0
    for i in range(odd.shape[0]):
        for r in range(nR):
            for a in range(nc):
                total = 0.0
                for b in range(nc):
                    total += Pi[a, b] * odd[i, nc * r + b]
                work[a] = total
            for s in range(r + 1):
                total = 0.0
                for a in range(nc):
                    total += odd[i, nc * s + a] * work[a]
                B[r, s] += total
    for r in range(nR):
        for s in range(r):
            B[s, r] = B[r, s]


@njit(**INLINE)
def output_matrix(
    sizes: Sizes,
    rows: Rows,
    W: Array,
    output_row: NDArray[np.int64],
    by_row: Array,
    by_state: Array,
    C: Array,
    gain: Array,
) -> None:
    """Fill C (ny, nx), readings by the states at the reference, and the gains (ny,)."""
    nc = 2 * sizes.elements
    for o in range(sizes.outputs):
        gain[o] = W[np.uint64(rows.gain + o * LANES)]
        first = np.uint64(rows.A) + np.uint64(output_row[o]) * np.uint64(nc * LANES)
        for a in range(sizes.motion - sizes.forces):
            C[o, a] = gain[o] * by_state[o, a]
        for a in range(nc):
            C[o, a] += gain[o] * (by_row[o] * W[first + np.uint64(a * LANES)])
        for f in range(sizes.forces):
            by_rate = W[first + np.uint64((2 * f + 1) * LANES)]
            damping = W[np.uint64(rows.damping + f * LANES)]
            C[o, sizes.motion - sizes.forces + f] = -gain[o] * by_row[o] * by_rate / damping


Array = NDArray[np.float64]

SIGMA_DISTANCE: Final = math.sqrt(3.0)
"""Distance of the sigma points in standard deviations; √3 matches the fourth moment of a normal."""


@njit(**INLINE)
def predict_measurement(
    sizes: Sizes,
    rows: Rows,
    shape: Shape,
    W: Array,
    n_model: int,
    x: Array,
    J: Array,
    Pi: Array,
    input_bias: Array,
    output_row: NDArray[np.int64],
    by_row: Array,
    by_state: Array,
    reads_states: bool,
    C: Array,
    y: Array,
    predicted: Array,
    g: Array,
    PC: Array,
    given_d: Array,
) -> None:
    """Predict the readings of all outputs.

    Parameters
    ----------
    sizes, rows, shape : Sizes, Rows and Shape
        Of the car.
    W : array
        Lanes of the sigma points.
    n_model : int
        Number of directions that change the model; the others change the state alone.
    x, J, Pi : arrays
        Belief of the filter, see :class:`bayes_asv.filters.ukf_state.State`.
    input_bias, output_row, by_row, by_state, reads_states
        Of :class:`bayes_asv.filters.ukf_state.Model`.
    C : (ny, nx) array
        Readings by states at the reference.
    y : (1 + 2 n_model, ny) array
        Workspace.
    predicted, g : (ny,) and (ny, p) arrays
        Filled: ``predicted + g d`` is the mean of each reading given d.
    PC : (ny, ns) array
        Filled with the covariance of each reading with the state given d.
    given_d : (ny, ny) array
        Filled with the covariance of the readings given d, without their white noise.
    """
    nx, ny, ns = sizes.motion, sizes.outputs, sizes.states
    noise = sizes.lasting + sizes.elements
    set_states(sizes, rows, W, n_model, SIGMA_DISTANCE, x, J, input_bias)
    outputs(rows, shape, W, n_model, output_row, by_row, by_state, reads_states, y)
    over = 1.0 / (SIGMA_DISTANCE * SIGMA_DISTANCE)
    half = 0.5 / SIGMA_DISTANCE
    for o in range(ny):
        predicted[o] = y[0, o] + x[nx + o] + x[noise + o]
        for i in range(n_model):
            g[o, i] = J[i, nx + o] + J[i, noise + o] + (y[1 + 2 * i, o] - y[2 + 2 * i, o]) * half
        for i in range(n_model, J.shape[0]):  # directions that change the state alone
            total = J[i, nx + o] + J[i, noise + o]
            for a in range(nx):
                total += C[o, a] * J[i, a]
            g[o, i] = total
        for a in range(ns):
            PC[o, a] = Pi[nx + o, a] + Pi[noise + o, a]
        for b in range(nx):
            by = C[o, b]
            for a in range(ns):
                PC[o, a] += by * Pi[b, a]
    for o in range(ny):
        for other in range(o + 1):
            total = PC[o, nx + other] + PC[o, noise + other]
            for b in range(nx):
                total += C[other, b] * PC[o, b]
            given_d[o, other] = total
    for i in range(n_model):
        up, down = 1 + 2 * i, 2 + 2 * i
        for o in range(ny):
            even = 0.5 * (y[up, o] + y[down, o]) - y[0, o]
            predicted[o] += even * over
            for other in range(o + 1):
                given_d[o, other] += (
                    even * (0.5 * (y[up, other] + y[down, other]) - y[0, other]) * over
                )
    for o in range(ny):
        for other in range(o):
            given_d[other, o] = given_d[o, other]
