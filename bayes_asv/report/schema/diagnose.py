"""``bayes_asv/diagnose/1``."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from bayes_asv.report.schema.parts import (
    Axle,
    Band,
    ByName,
    Channel,
    Count,
    Curve,
    DampingRates,
    Effect,
    EffectName,
    EffectValue,
    ElementName,
    Finite,
    Interval,
    MaybeNumber,
    MaybeShare,
    Model,
    NonNegative,
    OneOf,
    Parameter,
    Provenance,
    QuantityName,
    Share,
    SpringCurve,
    Text,
    Texts,
    Unit,
    VehicleInfo,
    check_lengths,
)

__all__ = [
    "Cell",
    "DiagnoseDocument",
    "Disagreement",
    "ForceCurve",
    "Gap",
    "NamedEffect",
    "SimulationError",
    "Unexplained",
    "UnnamedCause",
]

Intervals = Annotated[list[Interval], Field(max_length=10_000)]


class SimulationError(Model):
    """RMS difference between measured and simulated outputs."""

    before: NonNegative
    """Of the linear car."""
    after: NonNegative
    """With all that was added to the model."""
    floor: NonNegative
    """What sensor noise alone would leave."""
    closed: MaybeNumber = None
    """1 − (after² − floor²)/(before² − floor²)."""
    worse: bool = False
    """Whether it grew."""


class Gap(Model):
    """Simulation error on the fitted runs and on the held-out ones."""

    fit: SimulationError | None = None
    holdout: SimulationError | None = None
    unit: Unit = ""


class NamedEffect(Effect):
    """An effect that was named."""

    probability: Share
    indistinguishable_from: Annotated[list[EffectName], Field(max_length=50)]
    """Effects that these recordings cannot distinguish from it."""
    drive: Text = ""
    """The drive that would tell them apart."""
    gap: Gap
    run: Text | None = None
    """The run that it belongs to; null for all."""
    tones: list[Finite] = Field(default_factory=list)
    """Frequencies of an engine, Hz."""


class Outlier(Model):
    """Successive readings of a channel that fit worse than any others."""

    p: Share
    """p-value of their misfit."""
    channel: Text
    source: Text
    """The recording."""
    time: Finite
    """Time of the first of them by the recording's clock, s."""
    readings: Annotated[int, Field(ge=1)]
    """Their number."""


class Unexplained(Model):
    """What is left that no listed effect explains."""

    present: bool
    score: MaybeNumber = None
    """Log likelihood that a free force gains, nats."""
    axle: Text = ""
    p_memory: MaybeShare = None
    """p-value of the whiteness test."""
    swollen: Annotated[list[Text], Field(max_length=100)] = Field(default_factory=list)
    """Channels whose noise is far above the given level."""
    p_decoy: MaybeShare = None
    """p-value of the test for unlisted faults."""
    like: Text = ""
    """The unlisted fault that fits best."""
    failed: Annotated[list[Text], Field(max_length=50)] = Field(default_factory=list)
    """Effects that fitted but made the held-out runs worse."""
    ended: Text = ""
    """What explained more than any listed effect."""
    p_jitter: MaybeShare = None
    """p-value of the timing-jitter test."""
    jitters: Text = ""
    """The channel of that test."""
    missing_bits: Annotated[list[Text], Field(max_length=100)] = Field(default_factory=list)
    """Channels whose converter never sets, or never clears, one of its bits."""
    outlier: Outlier | None = None
    """The readings that fit worst."""
    rival: MaybeNumber = None
    """Log likelihood that an unlisted fault gains over the named effects, nats."""


class UnnamedCause(Model):
    """Something that no listed effect explains, as it was added to the model."""

    like: Text
    """The unlisted fault that changes the recordings as it does, and where."""
    share: Share
    """Its share of the squared change of the predictions."""
    source: Text
    """The fitted run that is drawn."""
    time: Annotated[Curve, Field(min_length=2)]
    """Seconds, by the recording's clock, where it changes most."""
    change: Curve
    """A force on the body, or what is to be added to a reading."""
    unit: Unit
    along: Curve
    """What it depends on: rate of deflection, acceleration of the body, or the reading."""
    along_unit: Unit
    along_words: Text

    @model_validator(mode="after")
    def _check_curves(self) -> Self:
        check_lengths(len(self.time), self.change, self.along)
        return self


class Cell(Model):
    """Mean missing force in a cell of the deflection–velocity plane; up is positive."""

    deflection: Interval
    velocity: Interval
    force: Finite
    t: Finite
    """Force over its standard error."""
    units: Annotated[list[Unit], Field(min_length=3, max_length=3)]
    """Of deflection, velocity and force."""


class Disagreement(Model):
    """Where the linear car and the measurement disagree."""

    channel: Text | None = None
    axle: Axle | None = None
    time: Intervals = Field(default_factory=list)
    """Seconds, by the recording's clock."""
    time_run: Annotated[list[Text], Field(max_length=10_000)] = Field(default_factory=list)
    """The recording of each interval of ``time``."""
    frequency: Annotated[list[Interval], Field(max_length=1000)] = Field(default_factory=list)
    """Hz."""
    state: Cell | None = None


class ForceBand(Model):
    """Median and 95 % band of a force."""

    median: Curve
    band95: Band


class ForceCurve(Model):
    """Force of a damper over velocity, or of a spring over deflection.

    Extension is positive, and so is a force that resists it.
    """

    velocity: Curve | None = None
    deflection: Curve | None = None
    unit: Unit
    force_unit: Unit
    before: ForceBand
    after: ForceBand
    nominal: Curve
    after_end: ForceBand | None = None
    """At the end of a run, for a damper that fades."""

    @property
    def grid(self) -> Curve:
        """Velocity of a damper, deflection of a spring."""
        return self.velocity if self.velocity is not None else self.deflection or []

    @model_validator(mode="after")
    def _check_curves(self) -> Self:
        if self.velocity is None and self.deflection is None:
            raise ValueError("it has a force but nothing to draw it against")
        for band in (self.before, self.after, self.after_end):
            if band is not None:
                check_lengths(len(self.grid), band.median, *band.band95)
        check_lengths(len(self.grid), self.nominal)
        return self


class DamperRates(Model):
    """Compression and rebound rate of a damper."""

    unit: Unit
    bound: EffectValue
    rebound: EffectValue


class ForceCurves(Model):
    """Damper and spring of one axle."""

    damper: ForceCurve | None = None
    spring: ForceCurve | None = None
    rates: DamperRates | None = None

    @model_validator(mode="after")
    def _check_axes(self) -> Self:
        if self.damper is not None and self.damper.velocity is None:
            raise ValueError("its damper has no velocity")
        if self.spring is not None and self.spring.deflection is None:
            raise ValueError("its spring has no deflection")
        return self


class BeforeAfter(Model):
    """A curve of the linear car and of the model with the named effects."""

    unit: Unit = ""
    """Where it is not that of the others."""
    before: Curve
    after: Curve


class ResidualSpectrum(ByName[BeforeAfter | None]):
    """Power spectral densities of the residuals (Welch), by output."""

    __pydantic_extra__: dict[Channel, BeforeAfter | None]
    unit: Unit
    frequency: Annotated[Curve, Field(min_length=1)]

    @model_validator(mode="after")
    def _check_curves(self) -> Self:
        for part in self.entries.values():
            if part is not None:
                check_lengths(len(self.frequency), part.before, part.after)
        return self


class Residual(ByName[BeforeAfter | None]):
    """Measured less simulated readings of one run, by output."""

    __pydantic_extra__: dict[Channel, BeforeAfter | None]
    source: Text
    unit: Unit
    time: Annotated[Curve, Field(min_length=2)]
    """Seconds, by the recording's clock."""
    seconds: Interval | None = None
    """First and last instant."""
    spectrum: ResidualSpectrum

    @model_validator(mode="after")
    def _check_curves(self) -> Self:
        for part in self.entries.values():
            if part is not None:
                check_lengths(len(self.time), part.before, part.after)
        return self


class RecordingFault(Model):
    """Something found in a recording before any fit, and how much of it."""

    name: Text
    where: Channel | None = None
    source: Text = ""
    samples: Count | None = None
    rms_seconds: NonNegative | None = None
    times_noise: NonNegative | None = None


class FittedRuns(Model):
    """Names of the fitted and of the held-out recordings."""

    fit: Texts = Field(default_factory=list)
    holdout: Texts = Field(default_factory=list)


class DiagnoseDocument(Model):
    """What the linear car lacks; written by ``bayes-asv diagnose``."""

    schema_name: Literal["bayes_asv/diagnose/1"] = Field(alias="schema")
    verdict: Annotated[str, OneOf("agreement", "named", "unexplained", "refused")]
    reasons: Texts
    """Why it was refused."""
    warnings: Texts
    car: Text = "half"
    """Model of the car, as ``--car`` takes it."""
    preflight: Annotated[list[RecordingFault], Field(max_length=1000)] = Field(default_factory=list)
    effects: Annotated[list[NamedEffect], Field(max_length=50)]
    """In the order in which they were added."""
    unexplained: Unexplained
    unnamed: Annotated[list[UnnamedCause], Field(max_length=10)] = Field(default_factory=list)
    """What is left, as it was added to the model without a name; the largest first."""
    disagreement: Disagreement | None = None
    gap: Gap
    """Simulation error before and after."""
    parameters_before: dict[QuantityName, Parameter]
    parameters_after: dict[QuantityName, Parameter]
    p_value: Share
    """Family-wise p-value of the test of the linear car."""
    p_none: MaybeShare = None
    """Probability that nothing beyond the tolerances is missing."""
    map: dict[Axle, Annotated[list[Cell], Field(max_length=1000)]] | None = None
    """Missing force over the deflection–velocity plane."""
    laws: dict[ElementName, ForceCurves] = Field(default_factory=dict)
    """Force curves that an effect changes."""
    dampers: Annotated[list[DampingRates], Field(max_length=10)] = Field(default_factory=list)
    """Rates of dampers whose force is not proportional to speed."""
    springs: Annotated[list[SpringCurve], Field(max_length=10)] = Field(default_factory=list)
    """Curves of springs that have a free one."""
    residuals: Annotated[list[Residual], Field(max_length=1000)] = Field(default_factory=list)
    runs: FittedRuns = FittedRuns()
    vehicle: VehicleInfo = VehicleInfo()
    provenance: Provenance = Provenance()
    seconds: NonNegative = 0.0
    """Time of computation."""
    version: Text
    seed: Count

    @model_validator(mode="after")
    def _check_verdict(self) -> Self:
        if self.verdict == "refused":
            if not self.reasons:
                raise ValueError("it is refused without a reason")
            return self
        if self.verdict == "named" and not self.effects:
            raise ValueError("it has named something but does not say what")
        before, after = self.parameters_before, self.parameters_after
        for name in ("c_f", "c_r", "i") if self.car == "half" else {**before, **after}:
            if name not in before or name not in after:
                raise ValueError(f"it has a verdict but no parameter {name} before and after")
        if self.gap.fit is None:
            raise ValueError("it has a verdict but no gap")
        return self
