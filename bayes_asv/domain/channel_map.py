"""A channel map: which column of a foreign log is which channel of the car, and in what scale.

The value of a channel is ``sign · scale · (Σ axis_k · reading_k − offset)`` in ``unit``, or what
``curve`` gives for the sum; a damper's travel is divided by the ``motion_ratio`` to give that of
the wheel.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bayes_asv.domain.channels import KNOWN_CHANNELS, channel
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import closest, read_bytes
from bayes_asv.domain.recording import COUNT_UNITS, COUNTS, Recording
from bayes_asv.domain.units import si_factor, si_unit

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from bayes_asv.domain.files import PathLike
    from bayes_asv.domain.log import Log, LoggedChannel

__all__ = ["ChannelMap", "MappedChannel", "find_column", "read_channel_map"]

_MAX_FILE_SIZE: Final = 1_000_000
_SAME_STAMP: Final = 1e-7
"""Stamps closer than this, s, are one: rounding of k/rate to text and back moves them by less."""
_MAX_LISTED: Final = 12
_GRID: Final = 2001  # points of the integral of a motion ratio: its error is 1e-7 of the travel


@dataclass(frozen=True, slots=True)
class MappedChannel:
    """Where the readings of one channel come from.

    Parameters
    ----------
    channel : str
        Name of the channel, one of ``KNOWN_CHANNELS``.
    columns : tuple of str
        Names in the file, at least one.
    group : str
        Device or table of the columns, where names repeat; empty for any.
    unit : str
        Unit of the value; empty for the unit that the file states.
    axis : tuple of float
        Weight of each column: for three axes of one sensor the direction of *up*, for the left and
        the right sensor of an axle a half each.  Empty for ones.
    offset : float
        Reading, or weighted sum of readings, where the quantity is zero: at rest, gravity included.
    scale : float
        Value per reading, in ``unit``; negative for a sensor that is mounted upside down.
    curve : tuple of (float, float)
        Readings and values in ``unit`` instead of ``offset`` and ``scale``, readings increasing.
    motion_ratio : float or tuple of (float, float)
        Travel of the damper over that of the wheel; or pairs of wheel travel from rest (m,
        extension positive, increasing) and the ratio there.
    delay : float or None
        Delay of the sample after its stamp, s; None for that of the vehicle file.
    position : float or None
        Place of the sensor on the body, m ahead of the rear axle.
    """

    channel: str
    columns: tuple[str, ...]
    group: str = ""
    unit: str = ""
    axis: tuple[float, ...] = ()
    offset: float = 0.0
    scale: float = 1.0
    curve: tuple[tuple[float, float], ...] = ()
    motion_ratio: float | tuple[tuple[float, float], ...] = 1.0
    delay: float | None = None
    position: float | None = None

    def __post_init__(self) -> None:
        where = f"[channels.{self.channel}]"
        if self.channel not in KNOWN_CHANNELS:
            near = closest(self.channel, KNOWN_CHANNELS)
            fix = f"did you mean {near}?" if near else f"channels are {', '.join(KNOWN_CHANNELS)}"
            raise InputError(where, "there is no such channel", fix)
        if not self.columns:
            raise InputError(where, "names no column", 'add column = "name in the file"')
        if self.axis and len(self.axis) != len(self.columns):
            raise InputError(
                where, f"has {len(self.columns)} columns and {len(self.axis)} numbers in axis",
                "give one number for each column",
            )  # fmt: skip
        if self.axis and not any(self.axis):
            raise InputError(where, "axis is zero", "give the direction of up, such as [0, 0, 1]")
        if self.scale == 0.0:
            raise InputError(where, "scale is zero", "give the value per reading")
        if self.curve and (self.offset or abs(self.scale) != 1.0):
            raise InputError(
                where, "has a curve beside offset or scale", "leave out the curve, or the others"
            )
        readings = [reading for reading, _ in self.curve]
        if self.curve and (len(readings) < 2 or any(np.diff(readings) <= 0.0)):
            raise InputError(
                where, "curve needs two readings or more, in increasing order",
                "write curve = [[reading, value], [reading, value]]",
            )  # fmt: skip
        self._check_motion_ratio(where)

    def _check_motion_ratio(self, where: str) -> None:
        ratio = self.motion_ratio
        if ratio != 1.0 and channel(self.channel).quantity != "deflection":
            raise InputError(
                where, "has a motion ratio, which a travel sensor alone has", "leave it out"
            )
        ratios = (ratio,) if isinstance(ratio, float) else tuple(value for _, value in ratio)
        travels = () if isinstance(ratio, float) else tuple(travel for travel, _ in ratio)
        if not ratios or not all(value > 0.0 for value in ratios):
            raise InputError(
                where, "motion_ratio is not above zero",
                "give the travel of the damper over that of the wheel, such as 0.6",
            )  # fmt: skip
        if travels and (len(travels) < 2 or any(np.diff(travels) <= 0.0)):
            raise InputError(
                where, "motion_ratio needs two travels or more, in increasing order",
                "write motion_ratio = { travel = [-40, 40], ratio = [0.55, 0.62], unit = \"mm\" }",
            )  # fmt: skip


@dataclass(frozen=True, slots=True)
class ChannelMap:
    """The channels of the car in a foreign log.

    Parameters
    ----------
    channels : tuple of MappedChannel
        At least one, each channel once.
    rate : float or None
        Sampling rate of a file without stamps, Hz.
    source : str
        File it was read from, for messages.
    """

    channels: tuple[MappedChannel, ...]
    rate: float | None = None
    source: str = "channel map"

    def __post_init__(self) -> None:
        names = [one.channel for one in self.channels]
        if not names:
            raise InputError(
                self.source, "maps no channel", "add a table such as [channels.front_wheel]"
            )
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"{self.source}: {name}", "is mapped twice", "keep one of them")
        ordered = sorted(self.channels, key=lambda one: KNOWN_CHANNELS.index(one.channel))
        object.__setattr__(self, "channels", tuple(ordered))

    @classmethod
    def from_names(cls, columns: Mapping[str, str]) -> ChannelMap:
        """Make a map of names alone: ``{"front_wheel": "Acc FL Z", …}``."""
        return cls(tuple(MappedChannel(name, (column,)) for name, column in columns.items()))

    @property
    def by_name(self) -> Mapping[str, MappedChannel]:
        """The mapped channels by the name of the channel."""
        return {one.channel: one for one in self.channels}

    def to_toml(self) -> str:
        """Return the text of a channel map that reads back as this one."""
        from bayes_asv.domain.vehicle_writer import channel_table

        lines = [] if self.rate is None else [f'rate = "{self.rate!r} Hz"', ""]
        for one in self.channels:
            position = "" if one.position is None else f'position = "{one.position!r} m"'
            lines += [*channel_table(one.channel, one, position), ""]
        return "\n".join(lines)

    def recording(self, log: Log) -> Recording:
        """Return the mapped channels of a log as a recording.

        Channels of different rates keep their own stamps: the recording has a row for each stamp of
        any channel, and NaN where a channel was not read at it.

        Parameters
        ----------
        log : Log
            As its reader returns it.

        Returns
        -------
        Recording
            In SI units, or in counts.

        Raises
        ------
        InputError
            If a column is missing, or its unit is not one of the channel's quantity.
        """
        notes = list(log.warnings)
        mapped = [self._values(one, log, notes) for one in self.channels]
        stamps = np.unique(np.concatenate([time for time, _, _ in mapped]))
        stamps = stamps[np.diff(stamps, prepend=-math.inf) > _SAME_STAMP]
        values = np.full((len(mapped), stamps.size), np.nan)
        for row, (time, readings, _) in enumerate(mapped):
            values[row, np.searchsorted(stamps, time + _SAME_STAMP, side="right") - 1] = readings
        metadata = [
            (key, value)
            for key, value in log.metadata
            if "=" not in key and not key.startswith(("delay ", "clock "))
        ]
        metadata += [
            (f"delay {one.channel}", f"{one.delay!r} s")
            for one in self.channels
            if one.delay is not None
        ]
        return Recording(
            stamps, values, tuple(unit for _, _, unit in mapped), tuple(metadata), log.source,
            log.sha256, tuple(notes), tuple(one.channel for one in self.channels),
        )  # fmt: skip

    def _values(
        self, one: MappedChannel, log: Log, notes: list[str]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], str]:
        """Stamps, values and unit of one channel."""
        where = f"{self.source}: [channels.{one.channel}]"
        columns = [find_column(log, name, where, one.group) for name in one.columns]
        time = columns[0].time
        for other in columns[1:]:
            if other.time is not time and not np.array_equal(other.time, time):
                raise InputError(
                    where, f"{columns[0].name} and {other.name} were not read at the same times",
                    "combine columns of one sensor only",
                )  # fmt: skip
        reading = columns[0].values * (one.axis[0] if one.axis else 1.0)
        for k, other in enumerate(columns[1:], 1):
            reading = reading + other.values * (one.axis[k] if one.axis else 1.0)
        unit, factor = _unit(one, columns[0].unit, where, notes)
        if one.curve:
            reading = one.scale * _along(one.curve, reading)
        else:
            reading = one.scale * (reading - one.offset)
        if unit == COUNTS:
            return time, reading, unit
        return (
            time,
            _wheel_travel(one.motion_ratio, reading * factor, where),
            _si_unit_of(one.channel),
        )


def _si_unit_of(name: str) -> str:
    """SI unit of a channel."""
    return si_unit(channel(name).dimension)


def read_channel_map(path: PathLike) -> ChannelMap:
    """Read a channel map (TOML, ``docs/channel-map.md``).

    Raises
    ------
    InputError
        If the file cannot be read or a key is wrong; the message names file, key and fix.
    """
    from bayes_asv.domain.vehicle_file import parse_channel_map  # importing pydantic takes 0.1 s

    source = os.fspath(path)
    return parse_channel_map(read_bytes(path, _MAX_FILE_SIZE), source)


def find_column(log: Log, name: str, where: str, group: str = "") -> LoggedChannel:
    """Return the column of a log by its name, and its group where names repeat.

    Raises
    ------
    InputError
        At `where`, if there is none, or several.
    """
    found = [one for one in log.channels if one.name == name and group in ("", one.source)]
    if not found:
        near = closest(name, log.names)
        names = ", ".join(dict.fromkeys(log.names[:_MAX_LISTED]))
        more = f" and {len(log.names) - _MAX_LISTED} more" if len(log.names) > _MAX_LISTED else ""
        place = f" of {group}" if group else ""
        raise InputError(
            where, f"{log.source} has no column '{name}'{place}",
            f"did you mean '{near}'?" if near and near != name else f"it has {names}{more}",
        )  # fmt: skip
    if len(found) > 1:
        groups = ", ".join(f'"{one.source}"' for one in found[:_MAX_LISTED])
        raise InputError(
            where, f"{log.source} has {len(found)} columns '{name}'", f"add group = one of {groups}"
        )
    return found[0]


def _unit(one: MappedChannel, stated: str, where: str, notes: list[str]) -> tuple[str, float]:
    """Return the unit of the values and its factor to SI."""
    dimension = channel(one.channel).dimension
    unit = one.unit or stated
    if unit.lower() in COUNT_UNITS:
        if one.curve or abs(one.scale) != 1.0:
            raise InputError(
                where, "has a scale, but its unit is counts", f'add unit = "{si_unit(dimension)}"'
            )
        return COUNTS, 1.0
    if not unit:
        raise InputError(
            where, f"{one.columns[0]} has no unit in the file",
            f'add unit = "{si_unit(dimension)}", or scale and the unit of its result',
        )  # fmt: skip
    try:
        factor = si_factor(unit, dimension)
    except InputError as exc:
        fix = exc.fix if one.unit else f'give scale, offset and unit = "{si_unit(dimension)}"'
        raise InputError(where, f"{exc.where} {exc.what}", fix) from None
    if one.unit and stated and not one.curve and abs(one.scale) == 1.0:
        try:
            other = si_factor(stated, dimension)
        except InputError:
            other = factor
        if not math.isclose(other, factor):
            notes.append(
                f"{one.columns[0]}: the file states {stated}, the channel map {unit}; the map is "
                "used"
            )
    return unit, factor


def _along(
    curve: tuple[tuple[float, float], ...], reading: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Values on a calibration curve, continued straight beyond its ends."""
    x, y = np.array(curve, dtype=float).T
    value: NDArray[np.float64] = np.interp(reading, x, y)
    for outside, (a, b) in ((reading < x[0], (0, 1)), (reading > x[-1], (-2, -1))):
        slope = (y[b] - y[a]) / (x[b] - x[a])
        end = a if a == 0 else b
        value[outside] = y[end] + slope * (reading[outside] - x[end])
    return value


def _wheel_travel(
    ratio: float | tuple[tuple[float, float], ...], damper: NDArray[np.float64], where: str
) -> NDArray[np.float64]:
    """Travel of the wheel for that of the damper: the inverse of ∫ ratio(z) dz."""
    if isinstance(ratio, float):
        return damper / ratio
    travel, value = np.array(ratio, dtype=float).T
    # the ratio stays what it is at the ends of the table
    span = max(float(np.nanmax(np.abs(damper))) / float(value.min()), float(np.ptp(travel)))
    wheel = np.linspace(min(travel[0], 0.0) - span, max(travel[-1], 0.0) + span, _GRID)
    slope = np.interp(wheel, travel, value)
    path = np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(wheel))])
    path -= np.interp(0.0, wheel, path)
    return np.interp(damper, path, wheel)
