"""The vehicle file as it is read: its TOML tables, and the messages for faults in them.

`vehicle.read_vehicle` turns these tables into a `Vehicle`.  All numbers are in SI.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any, Final, Literal, NamedTuple, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, PlainValidator, ValidationError, create_model
from pydantic_core import PydanticCustomError

from bayes_asv.domain.channel_map import ChannelMap, MappedChannel
from bayes_asv.domain.channels import KNOWN_CHANNELS, channel
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import closest, decode
from bayes_asv.domain.units import parse_quantity, si_factor, si_unit

__all__ = [
    "ClockTable",
    "Measured",
    "RangeSI",
    "RollTable",
    "SensorTable",
    "UnsprungTable",
    "VehicleTables",
    "clock_error",
    "given",
    "mapped_channels",
    "nominal",
    "parse_channel_map",
    "parse_vehicle",
    "reading_range",
    "unitless",
    "without_sd",
]


class Measured(NamedTuple):
    """A value in SI with its standard deviation, None if the file gives none."""

    value: float
    sd: float | None


class RangeSI(NamedTuple):
    """Lowest and highest reading in SI."""

    low: float
    high: float


# Smallest and largest plausible values, SI: wide enough for a model car and a mining truck, narrow
# enough to reveal a missing unit or a wrong exponent.
_PLAUSIBLE_RANGE: Final[Mapping[str, tuple[float, float]]] = {
    "mass": (1e-3, 1e7),
    "length": (1e-4, 1e3),
    "stiffness": (1e-3, 1e12),
    "damping": (1e-6, 1e10),
    "pitch_inertia": (1e-9, 1e10),
    "acceleration": (1e-9, 1e7),
    "angular_rate": (1e-9, 1e4),
    "deflection": (0.0, 1e3),
    "frequency": (1e-3, 1e7),
    "time": (0.0, 1.0),
}
_SIGNED: Final = frozenset({"counts_scale", "delay", "offset", "position"})  # may be negative
_MAX_RELATIVE_SD: Final = 1.0  # a given value with more than this is not informative
_MAX_RELATIVE_PRIOR_SD: Final = 10.0
_MAX_DRIFT: Final = 0.1  # beyond it the unit is wrong


def _error(what: str, fix: str) -> PydanticCustomError:
    return PydanticCustomError("quantity", "{what}", {"what": what, "fix": fix})


def _number(raw: object, name: str = "value") -> float:
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        raise _error(f"{name} is not a number", f"write {name} = 1.5, without quotes")
    try:
        number = float(raw)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise _error(f"{name} is not finite", "give a finite number")
    return number


def _check_keys(raw: Mapping[str, object], allowed: tuple[str, ...]) -> None:
    for key in raw:
        if key not in allowed:
            near = closest(key, allowed)
            fix = f"did you mean {near}?" if near else f"allowed are {', '.join(allowed)}"
            raise _error(f"unknown key '{key}'", fix)


def _factor(unit: object, dimension: str) -> float:
    if unit is None and dimension == "dimensionless":
        return 1.0
    if unit is None:
        raise _error("has no unit", f'add unit = "{si_unit(dimension)}"')
    if not isinstance(unit, str):
        raise _error("unit is not a text", f'write unit = "{si_unit(dimension)}"')
    try:
        return si_factor(unit, dimension)
    except InputError as exc:
        raise _error(f"{exc.where} {exc.what}", exc.fix) from None


def _text(raw: str, dimension: str) -> tuple[float, float]:
    """Split a text such as ``"100 lbf/in"`` into its number and the factor to SI."""
    try:
        number, unit = parse_quantity(raw)
    except InputError as exc:
        raise _error(f"{exc.where} {exc.what}", exc.fix) from None
    return number, _factor(unit or None, dimension)


def _check_plausible(value: float, dimension: str, name: str) -> None:
    if name == "drift":
        if abs(value) > _MAX_DRIFT:
            raise _error(f"is {1e6 * value:g} ppm, which is not plausible", 'give it in "ppm"')
        return
    if dimension == "dimensionless":
        if not 0.0 < value < 1.0:
            raise _error(
                f"is {value:g}, not between 0 and 1", "give the share of the front axle, as 0.47"
            )
        return
    low, high = _PLAUSIBLE_RANGE[dimension]
    size = abs(value) if name in _SIGNED else value
    if size <= 0.0 < low:
        raise _error(f"is {value:g} {si_unit(dimension)}", "give a value above zero")
    if not low <= size <= high:
        raise _error(
            f"is {value:g} {si_unit(dimension)}, which is not plausible", "check value and unit"
        )


def _deviation(raw: object, number: float, factor: float, dimension: str) -> float:
    """Read `sd` in SI from a number, a percentage or a text with a unit."""
    if isinstance(raw, str):
        percent = re.fullmatch(r"\s*([0-9.eE+-]{1,40}?)\s*(%|percent)\s*", raw)
        if percent:
            sd = _text(percent[1], "dimensionless")[0] / 100.0 * abs(number) * factor
        else:
            own, own_factor = _text(raw, dimension)
            sd = own * own_factor
    else:
        sd = _number(raw, "sd") * factor
    if not math.isfinite(sd) or sd < 0.0:
        raise _error("sd is negative or not finite", 'give sd as a number above zero or as "5 %"')
    return sd


def _quantity(
    dimension: str, name: str, largest_sd: float | None, allow_zero_sd: bool, raw: object
) -> Measured:
    """Read ``{ value, unit, sd }``, ``"100 lbf/in"``, or a bare number where no unit is needed."""
    if isinstance(raw, Measured):
        return raw
    sd_text: object = None
    if isinstance(raw, str):
        number, factor = _text(raw, dimension)
    elif isinstance(raw, Mapping):
        _check_keys(raw, ("value", "unit") if largest_sd is None else ("value", "unit", "sd"))
        if "value" not in raw:
            raise _error("has no value", f'write {{ value = 1.5, unit = "{si_unit(dimension)}" }}')
        number = _number(raw["value"])
        factor = _factor(raw.get("unit"), dimension)
        sd_text = raw.get("sd")
    else:
        number, factor = _number(raw), 1.0
        if dimension != "dimensionless":
            raise _error("has no unit", f'write "{number:g} {si_unit(dimension)}"')
    value = number * factor
    if not math.isfinite(value):
        raise _error("is not finite", "check value and unit")
    _check_plausible(value, dimension, name)
    if sd_text is None or largest_sd is None:
        return Measured(value, None)
    sd = _deviation(sd_text, number, factor, dimension)
    if sd > largest_sd * abs(value):
        raise _error(
            f"sd is {sd / abs(value):.3g} times the value",
            f"give at most {largest_sd:g} times, or check its unit",
        )
    if sd == 0.0 and not allow_zero_sd:
        raise _error("sd is zero", "leave sd out for the default prior, or give it above zero")
    return Measured(value, sd)


def _range(dimension: str, raw: object) -> RangeSI:
    """Read ``{ low, high, unit }``, or ``{ value, unit }`` for a symmetric range."""
    if isinstance(raw, str) or (isinstance(raw, Mapping) and "value" in raw):
        one = _quantity(dimension, "range", None, True, raw)
        return RangeSI(-one.value, one.value)
    if not isinstance(raw, Mapping):
        raise _error("is not a range", 'write { low = -20, high = 20, unit = "m/s^2" }')
    _check_keys(raw, ("low", "high", "unit", "value"))
    if "low" not in raw and "high" not in raw:
        raise _error("has neither low nor high", 'write { low = -20, high = 20, unit = "m/s^2" }')
    factor = _factor(raw.get("unit"), dimension)
    low = _number(raw["low"], "low") * factor if "low" in raw else -math.inf
    high = _number(raw["high"], "high") * factor if "high" in raw else math.inf
    if not low < high:
        raise _error("low is not below high", "swap them, or check both")
    return RangeSI(low, high)


def given(dimension: str, name: str = "") -> Any:
    """Validate a given value; its standard deviation may be zero."""
    return PlainValidator(partial(_quantity, dimension, name, _MAX_RELATIVE_SD, True))


def clock_error(dimension: str, name: str) -> Any:
    """Validate an offset or a drift of a clock; zero with any standard deviation is possible."""
    return PlainValidator(partial(_quantity, dimension, name, math.inf, True))


def nominal(dimension: str) -> Any:
    """Validate a nominal value; its standard deviation must be positive and may be wide."""
    return PlainValidator(partial(_quantity, dimension, "", _MAX_RELATIVE_PRIOR_SD, False))


def without_sd(dimension: str, name: str = "") -> Any:
    """Validate a value without a standard deviation."""
    return PlainValidator(partial(_quantity, dimension, name, None, True))


unitless: Final = PlainValidator(_number)
"""A number without a unit."""


def reading_range(dimension: str) -> Any:
    """Validate the lower and upper limit of the readings."""
    return PlainValidator(partial(_range, dimension))


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
