"""Numbers of a vehicle file: text or tables with units and deviations, checked, turned into SI."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import partial
from typing import Any, Final, NamedTuple

from pydantic import PlainValidator
from pydantic_core import PydanticCustomError

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import closest
from bayes_asv.domain.units import parse_quantity, si_factor

__all__ = ["Measured", "RangeSI", "count", "given", "nominal", "plain", "reading_range"]


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


def given(dimension: str, name: str = "") -> Any:
    """Validate what is known; its deviation may be zero."""
    return PlainValidator(partial(_quantity, dimension, name, _LARGEST_SD, True))


def nominal(dimension: str) -> Any:
    """Validate what is to be found; its deviation may be wide."""
    return PlainValidator(partial(_quantity, dimension, "", _LARGEST_PRIOR_SD, False))


def plain(dimension: str, name: str = "") -> Any:
    """Validate a figure without a deviation."""
    return PlainValidator(partial(_quantity, dimension, name, None, True))


count: Final = PlainValidator(_number)
"""A plain number without a unit."""
reading_range: Final = PlainValidator(_range)
"""Lowest and highest reading."""
