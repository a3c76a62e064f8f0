"""What a saved track has to hold: shape, size and sense of what the report counts on.

Further keys are left alone, so that newer documents stay readable.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from bayes_asv.report.saved_parts import (
    Band,
    Count,
    Curve,
    Finite,
    Parameter,
    Part,
    Provenance,
    Sentences,
    Share,
    Size,
    Unit,
    Words,
    alike,
)

__all__ = ["SavedTrack"]

_MOST_POINTS = 100_000

Quantity = Literal["c_f", "c_r", "i", "k_g", "zeta_f", "zeta_r"]


class _Lags(Part):
    front: Annotated[list[Finite | None], Field(max_length=1000)]
    rear: Annotated[list[Finite | None], Field(max_length=1000)]
    band95: Size
    lag_seconds: Size


class _Consistency(Part):
    nis_mean: Size | None
    nis_band95: Annotated[list[Size | None], Field(min_length=2, max_length=2)]
    verdict: Literal["consistent", "recovered", "inconsistent"]
    faults: Annotated[
        list[Literal["swollen", "coloured", "uneven", "optimistic", "pessimistic"]],
        Field(max_length=5),
    ]
    readings: Count
    share_of_time: Share
    largest_noise_level: Size
    autocorrelation: _Lags | None = None
    window_seconds: Size = 0.0


class _Curve(Part):
    unit: Unit
    median: Curve
    band95: Band


class _Nis(Part):
    mean: Curve
    band95: Band


class _Track(Part):
    time: Curve
    parameters: dict[Literal["c_f", "c_r", "i"], _Curve]
    nis: _Nis
    inflation: Curve
    consistent: Annotated[list[bool], Field(max_length=_MOST_POINTS)]

    @model_validator(mode="after")
    def _long(self) -> _Track:
        if len(self.time) < 2:
            raise ValueError("its curves have fewer than two points")
        curves = [self.nis.mean, *self.nis.band95, self.inflation]
        for one in self.parameters.values():
            curves += [one.median, *one.band95]
        alike(len(self.time), *curves)
        if len(self.consistent) != len(self.time):
            raise ValueError("curves of one figure differ in length")
        return self


class _Posterior(Part):
    mean: Finite
    sd: Size


class _Known(Part):
    label: Words = ""
    unit: Unit
    value: Finite
    sd: Size | None = None
    posterior: _Posterior | None = None


class _Filter(Part):
    rate: Size | None = None
    rows: Count = 0
    seconds: Size | None = None
    forget_seconds: Size | None = None
    resets: Annotated[list[Finite], Field(max_length=_MOST_POINTS, default_factory=list)]


class _Vehicle(Part):
    name: Words = ""
    units: Literal["US", "SI"] = "SI"


class SavedTrack(Part):
    """Schema ``bayes_asv/track/1``, as far as the report counts on it."""

    verdict: Literal["ok", "refused"]
    reasons: Sentences
    warnings: Sentences
    parameters: dict[Quantity, Parameter]
    consistency: _Consistency
    known: Annotated[dict[Words, _Known], Field(default_factory=dict)]
    track: _Track | None = None
    filter: Annotated[_Filter, Field(default_factory=_Filter)]
    vehicle: _Vehicle = _Vehicle()
    provenance: Provenance = Provenance()
    version: Words
    seed: Count

    @model_validator(mode="after")
    def _sense(self) -> SavedTrack:
        if self.verdict == "refused" and not self.reasons:
            raise ValueError("it is refused without a reason")
        if self.verdict == "ok":
            missing = [n for n in ("c_f", "c_r", "i") if n not in self.parameters]
            if missing:
                raise ValueError(f"it has a verdict but no parameter {missing[0]}")
            if self.track is None or len(self.track.parameters) < 3:
                raise ValueError("it has a verdict but no curves")
        return self
