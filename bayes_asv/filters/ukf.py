"""Unscented Kalman filter for the states and parameters of the half car, compiled.

The ten states s = (x, b, w, v) are the motion x, two biases b, and the filtered noise of the wheel
sensors w and of the chassis sensors v.  They are linear once the parameters θ are known, so that
only θ needs sigma points (Morelande & Moran 2007)::

    θ = μ + Dᵀ d,    d ~ N(m, Fᵀ F),    s = x + Jᵀ d + η,    η ~ N(0, Π)

Sigma points lie at ± :data:`SIGMA_DISTANCE` along each row of D, with s on the line that J gives.
The odd part of what a step or a measurement makes of them is the new J; the even part adds to mean
and variance.  With θ before s in the state vector this is the plain unscented filter with
n + λ = SIGMA_DISTANCE², α = β = 1, whose points along the ten linear directions need not be
computed.  Points along the axes do not see the interaction of uncertain parameters with an
uncertain state; its variance (:func:`bayes_asv.filters.simd_outputs.interaction_variance`) is added
to process and measurement noise.

A moving reference follows the estimate: after each reading μ, D and J absorb m and F.  A fixed
reference stays, so that a window can be filtered again with sigma points where later readings have
shown the parameters to be (posterior linearization; García-Fernández et al. 2015).
"""

from __future__ import annotations

import math
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
)
from bayes_asv.filters.predicted_measurement import SIGMA_DISTANCE, predict_measurement
from bayes_asv.filters.prediction import OPTIONS, TAYLOR
from bayes_asv.filters.simd_batch import (
    fill_lanes,
    propagate,
    set_parameters,
    transition_matrices,
    unscented_moments,
)
from bayes_asv.filters.simd_layout import BLOCK, blocks
from bayes_asv.filters.simd_outputs import interaction_variance, odd_parts, output_matrix
from bayes_asv.filters.tails import upper_tail
from bayes_asv.filters.ukf_state import (
    DEFLECTION,
    DEFLECTION_SD,
    DEVIANCE,
    DRIFT,
    DRIFT_DETECTED,
    FAST_FACTOR,
    FAULT_TIME,
    INFORMATION_GAIN,
    INNOVATION,
    LOG_LIKELIHOOD,
    MEAN,
    NIS,
    NOISE_FACTOR,
    PREDICTED,
    PREDICTED_SD,
    READINGS,
    REVIEW_TIME,
    SD,
    FilterSettings,
    Model,
    State,
    Steps,
)

__all__ = ["DONE", "RELINEARIZE", "RESET", "REVIEW", "SIGMA_DISTANCE", "run"]

Array = NDArray[np.float64]

# Why a run returned: all steps processed, or the decision that it needs.
DONE, RELINEARIZE, RESET, REVIEW = 0, 1, 2, 3

# Share of the interaction variance in a reading's variance beyond which the reading does not test
# the noise.
_MAX_INTERACTION: Final = 0.1
_LOG_2PI: Final = math.log(2.0 * math.pi)


@njit(**OPTIONS)
def _advance_covariance(
    P: Array,
    T: Array,
    phi: Array,
    gamma: Array,
    qf: Array,
    qr: Array,
    decay: Array,
    intensity_f: float,
    intensity_r: float,
    slow: Array,
) -> None:
    """Carry the covariance P (10, 10) over one step in place; T (4, 10) is room to work in."""
    for a in range(4):
        for b in range(10):
            T[a, b] = (
                phi[a, 0] * P[0, b]
                + phi[a, 1] * P[1, b]
                + phi[a, 2] * P[2, b]
                + phi[a, 3] * P[3, b]
                + gamma[a, 0] * P[6, b]
                + gamma[a, 1] * P[7, b]
            )
    for a in range(4):
        for b in range(a, 4):
            acc = (
                T[a, 0] * phi[b, 0]
                + T[a, 1] * phi[b, 1]
                + T[a, 2] * phi[b, 2]
                + T[a, 3] * phi[b, 3]
                + T[a, 6] * gamma[b, 0]
                + T[a, 7] * gamma[b, 1]
                + intensity_f * qf[a, b]
                + intensity_r * qr[a, b]
            )
            P[a, b] = acc
            P[b, a] = acc
        for b in range(6):
            acc = T[a, 4 + b] * decay[b]
            P[a, 4 + b] = acc
            P[4 + b, a] = acc
    for a in range(6):
        for b in range(6):
            P[4 + a, 4 + b] *= decay[a] * decay[b]
    for a in range(4):
        P[6 + a, 6 + a] += slow[a] * (1.0 - decay[2 + a] * decay[2 + a])


@njit(**OPTIONS)
def _reset_motion(state: State, start: Array, filtered_noise: Array) -> None:
    """Return motion and filtered noise to their priors; biases stay."""
    for a in range(10):
        if a == 4 or a == 5:
            continue
        state.x[a] = 0.0
        for i in range(state.J.shape[0]):
            state.J[i, a] = 0.0
        for b in range(10):
            state.Pi[a, b] = state.Pi[b, a] = 0.0
        state.Pi[a, a] = start[a] if a < 4 else filtered_noise[a - 6]


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
    """Process steps from ``first`` on, until the end or until a decision is needed.

    Parameters
    ----------
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
    out : (N, COLUMNS) array
        Results, filled from ``first`` on; not used with a fixed reference.

    Returns
    -------
    event, next : int
        Why it returned, and the first step that was not processed.
    """
    mu, D, x, J, m, F, Pi = (
        state.mu, state.D, state.x, state.J, state.m, state.F, state.Pi,
    )  # fmt: skip
    statistics, noise, parameter_noise = state.statistics, model.noise, model.parameter_noise
    n_model = model.element.shape[0]
    p = mu.shape[0]
    W = np.zeros(blocks(n_model) * BLOCK)
    fill_lanes(W, n_model, model.base)
    inputs = np.empty((2, TAYLOR + 1))
    even_covariance = np.empty((4, 4))
    even_workspace = np.empty((2, 4))
    B = np.empty((2, 2))
    odd = np.empty((n_model, 8))
    phi = np.zeros((4, 4))
    gamma = np.zeros((4, 2))
    qf = np.zeros((4, 4))
    qr = np.zeros((4, 4))
    decay = np.ones(6)
    T = np.empty((4, 10))
    C = np.empty((2, 4))
    gain = np.empty(2)
    y = np.empty((1 + 2 * n_model, 2))
    predicted = np.empty(2)
    g = np.empty((2, p))
    PC = np.empty((2, 10))
    variance_given_d = np.empty(2)
    interaction = np.zeros(2)
    innovation_cov = np.zeros(3)
    Fg = np.empty(p)
    Fg_rear = np.empty(p)
    workspace = np.empty(p)
    noise_factor = np.empty(2)
    filtered_noise = np.empty(4)
    front_innovation = rear_predicted = 0.0
    max_rate = 0.0
    h_transition = h_decay = -1.0
    lanes_current = False

    for k in range(first, steps.step.shape[0]):
        noise_factors(statistics, settings, noise_factor)
        for c in range(4):
            filtered_noise[c] = noise[4 + c] * noise_factor[c & 1]
        h = steps.step[k]
        if h > 0.0 and not fixed:
            has_noise = False
            for a in range(p):
                rate = parameter_noise[a]
                if statistics[DRIFT_DETECTED] > 0.0 and model.drift_noise[a] > rate:
                    rate = model.drift_noise[a]
                workspace[a] = rate * h
                has_noise = has_noise or rate > 0.0
            if has_noise:
                statistics[INFORMATION_GAIN] -= add_parameter_noise(D, J, Pi, workspace)
                lanes_current = False
        if not lanes_current:
            max_rate = set_parameters(
                W, mu, D, SIGMA_DISTANCE, model.element, model.log, model.centre, model.scale
            )
            output_matrix(W, C, gain)
            odd_parts(W, n_model, SIGMA_DISTANCE, odd)
            lanes_current = True
            h_transition = -1.0
        if steps.restart[k]:
            _reset_motion(state, model.start, filtered_noise)
        elif h > 0.0:
            new_length = abs(h - h_transition) > 1e-12
            propagate(
                W, n_model, SIGMA_DISTANCE, x, J, h, steps.moments[k], inputs, max_rate, new_length
            )
            if new_length:
                transition_matrices(W, n_model, h, phi, gamma, qf, qr)
                h_transition = h
            if h != h_decay:
                h_decay = h
                for c in range(4):
                    decay[2 + c] = math.exp(-noise[8 + c] * h)
            interaction_variance(odd, Pi, B)
            unscented_moments(W, n_model, SIGMA_DISTANCE, x, J, even_covariance, even_workspace)
            for i in range(n_model, p):
                _propagate_direction(J[i], phi, gamma)
            for c in range(4):
                x[6 + c] *= decay[2 + c]
                for i in range(p):
                    J[i, 6 + c] *= decay[2 + c]
            intensity_f = noise_factor[0] * (noise[0] * steps.spread[k, 0] + steps.spread[k, 2])
            intensity_r = noise_factor[1] * (noise[1] * steps.spread[k, 1] + steps.spread[k, 3])
            _advance_covariance(
                Pi, T, phi, gamma, qf, qr, decay, intensity_f, intensity_r, filtered_noise
            )
            for a in range(4):
                for b in range(4):
                    Pi[a, b] += even_covariance[a, b]
            for a in range(2):
                for b in range(2):
                    Pi[1 + 2 * a, 1 + 2 * b] += h * h * B[a, b]

        learn = fixed or is_excited(state, C, h)
        nis = 0.0
        count = 0
        covariance_given_d = 0.0
        if not fixed:
            out[k, INNOVATION] = out[k, INNOVATION + 1] = 0.0
        both = steps.kind[k, 0] == VALUE and steps.kind[k, 1] == VALUE
        for axle in range(2):
            kind = steps.kind[k, axle]
            if axle == 0 or (not both and steps.kind[k, 0] != MISSING):
                if axle == 1 and not fixed:  # a bound is not linear: use the updated belief
                    recentre(mu, D, x, J, m, F)
                    max_rate = set_parameters(
                        W,
                        mu,
                        D,
                        SIGMA_DISTANCE,
                        model.element,
                        model.log,
                        model.centre,
                        model.scale,
                    )
                    output_matrix(W, C, gain)
                    odd_parts(W, n_model, SIGMA_DISTANCE, odd)
                    h_transition = -1.0
                covariance_given_d = predict_measurement(
                    W, n_model, state, C, y, predicted, g, PC, variance_given_d
                )
                interaction_variance(odd, Pi, B)
                interaction[0] = gain[0] * gain[0] * B[0, 0]
                interaction[1] = gain[1] * gain[1] * B[1, 1]
                variance_given_d[0] += noise_factor[0] * noise[2] + interaction[0]
                variance_given_d[1] += noise_factor[1] * noise[3] + interaction[1]
                covariance_given_d += gain[0] * gain[1] * B[0, 1]
                innovation_cov[1] = variance_given_d[1] + parameter_variance(g[1], F, Fg_rear)
                innovation_cov[0] = variance_given_d[0] + parameter_variance(g[0], F, Fg)
                innovation_cov[2] = covariance_given_d
                for i in range(p):
                    innovation_cov[2] += Fg[i] * Fg_rear[i]
                if axle == 0 and not fixed:
                    for b in range(2):
                        out[k, PREDICTED + b] = predicted[b]
                        out[k, PREDICTED_SD + b] = math.sqrt(innovation_cov[b])
            if kind == MISSING:
                continue
            mean = predicted[axle]
            for i in range(p):
                mean += g[axle, i] * m[i]
            S = innovation_cov[axle]
            if axle == 1 and both:  # given the front reading
                S -= innovation_cov[2] * innovation_cov[2] / innovation_cov[0]
                mean = rear_predicted + innovation_cov[2] / innovation_cov[0] * front_innovation
            value = steps.reading[k, axle]
            if kind == VALUE:
                nu = value - mean
                ratio = nu * nu / S
                statistics[LOG_LIKELIHOOD] -= 0.5 * (_LOG_2PI + math.log(S) + ratio)
                if not fixed:
                    out[k, INNOVATION + axle] = nu / math.sqrt(S)
                    if interaction[axle] < _MAX_INTERACTION * S:
                        update_noise_factor(statistics, settings, axle, ratio, noise_factor[axle])
                        update_autocovariance(
                            state.autocovariance[axle], nu / math.sqrt(S), settings
                        )
                        nis += ratio
                        count += 1
                if ratio > settings.gate:
                    extra = S * (ratio / settings.gate - 1.0)
                    variance_given_d[axle] += extra
                    S += extra
                residual = value - predicted[axle]
                statistics[DEVIANCE] += (
                    math.log(variance_given_d[axle]) + residual * residual / variance_given_d[axle]
                )
            else:
                sign = 1.0 if kind == AT_LEAST else -1.0
                z = sign * (value - mean) / math.sqrt(S)
                if z > 0.0 and z * z > settings.gate:  # gated like a value
                    extra = S * (z * z / settings.gate - 1.0)
                    variance_given_d[axle] += extra
                    S += extra
                    z = math.sqrt(settings.gate)
                root = math.sqrt(S)
                log_tail, hazard = upper_tail(z)
                statistics[LOG_LIKELIHOOD] += log_tail
                statistics[DEVIANCE] -= 2.0 * log_tail
                shrink = hazard * (hazard - z)
                if shrink < 1e-12:
                    continue  # far inside the range: no information
                # A value with such noise changes mean and variance as the bound does (moment
                # matching of the truncated normal).
                value = mean + sign * hazard * root / shrink
                extra = S * (1.0 / shrink - 1.0)
                variance_given_d[axle] += extra
                S += extra
            if axle == 0 and both:
                innovation_cov[0] = S
                front_innovation = value - mean
                rear_predicted = predicted[1]
                for i in range(p):
                    rear_predicted += g[1, i] * m[i]
            parameter_variance(g[axle], F, Fg)
            if learn:
                statistics[INFORMATION_GAIN] += 0.5 * math.log(S / variance_given_d[axle])
            measurement_update(
                value, predicted[axle], g[axle], PC[axle], variance_given_d[axle], x, J, m, F, Pi,
                Fg, workspace, learn,
            )  # fmt: skip
            if axle == 0 and both:  # condition the rear on the front reading
                share = covariance_given_d / variance_given_d[0]
                predicted[1] += share * (value - predicted[0])
                variance_given_d[1] -= share * covariance_given_d
                for i in range(p):
                    g[1, i] -= share * g[0, i]
                for a in range(10):
                    PC[1, a] -= share * PC[0, a]
        if fixed:
            continue
        if steps.kind[k, 0] != MISSING or steps.kind[k, 1] != MISSING:
            recentre(mu, D, x, J, m, F)
            lanes_current = False
        if count > 0:
            detect_drift(state, settings.drift_threshold)
        _write_results(state, noise_factor, nis, count, out[k])
        take_snapshot(state, settings.fast_threshold, h)
        statistics[REVIEW_TIME] += h
        fast_factor = max(statistics[FAST_FACTOR], statistics[FAST_FACTOR + 1])
        statistics[FAULT_TIME] = (
            statistics[FAULT_TIME] + h if fast_factor > settings.fault_threshold else 0.0
        )
        if statistics[FAULT_TIME] > settings.fault_duration:
            return RESET, k + 1
        if statistics[INFORMATION_GAIN] > settings.information_gain:
            return RELINEARIZE, k + 1
        if statistics[REVIEW_TIME] > settings.review_interval:
            return REVIEW, k + 1
    return DONE, steps.step.shape[0]


@njit(**OPTIONS)
def _propagate_direction(slope: Array, phi: Array, gamma: Array) -> None:
    """Propagate the state's derivative (10,) along a direction without effect on the model."""
    a0, a1, a2, a3, wf, wr = slope[0], slope[1], slope[2], slope[3], slope[6], slope[7]
    for a in range(4):
        slope[a] = (
            phi[a, 0] * a0 + phi[a, 1] * a1 + phi[a, 2] * a2 + phi[a, 3] * a3
            + gamma[a, 0] * wf + gamma[a, 1] * wr
        )  # fmt: skip


@njit(**OPTIONS)
def _write_results(state: State, noise_factor: Array, nis: float, count: int, row: Array) -> None:
    """Fill a row of results, the reference being at the estimate."""
    for q in range(3):
        variance = 0.0
        for i in range(q + 1):
            variance += state.D[i, q] * state.D[i, q]
        row[MEAN + q] = state.mu[q]
        row[SD + q] = math.sqrt(variance)
    for axle in range(2):
        variance = state.Pi[2 * axle, 2 * axle]
        for i in range(state.mu.shape[0]):
            variance += state.J[i, 2 * axle] * state.J[i, 2 * axle]
        row[DEFLECTION + axle] = state.x[2 * axle]
        row[DEFLECTION_SD + axle] = math.sqrt(variance)
        row[NOISE_FACTOR + axle] = noise_factor[axle]
    row[NIS] = nis
    row[READINGS] = count
    row[DRIFT] = state.statistics[DRIFT_DETECTED]
