"""The vehicle file as text: its tables, its units, and what is said when they are wrong.

Nothing here knows the vehicle itself; `vehicle.py` turns what is read here into its own types.
Every number that leaves is SI.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any, Final, Literal, NamedTuple, get_args

from pydantic import BaseModel, ConfigDict, Field, PlainValidator, ValidationError
from pydantic_core import PydanticCustomError

from bayes_asv.errors import InputError
from bayes_asv.files import closest, decode
from bayes_asv.units import parse_quantity, si_factor

__all__ = [
    "Measured", "RangeSI", "RollTable", "SensorTable", "UnsprungTable", "VehicleTables",
    "parse_vehicle",
]  # fmt: skip


class Measured(NamedTuple):
    """A number in SI with its deviation (None when the file gives none)."""

    value: float
    sd: float | None


class RangeSI(NamedTuple):
    """Lowest and highest reading, m/s^2."""

    low: float
    high: float


# Smallest and largest believable values, SI: wide enough for a model car and a mine truck, narrow
# enough that a forgotten unit or a slipped exponent is seen.
_BELIEVABLE: Final[Mapping[str, tuple[float, float]]] = {
    "mass": (1e-3, 1e7),
    "length": (1e-4, 1e3),
    "stiffness": (1e-3, 1e12),
    "damping": (1e-6, 1e10),
    "pitch_inertia": (1e-9, 1e10),
    "acceleration": (1e-9, 1e7),
    "frequency": (1e-3, 1e7),
    "time": (0.0, 1.0),
}
_SIGNED: Final = frozenset({"counts_scale", "delay"})  # a sensor may hang upside down
_LARGEST_SD: Final = 1.0  # of the value: beyond it a given value is no knowledge
_LARGEST_PRIOR_SD: Final = 10.0


def _fault(what: str, mend: str) -> PydanticCustomError:
    return PydanticCustomError("quantity", "{what}", {"what": what, "mend": mend})


def _number(raw: object, name: str = "value") -> float:
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        raise _fault(f"{name} is not a number", f"write {name} = 1.5, without quotes")
    try:
        number = float(raw)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise _fault(f"{name} is not finite", "give a finite number")
    return number


def _keys(raw: Mapping[str, object], allowed: tuple[str, ...]) -> None:
    for key in raw:
        if key not in allowed:
            near = closest(key, allowed)
            mend = f"did you mean {near}?" if near else f"only {', '.join(allowed)} may stand here"
            raise _fault(f"unknown key '{key}'", mend)


def _factor(unit: object, dimension: str) -> float:
    if unit is None and dimension == "dimensionless":
        return 1.0
    if unit is None:
        raise _fault("has no unit", f'add unit = "{_SI[dimension]}"')
    if not isinstance(unit, str):
        raise _fault("unit is not a text", f'write unit = "{_SI[dimension]}"')
    try:
        return si_factor(unit, dimension)
    except InputError as exc:
        raise _fault(f"{exc.where} {exc.what}", exc.mend) from None


_SI: Final = {
    "mass": "kg",
    "length": "m",
    "stiffness": "N/m",
    "damping": "N*s/m",
    "pitch_inertia": "kg*m^2",
    "acceleration": "m/s^2",
    "frequency": "Hz",
    "time": "s",
    "dimensionless": "1",
}


def _text(raw: str, dimension: str) -> tuple[float, float]:
    """Split into number and factor a text such as ``"100 lbf/in"``."""
    try:
        number, unit = parse_quantity(raw)
    except InputError as exc:
        raise _fault(f"{exc.where} {exc.what}", exc.mend) from None
    return number, _factor(unit or None, dimension)


def _believable(value: float, dimension: str, name: str) -> None:
    if dimension == "dimensionless":
        if not 0.0 < value < 1.0:
            raise _fault(
                f"is {value:g}, not between 0 and 1", "give the share of the front axle, as 0.47"
            )
        return
    low, high = _BELIEVABLE[dimension]
    size = abs(value) if name in _SIGNED else value
    if size <= 0.0 < low:
        raise _fault(f"is {value:g} {_SI[dimension]}", "give a value above zero")
    if not low <= size <= high:
        raise _fault(
            f"is {value:g} {_SI[dimension]}, which is not believable", "check value and unit"
        )


def _deviation(raw: object, number: float, factor: float, dimension: str) -> float:
    """`sd` in SI from a number, a percentage or a text with a unit."""
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
        raise _fault("sd is negative or not finite", 'give sd as a number above zero or as "5 %"')
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
        _keys(raw, ("value", "unit") if largest_sd is None else ("value", "unit", "sd"))
        if "value" not in raw:
            raise _fault("has no value", f'write {{ value = 1.5, unit = "{_SI[dimension]}" }}')
        number = _number(raw["value"])
        factor = _factor(raw.get("unit"), dimension)
        sd_text = raw.get("sd")
    else:
        number, factor = _number(raw), 1.0
        if dimension != "dimensionless":
            raise _fault("has no unit", f'write "{number:g} {_SI[dimension]}"')
    value = number * factor
    if not math.isfinite(value):
        raise _fault("is not finite", "check value and unit")
    _believable(value, dimension, name)
    if sd_text is None or largest_sd is None:
        return Measured(value, None)
    sd = _deviation(sd_text, number, factor, dimension)
    if sd > largest_sd * abs(value):
        raise _fault(
            f"sd is {sd / abs(value):.3g} times the value",
            f"give at most {largest_sd:g} times, or check its unit",
        )
    if sd == 0.0 and not allow_zero_sd:
        raise _fault("sd is zero", "leave sd out for the usual prior, or give it above zero")
    return Measured(value, sd)


def _range(raw: object) -> RangeSI:
    """Read ``{ low, high, unit }`` or ``{ value, unit }`` for plus and minus the same."""
    if isinstance(raw, str) or (isinstance(raw, Mapping) and "value" in raw):
        one = _quantity("acceleration", "range", None, True, raw)
        return RangeSI(-one.value, one.value)
    if not isinstance(raw, Mapping):
        raise _fault("is not a range", 'write { low = -20, high = 20, unit = "m/s^2" }')
    _keys(raw, ("low", "high", "unit", "value"))
    if "low" not in raw and "high" not in raw:
        raise _fault("has neither low nor high", 'write { low = -20, high = 20, unit = "m/s^2" }')
    factor = _factor(raw.get("unit"), "acceleration")
    low = _number(raw["low"], "low") * factor if "low" in raw else -math.inf
    high = _number(raw["high"], "high") * factor if "high" in raw else math.inf
    if not low < high:
        raise _fault("low is not below high", "swap them, or check both")
    return RangeSI(low, high)


def _given(dimension: str) -> Any:
    return PlainValidator(partial(_quantity, dimension, "", _LARGEST_SD, True))


def _nominal(dimension: str) -> Any:
    return PlainValidator(partial(_quantity, dimension, "", _LARGEST_PRIOR_SD, False))


def _plain(dimension: str, name: str = "") -> Any:
    return PlainValidator(partial(_quantity, dimension, name, None, True))


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class KnownTable(_Table):
    """``[known]``."""

    sprung_mass: Annotated[Measured, _given("mass")]
    wheelbase: Annotated[Measured, _given("length")]
    front_weight_fraction: Annotated[Measured, _given("dimensionless")]
    front_spring_rate: Annotated[Measured, _given("stiffness")]
    rear_spring_rate: Annotated[Measured, _given("stiffness")]


class NominalTable(_Table):
    """``[nominal]``."""

    front_damping: Annotated[Measured, _nominal("damping")]
    rear_damping: Annotated[Measured, _nominal("damping")]
    pitch_inertia: Annotated[Measured, _nominal("pitch_inertia")]


class TravelTable(_Table):
    """``[travel]``: from rest to the stop."""

    front_bump: Annotated[Measured | None, _plain("length")] = None
    front_droop: Annotated[Measured | None, _plain("length")] = None
    rear_bump: Annotated[Measured | None, _plain("length")] = None
    rear_droop: Annotated[Measured | None, _plain("length")] = None


class SensorTable(_Table):
    """``[sensors.<channel>]``."""

    zero_counts: Annotated[float | None, PlainValidator(_number)] = None
    counts_scale: Annotated[
        Measured | None,
        PlainValidator(partial(_quantity, "acceleration", "counts_scale", _LARGEST_SD, True)),
    ] = None
    range: Annotated[RangeSI | None, PlainValidator(_range)] = None
    noise: Annotated[Measured | None, _plain("acceleration")] = None
    resolution: Annotated[Measured | None, _plain("acceleration")] = None
    bandwidth: Annotated[Measured | None, _plain("frequency")] = None
    delay: Annotated[Measured | None, _plain("time", "delay")] = None


class UnsprungTable(_Table):
    """``[unsprung]``: wheels and tyres, both sides of an axle together."""

    front_mass: Annotated[Measured, _plain("mass")]
    rear_mass: Annotated[Measured, _plain("mass")]
    front_tyre_rate: Annotated[Measured, _plain("stiffness")]
    rear_tyre_rate: Annotated[Measured, _plain("stiffness")]
    front_tyre_damping: Annotated[Measured | None, _plain("damping")] = None
    rear_tyre_damping: Annotated[Measured | None, _plain("damping")] = None


class RollTable(_Table):
    """``[roll]``: what a car needs to roll."""

    front_track: Annotated[Measured, _given("length")]
    rear_track: Annotated[Measured, _given("length")]
    inertia: Annotated[Measured, _nominal("pitch_inertia")]
    front_bar: Annotated[Measured | None, _plain("stiffness")] = None
    rear_bar: Annotated[Measured | None, _plain("stiffness")] = None
    front_sensors: Annotated[Measured | None, _plain("length")] = None


class SensorsTable(_Table):
    """``[sensors]``, one table a channel; those of a corner only for a car that rolls."""

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


class VehicleTables(_Table):
    """The whole file."""

    name: Annotated[str, Field(max_length=200)] = ""
    units: Literal["US", "SI"]
    known: KnownTable
    nominal: NominalTable
    travel: TravelTable = TravelTable()
    sensors: SensorsTable = SensorsTable()
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
        Its tables, every number in SI.

    Raises
    ------
    InputError
        With the key at fault and the mend.
    """
    text = decode(data, where)
    try:
        raw = tomllib.loads(text.replace("\r\n", "\n"))
    except tomllib.TOMLDecodeError as exc:
        raise InputError(where, f"is not TOML: {exc}", "mend that line") from None
    except (ValueError, RecursionError):  # numbers of thousands of digits, brackets without end
        raise InputError(where, "is not TOML that can be read", "write it anew") from None
    try:
        return VehicleTables.model_validate(raw)
    except ValidationError as exc:
        raise _first_fault(exc, where) from None


def _first_fault(error: ValidationError, where: str) -> InputError:
    """One line for all faults: the first in full, the others by name."""
    # A misspelt key shows twice, as unknown and as missing; the unknown one tells more.
    faults = sorted(error.errors(), key=lambda fault: fault["type"] != "extra_forbidden")
    first, others = faults[0], [_key(fault["loc"]) for fault in faults[1:]]
    what, mend = _explain(first["type"], first["loc"], first["msg"], first.get("ctx", {}))
    if others:
        more = f" and {len(others) - 3} more" if len(others) > 3 else ""
        what += f" (also at fault: {', '.join(others[:3])}{more})"
    return InputError(f"{where}: {_key(first['loc'])}", what, mend)


def _explain(
    kind: str, place: tuple[int | str, ...], message: str, context: Mapping[str, Any]
) -> tuple[str, str]:
    if kind == "quantity":
        return str(context["what"]), str(context["mend"])
    if kind == "extra_forbidden":
        return "unknown key", _where_it_belongs(place)
    if kind == "missing":
        return "is missing", f"add {place[-1]}" + (" = ..." if len(place) > 1 else "")
    if place[-1:] == ("units",):
        return "is not a system of units", 'write units = "US" or units = "SI"'
    if kind.startswith("model"):
        return "is not a table", f"write it as [{'.'.join(map(str, place))}]"
    return message, "mend it as in data/vehicles"


def _where_it_belongs(place: tuple[int | str, ...]) -> str:
    table: type[BaseModel] = VehicleTables
    for part in place[:-1]:
        inner = table.model_fields[str(part)].annotation
        for choice in (inner, *get_args(inner)):  # a table, or a table or None
            if isinstance(choice, type) and issubclass(choice, BaseModel):
                table = choice
    key = str(place[-1])
    for name, other in _HOMES:
        if key in other.model_fields and other is not table:
            return f"move it to [{name}]"
    near = closest(key, table.model_fields)
    return f"did you mean {near}?" if near else f"known are {', '.join(table.model_fields)}"


def _key(place: tuple[int | str, ...]) -> str:
    """``("sensors", "front_wheel", "noise")`` as ``[sensors.front_wheel] noise``."""
    parts = [str(part) for part in place]
    if len(parts) <= 1:
        return f"[{parts[0]}]" if parts and parts[0] in _TABLES else "".join(parts) or "top level"
    if parts[0] == "sensors" and len(parts) == 2:
        return f"[{'.'.join(parts)}]"
    return f"[{'.'.join(parts[:-1])}] {parts[-1]}"


_HOMES: Final[tuple[tuple[str, type[BaseModel]], ...]] = (
    ("known", KnownTable), ("nominal", NominalTable), ("travel", TravelTable),
    ("unsprung", UnsprungTable), ("roll", RollTable),
)  # fmt: skip
_TABLES: Final = frozenset({"known", "nominal", "travel", "sensors", "unsprung", "roll"})
