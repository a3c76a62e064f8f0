"""Validation: effects that make the simulation of held-out recordings worse are removed.

So are force pulses where something remains beside them.  A pulse acts once, so that held-out
recordings cannot test it, and with a free time and duration it fits a part of most faults.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

from bayes_asv.diagnosis.engine import Engine
from bayes_asv.diagnosis.forward_selection import (
    Selection,
    reconsider_pulses,
    select_effects,
)
from bayes_asv.diagnosis.misspecification_test import misspecification_tests
from bayes_asv.diagnosis.model_assessment import (
    AssessedModel,
    fit_pooled,
    prune,
    remove_effects,
    submodel,
    supported_by_holdout,
)
from bayes_asv.diagnosis.model_comparison import weighted_posterior
from bayes_asv.diagnosis.results import NamedEffect
from bayes_asv.diagnosis.simulation_error import ErrorChange, compare_errors, simulation_residuals
from bayes_asv.domain.progress import Progress
from bayes_asv.posterior.fitted_model import Dataset, FittedModel

__all__ = [
    "SimulationErrors",
    "Split",
    "ValidatedSelection",
    "failed_effects",
    "simulation_errors",
    "validate",
]

# Ratio of error to noise floor that counts as at the floor, given the uncertainty of the floor.
_AT_FLOOR = 1.03


class Split(NamedTuple):
    """Fitted and held-out recordings, with the linear car.

    Parameters
    ----------
    fit : Dataset
        Fitted recordings.
    holdout : Dataset or None
        Held-out recordings.
    linear : FittedModel
        The linear car, fitted to the fitted recordings.
    """

    fit: Dataset
    holdout: Dataset | None
    linear: FittedModel


class SimulationErrors(NamedTuple):
    """Simulation errors before and after effects were added.

    Parameters
    ----------
    errors : dict of str to ErrorChange
        Errors on ``fit`` and, if there is any, ``holdout``, of the linear car and of the final
        model; those of the linear car include an engine.
    effects : list of NamedEffect
        The effects, each with its own errors.
    without_engine : ErrorChange or None
        Errors on held-out recordings, with engine tones removed for both models.
    """

    errors: dict[str, ErrorChange]
    effects: list[NamedEffect]
    without_engine: ErrorChange | None


@dataclass(frozen=True)
class ValidatedSelection:
    """Effects that passed the validation.

    Parameters
    ----------
    selection : Selection
        The remaining effects, with their simulation errors.
    errors : dict of str to ErrorChange
        Simulation errors with all of them.
    failed : tuple of str
        Named effects that made the simulation of held-out recordings worse.
    unlisted : bool
        Whether an unlisted fault was found, in the selection or when effects failed.
    """

    selection: Selection
    errors: dict[str, ErrorChange]
    failed: tuple[str, ...] = ()
    unlisted: bool = False


def validate(
    selection: Selection,
    given: Split,
    without_tones: Split,
    engine: Engine | None,
    seed: int,
    progress: Progress,
) -> ValidatedSelection:
    """Remove effects that are unnecessary or fail; if one failed, continue the selection once.

    An effect that failed stood in for something else.  If that is not in the list, according to the
    selection or the misspecification tests, another effect would only stand in for it again.

    Parameters
    ----------
    selection : Selection
        The named effects.
    given, without_tones, engine, seed
        As in :func:`simulation_errors`.
    progress : callable
        See :data:`bayes_asv.domain.progress.Progress`.
    """

    def attempt(selection: Selection, excluded: tuple[str, ...] = ()) -> ValidatedSelection:
        selection = _prune(selection, seed)
        reconsidered = reconsider_pulses(selection, seed, progress, excluded)
        if reconsidered is not selection:
            selection = _prune(reconsidered, seed)
        assessed, named = selection.assessed, list(selection.effects)
        progress(0.85, "validating on held-out recordings")
        errors, named, without_engine = simulation_errors(
            given, without_tones, assessed, named, engine, seed
        )
        unlisted = bool(selection.stopped_by)
        while failed := failed_effects(
            without_tones.holdout, assessed, named, without_engine, seed
        ):
            excluded += tuple(str(e.placed) for e in failed)
            unlisted = (
                unlisted
                or misspecification_tests(assessed.denoised, assessed.evidence, seed).detected
            )
            assessed, named = remove_effects(assessed, named, failed, seed)
            errors, named, without_engine = simulation_errors(
                given, without_tones, assessed, named, engine, seed
            )
        pulses = [e for e in named if e.placed.run is not None]
        if pulses and _something_remains(assessed, without_tones.holdout, seed):
            assessed, named = remove_effects(assessed, named, pulses, seed)
            errors, named, _ = simulation_errors(
                given, without_tones, assessed, named, engine, seed
            )
        return ValidatedSelection(
            _replace_effects(selection, assessed, named), errors, excluded, unlisted
        )

    first = attempt(selection)
    if not first.failed or first.unlisted:
        return first
    continued = select_effects(first.selection, seed, progress, first.failed)
    return attempt(continued, first.failed)


def _something_remains(assessed: AssessedModel, holdout: Dataset | None, seed: int) -> bool:
    """Whether the misspecification tests find something beside the named effects."""
    pooled, _, evidence = fit_pooled(assessed, holdout)
    return misspecification_tests(pooled, evidence, seed).detected


def _prune(selection: Selection, seed: int) -> Selection:
    """Remove effects that later ones made unnecessary, and those within the error of knots."""
    return _replace_effects(selection, *prune(selection.assessed, list(selection.effects), seed))


def _replace_effects(
    selection: Selection, assessed: AssessedModel, effects: list[NamedEffect]
) -> Selection:
    """Return a selection with these effects, and its posterior if some were removed."""
    fewer = len(effects) < len(selection.effects)
    posteriors = selection.posteriors
    if fewer:
        posteriors = weighted_posterior(assessed.model, assessed.evidence)
    return replace(selection, assessed=assessed, effects=tuple(effects), posteriors=posteriors)


def failed_effects(
    holdout: Dataset | None,
    assessed: AssessedModel,
    effects: list[NamedEffect],
    total: ErrorChange | None,
    seed: int,
) -> list[NamedEffect]:
    """Find effects that make the simulation of held-out recordings worse.

    An effect fails if all of these hold: the error increased when it was added (which may be due to
    another effect that was still missing); it also increases when the effect is added last; the
    remaining error is above the noise floor; and the likelihood of the held-out recordings argues
    against it.  An effect of a single run cannot be tested on others.  If all effects together
    increased the error and no single one is responsible, all fail, including those of a single run,
    which bias the parameters of the car: they stand in for something that is not in the list.

    Parameters
    ----------
    holdout : Dataset or None
        Held-out recordings.
    assessed : AssessedModel
        Model with all named effects.
    effects : list of NamedEffect
        Named effects, with their simulation errors.
    total : ErrorChange or None
        Error change by all of them on the held-out recordings without engine tones, whose removal
        lowers the error by itself.
    seed : int
        Seed of the bootstrap.
    """
    if holdout is None:
        return []
    failed = []
    for effect in effects:
        if effect.placed.run is not None or not _is_worse(effect.errors["holdout"]):
            continue
        others = tuple(e.placed for e in effects if e is not effect)
        without = submodel(assessed, others)
        worse = compare_errors(holdout, without, assessed.model, seed).worse
        if worse and not supported_by_holdout(assessed, holdout, [effect]):
            failed.append(effect)
    if failed or total is None or not _is_worse(total):
        return failed
    return [] if supported_by_holdout(assessed, holdout, effects) else effects


def _is_worse(error: ErrorChange) -> bool:
    """Whether an error increased and exceeds the noise floor."""
    return error.worse and error.after > _AT_FLOOR * error.floor


def simulation_errors(
    given: Split,
    without_tones: Split,
    assessed: AssessedModel,
    effects: list[NamedEffect],
    engine: Engine | None,
    seed: int,
) -> SimulationErrors:
    """Compute the errors of the selection and of each effect, on fitted and held-out runs.

    Parameters
    ----------
    given, without_tones : Split
        Recordings as given, and without engine tones.
    assessed : AssessedModel
        Model with all named effects.
    effects : list of NamedEffect
        Named effects, in the order in which they were added.
    engine : Engine or None
        Engine whose tones were removed.
    seed : int
        Seed of noise and bootstrap.
    """
    models = [without_tones.linear]
    for k in range(1, len(effects)):
        models.append(submodel(assessed, tuple(e.placed for e in effects[:k])))
    if effects:
        models.append(assessed.model)
    errors: dict[str, ErrorChange] = {}
    without_engine: dict[str, ErrorChange] = {}
    of_effects = [dict(e.errors) for e in effects]
    parts = (
        ("fit", without_tones.fit, given.fit),
        ("holdout", without_tones.holdout, given.holdout),
    )
    for name, dataset, as_given in parts:
        if dataset is None or as_given is None:
            continue
        is_fitted = name == "fit"
        change = compare_errors(dataset, models[0], models[-1], seed, same_runs=is_fitted)
        without_engine[name] = change
        if engine is not None:
            before = simulation_residuals(as_given, given.linear, seed).rms
            change = replace(change, before=before, worse=change.after > before)
        errors[name] = change
        for j in range(len(effects)):
            of_effects[j][name] = compare_errors(
                dataset, models[j], models[j + 1], seed, same_runs=is_fitted
            )
    effects = [replace(e, errors=own) for e, own in zip(effects, of_effects, strict=True)]
    return SimulationErrors(errors, effects, without_engine.get("holdout"))
