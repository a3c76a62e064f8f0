"""The vehicle file as it is read: its TOML tables, and the messages for faults in them.

`vehicle.read_vehicle` turns these tables into a `Vehicle`.  All numbers are in SI.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from bayes_asv.domain.channel_map import ChannelMap, MappedChannel
from bayes_asv.domain.channels import KNOWN_CHANNELS, channel
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import closest, decode
from bayes_asv.domain.units import si_factor
from bayes_asv.domain.vehicle_numbers import (
    Measured,
    RangeSI,
    clock_error,
    given,
    nominal,
    reading_range,
    unitless,
    without_sd,
)

__all__ = [
    "ClockTable", "Measured", "RangeSI", "RollTable", "SensorTable", "UnsprungTable",
    "VehicleTables", "mapped_channels", "parse_channel_map", "parse_vehicle",
]  # fmt: skip


_Model = TypeVar("_Model", bound=BaseModel)


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class KnownTable(_Table):
    """``[known]``."""

    sprung_mass: Annotated[Measured, given("mass")]
    wheelbase: Annotated[Measured, given("length")]
    front_weight_fraction: Annotated[Measured, given("dimensionless")]
    front_spring_rate: Annotated[Measured, given("stiffness")]
    rear_spring_rate: Annotated[Measured, given("stiffness")]


class NominalTable(_Table):
    """``[nominal]``."""

    front_damping: Annotated[Measured, nominal("damping")]
    rear_damping: Annotated[Measured, nominal("damping")]
    pitch_inertia: Annotated[Measured, nominal("pitch_inertia")]


class TravelTable(_Table):
    """``[travel]``: distance from rest to each stop."""

    front_bump: Annotated[Measured | None, without_sd("length")] = None
    front_droop: Annotated[Measured | None, without_sd("length")] = None
    rear_bump: Annotated[Measured | None, without_sd("length")] = None
    rear_droop: Annotated[Measured | None, without_sd("length")] = None


class SensorTable(_Table):
    """``[sensors.<channel>]``; `_sensor_table` adds the checks of units."""

    zero_counts: Annotated[float | None, unitless] = None
    counts_scale: Measured | None = None
    range: RangeSI | None = None
    noise: Measured | None = None
    resolution: Measured | None = None
    bandwidth: Annotated[Measured | None, without_sd("frequency")] = None
    delay: Annotated[Measured | None, without_sd("time", "delay")] = None


class MotionRatioTable(_Table):
    """``motion_ratio`` that varies with the travel of the wheel from rest."""

    travel: list[float]
    ratio: list[float]
    unit: str


class ChannelTable(_Table):
    """``[channels.<channel>]``: columns of a foreign log, see ``MappedChannel``."""

    column: str | list[str] | None = None
    group: str = ""
    unit: str = ""
    axis: list[float] = []
    offset: float = 0.0
    sign: Literal[1, -1] = 1
    scale: float = 1.0
    curve: list[Annotated[list[float], Field(min_length=2, max_length=2)]] = []
    motion_ratio: float | MotionRatioTable = 1.0
    delay: Annotated[Measured | None, without_sd("time", "delay")] = None


class PlacedChannelTable(ChannelTable):
    """``[channels.<channel>]`` of a sensor that may sit anywhere on the body."""

    position: Annotated[Measured | None, without_sd("deflection", "position")] = None


class ClockTable(_Table):
    """``[clocks.<name>]``: channels with a clock of their own."""

    channels: list[str]
    offset: Annotated[Measured | None, clock_error("time", "offset")] = None
    drift: Annotated[Measured | None, clock_error("dimensionless", "drift")] = None


class UnsprungTable(_Table):
    """``[unsprung]``: wheels and tyres, both sides of an axle together."""

    front_mass: Annotated[Measured, without_sd("mass")]
    rear_mass: Annotated[Measured, without_sd("mass")]
    front_tyre_rate: Annotated[Measured, without_sd("stiffness")]
    rear_tyre_rate: Annotated[Measured, without_sd("stiffness")]
    front_tyre_damping: Annotated[Measured | None, without_sd("damping")] = None
    rear_tyre_damping: Annotated[Measured | None, without_sd("damping")] = None


class RollTable(_Table):
    """``[roll]``: tracks, roll inertia and anti-roll bars."""

    front_track: Annotated[Measured, given("length")]
    rear_track: Annotated[Measured, given("length")]
    inertia: Annotated[Measured, nominal("pitch_inertia")]
    front_bar: Annotated[Measured | None, without_sd("stiffness")] = None
    rear_bar: Annotated[Measured | None, without_sd("stiffness")] = None
    front_sensors: Annotated[Measured | None, without_sd("length")] = None


def _sensor_table(dimension: str) -> type[SensorTable]:
    """Table of a sensor whose readings are of a physical dimension."""
    own: dict[str, Any] = {
        "counts_scale": (Annotated[Measured | None, given(dimension, "counts_scale")], None),
        "range": (Annotated[RangeSI | None, reading_range(dimension)], None),
        "noise": (Annotated[Measured | None, without_sd(dimension)], None),
        "resolution": (Annotated[Measured | None, without_sd(dimension)], None),
    }
    return create_model("SensorTable", __base__=SensorTable, **own)


def _optional_tables(name: str, tables: Mapping[str, type[_Table]]) -> type[_Table]:
    """Table of tables, one a channel, each of which may be left out."""
    fields: dict[str, Any] = {key: (table | None, None) for key, table in tables.items()}
    return create_model(name, __base__=_Table, **fields)


_KNOWN: Final = tuple(map(channel, KNOWN_CHANNELS))
_SENSORS: Final = {one: _sensor_table(one) for one in {known.dimension for known in _KNOWN}}
_SENSORS_TABLE: Final = _optional_tables(
    "SensorsTable", {known.name: _SENSORS[known.dimension] for known in _KNOWN}
)
_CHANNELS_TABLE: Final = _optional_tables(
    "ChannelsTable",
    {
        known.name: PlacedChannelTable if known.has_own_position else ChannelTable
        for known in _KNOWN
    },
)


class VehicleTables(_Table):
    """The whole file; `_FILE` adds the tables of the channels."""

    name: Annotated[str, Field(max_length=200)] = ""
    units: Literal["US", "SI"]
    known: KnownTable
    nominal: NominalTable
    travel: TravelTable = TravelTable()
    sensors: _Table = _Table()
    channels: _Table = _Table()
    clocks: dict[str, ClockTable] = {}
    unsprung: UnsprungTable | None = None
    roll: RollTable | None = None


_FILE: Final = create_model(
    "VehicleTables",
    __base__=VehicleTables,
    sensors=(_SENSORS_TABLE, _SENSORS_TABLE()),
    channels=(_CHANNELS_TABLE, _CHANNELS_TABLE()),
)


class ChannelMapTables(_Table):
    """A channel map by itself; `_MAP_FILE` adds the tables of the channels."""

    rate: Annotated[Measured | None, without_sd("frequency")] = None
    channels: _Table = _Table()


_MAP_FILE: Final = create_model(
    "ChannelMapTables", __base__=ChannelMapTables, channels=(_CHANNELS_TABLE, _CHANNELS_TABLE())
)


def parse_vehicle(data: bytes, where: str) -> VehicleTables:
    """Read the bytes of a vehicle file.

    Parameters
    ----------
    data : bytes
        TOML text, UTF-8.
    where : str
        Name of the file, for messages.

    Returns
    -------
    VehicleTables
        The tables, all numbers in SI.

    Raises
    ------
    InputError
        With the key at fault and the fix.
    """
    return _validated(_FILE, data, where)


def parse_channel_map(data: bytes, where: str) -> ChannelMap:
    """Read the bytes of a channel map.

    Parameters
    ----------
    data : bytes
        TOML text, UTF-8: ``rate`` and the tables ``[channels.<channel>]``.
    where : str
        Name of the file, for messages.

    Returns
    -------
    ChannelMap

    Raises
    ------
    InputError
        With the key at fault and the fix.
    """
    tables = _validated(_MAP_FILE, data, where)
    mapped = mapped_channels(tables.channels, where)
    unmapped = [name for name, table in tables.channels if table and table.column is None]
    if unmapped:
        raise InputError(
            f"{where}: [channels.{unmapped[0]}]", "names no column",
            'add column = "name in the file"',
        )  # fmt: skip
    return ChannelMap(mapped, tables.rate.value if tables.rate else None, where)


def mapped_channels(tables: _Table, where: str) -> tuple[MappedChannel, ...]:
    """Return the channels whose table names a column.

    Raises
    ------
    InputError
        If keys of a table contradict each other.
    """
    result = []
    for name, table in tables:
        if table is None or table.column is None:
            continue
        columns = (table.column,) if isinstance(table.column, str) else tuple(table.column)
        position = getattr(table, "position", None)
        try:
            result.append(
                MappedChannel(
                    channel=name,
                    columns=columns,
                    group=table.group,
                    unit=table.unit,
                    axis=tuple(table.axis),
                    offset=table.offset,
                    scale=table.sign * table.scale,
                    curve=tuple((reading, value) for reading, value in table.curve),
                    motion_ratio=_motion_ratio(table.motion_ratio),
                    delay=None if table.delay is None else table.delay.value,
                    position=None if position is None else position.value,
                )
            )
        except InputError as exc:
            raise InputError(f"{where}: {exc.where}", exc.what, exc.fix) from None
    return tuple(result)


def _motion_ratio(table: float | MotionRatioTable) -> float | tuple[tuple[float, float], ...]:
    if not isinstance(table, MotionRatioTable):
        return float(table)
    factor = si_factor(table.unit, "deflection")
    if len(table.travel) != len(table.ratio):
        raise InputError(
            "motion_ratio",
            "has unequal numbers of travels and ratios",
            "give one ratio for each travel",
        )
    return tuple(
        (travel * factor, ratio) for travel, ratio in zip(table.travel, table.ratio, strict=True)
    )


def _validated(model: type[_Model], data: bytes, where: str) -> _Model:
    """Parse TOML text and check it against its tables."""
    text = decode(data, where)
    try:
        raw = tomllib.loads(text.replace("\r\n", "\n"))
    except tomllib.TOMLDecodeError as exc:
        raise InputError(where, f"is not TOML: {exc}", "correct that line") from None
    except (ValueError, RecursionError):  # numbers of thousands of digits, brackets without end
        raise InputError(where, "is not TOML that can be parsed", "write the file again") from None
    try:
        return model.model_validate(raw)
    except ValidationError as exc:
        raise _first_error(exc, where, model) from None


def _first_error(error: ValidationError, where: str, model: type[BaseModel]) -> InputError:
    """Report all faults in one line, the first in full and the others by name."""
    # A misspelt key is reported as unknown and as missing; the first helps more.
    faults = sorted(error.errors(), key=lambda fault: fault["type"] != "extra_forbidden")
    first, others = faults[0], [_key_path(fault["loc"]) for fault in faults[1:]]
    context = {"model": model, **first.get("ctx", {})}
    what, fix = _explain(first["type"], first["loc"], first["msg"], context)
    if others:
        more = f" and {len(others) - 3} more" if len(others) > 3 else ""
        what += f" (also at fault: {', '.join(others[:3])}{more})"
    return InputError(f"{where}: {_key_path(first['loc'])}", what, fix)


def _explain(
    kind: str, place: tuple[int | str, ...], message: str, context: Mapping[str, Any]
) -> tuple[str, str]:
    if kind == "quantity":
        return str(context["what"]), str(context["fix"])
    if kind == "extra_forbidden":
        return "unknown key", _suggest_place(place, context["model"])
    if kind == "missing":
        return "is missing", f"add {place[-1]}" + (" = ..." if len(place) > 1 else "")
    if place[-1:] == ("units",):
        return "is not a system of units", 'write units = "US" or units = "SI"'
    if kind.startswith("model"):
        return "is not a table", f"write it as [{'.'.join(map(str, place))}]"
    where = "docs/channel-map.md" if place[0] == "channels" else "the examples in data/vehicles"
    return message, f"see {where}"


def _suggest_place(place: tuple[int | str, ...], table: type[BaseModel]) -> str:
    if place[0] == "clocks" and len(place) > 2:
        place, table = place[2:], ClockTable
    for part in place[:-1]:
        inner = table.model_fields[str(part)].annotation
        for choice in (inner, *get_args(inner)):  # a table, or an optional one
            if isinstance(choice, type) and issubclass(choice, BaseModel):
                table = choice
    key = str(place[-1])
    for name, other in _TABLE_TYPES:
        if key in other.model_fields and other is not table:
            return f"move it to [{name}]"
    near = closest(key, table.model_fields)
    return f"did you mean {near}?" if near else f"known are {', '.join(table.model_fields)}"


def _key_path(place: tuple[int | str, ...]) -> str:
    """``("sensors", "front_wheel", "noise")`` as ``[sensors.front_wheel] noise``."""
    parts = [str(part) for part in place]
    if len(parts) <= 1:
        return f"[{parts[0]}]" if parts and parts[0] in _TABLES else "".join(parts) or "top level"
    if parts[0] in ("sensors", "channels", "clocks") and len(parts) == 2:
        return f"[{'.'.join(parts)}]"
    return f"[{'.'.join(parts[:-1])}] {parts[-1]}"


_TABLE_TYPES: Final[tuple[tuple[str, type[BaseModel]], ...]] = (
    ("known", KnownTable), ("nominal", NominalTable), ("travel", TravelTable),
    ("unsprung", UnsprungTable), ("roll", RollTable),
)  # fmt: skip
_TABLES: Final = frozenset(
    {"known", "nominal", "travel", "sensors", "channels", "clocks", "unsprung", "roll"}
)
