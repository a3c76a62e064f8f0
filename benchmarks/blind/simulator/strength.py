"""How much of a fault a linear half car cannot explain.

A linear half car is fitted to noise-free readings: damping rates and pitch inertia free, given
values with priors of their declared standard deviations, a start and two offsets in each run. The
readings of the wheels are its input, those of the chassis its output. What remains is weighed by
the covariance of the noise of all four sensors, that of the wheels as it comes through the car.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .cars import Car
from .declared import Declared
from .kinds import CHANNELS, Complexes, Vector
from .sensors import Sensor
from .signals import LinearSystem, interpolated, one_pole, spline

__all__ = ["Fit", "Yardstick", "half_car", "mobility"]

FINE = 2400.0
"""Least rate at which the car is computed, Hz."""

WHEELS, BODIES = (CHANNELS[0], CHANNELS[2]), (CHANNELS[1], CHANNELS[3])


def mobility(p: Vector, length: float) -> Vector:
    """Accelerations (2) of the chassis above the axles for forces (2) on it there, in SI."""
    i, m, wdf = (float(x) for x in p[2:5])
    a, b = (1.0 - wdf) * length, wdf * length
    return np.array(
        [[1.0 / m + a * a / i, 1.0 / m - a * b / i], [1.0 / m - a * b / i, 1.0 / m + b * b / i]]
    )


def half_car(p: Vector, length: float) -> LinearSystem:
    """Linear half car from wheel to chassis accelerations.

    ``p`` is (c_f, c_r, i, m, front weight fraction, k_f, k_r) in SI. States are the deflections
    and their rates.
    """
    gives = mobility(p, length)
    out = np.hstack([-gives * p[5:7], -gives * p[0:2]])
    matrix = np.vstack([np.hstack([np.zeros((2, 2)), np.eye(2)]), out])
    into = np.vstack([np.zeros((2, 2)), -np.eye(2)])
    return LinearSystem(matrix, into, out, np.zeros((2, 2)))


def _colour(sensor: Sensor, frequency: Vector, rate: float) -> Vector:
    """Spectrum of a sensor's noise and steps, (m/s²)² per sample, at frequencies in Hz."""
    shape = np.ones_like(frequency)
    if sensor.corner is not None:
        keep = float(np.exp(-2.0 * np.pi * sensor.corner / rate))
        shape = (1.0 - keep**2) / np.abs(1.0 - keep * np.exp(-2j * np.pi * frequency / rate)) ** 2
    return np.asarray(sensor.noise**2 * shape + sensor.step**2 / 12.0)


def _lag(sensor: Sensor, frequency: Vector) -> Complexes:
    """Transfer of a sensor's filter at frequencies in Hz."""
    if sensor.corner is None:
        return np.ones(len(frequency), complex)
    return 1.0 / (1.0 + 1j * frequency / sensor.corner)


class _Run:
    """One run: its whitening, and the columns that a start and offsets fill."""

    def __init__(
        self, times: Vector, sensors: Mapping[str, Sensor], p: Vector, length: float
    ) -> None:
        self.times, self.sensors, self.length = times, sensors, length
        self.rate = 1.0 / float(times[1] - times[0])
        self.fold = max(1, int(np.ceil(FINE / self.rate)))
        self.fine = float(times[0]) + np.arange(len(times) * self.fold + 1) / (
            self.rate * self.fold
        )
        frequency = np.fft.rfftfreq(len(times), 1.0 / self.rate)
        car = half_car(p, length)
        through = car.transfer(frequency)
        into = np.stack([_lag(sensors[c], frequency) for c in WHEELS], 1)
        out = np.stack([_lag(sensors[c], frequency) for c in BODIES], 1)
        through = through * out[:, :, None] / into[:, None, :]
        wheel = np.stack([_colour(sensors[c], frequency, self.rate) for c in WHEELS], 1)
        body = np.stack([_colour(sensors[c], frequency, self.rate) for c in BODIES], 1)
        cover = np.einsum("foi,fi,fpi->fop", through, wheel, through.conj())
        cover[:, 0, 0] += body[:, 0]
        cover[:, 1, 1] += body[:, 1]
        self.white: Complexes = np.asarray(np.linalg.inv(np.linalg.cholesky(cover)))
        free = car.free(times - times[0])
        columns = [free[:, :, state] for state in range(4)]
        for body_number in range(2):
            flat = np.zeros((len(times), 2))
            flat[:, body_number] = 1.0
            columns.append(flat)
        nuisance = np.stack([self.whitened(c) for c in columns], 1)
        self.basis, _ = np.linalg.qr(nuisance)

    def whitened(self, residual: Vector) -> Vector:
        """Independent numbers of unit variance from residuals (N, 2) of the chassis."""
        turned = np.fft.rfft(residual, axis=0) / np.sqrt(len(residual))
        white = np.einsum("fop,fp->fo", self.white, turned)
        weight = np.full(len(white), np.sqrt(2.0))
        weight[0] = 1.0
        if len(residual) % 2 == 0:
            weight[-1] = 1.0
        white = white * weight[:, None]
        return np.concatenate([white.real.ravel(), white.imag.ravel()])

    def inputs(self, rows: Vector) -> Vector:
        """Wheel accelerations on the fine grid from the readings of the wheels."""
        found = []
        for channel in WHEELS:
            sensor = self.sensors[channel]
            curve = spline(self.times + sensor.delay, rows[:, CHANNELS.index(channel)])
            value = curve(self.fine)
            if sensor.corner is not None:
                value = value + curve(self.fine, 1) / (2.0 * np.pi * sensor.corner)
            found.append(value)
        return np.stack(found, 1)

    def misfit(self, p: Vector, inputs: Vector, rows: Vector) -> Vector:
        """Whitened residuals without what start and offsets explain."""
        step = float(self.fine[1] - self.fine[0])
        out = half_car(p, self.length).response(inputs, step)
        residual = np.empty((len(self.times), 2))
        for number, channel in enumerate(BODIES):
            sensor = self.sensors[channel]
            signal = out[:, number]
            if sensor.poles:
                signal = np.real(one_pole(signal, step, sensor.poles[0]))
            at = self.times + sensor.delay
            model = interpolated(signal, float(self.fine[0]), step, at)
            residual[:, number] = rows[:, CHANNELS.index(channel)] - model
        white = self.whitened(residual)
        return np.asarray(white - self.basis @ (self.basis.T @ white))


@dataclass(frozen=True)
class Fit:
    """The nearest linear half car: logarithms ``q`` of its parameters over the true ones.

    ``misfit`` and ``prior`` are what remains of readings and given values, whitened, ``slope``
    and ``prior_slope`` their derivatives, ``cost`` the squared distance.
    """

    q: Vector
    misfit: Vector
    prior: Vector
    slope: Vector
    prior_slope: Vector
    cost: float


class Yardstick:
    """Distance of readings from the nearest linear half car."""

    def __init__(
        self, car: Car, declared: Declared, times: Sequence[Vector], base: Sequence[Vector]
    ) -> None:
        """Prepare for a car and its readings (N, 4) without a fault, of each run.

        ``floor`` is their squared distance from the true car, ``base`` that from the nearest one
        with the priors' part.
        """
        self.truth = np.array([*car.c, car.i, car.m, car.wdf, *car.k])
        self.declared = declared
        self.runs = [_Run(t, declared.sensors, self.truth, car.wheelbase) for t in times]
        inputs = [run.inputs(rows) for run, rows in zip(self.runs, base, strict=True)]
        rest = self._misfit(np.zeros(7), inputs, base)
        self.floor = float(rest @ rest)
        self.slope = self._slope(np.zeros(7), inputs, base)
        self.base = self.distance(base)

    def _misfit(self, q: Vector, inputs: Sequence[Vector], rows: Sequence[Vector]) -> Vector:
        p = self.truth * np.exp(q)
        return np.concatenate(
            [r.misfit(p, u, y) for r, u, y in zip(self.runs, inputs, rows, strict=True)]
        )

    def _slope(self, q: Vector, inputs: Sequence[Vector], rows: Sequence[Vector]) -> Vector:
        columns, small = [], 1e-3
        for number in range(7):
            shift = np.zeros(7)
            shift[number] = small
            up = self._misfit(q + shift, inputs, rows)
            columns.append((up - self._misfit(q - shift, inputs, rows)) / (2.0 * small))
        return np.stack(columns, 1)

    def _prior(self, q: Vector, declared: Declared) -> tuple[Vector, Vector]:
        given = np.array([declared.m, declared.wdf, *declared.k])
        ratio = self.truth[3:] * np.exp(q[3:]) / given
        sds = np.array(declared.sds)
        slope = np.zeros((4, 7))
        slope[:, 3:] = np.diag(ratio / sds)
        return (ratio - 1.0) / sds, slope

    def _cost(
        self, q: Vector, inputs: Sequence[Vector], rows: Sequence[Vector], declared: Declared
    ) -> tuple[Vector, Vector, Vector, float]:
        misfit = self._misfit(q, inputs, rows)
        prior, prior_slope = self._prior(q, declared)
        return misfit, prior, prior_slope, float(misfit @ misfit + prior @ prior)

    def fit(self, rows: Sequence[Vector], declared: Declared | None = None) -> Fit:
        """Return the nearest linear half car."""
        declared = declared or self.declared
        inputs = [run.inputs(y) for run, y in zip(self.runs, rows, strict=True)]
        q, slope, fresh, brake = np.zeros(7), self.slope, False, 0.0
        misfit, prior, prior_slope, cost = self._cost(q, inputs, rows, declared)
        for _ in range(25):
            normal = slope.T @ slope + prior_slope.T @ prior_slope
            push = slope.T @ misfit + prior_slope.T @ prior
            normal = normal + brake * np.diag(np.diag(normal))
            trial = q + np.clip(-np.linalg.solve(normal, push), -0.5, 0.5)
            new = self._cost(trial, inputs, rows, declared)
            gained = cost - new[3]
            enough = 0.003 * cost + 0.02
            if gained > 0.0:
                q, (misfit, prior, prior_slope, cost) = trial, new
                brake *= 0.1
            if gained > enough:
                fresh = False
                continue
            settled = fresh or float(np.max(np.abs(q))) < 0.04
            if gained >= 0.0 and settled:
                break
            if not fresh:
                slope, fresh = self._slope(q, inputs, rows), True
            elif gained < 0.0:
                brake = max(10.0 * brake, 1e-3)
                if brake > 1e4:
                    break
        return Fit(q, misfit, prior, slope, prior_slope, cost)

    def distance(self, rows: Sequence[Vector], declared: Declared | None = None) -> float:
        """Squared distance that remains after the fit, with the priors' part."""
        return self.fit(rows, declared).cost

    def strength(self, rows: Sequence[Vector], declared: Declared | None = None) -> float:
        """Squared distance beyond that of the same car without a fault."""
        return self.distance(rows, declared) - self.base
