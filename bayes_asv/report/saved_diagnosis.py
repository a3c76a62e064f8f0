"""What a saved diagnosis has to hold: shape, size and sense of what the report counts on.

Further keys are left alone, so that newer documents stay readable.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from bayes_asv.report.saved_parts import (
    Axle,
    Band,
    Count,
    Curve,
    Effect,
    Finite,
    Other,
    Pair,
    Parameter,
    Part,
    Provenance,
    Sentences,
    Share,
    Size,
    Unit,
    Value,
    Words,
    alike,
)

__all__ = ["SavedDiagnosis"]

Quantity = Literal["c_f", "c_r", "i", "k_g", "zeta_f", "zeta_r"]


class _GapOf(Part):
    before: Size
    after: Size
    floor: Size
    closed: Finite | None = None
    worse: bool = False


class _Gap(Part):
    fit: _GapOf | None = None
    holdout: _GapOf | None = None
    unit: Unit = ""


class _Named(Effect):
    probability: Share
    indistinguishable_from: Annotated[list[Other], Field(max_length=50)]
    drive: Words = ""
    gap: _Gap
    run: Words | None = None


class _Unexplained(Part):
    present: bool
    score: Finite | None = None
    swollen: Annotated[list[Words], Field(max_length=4)] = Field(default_factory=list)
    p_memory: Share | None = None
    p_decoy: Share | None = None
    like: Words = ""
    failed: Annotated[list[Words], Field(max_length=50)] = Field(default_factory=list)
    ended: Words = ""
    rival: Finite | None = None
    p_jitter: Share | None = None
    jitters: Words = ""


class _Cell(Part):
    deflection: Pair
    velocity: Pair
    force: Finite
    t: Finite
    units: Annotated[list[Unit], Field(min_length=3, max_length=3)]


class _Disagreement(Part):
    channel: Words | None = None
    axle: Axle | None = None
    time: Annotated[list[Pair], Field(max_length=10_000)] = Field(default_factory=list)
    time_run: Annotated[list[Words], Field(max_length=10_000)] = Field(default_factory=list)
    frequency: Annotated[list[Pair], Field(max_length=1000)] = Field(default_factory=list)
    state: _Cell | None = None


class _Lines(Part):
    median: Curve
    band95: Band


class _Law(Part):
    velocity: Curve | None = None
    deflection: Curve | None = None
    unit: Unit
    force_unit: Unit
    before: _Lines
    after: _Lines
    after_end: _Lines | None = None
    nominal: Curve

    @model_validator(mode="after")
    def _long(self) -> _Law:
        grid = self.velocity if self.velocity is not None else self.deflection
        if grid is None:
            raise ValueError("it has a force but nothing to draw it against")
        for lines in (self.before, self.after, self.after_end):
            if lines is not None:
                alike(len(grid), lines.median, *lines.band95)
        alike(len(grid), self.nominal)
        return self


class _Rates(Part):
    unit: Unit
    bound: Value
    rebound: Value


class _Laws(Part):
    damper: _Law | None = None
    spring: _Law | None = None
    rates: _Rates | None = None

    @model_validator(mode="after")
    def _against(self) -> _Laws:
        if self.damper is not None and self.damper.velocity is None:
            raise ValueError("its damper has no velocity")
        if self.spring is not None and self.spring.deflection is None:
            raise ValueError("its spring has no deflection")
        return self


class _Both(Part):
    before: Curve
    after: Curve


class _Spectrum(Part):
    unit: Unit
    frequency: Annotated[Curve, Field(min_length=1)]
    front_chassis: _Both
    rear_chassis: _Both

    @model_validator(mode="after")
    def _long(self) -> _Spectrum:
        for part in (self.front_chassis, self.rear_chassis):
            alike(len(self.frequency), part.before, part.after)
        return self


class _Residual(Part):
    source: Words
    unit: Unit
    time: Annotated[Curve, Field(min_length=2)]
    front_chassis: _Both
    rear_chassis: _Both
    spectrum: _Spectrum

    @model_validator(mode="after")
    def _long(self) -> _Residual:
        for part in (self.front_chassis, self.rear_chassis):
            alike(len(self.time), part.before, part.after)
        return self


class _Found(Part):
    name: Words
    source: Words = ""
    samples: Count | None = None
    rms_seconds: Size | None = None
    times_noise: Size | None = None


class _Runs(Part):
    fit: Annotated[list[Words], Field(max_length=1000)] = Field(default_factory=list)
    holdout: Annotated[list[Words], Field(max_length=1000)] = Field(default_factory=list)


class _Vehicle(Part):
    name: Words = ""
    units: Literal["US", "SI"] = "SI"


class SavedDiagnosis(Part):
    """Schema ``bayes_asv/diagnose/1``, as far as the report counts on it."""

    verdict: Literal["agreement", "named", "unexplained", "refused"]
    reasons: Sentences
    warnings: Sentences
    preflight: Annotated[list[_Found], Field(max_length=1000)] = Field(default_factory=list)
    effects: Annotated[list[_Named], Field(max_length=50)]
    unexplained: _Unexplained
    disagreement: _Disagreement | None = None
    gap: _Gap
    parameters_before: dict[Quantity, Parameter]
    parameters_after: dict[Quantity, Parameter]
    p_value: Share
    map: dict[Axle, Annotated[list[_Cell], Field(max_length=1000)]] | None = None
    laws: dict[Axle, _Laws] = Field(default_factory=dict)
    residuals: Annotated[list[_Residual], Field(max_length=1000)] = Field(default_factory=list)
    runs: _Runs = _Runs()
    vehicle: _Vehicle = _Vehicle()
    provenance: Provenance = Provenance()
    version: Words
    seed: Count

    @model_validator(mode="after")
    def _sense(self) -> SavedDiagnosis:
        if self.verdict == "refused":
            if not self.reasons:
                raise ValueError("it is refused without a reason")
            return self
        if self.verdict == "named" and not self.effects:
            raise ValueError("it has named something but does not say what")
        for name in ("c_f", "c_r", "i"):
            if name not in self.parameters_before or name not in self.parameters_after:
                raise ValueError(f"it has a verdict but no parameter {name} before and after")
        if self.gap.fit is None:
            raise ValueError("it has a verdict but no gap")
        return self
