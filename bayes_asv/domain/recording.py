"""A recording: channels over time, in the units of the file.

Nothing is resampled, filtered or interpolated here.  A missing cell is NaN and a missing row is a
larger time step.  `sample_times` applies the clocks and delays of the channels.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bayes_asv.domain.channels import CHANNELS, KNOWN_CHANNELS, ROLL_CHANNELS
from bayes_asv.domain.channels import channel as known_channel
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import closest
from bayes_asv.domain.units import parse_quantity, si_factor

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bayes_asv.domain.vehicle import Sensor, Vehicle

__all__ = [
    "CHANNELS",
    "COUNTS",
    "COUNT_UNITS",
    "MAX_SAMPLES",
    "ROLL_CHANNELS",
    "Recording",
    "Timing",
    "accelerations",
    "check_unit",
    "declared_rate",
    "nominal_rate",
    "require_half_car",
    "sample_times",
    "timing",
]

COUNTS: Final = "counts"
"""Unit of a channel in counts of its analogue-to-digital converter."""
COUNT_UNITS: Final = frozenset({"counts", "count", "raw", "lsb", "bits"})
"""Words for it in files, in small letters."""

_MAX_CLOCK_PPM: Final = 100_000.0  # 10 %: beyond it the unit of the stamps is wrong
_MAX_DELAY: Final = 1.0  # s, as for a vehicle's sensor
_EXAMPLES: Final = {"Hz": "400 Hz", "s": "0.000675 s", "ppm": "48.3 ppm"}
_RATE_RANGE: Final = (1e-2, 1e7)  # Hz
MAX_MAGNITUDE: Final = 1e12
"""Largest accepted stamp, s, or reading: some loggers mark missing cells by huge numbers."""
MAX_SAMPLES: Final = 50_000_000
"""Largest number of readings of one file, over all channels: 800 MB with their stamps."""


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """The content of one recording file; its arrays are read-only.

    Parameters
    ----------
    time : ndarray of float, shape (N,)
        Stamp of each row, s, strictly increasing, N at least 2.
    values : ndarray of float, shape (C, N)
        Readings in the order of the channels, each in its own unit; NaN where a cell is missing.
    units : tuple of C str
        Unit of each channel, of its dimension or ``"counts"``.
    metadata : tuple of (str, str)
        Keys and values in the order of the file, white space collapsed.
    source, sha256 : str
        Name and hash of the file; empty for a recording made in memory.
    warnings : tuple of str
        Oddities that the reader accepted.
    channels : tuple of C str
        Names of the channels; by default the four accelerometers of the half car.

    Raises
    ------
    InputError
        If shapes, stamps, units or metadata violate the above, or if the stamps span more time
        than `MAX_SAMPLES` readings at the recording's own rate would fill.
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
            raise InputError(where, f"has {time.size} rows", "a recording needs at least two")
        row = first_unsorted_row(time)
        if row is not None:
            raise InputError(
                f"{where}: row {row + 1}", "time does not increase", "sort or repair the stamps"
            )
        for numbers, name in ((time, "a stamp"), (values, "a reading")):
            if (np.abs(numbers) > MAX_MAGNITUDE).any():
                raise InputError(
                    where, f"{name} is beyond {MAX_MAGNITUDE:g}", "leave missing cells as NaN"
                )
        _check_span(time, values, where)
        if len(self.units) != len(self.channels):
            raise InputError(where, f"has {len(self.units)} units", "give one per channel")
        for channel, unit in zip(self.channels, self.units, strict=True):
            check_unit(channel, unit, f"{where}: {channel}")
        pairs = tuple(
            (_collapse_whitespace(key), _collapse_whitespace(value)) for key, value in self.metadata
        )
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
        """Return the last value of a metadata key, or None."""
        for name, value in reversed(self.metadata):
            if name == key:
                return value
        return None


@dataclass(frozen=True, slots=True)
class Timing:
    """Clocks and delays of the channels according to the metadata.

    Parameters
    ----------
    delay : tuple of C (float or None)
        Delay of the sample after the stamp, s; None where the metadata give none.
    clock : tuple of C float
        Relative rate error of the channel's clock, positive when fast (48.3 ppm is 48.3e-6).
    """

    delay: tuple[float | None, ...] = (None,) * 4
    clock: tuple[float, ...] = (0.0,) * 4


def require_half_car(recording: Recording) -> None:
    """Check that a recording has the four accelerations of the half car and no other channel.

    Raises
    ------
    InputError
        If its channels are not `CHANNELS`.
    """
    if recording.channels == CHANNELS:
        return
    source = recording.source or "recording"
    if recording.channels == ROLL_CHANNELS:
        raise InputError(
            source, "has the seven channels of the roll car, but four are needed",
            "use bayes-asv estimate --car roll",
        )  # fmt: skip
    missing = [name for name in CHANNELS if name not in recording.channels]
    others = [name for name in recording.channels if name not in CHANNELS]
    if missing:
        raise InputError(
            source, f"lacks the channel {missing[0]}, which is needed here",
            "record it, or use bayes-asv estimate",
        )  # fmt: skip
    raise InputError(
        source, f"has the channel {others[0]}, which is not used here",
        f"keep {', '.join(CHANNELS)} only, or use bayes-asv estimate",
    )  # fmt: skip


def accelerations(recording: Recording, vehicle: Vehicle) -> NDArray[np.float64]:
    """Convert the readings of all channels to SI units.

    A reading in counts becomes ``(counts - zero_counts) * counts_scale`` of the vehicle's sensor.

    Parameters
    ----------
    recording : Recording
        N rows.
    vehicle : Vehicle
        Used for channels in counts only.

    Returns
    -------
    ndarray of float, shape (C, N)
        m/s^2, m or rad/s, in the order of the recording's channels; NaN where a cell is missing.

    Raises
    ------
    InputError
        If a channel is in counts and the vehicle file lacks its zero or its scale.
    """
    result = np.empty_like(recording.values)
    for row, (channel, unit) in enumerate(zip(recording.channels, recording.units, strict=True)):
        if unit != COUNTS:
            result[row] = recording.values[row] * si_factor(unit, known_channel(channel).dimension)
            continue
        zero, scale = _zero_and_scale(vehicle, vehicle.sensor(channel), channel)
        result[row] = (recording.values[row] - zero) * scale
    return result


def nominal_rate(recording: Recording) -> float:
    """Return the sampling rate of the fastest channel, Hz.

    It comes from the median time step, which gaps do not change.  Channels of different rates have
    rows of their own, so that the rows together say nothing about a rate.
    """
    return _fastest_rate(recording.time, recording.values)


def declared_rate(recording: Recording) -> float | None:
    """Return the sampling rate declared in the metadata (``# sample_rate = 400 Hz``), Hz, or None.

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
    """Check that a sampling rate, Hz, is plausible."""
    if not _RATE_RANGE[0] <= rate <= _RATE_RANGE[1]:
        raise InputError(where, f"{rate:g} Hz is not a plausible sampling rate", "write 400 Hz")


def timing(recording: Recording) -> Timing:
    """Read the clocks and delays of the channels from the metadata.

    ``# delay front_chassis = 0.00044 s`` is the delay of one channel.  ``# clock rear = 48.3 ppm``
    gives the rate error of a clock that runs fast, of the board ``front`` or ``rear`` or of one
    channel; the entry of a channel takes precedence over that of its board.

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
            fix = f"did you mean {near}?" if near else f"name one of {', '.join(names)}"
            raise InputError(where, f"there is no channel '{name}'", fix)
        if kind == "delay":
            seconds = _quantity(value, "time", "s", where)
            if abs(seconds) > _MAX_DELAY:
                raise InputError(
                    where, f"{seconds:g} s is not a plausible delay", "write 0.000675 s"
                )
            delay[channels.index(name)] = seconds
        else:
            ratio = _quantity(value, "dimensionless", "ppm", where)
            if abs(ratio) > _MAX_CLOCK_PPM * 1e-6:
                raise InputError(
                    where, f"{ratio * 1e6:g} ppm is not a plausible clock error", "write 48.3 ppm"
                )
            (own if name in channels else board)[name] = ratio
    clock = tuple(own.get(name, board.get(name.split("_")[0], 0.0)) for name in channels)
    return Timing(tuple(delay), clock)


def sample_times(recording: Recording, vehicle: Vehicle) -> NDArray[np.float64]:
    """Time at which each reading was sampled.

    With t the stamp, t_0 the first stamp, e the relative rate error of the channel's clock and d
    its delay, the sample time is t_0 + (t - t_0) / (1 + e) + d.  Delays in the recording's metadata
    take precedence over those of the vehicle file.

    Parameters
    ----------
    recording : Recording
        N rows.
    vehicle : Vehicle
        Its sensors' delays apply where the metadata give none.

    Returns
    -------
    ndarray of float, shape (C, N)
        s, in the order of the recording's channels.

    Raises
    ------
    InputError
        As for `timing`.
    """
    declared = timing(recording)
    start = recording.time[0]
    result = np.empty_like(recording.values)
    for row, channel in enumerate(recording.channels):
        sensor = vehicle.sensor(channel)
        own = declared.delay[row]
        delay = sensor.delay if own is None else own
        # An ideal clock leaves the stamps unchanged to the last bit.
        elapsed = (
            recording.time
            if declared.clock[row] == 0.0
            else (start + (recording.time - start) / (1.0 + declared.clock[row]))
        )
        result[row] = elapsed + delay
    return result


def check_unit(name: str, unit: str, where: str) -> None:
    """Check that a unit is one of the channel's quantity, or counts.

    Raises
    ------
    InputError
        At `where`, if it is not, or if there is no such channel.
    """
    try:
        dimension = known_channel(name).dimension
    except KeyError:
        raise InputError(
            where, "is no channel", f"name one of {', '.join(KNOWN_CHANNELS)}"
        ) from None
    if unit == COUNTS:
        return
    try:
        si_factor(unit, dimension)
    except InputError as exc:
        raise InputError(where, f"{exc.where} {exc.what}", f"{exc.fix}, or counts") from None


def acceleration_factor(unit: str, where: str) -> float:
    """Return `si_factor` of an acceleration unit, with errors reported at `where`."""
    try:
        return si_factor(unit, "acceleration")
    except InputError as exc:
        raise InputError(where, f"{exc.where} {exc.what}", f"{exc.fix}, or counts") from None


def first_unsorted_row(time: NDArray[np.float64]) -> int | None:
    """Index of the first stamp that is not finite or does not exceed its predecessor."""
    good = np.isfinite(time)
    good[1:] &= time[1:] > time[:-1]
    return None if good.all() else int(np.argmin(good))


def _fastest_rate(time: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Rate of the channel (C, N) with the smallest median step, Hz."""
    steps = [
        float(np.median(np.diff(time[there])))
        for there in np.isfinite(values)
        if np.count_nonzero(there) > 1
    ]
    return 1.0 / max(min(steps, default=0.0), 1e-300)


def _check_span(time: NDArray[np.float64], values: NDArray[np.float64], where: str) -> None:
    """Check that the readings that would fill the recording's span fit into memory.

    Spectra, filters and events take a recording on an even grid at its own rate, gaps included.  A
    single stamp in another unit would make that grid thousands of times longer than the file.
    """
    span, steps = float(time[-1] - time[0]), np.diff(time)
    most = MAX_SAMPLES / len(values)
    if span <= most * float(steps.min()):  # the median step is no smaller
        return
    rate = _fastest_rate(time, values)
    if rate < 1e300 and span * rate > most:
        row = int(np.argmax(steps)) + 1
        raise InputError(
            f"{where}: row {row + 1}",
            f"comes {steps[row - 1]:.6g} s after the row before, in a recording that lasts "
            f"{span:.6g} s at {rate:.6g} Hz",
            "check its stamp and the unit of the time column, or cut the recording there",
        )


def _zero_and_scale(vehicle: Vehicle, sensor: Sensor, channel: str) -> tuple[float, float]:
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


def _quantity(text: str, dimension: str, default_unit: str, where: str) -> float:
    """Read ``"400 Hz"``, or ``"400"`` in the default unit, in SI."""
    try:
        number, unit = parse_quantity(text)
    except InputError as exc:
        what = f"{exc.where} {exc.what}"
        raise InputError(where, what, f"write it as {_EXAMPLES[default_unit]}") from None
    try:
        return number * si_factor(unit or default_unit, dimension)
    except InputError as exc:
        raise InputError(where, f"{exc.where} {exc.what}", exc.fix) from None


def _collapse_whitespace(text: str) -> str:
    """Reduce to one line with single spaces, the form that survives writing and reading."""
    return " ".join("".join(ch if ch.isprintable() else " " for ch in text).split())
