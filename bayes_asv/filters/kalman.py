"""Kalman filter of a car with noisy inputs: linear, or extended where its suspension is not.

What it computes for a linear car is the exact Gaussian marginal likelihood of one recording, with
initial state, biases and sensor noise integrated out (see :mod:`.prediction` for the model
and for readings at a rail).  With force laws it is an extended Kalman filter (see
:mod:`.suspension_forces`).  Residual autocorrelation is the business of :mod:`.kalman_ar`.

One recursion is compiled for each combination of sizes; it takes `LANES` sets of parameters side by
side (see :mod:`.vector_code`), and a single one in as much time as all of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.force_laws import WITH_MEMORY, table_of_laws
from bayes_asv.filters.linearised_filter import LinearisedFilter, room_for
from bayes_asv.filters.prediction import (
    AT_LEAST,
    AT_MOST,
    LOG_2PI,
    MISSING,
    OPTIONS,
    ORDER,
    STEP_LENGTHS,
    STEP_SERIES,
    TAYLOR,
    VALUE,
    condition_on_bound,
    condition_on_value,
    decays,
    find_step,
    gained_noise,
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
from bayes_asv.filters.vector_steps import (
    advance_mean_vectors,
    condition_vectors,
    discretize_vectors,
    feedback_vectors,
    linearise_vectors,
    predict_vectors,
    project_vectors,
)

__all__ = [
    "AT_LEAST", "AT_MOST", "LANES", "MISSING", "NO_LAWS", "ORDER", "VALUE", "FilterPass", "Laws",
    "Measurements", "SensorNoise", "StateSpace", "filter_pass", "linearise",
    "log_likelihood",
]  # fmt: skip

Array = NDArray[np.float64]


class StateSpace(NamedTuple):
    """W linear state-space models of one car and one set of sensors.

    ẋ = A x + B (u − u₀) + E φ and y = y₀ + C x + G φ with u and y in the units of the *readings*:
    gains of the sensors are in B, C and G.

    Parameters
    ----------
    A : (W, nx, nx) array
        System matrices; element e has its deflection at state 2 e and its rate behind it.
    B : (W, nx, nu) array
        By measured inputs.
    C : (W, ny, nx) array
        By outputs.
    E, G : (W, nx, ne) and (W, ny, ne) arrays
        By forces of the suspension elements, N.
    rates : (W, ne, 2) array
        Damping (N·s/m) and spring rate (N/m) of each element.
    N : (nu, nd) array
        Directions in which a bias of the inputs is not a bias of the outputs.
    biases : (W, nu + ny) array
        Zeros of the sensors that are known, u₀ and y₀; :mod:`.kalman_ar` and
        :mod:`.free_response` take readings that are free of them.
    """

    A: Array
    B: Array
    C: Array
    E: Array
    G: Array
    rates: Array
    N: Array
    biases: Array

    def subset(self, sets: Sequence[int]) -> StateSpace:
        """Pick some of the parameter sets."""
        only = list(sets)
        return StateSpace(
            self.A[only], self.B[only], self.C[only], self.E[only], self.G[only],
            self.rates[only], self.N, self.biases[only],
        )  # fmt: skip


class SensorNoise(NamedTuple):
    """Noise of the sensors for W parameter sets, inputs before outputs.

    Parameters
    ----------
    white, filtered : (W, nu + ny) arrays
        Variances of one sample: of noise that is white, and of noise that passed the sensor's
        filter, in the unit of the reading squared.
    poles : (W, nu + ny) array
        Of those filters, rad/s; 0 without one.
    """

    white: Array
    filtered: Array
    poles: Array

    def subset(self, sets: Sequence[int]) -> SensorNoise:
        """Pick some of the parameter sets."""
        only = list(sets)
        return SensorNoise(self.white[only], self.filtered[only], self.poles[only])


class Measurements(NamedTuple):
    """Steps and readings of one recording.

    Parameters
    ----------
    step : (N,) array
        Time since the instant before, s; zero for the first.
    moments : (N, nu, ORDER) array
        ∫₀ʰ (h−s)ʲ/j! û(s) ds of the inputs over each step.
    process_noise : (N, 2 nu) array
        What turns the variance of an input's sample into an intensity (s), and an intensity that is
        added for what the input did between its samples (m²/s³), one an input each.
    kind : (N, ny) int8 array
        0 missing, 1 a value, 2 at least, 3 at most.
    reading : (N, ny) array
        Outputs or rails.
    extra_variance : (N, ny) array
        Variance added to single readings.
    initial_covariance : (nx + nd + ny, nx + nd + ny) array
        Prior covariance of (x, d, b).
    """

    step: Array
    moments: Array
    process_noise: Array
    kind: NDArray[np.int8]
    reading: Array
    extra_variance: Array
    initial_covariance: Array


class Laws(NamedTuple):
    """Force laws of the suspension and what they need to know of the recording.

    Parameters
    ----------
    table : (W, K, P) array
        Laws of each parameter set, see :mod:`bayes_asv.filters.force_laws`.
    pole : float
        Pole of the filter that all readings passed, rad/s.
    inputs : (N, nu) array
        Measured inputs at the instants, m/s².
    elapsed : (N,) array
        Ends of the steps since the recording's beginning, s.
    added : (N, ne) array
        Forces on the body at the elements, of whatever origin, N.
    """

    table: Array
    pole: float
    inputs: Array
    elapsed: Array
    added: Array


NO_LAWS = Laws(table_of_laws([])[None], 1.0, np.zeros((0, 0)), np.ones(1), np.zeros((0, 0)))


class FilterPass(NamedTuple):
    """One pass over a recording for W parameter sets.

    Parameters
    ----------
    log_likelihood : (W,) array
        Of all readings.
    innovations, log_variances : (W, N, ny) arrays
        Normalised innovations and logarithms of their variances; zero where there is no value.
    states : (W, N, nx + ne) array
        Mean of the car's states and of the filtered forces after each update.
    """

    log_likelihood: Array
    innovations: Array
    log_variances: Array
    states: Array


@lru_cache(maxsize=64)
def _compiled(
    nx: int, ne: int, ns: int, nm: int, nd: int, nu: int, ny: int
) -> Callable[..., None]:  # sizes are constants of the compiled function
    lanes = LANES
    nf = nx + ne
    rows = nf + nm
    coupled = rows + nd + nu
    n = coupled + 2 * ny

    @njit(**OPTIONS)
    def run(
        A: Array,
        B: Array,
        C: Array,
        E: Array,
        rates: Array,
        N: Array,
        biases: Array,
        white: Array,
        filtered: Array,
        poles: Array,
        step: Array,
        moments: Array,
        spread: Array,
        kind: NDArray[np.int8],
        reading: Array,
        extra: Array,
        start: Array,
        table: Array,
        pole: float,
        inputs: Array,
        elapsed: Array,
        added: Array,
        keep: bool,
        total: Array,
        nus: Array,
        logs: Array,
        states: Array,
        transitions: Array,
        feedbacks: Array,
        by_force: Array,
        decay_at: Array,
        gains: Array,
        roots: Array,
        driven: Array,
    ) -> None:
        powers = np.empty((TAYLOR + 1, nx, nx, lanes))
        drive = np.empty((nu, ORDER, nx, lanes))
        power_series(nx, nu, lanes, A, B, powers, drive)
        # A known zero of an input is noise around it, of an output a bias that begins there.
        level = np.zeros((n, lanes))
        for u in range(nu):
            for q in range(lanes):
                level[coupled - nu + u, q] = biases[u, q]
        for y in range(ny):
            for q in range(lanes):
                level[coupled + y, q] = biases[nu + y, q]
        mean = level.copy()
        P = np.zeros((n, n, lanes))
        place = np.empty(nx + nd + ny, np.int64)
        for a in range(nx):
            place[a] = a
        for a in range(nd):
            place[nx + a] = rows + a
        for a in range(ny):
            place[nx + nd + a] = coupled + a
        for a in range(nx + nd + ny):
            for b in range(nx + nd + ny):
                for q in range(lanes):
                    P[place[a], place[b], q] = start[a, b]
        for e in range(ns):  # as if it had been linear before the recording began
            for a in range(nf):
                for q in range(lanes):
                    P[nf + e, a, q] = rates[e, 0, q] * P[2 * e + 1, a, q]
                    P[a, nf + e, q] = P[nf + e, a, q]
            for f in range(e + 1):
                for q in range(lanes):
                    P[nf + e, nf + f, q] = rates[e, 0, q] * P[2 * e + 1, nf + f, q]
                    P[nf + f, nf + e, q] = P[nf + e, nf + f, q]
        for u in range(nu):
            for q in range(lanes):
                P[coupled - nu + u, coupled - nu + u, q] = filtered[u, q]
        for y in range(ny):
            for q in range(lanes):
                P[coupled + ny + y, coupled + ny + y, q] = filtered[nu + y, q]

        lengths = np.full(STEP_LENGTHS, -1.0)
        kept_base = np.zeros((STEP_LENGTHS, rows, coupled, lanes))
        kept_Q = np.zeros((STEP_LENGTHS, nu, nx, nx, lanes))
        kept_decay = np.ones((STEP_LENGTHS, n, lanes))
        kept_gained = np.empty((STEP_LENGTHS, nu + ny, lanes))
        kept_W = np.zeros((STEP_LENGTHS, 3, nf, ne, lanes))
        carry = np.zeros((rows, coupled, lanes))
        T = np.empty((2, rows, lanes))
        PC = np.empty((n, lanes))
        ahead = np.empty((rows, lanes))
        S = np.empty(lanes)
        shift = np.empty(lanes)
        shrink = np.empty(lanes)
        squared = np.zeros(lanes)
        product = np.ones(lanes)
        intensity = np.empty((nu, lanes))
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
        nonlinear = table.shape[1] > 0  # without laws the Jacobian of a step stays as it is
        linearised = transitions.shape[0] > 0
        feedback = np.zeros((rows, nf, lanes))
        for a in range(nf):
            for q in range(lanes):
                feedback[a, a, q] = 1.0
        if linearised:
            for u in range(nu):
                for j in range(ORDER):
                    for a in range(nx):
                        driven[u, j, a] = drive[u, j, a, 0]
        values = 0
        h_before, carried, oldest = 0.0, -1, 0
        for k in range(step.shape[0]):
            h = step[k]
            if h > 0.0:
                slot, known, oldest = find_step(h, lengths, oldest)
                base, Q, W = kept_base[slot], kept_Q[slot], kept_W[slot]
                decay, gained = kept_decay[slot], kept_gained[slot]
                if not known:
                    step_weights(h, weights)
                    discretize_vectors(nx, nd, nu, rows, coupled, weights, powers, B, N, base, Q)
                    decays(coupled, nu, ny, lanes, h, poles, decay)
                    gained_noise(coupled, nu, ny, lanes, filtered, decay, gained)
                    if ne > 0:
                        force_weights(nx, ne, lanes, h, powers, E, pole, base, W, T[0], T[1])
                if not known or slot != carried:
                    carried = slot
                    for a in range(rows):
                        for b in range(coupled):
                            for q in range(lanes):
                                carry[a, b, q] = base[a, b, q]
                for u in range(nu):
                    for q in range(lanes):
                        intensity[u, q] = white[u, q] * spread[k, u] + spread[k, nu + u]
                advance_mean_vectors(
                    nx, nu, rows, coupled, n, 1, base, drive, moments[k], mean, ahead
                )
                if ne > 0:
                    bends[0], bends[1] = bend_weights(h, h_before)
                    h_before = h
                    advance_forces(
                        nx, ne, nu, ns, nm, coupled, table, rates, B, lag, mean, k, h, bends,
                        inputs, elapsed, added, W, by, last, force, stiffness, damping, rate,
                        series, work, ahead,
                    )  # fmt: skip
                    if nonlinear:
                        linearise_vectors(
                            nx, ne, nm, coupled, base, W, lag, by, stiffness, damping,
                            series, carry,
                        )  # fmt: skip
                    if linearised:
                        if nonlinear:
                            feedback_vectors(
                                nx, ne, nm, coupled, W, lag, by, stiffness, damping, series,
                                feedback,
                            )  # fmt: skip
                        for a in range(rows):
                            for b in range(coupled):
                                transitions[k, a, b] = carry[a, b, 0]
                            for b in range(nf):
                                feedbacks[k, a, b] = feedback[a, b, 0]
                        for part in range(2):
                            for a in range(nf):
                                for e in range(ne):
                                    by_force[k, part, a, e] = W[part, a, e, 0]
                        for a in range(n):
                            decay_at[k, a] = decay[a, 0]
                for a in range(rows):
                    for q in range(lanes):
                        mean[a, q] = ahead[a, q]
                for a in range(rows + nd, n):
                    for q in range(lanes):
                        mean[a, q] = level[a, q] + (mean[a, q] - level[a, q]) * decay[a, q]
                predict_vectors(nx, nu, ny, rows, coupled, carry, Q, decay, intensity, gained, P)
            for y in range(ny):
                what = kind[k, y]
                if what == MISSING:
                    continue
                project_vectors(y, rows, coupled, ny, 1, C, P, mean, PC, S, shift)
                for q in range(lanes):
                    S[q] += white[nu + y, q] + extra[k, y]
                if what == VALUE:
                    condition_on_value(lanes, reading[k, y], S, shift, shrink, squared)
                    values += 1
                    if keep:
                        for q in range(lanes):
                            nus[k, y, q] = shift[q] * math.sqrt(S[q])
                            logs[k, y, q] = math.log(S[q])
                    for q in range(lanes):
                        product[q] *= S[q]
                else:
                    condition_on_bound(
                        lanes, what == AT_LEAST, reading[k, y], S, shift, shrink, total
                    )
                if linearised:
                    roots[k, y] = 1.0 / math.sqrt(S[0]) if what == VALUE else 0.0
                    for a in range(n):
                        gains[k, y, a] = PC[a, 0] * shrink[0]
                condition_vectors(n, 1, PC, shift, shrink, mean, P)
            for q in range(lanes):
                if not 1e-100 < product[q] < 1e100:  # one logarithm for many readings
                    total[q] -= 0.5 * math.log(product[q])
                    product[q] = 1.0
            if keep:
                for a in range(nf):
                    for q in range(lanes):
                        states[k, a, q] = mean[a, q]
        for q in range(lanes):
            total[q] -= 0.5 * (math.log(product[q]) + squared[q] + values * LOG_2PI)

    return run  # type: ignore[no-any-return]


def forces_with_memory(laws: Laws, ne: int) -> tuple[int, int]:
    """Return how many forces are states: those of dampers, and all with those of friction.

    Where one element has a force with memory, all have one of that kind.
    """
    dampers, friction = (ne * bool(np.any(laws.table[:, :, 1] == code)) for code in WITH_MEMORY)
    return dampers, dampers + friction


def readout(system: StateSpace, nm: int) -> Array:
    """Return outputs (W, ny, nx + ne + nm) by states, filtered forces and forces with memory."""
    W, ny, _ = system.C.shape
    return np.concatenate([system.C, system.G, np.zeros((W, ny, nm))], axis=2)


def _passes(
    system: StateSpace,
    noise: SensorNoise,
    data: Measurements,
    laws: Laws | None,
    keep: bool,
    linearised: LinearisedFilter | None = None,
) -> FilterPass:
    """Run all parameter sets; fill what is linearised along the path of the first."""
    nonlinear = laws is not None
    laws = NO_LAWS if laws is None else laws
    W, nx, nu = system.B.shape
    ny = system.C.shape[1]
    ne = system.E.shape[2] if nonlinear else 0
    ns, nm = forces_with_memory(laws, ne)
    C = readout(system, nm) if nonlinear else system.C
    A, B, C, E, rates, biases, white, filtered, poles = (
        lanes_last(x)
        for x in (
            system.A, system.B, C, system.E[:, :, :ne], system.rates[:, :ne], system.biases,
            noise.white, noise.filtered, noise.poles,
        )
    )  # fmt: skip
    instants = len(data.step) if keep else 0
    tables = lanes_last(np.broadcast_to(laws.table, (W, *laws.table.shape[1:])))
    out = [np.zeros((len(A), LANES))]
    out += [np.zeros((len(A), instants, size, LANES)) for size in (ny, ny, nx + ne)]
    run = _compiled(nx, ne, ns, nm, system.N.shape[1], nu, ny)
    if linearised is None:
        linearised = room_for(nx, ne, nm, system.N.shape[1], nu, ny, np.zeros(0))
    for b in range(len(A)):
        run(
            A[b], B[b], C[b], E[b], rates[b], system.N, biases[b], white[b], filtered[b], poles[b],
            *data, tables[b], laws.pole, laws.inputs, laws.elapsed, laws.added, keep,
            *(x[b] for x in out), *linearised[1:-1],
        )  # fmt: skip
    total, *kept = (np.moveaxis(x, -1, 1).reshape(len(A) * LANES, *x.shape[1:-1])[:W] for x in out)
    return FilterPass(total, *kept)


def log_likelihood(
    system: StateSpace, noise: SensorNoise, data: Measurements, laws: Laws | None = None
) -> Array:
    """Log-likelihood (W,) of one recording for W parameter sets.

    Parameters
    ----------
    system, noise : StateSpace and SensorNoise
        Of W parameter sets.
    data : Measurements
        The recording.
    laws : Laws, optional
        Force laws; without any the filter is that of the linear car.

    Returns
    -------
    (W,) array
        Not finite where a variance overflows.
    """
    return _passes(system, noise, data, laws, keep=False).log_likelihood


def filter_pass(
    system: StateSpace, noise: SensorNoise, data: Measurements, laws: Laws | None = None
) -> FilterPass:
    """Log-likelihood, innovations and states of one recording for W parameter sets.

    Parameters and errors are those of :func:`log_likelihood`.
    """
    return _passes(system, noise, data, laws, keep=True)


def linearise(
    system: StateSpace, noise: SensorNoise, data: Measurements, laws: Laws
) -> tuple[FilterPass, LinearisedFilter]:
    """Filter one recording with one parameter set; linearise the filter along its path.

    Parameters are those of :func:`log_likelihood`; force laws may be none.
    """
    nx, nu = system.B.shape[1:]
    ny, ne = system.C.shape[1], system.E.shape[2]
    _, nm = forces_with_memory(laws, ne)
    room = room_for(nx, ne, nm, system.N.shape[1], nu, ny, data.step)
    filtered = _passes(system, noise, data, laws, True, room)
    return filtered, room._replace(C=readout(system, nm)[0])
