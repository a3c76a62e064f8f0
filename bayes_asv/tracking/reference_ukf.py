"""The filter as a textbook has it: filterpy's unscented filter on parameters and states together.

The state vector is (θ, x, b, w, v), parameters first, so that sigma points of the states leave the
parameters where they are.  It is slow and made to be read; the compiled engine
(:mod:`bayes_asv.filters.ukf`) is held against it to nine digits.
"""

from __future__ import annotations

import math

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter, unscented_transform
from numpy.typing import NDArray
from scipy.linalg import cholesky, expm

from bayes_asv.filters.kalman import AT_LEAST, MISSING, VALUE
from bayes_asv.filters.noise_adaptation import COPY
from bayes_asv.filters.tails import upper_tail
from bayes_asv.filters.ukf import DONE, REACH
from bayes_asv.filters.ukf_state import (
    BROKEN,
    CLOCK,
    COPIED,
    DEFLECTION,
    DEFLECTION_SD,
    DEVIATION,
    DOUBT,
    DOUBTED,
    EXPECTED,
    EXPECTED_SD,
    INNOVATION,
    LEVEL,
    LOG_P,
    LOST,
    MEAN,
    MOTION,
    NIS,
    QUICK,
    READINGS,
    SHAKEN,
    Model,
    Rules,
    State,
    Steps,
)
from bayes_asv.models.half_car import HalfCar, LinearSystem, deflection_form
from bayes_asv.tracking.reference_noise_adaptation import Doubts

__all__ = ["run"]

Array = NDArray[np.float64]

_SURE = 0.1


def run(
    first: int, fixed: bool, state: State, model: Model, rules: Rules, steps: Steps, out: Array
) -> tuple[int, int]:
    """Take up steps; see :func:`bayes_asv.filters.ukf.run`.

    Raises
    ------
    ValueError
        For a fixed reference, which a plain filter does not have.
    """
    if fixed:
        raise ValueError("a plain filter moves with its estimate")
    ukf = _Plain(state, model, rules)
    event = DONE
    k = first
    for k in range(first, len(steps.step)):
        ukf.step(steps, k, out[k])
        event = ukf.doubts.event()
        if event != DONE:
            break
    ukf.give_back(state)
    return event, k + 1


class _Plain:
    """filterpy's filter with what the half car needs around it."""

    def __init__(self, state: State, model: Model, rules: Rules) -> None:
        self.model, self.rules = model, rules
        self.memory, self.safe = state.memory, state.safe
        self.doubts = Doubts(state.memory, state.echo, rules)
        self.learns = True
        self.kept: dict[tuple[bytes, float], tuple[LinearSystem, Array, Array]] = {}
        p = self.p = len(state.mu)
        n = p + 10
        # n + λ = REACH², and the weight of the middle point such that no variance is negative
        points = MerweScaledSigmaPoints(
            n, alpha=1.0, beta=1.0, kappa=REACH**2 - n, sqrt_method=_upper_root
        )
        self.ukf = UnscentedKalmanFilter(
            dim_x=n, dim_z=2, dt=1.0, hx=self.readings, fx=self.moved, points=points
        )
        L = np.zeros((n, n))
        L[:p, :p], L[p:, :p] = state.D.T, state.J.T
        self.ukf.x = np.concatenate([state.mu, state.x])
        self.ukf.P = L @ L.T
        self.ukf.P[p:, p:] += state.Pi

    def give_back(self, state: State) -> None:
        """Put what is known into the other engine's form."""
        p = self.p
        L = _upper_root(self.ukf.P).T
        state.mu[:], state.x[:] = self.ukf.x[:p], self.ukf.x[p:]
        state.D[:], state.J[:] = L[:p, :p].T, L[p:, :p].T
        state.Pi[:] = L[p:, p:] @ L[p:, p:].T

    # The model

    def car(self, theta: Array) -> Array:
        """Car and gains (12,) at coordinates."""
        value = self.model.centre + self.model.scale * theta
        car = self.model.base.copy()
        car[self.model.which] = [
            math.exp(v) if log else v for v, log in zip(value, self.model.log, strict=True)
        ]
        return car

    def matrices(self, theta: Array, h: float = 0.0) -> tuple[LinearSystem, Array, Array]:
        """System, gains of the sensors, and (Φ, Γ) over a step, at coordinates.

        Kept for as long as the step lasts: most sigma points stand at the same parameters.
        """
        key = (theta.tobytes(), h)
        if key not in self.kept:
            car = self.car(theta)
            system = deflection_form(HalfCar(*car[:8]))
            augmented = np.zeros((6, 6))
            augmented[:4, :4], augmented[:4, 4:] = system.A * h, -system.B * h
            self.kept[key] = (system, car[8:], expm(augmented)[:4])
        return self.kept[key]

    def moved(self, s: Array, h: float, moments: Array) -> Array:
        """One sigma point after a step of length h."""
        p = self.p
        system, gains, flow = self.matrices(s[:p], h)
        x = flow[:, :4] @ s[p : p + 4] + flow[:, 4:] @ s[p + 6 : p + 8]
        drive = system.B / gains[[0, 2]]  # what a wheel read is divided by its gain
        for j in range(moments.shape[1]):
            x = x + drive @ moments[:, j]
            drive = system.A @ drive
        decay = np.exp(-self.model.noise[8:12] * h)
        return np.concatenate([s[:p], x, s[p + 4 : p + 6], decay * s[p + 6 :]])

    def readings(self, s: Array) -> Array:
        """Both chassis readings at one sigma point."""
        p = self.p
        system, gains, _ = self.matrices(s[:p])
        x, b, v = s[p : p + 4], s[p + 4 : p + 6], s[p + 8 :]
        return np.asarray(gains[[1, 3]] * (system.C @ x) + b + v)

    def process_noise(self, h: float, spread: Array, level: Array) -> Array:
        """Covariance that a step adds: noise of the wheels, fresh slow noise."""
        p, noise = self.p, self.model.noise
        A = self.matrices(self.ukf.x[:p])[0].A
        Q = np.zeros((p + 10, p + 10))
        for axle in range(2):
            intensity = level[axle] * (noise[axle] * spread[axle] + spread[2 + axle])
            for node in (-1.0, 1.0):  # two-point Gauss rule, as in the kernels
                kick = expm(A * 0.5 * h * (1.0 + node / math.sqrt(3.0)))[:, 2 * axle + 1]
                Q[p : p + 4, p : p + 4] += 0.5 * h * intensity * np.outer(kick, kick)
        fresh = noise[4:8] * np.tile(level, 2) * (1.0 - np.exp(-2.0 * noise[8:12] * h))
        Q[p + 6 :, p + 6 :] = np.diag(fresh)
        return Q

    def crossed(self) -> Array:
        """Variance (2, 2) of δ̈ that needs both parameters and state to be off."""
        p = self.p
        L = _upper_root(self.ukf.P).T
        Pi = (L[p:, p:] @ L[p:, p:].T)[:4, :4]
        total = np.zeros((2, 2))
        for i in range(p):
            up, down = (
                self.matrices(self.ukf.x[:p] + side * L[:p, i])[0].C for side in (REACH, -REACH)
            )
            odd = (up - down) / (2.0 * REACH)
            total += odd @ Pi @ odd.T
        return total

    # One step

    def step(self, steps: Steps, k: int, row: Array) -> None:
        """Predict over a step, take up its readings, and tell."""
        ukf, p = self.ukf, self.p
        self.kept.clear()
        level = self.doubts.levels()
        h = float(steps.step[k])
        walk = self.model.walk
        if self.memory[DOUBTED] > 0.0:
            walk = np.maximum(walk, self.model.doubt)
        if h > 0.0 and walk.any():
            before = self.determinant()
            ukf.P[range(p), range(p)] += walk * h
            self.memory[LOST] += 0.5 * (before - self.determinant())
        if steps.afresh[k]:
            self.forget_motion(level)
        elif h > 0.0:
            ukf.Q = self.process_noise(h, steps.spread[k], level)
            rates = [p + 1, p + 3]
            ukf.Q[np.ix_(rates, rates)] += h**2 * self.crossed()
            ukf.predict(dt=h, moments=steps.moments[k])
        self.learns = self.shaken(h)
        self.redraw()
        row[INNOVATION : INNOVATION + 2] = 0.0
        nis, count = self.take_up(steps.kind[k], steps.reading[k], level, row)
        if count:
            self.doubts.doubt()
        self.tell(level, nis, count, row)
        self.keep(h)

    def redraw(self) -> None:
        """Draw the sigma points anew, from the estimate as it is."""
        self.ukf.sigmas_f = self.ukf.points_fn.sigma_points(self.ukf.x, self.ukf.P)

    def expected(self, level: Array) -> tuple[Array, Array, Array, Array]:
        """Mean and covariance of both readings, the noise in it, and its unsure part."""
        h = np.array([self.readings(s) for s in self.ukf.sigmas_f])
        gain = self.matrices(self.ukf.x[: self.p])[1][[1, 3]]
        unsure = np.outer(gain, gain) * self.crossed()
        R = np.diag(level * self.model.noise[2:4]) + unsure
        mean, S = unscented_transform(h, self.ukf.Wm, self.ukf.Wc, R)
        return mean, S, R, np.diag(unsure)

    def take_up(
        self, kind: NDArray[np.int8], reading: Array, level: Array, row: Array
    ) -> tuple[float, int]:
        """Take up the readings of an instant; two values together, a bound by itself."""
        mean, S, R, unsure = self.expected(level)
        row[EXPECTED : EXPECTED + 2] = mean
        row[EXPECTED_SD : EXPECTED_SD + 2] = np.sqrt(np.diag(S))
        there = [axle for axle in range(2) if kind[axle] != MISSING]
        groups = [there] if all(kind[a] == VALUE for a in there) else [[a] for a in there]
        nis, count = 0.0, 0
        for group in groups:
            if group and group is not groups[0]:
                self.redraw()
                mean, S, R, unsure = self.expected(level)
            given = R.copy()
            value = reading.copy()
            seen: list[int] = []  # readings of the group before
            for axle in group:
                expected, variance = mean[axle], S[axle, axle]
                if seen:  # what the front said of the rear
                    share = S[axle, seen[0]] / S[seen[0], seen[0]]
                    expected += share * (value[seen[0]] - mean[seen[0]])
                    variance -= share * S[axle, seen[0]]
                if kind[axle] == VALUE:
                    nu = value[axle] - expected
                    ratio = nu**2 / variance
                    self.memory[LOG_P] -= 0.5 * (math.log(2.0 * math.pi * variance) + ratio)
                    row[INNOVATION + axle] = nu / math.sqrt(variance)
                    if unsure[axle] < _SURE * variance:
                        self.doubts.learn_level(axle, ratio, level[axle])
                        self.doubts.listen(axle, nu / math.sqrt(variance))
                        nis, count = nis + ratio, count + 1
                    more = variance * max(ratio / self.rules.gate - 1.0, 0.0)
                else:
                    sign = 1.0 if kind[axle] == AT_LEAST else -1.0
                    off = sign * (value[axle] - expected)
                    if off > 0.0 and off**2 > self.rules.gate * variance:
                        wider = off**2 / self.rules.gate - variance
                        given[axle, axle] += wider
                        S[axle, axle] += wider
                        variance += wider
                    root = math.sqrt(variance)
                    z = sign * (value[axle] - expected) / root
                    log_tail, hazard = upper_tail(z)
                    self.memory[LOG_P] += log_tail
                    shrink = hazard * (hazard - z)
                    if shrink < 1e-12:
                        continue
                    value[axle] = expected + sign * hazard * root / shrink
                    more = variance * (1.0 / shrink - 1.0)
                given[axle, axle] += more
                S[axle, axle] += more
                seen.append(axle)
            if seen:
                self.update(value, given, seen)
        return nis, count

    def update(self, value: Array, R: Array, axles: list[int]) -> None:
        """Let filterpy take up readings of some axles."""
        before = self.determinant()
        mean, covariance = self.ukf.x[: self.p].copy(), self.ukf.P[: self.p, : self.p].copy()
        self.ukf.update(
            value[axles],
            R=R[np.ix_(axles, axles)],
            hx=lambda s: self.readings(s)[axles],
        )
        if self.learns:
            self.memory[LOST] += 0.5 * (before - self.determinant())
        else:
            self.believe(mean, covariance)

    def believe(self, mean: Array, covariance: Array) -> None:
        """Put another belief of the parameters in place; the state given them stays."""
        p, x, P = self.p, self.ukf.x, self.ukf.P
        slope = np.linalg.solve(P[:p, :p], P[:p, p:]).T
        given = P[p:, p:] - slope @ P[:p, p:]
        x[p:] += slope @ (mean - x[:p])
        x[:p] = mean
        P[:p, :p] = covariance
        P[p:, :p] = slope @ covariance
        P[:p, p:] = P[p:, :p].T
        P[p:, p:] = given + slope @ covariance @ slope.T

    def shaken(self, h: float) -> bool:
        """Whether the car moves enough for its readings to speak of the parameters."""
        p, memory = self.p, self.memory
        L = _upper_root(self.ukf.P).T
        system, gains, _ = self.matrices(self.ukf.x[:p])
        C = gains[[1, 3], None] * system.C
        value = C @ self.ukf.x[p : p + 4]
        variance = np.diag(C @ (L[p : p + 4, p:] @ L[p : p + 4, p:].T) @ C.T)
        share = min(h / 0.25, 1.0)
        away = value - memory[MOTION : MOTION + 2]
        memory[MOTION : MOTION + 2] += share * away
        memory[SHAKEN : SHAKEN + 2] += share * (away**2 - memory[SHAKEN : SHAKEN + 2])
        return bool(np.any(memory[SHAKEN : SHAKEN + 2] > 25.0 * variance))

    def determinant(self) -> float:
        """Logarithm of the determinant of the parameters' covariance."""
        return float(np.linalg.slogdet(self.ukf.P[: self.p, : self.p])[1])

    def forget_motion(self, level: Array) -> None:
        """Motion and slow noise are as if nothing had been measured."""
        p = self.p
        gone = [p + a for a in (0, 1, 2, 3, 6, 7, 8, 9)]
        self.ukf.x[gone] = 0.0
        self.ukf.P[gone, :] = self.ukf.P[:, gone] = 0.0
        slow = self.model.noise[4:8] * np.tile(level, 2)
        self.ukf.P[gone, gone] = np.concatenate([self.model.start[:4], slow])

    # What is told, and kept

    def tell(self, level: Array, nis: float, count: int, row: Array) -> None:
        """Fill the row."""
        x, P, p = self.ukf.x, self.ukf.P, self.p
        row[MEAN : MEAN + 3] = x[:3]
        row[DEVIATION : DEVIATION + 3] = np.sqrt(np.diag(P)[:3])
        row[DEFLECTION : DEFLECTION + 2] = x[[p, p + 2]]
        row[DEFLECTION_SD : DEFLECTION_SD + 2] = np.sqrt(np.diag(P)[[p, p + 2]])
        row[LEVEL : LEVEL + 2] = level
        row[NIS], row[READINGS] = nis, count
        row[DOUBT] = self.memory[DOUBTED]

    def keep(self, h: float) -> None:
        """Keep the parameters of a time when all was well, and let the clocks run."""
        memory = self.memory
        memory[COPIED] += h
        worst = float(np.max(memory[QUICK : QUICK + 2]))
        if memory[COPIED] >= COPY and worst <= self.rules.sudden:
            memory[COPIED] = 0.0
            self.safe[0] = self.safe[1]
            p = self.p
            self.safe[1, :, 0] = self.ukf.x[:p]
            self.safe[1, :, 1:] = _upper_root(self.ukf.P[:p, :p])
        memory[CLOCK] += h
        memory[BROKEN] = memory[BROKEN] + h if worst > self.rules.broken else 0.0


def _upper_root(P: Array) -> Array:
    """U with Uᵀ U = P; rows of zeros where a variance is zero."""
    own = np.diag(P) > 0.0
    if own.all():
        return np.asarray(cholesky(P))
    root = np.zeros_like(P)
    root[np.ix_(own, own)] = cholesky(P[np.ix_(own, own)])
    return root
