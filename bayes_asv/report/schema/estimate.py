"""``bayes_asv/estimate/1``."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from bayes_asv.domain.channels import KNOWN_CHANNELS
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.report.schema.diagnose import DiagnoseDocument
from bayes_asv.report.schema.parts import (
    Axle,
    Band,
    ByName,
    Channel,
    Count,
    Curve,
    DampingRates,
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
    Positive,
    PossibleMistake,
    Provenance,
    Quantity,
    QuantityName,
    Share,
    SpringCurve,
    Summary,
    Text,
    Texts,
    Unit,
    VehicleInfo,
    check_lengths,
    half_car,
)
from bayes_asv.report.schema.track import TrackDocument

__all__ = [
    "Check",
    "Element",
    "EstimateDocument",
    "Fault",
    "LogEvent",
    "LongLog",
    "Measure",
    "ParameterBudget",
    "Run",
    "RunConsistency",
    "UncertaintyBudget",
]

Percents = dict[Text, NonNegative]


class Prior(Model):
    """A log-normal prior."""

    kind: Text = "log-normal"
    median: Positive
    factor: Positive | None = None
    """exp(log_sd)."""
    log_sd: Annotated[float, Field(ge=1e-9, le=50.0, allow_inf_nan=False)]
    eti95: Interval | None = None


class Diagnostics(Model):
    """Convergence of the sampler: the worst of all coordinates."""

    rhat_max: MaybeNumber = None
    ess_bulk_min: MaybeNumber = None
    ess_tail_min: MaybeNumber = None
    acceptance: MaybeNumber = None
    draws: Count | None = None
    likelihood: Text = ""
    band: Annotated[list[NonNegative], Field(min_length=2, max_length=2)] | None = None
    """Frequency band used, Hz; null for all."""
    sampler: Text = ""


class Measure(Model):
    """A value to be known better, or further runs to be recorded."""

    what: Annotated[str, OneOf("runs", *QUANTITIES, *(f"gain {c}" for c in KNOWN_CHANNELS))]
    further: Count = 0
    """Number of further runs."""
    now_sd_percent: Positive = 1.0
    needed_sd_percent: Positive = 1.0
    now_sd: Positive = 1.0
    needed_sd: Positive = 1.0
    unit: Unit = ""


class Remedy(Model):
    """Measures that together halve the standard deviation of one answer."""

    what: Text = ""
    measures: Annotated[list[Measure], Field(min_length=1, max_length=6)]
    sentence: Text = ""


class ParameterBudget(Model):
    """Where the variance of one answer comes from."""

    sd_percent: NonNegative
    """Standard deviation of the linearised posterior."""
    posterior_sd_percent: Positive | None = None
    """Standard deviation of the draws."""
    shares: Annotated[dict[Text, Finite], Field(min_length=1)]
    """Share of the variance by source."""
    noises: dict[Text, Finite]
    """The share of the data, by sensor."""
    exact_sd_percent: Percents
    """Standard deviation if one given value were exact."""
    better_sd_percent: Percents
    """Standard deviation if one sensor were better."""
    twice_the_runs_sd_percent: NonNegative
    halve: Annotated[list[Remedy], Field(max_length=100)]
    """What would halve the standard deviation, the least demanding first."""
    runs_to_halve: Count | None = None


class Shift(Model):
    """How far an undeclared fault moves an answer: in percent and in standard deviations."""

    percent: Finite
    sd: Finite


class Fault(Model):
    """A fault that the vehicle file does not declare, of a size the residuals would not show."""

    kind: Annotated[str, OneOf("given", "gain", "delay", "bandwidth", "place")]
    where: Annotated[str, OneOf(*KNOWN_CHANNELS, *QUANTITIES)]
    size: Positive
    """SI units, or a share."""
    larger_shows: bool
    """Whether a larger fault would show in the residuals."""
    shift: dict[QuantityName, Shift]


class UncertaintyBudget(ByName[ParameterBudget]):
    """Uncertainty budget of every answer, by its name."""

    __pydantic_extra__: dict[QuantityName, ParameterBudget]
    faults: Annotated[dict[Text, Fault], Field(max_length=100)] = Field(default_factory=dict)
    white: bool
    """Whether the residuals are as white as the sensors' noise."""
    runs: Count


class OwnValue(Quantity):
    """Posterior of one run by itself."""

    own: Summary | None = None
    """With the given values held, whose errors all runs share."""


class SingleRun(Model):
    """What one run says by itself."""

    source: Text
    effective_draws: NonNegative | None = None
    parameters: dict[QuantityName, OwnValue]


class Spread(Model):
    """Spread from run to run, percent."""

    median: NonNegative
    eti95: Interval
    p_differs: MaybeShare = None
    """Probability that it is not zero."""


class Test(Model):
    """A p-value; null when it could not be computed."""

    p: MaybeShare = None


class RunConsistency(Model):
    """Whether the runs are consistent with one car."""

    verdict: Annotated[str, OneOf("agree", "disagree", "unknown")]
    p: MaybeShare = None
    contrasts: Count = 0
    disagree_below: Share = 0.0
    """p-value below which the verdict is ``disagree``."""
    each: dict[QuantityName, Test]
    differing: Texts = Field(default_factory=list)
    spread_percent: dict[QuantityName, Spread]
    own_percent: dict[QuantityName, MaybeNumber] = Field(default_factory=dict)
    runs: Annotated[list[SingleRun], Field(max_length=1000)]
    joint: dict[QuantityName, Quantity]
    """Posterior if all runs are of one car."""
    mean_car: dict[QuantityName, Quantity]
    """Posterior of the mean over runs that differ."""
    next_run: dict[QuantityName, Quantity]
    """Prediction for a further run."""

    @model_validator(mode="after")
    def _check_complete(self) -> Self:
        for name in self.each:
            if name not in self.spread_percent or name not in self.mean_car:
                raise ValueError(f"it compares runs but not their {name}")
            if self.verdict == "disagree" and not (name in self.next_run and name in self.joint):
                raise ValueError("its runs disagree but it does not say how")
        return self


class Fit(Model):
    """Normalised rms error of the simulation, percent of the measured movement."""

    nrmse_percent: MaybeNumber
    fit_percent: MaybeNumber = None


class Fits(ByName[Fit]):
    """Fit of each output, by channel."""

    __pydantic_extra__: dict[Channel, Fit]
    source: Text = ""


class NoiseLevel(Summary):
    """Posterior of the noise of one sensor, rms, and what the vehicle file gives."""

    given: NonNegative | None = None
    unit: Unit = ""
    """Where it is not an acceleration."""


class Noise(ByName[NoiseLevel]):
    """Sensor noise in one run, by channel."""

    __pydantic_extra__: dict[Channel, NoiseLevel]
    source: Text
    unit: Unit
    filtered_share: Summary | None = None
    """Share of the noise variance that passed the sensor's filter."""
    colour_order: Count = 0
    """Order of the autoregressive model of the innovations."""


class ClockErrors(Model):
    """Offset and drift of a clock against the other channels."""

    name: Text
    source: Text = ""
    """Recording whose offset it is; empty for the drift, which all recordings share."""
    offset: Summary | None = None
    """Time by which the channels of the clock are late, s."""
    drift: Summary | None = None
    """Relative error of its rate, positive when it runs fast."""


class Spectrum(Model):
    """Power spectral densities of the reading and of the residual (Welch)."""

    unit: Unit = ""
    frequency: Curve
    measured: Curve
    residual: Curve

    @model_validator(mode="after")
    def _check_curves(self) -> Self:
        check_lengths(len(self.frequency), self.measured, self.residual)
        return self


class Transmissibility(Model):
    """Amplitude of an output over that of the wheel acceleration, by frequency."""

    frequency: Curve
    measured: Curve
    simulated: Curve

    @model_validator(mode="after")
    def _check_curves(self) -> Self:
        check_lengths(len(self.frequency), self.measured, self.simulated)
        return self


class OutputCurves(Model):
    """One output: measured, simulated, and tests of what is left."""

    unit: Unit = ""
    """Where it is not that of the run."""

    measured: Curve
    simulated: Curve
    band95: Band
    autocorrelation: Annotated[list[MaybeNumber], Field(max_length=1000)] = Field(
        default_factory=list
    )
    """Of the innovations, from lag 0."""
    autocorrelation_band95: NonNegative = 0.0
    whiteness_p: MaybeShare = None
    """p-value of the Ljung–Box test."""
    lag_seconds: NonNegative = 0.0
    spectrum: Spectrum | None = None
    transmissibility: Transmissibility | None = None
    """From the wheel below it, at the frequencies at which that wheel moved."""


class WheelCurves(ByName[Curve]):
    """Wheel accelerations, by channel."""

    __pydantic_extra__: dict[Channel, Curve]
    time: Curve

    @model_validator(mode="after")
    def _check_curves(self) -> Self:
        check_lengths(len(self.time), *self.entries.values())
        return self


class SpeedShare(Model):
    """Share of the time in one range of damper velocity."""

    side: Annotated[str, OneOf("compression", "rebound")]
    speed: Annotated[str, OneOf("low", "high")]
    mean: Share
    eti95: Annotated[list[Share], Field(min_length=2, max_length=2)]


class TravelCurves(Model):
    """Suspension travel from rest and its velocity; extension is positive."""

    deflection: Curve
    band95: Band
    velocity: Curve
    largest_bump: NonNegative
    largest_droop: NonNegative
    speed_shares: Annotated[list[SpeedShare], Field(max_length=4)] = Field(default_factory=list)
    """From fast compression to fast rebound; they add up to 1."""


class Travel(ByName[TravelCurves]):
    """Travel of each suspension element, by its name."""

    __pydantic_extra__: dict[ElementName, TravelCurves]
    unit: Unit
    velocity_unit: Unit = ""
    low_speed: Positive | None = None
    """Damper velocity that divides low from high speed."""


class Replicated(Model):
    """Quantiles over replicated recordings."""

    median: NonNegative
    eti95: Interval


class Check(Model):
    """A posterior predictive check."""

    channel: Channel
    of: Annotated[str, OneOf("reading", "residual")]
    quantity: Annotated[str, OneOf("peak", "rms")]
    band: Annotated[list[MaybeNumber], Field(min_length=2, max_length=2)] | None = None
    """Hz; an upper edge of null is the highest frequency there is."""
    unit: Unit
    observed: NonNegative
    replicated: Replicated
    p: Share
    """Two-sided."""
    p_larger: MaybeShare = None
    """P(T(replicate) ≥ T(recording))."""
    p_family: Share
    """Corrected for the number of checks of the run."""


class Bias(ByName[MaybeNumber]):
    """Bias of the chassis channels, by their place."""

    __pydantic_extra__: dict[ElementName, MaybeNumber]
    unit: Unit


class Run(Model):
    """One recording beside its simulation; times are in seconds from its start."""

    source: Text
    sha256: Text = ""
    rate: Annotated[float, Field(ge=1e-3, le=1e8, allow_inf_nan=False)]
    """Hz."""
    seconds: NonNegative
    rows: Count = 0
    missing: dict[Text, Count] = Field(default_factory=dict)
    clipped: dict[Text, Count] = Field(default_factory=dict)
    bias: Bias | None = None
    unit: Unit
    time: Curve
    chassis: dict[Channel, OutputCurves]
    """Accelerations of the chassis above the wheels."""
    outputs: dict[Channel, OutputCurves] = Field(default_factory=dict)
    """Further outputs, such as suspension travel and the pitch rate of the body."""
    wheels: WheelCurves
    travel: Travel
    checks: Annotated[list[Check], Field(max_length=200)] = Field(default_factory=list)

    @model_validator(mode="after")
    def _check_curves(self) -> Self:
        n = len(self.time)
        for output in (*self.chassis.values(), *self.outputs.values()):
            check_lengths(n, output.measured, output.simulated, *output.band95)
        for part in self.travel.entries.values():
            check_lengths(n, part.deflection, part.velocity, *part.band95)
        return self


class SideRatio(Summary):
    """Ratio of the damping rates of the left and the right damper of an axle."""

    p_left_softer: Share


class DamperForce(Model):
    """Force of a damper over the velocities driven; a force that resists extension is positive."""

    velocity: Curve
    unit: Unit
    force_unit: Unit
    median: Curve
    band95: Band
    nominal: Curve | None = None
    """Of the nominal rate."""

    @model_validator(mode="after")
    def _check_curves(self) -> Self:
        nominal = [] if self.nominal is None else [self.nominal]
        check_lengths(len(self.velocity), self.median, *self.band95, *nominal)
        return self


class PriorSensitivity(Model):
    """Power-scaling sensitivity of the answers to one prior (Kallioinen et al. 2024)."""

    label: Text = ""
    pareto_k: MaybeNumber = None
    """Pareto k̂ of the importance weights; above 0.7 the sensitivities are not reliable."""
    sensitivity: dict[QuantityName, NonNegative]
    """Change of the posterior per doubling of the prior's exponent."""


class LogEvent(Model):
    """A stretch of a long log that moves the suspension; times as in the log, s."""

    kind: Annotated[str, OneOf("bump", "rough stretch")]
    begin: Finite
    end: Finite
    used: bool
    reason: Text = ""
    """Why it was left out."""
    unfit: bool = False
    """Whether it could not have been used."""


class LongLog(Model):
    """A recording that was too long to be taken whole, and the events in it."""

    source: Text
    seconds: NonNegative
    events: Annotated[list[LogEvent], Field(max_length=100_000)]
    rest: dict[Text, NonNegative]
    """Seconds of what is no event: ``standing``, ``little motion``."""
    time: Curve
    level: Curve
    """Information per second over time, relative to the most there is."""

    @model_validator(mode="after")
    def _check_curves(self) -> Self:
        check_lengths(len(self.time), self.level)
        return self


class EstimateDocument(Model):
    """Posterior of damping rates and inertias; written by ``bayes-asv estimate``."""

    schema_name: Literal["bayes_asv/estimate/1"] = Field(alias="schema")
    verdict: Annotated[str, OneOf("ok", "not_converged", "refused")]
    reasons: Texts
    """Why it was refused."""
    warnings: Texts
    doubt: Text = ""
    """Why the input is probably wrong or the model does not hold; no verdict is given then."""
    doubt_about: Annotated[str, OneOf("input", "model")] = "input"
    """Which of these ``doubt`` speaks of."""
    nominal_mistakes: Annotated[list[PossibleMistake], Field(max_length=50)] = Field(
        default_factory=list
    )
    """What else may explain that damping is not nominal."""
    car: Text = "half"
    """Model of the car, as ``--car`` takes it."""
    elements: dict[ElementName, Element] = Field(default_factory=half_car)
    """Its suspension elements."""
    parameters: dict[QuantityName, Parameter]
    left_over_right: dict[Axle, SideRatio] = Field(default_factory=dict)
    """By axle, where each side has a damper; does not depend on the error of the mass."""
    known: dict[Text, Known] = Field(default_factory=dict)
    prior: dict[Text, Prior] = Field(default_factory=dict)
    diagnostics: Diagnostics
    width: UncertaintyBudget | None = None
    """Uncertainty budget."""
    agreement: RunConsistency | None = None
    """Consistency of several runs."""
    effects: Annotated[list[Effect], Field(max_length=50)] = Field(default_factory=list)
    """Effects in the model."""
    dampers: Annotated[list[DampingRates], Field(max_length=10)] = Field(default_factory=list)
    springs: Annotated[list[SpringCurve], Field(max_length=10)] = Field(default_factory=list)
    """Curves of springs that have a free one."""
    clocks: Annotated[list[ClockErrors], Field(max_length=1000)] = Field(default_factory=list)
    """Errors of clocks that are declared or were asked for."""
    fit: Fits
    fit_by_run: Annotated[list[Fits], Field(max_length=1000)] = Field(default_factory=list)
    noise: Annotated[list[Noise], Field(max_length=1000)] = Field(default_factory=list)
    runs: Annotated[list[Run], Field(max_length=1000)] = Field(default_factory=list)
    logs: Annotated[list[LongLog], Field(max_length=1000)] = Field(default_factory=list)
    """Recordings of which only events were used; these are the runs then."""
    forces: dict[ElementName, DamperForce] = Field(default_factory=dict)
    """Force of each damper over the velocities driven."""
    sensitivity: dict[QuantityName, PriorSensitivity] = Field(default_factory=dict)
    """Power-scaling sensitivity of the answers to each prior."""
    draws: dict[Text, Curve] = Field(default_factory=dict)
    """Some of the draws, in the vehicle's units."""
    vehicle: VehicleInfo = VehicleInfo()
    provenance: Provenance = Provenance()
    seconds: NonNegative = 0.0
    """Time of computation."""
    version: Text
    seed: Count
    diagnosis: DiagnoseDocument | None = None
    """A diagnosis of the same recordings, for a report of both."""
    online: TrackDocument | None = None
    """A track of one of the recordings, for a report of both."""

    @model_validator(mode="after")
    def _check_verdict(self) -> Self:
        if self.verdict == "refused" and not self.reasons:
            raise ValueError("it is refused without a reason")
        if self.verdict != "refused":
            for element in self.elements.values():
                if element.damping not in self.parameters:
                    raise ValueError(f"it has a verdict but no parameter {element.damping}")
        check_lengths(None, *self.draws.values())
        return self
