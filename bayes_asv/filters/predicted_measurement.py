"""What the unscented filter expects to read, from the sigma points as they stand, compiled."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.discretization import OPTIONS
from bayes_asv.filters.simd_batch import spread
from bayes_asv.filters.simd_outputs import outputs
from bayes_asv.filters.ukf_state import State

__all__ = ["REACH", "expect"]

Array = NDArray[np.float64]

REACH: Final = math.sqrt(3.0)
"""Distance of the sigma points in deviations: a normal's fourth moment."""


@njit(**OPTIONS)
def expect(
    W: Array,
    cars: int,
    state: State,
    C: Array,
    y: Array,
    expected: Array,
    g: Array,
    PC: Array,
    rest: Array,
) -> float:
    """Fill what both chassis readings are expected to be; return their covariance given d.

    ``expected`` + ``g`` d is the mean of each given d, ``rest`` its variance without the white
    noise of the reading, ``PC`` its covariance with the state.
    """
    x, J, Pi = state.x, state.J, state.Pi
    spread(W, cars, REACH, x, J)
    outputs(W, cars, y)
    over = 1.0 / (REACH * REACH)
    half = 0.5 / REACH
    between = 0.0
    for axle in range(2):
        expected[axle] = y[0, axle] + x[4 + axle] + x[8 + axle]
        rest[axle] = 0.0
    for i in range(cars):
        up, down = 1 + 2 * i, 2 + 2 * i
        e0 = 0.5 * (y[up, 0] + y[down, 0]) - y[0, 0]
        e1 = 0.5 * (y[up, 1] + y[down, 1]) - y[0, 1]
        g[0, i] = J[i, 4] + J[i, 8] + (y[up, 0] - y[down, 0]) * half
        g[1, i] = J[i, 5] + J[i, 9] + (y[up, 1] - y[down, 1]) * half
        expected[0] += e0 * over
        expected[1] += e1 * over
        rest[0] += e0 * e0 * over
        rest[1] += e1 * e1 * over
        between += e0 * e1 * over
    for axle in range(2):
        for i in range(cars, J.shape[0]):  # directions that change no car
            g[axle, i] = J[i, 4 + axle] + J[i, 8 + axle]
            for a in range(4):
                g[axle, i] += C[axle, a] * J[i, a]
        for a in range(10):
            PC[axle, a] = Pi[4 + axle, a] + Pi[8 + axle, a]
            for b in range(4):
                PC[axle, a] += C[axle, b] * Pi[b, a]
        rest[axle] += PC[axle, 4 + axle] + PC[axle, 8 + axle]
        for b in range(4):
            rest[axle] += C[axle, b] * PC[axle, b]
    covariance: float = between + PC[1, 4] + PC[1, 8]
    for b in range(4):
        covariance += C[0, b] * PC[1, b]
    return covariance
