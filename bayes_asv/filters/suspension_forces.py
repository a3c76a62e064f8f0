"""Forces beyond the linear springs and dampers in the prediction step, compiled into the filter.

An excess force f of each suspension element is whatever its springs, dampers and stops do beyond
−k δ − c δ̇.  All readings passed the sensors' filter with pole λ.  A linear car does not notice: its
filtered motions obey the same equations.  A force that is not linear acts on the motion before the
filter, δ + δ̇/λ and δ̇ + δ̈/λ, and is then filtered itself::

    ẋ = A x + B u + E φ        φ' = λ (f − φ)        y = C x + G φ + …

φ, the forces that passed, are states behind those of the car.  This is exact for one pole; where no
filter is declared λ is above what the samples can show.  Forces enter a step as the parabola
through its ends and the beginning of the step before (exponential integrator of Adams' kind;
Hochbruck & Ostermann 2010, Acta Numerica 19, section 2.3), the second end from a predictor;
straight lines would miss (ω h)²/12 of them, a twentieth at 50 Hz of 400.  The covariance follows
the slopes along that path: an extended Kalman filter, exact for a linear car.

A damper in series with a stiffness K (gas, oil, rubber mounts) has a force of its own, m, as a
state behind φ.  With F the damper's law and u the rate at its own ends::

    ṁ = K (δ̇ − u),      F(u) = m

so that force lags velocity: a loop in place of a curve.  It is integrated in parts of a step by
exponential Rosenbrock steps (Hochbruck & Ostermann, section 2.4), which stay stable where the
damper's slope F′ is small and K/F′ fast.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.force_laws import (
    damper_force,
    excess,
    series_stiffness,
    undamped_excess,
)
from bayes_asv.filters.prediction import INLINE, OPTIONS, TAYLOR
from bayes_asv.filters.vector_steps import (
    begin_forces_vectors,
    end_forces_vectors,
    rate_vectors,
)

__all__ = ["advance_forces", "bend_weights", "damper_forces", "force_weights", "rate_slopes"]

Array = NDArray[np.float64]

_PARTS = 4  # of a step, over each of which a damper in series with a stiffness is linear
_MOST_TRIES = 40  # of Newton's method for the rate at the damper


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
    W: Array,
    term: Array,
    after: Array,
) -> None:
    """Fill what one step of length h makes of filtered and of new forces.

    Columns nx … nx + ne of ``base`` carry φ at the step's beginning.  ``W`` (3, nx + ne, ne, L)
    carries a force that is constant over the step, one that grows from zero to one newton, and one
    of (s² − s)/2 newton at the share s of the step.  ``term`` and ``after`` (nx + ne, L) are room
    to work in.
    """
    for e in range(ne):
        for a in range(nx + ne):
            for q in range(lanes):
                term[a, q] = 1.0 if a == nx + e else 0.0
                base[a, nx + e, q] = W[0, a, e, q] = W[1, a, e, q] = W[2, a, e, q] = 0.0
        for j in range(TAYLOR + 8):
            for a in range(nx + ne):
                for q in range(lanes):
                    base[a, nx + e, q] += term[a, q]
                    W[0, a, e, q] += term[a, q] * pole * h / (j + 1)
                    linear = term[a, q] * pole * h / ((j + 1) * (j + 2))
                    W[1, a, e, q] += linear
                    W[2, a, e, q] += linear * (1.0 / (j + 3) - 0.5)
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
def bend_weights(h: float, before: float) -> tuple[float, float]:
    """Weights of the differences after and before an instant in h² times the second derivative.

    The step that ends there is ``before`` long, the next one h; both are zero where there was none.
    """
    if before <= 0.0:
        return 0.0, 0.0
    return 2.0 * h / (h + before), 2.0 * h * h / (before * (h + before))


@njit(**INLINE)
def rate_slopes(
    nx: int,
    ne: int,
    nd: int,
    nu: int,
    nm: int,
    lanes: int,
    powers: Array,
    B: Array,
    E: Array,
    N: Array,
    lag: Array,
    by: Array,
) -> None:
    """Fill the slopes (ne, coupled, L) of the rates of deflection before the sensors' filter.

    They are those in all states that drive the car; ``lag`` (1,) is 1/λ, s.
    """
    rows = nx + ne + nm
    for e in range(ne):
        row = 2 * e + 1
        for q in range(lanes):
            for b in range(nx):
                by[e, b, q] = lag[0] * powers[1, row, b, q]
            by[e, row, q] += 1.0
            for f in range(ne):
                by[e, nx + f, q] = lag[0] * E[row, f, q]
            for u in range(nu):
                by[e, rows + nd + u, q] = -lag[0] * B[row, u, q]
            for d in range(nd):
                total = 0.0
                for u in range(nu):
                    total += by[e, rows + nd + u, q] * N[u, d]
                by[e, rows + d, q] = total


@njit(**INLINE)
def _forces(
    nx: int,
    ne: int,
    nm: int,
    used: int,
    table: Array,
    rates: Array,
    lag: Array,
    mean: Array,
    time: float,
    share: float,
    rate: Array,
    force: Array,
    stiffness: Array,
    damping: Array,
) -> None:
    """Fill excess forces (ne, L) and their slopes in deflection and rate, of the first lanes.

    Parameters
    ----------
    used : int
        Number of lanes.
    table : (L, K, P) array
        Laws of each lane, as :func:`bayes_asv.filters.force_laws.excess` takes them.
    rates : (ne, 2, L) array
        Damping and spring rate of each element.
    lag : (1,) array
        1/λ, s.
    mean : (nx + ne + nm, L) array
        States of the car, filtered forces, and forces of dampers in series with a stiffness;
        element e has its deflection at 2 e and its rate at 2 e + 1.
    time, share : float
        Time since the recording began, s, and as a share of its length.
    rate : (ne, L) array
        Rates of deflection before the sensors' filter, m/s.
    """
    for e in range(ne):
        for q in range(used):
            deflection = mean[2 * e, q] + lag[0] * mean[2 * e + 1, q]
            if nm > 0:
                total, stiff, damped = undamped_excess(
                    table, q, e, rates[e, 1, q], deflection, rate[e, q], time
                )
                total += rates[e, 0, q] * rate[e, q] - mean[nx + ne + e, q]
                damped += rates[e, 0, q]
            else:
                total, stiff, damped = excess(
                    table, q, e, rates[e, 0, q], rates[e, 1, q], deflection, rate[e, q], time, share
                )
            force[e, q], stiffness[e, q], damping[e, q] = total, stiff, damped


@njit(**INLINE)
def _series_damper(
    table: Array,
    lane: int,
    element: int,
    c: float,
    force: float,
    begin: float,
    end: float,
    bend: float,
    up: float,
    back: float,
    h: float,
    share: float,
    guess: float,
) -> tuple[float, float, float, float, float]:
    """Carry the force of a damper in series with a stiffness over a step.

    Parameters
    ----------
    force : float
        At the step's beginning, N.
    begin, end : float
        Rates of deflection at its ends, m/s.
    bend, up, back : float
        Rates along the step are begin + (end − begin) s + bend (s² − s)/2, where ``bend`` grows
        by ``up`` with the end and falls by ``up + back`` with the beginning.
    guess : float
        Rate at the damper from which the search for it begins, m/s.

    Returns
    -------
    force, by_force, by_begin, by_end, guess : float
        Force at the step's end, its slopes in the force before and in both rates, and the rate at
        the damper.
    """
    K = series_stiffness(table, lane, element)
    if K == 0.0:
        total, slope = damper_force(table, lane, element, c, end, share)
        return total, 0.0, 0.0, slope, end
    by_force, by_begin, by_end = 1.0, 0.0, 0.0
    part = h / _PARTS
    at = guess
    for n in range(_PARTS):
        total, slope = damper_force(table, lane, element, c, at, share)
        low, high = -math.inf, math.inf  # a curve that is steep at rest throws Newton to and fro
        for _ in range(_MOST_TRIES):
            step = (force - total) / slope
            if abs(step) <= 1e-9 * (1e-3 + abs(at)):
                break
            if step > 0.0:
                low = at
            else:
                high = at
            at += step
            if at <= low or at >= high:
                at = 0.5 * (low + high)
            total, slope = damper_force(table, lane, element, c, at, share)
        z = K * part / slope
        kept = math.exp(-z)
        first = (1.0 - kept) / z if z > 1e-6 else 1.0 - 0.5 * z
        second = (1.0 - first) / z if z > 1e-6 else 0.5 - z / 6.0
        s, t = n / _PARTS, (n + 1) / _PARTS
        hump, humped = 0.5 * (s * s - s), 0.5 * (t * t - t)
        early = begin + (end - begin) * s + bend * hump
        later = begin + (end - begin) * t + bend * humped
        force += part * K * (first * (early - at) + second * (later - early))
        by_force *= kept
        by_early, by_later = part * K * (first - second), part * K * second
        by_begin *= kept
        by_begin += by_early * (1.0 - s - (up + back) * hump)
        by_begin += by_later * (1.0 - t - (up + back) * humped)
        by_end *= kept
        by_end += by_early * (s + up * hump) + by_later * (t + up * humped)
    return force, by_force, by_begin, by_end, at


@njit(**INLINE)
def _carry_series_dampers(
    nf: int,
    nm: int,
    used: int,
    table: Array,
    rates: Array,
    mean: Array,
    h: float,
    up: float,
    back: float,
    share: float,
    rate: Array,
    last: Array,
    series: Array,
    ahead: Array,
) -> None:
    """Fill the forces of dampers in series with a stiffness in ``ahead``, and ``series``."""
    for e in range(nm):
        for q in range(used):
            begin, end = rate[0, e, q], rate[1, e, q]
            bend = up * (end - begin) - back * (begin - last[1, e, q])
            force, by_force, by_begin, by_end, at = _series_damper(
                table, q, e, rates[e, 0, q], mean[nf + e, q], begin, end, bend, up, back,
                h, share, series[3, e, q],
            )  # fmt: skip
            ahead[nf + e, q] = force
            series[0, e, q], series[1, e, q], series[2, e, q] = by_force, by_begin, by_end
            series[3, e, q] = at


@njit(**INLINE)
def advance_forces(
    nx: int,
    ne: int,
    nu: int,
    nm: int,
    coupled: int,
    used: int,
    table: Array,
    rates: Array,
    B: Array,
    lag: Array,
    mean: Array,
    k: int,
    h: float,
    bends: Array,
    inputs: Array,
    elapsed: Array,
    added: Array,
    W: Array,
    by: Array,
    last: Array,
    force: Array,
    stiffness: Array,
    damping: Array,
    rate: Array,
    series: Array,
    ahead: Array,
) -> None:
    """Add to ``ahead`` (nx + ne + nm, L) what the forces of step k do over it.

    ``force``, ``stiffness`` and ``damping`` (2, ne, L) get the forces of the laws at both ends and
    their slopes in deflection and rate, ``rate`` (2, ne, L) the rates there.  The forces ``added``
    (N, ne) go straight from instant to instant.  ``bends`` (2,) are those of :func:`bend_weights`.
    ``last`` (2, ne, L) holds force and rate at the beginning of the step before; it is made ready
    for the next step.  ``series`` (4, nm, L) gets what a damper in series with a stiffness makes of
    its force and of the rates at both ends, and the rate at the damper.
    """
    whole = elapsed[-1]
    nonlinear = table.shape[1] > 0
    if nonlinear:
        rate_vectors(nx, ne, nu, nm, coupled, by, B, lag, inputs[k - 1], mean, mean, rate[0])
        before = elapsed[k - 1]
        _forces(
            nx, ne, nm, used, table, rates, lag, mean, before, before / whole, rate[0], force[0],
            stiffness[0], damping[0],
        )  # fmt: skip
    begin_forces_vectors(nx, ne, nm, W, force[0], added[k - 1], ahead)
    if nonlinear:
        rate_vectors(nx, ne, nu, nm, coupled, by, B, lag, inputs[k], ahead, mean, rate[1])
        now = elapsed[k]
        _carry_series_dampers(
            nx + ne, nm, used, table, rates, mean, h, bends[0], bends[1], now / whole, rate,
            last, series, ahead,
        )  # fmt: skip
        _forces(
            nx, ne, nm, used, table, rates, lag, ahead, now, now / whole, rate[1], force[1],
            stiffness[1], damping[1],
        )  # fmt: skip
    end_forces_vectors(
        nx, ne, nm, W, bends, force, last, rate[0], added[k - 1], added[k], ahead
    )  # fmt: skip


@njit(**OPTIONS)
def damper_forces(
    table: Array, element: int, c: float, rate: Array, step: Array, share: Array
) -> Array:
    """Force of an element's damper against its rate of deflection, along a recording.

    Parameters
    ----------
    table : (K, P) array
        Laws of one parameter set.
    element : int
        Number of the suspension element.
    c : float
        Damping rate, N·s/m.
    rate : (N,) array
        Rates of deflection at the instants, m/s.
    step : (N,) array
        Time since the instant before, s.
    share : (N,) array
        Share of the recording that has gone by.

    Returns
    -------
    (N,) array
        Forces, N, from the damper's law alone at the first instant.
    """
    laws = table.reshape((1, *table.shape))
    out = np.empty(len(rate))
    at = rate[0]
    force, _ = damper_force(laws, 0, element, c, at, share[0])
    out[0] = force
    for k in range(1, len(rate)):
        up, back = bend_weights(step[k], step[k - 1] if k > 1 else 0.0)
        bend = up * (rate[k] - rate[k - 1])
        if k > 1:
            bend -= back * (rate[k - 1] - rate[k - 2])
        force, _, _, _, at = _series_damper(
            laws, 0, element, c, force, rate[k - 1], rate[k], bend, up, back, step[k], share[k], at
        )
        out[k] = force
    return out
