"""Validation on held-out recordings: effects that make the simulation worse there are removed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

from bayes_asv.diagnosis.engine import Engine
from bayes_asv.diagnosis.forward_selection import (
    Progress,
    Selection,
    reconsider_pulses,
    select_effects,
)
from bayes_asv.diagnosis.misspecification_test import misspecification_tests
from bayes_asv.diagnosis.model_assessment import (
    AssessedModel,
    prune,
    remove_effects,
    submodel,
    supported_by_holdout,
)
from bayes_asv.diagnosis.model_comparison import weighted_posterior
from bayes_asv.diagnosis.results import NamedEffect
from bayes_asv.diagnosis.simulation_error import ErrorChange, compare_errors, simulation_residuals
from bayes_asv.posterior.fitted_model import Dataset, FittedModel

__all__ = [
    "Split",
    "ValidatedSelection",
    "ValidationErrors",
    "failed_effects",
    "validate",
    "validation_errors",
]

_AT_FLOOR = 1.03  # times the noise floor: within the uncertainty of an estimated floor


class Split(NamedTuple):
    """Fitted and held-out recordings, with the linear car.

    Parameters
    ----------
    fit : Dataset
        Fitted recordings.
    holdout : Dataset or None
        Held-out recordings.
    linear : FittedModel
        The linear car at its mode on the first.
    """

    fit: Dataset
    holdout: Dataset | None
    linear: FittedModel


class ValidationErrors(NamedTuple):
    """Simulation errors before and after.

    Parameters
    ----------
    errors : dict of str to ErrorChange
        ``fit`` and, where there is one, ``holdout``, from the linear car to the final model;
        an engine is part of the error before.
    effects : list of NamedEffect
        Each with its own errors.
    without_engine : ErrorChange or None
        On held-out recordings, engine tones removed before and after.
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
        The named effects that did not fail, with their simulation errors.
    errors : dict of str to ErrorChange
        Simulation errors of all of them together.
    failed : tuple of str
        Sites that were named and made the simulation of held-out recordings worse.
    unlisted : bool
        Something that is not in the list was found, in the selection or when effects failed.
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
    """Remove effects that are unnecessary or fail; where one failed, select another once.

    An effect that failed stood in for something else.  Where that is not in the list, as the
    selection or the misspecification tests have found, another effect would only stand in for it
    again.

    Parameters
    ----------
    selection : Selection
        The named effects.
    given, without_tones, engine, seed
        As :func:`validation_errors` takes them.
    progress : callable
        See :data:`bayes_asv.diagnosis.forward_selection.Progress`.
    """

    def attempt(selection: Selection, excluded: tuple[str, ...] = ()) -> ValidatedSelection:
        selection = _pruned(selection, seed)
        reconsidered = reconsider_pulses(selection, seed, progress, excluded)
        if reconsidered is not selection:
            selection = _pruned(reconsidered, seed)
        assessed, named = selection.assessed, list(selection.effects)
        progress(0.85, "validating on held-out recordings")
        errors, named, silent = validation_errors(
            given, without_tones, assessed, named, engine, seed
        )
        unlisted = bool(selection.stopped_by)
        while failed := failed_effects(without_tones.holdout, assessed, named, silent, seed):
            excluded += tuple(str(e.placed) for e in failed)
            unlisted = (
                unlisted
                or misspecification_tests(assessed.denoised, assessed.evidence, seed).detected
            )
            assessed, named = remove_effects(assessed, named, failed, seed)
            errors, named, silent = validation_errors(
                given, without_tones, assessed, named, engine, seed
            )
        return ValidatedSelection(
            _with_effects(selection, assessed, named), errors, excluded, unlisted
        )

    first = attempt(selection)
    if not first.failed or first.unlisted:
        return first
    again = select_effects(first.selection, seed, progress, first.failed)
    return attempt(again, first.failed)


def _pruned(selection: Selection, seed: int) -> Selection:
    """Remove the effects that later ones made unnecessary."""
    return _with_effects(selection, *prune(selection.assessed, list(selection.effects), seed))


def _with_effects(
    selection: Selection, assessed: AssessedModel, effects: list[NamedEffect]
) -> Selection:
    """Return a selection with these effects, and the model's posterior where some were removed."""
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
    """Effects that make the simulation of held-out recordings worse.

    An effect fails when the error increased both when it was added (which may be the fault of
    another that was still missing) and when it is added last, when the remaining error is above the
    noise floor, and when the likelihood of the held-out recordings speaks against it.  An effect of
    a single run cannot be judged on others.  Where all effects together increased the error and
    none alone is to blame, all fail, those of a single run included, which displace the car's own
    parameters: they stand in for something that is not in the list.

    Parameters
    ----------
    holdout : Dataset or None
        Held-out recordings.
    assessed : AssessedModel
        With all named effects.
    effects : list of NamedEffect
        With their simulation errors.
    total : ErrorChange or None
        Of all of them on the held-out recordings without engine tones: removed, those lower the
        error whatever the effects do.
    seed : int
        Seed of the bootstrap.
    """
    if holdout is None:
        return []
    failed = []
    for effect in effects:
        if effect.placed.run is not None or not _worse(effect.errors["holdout"]):
            continue
        others = tuple(e.placed for e in effects if e is not effect)
        without = submodel(assessed, others)
        worse = compare_errors(holdout, without, assessed.model, seed).worse
        if worse and not supported_by_holdout(assessed, holdout, [effect]):
            failed.append(effect)
    if failed or total is None or not _worse(total):
        return failed
    return [] if supported_by_holdout(assessed, holdout, effects) else effects


def _worse(error: ErrorChange) -> bool:
    """Whether an error increased and is not at the noise floor."""
    return error.worse and error.after > _AT_FLOOR * error.floor


def validation_errors(
    given: Split,
    without_tones: Split,
    assessed: AssessedModel,
    effects: list[NamedEffect],
    engine: Engine | None,
    seed: int,
) -> ValidationErrors:
    """Compute the errors of the selection and of each effect, on fitted and held-out runs.

    Parameters
    ----------
    given, without_tones : Split
        Recordings as given, and without engine tones.
    assessed : AssessedModel
        With all named effects.
    effects : list of NamedEffect
        In order.
    engine : Engine or None
        Whose tones were removed.
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
        own = name == "fit"
        change = compare_errors(dataset, models[0], models[-1], seed, own=own)
        without_engine[name] = change
        if engine is not None:
            before = simulation_residuals(as_given, given.linear, seed).rms
            change = replace(change, before=before, worse=change.after > before)
        errors[name] = change
        for j in range(len(effects)):
            of_effects[j][name] = compare_errors(dataset, models[j], models[j + 1], seed, own=own)
    effects = [replace(e, errors=own) for e, own in zip(effects, of_effects, strict=True)]
    return ValidationErrors(errors, effects, without_engine.get("holdout"))
