"""A recording laid out as the steps and readings that the innovations recursion takes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bayes_asv.channels import CHANNELS
from bayes_asv.errors import InputError
from bayes_asv.inference.wheels import WheelSignal, equalised, moments, wheel_signal
from bayes_asv.kernels.innovations import AT_LEAST, AT_MOST, MISSING, ORDER, VALUE
from bayes_asv.recording import Recording, accelerations, sample_offsets
from bayes_asv.vehicle import Vehicle

__all__ = ["FEWEST_READINGS", "Timeline", "build", "rails"]

Array = NDArray[np.float64]

FEWEST_READINGS = 8  # of a channel inside its range, without which there is no curve to draw
_LONGEST_STEP = 0.005  # s; keeps the series in the kernel exact to 1e-10
_SAME_INSTANT = 1e-8  # s

# What the state may be when a record begins, one deviation: 0.1 m, 1 m/s, and 1 m/s² for the
# zero of a chassis channel against its wheel channel (a count of zero off by 20 at 10 bits).
_START = np.array([0.1, 1.0, 0.1, 1.0, 1.0, 1.0]) ** 2


@dataclass(frozen=True)
class Timeline:
    """One recording, ready for :mod:`bayes_asv.kernels.innovations`.

    Parameters
    ----------
    step, moments, spread, kind, closes, reading, extra, start
        As the kernel takes them; see there for shapes and units.
    instants : (E,) array
        Times of the steps' ends, s.
    row : (E,) int array
        Row of the recording an instant belongs to, -1 for one put in between.
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
        Pole of each sensor's filter, rad/s; 0 where not given.
    source : str
        File name without its folder, for messages and reports.
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
    row: NDArray[np.int64]
    wheels: tuple[WheelSignal, WheelSignal]
    acceleration: Array
    times: Array
    clipped: NDArray[np.bool_]
    noise: tuple[float | None, ...]
    steps: Array
    poles: Array
    source: str

    @property
    def readings(self) -> int:
        """Number of chassis readings used."""
        return int(np.count_nonzero(self.kind != MISSING))


def rails(acc: Array, vehicle: Vehicle) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Find readings at the lower and at the upper rail of their sensor.

    Parameters
    ----------
    acc : (4, N) array
        Accelerations, m/s².
    vehicle : Vehicle
        Gives each channel's range; a channel without one has no rails.

    Returns
    -------
    low, high : (4, N) bool arrays
        A reading within half a step of the rail counts as at the rail.
    """
    low = np.zeros(acc.shape, bool)
    high = np.zeros(acc.shape, bool)
    for c, name in enumerate(CHANNELS):
        sensor = vehicle.sensor(name)
        slack = 0.5 * abs(sensor.resolution or sensor.counts_scale or 0.0)
        if np.isfinite(sensor.low):
            low[c] = acc[c] <= sensor.low + slack
        if np.isfinite(sensor.high):
            high[c] = acc[c] >= sensor.high - slack
    return low, high


def build(recording: Recording, vehicle: Vehicle) -> Timeline:
    """Lay a recording out in time.

    Parameters
    ----------
    recording : Recording
        As read.
    vehicle : Vehicle
        Gives calibration, delays, ranges and bandwidths.

    Returns
    -------
    Timeline

    Raises
    ------
    InputError
        When a channel has fewer than :data:`FEWEST_READINGS` readings inside its range.
    """
    acc = accelerations(recording, vehicle)
    times = sample_offsets(recording, vehicle)
    low, high = rails(acc, vehicle)
    for c, name in enumerate(CHANNELS):
        if np.count_nonzero(np.isfinite(acc[c]) & ~(low[c] | high[c])) < FEWEST_READINGS:
            raise InputError(
                recording.source,
                f"channel {name} has fewer than {FEWEST_READINGS} readings inside its range",
                "check the wiring, the column and the vehicle's range for that sensor",
            )
    sensors = [vehicle.sensor(name) for name in CHANNELS]
    acc, poles = _common_bandwidth(acc, times, [s.bandwidth for s in sensors])
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
    instants, kind, reading, row = _instants(acc, times, low, high, wheels)
    step = np.diff(instants, prepend=instants[0])
    closes = np.append(row[1:] != row[:-1], True) & (row >= 0)
    return Timeline(
        step=step,
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
        row=row,
        wheels=wheels,
        acceleration=acc,
        times=times,
        clipped=low | high,
        noise=tuple(s.noise for s in sensors),
        steps=steps,
        poles=poles,
        source=Path(recording.source).name,
    )


def _common_bandwidth(
    acc: Array, times: Array, bandwidth: list[float | None]
) -> tuple[Array, Array]:
    """Filter the faster sensors' readings so that all four passed the same pole."""
    given = [b for b in bandwidth if b is not None]
    if not given:
        return acc, np.zeros(4)
    target = min(given)
    out = acc.copy()
    for c, b in enumerate(bandwidth):
        there = np.isfinite(acc[c])
        if b is not None:
            out[c, there] = equalised(times[c, there], acc[c, there], b, target)
    return out, np.full(4, 2.0 * np.pi * target)


def _instants(
    acc: Array,
    times: Array,
    low: NDArray[np.bool_],
    high: NDArray[np.bool_],
    wheels: tuple[WheelSignal, WheelSignal],
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
    seen_row = row_of[new]
    gaps = np.diff(seen)
    pieces = np.maximum(np.ceil(gaps / _LONGEST_STEP - 1e-9).astype(int), 1)
    position = np.concatenate([[0], np.cumsum(pieces)])
    total = int(position[-1]) + 1
    instants = np.interp(np.arange(total), position, seen)
    instants[position] = seen
    kind = np.full((total, 2), MISSING, np.int8)
    reading = np.zeros((total, 2))
    row = np.full(total, -1)
    row[position] = seen_row
    for axle, c in enumerate((1, 3)):
        mine = axle_of == axle
        at, r = position[place[mine]], row_of[mine]
        kind[at, axle] = np.where(high[c, r], AT_LEAST, np.where(low[c, r], AT_MOST, VALUE))
        reading[at, axle] = acc[c, r]
    # A filler between two instants of one row must not close it.
    for k in range(1, total):
        if row[k] < 0 and row[k - 1] >= 0:
            ahead = position[np.searchsorted(position, k)]
            if row[ahead] == row[k - 1]:
                row[k:ahead] = row[ahead]
    return instants, kind, reading, row.astype(np.int64)


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
