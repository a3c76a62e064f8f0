"""Conversion of units: SI floats inside the package, named units at its boundary.

A recursive-descent parser reads unit texts (products, quotients, small integer powers,
parentheses), so no text from a file is ever evaluated.  Common units are in a table of exact
fractions.  Other names are looked up in pint, which is imported only then because that takes a
third of a second.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from bayes_asv.domain.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = [
    "FOOT", "INCH", "KMH", "MPH", "STANDARD_GRAVITY", "display_units", "from_si", "parse_quantity",
    "si_factor", "si_unit", "to_si",
]  # fmt: skip

Powers = tuple[int, int, int]
"""Integer powers of mass, length and time."""


class _Factor(NamedTuple):
    """A unit as an exact multiple of kg^a m^b s^c."""

    scale: Fraction
    powers: Powers
    angular: bool = False  # contains a radian, turn or degree


class _Dimension(NamedTuple):
    powers: Powers
    si: str
    examples: str


_DIMENSIONS: Final = {
    "mass": _Dimension((1, 0, 0), "kg", "kg, lbm or lbf*s^2/in"),
    "length": _Dimension((0, 1, 0), "m", "m, mm or in"),
    "deflection": _Dimension((0, 1, 0), "m", "m, mm or in"),
    "time": _Dimension((0, 0, 1), "s", "s, ms or us"),
    "frequency": _Dimension((0, 0, -1), "Hz", "Hz"),
    "velocity": _Dimension((0, 1, -1), "m/s", "m/s or in/s"),
    "acceleration": _Dimension((0, 1, -2), "m/s^2", "m/s^2, in/s^2 or g"),
    "angular_rate": _Dimension((0, 0, -1), "rad/s", "deg/s or rad/s"),
    "force": _Dimension((1, 1, -2), "N", "N or lbf"),
    "stiffness": _Dimension((1, 0, -2), "N/m", "N/m, N/mm or lbf/in"),
    "damping": _Dimension((1, 0, -1), "N*s/m", "N*s/m or lbf*s/in"),
    "pitch_inertia": _Dimension((1, 2, 0), "kg*m^2", "kg*m^2 or lbf*s^2*in"),
    "dimensionless": _Dimension((0, 0, 0), "1", "no unit, or %"),
}

_IN = Fraction(254, 10_000)
_LBM = Fraction(45_359_237, 100_000_000)
_G0 = Fraction(980_665, 100_000)
_LBF = _LBM * _G0
_PI = Fraction("3.1415926535897932384626433832795028841971693993751")
_MASS, _LENGTH, _TIME, _FORCE = (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, -2)
_ACCELERATION, _NONE = (0, 1, -2), (0, 0, 0)

_ONE = _Factor(Fraction(1), _NONE)

# Units common in vehicle files and recordings; a test compares them with pint.
_UNITS: Final[Mapping[str, _Factor]] = MappingProxyType(
    {
        "m": _Factor(Fraction(1), _LENGTH),
        "mm": _Factor(Fraction(1, 1000), _LENGTH),
        "in": _Factor(_IN, _LENGTH),
        "ft": _Factor(12 * _IN, _LENGTH),
        "s": _Factor(Fraction(1), _TIME),
        "sec": _Factor(Fraction(1), _TIME),
        "ms": _Factor(Fraction(1, 1000), _TIME),
        "us": _Factor(Fraction(1, 1_000_000), _TIME),
        "µs": _Factor(Fraction(1, 1_000_000), _TIME),
        "Hz": _Factor(Fraction(1), (0, 0, -1)),
        "kg": _Factor(Fraction(1), _MASS),
        "lbm": _Factor(_LBM, _MASS),
        "N": _Factor(Fraction(1), _FORCE),
        "lbf": _Factor(_LBF, _FORCE),
        "g0": _Factor(_G0, _ACCELERATION),
        "rad": _Factor(Fraction(1), _NONE, angular=True),
        "deg": _Factor(_PI / 180, _NONE, angular=True),
        "counts": _Factor(Fraction(1), _NONE),
        "%": _Factor(Fraction(1, 100), _NONE),
        "ppm": _Factor(Fraction(1, 1_000_000), _NONE),
    }
)

# Accelerometer data sheets write g for standard gravity; elsewhere g is the gram.
_GRAVITY: Final[Mapping[str, _Factor]] = MappingProxyType(
    {
        "g": _Factor(_G0, _ACCELERATION),
        "G": _Factor(_G0, _ACCELERATION),
        "g_0": _Factor(_G0, _ACCELERATION),
        "gn": _Factor(_G0, _ACCELERATION),
        "mg": _Factor(_G0 / 1000, _ACCELERATION),
        "ug": _Factor(_G0 / 1_000_000, _ACCELERATION),
        "µg": _Factor(_G0 / 1_000_000, _ACCELERATION),
    }
)

_AMBIGUOUS: Final = frozenset({"lb", "lbs", "pound", "pounds"})

_MAX_LENGTH: Final = 64
_MAX_POWER: Final = 4
_MAX_TOTAL_POWER: Final = 12
_FOLD: Final = str.maketrans({"·": "*", "⋅": "*", "×": "*", "−": "-", "μ": "µ", "⁻": "-"})
_SUPERSCRIPT: Final = re.compile(r"(-?)([²³⁴¹])")
_SUPERSCRIPT_DIGITS: Final = str.maketrans("¹²³⁴", "1234")
_TOKEN: Final = re.compile(r" *(?:(\*\*|[*/^()])|([A-Za-zµ_][A-Za-z0-9µ_]*|%)|(-?[0-9]+))")
_NUMBER: Final = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_MAX_NUMBER_LENGTH: Final = 400

STANDARD_GRAVITY: Final = float(_G0)
"""m/s²."""
INCH: Final = float(_IN)
FOOT: Final = float(12 * _IN)
"""m."""
MPH: Final = float(5280 * 12 * _IN / 3600)
KMH: Final = 1.0 / 3.6
"""m/s."""

_SYSTEMS: Final = ("US", "SI")
_DISPLAY: Final = {
    "mass": ("lbf*s^2/in", "kg"),
    "length": ("in", "m"),
    "deflection": ("in", "mm"),
    "time": ("s", "s"),
    "frequency": ("Hz", "Hz"),
    "velocity": ("in/s", "m/s"),
    "acceleration": ("in/s^2", "m/s^2"),
    "angular_rate": ("deg/s", "deg/s"),
    "force": ("lbf", "N"),
    "stiffness": ("lbf/in", "N/m"),
    "damping": ("lbf*s/in", "N*s/m"),
    "pitch_inertia": ("lbf*s^2*in", "kg*m^2"),
    "dimensionless": ("", ""),
}


@lru_cache(maxsize=512)
def si_factor(unit: str, dimension: str) -> float:
    """Return the factor from `unit` to the SI unit of `dimension`.

    Factors are exact (in = 0.0254 m, lbm = 0.45359237 kg, g0 = 9.80665 m/s^2) and rounded to a
    float once, at the end. Only multiplicative units are accepted.

    Parameters
    ----------
    unit : str
        For example ``"lbf*s/in"``. For an acceleration, ``g``, ``G``, ``mg`` and ``g0`` mean
        standard gravity, never the gram.
    dimension : str
        ``"mass"``, ``"length"``, ``"deflection"``, ``"time"``, ``"frequency"``, ``"velocity"``,
        ``"acceleration"``, ``"angular_rate"``, ``"force"``, ``"stiffness"``, ``"damping"``,
        ``"pitch_inertia"`` or ``"dimensionless"``.

    Returns
    -------
    float
        SI units per `unit`, positive and finite.

    Raises
    ------
    InputError
        If the unit is not known, is ambiguous (a bare ``lb``) or is of another dimension.
    KeyError
        If `dimension` is not one of the above, an error of the caller.
    """
    wanted = _DIMENSIONS[dimension]
    factor = _UnitParser(unit, dimension).read()
    if factor.powers != wanted.powers:
        raise _unit_error(
            unit, f"is not a unit of {_dimension_name(dimension)}", f"use {wanted.examples}"
        )
    if factor.angular and dimension == "frequency":
        # 60 rpm would become 6.28 per second without notice
        raise _unit_error(unit, "counts angle, not cycles", "give the frequency in Hz")
    try:
        scale = float(factor.scale)
    except OverflowError:
        scale = math.inf
    if not 0.0 < scale < math.inf:
        raise _unit_error(unit, "is too large or too small a unit", f"use {wanted.examples}")
    return scale


def si_unit(dimension: str) -> str:
    """Return the SI unit of a physical dimension as text, ``"1"`` for a dimensionless ratio.

    Raises
    ------
    KeyError
        If `dimension` is not one of those of `si_factor`.
    """
    return _DIMENSIONS[dimension].si


def to_si(value: float, unit: str, dimension: str) -> float:
    """`value` given in `unit`, in the SI unit of `dimension`.

    Raises
    ------
    InputError
        As for `si_factor`.
    """
    return value * si_factor(unit, dimension)


def from_si(value: float, unit: str, dimension: str) -> float:
    """`value` given in the SI unit of `dimension`, in `unit`.

    Raises
    ------
    InputError
        As for `si_factor`.
    """
    return value / si_factor(unit, dimension)


def parse_quantity(text: str) -> tuple[float, str]:
    """Split a text such as ``"100 lbf/in"`` into its number and its unit.

    Parameters
    ----------
    text : str
        A decimal number, then an optional unit.

    Returns
    -------
    tuple of float and str
        The number as written, and the unit (empty when there is none).

    Raises
    ------
    InputError
        If the text does not start with a finite number.
    """
    stripped = text.strip()
    match = _NUMBER.match(stripped) if len(stripped) <= _MAX_NUMBER_LENGTH else None
    if match is None or not math.isfinite(value := float(match.group())):
        raise InputError(
            f"'{_truncated(text)}'", "is not a number with a unit", 'write "100 lbf/in"'
        )
    return value, stripped[match.end() :].strip()


def display_units(system: str) -> Mapping[str, str]:
    """Units in which results are shown, by dimension.

    Parameters
    ----------
    system : str
        ``"US"`` or ``"SI"``.

    Returns
    -------
    Mapping of str to str
        Unit text for each dimension `si_factor` knows; ``""`` for dimensionless.

    Raises
    ------
    InputError
        If `system` is neither.
    """
    if system not in _SYSTEMS:
        raise InputError(
            f"units '{_truncated(str(system))}'", "is not a system of units", 'use "US" or "SI"'
        )
    place = _SYSTEMS.index(system)
    return MappingProxyType({dimension: pair[place] for dimension, pair in _DISPLAY.items()})


class _UnitParser:
    """Recursive descent over ``product := power (("*" | "/" | " ") power)*``."""

    def __init__(self, unit: str, dimension: str) -> None:
        self.unit = unit
        self.dimension = dimension
        self.tokens = self._split()
        self.at = 0

    def read(self) -> _Factor:
        if not self.tokens:
            if self.dimension == "dimensionless":
                return _ONE
            raise _unit_error(self.unit, "is empty", f"use {_DIMENSIONS[self.dimension].examples}")
        factor = self._product()
        if self.at < len(self.tokens):
            raise self._malformed()
        return factor

    def _split(self) -> list[str]:
        # Checking length and alphabet first bounds the time and memory of what follows.
        if len(self.unit) > _MAX_LENGTH:
            raise _unit_error(
                self.unit, "is not a unit", f"use {_DIMENSIONS[self.dimension].examples}"
            )
        text = self.unit.translate(_FOLD).strip()
        text = _SUPERSCRIPT.sub(r"^\1\2", text).translate(_SUPERSCRIPT_DIGITS)
        tokens, at = [], 0
        while at < len(text):
            match = _TOKEN.match(text, at)
            if match is None:
                raise self._malformed()
            tokens.append(match.group().strip())
            at = match.end()
        return tokens

    def _malformed(self) -> InputError:
        return _unit_error(
            self.unit, "is not written as a unit", f"use {_DIMENSIONS[self.dimension].examples}"
        )

    def _peek(self) -> str:
        return self.tokens[self.at] if self.at < len(self.tokens) else ""

    def _take(self) -> str:
        token = self._peek()
        self.at += 1
        return token

    def _product(self) -> _Factor:
        result = self._power()
        while (token := self._peek()) not in ("", ")"):
            if token in ("*", "/"):
                self.at += 1
            result = _times(result, self._power(), -1 if token == "/" else 1)
            if max(map(abs, result.powers)) > _MAX_TOTAL_POWER:
                raise self._malformed()
        return result

    def _power(self) -> _Factor:
        token = self._take()
        if token == "(":
            inner = self._product()
            if self._take() != ")":
                raise self._malformed()
            return inner
        if token == "1":
            return _ONE
        if not (token[:1].isalpha() or token[:1] in ("_", "%")):
            raise self._malformed()
        # Only a name may have a power: powers of powers grow without bound.
        if self._peek() in ("^", "**"):
            self.at += 1
            return _times(_ONE, self._name(token), self._exponent(self._take()))
        if len(token) > 1 and token[-1] in "23" and token[:-1] in _UNITS:
            return _times(_ONE, self._name(token[:-1]), int(token[-1]))  # many loggers write m/s2
        return self._name(token)

    def _exponent(self, token: str) -> int:
        if not re.fullmatch(r"-?[0-9]", token) or abs(int(token)) > _MAX_POWER:
            raise self._malformed()
        return int(token)

    def _name(self, name: str) -> _Factor:
        if name in _AMBIGUOUS:
            raise _unit_error(
                self.unit,
                f"contains '{name}', which may be a force or a mass",
                "write lbf (force) or lbm (mass)",
            )
        if self.dimension == "acceleration" and name in _GRAVITY:
            return _GRAVITY[name]
        if name in _UNITS:
            return _UNITS[name]
        factor = _from_pint(name)
        if factor is None:
            raise _unit_error(
                self.unit,
                f"contains '{name}', which is not a usable unit",
                f"use {_DIMENSIONS[self.dimension].examples}",
            )
        return factor


def _times(a: _Factor, b: _Factor, power: int) -> _Factor:
    """Return a * b^power."""
    (m, n, t), (p, q, r) = a.powers, b.powers
    powers = (m + power * p, n + power * q, t + power * r)
    return _Factor(a.scale * b.scale**power, powers, a.angular or b.angular)


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint

    return pint.UnitRegistry(non_int_type=Fraction, cache_folder=None)


@lru_cache(maxsize=256)
def _from_pint(name: str) -> _Factor | None:
    """Look up a unit in pint; None unless it is a multiple of kg, m and s powers."""
    registry = _registry()
    try:
        unit = registry.Unit(name)
        scale, root = registry.get_root_units(unit, check_nonmult=True)
        bases = dict(root._units)
        angular = bases.pop("radian", 0) != 0
        powers = [bases.pop(base, 0) for base in ("gram", "meter", "second")]
        bases.pop("count", None)
        if bases or any(p != int(p) for p in powers):
            return None
        exact = Fraction(scale) / 1000 ** int(
            powers[0]
        )  # the base unit of mass in pint is the gram
        # degrees Celsius and decibels have a base unit but no factor
        if not registry.Quantity(Fraction(1), unit)._is_multiplicative or exact <= 0:
            return None
    except Exception:  # pint raises many types; each means that the unit is not usable
        return None
    return _Factor(exact, (int(powers[0]), int(powers[1]), int(powers[2])), angular)


def _truncated(text: str) -> str:
    return text if len(text) <= _MAX_LENGTH else text[:_MAX_LENGTH] + "…"


def _dimension_name(dimension: str) -> str:
    return "a dimensionless ratio" if dimension == "dimensionless" else dimension.replace("_", " ")


def _unit_error(unit: object, what: str, fix: str) -> InputError:
    return InputError(f"unit '{_truncated(str(unit))}'", what, fix)
