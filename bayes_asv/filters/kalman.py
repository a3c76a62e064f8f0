"""Kalman filter of a car with noisy inputs: linear, or extended where its suspension is not.

What it computes for a linear car is the exact Gaussian marginal likelihood of one recording, with
initial state, biases and sensor noise integrated out (see :mod:`.prediction` for the model
and for readings at a rail).  With force laws it is an extended Kalman filter (see
:mod:`.suspension_forces`).  Residual autocorrelation is the business of :mod:`.kalman_ar`.

One recursion is compiled for each combination of sizes, once for a single set of parameters and
once for `LANES` sets side by side, which takes less than half the time for each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.force_laws import SERIES_STIFFNESS
from bayes_asv.filters.prediction import (
    AT_LEAST,
    AT_MOST,
    LOG_2PI,
    MISSING,
    OPTIONS,
    ORDER,
    TAYLOR,
    VALUE,
    advance_mean,
    condition,
    condition_on_bound,
    condition_on_value,
    decays,
    discretize,
    power_series,
    predict_covariance,
    predicted_reading,
    project,
    sizes_of_one_type,
)  # fmt: skip  # fmt: skip
from bayes_asv.filters.suspension_forces import (
    advance_forces,
    bend_weights,
    force_weights,
    linearise,
)

__all__ = [
    "AT_LEAST", "AT_MOST", "LANES", "MISSING", "NO_LAWS", "ORDER", "VALUE", "FilterPass", "Laws",
    "Measurements", "SensorNoise", "StateSpace", "filter_pass", "log_likelihood",
]  # fmt: skip

Array = NDArray[np.float64]

LANES = 32
"""Parameter sets side by side: so many walkers propose at once."""
_FEWEST_LANES = 12  # filled lanes from which on 32 lanes are faster than one set after the other


class StateSpace(NamedTuple):
    """W linear state-space models of one car and one set of sensors.

    ẋ = A x + B u + E φ and y = C x + G φ with u and y in the units of the *readings*: gains of the
    sensors are in B, C and G.

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
    """

    A: Array
    B: Array
    C: Array
    E: Array
    G: Array
    rates: Array
    N: Array

    def some(self, sets: Sequence[int]) -> StateSpace:
        """Pick some of the parameter sets."""
        only = list(sets)
        return StateSpace(
            self.A[only], self.B[only], self.C[only], self.E[only], self.G[only],
            self.rates[only], self.N,
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

    def some(self, sets: Sequence[int]) -> SensorNoise:
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
    spread : (N, 2 nu) array
        What turns the variance of an input's sample into an intensity (s), and an intensity that is
        added for what the input did between its samples (m²/s³), one an input each.
    kind : (N, ny) int8 array
        0 missing, 1 a value, 2 at least, 3 at most.
    reading : (N, ny) array
        Outputs or rails.
    extra : (N, ny) array
        Variance added to single readings.
    start : (nx + nd + ny, nx + nd + ny) array
        Prior covariance of (x, d, b).
    """

    step: Array
    moments: Array
    spread: Array
    kind: NDArray[np.int8]
    reading: Array
    extra: Array
    start: Array


class Laws(NamedTuple):
    """Force laws of the suspension and what they need to know of the recording.

    Parameters
    ----------
    table : (W, K, P) array
        Laws of each parameter set, as :func:`bayes_asv.filters.force_laws.excess` takes them.
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


NO_LAWS = Laws(np.zeros((1, 0, 6)), 1.0, np.zeros((0, 0)), np.ones(1), np.zeros((0, 0)))


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
    nx: int, ne: int, nm: int, nd: int, nu: int, ny: int, lanes: int
) -> Callable[..., None]:  # sizes are constants of the compiled function
    if lanes == 1:  # else loops of known length have to be vectorized before they are put together
        nx, ne, nm, nd, nu, ny = sizes_of_one_type(nx, ne, nm, nd, nu, ny)
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
        total: Array,
        keep: bool,
        nus: Array,
        logs: Array,
        states: Array,
    ) -> None:
        powers = np.empty((TAYLOR + 1, nx, nx, lanes))
        drive = np.empty((nu, ORDER, nx, lanes))
        power_series(nx, nu, lanes, A, B, powers, drive)
        mean = np.zeros((n, lanes))
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
        for e in range(nm):  # as if it had been linear before the recording began
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

        base = np.zeros((rows, coupled, lanes))
        carry = np.zeros((rows, coupled, lanes))
        Q = np.zeros((nu, nx, nx, lanes))
        decay = np.ones((n, lanes))
        T = np.empty((rows, n, lanes))
        PC = np.empty((n, lanes))
        ahead = np.empty((rows, lanes))
        S = np.empty(lanes)
        shift = np.empty(lanes)
        shrink = np.empty(lanes)
        squared = np.zeros(lanes)
        product = np.ones(lanes)
        intensity = np.empty((nu, lanes))
        work = np.empty((nx, nx, lanes))
        impulse = np.empty((nx, nu, lanes))
        W = np.zeros((3, nf, ne, lanes))
        last = np.zeros((3, ne, lanes))
        forces = np.zeros((2, ne, lanes))
        slopes = np.zeros((2, ne, coupled, lanes))
        rate = np.zeros((2, ne, lanes))
        by = np.zeros((2, ne, coupled, lanes))
        series = np.zeros((4, nm, lanes))
        nonlinear = table.shape[1] > 0  # without laws the Jacobian of a step stays as it is
        values = 0
        h_known, h_before = -1.0, 0.0
        for k in range(step.shape[0]):
            h = step[k]
            if h > 0.0:
                if abs(h - h_known) > 1e-12:
                    h_known = h
                    discretize(nx, nd, nu, rows, lanes, h, powers, B, N, base, Q, work, impulse)
                    decays(coupled, nu, ny, lanes, h, poles, decay)
                    if ne > 0:
                        force_weights(nx, ne, lanes, h, powers, E, pole, base, W, T[:, 0], T[:, 1])
                    for a in range(rows):
                        for b in range(coupled):
                            for q in range(lanes):
                                carry[a, b, q] = base[a, b, q]
                for u in range(nu):
                    for q in range(lanes):
                        intensity[u, q] = white[u, q] * spread[k, u] + spread[k, nu + u]
                advance_mean(nx, nu, rows, coupled, lanes, base, drive, k, moments, mean, ahead)
                if ne > 0:
                    up, back = bend_weights(h, h_before)
                    h_before = h
                    advance_forces(
                        nx, ne, nd, nu, nm, lanes, nonlinear, table, rates, powers, B, E, N, pole,
                        mean, k, h, up, back, inputs, elapsed, added, W, last, forces, slopes,
                        rate, by, series, ahead,
                    )  # fmt: skip
                    if nonlinear:
                        linearise(
                            nf, ne, nm, coupled, lanes, base, W, up, back, slopes,
                            by, series, carry,
                        )  # fmt: skip
                for a in range(rows):
                    for q in range(lanes):
                        mean[a, q] = ahead[a, q]
                for a in range(rows + nd, n):
                    for q in range(lanes):
                        mean[a, q] *= decay[a, q]
                predict_covariance(
                    nx, nu, ny, rows, coupled, lanes, carry, Q, decay, intensity, filtered, P, T
                )
            for y in range(ny):
                what = kind[k, y]
                if what == MISSING:
                    continue
                project(y, rows, coupled, ny, lanes, C, P, PC, S)
                for q in range(lanes):
                    S[q] += white[nu + y, q] + extra[k, y]
                predicted_reading(y, rows, coupled, ny, lanes, C, mean, shift)
                if what == VALUE:
                    condition_on_value(lanes, reading[k, y], S, shift, shrink, squared)
                    values += 1
                    if keep:
                        for q in range(lanes):
                            nus[k, y, q] = shift[q] * math.sqrt(S[q])
                            logs[k, y, q] = math.log(S[q])
                    for q in range(lanes):
                        product[q] *= S[q]
                        if not 1e-100 < product[q] < 1e100:  # one logarithm for many readings
                            total[q] -= 0.5 * math.log(product[q])
                            product[q] = 1.0
                else:
                    condition_on_bound(
                        lanes, what == AT_LEAST, reading[k, y], S, shift, shrink, total
                    )
                condition(n, lanes, PC, shift, shrink, mean, P)
            if keep:
                for a in range(nf):
                    for q in range(lanes):
                        states[k, a, q] = mean[a, q]
        for q in range(lanes):
            total[q] -= 0.5 * (math.log(product[q]) + squared[q] + values * LOG_2PI)

    return run  # type: ignore[no-any-return]


def series_dampers(laws: Laws, ne: int) -> int:
    """Return how many dampers have a force of their own: all of them, if any has a stiffness."""
    return ne if np.any(laws.table[:, :, 1] == SERIES_STIFFNESS) else 0


def readout(system: StateSpace, nm: int) -> Array:
    """Return outputs (W, ny, nx + ne + nm) by states, filtered forces and forces of dampers."""
    W, ny, _ = system.C.shape
    return np.concatenate([system.C, system.G, np.zeros((W, ny, nm))], axis=2)


def _lanes_last(values: Array, sets: NDArray[np.int64] | int) -> Array:
    """Pick one parameter set or several of them (W, …); they become the last axis."""
    if isinstance(sets, int):
        return np.ascontiguousarray(values[sets])[..., None]
    return np.ascontiguousarray(values[sets].transpose(*range(1, values.ndim), 0))


def _passes(
    system: StateSpace, noise: SensorNoise, data: Measurements, laws: Laws | None, keep: bool
) -> FilterPass:
    """Run all parameter sets, in lanes where enough of them are left."""
    nonlinear = laws is not None
    laws = NO_LAWS if laws is None else laws
    W, nx, nu = system.B.shape
    ny = system.C.shape[1]
    ne = system.E.shape[2] if nonlinear else 0
    nm = series_dampers(laws, ne)
    C = readout(system, nm) if nonlinear else system.C
    per_set = (
        system.A, system.B, C, system.E[:, :, :ne], system.rates[:, :ne], noise.white,
        noise.filtered, noise.poles,
    )  # fmt: skip
    instants = len(data.step) if keep else 0
    out = FilterPass(np.zeros(W), *(np.zeros((W, instants, size)) for size in (ny, ny, nx + ne)))
    tables = np.broadcast_to(laws.table, (W, *laws.table.shape[1:]))
    done = 0
    while done < W:
        several = W - done >= _FEWEST_LANES
        lanes = LANES if several else 1
        picked = np.minimum(np.arange(done, done + lanes), W - 1)  # the last one fills up
        sets = picked if several else done
        run = _compiled(nx, ne, nm, system.N.shape[1], nu, ny, lanes)
        A, B, rows, E, rates, white, filtered, poles = (_lanes_last(x, sets) for x in per_set)
        # One set alone is written where it belongs.
        total, *kept = (
            [np.zeros((*x.shape[1:], lanes)) for x in out]
            if several
            else [x[done, ..., None] for x in out]
        )
        run(
            A, B, rows, E, rates, system.N, white, filtered, poles, *data,
            np.ascontiguousarray(tables[picked]), laws.pole, laws.inputs, laws.elapsed, laws.added,
            total, keep, *kept,
        )  # fmt: skip
        count = min(lanes, W - done)
        if several:
            for into, values in zip(out, (total, *kept), strict=True):
                into[done : done + count] = np.moveaxis(values, -1, 0)[:count]
        done += count
    return out


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
