"""The free-running response of the half car, compiled.

Readable reference: ``bayes_asv.models.half_car.deflection_form`` with a matrix exponential, in
the tests.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["free_run"]

_TAYLOR = 14


@njit(cache=True, nogil=True, error_model="numpy")
def free_run(
    A: NDArray[np.float64],
    step: NDArray[np.float64],
    moments: NDArray[np.float64],
    start: NDArray[np.float64],
    driven: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Fill ``out`` with the states of several trajectories at once.

    Parameters
    ----------
    A : (4, 4) array
        System matrix in deflection coordinates.
    step : (N,) array
        Time since the instant before, s.
    moments : (N, 2, J) array
        Moments of the wheel accelerations over each step.
    start : (4, C) array
        States at the first instant.
    driven : (C,) array
        Share of the wheels' input that each trajectory gets, 1 or 0.
    out : (N, 4, C) array
        States (δ_f, δ̇_f, δ_r, δ̇_r) at the instants, in metres and m/s.
    """
    n, order, columns = step.shape[0], moments.shape[2], start.shape[1]
    powers = np.zeros((_TAYLOR + 1, 4, 4))
    for a in range(4):
        powers[0, a, a] = 1.0
    for j in range(1, _TAYLOR + 1):
        for a in range(4):
            for b in range(4):
                acc = 0.0
                for e in range(4):
                    acc += A[a, e] * powers[j - 1, e, b]
                powers[j, a, b] = acc / j
    phi = np.zeros((4, 4))
    known = -1.0
    forced = np.zeros(4)
    for a in range(4):
        for c in range(columns):
            out[0, a, c] = start[a, c]
    for k in range(1, n):
        h = step[k]
        if abs(h - known) > 1e-12:
            known = h
            for a in range(4):
                for b in range(4):
                    acc = powers[_TAYLOR, a, b]
                    for j in range(_TAYLOR - 1, -1, -1):
                        acc = acc * h + powers[j, a, b]
                    phi[a, b] = acc
        for a in range(4):
            acc = 0.0
            factorial = 1.0
            for j in range(order):
                if j > 0:
                    factorial *= j
                acc -= factorial * (
                    powers[j, a, 1] * moments[k, 0, j] + powers[j, a, 3] * moments[k, 1, j]
                )
            forced[a] = acc
        for a in range(4):
            for c in range(columns):
                acc = forced[a] * driven[c]
                for b in range(4):
                    acc += phi[a, b] * out[k - 1, b, c]
                out[k, a, c] = acc
