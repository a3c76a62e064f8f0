"""A recording laid out as the steps and readings that the innovations recursion takes."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording, accelerations, require_half_car, sample_times
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.kalman import AT_LEAST, AT_MOST, MISSING, ORDER, VALUE
from bayes_asv.models.half_car import HalfCar, deflection_form
from bayes_asv.preprocessing.missing_band import MissingBand
from bayes_asv.preprocessing.wheel_spline import WheelSignal, equalised, moments, wheel_signal

__all__ = [
    "FEWEST_READINGS",
    "MeasurementSchedule",
    "PreparedRecording",
    "build",
    "common_bandwidth",
    "rails",
    "schedule",
]  # fmt: skip

Array = NDArray[np.float64]

FEWEST_READINGS = 8  # of a channel inside its range, without which there is no curve to draw
# The kernel's series lose (λh)⁸/8! a step: with λh at most 1/4 for the nominal car they hold to
# 1e-9 there, and to 1e-5 where a rate is three times nominal.
_LONGEST_STEP = 0.005  # s
_LONGEST_PHASE = 0.25
_SAME_INSTANT = 1e-8  # s

# What the state may be when a record begins, one deviation: 0.1 m, 1 m/s, and 1 m/s² for the
# zero of a chassis channel against its wheel channel (a tenth of gravity, from tilt and offset).
_START = np.array([0.1, 1.0, 0.1, 1.0, 1.0, 1.0]) ** 2


class MeasurementSchedule(NamedTuple):
    """Steps and readings of a :class:`PreparedRecording`, in its names."""

    step: Array
    moments: Array
    spread: Array
    kind: NDArray[np.int8]
    closes: NDArray[np.bool_]
    reading: Array
    extra: Array
    start: Array
    instants: Array
    pairs: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class PreparedRecording:
    """One recording, ready for :mod:`bayes_asv.filters.kalman`.

    Parameters
    ----------
    step, moments, spread, kind, closes, reading, extra, start
        As the kernel takes them; see there for shapes and units.
    instants : (E,) array
        Times of the steps' ends, s.
    pairs : (R, 2) int array
        Instants of front and rear chassis readings that belong together, -1 where one is missing.
    wheels : pair of WheelSignal
        Front and rear wheel acceleration.
    acceleration : (4, N) array
        All channels in m/s², NaN where missing, bandwidths made equal.
    times : (4, N) array
        True sampling time of each reading, s.
    clipped : (4, N) bool array
        Readings at a rail.
    noise : 4-tuple of float or None
        Given deviation of one sample of each channel, m/s².
    steps : (4,) array
        One step of each channel's reading, m/s²; 0 where not given.
    poles : (4,) array
        Pole of the filter that all readings passed, rad/s; 0 when no bandwidth is given.
    source : str
        File name without its folder, for messages and reports.
    scale_sd : (4,) array
        Relative deviation of each sensor's scale; 0 where it is exact or not in counts.
    below : float or None
        Upper edge of the band that is left of the recording, Hz; None at full band.
    quiet : (4,) array or None
        Where the prior of a noise level that is not given is centred, m/s²; None for the level
        of the record's quiet quarter.
    notches : tuple of (frequency, half-width)
        Bands that were cut out of all channels, Hz.
    cut : MissingBand or None
        What that did to the noise.
    doubt : (E, 2) array or None
        Part of ``spread`` that is no noise, but doubt of wheels that stand still.
    began : float or None
        When the recording began, s, where a filter took its beginning away.
    """

    step: Array
    moments: Array
    spread: Array
    kind: NDArray[np.int8]
    closes: NDArray[np.bool_]
    reading: Array
    extra: Array
    start: Array
    instants: Array
    pairs: NDArray[np.int64]
    wheels: tuple[WheelSignal, WheelSignal]
    acceleration: Array
    times: Array
    clipped: NDArray[np.bool_]
    noise: tuple[float | None, ...]
    steps: Array
    poles: Array
    source: str
    scale_sd: Array = field(default_factory=lambda: np.zeros(4))
    below: float | None = None
    quiet: Array | None = None
    notches: tuple[tuple[float, float], ...] = ()
    cut: MissingBand | None = None
    doubt: Array | None = None
    began: float | None = None

    @property
    def elapsed(self) -> Array:
        """Times of the steps' ends since the recording began (E,), s."""
        return self.instants - (self.instants[0] if self.began is None else self.began)

    @property
    def noise_spread(self) -> Array:
        """How noise alone drives the states over each step (E, 4)."""
        if self.doubt is None:
            return self.spread
        return self.spread - np.hstack([np.zeros_like(self.doubt), self.doubt])

    def paired(self, values: Array) -> Array:
        """Arrange values at instants (E, 2) by pairs of readings (R, 2), nan where missing."""
        out = np.full(self.pairs.shape, np.nan)
        for axle in range(2):
            there = self.pairs[:, axle] >= 0
            at = self.pairs[there, axle]
            value = self.kind[at, axle] == VALUE
            out[there, axle] = np.where(value, values[at, axle], np.nan)
        return out

    @property
    def readings(self) -> int:
        """Number of chassis readings used."""
        return int(np.count_nonzero(self.kind != MISSING))

    @property
    def reading_step(self) -> float:
        """Usual time between two pairs of chassis readings, s."""
        return float(np.median(np.diff(self.instants[self.pairs.max(axis=1)])))


def rails(
    acc: Array, vehicle: Vehicle, channels: tuple[str, ...] = CHANNELS
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Find readings at the lower and at the upper rail of their sensor.

    Parameters
    ----------
    acc : (C, N) array
        Accelerations, m/s².
    vehicle : Vehicle
        Gives each channel's range; a channel without one has no rails.
    channels : tuple of C str
        Which they are.

    Returns
    -------
    low, high : (C, N) bool arrays
        A reading within half a step of the rail counts as at the rail.
    """
    low = np.zeros(acc.shape, bool)
    high = np.zeros(acc.shape, bool)
    for c, name in enumerate(channels):
        sensor = vehicle.sensor(name)
        slack = 0.5 * abs(sensor.resolution or sensor.counts_scale or 0.0)
        if np.isfinite(sensor.low):
            low[c] = acc[c] <= sensor.low + slack
        if np.isfinite(sensor.high):
            high[c] = acc[c] >= sensor.high - slack
    return low, high


def build(recording: Recording, vehicle: Vehicle) -> PreparedRecording:
    """Lay a recording out in time.

    Parameters
    ----------
    recording : Recording
        As read.
    vehicle : Vehicle
        Gives calibration, delays, ranges and bandwidths.

    Returns
    -------
    PreparedRecording

    Raises
    ------
    InputError
        When a channel has fewer than :data:`FEWEST_READINGS` readings inside its range, or the
        channels are those of single corners.
    """
    require_half_car(recording)
    acc = accelerations(recording, vehicle)
    times = sample_times(recording, vehicle)
    low, high = rails(acc, vehicle)
    for c, name in enumerate(CHANNELS):
        if np.count_nonzero(np.isfinite(acc[c]) & ~(low[c] | high[c])) < FEWEST_READINGS:
            raise InputError(
                recording.source,
                f"channel {name} has fewer than {FEWEST_READINGS} readings inside its range",
                "check the wiring, the column and the vehicle's range for that sensor",
            )
    sensors = [vehicle.sensor(name) for name in CHANNELS]
    acc, poles = common_bandwidth(acc, times, [s.bandwidth for s in sensors])
    scale_sd = np.array(
        [
            s.counts_scale_sd / abs(s.counts_scale)
            if recording.units[c] == "counts" and s.counts_scale
            else 0.0
            for c, s in enumerate(sensors)
        ]
    )
    steps = np.array(
        [
            s.resolution or (abs(s.counts_scale or 0.0) if recording.units[c] == "counts" else 0.0)
            for c, s in enumerate(sensors)
        ]
    )
    wheels = (
        wheel_signal(times[0], acc[0], low[0], high[0]),
        wheel_signal(times[2], acc[2], low[2], high[2]),
    )
    plan = schedule(acc, times, (low, high), wheels, vehicle)
    return PreparedRecording(
        **plan._asdict(),
        wheels=wheels,
        acceleration=acc,
        times=times,
        clipped=low | high,
        noise=tuple(s.noise for s in sensors),
        steps=steps,
        poles=poles,
        source=Path(recording.source).name,
        scale_sd=scale_sd,
    )


def schedule(
    acc: Array,
    times: Array,
    rails: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    wheels: tuple[WheelSignal, WheelSignal],
    vehicle: Vehicle,
    longest: float = _LONGEST_STEP,
) -> MeasurementSchedule:
    """Put chassis readings and wheel signals in the order in which the recursion takes them.

    Parameters
    ----------
    acc, times : (4, N) arrays
        Readings (m/s²), NaN where there is none, and when they were taken (s).
    rails : pair of (4, N) bool arrays
        Readings at the lower and at the upper rail.
    wheels : pair of WheelSignal
        Front and rear wheel acceleration.
    vehicle : Vehicle
        Its fastest motion limits the step.
    longest : float
        Longest step whatever the car, s.

    Returns
    -------
    MeasurementSchedule
    """
    longest = min(longest, _longest_step(vehicle))
    instants, kind, reading, pairs = _instants(acc, times, *rails, wheels, longest)
    closes = np.zeros(len(instants), bool)
    closes[pairs.max(axis=1)] = True
    return MeasurementSchedule(
        step=np.diff(instants, prepend=instants[0]),
        moments=np.ascontiguousarray(
            np.stack([moments(w, instants, ORDER) for w in wheels], axis=1)
        ),
        spread=_spread(wheels, instants),
        kind=kind,
        closes=closes,
        reading=reading,
        extra=np.zeros_like(reading),
        start=_START.copy(),
        instants=instants,
        pairs=pairs,
    )


def _longest_step(vehicle: Vehicle) -> float:
    """Length of step (s) over which the kernel's series hold for this car's motion."""
    car = HalfCar(*(getattr(vehicle, name).value for name in HalfCar._fields))
    fastest = float(np.max(np.abs(np.linalg.eigvals(deflection_form(car).A))))
    return _LONGEST_PHASE / fastest


def common_bandwidth(
    acc: Array, times: Array, bandwidth: list[float | None]
) -> tuple[Array, Array]:
    """Filter the faster sensors' readings so that all passed the same pole.

    A sensor without a bandwidth is taken to be like the slowest of the others.
    """
    given = [b for b in bandwidth if b is not None]
    if not given:
        return acc, np.zeros(len(acc))
    target = min(given)
    out = acc.copy()
    for c, b in enumerate(bandwidth):
        there = np.isfinite(acc[c])
        if b is not None:
            out[c, there] = equalised(times[c, there], acc[c, there], b, target)
    return out, np.full(len(acc), 2.0 * np.pi * target)


def _instants(
    acc: Array,
    times: Array,
    low: NDArray[np.bool_],
    high: NDArray[np.bool_],
    wheels: tuple[WheelSignal, WheelSignal],
    longest: float,
) -> tuple[Array, NDArray[np.int8], Array, NDArray[np.int64]]:
    """Instants of observation in order, with fillers where the step would be too long."""
    n = acc.shape[1]
    first = max(w.knots[0] for w in wheels)
    last = min(w.knots[-1] for w in wheels)
    when, which, rows = [], [], []
    for axle, c in enumerate((1, 3)):
        use = np.isfinite(acc[c]) & (times[c] >= first) & (times[c] <= last)
        when.append(times[c, use])
        which.append(np.full(np.count_nonzero(use), axle))
        rows.append(np.arange(n)[use])
    t = np.concatenate(when)
    order = np.argsort(t, kind="stable")
    t, axle_of, row_of = t[order], np.concatenate(which)[order], np.concatenate(rows)[order]
    new = np.append(True, np.diff(t) > _SAME_INSTANT)
    place = np.cumsum(new) - 1
    seen = t[new]
    pieces = np.maximum(np.ceil(np.diff(seen) / longest - 1e-9).astype(int), 1)
    position = np.concatenate([[0], np.cumsum(pieces)])
    total = int(position[-1]) + 1
    instants = np.interp(np.arange(total), position, seen)
    instants[position] = seen
    kind = np.full((total, 2), MISSING, np.int8)
    reading = np.zeros((total, 2))
    for axle, c in enumerate((1, 3)):
        mine = axle_of == axle
        at, r = position[place[mine]], row_of[mine]
        kind[at, axle] = np.where(high[c, r], AT_LEAST, np.where(low[c, r], AT_MOST, VALUE))
        reading[at, axle] = acc[c, r]
    return instants, kind, reading, _pairs(kind)


def _pairs(kind: NDArray[np.int8]) -> NDArray[np.int64]:
    """Pair front and rear readings that stand next to each other in time.

    One board reads both at one instant; two boards with clocks of their own do not, and after a
    minute they may be a row apart, so rows of the file do not tell what belongs together.
    """
    pairs: list[list[int]] = []
    current = [-1, -1]
    for k in np.flatnonzero(np.any(kind != MISSING, axis=1)):
        axles = np.flatnonzero(kind[k] != MISSING)
        if any(current[axle] >= 0 for axle in axles):
            pairs.append(current)
            current = [-1, -1]
        for axle in axles:
            current[axle] = int(k)
    pairs.append(current)
    return np.array(pairs, np.int64)


def _spread(wheels: tuple[WheelSignal, WheelSignal], instants: Array) -> Array:
    """How a sample's noise and its surroundings drive the states over each step."""
    middle = 0.5 * (instants + np.append(instants[0], instants[:-1]))
    out = np.zeros((len(instants), 4))
    for axle, wheel in enumerate(wheels):
        at = np.clip(np.searchsorted(wheel.knots, middle) - 1, 0, len(wheel.knots) - 2)
        spacing = np.diff(wheel.knots)[at]
        out[:, axle] = spacing
        out[:, 2 + axle] = wheel.deviation[at] ** 2 * spacing
    return out
