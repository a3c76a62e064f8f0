"""Free-running response of a car, linear or not: its measured inputs alone drive it.

The same step as that of the filter (see :mod:`.prediction` and :mod:`.suspension_forces`) without
its measurement updates.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.kalman import (
    NO_LAWS,
    Laws,
    Measurements,
    StateSpace,
    forces_with_memory,
    readout,
)
from bayes_asv.filters.prediction import (
    OPTIONS,
    ORDER,
    STEP_LENGTHS,
    STEP_SERIES,
    TAYLOR,
    find_step,
    power_series,
    step_weights,
)
from bayes_asv.filters.suspension_forces import (
    advance_forces,
    bend_weights,
    force_weights,
    law_workspace,
    rate_slopes,
)
from bayes_asv.filters.vector_code import LANES, lanes_last
from bayes_asv.filters.vector_steps import advance_mean_vectors, discretize_vectors

__all__ = ["free_response"]

Array = NDArray[np.float64]


@lru_cache(maxsize=64)
def _compiled(nx: int, ne: int, ns: int, nm: int, nd: int, nu: int, ny: int) -> Callable[..., None]:
    lanes = LANES
    nf = nx + ne
    rows = nf + nm
    coupled = rows + nd + nu

    @njit(**OPTIONS)
    def run(
        A: Array,
        B: Array,
        C: Array,
        E: Array,
        rates: Array,
        table: Array,
        N: Array,
        step: Array,
        moments: Array,
        pole: float,
        inputs: Array,
        elapsed: Array,
        added: Array,
        begin: Array,
        output: Array,
        states: Array,
    ) -> None:
        powers = np.empty((TAYLOR + 1, nx, nx, lanes))
        drive = np.empty((nu, ORDER, nx, lanes))
        power_series(nx, nu, lanes, A, B, powers, drive)
        lengths = np.full(STEP_LENGTHS, -1.0)
        kept_base = np.zeros((STEP_LENGTHS, rows, coupled, lanes))
        kept_W = np.zeros((STEP_LENGTHS, 3, nf, ne, lanes))
        Q = np.zeros((nu, nx, nx, lanes))
        weights = np.empty((STEP_SERIES, TAYLOR + 1))
        last = np.zeros((2, ne, lanes))
        force = np.zeros((2, ne, lanes))
        stiffness = np.zeros((2, ne, lanes))
        damping = np.zeros((2, ne, lanes))
        rate = np.zeros((2, ne, lanes))
        by = np.zeros((ne, coupled, lanes))
        bends = np.zeros(2)
        lag = np.full(1, 1.0 / pole)
        rate_slopes(nx, ne, nd, nu, nm, lanes, powers, B, E, N, lag, by)
        series = np.zeros((4, nm, lanes))
        work = law_workspace(ne)
        ahead = np.empty((rows, lanes))
        room = np.empty((2, rows, lanes))
        mean = np.zeros((coupled, lanes))
        for q in range(lanes):
            for a in range(nx):
                mean[a, q] = begin[a, q]
            for d in range(nd):
                mean[rows + d, q] = begin[nx + d, q]
            for e in range(ns):  # as if it had been linear before the recording began
                mean[nf + e, q] = rates[e, 0, q] * begin[2 * e + 1, q]
        h_before, oldest = 0.0, 0
        for k in range(step.shape[0]):
            h = step[k]
            if h > 0.0:
                slot, known, oldest = find_step(h, lengths, oldest)
                base, W = kept_base[slot], kept_W[slot]
                if not known:
                    step_weights(h, weights)
                    discretize_vectors(nx, nd, nu, rows, coupled, weights, powers, B, N, base, Q)
                    if ne > 0:
                        force_weights(nx, ne, lanes, h, powers, E, pole, base, W, room[0], room[1])
                advance_mean_vectors(
                    nx, nu, rows, coupled, coupled, 1, base, drive, moments[k], mean, ahead
                )
                if ne > 0:
                    bends[0], bends[1] = bend_weights(h, h_before)
                    h_before = h
                    advance_forces(
                        nx, ne, nu, ns, nm, coupled, table, rates, B, lag, mean, k, h, bends,
                        inputs, elapsed, added, W, by, last, force, stiffness, damping, rate,
                        series, work, ahead,
                    )  # fmt: skip
                for a in range(rows):
                    for q in range(lanes):
                        mean[a, q] = ahead[a, q]
            for y in range(ny):
                for q in range(lanes):
                    output[k, y, q] = begin[nx + nd + y, q]
                for a in range(rows):
                    for q in range(lanes):
                        output[k, y, q] += C[y, a, q] * mean[a, q]
            for a in range(nf):
                for q in range(lanes):
                    states[k, a, q] = mean[a, q]

    return run  # type: ignore[no-any-return]


def free_response(
    system: StateSpace, data: Measurements, begin: Array, laws: Laws | None = None
) -> tuple[Array, Array]:
    """Simulate one recording from its measured inputs, W times.

    Parameters
    ----------
    system : StateSpace
        W parameter sets, or one for all.
    data : Measurements
        Steps of the recording and the moments of its inputs; readings play no part.
    begin : (W, nx + nd + ny) array
        States at the first instant, input biases, and biases of the outputs.
    laws : Laws, optional
        Force laws of the suspension, of W parameter sets or of one.

    Returns
    -------
    output : (W, N, ny) array
        Predicted readings.
    states : (W, N, nx + ne) array
        States of the car and, with laws, filtered excess forces.
    """
    _, nx, nu = system.B.shape
    W, ny = len(begin), system.C.shape[1]
    ne = 0 if laws is None else system.E.shape[2]
    ns, nm = (0, 0) if laws is None else forces_with_memory(laws, ne)
    C = system.C if laws is None else readout(system, nm)
    laws = NO_LAWS if laws is None else laws
    run = _compiled(nx, ne, ns, nm, system.N.shape[1], nu, ny)
    forces, rates = system.E[:, :, :ne], system.rates[:, :ne]
    A, B, C, forces, rates, tables, begin = (
        lanes_last(np.broadcast_to(x, (W, *x.shape[1:])))
        for x in (system.A, system.B, C, forces, rates, laws.table, begin)
    )
    output = np.empty((len(A), len(data.step), ny, LANES))
    states = np.empty((len(A), len(data.step), nx + ne, LANES))
    for b in range(len(A)):
        run(
            A[b], B[b], C[b], forces[b], rates[b], tables[b], system.N, data.step, data.moments,
            laws.pole, laws.inputs, laws.elapsed, laws.added, begin[b], output[b], states[b],
        )  # fmt: skip
    first, second = (
        np.moveaxis(x, -1, 1).reshape(-1, *x.shape[1:-1])[:W] for x in (output, states)
    )
    return first, second
