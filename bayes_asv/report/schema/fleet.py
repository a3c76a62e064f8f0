"""Document of a season of recordings."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from bayes_asv.report.schema.estimate import EstimateDocument
from bayes_asv.report.schema.parts import (
    Count,
    Curve,
    Interval,
    Model,
    NonNegative,
    OneOf,
    Parameter,
    Positive,
    Provenance,
    QuantityName,
    Share,
    Text,
    Texts,
    Unit,
    VehicleInfo,
    check_lengths,
)

__all__ = ["FleetAnswer", "FleetChange", "FleetDocument", "FleetFile", "FleetTrend", "FleetValue"]


class FleetAnswer(EstimateDocument):
    """Estimate of one recording of a season."""

    recorded: Text = ""
    """When it was recorded, as its metadata say; ISO 8601."""


class FleetValue(Model):
    """A parameter in one recording, in the vehicle's units."""

    mean: NonNegative
    sd: NonNegative
    eti95: Interval


class FleetFile(Model):
    """One recording and what came of it."""

    file: Text
    sha256: Text = ""
    verdict: Annotated[
        str,
        OneOf("ok", "doubtful", "not_converged", "refused", "unreadable", "failed", "duplicate"),
    ]
    reason: Text = ""
    """Why it has no verdict on the dampers."""
    date: Text
    """ISO 8601, without a time zone."""
    date_from: Annotated[str, OneOf("metadata", "name", "file")]
    """Where the date is from; ``file`` is the time at which the file was last written."""
    answer: Text = ""
    """Name of the estimate's JSON in the folder of answers."""
    car: Text = ""
    parameters: dict[QuantityName, FleetValue] = Field(default_factory=dict)


class Ratio(Model):
    """Level after over level before."""

    median: Positive
    eti95: Interval


class FleetChange(Ratio):
    """A sudden change of a damping rate."""

    after: Text
    """Date of the last recording that is surely before it (95 %)."""
    before: Text
    """Date of the first recording that is surely after it."""
    probability: Share


class FleetTrend(Model):
    """A damping rate over the season."""

    label: Text
    unit: Unit
    nominal: Positive
    kind: Annotated[str, OneOf("no change", "gradual", "sudden")]
    """The most probable hypothesis."""
    p_no_change: Share
    p_gradual: Share
    p_sudden: Annotated[list[Share], Field(max_length=20)]
    """Probabilities of one, two, … sudden changes."""
    p_value: Share
    """Of the test that nothing changed."""
    gradual: Ratio
    """Last level over first, if the change is gradual."""
    changes: Annotated[list[FleetChange], Field(max_length=20)]
    """Sudden changes that are more probable than not."""
    scatter: Ratio
    """Standard deviation from run to run, as a share of the rate."""
    latest: Parameter
    """Level at the last recording, with the errors of the given values."""
    date: Annotated[list[Text], Field(max_length=100_000)]
    value: Curve
    """Each recording by itself, with the given values at their estimate."""
    value95: Annotated[list[Curve], Field(min_length=2, max_length=2)]
    level: Curve
    level95: Annotated[list[Curve], Field(min_length=2, max_length=2)]

    @model_validator(mode="after")
    def _check_curves(self) -> Self:
        check_lengths(len(self.date), self.value, *self.value95, self.level, *self.level95)
        return self


class FleetDocument(Model):
    """A season of recordings; written by ``bayes-asv fleet``."""

    schema_name: Literal["bayes_asv/fleet/1"] = Field(alias="schema")
    verdict: Annotated[str, OneOf("ok", "refused")]
    """``refused`` if no recording has a verdict."""
    reasons: Texts
    warnings: Texts
    counts: dict[Text, Count]
    """Number of recordings by verdict."""
    trends: dict[QuantityName, FleetTrend]
    files: Annotated[list[FleetFile], Field(max_length=100_000)]
    """In order of their dates."""
    vehicle: VehicleInfo = VehicleInfo()
    provenance: Provenance = Provenance()
    seconds: NonNegative = 0.0
    """Time of this run, without what was done before."""
    version: Text
    seed: Count
