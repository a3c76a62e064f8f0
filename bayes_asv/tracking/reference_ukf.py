"""Readable reference of the unscented filter: filterpy's filter on parameters and states jointly.

The state vector is (θ, x, b, w, v), parameters first, so that sigma points of the states leave the
parameters unchanged.  This implementation is slow and meant to be read; tests compare the compiled
one (:mod:`bayes_asv.filters.ukf`) with it to nine digits.
"""

from __future__ import annotations

import math

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter, unscented_transform
from numpy.typing import NDArray
from scipy.linalg import cholesky, expm

from bayes_asv.filters.kalman import AT_LEAST, MISSING, VALUE
from bayes_asv.filters.noise_adaptation import SNAPSHOT_INTERVAL
from bayes_asv.filters.tails import upper_tail
from bayes_asv.filters.ukf import DONE, SIGMA_DISTANCE
from bayes_asv.filters.ukf_state import (
    DEFLECTION,
    DEFLECTION_SD,
    DRIFT,
    DRIFT_DETECTED,
    FAST_FACTOR,
    FAULT_TIME,
    INFORMATION_GAIN,
    INNOVATION,
    LOG_LIKELIHOOD,
    MEAN,
    MOTION_MEAN,
    MOTION_VARIANCE,
    NIS,
    NOISE_FACTOR,
    PREDICTED,
    PREDICTED_SD,
    READINGS,
    REVIEW_TIME,
    SD,
    SNAPSHOT_TIME,
    FilterSettings,
    Model,
    State,
    Steps,
)
from bayes_asv.models.half_car import HalfCar, LinearSystem, deflection_form
from bayes_asv.tracking.reference_noise_adaptation import NoiseAdaptation

__all__ = ["run"]

Array = NDArray[np.float64]

_MAX_INTERACTION = 0.1  # as in filters.ukf
_MIN_EXCITATION, _EXCITATION_TIME = 25.0, 0.25  # as in filters.noise_adaptation


def run(
    first: int,
    fixed: bool,
    state: State,
    model: Model,
    settings: FilterSettings,
    steps: Steps,
    out: Array,
) -> tuple[int, int]:
    """Process steps; see :func:`bayes_asv.filters.ukf.run`.

    Raises
    ------
    ValueError
        For a fixed reference, which filterpy's filter does not have.
    """
    if fixed:
        raise ValueError("the reference filter has no fixed reference")
    ukf = _ReferenceFilter(state, model, settings)
    event = DONE
    k = first
    for k in range(first, len(steps.step)):
        ukf.step(steps, k, out[k])
        event = ukf.adaptation.event()
        if event != DONE:
            break
    ukf.store(state)
    return event, k + 1


class _ReferenceFilter:
    """filterpy's unscented filter with the model of the half car and its noise adaptation."""

    def __init__(self, state: State, model: Model, settings: FilterSettings) -> None:
        self.model, self.settings = model, settings
        self.statistics, self.snapshots = state.statistics, state.snapshots
        self.adaptation = NoiseAdaptation(state.statistics, state.autocovariance, settings)
        self.learn = True
        self.cache: dict[tuple[bytes, float], tuple[LinearSystem, Array, Array]] = {}
        p = self.p = len(state.mu)
        n = p + 10
        # n + λ = SIGMA_DISTANCE², and a weight of the centre that keeps all variances positive
        points = MerweScaledSigmaPoints(
            n, alpha=1.0, beta=1.0, kappa=SIGMA_DISTANCE**2 - n, sqrt_method=_upper_root
        )
        self.ukf = UnscentedKalmanFilter(
            dim_x=n, dim_z=2, dt=1.0, hx=self.measure, fx=self.propagate, points=points
        )
        L = np.zeros((n, n))
        L[:p, :p], L[p:, :p] = state.D.T, state.J.T
        self.ukf.x = np.concatenate([state.mu, state.x])
        self.ukf.P = L @ L.T
        self.ukf.P[p:, p:] += state.Pi

    def store(self, state: State) -> None:
        """Convert mean and covariance to the factored form of the compiled filter."""
        p = self.p
        L = _upper_root(self.ukf.P).T
        state.mu[:], state.x[:] = self.ukf.x[:p], self.ukf.x[p:]
        state.D[:], state.J[:] = L[:p, :p].T, L[p:, :p].T
        state.Pi[:] = L[p:, p:] @ L[p:, p:].T

    # Model

    def parameters(self, theta: Array) -> Array:
        """Parameter vector (12,) at coordinates."""
        value = self.model.centre + self.model.scale * theta
        parameters = self.model.base.copy()
        parameters[self.model.element] = [
            math.exp(v) if log else v for v, log in zip(value, self.model.log, strict=True)
        ]
        return parameters

    def matrices(self, theta: Array, h: float = 0.0) -> tuple[LinearSystem, Array, Array]:
        """System, gains of the sensors, and (Φ, Γ) over a step, at coordinates.

        Cached during a step: most sigma points have the same parameters.
        """
        key = (theta.tobytes(), h)
        if key not in self.cache:
            parameters = self.parameters(theta)
            system = deflection_form(HalfCar(*parameters[:8]))
            augmented = np.zeros((6, 6))
            augmented[:4, :4], augmented[:4, 4:] = system.A * h, -system.B * h
            self.cache[key] = (system, parameters[8:], expm(augmented)[:4])
        return self.cache[key]

    def propagate(self, s: Array, h: float, moments: Array) -> Array:
        """Propagate one sigma point over a step of length h."""
        p = self.p
        system, gains, transition = self.matrices(s[:p], h)
        x = transition[:, :4] @ s[p : p + 4] + transition[:, 4:] @ s[p + 6 : p + 8]
        drive = system.B / gains[[0, 2]]  # a wheel's reading is divided by its gain
        for j in range(moments.shape[1]):
            x = x + drive @ moments[:, j]
            drive = system.A @ drive
        decay = np.exp(-self.model.noise[8:12] * h)
        return np.concatenate([s[:p], x, s[p + 4 : p + 6], decay * s[p + 6 :]])

    def measure(self, s: Array) -> Array:
        """Both chassis readings at one sigma point."""
        p = self.p
        system, gains, _ = self.matrices(s[:p])
        x, b, v = s[p : p + 4], s[p + 4 : p + 6], s[p + 8 :]
        return np.asarray(gains[[1, 3]] * (system.C @ x) + b + v)

    def process_noise(self, h: float, spread: Array, noise_factor: Array) -> Array:
        """Covariance that a step adds to motion and filtered noise."""
        p, noise = self.p, self.model.noise
        A = self.matrices(self.ukf.x[:p])[0].A
        Q = np.zeros((p + 10, p + 10))
        for axle in range(2):
            intensity = noise_factor[axle] * (noise[axle] * spread[axle] + spread[2 + axle])
            for node in (-1.0, 1.0):  # two-point Gauss rule, as in the compiled filter
                response = expm(A * 0.5 * h * (1.0 + node / math.sqrt(3.0)))[:, 2 * axle + 1]
                Q[p : p + 4, p : p + 4] += 0.5 * h * intensity * np.outer(response, response)
        new = noise[4:8] * np.tile(noise_factor, 2) * (1.0 - np.exp(-2.0 * noise[8:12] * h))
        Q[p + 6 :, p + 6 :] = np.diag(new)
        return Q

    def interaction_variance(self) -> Array:
        """Variance (2, 2) of δ̈ due to uncertain parameters times uncertain state."""
        p = self.p
        L = _upper_root(self.ukf.P).T
        Pi = (L[p:, p:] @ L[p:, p:].T)[:4, :4]
        total = np.zeros((2, 2))
        for i in range(p):
            up, down = (
                self.matrices(self.ukf.x[:p] + side * L[:p, i])[0].C
                for side in (SIGMA_DISTANCE, -SIGMA_DISTANCE)
            )
            odd = (up - down) / (2.0 * SIGMA_DISTANCE)
            total += odd @ Pi @ odd.T
        return total

    # One step

    def step(self, steps: Steps, k: int, row: Array) -> None:
        """Predict over a step, condition on its readings, and fill a row of results."""
        ukf, p = self.ukf, self.p
        self.cache.clear()
        noise_factor = self.adaptation.factors()
        h = float(steps.step[k])
        parameter_noise = self.model.parameter_noise
        if self.statistics[DRIFT_DETECTED] > 0.0:
            parameter_noise = np.maximum(parameter_noise, self.model.drift_noise)
        if h > 0.0 and parameter_noise.any():
            before = self.log_determinant()
            ukf.P[range(p), range(p)] += parameter_noise * h
            self.statistics[INFORMATION_GAIN] += 0.5 * (before - self.log_determinant())
        if steps.restart[k]:
            self.reset_motion(noise_factor)
        elif h > 0.0:
            ukf.Q = self.process_noise(h, steps.spread[k], noise_factor)
            rates = [p + 1, p + 3]
            ukf.Q[np.ix_(rates, rates)] += h**2 * self.interaction_variance()
            ukf.predict(dt=h, moments=steps.moments[k])
        self.learn = self.is_excited(h)
        self.redraw()
        row[INNOVATION : INNOVATION + 2] = 0.0
        nis, count = self.condition(steps.kind[k], steps.reading[k], noise_factor, row)
        if count:
            self.adaptation.detect_drift()
        self.write_results(noise_factor, nis, count, row)
        self.advance_timers(h)

    def redraw(self) -> None:
        """Draw the sigma points of the present belief."""
        self.ukf.sigmas_f = self.ukf.points_fn.sigma_points(self.ukf.x, self.ukf.P)

    def predict_measurement(self, noise_factor: Array) -> tuple[Array, Array, Array, Array]:
        """Mean and covariance of both readings, their noise, and the interaction part of it."""
        h = np.array([self.measure(s) for s in self.ukf.sigmas_f])
        gain = self.matrices(self.ukf.x[: self.p])[1][[1, 3]]
        interaction = np.outer(gain, gain) * self.interaction_variance()
        R = np.diag(noise_factor * self.model.noise[2:4]) + interaction
        mean, S = unscented_transform(h, self.ukf.Wm, self.ukf.Wc, R)
        return mean, S, R, np.diag(interaction)

    def condition(
        self, kind: NDArray[np.int8], reading: Array, noise_factor: Array, row: Array
    ) -> tuple[float, int]:
        """Condition on the readings of an instant: two values jointly, a bound by itself."""
        mean, S, R, interaction = self.predict_measurement(noise_factor)
        row[PREDICTED : PREDICTED + 2] = mean
        row[PREDICTED_SD : PREDICTED_SD + 2] = np.sqrt(np.diag(S))
        present = [axle for axle in range(2) if kind[axle] != MISSING]
        joint = all(kind[a] == VALUE for a in present)
        groups = [present] if joint else [[a] for a in present]
        total_nis, count = 0.0, 0
        for group in groups:
            if group and group is not groups[0]:
                self.redraw()
                mean, S, R, interaction = self.predict_measurement(noise_factor)
            noise = R.copy()
            value = reading.copy()
            used: list[int] = []  # axles of this group so far
            for axle in group:
                predicted, variance = mean[axle], S[axle, axle]
                if used:  # condition the rear on the front reading
                    share = S[axle, used[0]] / S[used[0], used[0]]
                    predicted += share * (value[used[0]] - mean[used[0]])
                    variance -= share * S[axle, used[0]]
                if kind[axle] == VALUE:
                    nu = value[axle] - predicted
                    nis = nu**2 / variance
                    self.statistics[LOG_LIKELIHOOD] -= 0.5 * (
                        math.log(2.0 * math.pi * variance) + nis
                    )
                    row[INNOVATION + axle] = nu / math.sqrt(variance)
                    if interaction[axle] < _MAX_INTERACTION * variance:
                        self.adaptation.update_factor(axle, nis, noise_factor[axle])
                        self.adaptation.update_autocovariance(axle, nu / math.sqrt(variance))
                        total_nis, count = total_nis + nis, count + 1
                    extra = variance * max(nis / self.settings.gate - 1.0, 0.0)
                else:
                    sign = 1.0 if kind[axle] == AT_LEAST else -1.0
                    beyond = sign * (value[axle] - predicted)
                    if beyond > 0.0 and beyond**2 > self.settings.gate * variance:
                        gated = beyond**2 / self.settings.gate - variance
                        noise[axle, axle] += gated
                        S[axle, axle] += gated
                        variance += gated
                    root = math.sqrt(variance)
                    z = sign * (value[axle] - predicted) / root
                    log_tail, hazard = upper_tail(z)
                    self.statistics[LOG_LIKELIHOOD] += log_tail
                    shrink = hazard * (hazard - z)
                    if shrink < 1e-12:
                        continue
                    value[axle] = predicted + sign * hazard * root / shrink
                    extra = variance * (1.0 / shrink - 1.0)
                noise[axle, axle] += extra
                S[axle, axle] += extra
                used.append(axle)
            if used:
                self.update(value, noise, used)
        return total_nis, count

    def update(self, value: Array, R: Array, axles: list[int]) -> None:
        """Let filterpy condition on the readings of some axles."""
        before = self.log_determinant()
        mean, covariance = self.ukf.x[: self.p].copy(), self.ukf.P[: self.p, : self.p].copy()
        self.ukf.update(
            value[axles],
            R=R[np.ix_(axles, axles)],
            hx=lambda s: self.measure(s)[axles],
        )
        if self.learn:
            self.statistics[INFORMATION_GAIN] += 0.5 * (before - self.log_determinant())
        else:
            self.set_parameters(mean, covariance)

    def set_parameters(self, mean: Array, covariance: Array) -> None:
        """Replace the belief about the parameters; that about the state given them stays."""
        p, x, P = self.p, self.ukf.x, self.ukf.P
        slope = np.linalg.solve(P[:p, :p], P[:p, p:]).T
        residual = P[p:, p:] - slope @ P[:p, p:]
        x[p:] += slope @ (mean - x[:p])
        x[:p] = mean
        P[:p, :p] = covariance
        P[p:, :p] = slope @ covariance
        P[:p, p:] = P[p:, :p].T
        P[p:, p:] = residual + slope @ covariance @ slope.T

    def is_excited(self, h: float) -> bool:
        """Whether the car moves enough for its readings to carry information on the parameters."""
        p = self.p
        L = _upper_root(self.ukf.P).T
        system, gains, _ = self.matrices(self.ukf.x[:p])
        C = gains[[1, 3], None] * system.C
        value = C @ self.ukf.x[p : p + 4]
        variance = np.diag(C @ (L[p : p + 4, p:] @ L[p : p + 4, p:].T) @ C.T)
        share = min(h / _EXCITATION_TIME, 1.0)
        mean = self.statistics[MOTION_MEAN : MOTION_MEAN + 2]  # views
        spread = self.statistics[MOTION_VARIANCE : MOTION_VARIANCE + 2]
        difference = value - mean
        mean += share * difference
        spread += share * (difference**2 - spread)
        return bool(np.any(spread > _MIN_EXCITATION * variance))

    def log_determinant(self) -> float:
        """Log-determinant of the parameters' covariance."""
        return float(np.linalg.slogdet(self.ukf.P[: self.p, : self.p])[1])

    def reset_motion(self, noise_factor: Array) -> None:
        """Return motion and filtered noise to their priors."""
        p = self.p
        reset = [p + a for a in (0, 1, 2, 3, 6, 7, 8, 9)]
        self.ukf.x[reset] = 0.0
        self.ukf.P[reset, :] = self.ukf.P[:, reset] = 0.0
        filtered_noise = self.model.noise[4:8] * np.tile(noise_factor, 2)
        self.ukf.P[reset, reset] = np.concatenate([self.model.start[:4], filtered_noise])

    # Results and timers

    def write_results(self, noise_factor: Array, nis: float, count: int, row: Array) -> None:
        """Fill a row of results."""
        x, P, p = self.ukf.x, self.ukf.P, self.p
        row[MEAN : MEAN + 3] = x[:3]
        row[SD : SD + 3] = np.sqrt(np.diag(P)[:3])
        row[DEFLECTION : DEFLECTION + 2] = x[[p, p + 2]]
        row[DEFLECTION_SD : DEFLECTION_SD + 2] = np.sqrt(np.diag(P)[[p, p + 2]])
        row[NOISE_FACTOR : NOISE_FACTOR + 2] = noise_factor
        row[NIS], row[READINGS] = nis, count
        row[DRIFT] = self.statistics[DRIFT_DETECTED]

    def advance_timers(self, h: float) -> None:
        """Take a snapshot of the parameters if one is due, and advance the timers."""
        statistics, p = self.statistics, self.p
        statistics[SNAPSHOT_TIME] += h
        fast_factor = float(np.max(statistics[FAST_FACTOR : FAST_FACTOR + 2]))
        due = statistics[SNAPSHOT_TIME] >= SNAPSHOT_INTERVAL
        if due and fast_factor <= self.settings.fast_threshold:
            statistics[SNAPSHOT_TIME] = 0.0
            self.snapshots[0] = self.snapshots[1]
            self.snapshots[1, :, 0] = self.ukf.x[:p]
            self.snapshots[1, :, 1:] = _upper_root(self.ukf.P[:p, :p])
        statistics[REVIEW_TIME] += h
        faulty = fast_factor > self.settings.fault_threshold
        statistics[FAULT_TIME] = statistics[FAULT_TIME] + h if faulty else 0.0


def _upper_root(P: Array) -> Array:
    """U with Uᵀ U = P; rows of zeros where a variance is zero."""
    positive = np.diag(P) > 0.0
    if positive.all():
        return np.asarray(cholesky(P))
    root = np.zeros_like(P)
    root[np.ix_(positive, positive)] = cholesky(P[np.ix_(positive, positive)])
    return root
