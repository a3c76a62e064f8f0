"""Conversion of rows, as they arrive, into time steps and readings for the filter.

It does what :mod:`bayes_asv.preprocessing.prepare` does with a whole recording: true sampling times
of every channel, equal bandwidths, splines through the wheels' samples, readings of the outputs in
order of time.  A row is held back until all wheels' splines are final around its readings
(:data:`bayes_asv.tracking.streaming_spline.LOOKAHEAD`).  The size of chunks has no effect.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Timing
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.kalman import AT_LEAST, AT_MOST, MISSING, ORDER, VALUE
from bayes_asv.filters.ukf_state import ALL, NOTHING, STATES, Steps
from bayes_asv.models.car_model import CarModel, fastest_rate, state_space
from bayes_asv.models.modes import nominal_modes
from bayes_asv.preprocessing.data_checks import min_sampling_rate
from bayes_asv.preprocessing.prepare import LONGEST_PHASE, LONGEST_STEP, SAME_INSTANT
from bayes_asv.preprocessing.quantization import (
    STILL_STEPS,
    STILL_WINDOW,
    slow_steps,
    still_variance,
)
from bayes_asv.tracking.sensor_noise import SensorModel
from bayes_asv.tracking.streaming_spline import StreamingSpline

__all__ = ["Rows", "StreamingTimeline", "TimelineChunk", "max_gap", "max_step"]

Array = NDArray[np.float64]

# Longest gap between two samples of a wheel that a spline spans: the longer one of a number of rows
# and a time, s.
_GAP_ROWS = 6.0
_GAP_SECONDS = 0.02


class Rows(NamedTuple):
    """Rows whose readings have all been scheduled.

    Parameters
    ----------
    stamp : (R,) array
        Stamps, s.
    step : (R, ny) int array
        Index of the step that ends at the reading of each output, counted from the first step of
        the timeline; −1 without a reading.
    measured : (R, ny) array
        Those readings, SI units; NaN if missing or clipped, or if the motion of a wheel is unknown.
    """

    stamp: Array
    step: NDArray[np.int64]
    measured: Array


class TimelineChunk(NamedTuple):
    """The next steps, and the rows that they complete."""

    steps: Steps
    rows: Rows


@dataclass
class _BandwidthMatcher:
    """Filters a sensor's readings down to a slower pole, recursively.

    As ``preprocessing.wheel_spline.match_bandwidths``: (1 + s/ω) / (1 + s/ω₀) on a piecewise linear
    signal; it restarts after a gap.
    """

    bandwidth: float
    target: float
    max_gap: float
    time: float = -math.inf
    signal: float = 0.0
    filtered: float = 0.0

    def apply(self, time: Array, value: Array) -> Array:
        pole = 2.0 * math.pi * self.target
        share = self.target / self.bandwidth
        out = value.copy()
        for k in np.flatnonzero(np.isfinite(value)):
            t, u = float(time[k]), float(value[k])
            h = t - self.time
            if h > self.max_gap:
                self.filtered = u
            else:
                lag = (u - self.signal) / h / pole
                self.filtered = u - lag + (self.filtered - self.signal + lag) * math.exp(-pole * h)
            self.time, self.signal = t, u
            out[k] = share * u + (1.0 - share) * self.filtered
        return out


def max_step(car: CarModel) -> float:
    """Longest step (s) over which the moments describe the wheels accurately for a car."""
    fastest = fastest_rate(state_space(car, car.nominal, ()))
    return min(LONGEST_STEP, LONGEST_PHASE / fastest)


def max_gap(rate: float) -> float:
    """Time between two samples of a wheel (s) beyond which its motion is unknown."""
    return max(_GAP_ROWS / rate, _GAP_SECONDS) * (1.0 + 1e-6)


class _Stillness:
    """Detects rows at which channels with coarse converters hardly move.

    The quantisation error of a channel at rest is not white noise: it is constant
    (:mod:`bayes_asv.preprocessing.quantization`).

    Parameters
    ----------
    sensors : SensorModel
        Sensors with the noise of every channel.
    declared : (C,) bool array
        Whether the noise is declared.  Otherwise it is estimated from the readings, also at
        standstill, and includes this error.
    rate : float
        Rows per second, Hz.
    """

    def __init__(self, sensors: SensorModel, declared: NDArray[np.bool_], rate: float) -> None:
        figures = zip(sensors.resolution, sensors.noise, sensors.poles, strict=True)
        variance = [
            still_variance(float(step), float(noise), float(pole), 1.0 / rate)
            for step, noise, pole in figures
        ]
        self.variance = np.where(declared, variance, 0.0)
        self._window = max(round(STILL_WINDOW * rate), 3)
        coarse = self.variance > 0.0
        self._still = np.where(coarse, STILL_STEPS * sensors.resolution, 0.0)
        self._slow = np.where(coarse, slow_steps(self._window) * sensors.resolution, 0.0)
        self._before = np.full((len(coarse), self._window - 1), np.nan)

    def update(self, value: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Whether each channel is at rest, and whether it moves slowly, at rows (C, n)."""
        if not self.variance.any():
            none = np.zeros(value.shape, bool)
            return none, none
        value = np.concatenate([self._before, value], axis=1)
        self._before = value[:, value.shape[1] - self._window + 1 :].copy()
        known = np.isfinite(value)
        shift = (self._window - 1) // 2  # the window ends with the row
        high, low = (
            extreme(np.where(known, value, side), self._window, axis=1, origin=shift)
            for extreme, side in ((maximum_filter1d, -np.inf), (minimum_filter1d, np.inf))
        )
        span = (high - low)[:, self._window - 1 :]
        return span < self._still[:, None], span < self._slow[:, None]


class StreamingTimeline:
    """Schedules rows as they arrive.

    Parameters
    ----------
    vehicle : Vehicle
        Gives delays.
    sensors : SensorModel
        Sensors with the noise of every channel; its car limits the step.
    rate : float
        Rows per second, Hz.
    timing : Timing, optional
        Delays and clocks of the recording; they take precedence over the vehicle's.
    """

    def __init__(
        self, vehicle: Vehicle, sensors: SensorModel, rate: float, timing: Timing | None = None
    ) -> None:
        self._sensors = sensors
        # at a rate that is refused as too low, rows are gaps; otherwise, time stamps in a wrong
        # unit would need thousands of steps per row
        gap = max_gap(max(rate, min_sampling_rate(nominal_modes(sensors.car))))
        self._max_step = max_step(sensors.car)
        self._max_gap = gap
        count = len(sensors.channels)
        self._inputs, self._outputs = list(sensors.inputs), list(sensors.outputs)
        delays = (None,) * count if timing is None else timing.delay
        declared = vehicle.sensors_of([channel.name for channel in sensors.channels])
        self._delay = np.array(
            [s.delay if d is None else d for s, d in zip(declared, delays, strict=True)]
        )
        self._clock = np.zeros(count) if timing is None else np.array(timing.clock)
        self._matchers = [
            _BandwidthMatcher(b, sensors.bandwidth, gap)
            if b is not None and sensors.bandwidth is not None and b > sensors.bandwidth * 1.000001
            else None
            for b in sensors.bandwidths
        ]
        self._wheels = [
            StreamingSpline(sensors.interpolation_noise(c, rate), gap) for c in self._inputs
        ]
        given = np.array([s.noise is not None for s in declared])
        self._stillness = _Stillness(sensors, given, rate)
        self._origin: float | None = None
        self._last_stamp = -math.inf
        self._end: float | None = None  # end of the last step
        self._step_count = 0
        # pending rows: stamp; times, readings, kinds and steps of the outputs
        ny = len(self._outputs)
        self._stamp = np.empty(0)
        self._time = np.empty((0, ny))
        self._reading = np.empty((0, ny))
        self._kind = np.empty((0, ny), np.int8)
        self._step = np.empty((0, ny), np.int64)
        self._scheduled = np.empty((0, ny), bool)
        # whether each input is at rest, and the use of the readings
        self._still = np.empty((0, len(self._inputs)), bool)
        self._use = np.empty(0, np.int8)

    def push(self, times: Array, acc: Array) -> TimelineChunk:
        """Add rows; return the steps and rows that became ready.

        Parameters
        ----------
        times : (n,) array
            Stamps, s, increasing.
        acc : (n, C) array
            Readings of the channels, SI units; NaN where missing.

        Raises
        ------
        InputError
            If a stamp is not after the one before, or if shapes do not match.
        """
        times = np.asarray(times, np.float64)
        acc = np.asarray(acc, np.float64)
        self._check(times, acc)
        if len(times):
            self._add(times, acc)
        return self._ready()

    def finish(self) -> TimelineChunk:
        """Schedule all pending rows: no row will follow."""
        for wheel in self._wheels:
            wheel.finish()
        return self._ready(everything=True)

    def complete(self) -> None:
        """Fill in columns of pending rows that a checkpoint of an earlier version lacks."""
        missing = len(self._stamp) - len(self._use)
        if missing:
            self._still = np.zeros((missing, len(self._inputs)), bool)
            self._use = np.full(missing, ALL, np.int8)

    def _check(self, times: Array, acc: Array) -> None:
        count = len(self._sensors.channels)
        if times.ndim != 1 or acc.shape != (len(times), count):
            raise InputError(
                "rows", f"times {times.shape} and readings {acc.shape} do not match",
                f"give times (n,) and readings (n, {count})",
            )  # fmt: skip
        steps = np.diff(times, prepend=self._last_stamp)
        valid = np.isfinite(times) & (steps > 0.0)
        if not np.all(valid):
            bad = int(np.argmin(valid))
            raise InputError(
                "rows", f"stamp {times[bad]:g} s is not after the one before",
                "sort the rows, or begin another recording with resume()",
            )  # fmt: skip

    def _add(self, times: Array, acc: Array) -> None:
        """Compute true times, find clipped readings, and pass the samples on."""
        if self._origin is None:
            self._origin = float(times[0])
        self._last_stamp = float(times[-1])
        true = np.empty((len(self._delay), len(times)))
        for c in range(len(true)):
            elapsed = (
                times
                if self._clock[c] == 0.0
                else self._origin + (times - self._origin) / (1.0 + self._clock[c])
            )
            true[c] = elapsed + self._delay[c]
        value = acc.T.copy()
        value[~np.isfinite(value)] = np.nan
        low = value <= self._sensors.low[:, None]
        high = value >= self._sensors.high[:, None]
        # a clipped reading means that the true value is beyond the rail, whatever it reads
        margin = 0.5 * self._sensors.resolution
        rails = self._sensors.low - margin, self._sensors.high + margin
        value = np.clip(value, rails[0][:, None], rails[1][:, None])
        for c, matcher in enumerate(self._matchers):
            if matcher is not None:
                value[c] = matcher.apply(true[c], value[c])
        for wheel, c in zip(self._wheels, self._inputs, strict=True):
            wheel.push(true[c], value[c], low[c], high[c])
        kind = np.where(high, AT_LEAST, np.where(low, AT_MOST, VALUE)).astype(np.int8)
        kind[~np.isfinite(value)] = MISSING
        still, slow = self._stillness.update(value)
        outputs, ny = self._outputs, len(self._outputs)
        n = len(times)
        self._stamp = np.concatenate([self._stamp, times])
        self._time = np.concatenate([self._time, true[outputs].T])
        self._reading = np.concatenate([self._reading, np.nan_to_num(value[outputs].T)])
        self._kind = np.concatenate([self._kind, kind[outputs].T])
        self._step = np.concatenate([self._step, np.full((n, ny), -1)])
        self._scheduled = np.concatenate([self._scheduled, np.zeros((n, ny), bool)])
        self._still = np.concatenate([self._still, still[self._inputs].T])
        use = np.where(slow[self._inputs].all(axis=0), STATES, ALL)
        # at rest, a coarse converter reads a constant that is wrong by up to a step, and whose
        # uncertainty would be underestimated more and more
        use[still.all(axis=0)] = NOTHING
        self._use = np.concatenate([self._use, use.astype(np.int8)])

    def _ready(self, everything: bool = False) -> TimelineChunk:
        """Schedule the readings before the horizon, and return the rows that are complete."""
        if not len(self._stamp):
            return TimelineChunk(self._no_steps(), Rows(self._stamp, self._step, self._reading))
        # after the newest reading of one output, an earlier one of another output may still arrive
        horizon = min(*(w.horizon for w in self._wheels), *self._time[-1].tolist())
        if everything:
            horizon = math.inf
        due = ~self._scheduled & (self._time <= horizon + SAME_INSTANT)
        row, output = np.nonzero(due)
        time = self._time[row, output]
        self._scheduled |= due
        covered = np.logical_and.reduce([wheel.covers(time) for wheel in self._wheels])
        self._kind[row[~covered], output[~covered]] = MISSING
        steps = self._no_steps()
        if covered.any():
            steps = self._schedule(row[covered], output[covered], time[covered])
        # a reduction over the transpose: that over rows of two columns is slow
        done = np.logical_and.reduce(np.ascontiguousarray(self._scheduled.T))
        complete = int(np.argmin(np.append(done, False)))
        measured = np.where(self._kind[:complete] == VALUE, self._reading[:complete], np.nan)
        rows = Rows(self._stamp[:complete], self._step[:complete], measured)
        for name in (
            "_stamp", "_time", "_reading", "_kind", "_step", "_scheduled", "_still", "_use",
        ):  # fmt: skip
            setattr(self, name, getattr(self, name)[complete:])
        if self._end is not None:
            for wheel in self._wheels:
                wheel.discard(self._end)
        return TimelineChunk(steps, rows)

    def _schedule(self, row: NDArray[np.int64], output: NDArray[np.int64], time: Array) -> Steps:
        """Make steps that end at readings; divide steps that would be too long."""
        order = np.argsort(time, kind="stable")
        row, output, time = row[order], output[order], time[order]
        start = float(time[0]) if self._end is None else self._end
        new = np.append(True, np.diff(time) > SAME_INSTANT)
        instant = np.cumsum(new) - 1
        distinct = time[new]
        h = np.diff(distinct, prepend=start)
        parts = np.where(
            h > self._max_gap, 1.0, np.maximum(np.ceil(h / self._max_step - 1e-9), 1.0)
        )
        end = np.cumsum(parts.astype(int)) - 1
        total = int(end[-1]) + 1
        instants = np.interp(np.arange(total), np.append(-1, end), np.append(start, distinct))
        instants[end] = distinct
        step = np.diff(instants, prepend=start)
        ne, ny = len(self._wheels), len(self._outputs)
        moments = np.empty((total, ne, ORDER))
        spread = np.empty((total, 2 * ne))
        ends = np.empty((total, 2, ne))
        covered = step <= self._max_gap
        for e, wheel in enumerate(self._wheels):
            moments[:, e], wheel_spread, wheel_covered, ends[:, :, e] = wheel.integrate(
                instants, start
            )
            spread[:, e], spread[:, ne + e] = wheel_spread[:, 0], wheel_spread[:, 1]
            covered &= wheel_covered
        # the row at whose reading a step, or the last part of it, ends
        row_of_step = row[new][np.searchsorted(end, np.arange(total))]
        use = self._use[row_of_step]
        standstill_noise = self._stillness.variance[self._inputs] * self._still[row_of_step]
        spread[:, ne:] += standstill_noise * spread[:, :ne]
        kind = np.full((total, ny), MISSING, np.int8)
        reading = np.zeros((total, ny))
        at = end[instant]
        kind[at, output] = self._kind[row, output]
        reading[at, output] = self._reading[row, output]
        self._step[row, output] = self._step_count + at
        self._step_count += total
        self._end = float(instants[-1])
        restart = ~covered & (step > 0.0)
        return Steps(step, moments, spread, kind, reading, restart, ends, use)

    def _no_steps(self) -> Steps:
        ne, ny = len(self._wheels), len(self._outputs)
        return Steps(
            np.empty(0), np.empty((0, ne, ORDER)), np.empty((0, 2 * ne)),
            np.empty((0, ny), np.int8), np.empty((0, ny)), np.empty(0, bool), np.empty((0, 2, ne)),
            np.empty(0, np.int8),
        )  # fmt: skip
