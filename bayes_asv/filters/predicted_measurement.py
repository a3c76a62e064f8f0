"""Measurement prediction of the unscented filter from its sigma points, compiled."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.prediction import IN_PLACE
from bayes_asv.filters.simd_batch import set_states
from bayes_asv.filters.simd_layout import Rows
from bayes_asv.filters.simd_outputs import outputs
from bayes_asv.filters.simd_source import Shape
from bayes_asv.filters.ukf_state import Sizes

__all__ = ["SIGMA_DISTANCE", "predict_measurement"]

Array = NDArray[np.float64]

SIGMA_DISTANCE: Final = math.sqrt(3.0)
"""Distance of the sigma points in standard deviations; √3 matches the fourth moment of a normal."""


@njit(**IN_PLACE)
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
