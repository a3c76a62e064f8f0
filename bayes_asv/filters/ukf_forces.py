"""Prediction step of the unscented filter for a car with force laws, compiled.

The force laws and their discretisation are those of :mod:`bayes_asv.filters.suspension_forces`: the
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
    STEP_SERIES,
    TAYLOR,
    power_series,
    step_weights,
)
from bayes_asv.filters.simd_layout import LANES, Rows, lane_offset
from bayes_asv.filters.suspension_forces import (
    LawWorkspace,
    advance_forces,
    bend_weights,
    force_weights,
    law_workspace,
    rate_slopes,
)
from bayes_asv.filters.ukf_state import GRID, LawTable, Sizes
from bayes_asv.filters.vector_steps import (
    advance_mean_vectors,
    discretize_vectors,
    linearise_vectors,
)

__all__ = ["ForceWorkspace", "force_workspace", "propagate_with_forces"]

Array = NDArray[np.float64]

_GRID_FIRST, _GRID_STEP = float(GRID[0]), float(GRID[1] - GRID[0])
_GRID_POINTS = len(GRID)


class ForceWorkspace(NamedTuple):
    """Arrays of :func:`propagate_with_forces`.

    They are named as in :mod:`.prediction` and :mod:`.suspension_forces`.  Most begin with an axis
    of blocks and end in one of lanes; each lane of a block is a sigma point.
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
    series_weights: Array
    weights: Array
    term: Array
    after: Array
    mean: Array
    ahead: Array
    force: Array
    stiffness: Array
    damping: Array
    rate: Array
    by: Array
    series: Array
    laws: LawWorkspace
    lag: Array
    bends: Array
    elapsed: Array
    added: Array


@njit(**OPTIONS)
def force_workspace(sizes: Sizes, laws: LawTable, points: int) -> ForceWorkspace:
    """Make the arrays for a number of sigma points."""
    ne, nf = sizes.elements, sizes.motion
    nx, coupled, L = nf - sizes.forces, nf + ne, LANES
    K = (points + LANES - 1) // LANES
    table = np.empty((K, laws.rows.shape[0], laws.rows.shape[1], L))
    for b in range(K):
        for q in range(L):
            table[b, :, :, q] = laws.rows
    return ForceWorkspace(
        np.zeros((K, nx, nx, L)), np.zeros((K, nx, ne, L)), np.zeros((K, nx, ne, L)),
        np.zeros((ne, 0)), np.ones((K, ne, 2, L)), table,
        np.zeros((K, TAYLOR + 1, nx, nx, L)), np.zeros((K, ne, ORDER, nx, L)),
        np.zeros((K, nf, coupled, L)), np.zeros((nf, coupled, L)),
        np.zeros((K, ne, nx, nx, L)), np.zeros((STEP_SERIES, TAYLOR + 1)),
        np.zeros((K, 3, nf, ne, L)), np.zeros((nf, L)), np.zeros((nf, L)),
        np.zeros((coupled, L)), np.zeros((nf, L)), np.zeros((2, ne, L)),
        np.zeros((2, ne, L)), np.zeros((2, ne, L)), np.zeros((2, ne, L)),
        np.zeros((K, ne, coupled, L)), np.zeros((4, 0, L)), law_workspace(ne),
        np.full(1, 1.0 / laws.pole), np.zeros(2), np.array([0.0, 1.0]), np.zeros((2, ne)),
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
    points: int,
) -> None:
    """Fill system matrices, rates and laws of each sigma point from its parameters."""
    ne, nr = sizes.elements, sizes.rates
    for point in range(points):
        at = lane_offset(point, rows.size)
        block, q = point // LANES, point % LANES
        A, B, E, rates = work.A[block], work.B[block], work.E[block], work.rates[block]
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
            work.table[block, laws.entry[n, 0], laws.entry[n, 1], q] = _interpolate(
                laws.number[n], z
            )


@njit(**OPTIONS)
def propagate_with_forces(
    nx: int,
    ne: int,
    nf: int,
    coupled: int,
    sizes: Sizes,
    rows: Rows,
    W: Array,
    points: int,
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
    """Propagate all sigma points over step k, and linearise it at the reference.

    Parameters
    ----------
    nx, ne, nf, coupled : int
        States of the car, elements, states of the motion with the filtered forces, and states that
        drive them.
    sizes, rows : Sizes and Rows
        Of the car.
    W : array
        Lanes with their parameters, after :func:`bayes_asv.filters.simd_batch.set_states`; the new
        states are read by :func:`bayes_asv.filters.simd_batch.unscented_moments`.
    points : int
        Number of sigma points, the reference among them.
    h, before : float
        Lengths of this step and of the one before, s; zero where there was none.
    moments, ends : (N, ne, ORDER) and (N, 2, ne) arrays
        See :class:`bayes_asv.filters.ukf_state.Steps`.
    place, laws : array and LawTable
        Of :class:`bayes_asv.filters.ukf_state.Model`.
    history : (K, 2, ne, LANES) array
        See :class:`bayes_asv.filters.ukf_state.State`; changed in place.
    new_parameters, new_length : bool
        Whether the parameters, or the length of the step, are others than in the last call.
    work : ForceWorkspace
        Workspace.
    phi, gamma, Q : (nf, nf), (nf, ne) and (ne, nf, nf) arrays
        Filled with the derivatives of the new motion by the old one and by the inputs' noise, and
        with the process noise of an input of unit intensity.
    """
    if new_parameters:
        _set_laws(sizes, rows, W, place, laws, work, points)
    mean, ahead = work.mean, work.ahead
    work.bends[0], work.bends[1] = bend_weights(h, before)
    for b in range(history.shape[0]):
        if new_parameters:
            power_series(nx, ne, LANES, work.A[b], work.B[b], work.powers[b], work.drive[b])
            rate_slopes(
                nx, ne, 0, ne, 0, LANES, work.powers[b], work.B[b], work.E[b], work.N, work.lag,
                work.by[b],
            )  # fmt: skip
        if new_parameters or new_length:
            step_weights(h, work.series_weights)
            discretize_vectors(
                nx, 0, ne, nf, coupled, work.series_weights, work.powers[b], work.B[b], work.N,
                work.base[b], work.Q[b],
            )  # fmt: skip
            force_weights(
                nx, ne, LANES, h, work.powers[b], work.E[b], laws.pole, work.base[b],
                work.weights[b], work.term, work.after,
            )  # fmt: skip
        used = min(LANES, points - b * LANES)
        for q in range(used):
            at = lane_offset(b * LANES + q, rows.size)
            for a in range(nf):
                mean[a, q] = W[at + np.uint64(rows.before + a * LANES)]
            for u in range(ne):
                mean[nf + u, q] = W[at + np.uint64(rows.forcing + u * LANES)]
        advance_mean_vectors(
            nx, ne, nf, coupled, coupled, 1, work.base[b], work.drive[b], moments[k], mean, ahead
        )
        advance_forces(
            nx, ne, ne, 0, 0, coupled, work.table[b], work.rates[b], work.B[b], work.lag, mean,
            1, h, work.bends, ends[k], work.elapsed, work.added, work.weights[b], work.by[b],
            history[b], work.force, work.stiffness, work.damping, work.rate, work.series, work.laws,
            ahead,
        )  # fmt: skip
        for q in range(used):
            at = lane_offset(b * LANES + q, rows.size)
            for a in range(nf):
                W[at + np.uint64(rows.after + a * LANES)] = ahead[a, q]
        if b == 0:
            linearise_vectors(
                nx, ne, 0, coupled, work.base[0], work.weights[0], work.lag,
                work.by[0], work.stiffness, work.damping, work.series, work.carry,
            )  # fmt: skip
    for a in range(nf):
        for b in range(nf):
            phi[a, b] = work.carry[a, b, 0]
        for u in range(ne):
            gamma[a, u] = work.carry[a, nf + u, 0]
    if new_parameters or new_length:
        for u in range(ne):
            for a in range(nx):
                for b in range(nx):
                    Q[u, a, b] = work.Q[0, u, a, b, 0]
