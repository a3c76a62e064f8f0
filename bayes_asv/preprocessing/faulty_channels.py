"""Detection of faulty channels: copied, frozen, clipped, or far too noisy.

Two sensors never have the same noise: a channel that equals another one is a copy.  A sensor that
holds its value while others move is frozen, and one with many readings at its largest or smallest
value is at the end of an undeclared range.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from bayes_asv.domain.channels import Channel
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Sensor, Vehicle
from bayes_asv.models.car_model import CarModel
from bayes_asv.preprocessing.prepare import rails, used_readings
from bayes_asv.preprocessing.quantization import quiet_level, smallest_step, top_level

__all__ = [
    "clipping_limit", "noise_ratios", "noisy_channels", "stuck_channels", "with_measured_noise",
]  # fmt: skip

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_SAME = 0.99  # share of equal readings above which a channel is a copy of another one
_ROUNDED = 0.51  # largest difference of copies that were rounded differently, in the sum of steps
_RESOLVED = 2.0  # largest step of a converter whose noise is visible at rest, in sd of the noise
# Largest standard deviation of the other channels at rest, in steps or noise of the channel.
_AT_REST = 3.0
# Share of equal neighbouring readings at rest below which noise is visible: half for white noise,
# more behind a filter.
_EQUAL = 0.65
_CHANCE = 1e-3  # probability of as long a run of equal readings in a recording by chance
_WINDOW = 24  # readings of a window in which a channel is at rest
_FEWEST = 3  # length of a run of equal readings that is never suspicious
_JUMP = 8.0  # jump after a suspicious run, in steps or noise of the channel
# Number of readings before a suspicious run, and their least standard deviation, in steps or noise.
_BEFORE, _AMID = 8, 4.0
# Standard deviation of another channel during the run, in steps or noise of the held one.
_MOVES = 20.0
_NEAR = 0.02  # distance from an extreme that counts as near it, relative to the channel's range
# Ratio of readings at an extreme to those near it above which a channel is clipped; the rounded
# crest of a signal has at most twice as many.
_PILED = 5.0

_FEW = 8.0  # range of a channel at rest, in steps

_NOISY = 2.0  # ratio of noise level to the declared one above which a channel is too noisy


def clipping_limit(samples: int) -> int:
    """Return the largest number of clipped readings that a fit accepts: ten, or 2 %."""
    return max(10, int(0.02 * samples))


def stuck_channels(recording: Recording, vehicle: Vehicle, car: CarModel) -> list[str]:
    """Report channels that are copies, frozen, or clipped within the declared range.

    Parameters
    ----------
    recording, vehicle : Recording and Vehicle
        Recording and vehicle as read.
    car : CarModel
        Defines the channels that are needed.

    Returns
    -------
    list of str
        One message for each faulty channel.

    Raises
    ------
    InputError
        If a channel that the car needs is missing.
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
        count = _clipped_readings(values[c], at_rail)
        sensor = vehicle.sensor(channel.name)
        held = _held_readings(values, c, sensor) & ~at_rail
        if _dead_above(values, channels, c, sensor):
            held = np.isfinite(values[c])
        if count > limit:
            reasons.append(
                f"the {channel.words} sensor of {source} stays at its extreme for {count} samples "
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


def noise_ratios(recording: Recording, vehicle: Vehicle, car: CarModel) -> dict[str, float]:
    """Noise over declared noise of channels that are far noisier than those of the other axle.

    The level is the smaller one of that of the quarter with the least motion and of that at the top
    of the spectrum.  On a rough road the motion of a wheel resembles noise too, but at both axles.
    The ratio between the axles is then as uncertain as the excess itself, hence the square.

    Parameters
    ----------
    recording, vehicle, car
        As for :func:`stuck_channels`.

    Returns
    -------
    dict of str to float
        One ratio for each noisy channel.
    """
    ratios = {}
    channels, readings, _ = used_readings(recording, vehicle, car)
    for channel, values in zip(channels, readings, strict=True):
        name, sensor = channel.name, vehicle.sensor(channel.name)
        if sensor.noise:
            level = min(quiet_level(values, 0.0), top_level(values))
            ratios[name] = level / _stated_level(sensor)
    noisy = {}
    for name, ratio in ratios.items():
        front, rear = name.replace("rear", "front", 1), name.replace("front", "rear", 1)
        other = ratios.get(rear if name == front else front)
        if other is not None and ratio > _NOISY * max(other, 1.0) ** 2:
            noisy[name] = ratio
    return noisy


def _stated_level(sensor: Sensor) -> float:
    """Return the declared noise of one reading, with the errors of the converter."""
    return float(np.hypot(sensor.noise or 0.0, (sensor.resolution or 0.0) / np.sqrt(12.0)))


def _noise_sentence(recording: Recording, vehicle: Vehicle, name: str, ratio: float) -> str:
    return (
        f"the {vehicle.channel(name).words} sensor of {Path(recording.source).name} is {ratio:.0f} "
        "times as noisy as the vehicle file says; check sensor, plug, cable and mount"
    )


def noisy_channels(recording: Recording, vehicle: Vehicle, car: CarModel) -> list[str]:
    """Report channels that are far noisier than declared, see :func:`noise_ratios`."""
    ratios = noise_ratios(recording, vehicle, car)
    return [_noise_sentence(recording, vehicle, name, ratio) for name, ratio in ratios.items()]


def with_measured_noise(
    recordings: Sequence[Recording], vehicle: Vehicle, car: CarModel
) -> tuple[Vehicle, list[str]]:
    """Replace the declared noise of sensors that are far noisier by what the recordings show.

    Parameters
    ----------
    recordings, vehicle, car
        As for :func:`noise_ratios`.

    Returns
    -------
    Vehicle, list of str
        The vehicle with the largest noise of each sensor, and one message for each noisy channel.
    """
    sensors, messages = dict(vehicle.sensors), []
    for recording in recordings:
        for name, ratio in noise_ratios(recording, vehicle, car).items():
            sensor = vehicle.sensor(name)
            step = (sensor.resolution or 0.0) / np.sqrt(12.0)
            # the converter adds the same errors to more noise
            level = float(np.sqrt((ratio * _stated_level(sensor)) ** 2 - step**2))
            sensors[name] = replace(sensors[name], noise=max(level, sensors[name].noise or 0.0))
            sentence = _noise_sentence(recording, vehicle, name, ratio)
            messages.append(f"{sentence}; the noise that it shows is used here")
    return replace(vehicle, sensors=sensors), messages


def _copies(values: Array, channels: Sequence[Channel]) -> list[tuple[int, int]]:
    """Find pairs of channels that are equal whenever one of them moves."""
    out = []
    for b in range(len(values)):
        for a in range(b):
            if channels[a].quantity != channels[b].quantity:
                continue
            both = np.isfinite(values[a]) & np.isfinite(values[b])
            moves = np.append(np.diff(values[a]) != 0.0, False) & both
            one, other = (smallest_step(values[k, both]) for k in (a, b))
            # With the same step, a copy has exactly the same readings: two sensors with the same
            # motion are often within one coarse step of each other.
            alike = abs(one - other) < 1e-3 * one
            tolerance = 1e-6 * one if alike else _ROUNDED * (one + other)
            if np.count_nonzero(moves) < _WINDOW or not _exceeds_rest_range(
                values[a, moves], one + other
            ):
                continue  # at rest, any two sensors agree
            if np.mean(np.abs(values[a, moves] - values[b, moves]) <= tolerance) > _SAME:
                out.append((a, b))
    return out


def _runs(signal: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First reading and length of each run of equal readings; each missing one is a run."""
    begins = np.flatnonzero(np.concatenate([[True], signal[1:] != signal[:-1]]))
    return begins, np.diff(np.append(begins, len(signal)))


def _held_readings(values: Array, c: int, sensor: Sensor) -> Flags:
    """Find readings (N,) in runs of equal values that a working channel does not have.

    A run amid motion that ends in a jump is neither a crest nor rest.  In any other run, such as
    one to the end of the recording, noise of a good part of a step would be visible.  The step of a
    channel that never changes is unknown: see :func:`_dead_above`, and for wheels the data checks.
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
    noise_is_visible = noise is not None and step <= _RESOLVED * noise
    if noise is None:
        rest = np.max(_local_deviation(others), axis=0) < _AT_REST * floor
        pairs = rest[1:] & rest[:-1]
        same = np.diff(signal)[pairs] == 0.0
        noise_is_visible = len(same) > _WINDOW and float(np.mean(same)) < _EQUAL
    enough = 1.0 + math.log(_CHANCE / len(signal)) / math.log(_EQUAL)
    begins, lengths = _runs(signal)
    jumps = np.concatenate([[0.0], np.abs(np.diff(signal)), [0.0]])
    long = lengths > _FEWEST
    for begin, length in zip(begins[long], lengths[long], strict=True):
        rows = slice(int(begin), int(begin + length))
        before = signal[max(int(begin) - _BEFORE, 0) : int(begin)]
        amid = len(before) == _BEFORE and float(np.std(before)) > _AMID * floor
        ends = jumps[begin + length] > _JUMP * floor
        if (ends and amid) or (noise_is_visible and length > enough):
            moves = float(np.max(np.std(others[:, rows], axis=1))) > _MOVES * floor
            out[np.flatnonzero(present)[rows]] = moves
    return out


def _dead_above(values: Array, channels: Sequence[Channel], c: int, sensor: Sensor) -> bool:
    """Whether a channel of the body never changes although a wheel of its axle moves.

    A wheel may be at rest until it meets a bump, but the body above a moving wheel is not.  The
    wheel has to move by far more than its noise, and than the resolution of the other channel.
    """
    channel, readings = channels[c], values[c, np.isfinite(values[c])]
    if (
        channel.is_input
        or channel.axle is None
        or len(readings) < _WINDOW
        or np.ptp(readings) > 0.0
    ):
        return False
    stated = max(sensor.resolution or 0.0, sensor.noise or 0.0)
    wheels = [
        values[k, np.isfinite(values[k])]
        for k, one in enumerate(channels)
        if one.is_input and (one.axle, one.side) == (channel.axle, channel.side)
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


def _exceeds_rest_range(readings: Array, step: float) -> bool:
    """Whether readings cover more than the few steps of a converter at rest."""
    return float(np.ptp(readings)) > _FEW * step


def _clipped_readings(signal: Array, at_rail: Flags) -> int:
    """Count readings amid motion that accumulate at an extreme which is not a declared rail."""
    readings = signal[np.isfinite(signal) & ~at_rail]
    step = smallest_step(readings)
    if len(readings) < _WINDOW or not _exceeds_rest_range(readings, step):
        return 0
    # the level of a channel at rest is an extreme until it has moved both ways
    readings = readings[_local_deviation(readings[None])[0] > _AT_REST * step]
    if len(readings) < _WINDOW:
        return 0
    tolerance = max(_NEAR * float(np.ptp(readings)), 2.0 * step)
    out = 0
    for extreme in (readings.max(), readings.min()):
        distance = np.abs(readings - extreme)
        at_extreme = int(np.count_nonzero(distance == 0.0))
        near_extreme = int(np.count_nonzero((distance > 0.0) & (distance <= tolerance)))
        out += at_extreme if at_extreme > _PILED * max(near_extreme, 1) else 0
    return out
