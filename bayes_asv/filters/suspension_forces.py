"""Forces beyond the linear springs and dampers in the prediction step, compiled into the filter.

An excess force f of each suspension element is whatever its springs, dampers and stops do beyond
−k δ − c δ̇.  All readings passed the sensors' filter with pole λ.  A linear car does not notice: its
filtered motions obey the same equations.  A force that is not linear acts on the motion before the
filter, δ + δ̇/λ and δ̇ + δ̈/λ, and is then filtered itself::

    ẋ = A x + B u + E φ        φ' = λ (f − φ)        y = C x + G φ + …

φ, the forces that passed, are states behind those of the car.  This is exact for one pole; where no
filter is declared λ is above what the samples can show.  Forces enter a step as straight lines
between its ends (second-order exponential integrator; Hochbruck & Ostermann 2010, Acta Numerica 19,
eq. 2.39), the second end from a predictor.  The covariance follows the slopes along that path: an
extended Kalman filter, exact for a linear car.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.force_laws import excess
from bayes_asv.filters.prediction import INLINE, TAYLOR

__all__ = ["advance_forces", "force_weights", "linearise"]

Array = NDArray[np.float64]


@njit(**INLINE)
def force_weights(
    nx: int,
    ne: int,
    lanes: int,
    h: float,
    powers: Array,
    E: Array,
    pole: float,
    base: Array,
    W0: Array,
    W1: Array,
    term: Array,
    after: Array,
) -> None:
    """Fill what one step of length h makes of filtered and of new forces.

    Columns nx … nx + ne of ``base`` carry φ at the step's beginning, ``W0`` (nx + ne, ne, L) a
    force that is constant over the step, ``W1`` one that grows from zero to one newton.  ``term``
    and ``after`` (nx + ne, L) are room to work in.
    """
    for e in range(ne):
        for a in range(nx + ne):
            for q in range(lanes):
                term[a, q] = 1.0 if a == nx + e else 0.0
                base[a, nx + e, q] = W0[a, e, q] = W1[a, e, q] = 0.0
        for j in range(TAYLOR + 8):
            for a in range(nx + ne):
                for q in range(lanes):
                    base[a, nx + e, q] += term[a, q]
                    W0[a, e, q] += term[a, q] * pole * h / (j + 1)
                    W1[a, e, q] += term[a, q] * pole * h / ((j + 1) * (j + 2))
            for a in range(nx):
                for q in range(lanes):
                    total = 0.0
                    for b in range(nx):
                        total += powers[1, a, b, q] * term[b, q]
                    for f in range(ne):
                        total += E[a, f, q] * term[nx + f, q]
                    after[a, q] = total
            for f in range(ne):
                for q in range(lanes):
                    after[nx + f, q] = -pole * term[nx + f, q]
            for a in range(nx + ne):
                for q in range(lanes):
                    term[a, q] = after[a, q] * h / (j + 1)


@njit(**INLINE)
def _excess_forces(
    nx: int,
    ne: int,
    nd: int,
    nu: int,
    lanes: int,
    table: Array,
    rates: Array,
    powers: Array,
    B: Array,
    E: Array,
    N: Array,
    pole: float,
    mean: Array,
    drivers: Array,
    k: int,
    inputs: Array,
    elapsed: Array,
    out: Array,
    slopes: Array,
) -> None:
    """Fill excess forces (ne, L) and their slopes (ne, nx + ne + nd + nu, L) in x, φ, d and w.

    Parameters
    ----------
    table : (L, K, 6) array
        Laws of each lane, as :func:`bayes_asv.filters.force_laws.excess` takes them.
    rates : (ne, 2, L) array
        Damping and spring rate of each element.
    mean : (nx + ne, L) array
        States of the car and filtered forces; element e has its deflection at 2 e and its rate at
        2 e + 1.
    drivers : (n, L) array
        State whose rows from nx + ne on are input biases and filtered noise of the inputs.
    k : int
        Number of the instant.
    inputs, elapsed : (N, nu) and (N,) arrays
        Readings of the inputs, m/s², and the time since the recording began, s.
    """
    lag = 1.0 / pole
    rows = nx + ne
    time = elapsed[k]
    share = time / elapsed[-1]
    for e in range(ne):
        row = 2 * e + 1
        for q in range(lanes):
            acceleration = 0.0
            for b in range(nx):
                acceleration += powers[1, row, b, q] * mean[b, q]
            for f in range(ne):
                acceleration += E[row, f, q] * mean[nx + f, q]
            for u in range(nu):
                disturbance = drivers[rows + nd + u, q]
                for d in range(nd):
                    disturbance += N[u, d] * drivers[rows + d, q]
                acceleration += B[row, u, q] * (inputs[k, u] - disturbance)
            deflection = mean[2 * e, q] + lag * mean[row, q]
            rate = mean[row, q] + lag * acceleration
            force, by_deflection, by_rate = excess(
                table, q, e, rates[e, 0, q], rates[e, 1, q], deflection, rate, time, share
            )
            out[e, q] = force
            late = lag * by_rate
            for b in range(nx):
                slopes[e, b, q] = late * powers[1, row, b, q]
            for f in range(ne):
                slopes[e, nx + f, q] = late * E[row, f, q]
            for d in range(nd):
                slopes[e, nx + ne + d, q] = 0.0
            for u in range(nu):
                slopes[e, nx + ne + nd + u, q] = -late * B[row, u, q]
                for d in range(nd):
                    slopes[e, nx + ne + d, q] -= late * B[row, u, q] * N[u, d]
            slopes[e, 2 * e, q] += by_deflection
            slopes[e, row, q] += lag * by_deflection + by_rate


@njit(**INLINE)
def advance_forces(
    nx: int,
    ne: int,
    nd: int,
    nu: int,
    lanes: int,
    nonlinear: bool,
    table: Array,
    rates: Array,
    powers: Array,
    B: Array,
    E: Array,
    N: Array,
    pole: float,
    mean: Array,
    k: int,
    inputs: Array,
    elapsed: Array,
    added: Array,
    W0: Array,
    W1: Array,
    now: Array,
    then: Array,
    early: Array,
    late: Array,
    ahead: Array,
) -> None:
    """Add to ``ahead`` (nx + ne, L) what the forces of step k do over it.

    ``early`` and ``late`` (ne, coupled, L) get the slopes of the forces at both ends; ``bent`` says
    whether there are any laws beside the forces ``added`` (N, ne).
    """
    if nonlinear:
        _excess_forces(
            nx, ne, nd, nu, lanes, table, rates, powers, B, E, N, pole, mean, mean, k - 1,
            inputs, elapsed, now, early,
        )  # fmt: skip
    for e in range(ne):
        for q in range(lanes):
            now[e, q] = now[e, q] + added[k - 1, e] if nonlinear else added[k - 1, e]
    for a in range(nx + ne):
        for e in range(ne):
            for q in range(lanes):
                ahead[a, q] += W0[a, e, q] * now[e, q]
    if nonlinear:
        _excess_forces(
            nx, ne, nd, nu, lanes, table, rates, powers, B, E, N, pole, ahead, mean, k,
            inputs, elapsed, then, late,
        )  # fmt: skip
    for e in range(ne):
        for q in range(lanes):
            then[e, q] = then[e, q] + added[k, e] if nonlinear else added[k, e]
    for a in range(nx + ne):
        for e in range(ne):
            for q in range(lanes):
                ahead[a, q] += W1[a, e, q] * (then[e, q] - now[e, q])


@njit(**INLINE)
def linearise(
    rows: int,
    ne: int,
    coupled: int,
    lanes: int,
    base: Array,
    W0: Array,
    W1: Array,
    early: Array,
    late: Array,
    carry: Array,
) -> None:
    """Fill the Jacobian ``carry`` (rows, coupled, L) of a step with forces that change along it.

    ``base`` holds that of the linear car, ``early`` and ``late`` (ne, coupled, L) the slopes of the
    forces at the step's beginning and at its predicted end.
    """
    for a in range(rows):
        for b in range(coupled):
            for q in range(lanes):
                slope = base[a, b, q]
                for e in range(ne):
                    slope += W0[a, e, q] * early[e, b, q]
                carry[a, b, q] = slope
    for e in range(ne):
        for b in range(coupled):
            for q in range(lanes):
                early[e, b, q] = -early[e, b, q]
        for b in range(rows, coupled):
            for q in range(lanes):
                early[e, b, q] += late[e, b, q]
        for a in range(rows):
            for b in range(coupled):
                for q in range(lanes):
                    early[e, b, q] += late[e, a, q] * carry[a, b, q]
    for a in range(rows):
        for b in range(coupled):
            for q in range(lanes):
                slope = carry[a, b, q]
                for e in range(ne):
                    slope += W1[a, e, q] * early[e, b, q]
                carry[a, b, q] = slope
