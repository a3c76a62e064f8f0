"""The vehicle file as it is read: its TOML tables, and the messages for faults in them.

`vehicle.read_vehicle` turns these tables into a `Vehicle`.  All numbers are in SI.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import closest, decode
from bayes_asv.domain.vehicle_numbers import (
    Measured,
    RangeSI,
    given,
    nominal,
    reading_range,
    unitless,
    without_sd,
)

__all__ = [
    "Measured", "RangeSI", "RollTable", "SensorTable", "UnsprungTable", "VehicleTables",
    "parse_vehicle",
]  # fmt: skip


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
    """``[sensors.<channel>]``."""

    zero_counts: Annotated[float | None, unitless] = None
    counts_scale: Annotated[Measured | None, given("acceleration", "counts_scale")] = None
    range: Annotated[RangeSI | None, reading_range("acceleration")] = None
    noise: Annotated[Measured | None, without_sd("acceleration")] = None
    resolution: Annotated[Measured | None, without_sd("acceleration")] = None
    bandwidth: Annotated[Measured | None, without_sd("frequency")] = None
    delay: Annotated[Measured | None, without_sd("time", "delay")] = None


class TravelSensorTable(SensorTable):
    """``[sensors.<channel>]`` of a suspension deflection."""

    counts_scale: Annotated[Measured | None, given("deflection", "counts_scale")] = None
    range: Annotated[RangeSI | None, reading_range("deflection")] = None
    noise: Annotated[Measured | None, without_sd("deflection")] = None
    resolution: Annotated[Measured | None, without_sd("deflection")] = None


class RateSensorTable(SensorTable):
    """``[sensors.<channel>]`` of an angular rate."""

    counts_scale: Annotated[Measured | None, given("angular_rate", "counts_scale")] = None
    range: Annotated[RangeSI | None, reading_range("angular_rate")] = None
    noise: Annotated[Measured | None, without_sd("angular_rate")] = None
    resolution: Annotated[Measured | None, without_sd("angular_rate")] = None


class ChannelTable(_Table):
    """``[channels.<channel>]``: where a sensor on the body sits."""

    position: Annotated[Measured, without_sd("deflection", "position")]


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


class SensorsTable(_Table):
    """``[sensors]``, one table per channel; those of single corners are for the roll car."""

    front_wheel: SensorTable = SensorTable()
    front_chassis: SensorTable = SensorTable()
    rear_wheel: SensorTable = SensorTable()
    rear_chassis: SensorTable = SensorTable()
    front_left_wheel: SensorTable | None = None
    front_right_wheel: SensorTable | None = None
    rear_left_wheel: SensorTable | None = None
    rear_right_wheel: SensorTable | None = None
    front_left_chassis: SensorTable | None = None
    front_right_chassis: SensorTable | None = None
    front_travel: TravelSensorTable | None = None
    rear_travel: TravelSensorTable | None = None
    front_left_travel: TravelSensorTable | None = None
    front_right_travel: TravelSensorTable | None = None
    rear_left_travel: TravelSensorTable | None = None
    rear_right_travel: TravelSensorTable | None = None
    body_vertical: SensorTable | None = None
    body_pitch_rate: RateSensorTable | None = None


class ChannelsTable(_Table):
    """``[channels]``: sensors on the body that do not sit above an axle."""

    body_vertical: ChannelTable | None = None


class VehicleTables(_Table):
    """The whole file."""

    name: Annotated[str, Field(max_length=200)] = ""
    units: Literal["US", "SI"]
    known: KnownTable
    nominal: NominalTable
    travel: TravelTable = TravelTable()
    sensors: SensorsTable = SensorsTable()
    channels: ChannelsTable = ChannelsTable()
    unsprung: UnsprungTable | None = None
    roll: RollTable | None = None


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
    text = decode(data, where)
    try:
        raw = tomllib.loads(text.replace("\r\n", "\n"))
    except tomllib.TOMLDecodeError as exc:
        raise InputError(where, f"is not TOML: {exc}", "correct that line") from None
    except (ValueError, RecursionError):  # numbers of thousands of digits, brackets without end
        raise InputError(where, "is not TOML that can be parsed", "write the file again") from None
    try:
        return VehicleTables.model_validate(raw)
    except ValidationError as exc:
        raise _first_error(exc, where) from None


def _first_error(error: ValidationError, where: str) -> InputError:
    """Report all faults in one line, the first in full and the others by name."""
    # A misspelt key is reported as unknown and as missing; the first helps more.
    faults = sorted(error.errors(), key=lambda fault: fault["type"] != "extra_forbidden")
    first, others = faults[0], [_key_path(fault["loc"]) for fault in faults[1:]]
    what, fix = _explain(first["type"], first["loc"], first["msg"], first.get("ctx", {}))
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
        return "unknown key", _suggest_place(place)
    if kind == "missing":
        return "is missing", f"add {place[-1]}" + (" = ..." if len(place) > 1 else "")
    if place[-1:] == ("units",):
        return "is not a system of units", 'write units = "US" or units = "SI"'
    if kind.startswith("model"):
        return "is not a table", f"write it as [{'.'.join(map(str, place))}]"
    return message, "see the examples in data/vehicles"


def _suggest_place(place: tuple[int | str, ...]) -> str:
    table: type[BaseModel] = VehicleTables
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
    if parts[0] in ("sensors", "channels") and len(parts) == 2:
        return f"[{'.'.join(parts)}]"
    return f"[{'.'.join(parts[:-1])}] {parts[-1]}"


_TABLE_TYPES: Final[tuple[tuple[str, type[BaseModel]], ...]] = (
    ("known", KnownTable), ("nominal", NominalTable), ("travel", TravelTable),
    ("unsprung", UnsprungTable), ("roll", RollTable),
)  # fmt: skip
_TABLES: Final = frozenset(
    {"known", "nominal", "travel", "sensors", "channels", "unsprung", "roll"}
)
