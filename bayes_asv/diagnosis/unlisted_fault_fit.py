"""Unlisted faults beside the named effects, and in place of them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

from bayes_asv.diagnosis.fault_regression import FaultRegression, regress_on_unlisted_faults
from bayes_asv.diagnosis.holdout_validation import Split
from bayes_asv.diagnosis.model_assessment import AssessedModel, model_evidence, submodel
from bayes_asv.diagnosis.simulation_error import ErrorChange, compare_errors
from bayes_asv.diagnosis.thresholds import PRIOR_NONE

__all__ = ["UnlistedFaultResult", "fit_unlisted_faults"]


class UnlistedFaultResult(NamedTuple):
    """A model with unlisted faults beside the named effects.

    Parameters
    ----------
    regression : FaultRegression or None
        The model with unlisted faults; None if none is decisive, or if it fails the validation.
    errors : dict of str to ErrorChange
        Simulation errors with the resulting model.
    alternative : float
        Log Bayes factor (nats) of unlisted faults alone against the named effects, with unlisted
        faults beside them; −∞ without named effects.
    """

    regression: FaultRegression | None
    errors: dict[str, ErrorChange]
    alternative: float


def fit_unlisted_faults(
    assessed: AssessedModel,
    named: int,
    effect_count: int,
    runs: Split,
    errors: dict[str, ErrorChange],
    seed: int,
) -> UnlistedFaultResult:
    """Fit unlisted faults beside the named effects, and in their place.

    Parameters
    ----------
    assessed : AssessedModel
        Model with all named effects.
    named, effect_count : int
        Number of named effects, and number of candidates from which they were selected.
    runs : Split
        Fitted and held-out recordings, with engine tones removed.
    errors : dict of str to ErrorChange
        Simulation errors with the named effects alone.
    seed : int
        Seed of the errors' noise and bootstrap.
    """
    beside = regress_on_unlisted_faults(assessed, runs.holdout)
    alternative = -math.inf
    if named:
        model = submodel(assessed, ())
        plain = replace(assessed, model=model, evidence=model_evidence(assessed.denoised, model))
        alone = regress_on_unlisted_faults(plain, None)
        with_named, without_named = (
            base.evidence.log_evidence if fit is None else fit.log_evidence
            for base, fit in ((assessed, beside), (plain, alone))
        )
        prior = named * math.log((1.0 - PRIOR_NONE) / effect_count)
        alternative = without_named - (with_named + prior)
    if beside is None:
        return UnlistedFaultResult(None, errors, alternative)
    changed = _errors_with(assessed, beside, runs, errors, seed)
    return UnlistedFaultResult(beside if changed else None, changed or errors, alternative)


def _errors_with(
    assessed: AssessedModel,
    regression: FaultRegression,
    runs: Split,
    errors: dict[str, ErrorChange],
    seed: int,
) -> dict[str, ErrorChange]:
    """Return the simulation errors with a regression; empty if the held-out one is no smaller."""
    model, changed = regression.assessed.model, dict(errors)
    parts = (
        ("fit", runs.fit, regression.assessed.dataset),
        ("holdout", runs.holdout, regression.holdout),
    )
    for name, dataset, perturbed in parts:
        if dataset is None or perturbed is None:
            continue
        is_fitted = name == "fit"
        error = compare_errors(
            dataset, assessed.model, model, seed, same_runs=is_fitted, perturbed=perturbed
        )
        if error.worse or (not is_fitted and error.after >= error.before):
            return {}
        floor = min(error.floor, errors[name].floor)
        worse = errors[name].worse and error.after > errors[name].before
        changed[name] = replace(errors[name], after=error.after, floor=floor, worse=worse)
    return changed
