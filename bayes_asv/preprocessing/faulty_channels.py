"""Channels whose readings no working sensor has: copied, frozen, clipped, or far too noisy.

Two sensors never read the same, noise and all: a channel that equals another one is a copy.  A
sensor that holds its value while others move is frozen, and one that piles up readings at its
largest or smallest one is at the end of a range that nobody stated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from bayes_asv.domain.channels import Channel
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Sensor, Vehicle
from bayes_asv.models.car_model import CarModel
from bayes_asv.preprocessing.prepare import rails, used_readings
from bayes_asv.preprocessing.quantization import quiet_level, smallest_step

__all__ = ["clipping_limit", "noisy_channels", "stuck_channels"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_SAME = 0.99  # share of equal readings from which on one channel is a copy of another
_ROUNDED = 0.51  # of both steps, by which copies differ that were rounded apart
_RESOLVED = 2.0  # largest step, in deviations of the noise, that a channel at rest flickers by
_AT_REST = 3.0  # largest deviation of the others then, in steps or noise of the channel
_EQUAL = 0.65  # share of equal neighbours at rest then: half where white, more behind a filter
_CHANCE = 1e-3  # of so long a run of equal readings in a recording
_WINDOW = 24  # readings in which a channel is at rest
_FEWEST = 3  # equal readings in a row that need no reason
_JUMP = 8.0  # after such a run, in steps or noise of the channel
_BEFORE, _AMID = 8, 4.0  # readings before it, and their deviation in the same
_MOVES = 20.0  # deviation of another channel meanwhile, in steps or noise of the one that holds
_NEAR = 0.02  # of all it covers, next to an extreme: where a channel that is not clipped often is
_PILED = 5.0  # readings at an extreme over those near it; a rounded crest has twice as many at most

_FEW = 8.0  # steps that a channel at rest covers

_NOISY = 2.0  # times the stated noise


def clipping_limit(samples: int) -> int:
    """Return how many readings at the end of its range a fit copes with: ten, or 2 %."""
    return max(10, int(0.02 * samples))


def stuck_channels(recording: Recording, vehicle: Vehicle, car: CarModel) -> list[str]:
    """Name channels that are copies, frozen, or clipped within the range that is stated.

    Parameters
    ----------
    recording, vehicle : Recording and Vehicle
        As read.
    car : CarModel
        Says which channels it needs.

    Returns
    -------
    list of str
        One reason a channel.

    Raises
    ------
    InputError
        When a channel that the car needs is missing.
    """
    channels, values, _ = used_readings(recording, vehicle, car)
    source = Path(recording.source).name
    reasons = [
        f"the columns {channels[a].words} and {channels[b].words} of {source} hold the same "
        "readings, which two sensors never do; check the columns and the wiring"
        for a, b in _copies(values, channels)
    ]
    if reasons:
        return reasons
    low, high = rails(values, vehicle, channels)
    for c, channel in enumerate(channels):
        limit = clipping_limit(int(np.count_nonzero(np.isfinite(values[c]))))
        at_rail = low[c] | high[c]
        piled = _piled_up(values[c], at_rail)
        sensor = vehicle.sensor(channel.name)
        held = _held(values, c, sensor) & ~at_rail
        if _dead_above(values, channels, c, sensor):
            held = np.isfinite(values[c])
        if piled > limit:
            reasons.append(
                f"the {channel.words} sensor of {source} stays at its extreme for {piled} samples "
                "in all, as a sensor or amplifier at the end of its range does; check its supply "
                "and gain, drive slower, or use a sensor with a wider range"
            )
        elif np.count_nonzero(held) > limit:
            at = recording.time[np.flatnonzero(held)[0]] - recording.time[0]
            reasons.append(
                f"the {channel.words} sensor of {source} holds its value in "
                f"{np.count_nonzero(held)} samples, the first time after {at:.2f} s, while the car "
                "moves; check sensor, plug and cable"
            )
    return reasons


def noisy_channels(recording: Recording, vehicle: Vehicle, car: CarModel) -> list[str]:
    """Name channels that are far noisier than stated, while the same one of the other axle is not.

    On a rough road the motion of a sound wheel looks like noise too, but at both axles; by what
    factor the axles then differ is uncertain by as much as that, hence the square.

    Parameters
    ----------
    recording, vehicle, car
        As for :func:`stuck_channels`.

    Returns
    -------
    list of str
        One sentence a channel.
    """
    ratios = {}
    channels, readings, _ = used_readings(recording, vehicle, car)
    for channel, values in zip(channels, readings, strict=True):
        name, sensor = channel.name, vehicle.sensor(channel.name)
        if sensor.noise:
            stated = float(np.hypot(sensor.noise, (sensor.resolution or 0.0) / np.sqrt(12.0)))
            ratios[name] = quiet_level(values, 0.0) / stated
    out = []
    for name, ratio in ratios.items():
        front, rear = name.replace("rear", "front", 1), name.replace("front", "rear", 1)
        other = ratios.get(rear if name == front else front)
        if other is not None and ratio > _NOISY * max(other, 1.0) ** 2:
            out.append(
                f"the {vehicle.channel(name).words} sensor of {Path(recording.source).name} is "
                f"{ratio:.0f} times as noisy as the vehicle file says; check sensor, plug, cable "
                "and mount"
            )
    return out


def _copies(values: Array, channels: Sequence[Channel]) -> list[tuple[int, int]]:
    """Pairs of channels that equal each other wherever one of them moves."""
    out = []
    for b in range(len(values)):
        for a in range(b):
            if channels[a].quantity != channels[b].quantity:
                continue
            both = np.isfinite(values[a]) & np.isfinite(values[b])
            moves = np.append(np.diff(values[a]) != 0.0, False) & both
            one, other = (smallest_step(values[k, both]) for k in (a, b))
            # Of one converter a copy has the very readings: two sensors that move alike are often
            # within one coarse step of each other.
            alike = abs(one - other) < 1e-3 * one
            near = 1e-6 * one if alike else _ROUNDED * (one + other)
            if np.count_nonzero(moves) < _WINDOW or not _resolved(values[a, moves], one + other):
                continue  # at rest any two sensors agree
            if np.mean(np.abs(values[a, moves] - values[b, moves]) <= near) > _SAME:
                out.append((a, b))
    return out


def _runs(signal: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First reading and length of each run of equal readings; each missing one is a run."""
    begins = np.flatnonzero(np.concatenate([[True], signal[1:] != signal[:-1]]))
    return begins, np.diff(np.append(begins, len(signal)))


def _held(values: Array, c: int, sensor: Sensor) -> Flags:
    """Find readings (N,) in runs that a working channel does not have while the others move.

    A run amid motion that ends in a jump was neither a crest nor rest.  In another one, such as one
    to the end of the recording, noise of a good part of a step would have shown.  Of a channel that
    never changes the step is not known: see :func:`_dead_above`, and for wheels the data checks.
    """
    out = np.zeros(values.shape[1], bool)
    present = np.isfinite(values[c])
    signal = values[c, present]
    if len(signal) < _WINDOW:
        return out
    step = smallest_step(signal)
    if step == 0.0:
        return out
    step = max(step, sensor.resolution or 0.0)
    floor, noise = max(quiet_level(signal, 0.0), step), sensor.noise
    others = np.nan_to_num(np.delete(values, c, axis=0)[:, present])
    flickers = noise is not None and step <= _RESOLVED * noise
    if noise is None:
        rest = np.max(_local_deviation(others), axis=0) < _AT_REST * floor
        pairs = rest[1:] & rest[:-1]
        same = np.diff(signal)[pairs] == 0.0
        flickers = len(same) > _WINDOW and float(np.mean(same)) < _EQUAL
    enough = 1.0 + math.log(_CHANCE / len(signal)) / math.log(_EQUAL)
    begins, lengths = _runs(signal)
    jumps = np.concatenate([[0.0], np.abs(np.diff(signal)), [0.0]])
    long = lengths > _FEWEST
    for begin, length in zip(begins[long], lengths[long], strict=True):
        rows = slice(int(begin), int(begin + length))
        before = signal[max(int(begin) - _BEFORE, 0) : int(begin)]
        amid = len(before) == _BEFORE and float(np.std(before)) > _AMID * floor
        ends = jumps[begin + length] > _JUMP * floor
        if (ends and amid) or (flickers and length > enough):
            moves = float(np.max(np.std(others[:, rows], axis=1))) > _MOVES * floor
            out[np.flatnonzero(present)[rows]] = moves
    return out


def _dead_above(values: Array, channels: Sequence[Channel], c: int, sensor: Sensor) -> bool:
    """Whether a channel of the body never changes although a wheel of its axle moves.

    A wheel may be still until it meets the bump; the body above one that moves is not.  It has to
    move by far more than its own noise, and than what the still channel can resolve.
    """
    own, readings = channels[c], values[c, np.isfinite(values[c])]
    if own.is_input or own.axle is None or len(readings) < _WINDOW or np.ptp(readings) > 0.0:
        return False
    stated = max(sensor.resolution or 0.0, sensor.noise or 0.0)
    wheels = [
        values[k, np.isfinite(values[k])]
        for k, one in enumerate(channels)
        if one.is_input and (one.axle, one.side) == (own.axle, own.side)
    ]
    return any(
        len(x) >= _WINDOW and float(np.std(x)) > _MOVES * max(stated, quiet_level(x, 0.0)) > 0.0
        for x in wheels
    )


def _local_deviation(signals: Array) -> Array:
    """Return the standard deviation of signals (C, N) over windows of `_WINDOW` readings."""
    mean = uniform_filter1d(signals, _WINDOW, axis=1)
    square = uniform_filter1d(signals**2, _WINDOW, axis=1)
    return np.asarray(np.sqrt(np.maximum(square - mean**2, 0.0)))


def _resolved(readings: Array, step: float) -> bool:
    """Whether readings move by more than the few steps of a converter at rest."""
    return float(np.ptp(readings)) > _FEW * step


def _piled_up(signal: Array, at_rail: Flags) -> int:
    """Count readings amid motion that pile up at an extreme which is not a stated rail."""
    readings = signal[np.isfinite(signal) & ~at_rail]
    step = smallest_step(readings)
    if len(readings) < _WINDOW or not _resolved(readings, step):
        return 0
    # The level at which a channel rests is an extreme until it has moved both ways.
    readings = readings[_local_deviation(readings[None])[0] > _AT_REST * step]
    if len(readings) < _WINDOW:
        return 0
    near = max(_NEAR * float(np.ptp(readings)), 2.0 * step)
    out = 0
    for extreme in (readings.max(), readings.min()):
        distance = np.abs(readings - extreme)
        there = int(np.count_nonzero(distance == 0.0))
        close = int(np.count_nonzero((distance > 0.0) & (distance <= near)))
        out += there if there > _PILED * max(close, 1) else 0
    return out
