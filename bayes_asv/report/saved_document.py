"""What a saved document has to hold: shape, size and sense of what the report counts on.

Further keys are left alone, so that newer documents stay readable.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from bayes_asv.report.saved_diagnosis import SavedDiagnosis
from bayes_asv.report.saved_parts import (
    Band,
    Channel,
    Chassis,
    Count,
    Curve,
    Effect,
    Finite,
    Pair,
    Parameter,
    Part,
    Positive,
    Provenance,
    Sentences,
    Share,
    Shown,
    Size,
    Summary,
    Unit,
    Words,
    alike,
)
from bayes_asv.report.saved_track import SavedTrack

__all__ = ["SavedDocument"]

Answer = Literal["c_f", "c_r", "i", "k_g"]


class _Known(Part):
    label: Words = ""
    unit: Unit
    value: Finite
    sd: Size | None = None
    posterior: Summary | None = None


class _Prior(Part):
    median: Positive
    log_sd: Annotated[float, Field(ge=1e-9, le=50.0, allow_inf_nan=False)]


class _Diagnostics(Part):
    rhat_max: Finite | None = None
    ess_bulk_min: Finite | None = None
    ess_tail_min: Finite | None = None
    acceptance: Finite | None = None
    draws: Count | None = None
    likelihood: Words = ""


class _Fit(Part):
    nrmse_percent: Size


class _Fits(Part):
    source: Words = ""
    front_chassis: _Fit | None = None
    rear_chassis: _Fit | None = None


class _NoiseOf(Summary):
    given: Size | None = None


class _Noise(Part):
    source: Words
    unit: Unit
    front_wheel: _NoiseOf | None = None
    front_chassis: _NoiseOf | None = None
    rear_wheel: _NoiseOf | None = None
    rear_chassis: _NoiseOf | None = None


class _Spectrum(Part):
    unit: Unit = ""
    frequency: Curve
    measured: Curve
    residual: Curve

    @model_validator(mode="after")
    def _long(self) -> _Spectrum:
        alike(len(self.frequency), self.measured, self.residual)
        return self


class _Chassis(Part):
    measured: Curve
    simulated: Curve
    band95: Band
    autocorrelation: Annotated[list[Finite | None], Field(max_length=1000)] = Field(
        default_factory=list
    )
    autocorrelation_band95: Size = 0.0
    whiteness_p: Share | None = None
    lag_seconds: Size = 0.0
    spectrum: _Spectrum | None = None


class _TravelOf(Part):
    deflection: Curve
    velocity: Curve
    band95: Band
    largest_bump: Size
    largest_droop: Size


class _Travel(Part):
    unit: Unit
    velocity_unit: Unit = ""
    front: _TravelOf | None = None
    rear: _TravelOf | None = None


class _Wheels(Part):
    time: Curve
    front_wheel: Curve
    rear_wheel: Curve

    @model_validator(mode="after")
    def _long(self) -> _Wheels:
        alike(len(self.time), self.front_wheel, self.rear_wheel)
        return self


class _Replicated(Part):
    median: Size
    eti95: Pair


class _Check(Part):
    channel: Chassis
    of: Literal["reading", "residual"]
    quantity: Literal["peak", "rms"]
    band: Annotated[list[Size], Field(min_length=2, max_length=2)] | None = None
    unit: Unit
    observed: Size
    replicated: _Replicated
    p: Share
    p_family: Share


class _OfRun(Shown):
    own: Summary | None = None


class _Alone(Part):
    source: Words
    parameters: dict[Answer, _OfRun]


class _Spread(Part):
    median: Size
    eti95: Pair


class _Test(Part):
    p: Share | None = None


class _Agreement(Part):
    verdict: Literal["agree", "disagree", "unknown"]
    p: Share | None = None
    each: dict[Answer, _Test]
    spread_percent: dict[Answer, _Spread]
    runs: Annotated[list[_Alone], Field(max_length=1000)]
    joint: dict[Answer, Shown]
    mean_car: dict[Answer, Shown]
    next_run: dict[Answer, Shown]

    @model_validator(mode="after")
    def _whole(self) -> _Agreement:
        for name in ("c_f", "c_r", "i"):
            if any(name not in part for part in (self.each, self.spread_percent, self.mean_car)):
                raise ValueError(f"it holds runs against each other but not their {name}")
        if self.verdict == "disagree" and any(
            n not in part for n in ("c_f", "c_r", "i") for part in (self.next_run, self.joint)
        ):
            raise ValueError("its runs disagree but it does not say how")
        return self


class _Run(Part):
    source: Words
    unit: Unit
    rate: Annotated[float, Field(ge=1e-3, le=1e8, allow_inf_nan=False)]
    seconds: Size
    time: Curve
    chassis: dict[Chassis, _Chassis]
    wheels: _Wheels
    travel: _Travel
    checks: Annotated[list[_Check], Field(max_length=200)] = Field(default_factory=list)

    @model_validator(mode="after")
    def _long(self) -> _Run:
        n = len(self.time)
        for part in self.chassis.values():
            alike(n, part.measured, part.simulated, *part.band95)
        for side in (self.travel.front, self.travel.rear):
            if side is not None:
                alike(n, side.deflection, side.velocity, *side.band95)
        return self


class _Measure(Part):
    what: Literal[
        "runs", "m", "l", "wdf", "k_f", "k_r",
        "gain front_wheel", "gain front_chassis", "gain rear_wheel", "gain rear_chassis",
    ]  # fmt: skip
    further: Count = 0
    now_sd_percent: Positive = 1.0
    needed_sd_percent: Positive = 1.0
    needed_sd: Positive = 1.0
    unit: Unit = ""


class _Halving(Part):
    measures: Annotated[list[_Measure], Field(min_length=1, max_length=6)]


class _Budget(Part):
    sd_percent: Size
    posterior_sd_percent: Positive | None = None
    shares: Annotated[dict[Words, Finite], Field(min_length=1)]
    noises: dict[Words, Finite]
    exact_sd_percent: dict[Words, Size]
    better_sd_percent: dict[Words, Size]
    twice_the_runs_sd_percent: Size
    halve: Annotated[list[_Halving], Field(max_length=100)]
    runs_to_halve: Count | None = None


class _Moved(Part):
    percent: Finite
    sd: Finite


class _Fault(Part):
    kind: Literal["given", "gain", "delay", "bandwidth", "place"]
    where: Channel | Literal["c_f", "c_r", "i", "m", "l", "wdf", "k_f", "k_r"]
    size: Positive
    larger_shows: bool
    shift: dict[Literal["c_f", "c_r", "i", "k_g"], _Moved]


class _Width(Part):
    white: bool
    runs: Count
    c_f: _Budget | None = None
    c_r: _Budget | None = None
    i: _Budget | None = None
    k_g: _Budget | None = None
    faults: Annotated[dict[Words, _Fault], Field(max_length=100)] = Field(default_factory=dict)


class _Stops(Part):
    unit: Unit = ""
    front_bump: Positive | None = None
    front_droop: Positive | None = None
    rear_bump: Positive | None = None
    rear_droop: Positive | None = None


class _Vehicle(Part):
    name: Words = ""
    units: Literal["US", "SI"] = "SI"
    source: Words = ""
    sha256: Words = ""
    travel: _Stops | None = None


class SavedDocument(Part):
    """Schema ``bayes_asv/estimate/1``, as far as the report counts on it."""

    verdict: Literal["ok", "not_converged", "refused"]
    reasons: Sentences
    warnings: Sentences
    parameters: dict[
        Literal["c_f", "c_r", "i", "k_g", "zeta_f", "zeta_r", "m", "l", "wdf", "k_f", "k_r"],
        Parameter,
    ]
    diagnostics: _Diagnostics
    fit: _Fits
    effects: Annotated[list[Effect], Field(max_length=50)] = Field(default_factory=list)
    known: dict[Words, _Known] = Field(default_factory=dict)
    prior: dict[Words, _Prior] = Field(default_factory=dict)
    width: _Width | None = None
    agreement: _Agreement | None = None
    fit_by_run: Annotated[list[_Fits], Field(max_length=1000)] = Field(default_factory=list)
    noise: Annotated[list[_Noise], Field(max_length=1000)] = Field(default_factory=list)
    runs: Annotated[list[_Run], Field(max_length=1000)] = Field(default_factory=list)
    draws: dict[Words, Curve] = Field(default_factory=dict)
    diagnosis: SavedDiagnosis | None = None
    online: SavedTrack | None = None
    vehicle: _Vehicle = _Vehicle()
    provenance: Provenance = Provenance()
    version: Words
    seed: Count

    @model_validator(mode="after")
    def _sense(self) -> SavedDocument:
        if self.verdict == "refused" and not self.reasons:
            raise ValueError("it is refused without a reason")
        if self.verdict != "refused":
            missing = [n for n in ("c_f", "c_r", "i", "k_g") if n not in self.parameters]
            if missing:
                raise ValueError(f"it has a verdict but no parameter {missing[0]}")
        alike(None, *self.draws.values())
        return self
