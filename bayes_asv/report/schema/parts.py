"""Types that several documents share: bounded numbers and texts, parameters, effects, files."""

from __future__ import annotations

import math
from typing import Annotated, Any, Final, Generic, Self, TypeVar, cast

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    model_validator,
)
from pydantic_core import core_schema

from bayes_asv.domain.channels import KNOWN_CHANNELS
from bayes_asv.domain.clocks import GROUPS
from bayes_asv.domain.quantities import QUANTITIES

__all__ = [
    "MAX_POINTS",
    "Axle",
    "Band",
    "ByName",
    "Channel",
    "Count",
    "Curve",
    "DamperShape",
    "DampingRates",
    "Effect",
    "EffectName",
    "EffectValue",
    "Element",
    "ElementName",
    "Finite",
    "Interval",
    "Known",
    "MaybeNumber",
    "MaybeShare",
    "Model",
    "NonNegative",
    "OneOf",
    "Parameter",
    "Positive",
    "PossibleMistake",
    "Provenance",
    "Quantity",
    "QuantityName",
    "Share",
    "SourceFile",
    "SpringCurve",
    "SpringShape",
    "Summary",
    "Text",
    "Texts",
    "TravelLimits",
    "Unit",
    "VehicleInfo",
    "check_lengths",
    "half_car",
]

MAX_POINTS: Final = 100_000
_LARGEST: Final = 1e15
_SMALLEST: Final = 1e-30


def _none_unless_finite(value: Any) -> Any:
    """JSON has no NaN and no infinity: an optional number that does not exist is null."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


Finite = Annotated[float, Field(ge=-_LARGEST, le=_LARGEST, allow_inf_nan=False)]
Positive = Annotated[float, Field(ge=_SMALLEST, le=_LARGEST, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0.0, le=_LARGEST, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
MaybeNumber = Annotated[Finite | None, BeforeValidator(_none_unless_finite)]
MaybeShare = Annotated[Share | None, BeforeValidator(_none_unless_finite)]
Count = Annotated[int, Field(ge=0, le=10**12)]
Text = Annotated[str, Field(max_length=10_000)]
Texts = Annotated[list[Text], Field(max_length=1000)]
Unit = Annotated[str, Field(max_length=64)]
Curve = Annotated[list[Finite | None], Field(max_length=MAX_POINTS)]
Band = Annotated[list[Curve], Field(min_length=2, max_length=2)]
Interval = Annotated[list[Finite], Field(min_length=2, max_length=2)]


class OneOf:
    """Annotation of a text that is one of several: a ``Literal`` of static type ``str``."""

    def __init__(self, *values: str) -> None:
        self.values = values

    def __get_pydantic_core_schema__(
        self, source: type[Any], handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        """Accept the values and nothing else."""
        return core_schema.literal_schema(list(self.values))


Axle = Annotated[str, OneOf("front", "rear")]
Channel = Annotated[str, OneOf(*KNOWN_CHANNELS)]
_ELEMENTS: Final = tuple(n.removesuffix("_wheel") for n in KNOWN_CHANNELS if n.endswith("_wheel"))
ElementName = Annotated[str, OneOf(*_ELEMENTS)]
"""A suspension element: an axle, or one side of it."""
EffectPlace = Annotated[str, OneOf("both", *_ELEMENTS, *KNOWN_CHANNELS, *GROUPS)]
QuantityName = Annotated[str, OneOf(*QUANTITIES)]


class Model(BaseModel):
    """Base class: no conversion of types, and keys of later versions are kept."""

    model_config = ConfigDict(strict=True, extra="allow")

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON, with the keys that were given."""
        return self.model_dump(by_alias=True, exclude_unset=True)


Entry = TypeVar("Entry")


class ByName(Model, Generic[Entry]):
    """An object that has, beside its own fields, one entry for each of several names.

    A subclass annotates ``__pydantic_extra__`` with the types of names and entries.
    """

    @property
    def entries(self) -> dict[str, Entry]:
        """Entries in the order of the document."""
        return cast("dict[str, Entry]", self.__pydantic_extra__)


class _Interval(Model):
    """A value with its 95 % interval."""

    mean: Finite
    eti95: Interval
    """Equal-tailed 95 % interval."""

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        low, high = self.eti95
        if low > high:
            raise ValueError("the interval ends before it begins")
        return self


class _Labelled(Model):
    label: Text = ""
    unit: Unit = ""


class Summary(_Interval):
    """Mean, median, standard deviation and 95 % interval."""

    median: MaybeNumber = None
    sd: NonNegative


class Quantity(Summary, _Labelled):
    """The same with unit and, where there is one, the nominal value."""

    nominal: MaybeNumber = None


class Parameter(Quantity):
    """An estimated parameter in the vehicle's units."""

    unit: Unit
    p_below_nominal: MaybeShare = None
    """Posterior probability that it is below nominal; of damping one that counts
    ``nominal_mistakes``."""
    withheld: bool = False
    """Whether the comparison with nominal is withheld: see ``doubt`` and ``dampers``."""
    si: Quantity | None = None
    """The same in SI units."""


class Known(_Labelled):
    """A given value of the vehicle, and what the recordings say of it."""

    unit: Unit
    value: Finite
    sd: NonNegative | None = None
    """Standard deviation as given; 0 for a value given as exact."""
    posterior: Summary | None = None


class EffectValue(_Interval):
    """A parameter of an effect."""

    unit: Unit = ""


class EffectName(Model):
    """An effect and its place."""

    name: Annotated[str, Field(max_length=64)]
    where: EffectPlace | None = None
    """Axle or sensor channel; null for an effect on the whole car."""
    title: Text = ""


class Effect(EffectName):
    """An effect with its parameters."""

    parameters: Annotated[dict[Text, EffectValue], Field(max_length=20)]


class DamperShape(Model):
    """A statement about a damper's curve."""

    name: Annotated[str, OneOf("digressive", "progressive", "unequal_sides")]
    side: Annotated[str, OneOf("compression", "extension", "both")]
    probability: Share
    ratio: EffectValue
    """Slope in fast over slope in slow motion, or force in extension over compression; its mean is
    geometric."""


class PossibleMistake(Model):
    """A mistake in the input that may explain what was found."""

    words: Text
    fix: Text
    """What to do."""
    probability: Share


class DampingRates(Model):
    """Rates of a damper whose force is not proportional to speed."""

    element: ElementName
    speed: NonNegative
    """Root mean square of the rates of deflection that were driven."""
    speed_unit: Unit
    at_rest: EffectValue
    """Slope of its curve at rest."""
    equal_power: EffectValue
    """Rate of the linear damper that takes the same power at the speeds driven.

    Dry friction at the element is part of that power.
    """
    compression: EffectValue
    """Force over speed in compression at ``speed``."""
    extension: EffectValue
    shapes: Annotated[list[DamperShape], Field(max_length=5)] = Field(default_factory=list)
    """What is more probable than not of its curve."""


class SpringShape(Model):
    """A statement about a spring's curve."""

    name: Annotated[str, OneOf("softening", "stiffening", "unequal_sides")]
    side: Annotated[str, OneOf("compression", "extension", "both")]
    probability: Share
    ratio: EffectValue
    """Slope far from rest over slope near rest, or force in extension over compression; its mean
    is geometric."""


class SpringCurve(Model):
    """Force over deflection of a spring whose force is not proportional to travel.

    Extension is positive, and so is a force that resists it.
    """

    element: ElementName
    travel: Interval
    """Compression and extension that were used, extension positive."""
    unit: Unit
    force_unit: Unit
    at_rest: EffectValue
    """Stiffness at rest."""
    compression: EffectValue
    """Force over deflection in compression at ``travel``."""
    extension: EffectValue
    shapes: Annotated[list[SpringShape], Field(max_length=5)] = Field(default_factory=list)
    """What is more probable than not of its curve."""
    deflection: Curve
    median: Curve
    band95: Band
    nominal: Curve
    """Of the nominal stiffness."""

    @model_validator(mode="after")
    def _check_curves(self) -> Self:
        check_lengths(len(self.deflection), self.median, *self.band95, self.nominal)
        return self


class SourceFile(Model):
    """A file with its hash."""

    file: Text = ""
    sha256: Text = ""


class Provenance(Model):
    """Files, versions and seed that a document was made of."""

    recordings: Annotated[list[SourceFile], Field(max_length=1000)] = Field(default_factory=list)
    vehicle: SourceFile | None = None
    bayes_asv: Text = ""
    python: Text = ""
    packages: dict[Text, Text] = Field(default_factory=dict)
    seed: Count = 0
    order: Texts = Field(default_factory=list)
    """Names of the sampled parameters of the car, in the sampler's order."""


class TravelLimits(Model):
    """Suspension travel from rest to the stops; bump is compression."""

    unit: Unit = ""
    front_bump: Positive | None = None
    front_droop: Positive | None = None
    rear_bump: Positive | None = None
    rear_droop: Positive | None = None


class VehicleInfo(Model):
    """The vehicle file."""

    name: Text = ""
    units: Annotated[str, OneOf("US", "SI")] = "SI"
    source: Text = ""
    sha256: Text = ""
    travel: TravelLimits | None = None


def check_lengths(count: int | None, *curves: list[Any]) -> None:
    """Refuse curves of different lengths; a count of None is the length of the first curve."""
    wanted = len(curves[0]) if count is None and curves else count
    if any(len(curve) != wanted for curve in curves):
        raise ValueError("curves of one figure differ in length")


class Element(Model):
    """A spring and a damper between body and wheel: of one axle, or of one side of it."""

    axle: Axle
    side: Annotated[str, OneOf("left", "right")] | None = None
    damping: QuantityName
    """Name of the parameter that is its damping rate."""
    spring: QuantityName
    """Name of the parameter that is its spring rate."""


def half_car() -> dict[str, Element]:
    """Suspension elements of the half car, the model of documents that name none."""
    return {
        "front": Element(axle="front", damping="c_f", spring="k_f"),
        "rear": Element(axle="rear", damping="c_r", spring="k_r"),
    }
