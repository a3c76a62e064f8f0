"""Checks of recordings before any fit, with messages.

No linear car model explains more of a chassis channel than the best linear relation with all
wheels: multiple coherence is an upper bound (Bendat & Piersol, Random Data, 2010, ch. 7).  Spectra
are averaged over windows (Welch 1967); with K windows and two inputs, the unexplained power is
underestimated by (K − 2)/K on average, which is corrected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import Channel
from bayes_asv.domain.errors import enumerated
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Sensor, Vehicle
from bayes_asv.filters.kalman import VALUE
from bayes_asv.models.car_model import CarModel
from bayes_asv.models.modes import VibrationMode, nominal_modes
from bayes_asv.preprocessing.activity import FEWEST_ROWS
from bayes_asv.preprocessing.band import ABOVE_MODES, too_short
from bayes_asv.preprocessing.faulty_channels import clipping_limit
from bayes_asv.preprocessing.prepare import (
    FEWEST_READINGS,
    LONGEST_GAP,
    rails,
    used_readings,
)
from bayes_asv.preprocessing.prepared_recording import PreparedRecording  # fmt: skip
from bayes_asv.preprocessing.quantization import noise_level

__all__ = [
    "FEWEST_WINDOWS",
    "LEAST_PERIODS",
    "MAX_UNEXPLAINED",
    "MIN_EXCITATION",
    "Coherence",
    "coherence",
    "dead_channels",
    "min_sampling_rate",
    "mistaken_time_unit",
    "preflight",
    "suggest_band",
]

LEAST_PERIODS = 1.0  # least length of a recording, in periods of the slowest mode
_SAMPLES_A_PERIOD = 12.0  # least number of samples per period of the fastest mode
# Factor on that number for a mode that does not oscillate; 5 were enough for poles of 18 to 32 Hz.
_REAL = 0.5
_FEW_A_SECOND = 2.5  # rows per second: fewer than any logger of accelerations takes
_FASTEST_LOGGER = 20e3  # highest sampling rate of a logger, Hz
MAX_UNEXPLAINED = 0.3
"""Unexplained share (rms) above which the intervals are too narrow."""
_MAX_WHEEL_RMS = 300.0  # largest rms acceleration of a wheel, m/s²: 30 g throughout the drive
_RAIL = 0.1
"""Share of its range by which a sensor may exceed it: data sheets state the guaranteed range, and
converters end a few per cent beyond it."""
MIN_EXCITATION = 5.0
"""Ratio of the rms of a wheel to its noise, below which the drive has no excitation."""


def still_wheel(source: str, channels: Sequence[Channel], still: int, rms: Sequence[float]) -> str:
    """Message that a wheel hardly moved; its sensor is probably dead if the other sensors did.

    Parameters
    ----------
    source : str
        Name of the recording.
    channels : sequence of C Channel
        Its channels.
    still : int
        Index of the channel.
    rms : (C,) sequence of float
        Standard deviations of the channels, SI units.
    """
    channel, shaken = channels[still], rms[still]
    moved = [
        f"the {one.words} did ({other:.2f})"
        for one, other in zip(channels, rms, strict=True)
        if (one.axle, one.side, one.quantity) == (channel.axle, channel.side, channel.quantity)
        and one is not channel
        and other > 2.0 * shaken
    ]
    text = f"the {channel.words} hardly moved in {source} ({shaken:.2f} m/s² rms)"
    if not moved:
        return f"{text}; drive over a bump, a parking stop or a rough road"
    return (
        f"{text}, but {' and '.join(moved)}: its sensor is probably dead, loose or not connected; "
        "check sensor, plug and cable"
    )


def dead_channels(recording: Recording, vehicle: Vehicle, car: CarModel) -> list[str]:
    """Report channels with too few readings.

    Parameters
    ----------
    recording, vehicle : Recording and Vehicle
        Recording and vehicle as read.
    car : CarModel
        Defines the channels that are needed.

    Returns
    -------
    list of str
        One message for each channel without enough readings inside its range.

    Raises
    ------
    InputError
        If a channel that the car needs is missing.
    """
    channels, values, times = used_readings(recording, vehicle, car)
    low, high = rails(values, vehicle, channels)
    good = np.count_nonzero(np.isfinite(values) & ~(low | high), axis=1)
    source = Path(recording.source).name
    reasons = [
        f"the {channel.words} sensor of {source} has {count} readings inside its range; check its "
        "wiring, its column and the range in the vehicle file"
        for channel, count in zip(channels, good, strict=True)
        if count < FEWEST_READINGS
    ]
    if reasons:
        return reasons
    finite = np.isfinite(values)
    inputs = [c for c, channel in enumerate(channels) if channel.is_input]
    first = max(times[c, finite[c]][0] for c in inputs)
    last = min(times[c, finite[c]][-1] for c in inputs)
    for c, channel in enumerate(channels):
        inside = finite[c] & (times[c] >= first) & (times[c] <= last)
        if not channel.is_input and np.count_nonzero(inside) < FEWEST_READINGS:
            reasons.append(
                f"only {np.count_nonzero(inside)} readings of the {channel.words} sensor of "
                f"{source} were taken while the wheels were measured; "
                "check delays, clocks and missing cells, or record longer"
            )
    return reasons


def preflight(vehicle: Vehicle, recording: PreparedRecording) -> tuple[list[str], list[str]]:
    """Check whether a recording is suitable for a fit.

    Parameters
    ----------
    vehicle : Vehicle
        Gives the sensors.
    recording : PreparedRecording
        One recording; the modes of its nominal car determine the necessary length and rate.

    Returns
    -------
    reasons, warnings : lists of str
        Messages; any reason means that the recording is refused.
    """
    reasons: list[str] = []
    warnings: list[str] = []
    modes = nominal_modes(recording.car)
    slowest, fastest = modes[0].natural, modes[-1].natural
    times = recording.times[0]
    rows = len(times)
    duration = float(times[-1] - times[0])
    rate = min(1.0 / _reading_step(recording, c) for c in range(len(recording.channels)))
    needed = max(LEAST_PERIODS / slowest, 0.3)
    if duration < needed or rows < FEWEST_ROWS:
        reasons.append(
            f"{recording.source} is too short: {duration:.2f} s in {rows} rows, and this car needs "
            f"at least {needed:.2f} s and {FEWEST_ROWS} rows; start the recording a second before "
            "the bump and let it run until the car has stopped bouncing"
        )
    mistaken = mistaken_time_unit(recording.source, rate, min_sampling_rate(modes))
    if mistaken:
        return [*reasons, mistaken], warnings
    if rate < min_sampling_rate(modes):
        reasons.append(
            f"{recording.source} was taken at {rate:.0f} Hz, too slow for this car, which moves at "
            f"up to {fastest:.1f} Hz; record at {_round_rate(min_sampling_rate(modes))} Hz or more"
        )
    for c, channel in enumerate(recording.channels):
        clipped = int(np.count_nonzero(recording.clipped[c]))
        missing = _count_missing(recording, c)
        due = int(np.count_nonzero(np.isfinite(recording.values[c]))) + missing
        if _exceeds_range(recording.values[c], vehicle.sensor(channel.name)):
            reasons.append(
                f"the {channel.words} sensor of {recording.source} reads beyond the range that the "
                "vehicle file gives for it, which no sensor does; check the unit of the column, "
                "the scale of the sensor and its range"
            )
        elif clipped > clipping_limit(due):
            reasons.append(
                f"the {channel.words} sensor of {recording.source} was at the end of its range in "
                f"{clipped} of {due} samples; drive slower, take a lower bump or use a sensor "
                "with a wider range"
            )
        elif clipped:
            warnings.append(
                f"{clipped} samples of the {channel.words} sensor of {recording.source} were at "
                "the end of its range and are used as bounds"
            )
        if missing > 0.2 * due:
            reasons.append(
                f"{missing} of {due} readings of the {channel.words} sensor of {recording.source} "
                "are missing; check its wiring and the transfer"
            )
        elif missing:
            warnings.append(
                f"{missing} reading{'s' * (missing > 1)} of the {channel.words} sensor of "
                f"{recording.source} {'are' if missing > 1 else 'is'} missing"
            )
    for wheel, c in zip(recording.wheels, recording.inputs, strict=True):
        name = recording.channels[c].words
        signal = recording.values[c][np.isfinite(recording.values[c])]
        shaken = float(np.std(signal))
        floor = max(recording.noise[c] or 0.0, recording.quantization_steps[c] / np.sqrt(12.0))
        if shaken < MIN_EXCITATION * floor or shaken < 0.05:
            moving = [float(np.std(values[np.isfinite(values)])) for values in recording.values]
            reasons.append(still_wheel(recording.source, recording.channels, c, moving))
        elif shaken > _MAX_WHEEL_RMS:
            reasons.append(
                f"the {name} moves at {shaken:.0f} m/s² rms in {recording.source}, which no car "
                "takes; check the unit of the column and the scale of the sensor"
            )
        largest = float(np.diff(wheel.knots).max())
        if largest > LONGEST_GAP / fastest:
            reasons.append(
                f"the {name} of {recording.source} has a gap of {largest * 1e3:.0f} ms, longer "
                "than this car's motion can be followed across; cut the recording there and give "
                "both parts"
            )
    sides = [e for e, element in enumerate(recording.car.elements) if element.side == "left"]
    if sides and not reasons and all(_move_alike(recording, e) for e in sides):
        reasons.append(
            f"left and right wheels of {recording.source} move alike, so roll is not excited; "
            "drive one side over something before the other, or choose the half car"
        )
    given = [
        vehicle.sensor(channel.name).bandwidth
        for channel in recording.channels
        if channel.quantity == "acceleration"
    ]
    if any(b is None for b in given) and any(b is not None for b in given):
        warnings.append(
            "the vehicle file gives a bandwidth for some sensors only; the others are taken to "
            "be like the slowest of those"
        )
    for c, channel in enumerate(recording.channels):
        sensor = vehicle.sensor(channel.name)
        if not np.isfinite([sensor.low, sensor.high]).any():
            stuck = _stuck_at_extreme(recording.values[c])
            if stuck:
                warnings.append(
                    f"the {channel.words} sensor of {recording.source} stays at its extreme for "
                    f"{stuck} samples in a row, as a sensor at the end of its range does; give its "
                    "range in the vehicle file"
                )
        if sensor.counts_scale_sd > 0.0 and recording.scale_sd[c] == 0.0:
            warnings.append(
                f"the deviation given for the scale of the {channel.words} sensor is not used: "
                f"{recording.source} is not in counts, and the intervals take its scale as exact"
            )
    return reasons, warnings


def mistaken_time_unit(source: str, rate: float, least: float) -> str:
    """Message that time stamps are not in seconds; empty if they may be.

    Parameters
    ----------
    source : str
        Name of the recording.
    rate, least : float
        Sampling rate according to the stamps, and the rate that the car needs, Hz.
    """
    for factor, unit, short in (
        (1e3, "milliseconds", "ms"), (1e6, "microseconds", "us"), (1e9, "nanoseconds", "ns"),
    ):  # fmt: skip
        if rate < _FEW_A_SECOND and least <= factor * rate <= _FASTEST_LOGGER:
            return (
                f"the rows of {source} are {1.0 / rate:.4g} s apart: its time column is probably "
                f"in {unit}, not in seconds; give the unit in its header, time [{short}]"
            )
    return ""


def min_sampling_rate(found: list[VibrationMode]) -> float:
    """Lowest sampling rate for a car with these modes, Hz."""
    return _SAMPLES_A_PERIOD * max(m.natural * (1.0 if m.damped else _REAL) for m in found)


def _move_alike(recording: PreparedRecording, left: int) -> bool:
    """Whether the wheels of an axle differ by little more than their noise."""
    one, other = recording.inputs[left], recording.inputs[left + 1]
    difference = recording.values[one] - recording.values[other]
    rms = float(np.std(difference[np.isfinite(difference)]))
    noise = [
        np.hypot(
            noise_level(recording, c) if (given := recording.noise[c]) is None else given,
            recording.quantization_steps[c] / np.sqrt(12.0),
        )
        for c in (one, other)
    ]
    return rms < MIN_EXCITATION * float(np.hypot(*noise))


def _exceeds_range(readings: NDArray[np.float64], sensor: Sensor) -> bool:
    """Whether readings lie outside a sensor's range by more than `_RAIL` of it."""
    if not np.isfinite([sensor.low, sensor.high]).all():
        return False
    margin = _RAIL * (sensor.high - sensor.low)
    return bool(
        np.nanmin(readings) < sensor.low - margin or np.nanmax(readings) > sensor.high + margin
    )


def _reading_step(recording: PreparedRecording, c: int) -> float:
    """Usual time between two readings of a channel, s, regardless of the rows of other channels."""
    return float(np.median(np.diff(recording.times[c][np.isfinite(recording.values[c])])))


def _count_missing(recording: PreparedRecording, c: int) -> int:
    """Count the missing readings of a channel, at its own rate and where there are rows."""
    with_reading = np.flatnonzero(np.isfinite(recording.values[c]))
    edges = np.concatenate([[-1], with_reading, [recording.values.shape[1]]])
    empty = np.diff(edges) - 1
    times = recording.times[c]
    known = np.concatenate([[times[0]], times[with_reading], [times[-1]]])
    steps = np.diff(known) / _reading_step(recording, c)
    # one step between two readings is not a gap, nor is a part of a step at either end
    missing = np.floor(steps + 1e-6)
    missing[1:-1] = np.round(steps[1:-1]) - 1.0
    missing = np.maximum(missing, 0.0).astype(int)
    return int(np.minimum(empty, missing).sum())


def _stuck_at_extreme(signal: NDArray[np.float64]) -> int:
    """Longest run of samples that repeat the largest or smallest value, if three or more."""
    longest = 0
    for extreme in (np.nanmax(signal), np.nanmin(signal)):
        run = 0
        for same in signal == extreme:
            run = run + 1 if same else 0
            longest = max(longest, run)
    return longest if longest >= 3 else 0


def _round_rate(least: float) -> int:
    """Round up to the next usual rate of a logger."""
    for rate in (50, 100, 200, 400, 800):
        if rate >= least:
            return rate
    return int(np.ceil(least / 100.0) * 100)


Array = NDArray[np.float64]

# Least number of windows: with fewer, two inputs explain a large part of any signal by chance.
FEWEST_WINDOWS = 8

_WINDOWS = 10.0  # number of windows in a recording
_SHORTEST, _LONGEST = 3.0, 8.0  # range of the length of a window, periods of the slowest mode
_HIGHEST = 2.0  # highest band edge that is suggested, in frequencies of the fastest mode
_WORTH = 0.8  # explained share above which a band is suggested
# Ratio of unexplained power to the bound above which the fit is biased by motion outside the band.
_BIASED = 1.5


@dataclass(frozen=True)
class Coherence:
    """Power that no linear relation between wheels and chassis explains, by frequency.

    Parameters
    ----------
    frequency : (F,) array
        Frequencies without zero, Hz.
    power : (F, ny) array
        Power of each output, its unit squared over Hz.
    unexplained_power : (F, ny) array
        Power that no linear relation with the inputs explains.
    windows : float
        Equivalent number of independent windows.
    """

    frequency: Array
    power: Array
    unexplained_power: Array
    windows: float

    def explained(self, low: float, high: float) -> Array:
        """Share (ny,) of the power between two frequencies that the wheels can explain."""
        band = (self.frequency > low) & (self.frequency <= high)
        return np.asarray(
            1.0 - self.unexplained_power[band].sum(axis=0) / self.power[band].sum(axis=0)
        )


def coherence(recording: PreparedRecording, window: float) -> Coherence | None:
    """Multiple coherence of all wheels with each chassis channel.

    Parameters
    ----------
    recording : PreparedRecording
        A recording.
    window : float
        Length of a window, s; its inverse is the resolution.

    Returns
    -------
    Coherence or None
        None if the recording has fewer than :data:`FEWEST_WINDOWS` windows.
    """
    first = max(w.knots[0] for w in recording.wheels)
    last = min(w.knots[-1] for w in recording.wheels)
    rate = 1.0 / recording.reading_step
    time = np.arange(first, last, 1.0 / rate)
    n = int(window * rate)
    starts = np.arange(0, len(time) - n + 1, max(n // 2, 1))
    windows = 0.5 * (len(starts) + 1)  # equivalent number, with an overlap of one half
    if n < 8 or windows < FEWEST_WINDOWS:
        return None
    signals = [w.spline(time) for w in recording.wheels]
    for y in range(len(recording.outputs)):
        use = recording.kind[:, y] == VALUE
        signals.append(np.interp(time, recording.instants[use], recording.reading[use, y]))
    nu = len(recording.wheels)
    pieces = np.stack([np.stack(signals)[:, s : s + n] for s in starts])  # (K, nu + ny, n)
    pieces = pieces - pieces.mean(axis=2, keepdims=True)
    taper = np.hanning(n + 2)[1:-1]
    spectra = np.fft.rfft(pieces * taper)[:, :, 1:]
    cross = np.einsum("kaf,kbf->fab", spectra, spectra.conj())
    cross *= 2.0 / (len(starts) * rate * np.sum(taper**2))
    wheels = cross[:, :nu, :nu]
    power = np.einsum("faa->fa", cross)[:, nu:].real
    across = cross[:, nu:, :nu]
    gain = np.linalg.solve(wheels.transpose(0, 2, 1), across.transpose(0, 2, 1))
    explained = np.einsum("fba,fab->fa", gain, across.conj()).real
    unexplained = np.clip((power - explained) * windows / (windows - nu), 0.0, power)
    frequency = np.asarray(np.fft.rfftfreq(n, 1.0 / rate)[1:], np.float64)
    return Coherence(frequency, power, unexplained, windows)


def suggest_band(recording: PreparedRecording, left: Array, top: float) -> list[str]:
    """Suggest a band if the fit at full band explains too little and the band would explain more.

    Parameters
    ----------
    recording : PreparedRecording
        A recording, prepared at full band.
    left : (ny,) array
        Unexplained share of the power of each output below ``top``.
    top : float
        Upper frequency, Hz.

    Returns
    -------
    list of str
        Message; empty if the fit leaves little more than any linear relation would, if no band is
        suitable, or if the recording is too short.
    """
    modes = nominal_modes(recording.car)  # bands are tried from twice the fastest mode downwards
    slowest, fastest = modes[0].natural, modes[-1].natural
    span = float(recording.times[0, -1] - recording.times[0, 0])
    window = min(span / _WINDOWS, _LONGEST / slowest)
    multiple_coherence = coherence(recording, window) if window * slowest >= _SHORTEST else None
    if multiple_coherence is None:
        return []
    bound = 1.0 - multiple_coherence.explained(0.0, top)
    if not np.any((left > MAX_UNEXPLAINED**2) & (left > _BIASED * bound)):
        return []
    for below in range(int(_HIGHEST * fastest), 0, -1):
        if below < ABOVE_MODES * fastest or too_short(recording, below) is not None:
            break
        share = 100.0 * multiple_coherence.explained(0.0, below)
        if np.all(share >= 100.0 * _WORTH):
            names = enumerated([recording.channels[c].words for c in recording.outputs])
            fitted, best, in_band = (
                enumerated([f"{100.0 * x:.0f}" for x in values])
                for values in (np.clip(1.0 - left, 0.0, 1.0), 1.0 - bound, share / 100.0)
            )
            return [
                f"the fitted {recording.car.name} car explains only {fitted} % of {names} below "
                f"{top:.2g} Hz in {recording.source}, where a linear relation with the wheels "
                f"explains {best} %: what is above drew the fit away; below {below} Hz the wheels "
                f"explain {in_band} %: try 'bayes-asv estimate --below {below}'"
            ]
    return []
