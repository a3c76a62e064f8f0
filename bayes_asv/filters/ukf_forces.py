"""Prediction step of the unscented filter for a car with force laws, compiled.

The force laws and their discretization are those of :mod:`bayes_asv.filters.suspension_forces`: the
forces that passed the sensors' filter are states behind those of the motion.  Each sigma point of
the parameters is a lane, with laws, rates and motion of its own.  Given the parameters the motion
is not linear any more; its covariance follows the slopes of the forces at the reference, as in the
extended Kalman filter of ``estimate``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.prediction import (
    OPTIONS,
    ORDER,
    TAYLOR,
    advance_mean,
    discretize,
    power_series,
)
from bayes_asv.filters.simd_layout import LANES, Rows, lane_offset
from bayes_asv.filters.suspension_forces import (
    advance_forces,
    bend_weights,
    force_weights,
    linearise,
)
from bayes_asv.filters.ukf_state import LawTable, Sizes

__all__ = ["ForceWorkspace", "force_workspace", "propagate_with_forces"]

Array = NDArray[np.float64]

_GRID_FIRST, _GRID_STEP, _GRID_POINTS = -10.0, 0.05, 401  # of ukf_state.GRID


class ForceWorkspace(NamedTuple):
    """Arrays of :func:`propagate_with_forces`.

    They are named as in :mod:`.prediction` and :mod:`.suspension_forces`; most end in an axis of
    lanes, one a sigma point.
    """

    A: Array
    B: Array
    E: Array
    N: Array
    rates: Array
    table: Array
    powers: Array
    drive: Array
    base: Array
    carry: Array
    Q: Array
    work: Array
    impulse: Array
    weights: Array
    term: Array
    after: Array
    mean: Array
    ahead: Array
    forces: Array
    slopes: Array
    rate: Array
    by: Array
    series: Array
    elapsed: Array
    added: Array


@njit(**OPTIONS)
def force_workspace(sizes: Sizes, laws: LawTable, lanes: int) -> ForceWorkspace:
    """Make the arrays for a number of lanes."""
    ne, nf = sizes.elements, sizes.motion
    nx, coupled = nf - sizes.forces, nf + ne
    table = np.empty((lanes, laws.rows.shape[0], laws.rows.shape[1]))
    for q in range(lanes):
        table[q] = laws.rows
    return ForceWorkspace(
        np.zeros((nx, nx, lanes)), np.zeros((nx, ne, lanes)), np.zeros((nx, ne, lanes)),
        np.zeros((ne, 0)), np.zeros((ne, 2, lanes)), table,
        np.zeros((TAYLOR + 1, nx, nx, lanes)), np.zeros((ne, ORDER, nx, lanes)),
        np.zeros((nf, coupled, lanes)), np.zeros((nf, coupled, lanes)),
        np.zeros((ne, nx, nx, lanes)), np.zeros((nx, nx, lanes)), np.zeros((nx, ne, lanes)),
        np.zeros((3, nf, ne, lanes)), np.zeros((nf, lanes)), np.zeros((nf, lanes)),
        np.zeros((coupled, lanes)), np.zeros((nf, lanes)), np.zeros((2, ne, lanes)),
        np.zeros((2, ne, coupled, lanes)), np.zeros((2, ne, lanes)),
        np.zeros((2, ne, coupled, lanes)), np.zeros((4, 0, lanes)), np.array([0.0, 1.0]),
        np.zeros((2, ne)),
    )  # fmt: skip


@njit(**OPTIONS)
def _interpolate(values: Array, z: float) -> float:
    """Cubic through the four values on the grid of a coordinate that are around z."""
    at = min(max((z - _GRID_FIRST) / _GRID_STEP, 1.0), _GRID_POINTS - 3.0)
    k = int(at)
    t = at - k
    return float(
        values[k - 1] * (t * (1.0 - t) * (t - 2.0) / 6.0)
        + values[k] * ((t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0)
        + values[k + 1] * ((t + 1.0) * t * (2.0 - t) / 2.0)
        + values[k + 2] * ((t + 1.0) * t * (t - 1.0) / 6.0)
    )


@njit(**OPTIONS)
def _set_laws(
    sizes: Sizes,
    rows: Rows,
    W: Array,
    place: NDArray[np.int64],
    laws: LawTable,
    work: ForceWorkspace,
    lanes: int,
) -> None:
    """Fill system matrices, rates and laws of each lane from its parameters."""
    ne, nr = sizes.elements, sizes.rates
    A, B, E, rates = work.A, work.B, work.E, work.rates
    for q in range(lanes):
        at = lane_offset(q, rows.size)
        for e in range(ne):
            A[2 * e, 2 * e + 1, q] = 1.0
            B[2 * e + 1, e, q] = -W[at + np.uint64(rows.inverse_gain + e * LANES)]
            rates[e, 0, q] = W[at + np.uint64(rows.damping + e * LANES)]
            rates[e, 1, q] = W[at + np.uint64(rows.spring + e * LANES)]
        for r in range(ne + nr):
            row = 2 * r + 1 if r < ne else ne + r
            for c in range(2 * ne):
                A[row, c, q] = W[at + np.uint64(rows.A + (2 * ne * r + c) * LANES)]
            for f in range(ne):  # an acceleration by a rate of deflection is −c times that
                E[row, f, q] = -A[row, 2 * f + 1, q] / rates[f, 0, q]
        for n in range(laws.entry.shape[0]):
            z = W[at + np.uint64(rows.damping + place[laws.entry[n, 2]] * LANES)]
            work.table[q, laws.entry[n, 0], laws.entry[n, 1]] = _interpolate(laws.number[n], z)


@njit(**OPTIONS)
def propagate_with_forces(
    sizes: Sizes,
    rows: Rows,
    W: Array,
    lanes: int,
    h: float,
    before: float,
    moments: Array,
    k: int,
    ends: Array,
    place: NDArray[np.int64],
    laws: LawTable,
    history: Array,
    new_parameters: bool,
    new_length: bool,
    work: ForceWorkspace,
    phi: Array,
    gamma: Array,
    Q: Array,
) -> None:
    """Propagate all lanes over step k, and linearize it at the reference.

    Parameters
    ----------
    sizes, rows : Sizes and Rows
        Of the car.
    W : array
        Lanes with their parameters, after :func:`bayes_asv.filters.simd_batch.set_states`; the new
        states are read by :func:`bayes_asv.filters.simd_batch.unscented_moments`.
    lanes : int
        Number of sigma points, the reference among them.
    h, before : float
        Lengths of this step and of the one before, s; zero where there was none.
    moments, ends : (N, ne, ORDER) and (N, 2, ne) arrays
        See :class:`bayes_asv.filters.ukf_state.Steps`.
    place, laws : array and LawTable
        Of :class:`bayes_asv.filters.ukf_state.Model`.
    history : (3, ne, lanes) array
        See :class:`bayes_asv.filters.ukf_state.State`; changed in place.
    new_parameters, new_length : bool
        Whether the parameters, or the length of the step, are others than in the last call.
    work : ForceWorkspace
        Workspace.
    phi, gamma, Q : (nf, nf), (nf, ne) and (ne, nf, nf) arrays
        Filled with the derivatives of the new motion by the old one and by the inputs' noise, and
        with the process noise of an input of unit intensity.
    """
    ne, nf = sizes.elements, sizes.motion
    nx, coupled = nf - sizes.forces, nf + ne
    if new_parameters:
        _set_laws(sizes, rows, W, place, laws, work, lanes)
        power_series(nx, ne, lanes, work.A, work.B, work.powers, work.drive)
    if new_parameters or new_length:
        discretize(
            nx, 0, ne, nf, lanes, h, work.powers, work.B, work.N, work.base, work.Q, work.work,
            work.impulse,
        )  # fmt: skip
        force_weights(
            nx, ne, lanes, h, work.powers, work.E, laws.pole, work.base, work.weights, work.term,
            work.after,
        )  # fmt: skip
        for u in range(ne):
            for a in range(nx):
                for b in range(nx):
                    Q[u, a, b] = work.Q[u, a, b, 0]
    mean, ahead = work.mean, work.ahead
    for q in range(lanes):
        at = lane_offset(q, rows.size)
        for a in range(nf):
            mean[a, q] = W[at + np.uint64(rows.before + a * LANES)]
        for u in range(ne):
            mean[nf + u, q] = W[at + np.uint64(rows.forcing + u * LANES)]
    advance_mean(nx, ne, nf, coupled, lanes, work.base, work.drive, k, moments, mean, ahead)
    up, back = bend_weights(h, before)
    advance_forces(
        nx, ne, 0, ne, 0, lanes, True, work.table, work.rates, work.powers, work.B, work.E, work.N,
        laws.pole, mean, 1, h, up, back, ends[k], work.elapsed, work.added, work.weights, history,
        work.forces, work.slopes, work.rate, work.by, work.series, ahead,
    )  # fmt: skip
    linearise(
        nf, ne, 0, coupled, 1, work.base, work.weights, up, back, work.slopes, work.by, work.series,
        work.carry,
    )  # fmt: skip
    for q in range(lanes):
        at = lane_offset(q, rows.size)
        for a in range(nf):
            W[at + np.uint64(rows.after + a * LANES)] = ahead[a, q]
    for a in range(nf):
        for b in range(nf):
            phi[a, b] = work.carry[a, b, 0]
        for u in range(ne):
            gamma[a, u] = work.carry[a, nf + u, 0]
