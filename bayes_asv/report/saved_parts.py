"""Parts that saved documents have in common: bounds of numbers and texts, parameters, files."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

__all__ = [
    "Axle",
    "Band",
    "Channel",
    "Chassis",
    "Count",
    "Curve",
    "Effect",
    "File",
    "Finite",
    "Other",
    "Pair",
    "Parameter",
    "Part",
    "Positive",
    "Provenance",
    "Sentences",
    "Share",
    "Shown",
    "Size",
    "Summary",
    "Unit",
    "Value",
    "Words",
    "alike",
]

_MOST_POINTS: Final = 100_000
_LARGEST: Final = 1e15
_SMALLEST: Final = 1e-30

Finite = Annotated[float, Field(ge=-_LARGEST, le=_LARGEST, allow_inf_nan=False)]
Positive = Annotated[float, Field(ge=_SMALLEST, le=_LARGEST, allow_inf_nan=False)]
Size = Annotated[float, Field(ge=0.0, le=_LARGEST, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
Words = Annotated[str, Field(max_length=10_000)]
Unit = Annotated[str, Field(max_length=64)]
Count = Annotated[int, Field(ge=0, le=10**12)]
Curve = Annotated[list[Finite | None], Field(max_length=_MOST_POINTS)]
Sentences = Annotated[list[Words], Field(max_length=1000)]
Pair = Annotated[list[Finite], Field(min_length=2, max_length=2)]
Band = Annotated[list[Curve], Field(min_length=2, max_length=2)]
Axle = Literal["front", "rear"]
Channel = Literal["front_wheel", "front_chassis", "rear_wheel", "rear_chassis"]
Chassis = Literal["front_chassis", "rear_chassis"]


class Part(BaseModel):
    """What every part keeps to: no conversion of types, further keys left alone."""

    model_config = ConfigDict(strict=True, extra="allow")


class Summary(Part):
    """A mean with its 95 % interval."""

    mean: Finite
    median: Finite | None = None
    sd: Size
    eti95: Pair

    @model_validator(mode="after")
    def _ordered(self) -> Summary:
        low, high = self.eti95
        if low > high:
            raise ValueError("the interval ends before it begins")
        return self


class Shown(Summary):
    """The same with its unit and, where there is one, its nominal value."""

    unit: Unit
    nominal: Finite | None = None


class Parameter(Shown):
    """A parameter as the report shows it."""

    label: Words = ""
    p_below_nominal: Share | None = None
    si: Shown | None = None


class Value(Part):
    """A parameter of an effect."""

    mean: Finite
    eti95: Pair
    unit: Unit = ""

    @model_validator(mode="after")
    def _ordered(self) -> Value:
        low, high = self.eti95
        if low > high:
            raise ValueError("the interval ends before it begins")
        return self


class Other(Part):
    """An effect by name and place."""

    name: Annotated[str, Field(max_length=64)]
    where: Axle | Channel | Literal["both"] | None = None
    title: Words = ""


class Effect(Other):
    """An effect with its parameters."""

    parameters: Annotated[dict[Words, Value], Field(max_length=20)]


class File(Part):
    """A file with its hash."""

    file: Words = ""
    sha256: Words = ""


class Provenance(Part):
    """Where a document comes from."""

    recordings: Annotated[list[File], Field(max_length=1000)] = []
    vehicle: File | None = None
    python: Words = ""
    packages: dict[Words, Words] = {}


def alike(count: int | None, *curves: list[float | None]) -> None:
    """Refuse curves of different lengths; a count of None is that of the first."""
    wanted = len(curves[0]) if count is None and curves else count
    if any(len(curve) != wanted for curve in curves):
        raise ValueError("curves of one figure differ in length")
