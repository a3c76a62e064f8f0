"""The Kalman filter of a recording, linearised along its path: responses to small changes.

A candidate effect, a fault or a push changes the readings, the inputs or the forces of a recording
a little.  What that makes of the innovations, with the gains as they are, is a linear recursion in
the filter's mean, at a tenth of the price of a filter pass.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.prediction import OPTIONS, ORDER

__all__ = ["LinearisedFilter", "perturbation_response", "room_for"]

Array = NDArray[np.float64]


class LinearisedFilter(NamedTuple):
    """The filter of one recording and one parameter set, linearised along its own path.

    With n = nx + ne + nm + nd + nu + 2 ny states: those of the car, forces that passed the sensors'
    filter, forces with memory, biases and noise of the inputs, biases and noise of the outputs.
    The first nx + ne + nm are carried, and those before the outputs' drive them.

    Parameters
    ----------
    step : (N,) array
        Time since the instant before, s.
    transitions : (N, carried, driving) array
        From the states before a step to the carried states after it.
    feedback : (N, carried, nx + ne) array
        From a change of car and filtered forces within a step to its end, with what the
        suspension forces make of it there.
    by_force : (N, 2, nx + ne, ne) array
        By forces on the body that last over the step, and by those that grow over it.
    decay : (N, n) array
        What is left of the other states.
    gains : (N, ny, n) array
        Changes of the states by a reading that differs from its prediction; zero without a reading.
    roots : (N, ny) array
        Inverse standard deviations of the innovations; zero where there is no value.
    drive : (nu, ORDER, nx) array
        By moments of the inputs.
    C : (ny, carried) array
        Outputs by carried states.
    """

    step: Array
    transitions: Array
    feedback: Array
    by_force: Array
    decay: Array
    gains: Array
    roots: Array
    drive: Array
    C: Array


def room_for(nx: int, ne: int, nm: int, nd: int, nu: int, ny: int, step: Array) -> LinearisedFilter:
    """Make the arrays for a filter at instants that follow steps (N,); none for N = 0.

    The sizes are numbers of the car's states, suspension elements, dampers in series with a
    stiffness, biases of the inputs, inputs and outputs.
    """
    instants, forces, carried = len(step), nx + ne, nx + ne + nm
    driving = carried + nd + nu
    n = driving + 2 * ny
    return LinearisedFilter(
        step,
        np.zeros((instants, carried, driving)),
        np.zeros((instants, carried, forces)),
        np.zeros((instants, 2, forces, ne)),
        np.zeros((instants, n)),
        np.zeros((instants, ny, n)),
        np.zeros((instants, ny)),
        np.zeros((nu, ORDER, nx)),
        np.zeros((ny, carried)),
    )


def perturbation_response(
    linearised: LinearisedFilter, moments: Array, reading: Array, added: Array
) -> Array:
    """Change of normalised innovations by small changes of a recording, with fixed gain.

    Parameters
    ----------
    linearised : LinearisedFilter
        Of the recording.
    moments : (N, nu, ORDER) array
        Changes of the moments of the inputs.
    reading : (N, ny) array
        Changes of the outputs or rails.
    added : (N, ne) array
        Changes of the forces on the body at the elements, N; straight from instant to instant.

    Returns
    -------
    (N, ny) array
        Zero where there is no value.
    """
    out = np.zeros(reading.shape)
    _respond(*linearised, moments, reading, added, out)
    return out


@njit(**OPTIONS)
def _respond(
    step: Array,
    transitions: Array,
    feedback: Array,
    by_force: Array,
    decay: Array,
    gains: Array,
    roots: Array,
    drive: Array,
    C: Array,
    moments: Array,
    reading: Array,
    added: Array,
    out: Array,
) -> None:
    rows, coupled = transitions.shape[1:]
    nf, ny, n = feedback.shape[2], gains.shape[1], gains.shape[2]
    nu, order, nx = drive.shape
    ne = added.shape[1]
    state, ahead, within = np.zeros(n), np.zeros(rows), np.zeros(nf)
    for k in range(len(step)):
        if step[k] > 0.0:
            within[:] = 0.0
            for u in range(nu):
                for j in range(order):
                    for a in range(nx):
                        within[a] += drive[u, j, a] * moments[k, u, j]
            for a in range(nf):
                for e in range(ne):
                    within[a] += by_force[k, 0, a, e] * added[k - 1, e]
            for a in range(rows):
                total = 0.0
                for b in range(coupled):
                    total += transitions[k, a, b] * state[b]
                for b in range(nf):
                    total += feedback[k, a, b] * within[b]
                if a < nf:
                    for e in range(ne):
                        total += by_force[k, 1, a, e] * (added[k, e] - added[k - 1, e])
                ahead[a] = total
            state[:rows] = ahead
            for a in range(rows, n):
                state[a] *= decay[k, a]
        for y in range(ny):
            left = reading[k, y] - state[coupled + y] - state[coupled + ny + y]
            for a in range(rows):
                left -= C[y, a] * state[a]
            out[k, y] = left * roots[k, y]
            for a in range(n):
                state[a] += gains[k, y, a] * left
