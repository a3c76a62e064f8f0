"""Propagation of many parameter sets over one step, in the lanes of a vector unit.

A lane holds one car with one state x, the deflections and rates of its elements and the body rates.
Over a step of length h with the inputs' moments i its state becomes::

    x⁺ = Σ_j (A h)ʲ/j! (x + Σ_e e_e i_ej)

evaluated by Horner's rule from the highest order down, eight lanes at a time.  Lane 0 is the
reference, lanes 1 + 2 i and 2 + 2 i are the sigma points at plus and minus the distance along
direction i.  Four more lanes an element, with the reference's parameters, give the transition
matrices: the columns of Φ of the deflection rates, those of Γ, and the two Gauss nodes of each
input's process noise (see :mod:`bayes_asv.filters.prediction`).  The columns of Φ of
the deflections follow from Φ e = e + ∫ Φ(s) A e ds.

The sizes of a car are arguments that the filter fixes when it is compiled.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.prediction import IN_PLACE, INLINE, OPTIONS, ORDER, TAYLOR
from bayes_asv.filters.simd_layout import (
    LANES,
    WIDTH,
    ZERO,
    Rows,
    Shape,
    blocks,
    horner,
    lane_offset,
    matrices,
    transition_lanes,
)
from bayes_asv.filters.ukf_state import Model, Sizes

__all__ = [
    "fill_lanes",
    "polynomials",
    "propagate",
    "set_parameters",
    "set_states",
    "transition_matrices",
    "unscented_moments",
]

Array = NDArray[np.float64]

_GAUSS = 1.0 / math.sqrt(3.0)
_SERIES_LIMIT = 1 / 16  # where x⁹/9! is 4e-17
_TRUNCATION = 1e-14  # first omitted term of the exponential series


@njit(**OPTIONS)
def _exp(x: float) -> float:
    """Exponential function, by nine terms of its series for small arguments.

    The series is exact to rounding there, and five times as fast as the library's function.
    """
    if abs(x) > _SERIES_LIMIT:
        return math.exp(x)
    square = x * x
    even = 1.0 + square * (1 / 2 + square * (1 / 24 + square * (1 / 720 + square * (1 / 40320))))
    odd = 1.0 + square * (1 / 6 + square * (1 / 120 + square * (1 / 5040)))
    return even + x * odd


@njit(**INLINE)
def fill_lanes(sizes: Sizes, rows: Rows, W: Array, p: int, model: Model) -> None:
    """Fill all lanes of p directions with one parameter vector and with what is constant."""
    for b in range(blocks(p, sizes.elements)):
        at = np.uint64(b) * np.uint64(rows.size)
        for c in range(model.constant.shape[0]):
            row = at + np.uint64(rows.geometry + c * LANES)
            for q in range(ZERO, WIDTH):
                W[row + q] = model.constant[c]
        for c in range(model.base.shape[0]):
            row = at + np.uint64(rows.damping + model.place[c] * LANES)
            for q in range(ZERO, WIDTH):
                W[row + q] = model.base[c]
        for c in range(model.copies.shape[0]):
            to = at + np.uint64(rows.damping + model.copies[c, 0] * LANES)
            of = at + np.uint64(rows.damping + model.copies[c, 1] * LANES)
            for q in range(ZERO, WIDTH):
                W[to + q] = W[of + q]
        for e in range(sizes.elements):
            to = at + np.uint64(rows.inverse_gain + e * LANES)
            of = at + np.uint64(rows.input_gain + e * LANES)
            for q in range(ZERO, WIDTH):
                W[to + q] = 1.0 / W[of + q]


@njit(**OPTIONS)
def polynomials(
    rows: Rows,
    W: Array,
    at: np.uint64,
    term: NDArray[np.int64],
    coefficient: Array,
    factors: NDArray[np.int64],
    constant: Array,
) -> None:
    """Evaluate the geometry of one block, term by term; see :class:`Model`."""
    parameters = at + np.uint64(rows.damping)
    last = -1
    for t in range(coefficient.shape[0]):
        entry, own, factor = term[t, 0], term[t, 1], coefficient[t]
        to = at + np.uint64(rows.geometry) + np.uint64(entry) * np.uint64(LANES)
        if entry != last:
            for q in range(ZERO, WIDTH):
                W[to + q] = constant[entry]
            last = entry
        if own >= 0:
            of = parameters + np.uint64(own) * np.uint64(LANES)
            for q in range(ZERO, WIDTH):
                W[to + q] += factor * W[of + q]
            continue
        for q in range(ZERO, WIDTH):
            product = factor
            for f in range(factors.shape[1]):
                if factors[t, f] >= 0:
                    product *= W[parameters + np.uint64(factors[t, f]) * WIDTH + q]
            W[to + q] += product


@njit(**OPTIONS)
def set_parameters(
    ne: int,
    rows: Rows,
    shape: Shape,
    W: Array,
    mu: Array,
    D: Array,
    distance: float,
    element: NDArray[np.int64],
    log: NDArray[np.bool_],
    centre: Array,
    scale: Array,
    place: NDArray[np.int64],
    term: NDArray[np.int64],
    coefficient: Array,
    factors: NDArray[np.int64],
    constant: Array,
    copies: NDArray[np.int64],
    bars: Array,
    uncertain_gains: bool,
) -> float:
    """Set the parameters of every lane; return a bound of all eigenvalues' magnitude (1/s).

    Element ``element`` of the parameter vector is exp(centre + scale μ) where ``log``, else
    centre + scale μ.

    Parameters
    ----------
    ne, rows, shape : int, Rows and Shape
        Number of elements, and layout.
    W : (blocks · rows.size,) array
        Lanes, after :func:`fill_lanes`; changed in place.
    mu : (p + q,) array
        Coordinates of the reference; the last q have no effect on the parameters.
    D : (p + q, p + q) array
        Row i is direction i, zero before its i-th element.
    distance : float
        Distance of the sigma points in units of the directions.
    element, …, uncertain_gains
        Of :class:`bayes_asv.filters.ukf_state.Model`, one by one: compiled code counts references
        whenever it looks into a record.
    """
    p = element.shape[0]
    count = blocks(p, ne)
    for k in range(p):
        row = np.uint64(rows.damping) + np.uint64(place[element[k]]) * np.uint64(LANES)
        value = centre[k] + scale[k] * mu[k]
        if log[k]:
            value = math.exp(value)
        for b in range(count):
            at = np.uint64(b) * np.uint64(rows.size) + row
            for q in range(ZERO, WIDTH):
                W[at + q] = value
        for i in range(k + 1):
            by = distance * scale[k] * D[i, k]
            if log[k]:
                W[lane_offset(1 + 2 * i, rows.size) + row] = value * _exp(by)
                W[lane_offset(2 + 2 * i, rows.size) + row] = value * _exp(-by)
            else:
                W[lane_offset(1 + 2 * i, rows.size) + row] = value + by
                W[lane_offset(2 + 2 * i, rows.size) + row] = value - by
    for b in range(count):
        at = np.uint64(b) * np.uint64(rows.size)
        polynomials(rows, W, at, term, coefficient, factors, constant)
        for c in range(copies.shape[0]):
            to = at + np.uint64(rows.damping) + np.uint64(copies[c, 0]) * np.uint64(LANES)
            of = at + np.uint64(rows.damping) + np.uint64(copies[c, 1]) * np.uint64(LANES)
            for q in range(ZERO, WIDTH):
                W[to + q] = W[of + q]
        matrices(shape, W, at, bars)
        if uncertain_gains:
            for e in range(ne):
                for q in range(ZERO, WIDTH):
                    W[at + np.uint64(rows.inverse_gain + e * LANES) + q] = (
                        1.0 / W[at + np.uint64(rows.input_gain + e * LANES) + q]
                    )
    for lane in range(1 + 2 * p, count * LANES):  # no measured input
        for e in range(ne):
            W[lane_offset(lane, rows.size) + np.uint64(rows.inverse_gain + e * LANES)] = 0.0
    max_rate = 0.0
    for lane in range(1 + 2 * p):
        max_rate = max(max_rate, W[lane_offset(lane, rows.size) + np.uint64(rows.rate)])
    return max_rate


@njit(**INLINE)
def propagate(
    sizes: Sizes,
    rows: Rows,
    shape: Shape,
    W: Array,
    p: int,
    distance: float,
    x: Array,
    J: Array,
    N: Array,
    h: float,
    moments: Array,
    inputs: Array,
    max_rate: float,
    with_transition: bool,
) -> None:
    """Propagate all lanes over one step.

    Parameters
    ----------
    sizes, rows, shape : Sizes, Rows and Shape
        Of the car.
    W : array
        Lanes with their parameters; the new states are read by :func:`unscented_moments`.
    p : int
        Number of directions.
    distance : float
        Distance of the sigma points in units of the directions.
    x : (ns,) array
        State of the filter at the reference.
    J : (p, ns) array
        Its derivatives along the directions.
    N : (ne, nd) array
        Directions of the input biases.
    h : float
        Length of the step, s.
    moments : (ne, ORDER) array
        ∫₀ʰ (h−s)ʲ/j! û(s) ds of the inputs.
    inputs : (ne, TAYLOR + 1) array
        Workspace.
    max_rate : float
        From :func:`set_parameters`.
    with_transition : bool
        Whether the lanes of the transition matrices are propagated as well.
    """
    ne, nx = sizes.elements, sizes.motion
    set_states(sizes, rows, W, p, distance, x, J, N)
    sigma = 1 + 2 * p
    last = sigma
    for lane in range(sigma):
        W[lane_offset(lane, rows.size) + np.uint64(rows.step)] = h
    if with_transition:
        last = sigma + transition_lanes(ne)
        for lane in range(sigma, last):
            at = lane_offset(lane, rows.size)
            for a in range(nx):
                W[at + np.uint64(rows.before + a * LANES)] = 0.0
            for e in range(ne):
                W[at + np.uint64(rows.forcing + e * LANES)] = 0.0
            W[at + np.uint64(rows.step)] = h
        for e in range(ne):
            rate = np.uint64(rows.before + (2 * e + 1) * LANES)
            W[lane_offset(sigma + e, rows.size) + rate] = 1.0
            W[lane_offset(sigma + ne + e, rows.size) + np.uint64(rows.forcing + e * LANES)] = 1.0
            for g in range(2):
                at = lane_offset(sigma + 2 * ne + 2 * e + g, rows.size)
                W[at + rate] = 1.0
                W[at + np.uint64(rows.step)] = h * (0.5 + (g - 0.5) * _GAUSS)
    order = 1
    term = max_rate * h
    while term > _TRUNCATION and order < TAYLOR:
        order += 1
        term *= max_rate * h / order
    # Moments scaled for Horner's rule: ∫ (1 − s/h)ʲ u ds, all of the magnitude of u h.
    factor = 1.0
    over = 1.0 / h
    for j in range(order + 1):
        if j < ORDER:
            for e in range(ne):
                inputs[e, j] = -moments[e, j] * factor
            factor *= (j + 1) * over
        else:
            for e in range(ne):
                inputs[e, j] = 0.0
    for b in range((last + LANES - 1) // LANES):
        horner(shape, W, np.uint64(b) * np.uint64(rows.size), inputs, order)


@njit(**INLINE)
def set_states(
    sizes: Sizes, rows: Rows, W: Array, p: int, distance: float, x: Array, J: Array, N: Array
) -> None:
    """Set the states of the sigma points: x and x ± distance · J along each direction.

    What drives an element is the filtered noise of its input and the input's bias N d.
    """
    ne, nx, nd = sizes.elements, sizes.motion, sizes.directions
    bias, noise = nx + sizes.outputs, sizes.lasting
    for a in range(nx):
        W[np.uint64(rows.before + a * LANES)] = x[a]
    for e in range(ne):
        total = x[noise + e]
        for k in range(nd):
            total += N[e, k] * x[bias + k]
        W[np.uint64(rows.forcing + e * LANES)] = total
    for i in range(p):
        up, down = lane_offset(1 + 2 * i, rows.size), lane_offset(2 + 2 * i, rows.size)
        for a in range(nx):
            by = distance * J[i, a]
            W[up + np.uint64(rows.before + a * LANES)] = x[a] + by
            W[down + np.uint64(rows.before + a * LANES)] = x[a] - by
        for e in range(ne):
            by = J[i, noise + e]
            for k in range(nd):
                by += N[e, k] * J[i, bias + k]
            by *= distance
            middle = W[np.uint64(rows.forcing + e * LANES)]
            W[up + np.uint64(rows.forcing + e * LANES)] = middle + by
            W[down + np.uint64(rows.forcing + e * LANES)] = middle - by


@njit(**IN_PLACE)
def unscented_moments(
    sizes: Sizes,
    rows: Rows,
    W: Array,
    p: int,
    distance: float,
    x: Array,
    J: Array,
    even_covariance: Array,
    workspace: Array,
) -> None:
    """Unscented mean, derivatives and covariance of the propagated states.

    Parameters
    ----------
    sizes, rows : Sizes and Rows
        Of the car.
    W : array
        Lanes after :func:`propagate`.
    p : int
        Number of directions.
    distance : float
        Distance of the sigma points in units of the directions.
    x, J : (ns,) and (p, ns) arrays
        Filled in their first nx columns: mean, and odd part along each direction.
    even_covariance : (nx, nx) array
        Filled with Σ e eᵀ/distance², e being the even part: the mean of both sigma points less the
        reference.
    workspace : (2, nx) array
        Workspace.
    """
    nx = sizes.motion
    e, mean = workspace[0], workspace[1]
    for a in range(nx):
        mean[a] = 0.0
        for b in range(nx):
            even_covariance[a, b] = 0.0
    over = 1.0 / (distance * distance)
    half = 0.5 / distance
    for i in range(p):
        up, down = lane_offset(1 + 2 * i, rows.size), lane_offset(2 + 2 * i, rows.size)
        for a in range(nx):
            row = np.uint64(rows.after + a * LANES)
            plus, minus = W[up + row], W[down + row]
            J[i, a] = (plus - minus) * half
            e[a] = 0.5 * (plus + minus) - W[row]
            mean[a] += e[a]
        for a in range(nx):
            for b in range(a + 1):
                even_covariance[a, b] += e[a] * e[b]
    for a in range(nx):
        x[a] = W[np.uint64(rows.after + a * LANES)] + mean[a] * over
        for b in range(a + 1):
            even_covariance[a, b] *= over
            even_covariance[b, a] = even_covariance[a, b]


@njit(**INLINE)
def transition_matrices(
    sizes: Sizes, rows: Rows, W: Array, p: int, h: float, phi: Array, gamma: Array, Q: Array
) -> None:
    """Read Φ (nx, nx), Γ (nx, ne) and every input's process-noise matrix Q (ne, nx, nx)."""
    ne, nr, nx = sizes.elements, sizes.rates, sizes.motion
    sigma = 1 + 2 * p
    for a in range(nx):
        row = np.uint64(rows.after + a * LANES)
        for e in range(ne):
            gamma[a, e] = W[lane_offset(sigma + ne + e, rows.size) + row]
            phi[a, 2 * e + 1] = W[lane_offset(sigma + e, rows.size) + row]
        for e in range(ne):
            total = 1.0 if a == 2 * e else 0.0
            for f in range(ne):
                total += W[np.uint64(rows.A + (2 * ne * f + 2 * e) * LANES)] * gamma[a, f]
            for r in range(nr):
                if a == 2 * ne + r:
                    total += h * W[np.uint64(rows.A + (2 * ne * (ne + r) + 2 * e) * LANES)]
            phi[a, 2 * e] = total
        for r in range(nr):
            phi[a, 2 * ne + r] = 1.0 if a == 2 * ne + r else 0.0
        for e in range(ne):
            first = lane_offset(sigma + 2 * ne + 2 * e, rows.size)
            second = lane_offset(sigma + 2 * ne + 2 * e + 1, rows.size)
            for b in range(a + 1):
                other = np.uint64(rows.after + b * LANES)
                Q[e, a, b] = Q[e, b, a] = (0.5 * h) * (
                    W[first + row] * W[first + other] + W[second + row] * W[second + other]
                )
