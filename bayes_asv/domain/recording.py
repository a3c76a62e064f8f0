"""A recording: accelerometer channels over time, in the units they were read in.

Nothing is resampled, filtered or filled in here. A missing cell is NaN, a missing row is a step in
time, and the stamps govern; what is known about clocks and delays is applied only when asked for.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bayes_asv.domain.channels import CHANNELS, ROLL_CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import closest
from bayes_asv.domain.units import parse_quantity, si_factor

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bayes_asv.domain.vehicle import Sensor, Vehicle

__all__ = [
    "CHANNELS",
    "COUNTS",
    "ROLL_CHANNELS",
    "Recording",
    "Timing",
    "accelerations",
    "corners_only",
    "declared_rate",
    "half_car_only",
    "nominal_rate",
    "sample_offsets",
    "timing",
]

COUNTS: Final = "counts"
"""Unit of a channel that still is in steps of its converter."""

_LARGEST_CLOCK_PPM: Final = 100_000.0  # a tenth: beyond it the stamps are of another unit
_LARGEST_DELAY: Final = 1.0  # s, as for a vehicle's sensor
_EXAMPLES: Final = {"Hz": "400 Hz", "s": "0.000675 s", "ppm": "48.3 ppm"}
_RATES: Final = (1e-2, 1e7)  # Hz
LARGEST_NUMBER: Final = 1e12
"""No stamp (s) and no reading lies beyond; some loggers mark a missing cell by a huge number."""


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """What was read from one file; arrays are read-only.

    Parameters
    ----------
    time : ndarray of float, shape (N,)
        Stamp of each row, s, strictly increasing, N at least 2.
    values : ndarray of float, shape (C, N)
        Readings in the order of the channels, each in its own unit; NaN where a cell is missing.
    units : tuple of C str
        Unit of each channel, an acceleration or ``"counts"``.
    metadata : tuple of (str, str)
        Keys and values in their order; white space is folded.
    source, sha256 : str
        Name and hash of the file; empty when it was made in memory.
    warnings : tuple of str
        What a reader noticed and a person should know.
    channels : tuple of C str
        `CHANNELS`, or `ROLL_CHANNELS` for a car that rolls.

    Raises
    ------
    InputError
        If shapes, stamps, units or metadata break the above.
    """

    time: NDArray[np.float64]
    values: NDArray[np.float64]
    units: tuple[str, ...]
    metadata: tuple[tuple[str, str], ...] = ()
    source: str = ""
    sha256: str = ""
    warnings: tuple[str, ...] = ()
    channels: tuple[str, ...] = CHANNELS

    def __post_init__(self) -> None:
        where = self.source or "recording"
        time = np.array(self.time, dtype=np.float64, ndmin=1)
        values = np.array(self.values, dtype=np.float64, ndmin=2)
        if time.ndim != 1 or values.shape != (len(self.channels), time.size):
            raise InputError(
                where,
                f"time {time.shape} and values {values.shape} do not match",
                f"give time (N,) and values ({len(self.channels)}, N)",
            )
        if time.size < 2:
            raise InputError(where, f"has {time.size} rows", "a recording needs two at least")
        row = unsorted_row(time)
        if row is not None:
            raise InputError(
                f"{where}: row {row + 1}", "time does not increase", "sort or repair the stamps"
            )
        for numbers, name in ((time, "a stamp"), (values, "a reading")):
            if (np.abs(numbers) > LARGEST_NUMBER).any():
                raise InputError(
                    where, f"{name} is beyond {LARGEST_NUMBER:g}", "leave missing cells as NaN"
                )
        if len(self.units) != len(self.channels):
            raise InputError(where, f"has {len(self.units)} units", "give one a channel")
        for channel, unit in zip(self.channels, self.units, strict=True):
            if unit != COUNTS:
                acceleration_factor(unit, f"{where}: {channel}")
        pairs = tuple((_folded(key), _folded(value)) for key, value in self.metadata)
        for key, _ in pairs:
            if not key or "=" in key:
                raise InputError(f"{where}: # {key}", "is not a key", "use words without '='")
        time.flags.writeable = False
        values.flags.writeable = False
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "units", tuple(self.units))
        object.__setattr__(self, "metadata", pairs)

    def get(self, key: str) -> str | None:
        """Last value of a metadata key, or None."""
        for name, value in reversed(self.metadata):
            if name == key:
                return value
        return None


@dataclass(frozen=True, slots=True)
class Timing:
    """What a recording's metadata say about its clocks.

    Parameters
    ----------
    delay : tuple of C (float or None)
        Sampled this much after the stamp, s; None where the metadata do not say.
    clock : tuple of C float
        How much the channel's clock runs fast, as a ratio (48.3 ppm is 48.3e-6).
    """

    delay: tuple[float | None, ...] = (None,) * 4
    clock: tuple[float, ...] = (0.0,) * 4


def half_car_only(recording: Recording) -> None:
    """Refuse a recording of single corners where a half car is meant.

    Raises
    ------
    InputError
        If its channels are not `CHANNELS`.
    """
    if recording.channels != CHANNELS:
        raise InputError(
            recording.source or "recording",
            f"has {len(recording.channels)} channels, of single corners, and this needs four",
            "use bayes-asv estimate --car roll",
        )


def corners_only(recording: Recording) -> None:
    """Refuse a recording of a half car where one of single corners is meant.

    Raises
    ------
    InputError
        If its channels are not `ROLL_CHANNELS`.
    """
    if recording.channels != ROLL_CHANNELS:
        raise InputError(
            recording.source or "recording",
            "has the four channels of a half car, and a car that rolls needs seven",
            f"give {', '.join(ROLL_CHANNELS)}, or leave out --car roll",
        )


def accelerations(recording: Recording, vehicle: Vehicle) -> NDArray[np.float64]:
    """Return the readings of all channels as accelerations, upward positive.

    Counts become ``(counts - zero_counts) * counts_scale`` of the vehicle's sensor.

    Parameters
    ----------
    recording : Recording
        N rows.
    vehicle : Vehicle
        Needed only for channels in counts.

    Returns
    -------
    ndarray of float, shape (C, N)
        m/s^2 in the order of the recording's channels; NaN where a cell is missing.

    Raises
    ------
    InputError
        If a channel is in counts and the vehicle's file lacks its zero or its scale.
    """
    result = np.empty_like(recording.values)
    for row, (channel, unit) in enumerate(zip(recording.channels, recording.units, strict=True)):
        if unit != COUNTS:
            result[row] = recording.values[row] * si_factor(unit, "acceleration")
            continue
        zero, scale = _count_scale(vehicle, vehicle.sensor(channel), channel)
        result[row] = (recording.values[row] - zero) * scale
    return result


def nominal_rate(recording: Recording) -> float:
    """Rows a second, Hz, from the median step of the stamps: gaps do not move it."""
    return 1.0 / max(float(np.median(np.diff(recording.time))), 1e-300)


def declared_rate(recording: Recording) -> float | None:
    """Rate that the metadata declare (``# sample_rate = 400 Hz``), Hz, or None.

    Raises
    ------
    InputError
        If it is not a rate.
    """
    text = recording.get("sample_rate")
    return None if text is None else parse_rate(text, f"{recording.source}: # sample_rate")


def parse_rate(text: str, where: str) -> float:
    """Read ``"400 Hz"`` or ``"400"``; an `InputError` at `where` if it is not a rate."""
    rate = _quantity(text, "frequency", "Hz", where)
    check_rate(rate, where)
    return rate


def check_rate(rate: float, where: str) -> None:
    """Refuse a rate, Hz, that no logger has."""
    if not _RATES[0] <= rate <= _RATES[1]:
        raise InputError(where, f"{rate:g} Hz is not a rate that is believable", "write 400 Hz")


def timing(recording: Recording) -> Timing:
    """Clocks and delays of the channels, from the metadata.

    ``# delay front_chassis = 0.00044 s`` is the delay of one channel. ``# clock rear = 48.3 ppm``
    says that a clock runs fast; it may name ``front``, ``rear`` (a board with two channels) or one
    channel, and the channel's own entry wins.

    Raises
    ------
    InputError
        If an entry names no channel or is not a delay or a clock.
    """
    channels = recording.channels
    delay: list[float | None] = [None] * len(channels)
    board: dict[str, float] = {}
    own: dict[str, float] = {}
    for key, value in recording.metadata:
        match = re.fullmatch(r"(delay|clock) (.+)", key)
        if match is None:
            continue
        where = f"{recording.source or 'recording'}: # {key}"
        kind, name = match[1], re.sub(r"[\s-]+", "_", match[2].lower())
        names = channels if kind == "delay" else (*channels, "front", "rear")
        if name not in names:
            near = closest(name, names)
            mend = f"did you mean {near}?" if near else f"name one of {', '.join(names)}"
            raise InputError(where, f"there is no channel '{name}'", mend)
        if kind == "delay":
            seconds = _quantity(value, "time", "s", where)
            if abs(seconds) > _LARGEST_DELAY:
                raise InputError(where, f"{seconds:g} s is not believable", "write 0.000675 s")
            delay[channels.index(name)] = seconds
        else:
            ratio = _quantity(value, "dimensionless", "ppm", where)
            if abs(ratio) > _LARGEST_CLOCK_PPM * 1e-6:
                raise InputError(where, f"{ratio * 1e6:g} ppm is not believable", "write 48.3 ppm")
            (own if name in channels else board)[name] = ratio
    clock = tuple(own.get(name, board.get(name.split("_")[0], 0.0)) for name in channels)
    return Timing(tuple(delay), clock)


def sample_offsets(recording: Recording, vehicle: Vehicle) -> NDArray[np.float64]:
    """Time at which each reading was really taken.

    With t the stamp, t_0 the first one, e how much the channel's clock runs fast and d its delay,
    the reading belongs to t_0 + (t - t_0) / (1 + e) + d. The recording's metadata come before the
    vehicle's delays: two boards have two clocks.

    Parameters
    ----------
    recording : Recording
        N rows.
    vehicle : Vehicle
        Its sensors' delays hold where the metadata name none.

    Returns
    -------
    ndarray of float, shape (C, N)
        s, in the order of the recording's channels.

    Raises
    ------
    InputError
        As for `timing`.
    """
    said = timing(recording)
    start = recording.time[0]
    result = np.empty_like(recording.values)
    for row, channel in enumerate(recording.channels):
        sensor = vehicle.sensor(channel)
        own = said.delay[row]
        delay = sensor.delay if own is None else own
        # An ideal clock leaves its stamps as they are, to the last bit.
        elapsed = (
            recording.time
            if said.clock[row] == 0.0
            else (start + (recording.time - start) / (1.0 + said.clock[row]))
        )
        result[row] = elapsed + delay
    return result


def acceleration_factor(unit: str, where: str) -> float:
    """`si_factor` of an acceleration, its fault told at `where`."""
    try:
        return si_factor(unit, "acceleration")
    except InputError as exc:
        raise InputError(where, f"{exc.where} {exc.what}", f"{exc.mend}, or counts") from None


def unsorted_row(time: NDArray[np.float64]) -> int | None:
    """Index of the first stamp that is not finite or not after the one before it."""
    good = np.isfinite(time)
    good[1:] &= time[1:] > time[:-1]
    return None if good.all() else int(np.argmin(good))


def _count_scale(vehicle: Vehicle, sensor: Sensor, channel: str) -> tuple[float, float]:
    where = f"{vehicle.source or vehicle.name or 'vehicle'}: [sensors.{channel}]"
    if sensor.zero_counts is None:
        raise InputError(
            where, "has no zero_counts and the recording is in counts", "add zero_counts = 512"
        )
    if sensor.counts_scale is None:
        raise InputError(
            where,
            "has no counts_scale and the recording is in counts",
            'add counts_scale = { value = 5.945, unit = "in/s^2" }',
        )
    return sensor.zero_counts, sensor.counts_scale


def _quantity(text: str, dimension: str, usual: str, where: str) -> float:
    """Read a number in SI from ``"400 Hz"``, or from ``"400"`` in the usual unit."""
    try:
        number, unit = parse_quantity(text)
    except InputError as exc:
        what = f"{exc.where} {exc.what}"
        raise InputError(where, what, f"write it as {_EXAMPLES[usual]}") from None
    try:
        return number * si_factor(unit or usual, dimension)
    except InputError as exc:
        raise InputError(where, f"{exc.where} {exc.what}", exc.mend) from None


def _folded(text: str) -> str:
    """One line, single spaces: what a metadata line can hold and give back."""
    return " ".join("".join(ch if ch.isprintable() else " " for ch in text).split())
