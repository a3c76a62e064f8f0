"""Checks of recordings before anything is fitted, with reasons in words.

Whatever a linear relation between all wheels and one chassis channel leaves over, no car
explains either: multiple coherence bounds every linear model from above (Bendat & Piersol,
Random Data, 2010, ch. 7).  Spectra are averaged over windows (Welch 1967); K windows and two
inputs leave (K − 2)/K of the rest on average, which is made good.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import Channel
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Sensor, Vehicle
from bayes_asv.filters.kalman import VALUE
from bayes_asv.models.car_model import CarModel
from bayes_asv.models.modes import VibrationMode, nominal_modes
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
    "FEWEST_ROWS",
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

LEAST_PERIODS = 1.0  # of the slowest mode that a record must last
_SAMPLES_A_PERIOD = 12.0  # of the fastest mode
_REAL = 0.5  # of that for a mode that does not oscillate: 5 were enough for poles of 18 to 32 Hz
_FEW_A_SECOND = 2.5  # rows: fewer than any logger of accelerations takes
_FASTEST_LOGGER = 20e3  # Hz
FEWEST_ROWS = 100  # rows
MAX_UNEXPLAINED = 0.3
"""Share left over (rms) beyond which the intervals are too good to be true."""
_MAX_WHEEL_RMS = 300.0  # m/s² rms of a wheel: 30 g for as long as the drive lasts
_RAIL = 0.1
"""Share of its range by which a sensor may exceed it: data sheets state the range that is assured,
and converters end a few per cent beyond it."""
MIN_EXCITATION = 5.0
"""Wheel rms in units of its noise, below which nothing was driven over."""


def still_wheel(source: str, channels: Sequence[Channel], still: int, rms: Sequence[float]) -> str:
    """Say that a wheel was still and what to do; its sensor is dead if the body above it moved.

    Parameters
    ----------
    source : str
        Name of the recording.
    channels : sequence of C Channel
        Its channels.
    still : int
        Which of them.
    rms : (C,) sequence of float
        Root mean squares of the channels about their means, SI units.
    """
    own, shaken = channels[still], rms[still]
    moved = [
        f"the {one.words} did ({other:.2f})"
        for one, other in zip(channels, rms, strict=True)
        if (one.axle, one.side, one.quantity) == (own.axle, own.side, own.quantity)
        and one is not own
        and other > 2.0 * shaken
    ]
    said = f"the {own.words} hardly moved in {source} ({shaken:.2f} m/s² rms)"
    if not moved:
        return f"{said}; drive over a bump, a parking stop or a rough road"
    return (
        f"{said}, but {' and '.join(moved)}: its sensor is probably dead, loose or not connected; "
        "check sensor, plug and cable"
    )


def dead_channels(recording: Recording, vehicle: Vehicle, car: CarModel) -> list[str]:
    """Name channels with too few readings to work with.

    Parameters
    ----------
    recording, vehicle : Recording and Vehicle
        As read.
    car : CarModel
        Says which channels it needs.

    Returns
    -------
    list of str
        One reason a channel without enough readings inside its range.

    Raises
    ------
    InputError
        When a channel that the car needs is missing.
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
    there = np.isfinite(values)
    inputs = [c for c, channel in enumerate(channels) if channel.is_input]
    first = max(times[c, there[c]][0] for c in inputs)
    last = min(times[c, there[c]][-1] for c in inputs)
    for c, channel in enumerate(channels):
        inside = there[c] & (times[c] >= first) & (times[c] <= last)
        if not channel.is_input and np.count_nonzero(inside) < FEWEST_READINGS:
            reasons.append(
                f"only {np.count_nonzero(inside)} readings of the {channel.words} sensor of "
                f"{source} were taken while the wheels were measured; "
                "check delays, clocks and missing cells, or record longer"
            )
    return reasons


def preflight(vehicle: Vehicle, recording: PreparedRecording) -> tuple[list[str], list[str]]:
    """Look for what would make an answer worthless.

    Parameters
    ----------
    vehicle : Vehicle
        Gives the sensors.
    recording : PreparedRecording
        One recording; the modes of its nominal car say how long and how fast one must measure.

    Returns
    -------
    reasons, warnings : lists of str
        Sentences; any reason means that the recording is refused.
    """
    reasons: list[str] = []
    warnings: list[str] = []
    found = nominal_modes(recording.car)
    slowest, fastest = found[0].natural, found[-1].natural
    times = recording.times[0]
    rows = len(times)
    duration = float(times[-1] - times[0])
    rate = min(1.0 / _own_step(recording, c) for c in range(len(recording.channels)))
    needed = max(LEAST_PERIODS / slowest, 0.3)
    if duration < needed or rows < FEWEST_ROWS:
        reasons.append(
            f"{recording.source} is too short: {duration:.2f} s in {rows} rows, and this car needs "
            f"at least {needed:.2f} s and {FEWEST_ROWS} rows; start the recording a second before "
            "the bump and let it run until the car has stopped bouncing"
        )
    mistaken = mistaken_time_unit(recording.source, rate, min_sampling_rate(found))
    if mistaken:
        return [*reasons, mistaken], warnings
    if rate < min_sampling_rate(found):
        reasons.append(
            f"{recording.source} was taken at {rate:.0f} Hz, too slow for this car, which moves at "
            f"up to {fastest:.1f} Hz; record at {_round_rate(min_sampling_rate(found))} Hz or more"
        )
    for c, channel in enumerate(recording.channels):
        clipped = int(np.count_nonzero(recording.clipped[c]))
        missing = _missing(recording, c)
        due = int(np.count_nonzero(np.isfinite(recording.values[c]))) + missing
        if _beyond_range(recording.values[c], vehicle.sensor(channel.name)):
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
    if sides and not reasons and all(_alike(recording, e) for e in sides):
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
    """Say that stamps were taken for seconds and are not; empty where they may be.

    Parameters
    ----------
    source : str
        Name of the recording.
    rate, least : float
        Rows a second by the stamps, and those that the car needs.
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
    """Rows a second below which a car of these modes moves between the samples."""
    return _SAMPLES_A_PERIOD * max(m.natural * (1.0 if m.damped else _REAL) for m in found)


def _alike(recording: PreparedRecording, left: int) -> bool:
    """Whether the wheels of an axle differ by little more than their noise."""
    one, other = recording.inputs[left], recording.inputs[left + 1]
    apart = recording.values[one] - recording.values[other]
    rms = float(np.std(apart[np.isfinite(apart)]))
    noise = [
        np.hypot(
            noise_level(recording, c) if (given := recording.noise[c]) is None else given,
            recording.quantization_steps[c] / np.sqrt(12.0),
        )
        for c in (one, other)
    ]
    return rms < MIN_EXCITATION * float(np.hypot(*noise))


def _beyond_range(readings: NDArray[np.float64], sensor: Sensor) -> bool:
    """Whether readings lie outside a sensor's range by more than `_RAIL` of it."""
    if not np.isfinite([sensor.low, sensor.high]).all():
        return False
    margin = _RAIL * (sensor.high - sensor.low)
    return bool(
        np.nanmin(readings) < sensor.low - margin or np.nanmax(readings) > sensor.high + margin
    )


def _own_step(recording: PreparedRecording, c: int) -> float:
    """Usual time between two readings of a channel, s; rows of other channels do not count."""
    return float(np.median(np.diff(recording.times[c][np.isfinite(recording.values[c])])))


def _missing(recording: PreparedRecording, c: int) -> int:
    """Count the readings that a channel lacks at its own rate, where there are rows for them."""
    there = np.flatnonzero(np.isfinite(recording.values[c]))
    edges = np.concatenate([[-1], there, [recording.values.shape[1]]])
    empty = np.diff(edges) - 1
    times = recording.times[c]
    known = np.concatenate([[times[0]], times[there], [times[-1]]])
    steps = np.diff(known) / _own_step(recording, c)
    # between two readings one step is no gap; a channel that begins or ends a part of a step apart
    # from the others lacks nothing
    lacking = np.floor(steps + 1e-6)
    lacking[1:-1] = np.round(steps[1:-1]) - 1.0
    lacking = np.maximum(lacking, 0.0).astype(int)
    return int(np.minimum(empty, lacking).sum())


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
    """Round up to the next rate a logger offers."""
    for rate in (50, 100, 200, 400, 800):
        if rate >= least:
            return rate
    return int(np.ceil(least / 100.0) * 100)


Array = NDArray[np.float64]

FEWEST_WINDOWS = 8  # below it two inputs explain a good part of anything

_WINDOWS = 10.0  # in a recording
_SHORTEST, _LONGEST = 3.0, 8.0  # periods of the slowest mode in a window
_HIGHEST = 2.0  # times the fastest mode: all that the car is about lies below
_WORTH = 0.8  # share explained that makes a band worth a try
_DRAWN = 1.5  # times the bound: a car that leaves more was fitted to something else


@dataclass(frozen=True)
class Coherence:
    """What any linear relation between wheels and chassis leaves over, by frequency.

    Parameters
    ----------
    frequency : (F,) array
        Hz, without zero.
    power : (F, ny) array
        Power of each output, its unit squared over Hz.
    unexplained_power : (F, ny) array
        Power that no linear relation with the inputs explains.
    windows : float
        Number of independent windows it stands on.
    """

    frequency: Array
    power: Array
    unexplained_power: Array
    windows: float

    def explained(self, low: float, high: float) -> Array:
        """Share (ny,) of the power from one frequency to another that the wheels can explain."""
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
        Length of a window, s: its inverse is the resolution.

    Returns
    -------
    Coherence or None
        None when the recording has not :data:`FEWEST_WINDOWS` windows.
    """
    first = max(w.knots[0] for w in recording.wheels)
    last = min(w.knots[-1] for w in recording.wheels)
    rate = 1.0 / recording.reading_step
    time = np.arange(first, last, 1.0 / rate)
    n = int(window * rate)
    starts = np.arange(0, len(time) - n + 1, max(n // 2, 1))
    windows = 0.5 * (len(starts) + 1)  # overlapping halves are worth about that many
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
    met = np.einsum("fba,fab->fa", gain, across.conj()).real
    left = np.clip((power - met) * windows / (windows - nu), 0.0, power)
    frequency = np.asarray(np.fft.rfftfreq(n, 1.0 / rate)[1:], np.float64)
    return Coherence(frequency, power, left, windows)


def suggest_band(recording: PreparedRecording, left: Array, top: float) -> list[str]:
    """Say why a fit at full band explains too little, where a band would explain more.

    Parameters
    ----------
    recording : PreparedRecording
        A recording, laid out at full band.
    left : (ny,) array
        Share of the power of each output below ``top`` that the fitted car leaves.
    top : float
        Hz.

    Returns
    -------
    list of str
        Empty when the fit leaves little more than any linear relation would, when no band is
        worth a try, or when the recording is too short to tell.
    """
    found = nominal_modes(recording.car)  # where to look: from twice the fastest one downwards
    slowest, fastest = found[0].natural, found[-1].natural
    span = float(recording.times[0, -1] - recording.times[0, 0])
    window = min(span / _WINDOWS, _LONGEST / slowest)
    seen = coherence(recording, window) if window * slowest >= _SHORTEST else None
    if seen is None:
        return []
    bound = 1.0 - seen.explained(0.0, top)
    if not np.any((left > MAX_UNEXPLAINED**2) & (left > _DRAWN * bound)):
        return []
    for below in range(int(_HIGHEST * fastest), 0, -1):
        if below < ABOVE_MODES * fastest or too_short(recording, below) is not None:
            break
        share = 100.0 * seen.explained(0.0, below)
        if np.all(share >= 100.0 * _WORTH):
            names = _listed([recording.channels[c].words for c in recording.outputs])
            fitted, best, in_band = (
                _listed([f"{100.0 * x:.0f}" for x in values])
                for values in (np.clip(1.0 - left, 0.0, 1.0), 1.0 - bound, share / 100.0)
            )
            return [
                f"the fitted {recording.car.name} car explains only {fitted} % of {names} below "
                f"{top:.2g} Hz in {recording.source}, where a linear relation with the wheels "
                f"explains {best} %: what is above drew the fit away; below {below} Hz the wheels "
                f"explain {in_band} %: try --below {below}"
            ]
    return []


def _listed(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
