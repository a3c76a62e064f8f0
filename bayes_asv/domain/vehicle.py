"""A vehicle: given values, nominal values and sensors, in SI units.

Rates are effective at the wheel, both sides of an axle together.  The front weight fraction wdf
gives the centre of gravity: l_f = l (1 - wdf) behind the front axle, l_r = l wdf ahead of the rear
axle.
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, Literal, Self

from bayes_asv.domain.channel_map import ChannelMap
from bayes_asv.domain.channels import CHANNELS, KNOWN_CHANNELS, Channel
from bayes_asv.domain.channels import channel as known_channel
from bayes_asv.domain.clocks import DRIFT_SD, OFFSET_SD, Clock, check_clocks
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import closest, read_bytes, write_atomically
from bayes_asv.domain.vehicle_writer import to_toml

if TYPE_CHECKING:
    from bayes_asv.domain.files import PathLike
    from bayes_asv.domain.vehicle_file import (
        ClockTable,
        Measured,
        RollTable,
        SensorTable,
        UnsprungTable,
    )

__all__ = [
    "CHANNELS",
    "Given",
    "Nominal",
    "Roll",
    "Sensor",
    "Travel",
    "Unsprung",
    "Vehicle",
    "read_vehicle",
    "to_toml",
    "write_vehicle",
]

_MAX_FILE_SIZE: Final = 1_000_000


_BOUNCE_RANGE: Final = (0.3, 15.0)
"""Plausible bounce frequencies, Hz, from heavy trucks to scale models and stiff racing cars."""
_DYNAMIC_INDEX_RANGE: Final = (0.01, 100.0)
"""Plausible dynamic indices i / (m l_f l_r); passenger cars have about one."""


@dataclass(frozen=True, slots=True)
class Given:
    """A given value in SI with its standard deviation; zero means exact."""

    value: float
    sd: float = 0.0


@dataclass(frozen=True, slots=True)
class Nominal:
    """A nominal value in SI; `sd` is the prior standard deviation, None for the default prior."""

    value: float
    sd: float | None = None


@dataclass(frozen=True, slots=True)
class Travel:
    """Suspension travel from rest to each stop, m, positive; None where unknown.

    Bump is compression, droop is extension.
    """

    front_bump: float | None = None
    front_droop: float | None = None
    rear_bump: float | None = None
    rear_droop: float | None = None


@dataclass(frozen=True, slots=True)
class Sensor:
    """The sensor of one channel as mounted; None where a value is unknown.

    Readings are in the SI unit of the channel: m/s² for an accelerometer.

    Parameters
    ----------
    zero_counts : float or None
        Reading at rest, counts.
    counts_scale : float or None
        Reading per count; negative for a sensor mounted upside down.
    low, high : float
        Limits of the measuring range.
    noise : float or None
        Root-mean-square noise of one sample without quantisation.
    resolution : float or None
        Quantisation step.
    bandwidth : float or None
        Corner frequency of the one-pole output filter, Hz.
    delay : float
        Delay of the sample after the time stamp of its row, s.
    counts_scale_sd : float
        Standard deviation of `counts_scale` (zero: exact).
    """

    zero_counts: float | None = None
    counts_scale: float | None = None
    low: float = -math.inf
    high: float = math.inf
    noise: float | None = None
    resolution: float | None = None
    bandwidth: float | None = None
    delay: float = 0.0
    counts_scale_sd: float = 0.0


@dataclass(frozen=True, slots=True)
class Unsprung:
    """Wheels and tyres, both sides of an axle together.

    Parameters
    ----------
    front_mass, rear_mass : float
        Wheels, hubs and half of the links, kg.
    front_tyre_rate, rear_tyre_rate : float
        Vertical stiffness of both tyres, N/m.
    front_tyre_damping, rear_tyre_damping : float
        Vertical damping of both tyres, N·s/m.
    """

    front_mass: float
    rear_mass: float
    front_tyre_rate: float
    rear_tyre_rate: float
    front_tyre_damping: float = 0.0
    rear_tyre_damping: float = 0.0


@dataclass(frozen=True, slots=True)
class Roll:
    """Tracks, roll inertia and anti-roll bars.

    Parameters
    ----------
    front_track, rear_track : Given
        Distance between the tyre centres, m.
    inertia : Nominal
        Roll inertia of the sprung mass about its centre of gravity, kg·m².
    front_bar, rear_bar : float
        Anti-roll bar rates: force at either wheel over the difference of the deflections, N/m.
    front_sensors : float or None
        Distance between the front chassis sensors, m; None for the front track.
    """

    front_track: Given
    rear_track: Given
    inertia: Nominal
    front_bar: float = 0.0
    rear_bar: float = 0.0
    front_sensors: float | None = None


@dataclass(frozen=True, slots=True)
class Vehicle:
    """A car with its sensors.

    Two vehicles are equal when their values are equal, whatever files they were read from.

    Parameters
    ----------
    name : str
        Display name.
    units : {"US", "SI"}
        System of units in which results are shown.
    m : Given
        Sprung mass, kg.
    l : Given
        Wheelbase, m.
    wdf : Given
        Fraction of the weight on the front axle.
    k_f, k_r : Given
        Spring rates, N/m.
    c_f, c_r : Nominal
        Damping rates, N s/m.
    i : Nominal
        Pitch inertia of the sprung mass, kg m^2.
    travel : Travel
        Suspension travel.
    sensors : mapping of str to Sensor
        Declared sensors by channel; see :meth:`sensor` for those of other channels.
    channels : tuple of Channel
        Channels that the vehicle file describes; others are as their name says.
    channel_map : ChannelMap or None
        Where the channels stand in the files of the car's logger.
    clocks : tuple of Clock
        Clocks of channels whose stamps may be off against those of the others.
    unsprung : Unsprung or None
        Wheels and tyres.
    roll : Roll or None
        Properties of the roll car.
    source, sha256 : str
        Name and hash of the file; empty for a vehicle made in memory.

    Raises
    ------
    InputError
        If `sensors` names a channel that does not exist.
    """

    name: str
    units: Literal["US", "SI"]
    m: Given
    l: Given
    wdf: Given
    k_f: Given
    k_r: Given
    c_f: Nominal
    c_r: Nominal
    i: Nominal
    travel: Travel = field(default_factory=Travel)
    sensors: Mapping[str, Sensor] = field(default_factory=dict, hash=False)
    channels: tuple[Channel, ...] = ()
    channel_map: ChannelMap | None = None
    clocks: tuple[Clock, ...] = ()
    unsprung: Unsprung | None = None
    roll: Roll | None = None
    source: str = field(default="", compare=False)
    sha256: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        for name in self.sensors:
            _known(name)
        ordered = {name: self.sensors[name] for name in KNOWN_CHANNELS if name in self.sensors}
        object.__setattr__(self, "sensors", ordered)

    def sensor(self, name: str) -> Sensor:
        """Return the sensor of one channel.

        A channel of one side without its own sensor takes that of its axle, without zero and scale
        in counts, which differ from sensor to sensor.

        Raises
        ------
        InputError
            If there is no channel of that name.
        """
        if name in self.sensors:
            return self.sensors[name]
        wanted = self.channel(name)
        for other, sensor in self.sensors.items():
            if wanted.side and replace(wanted, name=other, side=None) == known_channel(other):
                scale = sensor.counts_scale
                step = sensor.resolution or (abs(scale) if scale else None)
                return replace(
                    sensor,
                    zero_counts=None,
                    counts_scale=None,
                    counts_scale_sd=0.0,
                    resolution=step,
                )
        return Sensor()

    def sensors_of(self, names: Iterable[str]) -> tuple[Sensor, ...]:
        """Return the sensors of some channels, see :meth:`sensor`."""
        return tuple(self.sensor(name) for name in names)

    def channel(self, name: str) -> Channel:
        """Return what a channel measures, and where.

        Raises
        ------
        InputError
            If there is no channel of that name, or its place on the body is not given.
        """
        for one in self.channels:
            if one.name == name:
                return one
        found = _known(name)
        if found.has_own_position:
            raise InputError(
                f"{self.source or 'vehicle'}: [channels.{name}]",
                "is missing, so that the place of the sensor is not known",
                "add it with position, the distance ahead of the rear axle",
            )
        return found

    def with_channel_map(self, channel_map: ChannelMap) -> Self:
        """Return the vehicle with a channel map, and its sensors where the map places them."""
        placed = tuple(
            replace(known_channel(one.channel), position=one.position)
            for one in channel_map.channels
            if one.position is not None
        )
        names = {one.name for one in placed}
        kept = tuple(one for one in self.channels if one.name not in names)
        return replace(self, channels=(*kept, *placed), channel_map=channel_map)

    @property
    def l_f(self) -> float:
        """Distance from the centre of gravity to the front axle, m."""
        return self.l.value * (1.0 - self.wdf.value)

    @property
    def l_r(self) -> float:
        """Distance from the centre of gravity to the rear axle, m."""
        return self.l.value * self.wdf.value

    @property
    def k_g(self) -> float:
        """Pitch radius of gyration √(i/m) at the nominal inertia, m."""
        return math.sqrt(self.i.value / self.m.value)

    @property
    def zeta_f(self) -> float:
        """Damping ratio c_f / (2 √(k_f m wdf)) of the front axle alone, nominal."""
        return self.c_f.value / (2.0 * math.sqrt(self.k_f.value * self.m.value * self.wdf.value))

    @property
    def zeta_r(self) -> float:
        """Damping ratio c_r / (2 √(k_r m (1 − wdf))) of the rear axle alone, nominal."""
        return self.c_r.value / (
            2.0 * math.sqrt(self.k_r.value * self.m.value * (1.0 - self.wdf.value))
        )


def _known(name: str) -> Channel:
    try:
        return known_channel(name)
    except KeyError:
        near = closest(name, KNOWN_CHANNELS)
        fix = f"did you mean {near}?" if near else f"channels are {', '.join(KNOWN_CHANNELS)}"
        raise InputError(f"channel '{name}'", "there is no such channel", fix) from None


def read_vehicle(path: PathLike) -> Vehicle:
    """Read a vehicle file (TOML).

    Parameters
    ----------
    path : str or os.PathLike
        The file; ``data/README.md`` describes its tables.

    Returns
    -------
    Vehicle
        The vehicle in SI units.

    Raises
    ------
    InputError
        If the file cannot be read, a key is unknown or missing, a unit is wrong or a value is
        implausible; the message names the file, the key and the fix.
    """
    from bayes_asv.domain.vehicle_file import (
        mapped_channels,
        parse_vehicle,
    )  # deferred: importing pydantic takes 0.1 s

    source = os.fspath(path)
    data = read_bytes(path, _MAX_FILE_SIZE)
    tables = parse_vehicle(data, source)
    known, nominal, travel = tables.known, tables.nominal, tables.travel
    mapped = mapped_channels(tables.channels, source)
    vehicle = Vehicle(
        name=tables.name or os.path.splitext(os.path.basename(source))[0],
        units=tables.units,
        m=_to_given(known.sprung_mass),
        l=_to_given(known.wheelbase),
        wdf=_to_given(known.front_weight_fraction),
        k_f=_to_given(known.front_spring_rate),
        k_r=_to_given(known.rear_spring_rate),
        c_f=Nominal(*nominal.front_damping),
        c_r=Nominal(*nominal.rear_damping),
        i=Nominal(*nominal.pitch_inertia),
        travel=Travel(
            _optional_value(travel.front_bump),
            _optional_value(travel.front_droop),
            _optional_value(travel.rear_bump),
            _optional_value(travel.rear_droop),
        ),
        sensors={name: _to_sensor(table) for name, table in tables.sensors if table is not None},
        channels=tuple(
            replace(known_channel(name), position=table.position.value)
            for name, table in tables.channels
            if table is not None and getattr(table, "position", None)
        ),
        channel_map=ChannelMap(mapped, source=source) if mapped else None,
        clocks=_to_clocks(tables.clocks, source),
        unsprung=None if tables.unsprung is None else _to_unsprung(tables.unsprung),
        roll=None if tables.roll is None else _to_roll(tables.roll),
        source=source,
        sha256=hashlib.sha256(data).hexdigest(),
    )
    _check_plausible(vehicle)
    return vehicle


def _check_plausible(vehicle: Vehicle) -> None:
    """Refuse numbers that no car combines: a wrong unit shows in bounce frequency or inertia."""
    m, l, wdf = vehicle.m.value, vehicle.l.value, vehicle.wdf.value
    bounce = math.sqrt((vehicle.k_f.value + vehicle.k_r.value) / m) / (2.0 * math.pi)
    if not _BOUNCE_RANGE[0] < bounce < _BOUNCE_RANGE[1]:
        raise InputError(
            f"{vehicle.source}: [known]",
            f"a sprung mass of {m:.4g} kg on these springs has a bounce frequency of {bounce:.2g} "
            f"Hz, outside {_BOUNCE_RANGE[0]:g} to {_BOUNCE_RANGE[1]:g} Hz",
            "check the units of sprung_mass and of the spring rates",
        )
    index = vehicle.i.value / (m * l**2 * wdf * (1.0 - wdf))
    if not _DYNAMIC_INDEX_RANGE[0] < index < _DYNAMIC_INDEX_RANGE[1]:
        raise InputError(
            vehicle.source,
            f"the pitch inertia is {index:.2g} times m l_f l_r; cars have about 1",
            "check the units of wheelbase, sprung_mass and pitch_inertia",
        )


def write_vehicle(vehicle: Vehicle, path: PathLike) -> None:
    """Write a vehicle file atomically, in the display units of the vehicle.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    write_atomically(path, to_toml(vehicle).encode("utf-8"))


def _to_given(measured: Measured) -> Given:
    return Given(measured.value, measured.sd or 0.0)


def _optional_value(measured: Measured | None) -> float | None:
    return None if measured is None else measured.value


def _to_clocks(tables: Mapping[str, ClockTable], source: str) -> tuple[Clock, ...]:
    clocks = []
    for name, table in tables.items():
        offset, drift = table.offset, table.drift
        given: dict[str, float] = {}
        if offset is not None:
            given |= {"offset": offset.value, "offset_sd": _sd_or(offset, OFFSET_SD)}
        if drift is not None:
            given |= {"drift": drift.value, "drift_sd": _sd_or(drift, DRIFT_SD)}
        try:
            clocks.append(Clock(name, tuple(table.channels), **given))
        except InputError as exc:
            where = f"{source}: [clocks.{name}] channels"
            raise InputError(where, f"{exc.where}: {exc.what}", exc.fix) from None
    check_clocks(clocks, f"{source}: [clocks]")
    return tuple(clocks)


def _sd_or(measured: Measured, default: float) -> float:
    return default if measured.sd is None else measured.sd


def _to_unsprung(table: UnsprungTable) -> Unsprung:
    return Unsprung(
        table.front_mass.value,
        table.rear_mass.value,
        table.front_tyre_rate.value,
        table.rear_tyre_rate.value,
        _optional_value(table.front_tyre_damping) or 0.0,
        _optional_value(table.rear_tyre_damping) or 0.0,
    )


def _to_roll(table: RollTable) -> Roll:
    return Roll(
        _to_given(table.front_track),
        _to_given(table.rear_track),
        Nominal(*table.inertia),
        _optional_value(table.front_bar) or 0.0,
        _optional_value(table.rear_bar) or 0.0,
        _optional_value(table.front_sensors),
    )


def _to_sensor(table: SensorTable) -> Sensor:
    scale = table.counts_scale
    low, high = table.range or (-math.inf, math.inf)
    return Sensor(
        zero_counts=table.zero_counts,
        counts_scale=_optional_value(scale),
        low=low,
        high=high,
        noise=_optional_value(table.noise),
        resolution=_optional_value(table.resolution),
        bandwidth=_optional_value(table.bandwidth),
        delay=_optional_value(table.delay) or 0.0,
        counts_scale_sd=(scale.sd or 0.0) if scale else 0.0,
    )
