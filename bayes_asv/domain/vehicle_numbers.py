"""Quantities of a vehicle file: text or tables with units and standard deviations, to SI."""

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
from bayes_asv.domain.units import parse_quantity, si_factor, si_unit

__all__ = [
    "Measured", "RangeSI", "clock_error", "given", "nominal", "reading_range", "unitless",
    "without_sd",
]  # fmt: skip


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
