"""Unscented Kalman filter for the states and parameters of a car, compiled.

The states s = (x, b, d, w, v) are the motion x, biases b of the outputs, biases d of the inputs
along the directions in which those of the outputs cannot absorb them, and the noise that passed the
filters of the input sensors w and of the output sensors v.  They are linear once the parameters θ
are known, so that only θ needs sigma points (Morelande & Moran 2007)::

    θ = μ + Dᵀ d,    d ~ N(m, Fᵀ F),    s = x + Jᵀ d + η,    η ~ N(0, Π)

Sigma points lie at ± :data:`SIGMA_DISTANCE` along each row of D, with s on the line that J gives.
The odd part of what a step or a measurement makes of them is the new J; the even part adds to mean
and variance.  With θ before s in the state vector this is the plain unscented filter with
n + λ = SIGMA_DISTANCE², α = β = 1, whose points along the linear directions need not be
computed.  Points along the axes do not see the interaction of uncertain parameters with an
uncertain state; its variance
(:func:`bayes_asv.filters.predicted_measurement.interaction_variance`) is added to process and
measurement noise.

A moving reference follows the estimate: after each reading μ, D and J absorb m and F.  A fixed
reference stays, so that a window can be filtered again with sigma points where later readings have
shown the parameters to be (posterior linearisation; García-Fernández et al. 2015).

With force laws the state is not linear in itself either; :mod:`bayes_asv.filters.ukf_forces` takes
the place of the linear prediction step, and all else stays as it is.

One recursion is compiled for each combination of sizes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.cholesky_update import (
    add_parameter_noise,
    measurement_update,
    parameter_variance,
    recentre,
)
from bayes_asv.filters.kalman import AT_LEAST, MISSING, VALUE
from bayes_asv.filters.noise_adaptation import (
    detect_drift,
    is_excited,
    noise_factors,
    take_snapshot,
    update_autocovariance,
    update_noise_factor,
    update_white_share,
)
from bayes_asv.filters.predicted_measurement import (
    SIGMA_DISTANCE,
    interaction_variance,
    odd_parts,
    output_matrix,
    predict_measurement,
)
from bayes_asv.filters.prediction import (
    IN_PLACE,
    INLINE,
    LOG_2PI,
    OPTIONS,
    TAYLOR,
    sizes_of_one_type,
    upper_tail,
)
from bayes_asv.filters.simd_batch import (
    fill_lanes,
    propagate,
    set_parameters,
    set_states,
    transition_matrices,
    unscented_moments,
)
from bayes_asv.filters.simd_layout import blocks, lane_rows, shape_of
from bayes_asv.filters.ukf_forces import force_workspace, propagate_with_forces
from bayes_asv.filters.ukf_state import (
    ALL,
    NOTHING,
    Columns,
    FilterSettings,
    Model,
    Sizes,
    State,
    Steps,
    columns,
    statistics,
)

__all__ = ["DONE", "RELINEARIZE", "RESET", "REVIEW", "SIGMA_DISTANCE", "run"]

Array = NDArray[np.float64]

# Why a run returned: all steps processed, or the decision that it needs.
DONE, RELINEARIZE, RESET, REVIEW = 0, 1, 2, 3

# Share of the interaction variance in a reading's variance beyond which the reading does not test
# the noise.
_MAX_INTERACTION: Final = 0.1


@njit(**IN_PLACE)
def _advance_covariance(
    sizes: Sizes,
    P: Array,
    T: Array,
    phi: Array,
    gamma: Array,
    by_bias: Array,
    Q: Array,
    decay: Array,
    intensity: Array,
    filtered: Array,
) -> None:
    """Carry the covariance P (ns, ns) over one step in place; T (nx, ns) is room to work in."""
    nx, ne, nd, ny, ns = sizes.motion, sizes.elements, sizes.directions, sizes.outputs, sizes.states
    bias, noise = nx + ny, sizes.lasting
    for a in range(nx):
        for b in range(ns):
            total = 0.0
            for c in range(nx):
                total += phi[a, c] * P[c, b]
            for k in range(nd):
                total += by_bias[a, k] * P[bias + k, b]
            for u in range(ne):
                total += gamma[a, u] * P[noise + u, b]
            T[a, b] = total
    for a in range(nx):
        for b in range(a, nx):
            total = 0.0
            for c in range(nx):
                total += T[a, c] * phi[b, c]
            for k in range(nd):
                total += T[a, bias + k] * by_bias[b, k]
            for u in range(ne):
                total += T[a, noise + u] * gamma[b, u]
            for u in range(ne):
                total += intensity[u] * Q[u, a, b]
            P[a, b] = total
            P[b, a] = total
        for b in range(ns - nx):
            value = T[a, nx + b] * decay[b]
            P[a, nx + b] = value
            P[nx + b, a] = value
    for a in range(ns - nx):
        for b in range(ns - nx):
            P[nx + a, nx + b] *= decay[a] * decay[b]
    for c in range(ne + ny):
        kept = decay[ny + nd + c]
        P[noise + c, noise + c] += filtered[c] * (1.0 - kept * kept)


@njit(**INLINE)
def _reset_motion(
    sizes: Sizes, x: Array, J: Array, Pi: Array, start: Array, filtered: Array
) -> None:
    """Return motion and filtered noise to their priors; biases stay."""
    for a in range(sizes.states):
        if sizes.motion <= a < sizes.lasting:
            continue
        x[a] = 0.0
        for i in range(J.shape[0]):
            J[i, a] = 0.0
        for b in range(sizes.states):
            Pi[a, b] = Pi[b, a] = 0.0
        Pi[a, a] = start[a, a] if a < sizes.motion else filtered[a - sizes.lasting]


def run(
    sizes: Sizes,
    first: int,
    fixed: bool,
    state: State,
    model: Model,
    settings: FilterSettings,
    steps: Steps,
    out: Array,
) -> tuple[int, int]:
    """Process steps from ``first`` on, until the end or until a decision is needed.

    Parameters
    ----------
    sizes : Sizes
        Of the car and its sensors.
    first : int
        First step.
    fixed : bool
        Whether the reference is fixed.  Such a run processes all steps without process noise of the
        parameters and without noise adaptation.  Directions beyond the model's coordinates change
        the state alone.
    state : State
        Changed in place.
    model : Model
        Car and sensors.
    settings : FilterSettings
        Thresholds.
    steps : Steps
        Steps and readings.
    out : (N, columns) array
        Results, filled from ``first`` on; not used with a fixed reference.

    Returns
    -------
    event, next : int
        Why it returned, and the first step that was not processed.
    """
    return _compiled(sizes)(first, fixed, state, model, settings, steps, out)


@lru_cache(maxsize=64)
def _compiled(sizes: Sizes) -> Callable[..., tuple[int, int]]:
    rows, at, into = lane_rows(sizes), statistics(sizes.outputs), columns(sizes)
    nx, ne, nd, ny, ns = sizes_of_one_type(
        sizes.motion, sizes.elements, sizes.directions, sizes.outputs, sizes.states
    )
    nR, size, shape, forces = sizes.rows, rows.size, shape_of(sizes), sizes.forces
    # Python's integers, which are constants of the vector code
    plain, elements, moving, coupled = int(nx - forces), int(ne), int(nx), int(nx + ne)

    @njit(**OPTIONS)
    def run(
        first: int,
        fixed: bool,
        state: State,
        model: Model,
        settings: FilterSettings,
        steps: Steps,
        out: Array,
    ) -> tuple[int, int]:
        mu, D, x, J, m, F, Pi = (
            state.mu, state.D, state.x, state.J, state.m, state.F, state.Pi,
        )  # fmt: skip
        scores, autocovariance, snapshots = state.statistics, state.autocovariance, state.snapshots
        # Taken out of their records once: compiled code counts references at every look.
        step, moments, spread, kinds, values, restart, ends, use = steps
        noise, share, start, input_bias = model.noise, model.share, model.start, model.input_bias
        parameter_noise, drift_noise = model.parameter_noise, model.drift_noise
        element, log, centre, scale = model.element, model.log, model.centre, model.scale
        place, copies, bars = model.place, model.copies, model.bars
        term, coefficient, factors = model.term, model.coefficient, model.factors
        constant, uncertain_gains = model.constant, model.uncertain_gains
        output_row, by_row, by_state = model.output_row, model.by_row, model.by_state
        reads_states = model.reads_states
        n_model = element.shape[0]
        p = mu.shape[0]
        points = 1 + 2 * n_model if forces else 0
        force_work = force_workspace(sizes, model.laws, points)
        W = np.zeros(blocks(n_model, ne) * size)
        fill_lanes(sizes, rows, W, n_model, model)
        inputs = np.zeros((ne, TAYLOR + 1))
        even_covariance = np.empty((nx, nx))
        even_workspace = np.empty((2, nx))
        B = np.zeros((nR, nR))
        odd = np.empty((n_model, nR * 2 * ne))
        work = np.empty(2 * ne)
        phi = np.zeros((nx, nx))
        gamma = np.zeros((nx, ne))
        by_bias = np.zeros((nx, nd))
        Q = np.zeros((ne, nx, nx))
        decay = np.ones(ns - nx)
        T = np.empty((nx, ns))
        C = np.empty((ny, nx))
        gain = np.empty(ny)
        y = np.empty((1 + 2 * n_model, ny))
        predicted = np.empty(ny)
        mean = np.empty(ny)
        g = np.empty((ny, p))
        PC = np.empty((ny, ns))
        given_d = np.empty((ny, ny))
        total = np.empty((ny, ny))
        interaction = np.zeros(ny)
        Fg = np.empty((ny, p))
        workspace = np.empty(p)
        noise_factor = np.empty(ny)
        input_factor = np.empty(ne)
        intensity = np.empty(ne)
        filtered = np.empty(ne + ny)
        max_rate = 0.0
        h_transition = h_decay = -1.0
        lanes_current = False
        new_laws = True  # since the last step with forces
        limit = math.sqrt(settings.gate)

        for k in range(first, step.shape[0]):
            noise_factors(ny, at, scores, settings, noise_factor)
            white = scores[at.white_share]
            for u in range(ne):
                input_factor[u] = 0.0
                for o in range(ny):
                    input_factor[u] += share[u, o] * noise_factor[o]
                filtered[u] = (1.0 - white) * noise[ne + ny + u] * input_factor[u]
            for o in range(ny):
                filtered[ne + o] = (1.0 - white) * noise[2 * ne + ny + o] * noise_factor[o]
            h = step[k]
            if h > 0.0 and not fixed:
                has_noise = False
                for a in range(p):
                    rate = parameter_noise[a]
                    if scores[at.drift_detected] > 0.0 and drift_noise[a] > rate:
                        rate = drift_noise[a]
                    workspace[a] = rate * h
                    has_noise = has_noise or rate > 0.0
                if has_noise:
                    scores[at.information_gain] -= add_parameter_noise(ns, D, J, Pi, workspace)
                    lanes_current = False
            if not lanes_current:
                max_rate = set_parameters(
                    ne, rows, shape, W, mu, D, SIGMA_DISTANCE, element, log, centre, scale, place,
                    term, coefficient, factors, constant, copies, bars, uncertain_gains,
                )  # fmt: skip
                output_matrix(sizes, rows, W, output_row, by_row, by_state, C, gain)
                odd_parts(sizes, rows, W, n_model, SIGMA_DISTANCE, odd)
                lanes_current = True
                new_laws = True
                h_transition = -1.0
            if restart[k]:
                _reset_motion(sizes, x, J, Pi, start, filtered)
                scores[at.last_step] = 0.0
            elif h > 0.0:
                new_length = abs(h - h_transition) > 1e-12
                if forces:
                    set_states(sizes, rows, W, n_model, SIGMA_DISTANCE, x, J, input_bias)
                    propagate_with_forces(
                        plain, elements, moving, coupled, sizes, rows, W, points, h,
                        scores[at.last_step], moments, k, ends, place, model.laws,
                        state.force_history, new_laws, new_length, force_work, phi, gamma, Q,
                    )  # fmt: skip
                    new_laws = False
                    scores[at.last_step] = h
                else:
                    propagate(
                        sizes, rows, shape, W, n_model, SIGMA_DISTANCE, x, J, input_bias, h,
                        moments[k], inputs, max_rate, new_length,
                    )  # fmt: skip
                    if new_length:
                        transition_matrices(sizes, rows, W, n_model, h, phi, gamma, Q)
                if new_length or forces:
                    h_transition = h
                    for a in range(nx):
                        for d in range(nd):
                            by_bias[a, d] = 0.0
                            for u in range(ne):
                                by_bias[a, d] += gamma[a, u] * input_bias[u, d]
                if h != h_decay:
                    h_decay = h
                    for c in range(ne + ny):
                        decay[ny + nd + c] = math.exp(-noise[2 * (ne + ny) + c] * h)
                interaction_variance(sizes, odd, Pi, work, B)
                unscented_moments(
                    sizes, rows, W, n_model, SIGMA_DISTANCE, x, J, even_covariance, even_workspace
                )
                for i in range(n_model, p):
                    _propagate_direction(sizes, J[i], phi, gamma, by_bias, even_workspace[0])
                for c in range(ne + ny):
                    x[nx + ny + nd + c] *= decay[ny + nd + c]
                    for i in range(p):
                        J[i, nx + ny + nd + c] *= decay[ny + nd + c]
                for u in range(ne):
                    variance = noise[u] + white * noise[ne + ny + u]
                    intensity[u] = input_factor[u] * (variance * spread[k, u] + spread[k, ne + u])
                _advance_covariance(
                    sizes, Pi, T, phi, gamma, by_bias, Q, decay, intensity, filtered
                )
                for a in range(nx):
                    for b in range(nx):
                        Pi[a, b] += even_covariance[a, b]
                for a in range(nx - forces - ne):
                    to = 2 * a + 1 if a < ne else ne + a
                    for b in range(nx - forces - ne):
                        other = 2 * b + 1 if b < ne else ne + b
                        Pi[to, other] += h * h * B[a, b]

            learn = fixed or is_excited(ny, nx, at, scores, x, Pi, C, h)
            nis = 0.0
            count = 0
            joint = True
            readings = False
            for o in range(ny):
                if not fixed:
                    out[k, into.innovation + o] = 0.0
                kind = kinds[k, o] if use[k] != NOTHING else MISSING
                readings = readings or kind != MISSING
                joint = joint and kind in (MISSING, VALUE)
            processed = False
            for o in range(ny):
                kind = kinds[k, o] if use[k] != NOTHING else MISSING
                if o == 0 or (processed and not joint and kind != MISSING):
                    if o > 0 and not fixed:  # a bound is not linear: use the updated belief
                        recentre(ns, mu, D, x, J, m, F)
                        max_rate = set_parameters(
                    ne, rows, shape, W, mu, D, SIGMA_DISTANCE, element, log, centre, scale, place,
                    term, coefficient, factors, constant, copies, bars, uncertain_gains,
                )  # fmt: skip
                        output_matrix(sizes, rows, W, output_row, by_row, by_state, C, gain)
                        odd_parts(sizes, rows, W, n_model, SIGMA_DISTANCE, odd)
                        h_transition = -1.0
                        new_laws = True
                    predict_measurement(
                        sizes,
                        rows,
                        shape,
                        W,
                        n_model,
                        x,
                        J,
                        Pi,
                        input_bias,
                        output_row,
                        by_row,
                        by_state,
                        reads_states,
                        C,
                        y,
                        predicted,
                        g,
                        PC,
                        given_d,
                    )
                    interaction_variance(sizes, odd, Pi, work, B)
                    for a in range(ny):
                        by = gain[a] * by_row[a]
                        for b in range(ny):
                            given_d[a, b] += (
                                by * gain[b] * by_row[b]
                                * B[output_row[a], output_row[b]]
                            )  # fmt: skip
                        interaction[a] = by * by * B[output_row[a], output_row[a]]
                        variance = noise[ne + a] + white * noise[2 * ne + ny + a]
                        given_d[a, a] += noise_factor[a] * variance
                        parameter_variance(g[a], F, Fg[a])
                        mean[a] = predicted[a]
                        for i in range(p):
                            mean[a] += g[a, i] * m[i]
                        for b in range(a + 1):
                            value = given_d[a, b]
                            for i in range(p):
                                value += Fg[a, i] * Fg[b, i]
                            total[a, b] = value
                            total[b, a] = value
                    if o == 0 and not fixed:
                        for b in range(ny):
                            out[k, into.predicted + b] = predicted[b]
                            out[k, into.predicted_sd + b] = math.sqrt(total[b, b])
                if kind == MISSING:
                    continue
                processed = True
                S = total[o, o]
                value = values[k, o]
                if kind == VALUE:
                    nu = value - mean[o]
                    ratio = nu * nu / S
                    scores[at.log_likelihood] -= 0.5 * (LOG_2PI + math.log(S) + ratio)
                    if not fixed:
                        out[k, into.innovation + o] = nu / math.sqrt(S)
                        if use[k] == ALL and interaction[o] < _MAX_INTERACTION * S:
                            clipped = min(max(nu / math.sqrt(S), -limit), limit)
                            update_white_share(
                                at, scores, settings.slow_window * ny, autocovariance[o, 0, 0],
                                clipped, math.exp(-noise[2 * (ne + ny) + ne + o] * h),
                                noise_factor[o] * noise[2 * ne + ny + o] / S,
                            )  # fmt: skip
                            update_noise_factor(at, scores, settings, o, ratio, noise_factor[o])
                            update_autocovariance(autocovariance[o], nu / math.sqrt(S), settings)
                            nis += ratio
                            count += 1
                    if ratio > settings.gate:
                        extra = S * (ratio / settings.gate - 1.0)
                        given_d[o, o] += extra
                        S += extra
                    residual = value - predicted[o]
                    scores[at.deviance] += (
                        math.log(given_d[o, o]) + residual * residual / given_d[o, o]
                    )
                else:
                    sign = 1.0 if kind == AT_LEAST else -1.0
                    z = sign * (value - mean[o]) / math.sqrt(S)
                    if z > 0.0 and z * z > settings.gate:  # gated like a value
                        extra = S * (z * z / settings.gate - 1.0)
                        given_d[o, o] += extra
                        S += extra
                        z = math.sqrt(settings.gate)
                    root = math.sqrt(S)
                    log_tail, hazard = upper_tail(z)
                    scores[at.log_likelihood] += log_tail
                    scores[at.deviance] -= 2.0 * log_tail
                    shrink = hazard * (hazard - z)
                    if shrink < 1e-12:
                        continue  # far inside the range: no information
                    # A value with such noise changes mean and variance as the bound does (moment
                    # matching of the truncated normal).
                    value = mean[o] + sign * hazard * root / shrink
                    extra = S * (1.0 / shrink - 1.0)
                    given_d[o, o] += extra
                    S += extra
                parameter_variance(g[o], F, Fg[o])
                if learn:
                    scores[at.information_gain] += 0.5 * math.log(S / given_d[o, o])
                measurement_update(
                    ns, value, predicted[o], g[o], PC[o], given_d[o, o], x, J, m, F, Pi, Fg[o],
                    workspace, learn,
                )  # fmt: skip
                if joint:  # condition the other outputs on this reading
                    surprise, residual = value - mean[o], value - predicted[o]
                    for later in range(o + 1, ny):
                        if kinds[k, later] == MISSING:
                            continue
                        part = given_d[o, later] / given_d[o, o]
                        whole = total[o, later] / S
                        predicted[later] += part * residual
                        mean[later] += whole * surprise
                        for i in range(p):
                            g[later, i] -= part * g[o, i]
                        for a in range(ns):
                            PC[later, a] -= part * PC[o, a]
                        for other in range(o + 1, later + 1):
                            given_d[later, other] -= part * given_d[o, other]
                            given_d[other, later] = given_d[later, other]
                            total[later, other] -= whole * total[o, other]
                            total[other, later] = total[later, other]
            if fixed:
                continue
            if readings:
                recentre(ns, mu, D, x, J, m, F)
            # A run may end at any reading, heard or not: what the next one begins with is computed
            # anew in either case, so that the size of chunks has no effect.
            if readings or use[k] == NOTHING:
                lanes_current = False
            if count > 0:
                detect_drift(ny, at, scores, autocovariance, settings.drift_threshold)
            _write_results(
                sizes,
                into,
                mu,
                D,
                x,
                J,
                Pi,
                noise_factor,
                nis,
                count,
                scores[at.drift_detected],
                out[k],
            )
            take_snapshot(ny, at, scores, snapshots, mu, D, settings.fast_threshold, h)
            scores[at.review_time] += h
            fast_factor = 0.0
            for o in range(ny):
                fast_factor = max(fast_factor, scores[at.fast_factor + o])
            scores[at.fault_time] = (
                scores[at.fault_time] + h if fast_factor > settings.fault_threshold else 0.0
            )
            if scores[at.fault_time] > settings.fault_duration:
                return RESET, k + 1
            if scores[at.information_gain] > settings.information_gain:
                return RELINEARIZE, k + 1
            if scores[at.review_time] > settings.review_interval:
                return REVIEW, k + 1
        return DONE, step.shape[0]

    return run  # type: ignore[no-any-return]


@njit(**INLINE)
def _propagate_direction(
    sizes: Sizes, slope: Array, phi: Array, gamma: Array, by_bias: Array, work: Array
) -> None:
    """Propagate the state's derivative (ns,) along a direction without effect on the model."""
    nx = sizes.motion
    for a in range(nx):
        work[a] = slope[a]
    for a in range(nx):
        total = 0.0
        for c in range(nx):
            total += phi[a, c] * work[c]
        for d in range(sizes.directions):
            total += by_bias[a, d] * slope[nx + sizes.outputs + d]
        for u in range(sizes.elements):
            total += gamma[a, u] * slope[sizes.lasting + u]
        slope[a] = total


@njit(**INLINE)
def _write_results(
    sizes: Sizes,
    into: Columns,
    mu: Array,
    D: Array,
    x: Array,
    J: Array,
    Pi: Array,
    noise_factor: Array,
    nis: float,
    count: int,
    drift: float,
    row: Array,
) -> None:
    """Fill a row of results, the reference being at the estimate."""
    for q in range(sizes.estimands):
        variance = 0.0
        for i in range(q + 1):
            variance += D[i, q] * D[i, q]
        row[into.mean + q] = mu[q]
        row[into.sd + q] = math.sqrt(variance)
    for e in range(sizes.elements):
        variance = Pi[2 * e, 2 * e]
        for i in range(mu.shape[0]):
            variance += J[i, 2 * e] * J[i, 2 * e]
        row[into.deflection + e] = x[2 * e]
        row[into.deflection_sd + e] = math.sqrt(variance)
    for o in range(sizes.outputs):
        row[into.noise_factor + o] = noise_factor[o]
    row[into.nis] = nis
    row[into.readings] = count
    row[into.drift] = drift
