"""Measurement prediction of the unscented filter from its sigma points, compiled."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.prediction import OPTIONS
from bayes_asv.filters.simd_batch import set_states
from bayes_asv.filters.simd_outputs import outputs
from bayes_asv.filters.ukf_state import State

__all__ = ["SIGMA_DISTANCE", "predict_measurement"]

Array = NDArray[np.float64]

SIGMA_DISTANCE: Final = math.sqrt(3.0)
"""Distance of the sigma points in standard deviations; √3 matches the fourth moment of a normal."""


@njit(**OPTIONS)
def predict_measurement(
    W: Array,
    n_model: int,
    state: State,
    C: Array,
    y: Array,
    predicted: Array,
    g: Array,
    PC: Array,
    variance_given_d: Array,
) -> float:
    """Predict both chassis readings; return their covariance given d.

    Parameters
    ----------
    W : array
        Lanes of the sigma points.
    n_model : int
        Number of directions that change the model; the others change the state alone.
    state : State
        Belief of the filter.
    C : (2, 4) array
        Readings by states at the reference.
    y : (1 + 2 n_model, 2) array
        Workspace.
    predicted, g : (2,) and (2, p) arrays
        Filled: ``predicted + g d`` is the mean of each reading given d.
    PC : (2, 10) array
        Filled with the covariance of each reading with the state given d.
    variance_given_d : (2,) array
        Filled with the variance of each reading given d, without its white noise.
    """
    x, J, Pi = state.x, state.J, state.Pi
    set_states(W, n_model, SIGMA_DISTANCE, x, J)
    outputs(W, n_model, y)
    over = 1.0 / (SIGMA_DISTANCE * SIGMA_DISTANCE)
    half = 0.5 / SIGMA_DISTANCE
    even_covariance = 0.0
    for axle in range(2):
        predicted[axle] = y[0, axle] + x[4 + axle] + x[8 + axle]
        variance_given_d[axle] = 0.0
    for i in range(n_model):
        up, down = 1 + 2 * i, 2 + 2 * i
        e0 = 0.5 * (y[up, 0] + y[down, 0]) - y[0, 0]
        e1 = 0.5 * (y[up, 1] + y[down, 1]) - y[0, 1]
        g[0, i] = J[i, 4] + J[i, 8] + (y[up, 0] - y[down, 0]) * half
        g[1, i] = J[i, 5] + J[i, 9] + (y[up, 1] - y[down, 1]) * half
        predicted[0] += e0 * over
        predicted[1] += e1 * over
        variance_given_d[0] += e0 * e0 * over
        variance_given_d[1] += e1 * e1 * over
        even_covariance += e0 * e1 * over
    for axle in range(2):
        for i in range(n_model, J.shape[0]):  # directions that change the state alone
            g[axle, i] = J[i, 4 + axle] + J[i, 8 + axle]
            for a in range(4):
                g[axle, i] += C[axle, a] * J[i, a]
        for a in range(10):
            PC[axle, a] = Pi[4 + axle, a] + Pi[8 + axle, a]
            for b in range(4):
                PC[axle, a] += C[axle, b] * Pi[b, a]
        variance_given_d[axle] += PC[axle, 4 + axle] + PC[axle, 8 + axle]
        for b in range(4):
            variance_given_d[axle] += C[axle, b] * PC[axle, b]
    covariance: float = even_covariance + PC[1, 4] + PC[1, 8]
    for b in range(4):
        covariance += C[0, b] * PC[1, b]
    return covariance
