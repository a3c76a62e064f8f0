"""Rows as they come in, laid out as steps and readings for the filter.

What :mod:`bayes_asv.preprocessing.timeline` does with a whole recording: true times of every
channel, bandwidths made equal, curves through the wheels, chassis readings in order.  A row is
held back until both wheels are known around its readings
(:data:`bayes_asv.tracking.streaming_spline.AHEAD`).  How rows were cut into chunks makes no
difference."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Timing
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.kalman import AT_LEAST, AT_MOST, MISSING, ORDER, VALUE
from bayes_asv.filters.ukf_state import Steps
from bayes_asv.models.half_car import HalfCar, deflection_form
from bayes_asv.tracking.sensor_noise import Sensing
from bayes_asv.tracking.streaming_spline import WheelCurve

__all__ = ["Laid", "Layout", "longest_gap", "longest_step"]

Array = NDArray[np.float64]

_CHASSIS = (1, 3)
_SAME_INSTANT = 1e-8  # s
# The moments of the wheels lose (λh)⁸/8! a step; see inference.timeline.
_LONGEST_STEP = 0.005  # s
_LONGEST_PHASE = 0.25
_GAP_ROWS = 6.0  # rows that may be missing, or
_GAP_SECONDS = 0.02  # s, whichever is longer: beyond it nobody knows what a wheel did


class Rows(NamedTuple):
    """Rows whose readings have all been laid out.

    Parameters
    ----------
    stamp : (R,) array
        As they came, s.
    step : (R, 2) int array
        Number of the step that ends at the front and at the rear chassis reading, counted from
        the first ever; −1 where there was none.
    measured : (R, 2) array
        Those readings, m/s²; NaN where there is none, where it is at a rail, or where a wheel
        is not known.
    """

    stamp: Array
    step: NDArray[np.int64]
    measured: Array


class Laid(NamedTuple):
    """Steps that follow on those before, and the rows that they complete."""

    steps: Steps
    rows: Rows


@dataclass
class _Equaliser:
    """Passes a sensor's readings on to a slower pole (``inference.wheels.equalised``), row by row.

    Straight lines between readings; begins anew behind a gap.
    """

    bandwidth: float
    target: float
    gap: float
    time: float = -math.inf
    signal: float = 0.0
    slow: float = 0.0

    def __call__(self, time: Array, value: Array) -> Array:
        pole = 2.0 * math.pi * self.target
        share = self.target / self.bandwidth
        out = value.copy()
        for k in np.flatnonzero(np.isfinite(value)):
            t, u = float(time[k]), float(value[k])
            h = t - self.time
            if h > self.gap:
                self.slow = u
            else:
                lag = (u - self.signal) / h / pole
                self.slow = u - lag + (self.slow - self.signal + lag) * math.exp(-pole * h)
            self.time, self.signal = t, u
            out[k] = share * u + (1.0 - share) * self.slow
        return out


def longest_step(vehicle: Vehicle) -> float:
    """Length of step (s) over which the moments describe the wheels well enough for this car."""
    car = HalfCar(*(getattr(vehicle, name).value for name in HalfCar._fields))
    fastest = float(np.max(np.abs(np.linalg.eigvals(deflection_form(car).A))))
    return min(_LONGEST_STEP, _LONGEST_PHASE / fastest)


def longest_gap(rate: float) -> float:
    """Time between two samples of a wheel (s) beyond which its motion is taken for unknown."""
    return max(_GAP_ROWS / rate, _GAP_SECONDS) * (1.0 + 1e-6)


class Layout:
    """Lays rows out as they come in.

    Parameters
    ----------
    vehicle : Vehicle
        Gives delays, and limits the step.
    sensing : Sensing
        Its noise is known on every channel.
    rate : float
        Rows a second, Hz.
    timing : Timing, optional
        Delays and clocks that the recording gives; they come before the vehicle's.
    """

    def __init__(
        self, vehicle: Vehicle, sensing: Sensing, rate: float, timing: Timing | None = None
    ) -> None:
        self._sensing = sensing
        gap = longest_gap(rate)
        self._longest = longest_step(vehicle)
        self._gap = gap
        own = (None,) * 4 if timing is None else timing.delay
        self._delay = np.array(
            [s.delay if d is None else d for s, d in zip(vehicle.sensors, own, strict=True)]
        )
        self._clock = np.zeros(4) if timing is None else np.array(timing.clock)
        self._equalisers = [
            _Equaliser(b, sensing.bandwidth, gap)
            if b is not None and sensing.bandwidth is not None and b > sensing.bandwidth * 1.000001
            else None
            for b in sensing.bandwidths
        ]
        self._wheels = [WheelCurve(sensing.missed_by_noise(c, rate), gap) for c in (0, 2)]
        self._origin: float | None = None
        self._last_stamp = -math.inf
        self._now: float | None = None  # end of the last step
        self._count = 0  # steps laid out so far
        # rows that wait: stamp, times of both chassis readings, readings, kinds, steps
        self._stamp = np.empty(0)
        self._when = np.empty((0, 2))
        self._reading = np.empty((0, 2))
        self._kind = np.empty((0, 2), np.int8)
        self._step = np.empty((0, 2), np.int64)
        self._done = np.empty((0, 2), bool)

    def push(self, times: Array, acc: Array) -> Laid:
        """Take rows; return what became ready.

        Parameters
        ----------
        times : (n,) array
            Stamps, s, increasing.
        acc : (n, 4) array
            Accelerations, m/s²; NaN where missing.

        Raises
        ------
        InputError
            When a stamp is not after the one before, or shapes do not match.
        """
        times = np.asarray(times, np.float64)
        acc = np.asarray(acc, np.float64)
        self._check(times, acc)
        if len(times):
            self._take(times, acc)
        return self._ready()

    def finish(self) -> Laid:
        """No row will follow: lay out what was held back."""
        for wheel in self._wheels:
            wheel.finish()
        return self._ready(everything=True)

    def _check(self, times: Array, acc: Array) -> None:
        if times.ndim != 1 or acc.shape != (len(times), 4):
            raise InputError(
                "rows", f"times {times.shape} and readings {acc.shape} do not match",
                "give times (n,) and readings (n, 4)",
            )  # fmt: skip
        steps = np.diff(times, prepend=self._last_stamp)
        if not (np.all(np.isfinite(times)) and np.all(steps > 0.0)):
            bad = int(np.argmin(np.isfinite(times) & (steps > 0.0)))
            raise InputError(
                "rows", f"stamp {times[bad]:g} s is not after the one before",
                "begin another recording with resume(), or sort the rows",
            )  # fmt: skip

    def _take(self, times: Array, acc: Array) -> None:
        """Put rows on the channels' own clocks and hand them on."""
        if self._origin is None:
            self._origin = float(times[0])
        self._last_stamp = float(times[-1])
        true = np.empty((4, len(times)))
        for c in range(4):
            elapsed = (
                times
                if self._clock[c] == 0.0
                else self._origin + (times - self._origin) / (1.0 + self._clock[c])
            )
            true[c] = elapsed + self._delay[c]
        value = acc.T.copy()
        value[~np.isfinite(value)] = np.nan
        low = value <= self._sensing.low[:, None]
        high = value >= self._sensing.high[:, None]
        # a sensor at its rail says that the truth is beyond the rail, whatever number it sends
        slack = 0.5 * self._sensing.steps
        rails = self._sensing.low - slack, self._sensing.high + slack
        value = np.clip(value, rails[0][:, None], rails[1][:, None])
        for c, equaliser in enumerate(self._equalisers):
            if equaliser is not None:
                value[c] = equaliser(true[c], value[c])
        for wheel, c in zip(self._wheels, (0, 2), strict=True):
            wheel.push(true[c], value[c], low[c], high[c])
        kind = np.where(high, AT_LEAST, np.where(low, AT_MOST, VALUE)).astype(np.int8)
        kind[~np.isfinite(value)] = MISSING
        chassis = list(_CHASSIS)
        n = len(times)
        self._stamp = np.concatenate([self._stamp, times])
        self._when = np.concatenate([self._when, true[chassis].T])
        self._reading = np.concatenate([self._reading, np.nan_to_num(value[chassis].T)])
        self._kind = np.concatenate([self._kind, kind[chassis].T])
        self._step = np.concatenate([self._step, np.full((n, 2), -1)])
        self._done = np.concatenate([self._done, np.zeros((n, 2), bool)])

    def _ready(self, everything: bool = False) -> Laid:
        """Lay out what lies before the horizon."""
        if not len(self._stamp):
            return Laid(
                _no_steps(), Rows(np.empty(0), np.empty((0, 2), np.int64), np.empty((0, 2)))
            )
        # beyond the newest of either chassis channel an earlier reading may still come
        horizon = min(*(w.horizon for w in self._wheels), *self._when[-1].tolist())
        if everything:
            horizon = math.inf
        use = ~self._done & (self._when <= horizon + _SAME_INSTANT)
        row, axle = np.nonzero(use)
        when = self._when[row, axle]
        self._done |= use
        lit = self._wheels[0].lit(when) & self._wheels[1].lit(when)
        self._kind[row[~lit], axle[~lit]] = MISSING
        steps = _no_steps()
        if lit.any():
            steps = self._lay(row[lit], axle[lit], when[lit])
        whole = int(np.argmin(np.append(np.logical_and(*self._done.T), False)))
        measured = np.where(self._kind[:whole] == VALUE, self._reading[:whole], np.nan)
        rows = Rows(self._stamp[:whole], self._step[:whole], measured)
        for name in ("_stamp", "_when", "_reading", "_kind", "_step", "_done"):
            setattr(self, name, getattr(self, name)[whole:])
        if self._now is not None:
            for wheel in self._wheels:
                wheel.forget(self._now)
        return Laid(steps, rows)

    def _lay(self, row: NDArray[np.int64], axle: NDArray[np.int64], when: Array) -> Steps:
        """Make steps that end at readings, with fillers where they would be too long."""
        order = np.argsort(when, kind="stable")
        row, axle, when = row[order], axle[order], when[order]
        start = float(when[0]) if self._now is None else self._now
        new = np.append(True, np.diff(when) > _SAME_INSTANT)
        place = np.cumsum(new) - 1
        seen = when[new]
        h = np.diff(seen, prepend=start)
        parts = np.where(h > self._gap, 1.0, np.maximum(np.ceil(h / self._longest - 1e-9), 1.0))
        end = np.cumsum(parts.astype(int)) - 1
        total = int(end[-1]) + 1
        instants = np.interp(np.arange(total), np.append(-1, end), np.append(start, seen))
        instants[end] = seen
        step = np.diff(instants, prepend=start)
        moments = np.empty((total, 2, ORDER))
        spread = np.empty((total, 4))
        known = step <= self._gap
        for a, wheel in enumerate(self._wheels):
            moments[:, a], part, there = wheel.integrate(instants, start)
            spread[:, a], spread[:, 2 + a] = part[:, 0], part[:, 1]
            known &= there
        kind = np.full((total, 2), MISSING, np.int8)
        reading = np.zeros((total, 2))
        at = end[place]
        kind[at, axle] = self._kind[row, axle]
        reading[at, axle] = self._reading[row, axle]
        self._step[row, axle] = self._count + at
        self._count += total
        self._now = float(instants[-1])
        afresh = ~known & (step > 0.0)
        return Steps(step, moments, spread, kind, reading, afresh)


def _no_steps() -> Steps:
    return Steps(
        np.empty(0), np.empty((0, 2, ORDER)), np.empty((0, 4)), np.empty((0, 2), np.int8),
        np.empty((0, 2)), np.empty(0, bool),
    )  # fmt: skip
