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
straight lines would miss (ω h)²/12 of them, a twentieth at 50 Hz of 400, as they do after a step
of less than half the length.  The covariance follows
the slopes at both ends, in a straight line, since the bend owes as much to the step before as to
this one: an extended Kalman filter, exact for a linear car.

A damper in series with a stiffness K (gas, oil, rubber mounts) has a force of its own, m, as a
state behind φ.  With F the damper's law and u the rate at its own ends::

    ṁ = K (δ̇ − u),      F(u) = m

so that force lags velocity: a loop in place of a curve.  It is integrated in parts of a step by
exponential Rosenbrock steps (Hochbruck & Ostermann, section 2.4), which stay stable where the
damper's slope F′ is small and K/F′ fast.

Friction gives before it slips.  Its force m is a state as well: with a force F, a slip speed s and
a presliding displacement d, after Dahl (1968, Aerospace TOR-0158(3107-18)-1), whose law is that of
s = 0::

    ṁ = (F δ̇ − w m)/d        w = √(δ̇² + s²)

In steady motion it is F δ̇/w.  Over a part of a step with z = ∫ w dt/d, the force that it tends to
is taken as linear in z, with the exact mean F ∫ δ̇ dt/∫ w dt and the exact value at the end: right
both where friction only gives (z → 0) and where it slips all along (z → ∞).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.force_laws import (
    COULOMB,
    LAW_PARTS,
    SERIES_STIFFNESS,
    apply_laws,
    damper_forces,
    row_of_law,
)
from bayes_asv.filters.prediction import INLINE, OPTIONS, TAYLOR
from bayes_asv.filters.vector_code import LANES, lanes_last
from bayes_asv.filters.vector_steps import (
    begin_forces_vectors,
    begin_laws_vectors,
    end_forces_vectors,
    end_laws_vectors,
    rate_vectors,
)

__all__ = [
    "LawWorkspace", "advance_forces", "bend_weights", "force_weights", "law_workspace",
    "rate_slopes", "resisting_force_history",
]  # fmt: skip

Array = NDArray[np.float64]

_PARTS = 4  # of a step, over each of which a force with memory is linear
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

    The step that ends there is ``before`` long, the next one h.  Both weights are zero, for a
    straight line, where there was no step or one of less than half of h: a reading between the two
    steps moves the force, which a parabola would take for a bend, 2 (h/before)² times too large.
    """
    if before < 0.5 * h:
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


class LawWorkspace(NamedTuple):
    """Arrays of :func:`advance_forces`.

    Parameters
    ----------
    moment : (2, L) array
        Time since the recording began, s, and as a share of its length.
    parts : (ne, LAW_PARTS, L) array
        Of the laws, see :data:`bayes_asv.filters.force_laws.LAW_PARTS`.
    search : (4, L) array
        Force and slope of a damper, and bounds of the search for its rate.
    """

    moment: Array
    parts: Array
    search: Array


@njit(**OPTIONS)
def law_workspace(ne: int) -> LawWorkspace:
    """Make the arrays for ne elements."""
    return LawWorkspace(
        np.zeros((2, LANES)), np.zeros((ne, LAW_PARTS, LANES)), np.zeros((4, LANES))
    )


@njit(**INLINE)
def _forces(
    nx: int,
    ne: int,
    ns: int,
    nm: int,
    table: Array,
    rates: Array,
    lag: Array,
    mean: Array,
    rate: Array,
    work: LawWorkspace,
    force: Array,
    stiffness: Array,
    damping: Array,
) -> None:
    """Fill excess forces (ne, L) and their slopes in deflection and rate.

    Parameters
    ----------
    table : (K, P, L) array
        Laws of each lane; see :mod:`bayes_asv.filters.force_laws`.
    rates : (ne, 2, L) array
        Damping and spring rate of each element.
    lag : (1,) array
        1/λ, s.
    mean : (nx + ne + nm, L) array
        States of the car, filtered forces, and forces with memory; element e has its deflection
        at 2 e and its rate at 2 e + 1.
    rate : (ne, L) array
        Rates of deflection before the sensors' filter, m/s.
    work : LawWorkspace
        With its ``moment``.
    """
    begin_laws_vectors(nx, ne, nm, lag, mean, rate, work.parts)
    apply_laws(table, work.moment, ns == 0, nm == ns, work.parts)
    end_laws_vectors(nx, ne, ns, nm, rates, mean, work.parts, force, stiffness, damping)


@njit(**INLINE)
def _rates_around(
    n: int, begin: float, end: float, last: float, up: float, back: float
) -> tuple[float, float]:
    """Return the rates of deflection at both ends of part n of a step.

    ``last`` is that at the beginning of the step before.  Along the step they are begin +
    (end − begin) s + bend (s² − s)/2, where the bend grows by ``up`` with the end and falls by
    ``up + back`` with the beginning.
    """
    s, t = n / _PARTS, (n + 1) / _PARTS
    bend = up * (end - begin) - back * (begin - last)
    early = begin + (end - begin) * s + bend * 0.5 * (s * s - s)
    return early, begin + (end - begin) * t + bend * 0.5 * (t * t - t)


@njit(**INLINE)
def _chain_slopes(
    n: int, q: int, kept: float, by_early: float, by_later: float, series: Array
) -> None:
    """Carry slopes of a force in itself and in the rates at both ends of a step over its part n.

    ``by_early`` and ``by_later`` are those in the rates at the ends of the part, without the bend.
    """
    s, t = n / _PARTS, (n + 1) / _PARTS
    series[0, q] *= kept
    series[1, q] = series[1, q] * kept + by_early * (1.0 - s) + by_later * (1.0 - t)
    series[2, q] = series[2, q] * kept + by_early * s + by_later * t


@njit(**INLINE)
def _carry_series_damper(
    table: Array,
    element: int,
    c: Array,
    force: Array,
    begin: Array,
    end: Array,
    last: Array,
    up: float,
    back: float,
    h: float,
    work: LawWorkspace,
    series: Array,
    ahead: Array,
) -> None:
    """Carry the force of a damper in series with a stiffness over a step.

    Parameters
    ----------
    table : (K, P, L) array
        Laws of each lane.
    element : int
        Number of the suspension element.
    c, force : (L,) arrays
        Damping rate (N·s/m) and force at the step's beginning (N).
    begin, end, last : (L,) arrays
        Rates of deflection at its ends, and at the beginning of the step before (m/s).
    up, back : float
        Of :func:`_rates_around`.
    h : float
        Length of the step, s.
    series : (4, L) array
        Gets slopes of the new force in the force before and in both rates.  Its last row is the
        rate at the damper, from which the search for the next one begins (m/s).
    ahead : (L,) array
        Gets the force at the step's end.
    """
    parts, at = work.parts[element], series[3]
    total, slope, low, high = work.search
    row = row_of_law(table, element, SERIES_STIFFNESS)
    if row < 0:
        damper_forces(table, element, c, end, work.moment, parts, ahead, slope)
        for q in range(LANES):
            series[0, q], series[1, q], series[2, q], at[q] = 0.0, 0.0, slope[q], end[q]
        return
    for q in range(LANES):
        ahead[q] = force[q]
        series[0, q], series[1, q], series[2, q] = 1.0, 0.0, 0.0
    part = h / _PARTS
    for n in range(_PARTS):
        for q in range(LANES):  # a curve that is steep at rest throws Newton to and fro
            low[q], high[q] = -math.inf, math.inf
        for _ in range(_MOST_TRIES):
            damper_forces(table, element, c, at, work.moment, parts, total, slope)
            moved = False
            for q in range(LANES):
                step = (ahead[q] - total[q]) / slope[q]
                if abs(step) <= 1e-9 * (1e-3 + abs(at[q])):
                    continue
                moved = True
                if step > 0.0:
                    low[q] = at[q]
                else:
                    high[q] = at[q]
                at[q] += step
                if at[q] <= low[q] or at[q] >= high[q]:
                    at[q] = 0.5 * (low[q] + high[q])
            if not moved:
                break
        for q in range(LANES):
            K = table[row, 2, q]
            z = K * part / slope[q]
            kept = math.exp(-z)
            first = (1.0 - kept) / z if z > 1e-6 else 1.0 - 0.5 * z
            second = (1.0 - first) / z if z > 1e-6 else 0.5 - z / 6.0
            early, later = _rates_around(n, begin[q], end[q], last[q], up, back)
            ahead[q] += part * K * (first * (early - at[q]) + second * (later - early))
            _chain_slopes(n, q, kept, part * K * (first - second), part * K * second, series)


@njit(**INLINE)
def _carry_friction(
    table: Array,
    element: int,
    force: Array,
    begin: Array,
    end: Array,
    last: Array,
    up: float,
    back: float,
    h: float,
    series: Array,
    ahead: Array,
) -> None:
    """Carry the force of an element's friction over a step; see :func:`_carry_series_damper`."""
    row = row_of_law(table, element, COULOMB)
    for q in range(LANES):
        ahead[q] = force[q]
        series[0, q], series[1, q], series[2, q] = 1.0, 0.0, 0.0
    if row < 0:
        return
    part = h / _PARTS
    for n in range(_PARTS):
        for q in range(LANES):
            level, slip, d = table[row, 2, q], table[row, 3, q], table[row, 4, q]
            early, later = _rates_around(n, begin[q], end[q], last[q], up, back)
            middle = 0.5 * (early + later)
            w0 = math.sqrt(early * early + slip * slip)
            w1 = math.sqrt(later * later + slip * slip)
            w = math.sqrt(middle * middle + slip * slip)
            z = part * (w0 + 4.0 * w + w1) / (6.0 * d)
            kept = math.exp(-z)
            # weights of the mean of what it tends to, its slope in z, and weight of that at the end
            if z > 0.05:
                by_mean = ((1.0 - kept) / z - kept) / z
                by_mean_slope = (kept - 2.0 * by_mean) / z
                at_end = 1.0 + kept - 2.0 * (1.0 - kept) / z
            else:  # series, where differences would lose their digits
                by_mean = 0.5 - z * (1.0 / 3.0 - z * (0.125 - z / 30.0))
                by_mean_slope = -1.0 / 3.0 + z * (0.25 - z * (0.1 - z / 36.0))
                at_end = z * z * (1.0 / 6.0 - z * (1.0 / 12.0 - z / 40.0))
            elastic = 2.0 * level * part / d  # twice the force that a rate of 1 m/s adds
            by_z = (2.0 * by_mean - kept) * level * later / w1 + elastic * middle * by_mean_slope
            by_z -= kept * ahead[q]
            ahead[q] = kept * ahead[q] + at_end * level * later / w1 + elastic * middle * by_mean
            by_early = by_z * part / (6.0 * d) * (early / w0 + 2.0 * middle / w)
            by_early += 0.5 * elastic * by_mean
            by_later = by_z * part / (6.0 * d) * (later / w1 + 2.0 * middle / w)
            by_later += 0.5 * elastic * by_mean + at_end * level * slip * slip / (w1 * w1 * w1)
            _chain_slopes(n, q, kept, by_early, by_later, series)


@njit(**INLINE)
def advance_forces(
    nx: int,
    ne: int,
    nu: int,
    ns: int,
    nm: int,
    coupled: int,
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
    work: LawWorkspace,
    ahead: Array,
) -> None:
    """Add to ``ahead`` (nx + ne + nm, L) what the forces of step k do over it.

    ``force``, ``stiffness`` and ``damping`` (2, ne, L) get the forces of the laws at both ends and
    their slopes in deflection and rate, ``rate`` (2, ne, L) the rates there.  The forces ``added``
    (N, ne) go straight from instant to instant.  ``bends`` (2,) are those of :func:`bend_weights`.
    ``last`` (2, ne, L) holds force and rate at the beginning of the step before; it is made ready
    for the next step.  ``series`` (4, nm, L) gets the slopes of each force with memory in itself
    and in the rates at both ends, and the rate at a damper in series with a stiffness; the first ns
    of them (0 or ne) are forces of such dampers, the others of friction, which has slipped in
    neither direction before the recording.
    """
    whole = elapsed[-1]
    nonlinear = table.shape[1] > 0
    if nonlinear:
        rate_vectors(nx, ne, nu, nm, coupled, by, B, lag, inputs[k - 1], mean, mean, rate[0])
        work.moment[0], work.moment[1] = elapsed[k - 1], elapsed[k - 1] / whole
        _forces(
            nx, ne, ns, nm, table, rates, lag, mean, rate[0], work, force[0], stiffness[0],
            damping[0],
        )  # fmt: skip
    begin_forces_vectors(nx, ne, nm, W, force[0], added[k - 1], ahead)
    if nonlinear:
        rate_vectors(nx, ne, nu, nm, coupled, by, B, lag, inputs[k], ahead, mean, rate[1])
        work.moment[0], work.moment[1] = elapsed[k], elapsed[k] / whole
        for e in range(ns):
            _carry_series_damper(
                table, e, rates[e, 0], mean[nx + ne + e], rate[0, e], rate[1, e], last[1, e],
                bends[0], bends[1], h, work, series[:, e], ahead[nx + ne + e],
            )  # fmt: skip
        for m in range(ns, nm):
            e = m - ns
            _carry_friction(
                table, e, mean[nx + ne + m], rate[0, e], rate[1, e], last[1, e], bends[0],
                bends[1], h, series[:, m], ahead[nx + ne + m],
            )  # fmt: skip
        _forces(
            nx, ne, ns, nm, table, rates, lag, ahead, rate[1], work, force[1], stiffness[1],
            damping[1],
        )  # fmt: skip
    end_forces_vectors(
        nx, ne, nm, W, bends, force, last, rate[0], added[k - 1], added[k], ahead
    )  # fmt: skip


def resisting_force_history(
    tables: Array, element: int, c: Array, rate: Array, step: Array
) -> Array:
    """Return the forces of an element's damper and friction against its rate of deflection.

    Parameters
    ----------
    tables : (W, K, P) array
        Laws of each parameter set.
    element : int
        Number of the suspension element.
    c : (W,) array
        Damping rates, N·s/m.
    rate : (N,) array
        Rates of deflection at the instants, m/s.
    step : (N,) array
        Time since the instant before, s.

    Returns
    -------
    (W, N) array
        Forces, N, at a share of zero of the recording, and at the first instant from the damper's
        law alone.
    """
    laws, rates = lanes_last(tables), lanes_last(c)
    out = [
        _force_history(one, element, by, rate, step) for one, by in zip(laws, rates, strict=True)
    ]
    return np.concatenate(out, axis=1).T[: len(c)]


@njit(**OPTIONS)
def _force_history(table: Array, element: int, c: Array, rate: Array, step: Array) -> Array:
    """Return forces (N, L) with laws (K, P, L) and rates (L,)."""
    work = law_workspace(element + 1)
    series, rates = np.zeros((2, 4, LANES)), np.empty((3, LANES))
    damper, friction = np.empty((len(rate), LANES)), np.zeros((len(rate), LANES))
    for k in range(len(rate)):
        rates[0], rates[1], rates[2] = rate[max(k - 2, 0)], rate[max(k - 1, 0)], rate[k]
        if k == 0:
            damper_forces(
                table,
                element,
                c,
                rates[2],
                work.moment,
                work.parts[element],
                damper[0],
                series[0, 0],
            )
            series[0, 3] = rate[0]
            continue
        up, back = bend_weights(step[k], step[k - 1] if k > 1 else 0.0)
        _carry_series_damper(
            table, element, c, damper[k - 1], rates[1], rates[2], rates[0], up, back, step[k], work,
            series[0], damper[k],
        )  # fmt: skip
        _carry_friction(
            table, element, friction[k - 1], rates[1], rates[2], rates[0], up, back, step[k],
            series[1], friction[k],
        )  # fmt: skip
    return damper + friction
