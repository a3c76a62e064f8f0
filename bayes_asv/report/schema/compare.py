"""``bayes_asv/compare/1``."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from bayes_asv.report.schema.estimate import EstimateDocument
from bayes_asv.report.schema.parts import (
    Count,
    Interval,
    MaybeShare,
    Model,
    NonNegative,
    OneOf,
    Positive,
    Provenance,
    QuantityName,
    Share,
    Text,
    Texts,
    VehicleInfo,
)

__all__ = ["ChangePrior", "CompareDocument", "ParameterChange"]


class ChangePrior(Model):
    """What is believed of every change before the recordings are seen."""

    unchanged: Share
    """Probability that a parameter did not change."""
    log_sd: Positive
    """Standard deviation of the logarithm of after over before, if it changed."""


class ParameterChange(Model):
    """Change of one parameter."""

    label: Text
    ratio: Positive
    """After over before: median of the posterior if all parameters may have changed."""
    eti95: Interval
    log_sd: NonNegative
    """Standard deviation of the logarithm of the ratio."""
    p_changed: Share
    """Posterior probability that it changed."""
    p_lower: Share
    """Posterior probability that it changed and is lower after."""
    p_higher: Share
    """Posterior probability that it changed and is higher after."""
    p_value: MaybeShare
    """Of the test that it is the same, with the others free to differ."""

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if not 0.0 < self.eti95[0] <= self.ratio <= self.eti95[1]:
            raise ValueError("the ratio is not inside its interval")
        return self


class CompareDocument(Model):
    """Two sessions of one car compared; written by ``bayes-asv compare``."""

    schema_name: Literal["bayes_asv/compare/1"] = Field(alias="schema")
    verdict: Annotated[str, OneOf("changed", "consistent", "unclear", "doubtful", "refused")]
    """``unclear`` if a parameter may or may not have changed; ``doubtful`` where there are
    ``doubts``."""
    reasons: Texts
    warnings: Texts
    doubts: Texts
    """Why no verdict on a damper may rest on this comparison."""
    p_value: MaybeShare
    """Of the test that all parameters are the same."""
    p_unchanged: MaybeShare
    """Posterior probability that none of them changed."""
    p_value_shared: MaybeShare
    """Of the test that everything else that both sessions share is the same."""
    differ_below: Share
    """p-value of that test below which the sessions differ in something else."""
    prior: ChangePrior
    shared: Texts
    """Given values with an uncertainty that both sessions share."""
    different: Texts
    """Given values that differ between both vehicle files."""
    changes: dict[QuantityName, ParameterChange]
    before: EstimateDocument
    """Estimate from the first session alone."""
    after: EstimateDocument
    """Estimate from the second session alone."""
    vehicle: VehicleInfo = VehicleInfo()
    provenance: Provenance = Provenance()
    version: Text
    seed: Count

    @model_validator(mode="after")
    def _check_complete(self) -> Self:
        if self.verdict == "refused":
            return self
        if not self.changes:
            raise ValueError("it has a verdict but no changes")
        for name in self.changes:
            if name not in self.before.parameters or name not in self.after.parameters:
                raise ValueError(f"it has a change of {name} but not both estimates of it")
        return self
