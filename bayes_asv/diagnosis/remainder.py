"""What is left beside the named effects: added to the model, and compared with them."""

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
    """What is left, added to the model.

    Parameters
    ----------
    regression : FaultRegression or None
        The model with it; None where nothing decisive was found, or where it fails.
    errors : dict of str to ErrorChange
        Simulation errors then.
    alternative : float
        Log evidence (nats) by which unlisted faults alone explain the recordings better than the
        named effects beside what is left; −∞ without named effects.
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
    """Explain what is left by unlisted faults, beside the named effects and in their place.

    Parameters
    ----------
    assessed : AssessedModel
        With all named effects.
    named, effect_count : int
        Number of these, and of those that they were selected from.
    runs : Split
        Fitted and held-out recordings, engine tones removed.
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
        own, other = (
            base.evidence.log_evidence if found is None else found.log_evidence
            for base, found in ((assessed, beside), (plain, alone))
        )
        prior = named * math.log((1.0 - PRIOR_NONE) / effect_count)
        alternative = other - (own + prior)
    if beside is None:
        return UnlistedFaultResult(None, errors, alternative)
    changed = _changed_errors(assessed, beside, runs, errors, seed)
    return UnlistedFaultResult(beside if changed else None, changed or errors, alternative)


def _changed_errors(
    assessed: AssessedModel,
    regression: FaultRegression,
    runs: Split,
    errors: dict[str, ErrorChange],
    seed: int,
) -> dict[str, ErrorChange]:
    """Return the simulation errors with a regression; none where the held-out one is no smaller."""
    model, changed = regression.assessed.model, dict(errors)
    parts = (
        ("fit", runs.fit, regression.assessed.dataset),
        ("holdout", runs.holdout, regression.holdout),
    )
    for name, dataset, perturbed in parts:
        if dataset is None or perturbed is None:
            continue
        own = name == "fit"
        error = compare_errors(dataset, assessed.model, model, seed, own=own, perturbed=perturbed)
        if error.worse or (not own and error.after >= error.before):
            return {}
        floor = min(error.floor, errors[name].floor)
        worse = errors[name].worse and error.after > errors[name].before
        changed[name] = replace(errors[name], after=error.after, floor=floor, worse=worse)
    return changed
