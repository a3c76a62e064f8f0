"""Readable reference of the unscented filter: filterpy's filter on parameters and states jointly.

The state vector is (θ, x, b, d, w, v), parameters first, so that sigma points of the states leave
the parameters unchanged.  This implementation is slow and meant to be read; tests compare the
compiled one (:mod:`bayes_asv.filters.ukf`) with it to nine digits.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter, unscented_transform
from numpy.typing import NDArray
from scipy.linalg import cholesky, expm

from bayes_asv.filters.kalman import AT_LEAST, MISSING, VALUE
from bayes_asv.filters.noise_adaptation import SNAPSHOT_INTERVAL
from bayes_asv.filters.prediction import upper_tail
from bayes_asv.filters.ukf import DONE, SIGMA_DISTANCE
from bayes_asv.filters.ukf_state import ALL, NOTHING, FilterSettings, State, Steps
from bayes_asv.models.car_model import state_space
from bayes_asv.tracking.filter_model import FilterModel
from bayes_asv.tracking.reference_noise_adaptation import NoiseAdaptation

__all__ = ["run"]

Array = NDArray[np.float64]

_MAX_INTERACTION = 0.1  # as in filters.ukf
_MIN_EXCITATION, _EXCITATION_TIME = 25.0, 0.25  # as in filters.noise_adaptation


class _System(NamedTuple):
    """A car and its sensors at one set of parameters.

    Parameters
    ----------
    A : (nx, nx) array
        System matrix.
    drive : (nx, ne) array
        Input matrix for readings of the inputs: includes the gains of their sensors.
    bare : (nx, ne) array
        Input matrix for accelerations of the wheels.
    C : (ny, nx) array
        Output matrix, without the gains of sensors.
    gain : (ny,) array
        Gains of the outputs' sensors.
    phi, gamma : (nx, nx) and (nx, ne) arrays
        Transition over a step.
    """

    A: Array
    drive: Array
    bare: Array
    C: Array
    gain: Array
    phi: Array
    gamma: Array


def run(
    first: int,
    fixed: bool,
    state: State,
    model: FilterModel,
    settings: FilterSettings,
    steps: Steps,
    out: Array,
) -> tuple[int, int]:
    """Process steps; see :func:`bayes_asv.filters.ukf.run`.

    Raises
    ------
    ValueError
        For a fixed reference, which filterpy does not support.
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
    """filterpy's unscented filter with the model of a car and its noise adaptation."""

    def __init__(self, state: State, model: FilterModel, settings: FilterSettings) -> None:
        self.model, self.settings, self.sizes = model, settings, model.sizes
        self.noise = model.arrays.noise  # of the present step, see `split_noise`
        self.statistics, self.snapshots = state.statistics, state.snapshots
        self.adaptation = NoiseAdaptation(
            model.at, self.sizes.outputs, state.statistics, state.autocovariance, settings
        )
        self.learn = self.tested = True
        self.h = 0.0  # length of the present step, s
        self.cache: dict[tuple[bytes, float], _System] = {}
        p = self.p = len(state.mu)
        n = p + self.sizes.states
        # n + λ = SIGMA_DISTANCE², and a weight of the centre that keeps all variances positive
        points = MerweScaledSigmaPoints(
            n, alpha=1.0, beta=1.0, kappa=SIGMA_DISTANCE**2 - n, sqrt_method=_upper_root
        )
        self.ukf = UnscentedKalmanFilter(
            dim_x=n, dim_z=self.sizes.outputs, dt=1.0, hx=self.measure, fx=self.propagate,
            points=points,
        )  # fmt: skip
        L = np.zeros((n, n))
        L[:p, :p], L[p:, :p] = state.D.T, state.J.T
        self.ukf.x = np.concatenate([state.mu, state.x])
        self.ukf.P = L @ L.T
        self.ukf.P[p:, p:] += state.Pi
        # parts of the state vector
        nx, ny = self.sizes.motion, self.sizes.outputs
        ends = np.cumsum([p, nx, ny, self.sizes.directions, self.sizes.elements, ny])
        self.motion, self.bias, self.input_bias, self.input_noise, self.output_noise = (
            slice(first, last) for first, last in pairwise(ends)
        )
        # states that are rates of change which parameters and states drive together
        ne = self.sizes.elements
        self.rates = [2 * e + 1 for e in range(ne)] + list(range(2 * ne, nx))

    def store(self, state: State) -> None:
        """Convert mean and covariance to the factored form of the compiled filter."""
        p = self.p
        L = _upper_root(self.ukf.P).T
        state.mu[:], state.x[:] = self.ukf.x[:p], self.ukf.x[p:]
        state.D[:], state.J[:] = L[:p, :p].T, L[p:, :p].T
        state.Pi[:] = L[p:, p:] @ L[p:, p:].T

    # Model

    def matrices(self, theta: Array, h: float = 0.0) -> _System:
        """Car and sensors at coordinates, and the transition over a step.

        Cached during a step: most sigma points have the same parameters.
        """
        key = (theta.tobytes(), h)
        if key not in self.cache:
            space = self.model.coordinates
            vector = space.parameter_vectors(theta[None])
            values = {name: vector[:, k] for k, name in enumerate(space.car.names)}
            system = state_space(space.car, values, self.model.outputs)
            A, bare, C = system.A[0], system.B[0], system.C[0]
            nx, ne = bare.shape
            augmented = np.zeros((nx + ne, nx + ne))
            augmented[:nx, :nx], augmented[:nx, nx:] = A * h, -bare * h
            transition = expm(augmented)[:nx]
            P = len(space.car.names)
            drive = bare / vector[0, [P + c for c in self.model.inputs]]
            gain = vector[0, [P + c for c in self.model.output_channels]]
            self.cache[key] = _System(
                A, drive, bare, C, gain, transition[:, :nx], transition[:, nx:]
            )
        return self.cache[key]

    def propagate(self, s: Array, h: float, moments: Array) -> Array:
        """Propagate one sigma point over a step of length h."""
        system = self.matrices(s[: self.p], h)
        forcing = s[self.input_noise] + self.model.arrays.input_bias @ s[self.input_bias]
        x = system.phi @ s[self.motion] + system.gamma @ forcing
        drive = system.drive
        for j in range(moments.shape[1]):
            x = x + drive @ moments[:, j]
            drive = system.A @ drive
        count = self.sizes.elements + self.sizes.outputs
        decay = np.exp(-self.noise[2 * count :] * h)
        after = s.copy()
        after[self.motion] = x
        after[self.input_noise.start :] *= decay
        return after

    def measure(self, s: Array) -> Array:
        """Compute the readings of all outputs at one sigma point."""
        system = self.matrices(s[: self.p])
        read = system.gain * (system.C @ s[self.motion])
        return np.asarray(read + s[self.bias] + s[self.output_noise])

    def split_noise(self) -> None:
        """Split the noise of sensors with a filter into a white and a filtered part."""
        count = self.sizes.elements + self.sizes.outputs
        share = self.statistics[self.model.at.white_share]
        self.noise = self.model.arrays.noise.copy()
        self.noise[:count] += share * self.noise[count : 2 * count]
        self.noise[count : 2 * count] *= 1.0 - share

    def input_factors(self, noise_factor: Array) -> Array:
        """Noise factors of the inputs."""
        return np.asarray(self.model.arrays.share @ noise_factor)

    def process_noise(self, h: float, spread: Array, noise_factor: Array) -> Array:
        """Process noise of a step: covariance added to motion and filtered noise."""
        ne, count = self.sizes.elements, self.sizes.elements + self.sizes.outputs
        noise, factor = self.noise, self.input_factors(noise_factor)
        A = self.matrices(self.ukf.x[: self.p]).A
        Q = np.zeros_like(self.ukf.P)
        for e in range(ne):
            intensity = factor[e] * (noise[e] * spread[e] + spread[ne + e])
            for node in (-1.0, 1.0):  # two-point Gauss rule, as in the compiled filter
                response = expm(A * 0.5 * h * (1.0 + node / math.sqrt(3.0)))[:, 2 * e + 1]
                Q[self.motion, self.motion] += 0.5 * h * intensity * np.outer(response, response)
        factors = np.concatenate([factor, noise_factor])
        new = noise[count : 2 * count] * factors * (1.0 - np.exp(-2.0 * noise[2 * count :] * h))
        Q[self.input_noise.start :, self.input_noise.start :] = np.diag(new)
        return np.asarray(Q)

    def interactions(self) -> tuple[Array, Array]:
        """Variances due to products of uncertain parameters and uncertain state.

        For the rates of change that are states, and for the outputs without their gains.
        """
        p = self.p
        L = _upper_root(self.ukf.P).T
        Pi = (L[p:, p:] @ L[p:, p:].T)[: self.sizes.motion, : self.sizes.motion]
        rates = np.zeros((len(self.rates), len(self.rates)))
        outputs = np.zeros((self.sizes.outputs, self.sizes.outputs))
        for i in range(p):
            up, down = (
                self.matrices(self.ukf.x[:p] + side * L[:p, i])
                for side in (SIGMA_DISTANCE, -SIGMA_DISTANCE)
            )
            odd = (up.A - down.A)[self.rates] / (2.0 * SIGMA_DISTANCE)
            rates += odd @ Pi @ odd.T
            odd = (up.C - down.C) / (2.0 * SIGMA_DISTANCE)
            outputs += odd @ Pi @ odd.T
        return rates, outputs

    # One step

    def step(self, steps: Steps, k: int, row: Array) -> None:
        """Predict over a step, condition on its readings, and fill a row of results."""
        ukf, p = self.ukf, self.p
        self.cache.clear()
        self.split_noise()
        noise_factor = self.adaptation.factors()
        h = float(steps.step[k])
        at, into, arrays = self.model.at, self.model.into, self.model.arrays
        parameter_noise = arrays.parameter_noise
        if self.statistics[at.drift_detected] > 0.0:
            parameter_noise = np.maximum(parameter_noise, arrays.drift_noise)
        if h > 0.0 and parameter_noise.any():
            before = self.log_determinant()
            ukf.P[range(p), range(p)] += parameter_noise * h
            self.statistics[self.model.at.information_gain] += 0.5 * (
                before - self.log_determinant()
            )
        if steps.restart[k]:
            self.reset_motion(noise_factor)
        elif h > 0.0:
            ukf.Q = self.process_noise(h, steps.spread[k], noise_factor)
            rates = [p + a for a in self.rates]
            ukf.Q[np.ix_(rates, rates)] += h**2 * self.interactions()[0]
            ukf.predict(dt=h, moments=steps.moments[k])
        self.learn = self.is_excited(h)
        self.redraw()
        row[into.innovation : into.innovation + self.sizes.outputs] = 0.0
        self.tested, self.h = bool(steps.use[k] == ALL), h
        kind = steps.kind[k] if steps.use[k] != NOTHING else np.full_like(steps.kind[k], MISSING)
        nis, count = self.condition(kind, steps.reading[k], noise_factor, row)
        if count:
            self.adaptation.detect_drift()
        self.write_results(noise_factor, nis, count, row)
        self.advance_timers(h)

    def redraw(self) -> None:
        """Draw the sigma points of the current distribution."""
        self.ukf.sigmas_f = self.ukf.points_fn.sigma_points(self.ukf.x, self.ukf.P)

    def predict_measurement(self, noise_factor: Array) -> tuple[Array, Array, Array, Array]:
        """Mean and covariance of the readings, their noise, and its interaction part."""
        h = np.array([self.measure(s) for s in self.ukf.sigmas_f])
        gain = self.matrices(self.ukf.x[: self.p]).gain
        interaction = np.outer(gain, gain) * self.interactions()[1]
        ne, ny = self.sizes.elements, self.sizes.outputs
        R = np.diag(noise_factor * self.noise[ne : ne + ny]) + interaction
        mean, S = unscented_transform(h, self.ukf.Wm, self.ukf.Wc, R)
        return mean, S, R, np.diag(interaction)

    def condition(
        self, kind: NDArray[np.int8], reading: Array, noise_factor: Array, row: Array
    ) -> tuple[float, int]:
        """Condition on the readings of an instant: values jointly, bounds one by one."""
        at, into, ny = self.model.at, self.model.into, self.sizes.outputs
        mean, S, R, interaction = self.predict_measurement(noise_factor)
        row[into.predicted : into.predicted + ny] = mean
        row[into.predicted_sd : into.predicted_sd + ny] = np.sqrt(np.diag(S))
        present = [y for y in range(ny) if kind[y] != MISSING]
        joint = all(kind[y] == VALUE for y in present)
        groups = [present] if joint else [[y] for y in present]
        total_nis, count = 0.0, 0
        for group in groups:
            if group and group is not groups[0]:
                self.redraw()
                mean, S, R, interaction = self.predict_measurement(noise_factor)
            noise = R.copy()
            value = reading.copy()
            expected, covariance = mean.copy(), S.copy()  # given the readings of the group so far
            used: list[int] = []
            for y in group:
                predicted, variance = expected[y], covariance[y, y]
                if kind[y] == VALUE:
                    nu = value[y] - predicted
                    nis = nu**2 / variance
                    self.statistics[at.log_likelihood] -= 0.5 * (
                        math.log(2.0 * math.pi * variance) + nis
                    )
                    row[into.innovation + y] = nu / math.sqrt(variance)
                    if self.tested and interaction[y] < _MAX_INTERACTION * variance:
                        ne, count_ = self.sizes.elements, len(self.noise) // 3
                        filtered = self.model.arrays.noise[count_ + ne + y]
                        self.adaptation.update_white_share(
                            y,
                            nu / math.sqrt(variance),
                            math.exp(-self.noise[2 * count_ + ne + y] * self.h),
                            noise_factor[y] * filtered / variance,
                        )
                        self.adaptation.update_factor(y, nis, noise_factor[y])
                        self.adaptation.update_autocovariance(y, nu / math.sqrt(variance))
                        total_nis, count = total_nis + nis, count + 1
                    extra = variance * max(nis / self.settings.gate - 1.0, 0.0)
                else:
                    sign = 1.0 if kind[y] == AT_LEAST else -1.0
                    excess = sign * (value[y] - predicted)
                    if excess > 0.0 and excess**2 > self.settings.gate * variance:
                        gated = excess**2 / self.settings.gate - variance
                        noise[y, y] += gated
                        variance += gated
                    root = math.sqrt(variance)
                    z = sign * (value[y] - predicted) / root
                    log_tail, hazard = upper_tail(z)
                    self.statistics[at.log_likelihood] += log_tail
                    shrink = hazard * (hazard - z)
                    if shrink < 1e-12:
                        continue
                    value[y] = predicted + sign * hazard * root / shrink
                    extra = variance * (1.0 / shrink - 1.0)
                noise[y, y] += extra
                gain = covariance[:, y] / (variance + extra)
                expected = expected + gain * (value[y] - predicted)
                covariance = covariance - np.outer(gain, covariance[y])
                used.append(y)
            if used:
                self.update(value, noise, used)
        return total_nis, count

    def update(self, value: Array, R: Array, outputs: list[int]) -> None:
        """Let filterpy condition on the readings of some outputs."""
        before = self.log_determinant()
        mean, covariance = self.ukf.x[: self.p].copy(), self.ukf.P[: self.p, : self.p].copy()
        self.ukf.update(
            value[outputs],
            R=R[np.ix_(outputs, outputs)],
            hx=lambda s: self.measure(s)[outputs],
        )
        if self.learn:
            self.statistics[self.model.at.information_gain] += 0.5 * (
                before - self.log_determinant()
            )
        else:
            self.set_parameters(mean, covariance)

    def set_parameters(self, mean: Array, covariance: Array) -> None:
        """Replace the distribution of the parameters; that of the state given them is unchanged."""
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
        """Whether the car moves enough for its readings to be informative about the parameters."""
        p, at, ny = self.p, self.model.at, self.sizes.outputs
        L = _upper_root(self.ukf.P).T
        system = self.matrices(self.ukf.x[:p])
        C = system.gain[:, None] * system.C
        value = C @ self.ukf.x[self.motion]
        variance = np.diag(C @ (L[self.motion, p:] @ L[self.motion, p:].T) @ C.T)
        share = min(h / _EXCITATION_TIME, 1.0)
        mean = self.statistics[at.motion_mean : at.motion_mean + ny]  # views
        spread = self.statistics[at.motion_variance : at.motion_variance + ny]
        difference = value - mean
        mean += share * difference
        spread += share * (difference**2 - spread)
        return bool(np.any(spread > _MIN_EXCITATION * variance))

    def log_determinant(self) -> float:
        """Log-determinant of the parameters' covariance."""
        return float(np.linalg.slogdet(self.ukf.P[: self.p, : self.p])[1])

    def reset_motion(self, noise_factor: Array) -> None:
        """Return motion and filtered noise to their priors."""
        count = self.sizes.elements + self.sizes.outputs
        first = self.input_noise.start
        reset = [*range(self.motion.start, self.motion.stop), *range(first, len(self.ukf.x))]
        self.ukf.x[reset] = 0.0
        self.ukf.P[reset, :] = self.ukf.P[:, reset] = 0.0
        factors = np.concatenate([self.input_factors(noise_factor), noise_factor])
        filtered = self.noise[count : 2 * count] * factors
        start = np.diag(self.model.arrays.start)[: self.sizes.motion]
        self.ukf.P[reset, reset] = np.concatenate([start, filtered])

    # Results and timers

    def write_results(self, noise_factor: Array, nis: float, count: int, row: Array) -> None:
        """Fill a row of results."""
        x, P, into, sizes = self.ukf.x, self.ukf.P, self.model.into, self.sizes
        na, ne, ny = sizes.estimands, sizes.elements, sizes.outputs
        row[into.mean : into.mean + na] = x[:na]
        row[into.sd : into.sd + na] = np.sqrt(np.diag(P)[:na])
        deflections = [self.p + 2 * e for e in range(ne)]
        row[into.deflection : into.deflection + ne] = x[deflections]
        row[into.deflection_sd : into.deflection_sd + ne] = np.sqrt(np.diag(P)[deflections])
        row[into.noise_factor : into.noise_factor + ny] = noise_factor
        row[into.nis], row[into.readings] = nis, count
        row[into.drift] = self.statistics[self.model.at.drift_detected]

    def advance_timers(self, h: float) -> None:
        """Take a snapshot of the parameters if one is due, and advance the timers."""
        statistics, p, at = self.statistics, self.p, self.model.at
        statistics[at.snapshot_time] += h
        fast = statistics[at.fast_factor : at.fast_factor + self.sizes.outputs]
        fast_factor = float(np.max(fast))
        due = statistics[at.snapshot_time] >= SNAPSHOT_INTERVAL
        if due and fast_factor <= self.settings.fast_threshold:
            statistics[at.snapshot_time] = 0.0
            self.snapshots[0] = self.snapshots[1]
            self.snapshots[1, :, 0] = self.ukf.x[:p]
            self.snapshots[1, :, 1:] = _upper_root(self.ukf.P[:p, :p])
        statistics[at.review_time] += h
        faulty = fast_factor > self.settings.fault_threshold
        statistics[at.fault_time] = statistics[at.fault_time] + h if faulty else 0.0


def _upper_root(P: Array) -> Array:
    """U with Uᵀ U = P; rows of zeros where a variance is zero."""
    positive = np.diag(P) > 0.0
    if positive.all():
        return np.asarray(cholesky(P))
    root = np.zeros_like(P)
    root[np.ix_(positive, positive)] = cholesky(P[np.ix_(positive, positive)])
    return root
