"""``bayes_asv/track/1`` and ``bayes_asv/watch/1``."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from bayes_asv.report.schema.parts import (
    MAX_POINTS,
    Band,
    Channel,
    Count,
    Curve,
    Effect,
    Element,
    ElementName,
    Finite,
    Interval,
    Known,
    MaybeNumber,
    MaybeShare,
    Model,
    NonNegative,
    OneOf,
    Parameter,
    PossibleMistake,
    Provenance,
    QuantityName,
    Share,
    Text,
    Texts,
    Unit,
    VehicleInfo,
    check_lengths,
    half_car,
)

__all__ = ["TrackDocument", "WatchDocument"]


class Autocorrelation(Model):
    """Autocorrelation of the innovations, from lag 0."""

    front: Annotated[list[MaybeNumber], Field(max_length=1000)] = Field(default_factory=list)
    rear: Annotated[list[MaybeNumber], Field(max_length=1000)] = Field(default_factory=list)
    """Those of the chassis above an axle; empty where it is not measured."""
    outputs: dict[Channel, Annotated[list[MaybeNumber], Field(max_length=1000)]] = Field(
        default_factory=dict
    )
    """By measured output."""
    band95: NonNegative
    lags: Count = 0
    lag_seconds: NonNegative


class Consistency(Model):
    """Whether the errors of the filter match its stated uncertainty."""

    nis_mean: MaybeNumber
    """Mean normalised innovation squared; 1 for a consistent filter."""
    nis_band95: Annotated[list[MaybeNumber], Field(min_length=2, max_length=2)]
    verdict: Annotated[str, OneOf("consistent", "recovered", "inconsistent")]
    faults: Annotated[
        list[Annotated[str, OneOf("swollen", "coloured", "uneven", "optimistic", "pessimistic")]],
        Field(max_length=5),
    ]
    readings: Count
    share_of_time: Share
    """Share of the time in which the filter was consistent."""
    largest_noise_level: NonNegative
    """Largest factor on the standard deviation of the noise."""
    colour: MaybeNumber = None
    autocorrelation: Autocorrelation | None = None
    window_seconds: NonNegative = 0.0
    words: Texts = Field(default_factory=list)


class ParameterCurve(Model):
    """Median and 95 % band of a parameter against time."""

    unit: Unit
    median: Curve
    band95: Band


class NisCurve(Model):
    """Mean normalised innovation squared over a sliding window, with its 95 % band."""

    mean: Curve
    band95: Band


class TrackCurves(Model):
    """The filter against time, seconds from the first row."""

    time: Curve
    parameters: dict[QuantityName, ParameterCurve]
    effects: Annotated[dict[Text, ParameterCurve], Field(max_length=50)] = Field(
        default_factory=dict
    )
    """Parameters of force laws, by effect and parameter."""
    nis: NisCurve
    inflation: Curve
    """Factor on the standard deviation of the noise."""
    consistent: Annotated[list[bool], Field(max_length=MAX_POINTS)]

    @model_validator(mode="after")
    def _check_curves(self) -> Self:
        if len(self.time) < 2:
            raise ValueError("its curves have fewer than two points")
        curves = [self.nis.mean, *self.nis.band95, self.inflation]
        for curve in (*self.parameters.values(), *self.effects.values()):
            curves += [curve.median, *curve.band95]
        check_lengths(len(self.time), *curves, self.consistent)
        drawn = [c for curve in self.parameters.values() for c in (curve.median, *curve.band95)]
        for values in (self.time, *drawn):
            if all(value is None for value in values):
                raise ValueError("a curve has no values")
        return self


class Filter(Model):
    """Settings of the filter, and how far it came."""

    engine: Text = ""
    forget_seconds: NonNegative | None = None
    """Time in which the parameters may change by 10 %; null for constant parameters."""
    rate: NonNegative | None = None
    """Hz."""
    rows: Count = 0
    seconds: NonNegative | None = None
    resets: Annotated[list[Finite], Field(max_length=MAX_POINTS)] = Field(default_factory=list)
    """Times at which motion and biases were reset, seconds from the first row."""


class TrackDocument(Model):
    """Parameters from the online filter; written by ``bayes-asv track``."""

    schema_name: Literal["bayes_asv/track/1"] = Field(alias="schema")
    car: Annotated[str, Field(max_length=64)] = "half"
    """Model of the car."""
    elements: dict[ElementName, Element] = Field(default_factory=half_car)
    """Its suspension elements."""
    channels: Annotated[list[Channel], Field(max_length=100)] = Field(default_factory=list)
    """What was measured; empty in a document of an earlier version, which is of the half car."""
    verdict: Annotated[str, OneOf("ok", "refused")]
    reasons: Texts
    """Why it was refused."""
    warnings: Texts
    doubt: Text = ""
    """Why no verdict on a damper may rest on it; empty where nothing speaks against it."""
    nominal_mistakes: Annotated[list[PossibleMistake], Field(max_length=50)] = Field(
        default_factory=list
    )
    """What else may explain that damping is not nominal."""
    parameters: dict[QuantityName, Parameter]
    """After the last row."""
    effects: Annotated[list[Effect], Field(max_length=50)] = Field(default_factory=list)
    """Effects in the model, after the last row."""
    consistency: Consistency
    known: dict[Text, Known] = Field(default_factory=dict)
    track: TrackCurves | None = None
    filter: Filter = Filter()
    vehicle: VehicleInfo = VehicleInfo()
    provenance: Provenance = Provenance()
    seconds: NonNegative = 0.0
    """Time of computation."""
    version: Text
    seed: Count
    trace: Text | None = None
    """The CSV file with the state after each row."""

    @model_validator(mode="after")
    def _check_verdict(self) -> Self:
        if self.verdict == "refused" and not self.reasons:
            raise ValueError("it is refused without a reason")
        if self.verdict == "ok":
            if self.track is None or not self.track.parameters:
                raise ValueError("it has a verdict but no curves")
            needed = ("c_f", "c_r", "i") if self.car == "half" else tuple(self.track.parameters)
            missing = [n for n in needed if n not in self.parameters]
            if missing:
                raise ValueError(f"it has a verdict but no parameter {missing[0]}")
            if any(n not in self.track.parameters for n in needed):
                raise ValueError("it has a verdict but no curves")
        return self


class AlarmSettings(Model):
    """What counts as worn, with what probability, for how long."""

    share: Share
    """Of the nominal rate."""
    probability: Share
    hold_seconds: NonNegative


class AlarmInfo(Model):
    """An alarm."""

    axle: ElementName
    """Place of the damper."""
    time: Finite
    since: Finite
    probability: Share
    share_of_nominal: NonNegative
    eti95: Interval


class WatchDocument(Model):
    """Whether a damper became too soft; written by ``bayes-asv watch``."""

    schema_name: Literal["bayes_asv/watch/1"] = Field(alias="schema")
    car: Annotated[str, Field(max_length=64)] = "half"
    """Model of the car."""
    verdict: Annotated[str, OneOf("alarm", "ok", "refused")]
    reasons: Texts
    warnings: Texts
    doubt: Text = ""
    """As in a track: with a mistake in the input there is no alarm."""
    asked: AlarmSettings
    alarm: AlarmInfo | None
    probability: dict[ElementName, MaybeShare]
    """That a damper is worn, at the end."""
    seconds_watched: NonNegative
    share_of_time: Share
    """Share of the time in which the filter was consistent and an alarm was possible."""
    recording: Text
    version: Text
    seed: Count
