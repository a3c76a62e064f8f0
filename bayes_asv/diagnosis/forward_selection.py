"""Forward selection: the most probable missing effect is added, until nothing more is missing.

Two models are indistinguishable if one of them, fitted to the noise-free prediction of the other,
differs by less than noise would hide, or by less than the error of its law, or if the data prefer
neither.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.model_assessment import (
    AssessedModel,
    assess,
    model_evidence,
    remove_effects,
    submodel,
)
from bayes_asv.diagnosis.model_comparison import (
    ExtendedModel,
    WeightedPosterior,
    evidence_without,
    fit_candidates,
    model_probabilities,
    split_places,
    weighted_posterior,
)
from bayes_asv.diagnosis.results import NamedEffect
from bayes_asv.diagnosis.score_test import nuisance_projection
from bayes_asv.diagnosis.thresholds import (
    CLEARLY_WORSE,
    DECISIVE_EVIDENCE,
    DISTINGUISHABLE_DISTANCE,
    FIRST_ORDER_ERROR,
    FURTHER_LEVEL,
    MAX_EFFECTS,
    MIN_PROBABILITY,
    SIGNIFICANCE_LEVEL,
    TOLERANCE_PREFERRED,
)
from bayes_asv.diagnosis.tolerance_prior import ModelEvidence
from bayes_asv.diagnosis.unlisted_faults import best_unlisted_explanation
from bayes_asv.domain.errors import FitError
from bayes_asv.domain.progress import Progress
from bayes_asv.posterior.effect_fit import Candidate, fit_with_effect
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, fit_again, fit_model
from bayes_asv.posterior.free_simulation import free_run

__all__ = [
    "Selection",
    "indistinguishable_from_best",
    "reconsider_pulses",
    "select_effects",
    "similar_candidates",
    "squared_distance",
    "start_selection",
    "with_indistinguishable",
]

# Difference of log evidence (nats, odds of 20 : 1) below which the data prefer neither model.
_NO_PREFERENCE = 3.0
# Error of a law, as a share of what it changes.  A filter of second order differs from a pure delay
# and from a pole by a fifth to a quarter of what it changes.
_LAW_ERROR = 0.25
_MAX_COMPARED = 4  # models that are compared with the best one
_MAX_REFITTED = 2  # effects that are fitted in place of each named effect


def squared_distance(dataset: Dataset, one: FittedModel, other: FittedModel) -> float:
    """Squared whitened distance of ``other`` after a fit to the noise-free prediction of ``one``.

    Noise levels are fixed at their declared values, so that they cannot absorb the difference.
    """
    recordings = tuple(
        replace(recording, reading=free_run(one.posterior, one.mode.z, run).output)
        for run, recording in enumerate(dataset.recordings)
    )
    predicted = replace(dataset, recordings=recordings)
    modes = []
    for model in (one, other):
        posterior = predicted.posterior(model.placed_effects, fixed_noise=True)
        modes.append(fit_model(posterior, model.transfer(posterior.space)).mode)
    # the misfit of ``one`` to its own prediction is due to the initial state alone
    return max(2.0 * (modes[0].log_posterior - modes[1].log_posterior), 0.0)


def indistinguishable_from_best(
    dataset: Dataset, base: FittedModel, extended: list[ExtendedModel]
) -> list[ExtendedModel]:
    """List the models that the data cannot distinguish from the first one, including it.

    The law of an effect is only nearly that of a car.  If the effect changes the predictions by a
    squared distance D², a law of the same kind may therefore differ from it by a share s of D, and
    lose s² D²/2 of log evidence.  A force pulse has no law.

    Parameters
    ----------
    dataset : Dataset
        Recordings with denoised inputs.
    base : FittedModel
        The model without the effect.
    extended : list of ExtendedModel
        Models with one more effect, the most probable first.
    """
    best, *others = extended[: 1 + _MAX_COMPARED]
    out = [best]
    if not others:
        return out
    error = _LAW_ERROR**2 * squared_distance(dataset, best.model, base)
    for other in others:
        behind = best.evidence.log_evidence - other.evidence.log_evidence
        allowed = 0.0 if best.placed.effect.in_one_run or other.placed.effect.in_one_run else error
        if not behind < max(CLEARLY_WORSE, 0.5 * allowed):
            continue
        if behind < _NO_PREFERENCE or (
            squared_distance(dataset, best.model, other.model)
            < max(DISTINGUISHABLE_DISTANCE, allowed)
        ):
            out.append(other)
    return out


def with_indistinguishable(
    assessed: AssessedModel, effects: tuple[NamedEffect, ...]
) -> tuple[NamedEffect, ...]:
    """Add the indistinguishable alternatives of each named effect, given all others.

    When the effect was named, other effects were still missing; models that could be distinguished
    then may be indistinguishable in the final model.

    Parameters
    ----------
    assessed : AssessedModel
        Model with all named effects.
    effects : tuple of NamedEffect
        Named effects; a single one has been compared in the final model already.
    """
    if len(effects) < 2:
        return effects
    return tuple(_add_indistinguishable(assessed, one) for one in effects)


def _add_indistinguishable(assessed: AssessedModel, effect: NamedEffect) -> NamedEffect:
    groups = similar_candidates(assessed, effect)
    if not groups:
        return effect
    rest = submodel(assessed, tuple(s for s in assessed.model.placed_effects if s != effect.placed))
    extended = [ExtendedModel(effect.placed, assessed.model, assessed.evidence)]
    extended += [_fit_in_place(assessed, rest, group) for group in groups[:_MAX_REFITTED]]
    known_effects = {str(other.placed) for other in effect.indistinguishable}
    others = indistinguishable_from_best(assessed.denoised, rest, extended)[1:]
    new = [one for one in others if str(one.placed) not in known_effects]
    return replace(effect, indistinguishable=(*effect.indistinguishable, *new))


def similar_candidates(assessed: AssessedModel, effect: NamedEffect) -> list[list[Candidate]]:
    """Candidates, by effect and place, that change predictions as an effect does; closest first.

    To first order: the effect's change of the predictions, with the candidate's projected out, is
    smaller than noise would hide.

    Parameters
    ----------
    assessed : AssessedModel
        Model with all named effects.
    effect : NamedEffect
        One of them.
    """
    model, test = assessed.model, assessed.test
    names = [effect.placed.coordinate_name(p) for p in effect.placed.effect.parameters]
    is_of_effect = np.array([name in names for name in model.space.names])
    derivatives = test.derivatives
    change = model.mode.z[is_of_effect] @ derivatives.means[is_of_effect]
    projection = nuisance_projection(
        derivatives.only(~is_of_effect), model.mode.z[~is_of_effect], test.quantization_drifts
    )
    _, information = projection.project_out(np.vstack([change, test.sensitivities]))
    cross, size = information[0, 1:], np.diag(information)[1:]
    remaining = information[0, 0] - cross**2 / np.maximum(size, 1e-12)
    groups: dict[tuple[str, int | None], list[Candidate]] = {}
    for k in np.argsort(remaining):
        candidate = test.candidates[k]
        if remaining[k] < DISTINGUISHABLE_DISTANCE and not effect.placed.overlaps(candidate.placed):
            groups.setdefault(candidate.placed.key, []).append(candidate)
    return list(groups.values())


def _fit_in_place(
    assessed: AssessedModel, rest: FittedModel, group: list[Candidate]
) -> ExtendedModel:
    """Fit another effect in place of a named one."""
    model = fit_with_effect(assessed.denoised, rest, group)
    evidence = model_evidence(assessed.denoised, model)
    return ExtendedModel(group[0].placed, model, evidence)


Array = NDArray[np.float64]

_TINY = 1e-12  # lower bound of a probability in a denominator


@dataclass(frozen=True)
class Selection:
    """A model with the effects that were selected.

    Parameters
    ----------
    assessed : AssessedModel
        Model with all named effects.
    effects : tuple of NamedEffect
        Named effects, in the order in which they were added.
    posteriors : list of WeightedPosterior
        Models of the last step, weighted by their probabilities.
    p_none : float
        Probability that nothing beyond tolerances is missing, before the first effect was named.
    engine_found : bool
        Whether a cause that is no effect of the model was found (an engine), so that any effect is
        a further one.
    stopped_by : str
        The unlisted explanation that ended the selection; empty without one.
    """

    assessed: AssessedModel
    effects: tuple[NamedEffect, ...]
    posteriors: list[WeightedPosterior]
    p_none: float
    engine_found: bool = False
    stopped_by: str = ""


class _Step(NamedTuple):
    """Comparison of the effects that may be added next.

    Parameters
    ----------
    extended : list of ExtendedModel
        Models with one more effect, the most probable first.
    probabilities : (K,) array
        Their probabilities.
    p_none : float
        Probability that nothing is missing.
    gain : float
        Log evidence of the first one over the current model, nats.
    posteriors : list of WeightedPosterior
        All models, weighted by their probabilities.
    stopped_by : str
        An unlisted explanation that is better than all of them; empty without one.
    """

    extended: list[ExtendedModel]
    probabilities: Array
    p_none: float
    gain: float
    posteriors: list[WeightedPosterior]
    stopped_by: str


def start_selection(assessed: AssessedModel, *, engine_found: bool = False) -> Selection:
    """Return a selection without any effects."""
    posteriors = weighted_posterior(assessed.model, assessed.evidence)
    return Selection(assessed, (), posteriors, 1.0, engine_found)


def select_effects(
    selection: Selection,
    seed: int,
    progress: Progress,
    excluded: Collection[str] = (),
    max_effects: int = MAX_EFFECTS,
) -> Selection:
    """Add the most probable effect, as long as one is missing and no unlisted fault is better.

    Listed effects can stand in for a fault that is not in the list, each for a part of it.
    Therefore no more effects are added once an unlisted explanation is better than the best one.

    If the tolerances alone are more probable than the best effect, it is added on trial: of two
    faults, each may be less probable than tolerances that explain both.  The next step decides.

    Parameters
    ----------
    selection : Selection
        From :func:`start_selection`, or a selection to continue.
    seed : int
        Seed of the tests.
    progress : callable
        See :data:`Progress`.
    excluded : collection of str
        Placed effects that are not considered, by name, since they failed on held-out recordings.
    max_effects : int
        Largest number of effects in all.
    """
    current = accepted_so_far = replace(selection, stopped_by="")
    p_tolerances = 0.0  # probability of the tolerances alone, in place of the effect on trial
    while len(current.effects) < max_effects:
        assessed = current.assessed
        further = bool(current.effects) or current.engine_found
        if assessed.p_value >= (FURTHER_LEVEL if further else SIGNIFICANCE_LEVEL):
            break
        share_done = 0.1 + 0.2 * len(current.effects)
        progress(share_done, "testing for missing effects")
        step = _compare_next_effects(
            assessed, progress, share_done + 0.05, excluded, further=further
        )
        if step is None:
            break
        p_none = current.p_none if current.effects else step.p_none
        p_named = 1.0  # probability that the effects named so far are present
        if step.stopped_by:  # which does not make an effect on trial more probable
            on_trial = p_tolerances > 0.0
            last = (
                accepted_so_far
                if on_trial
                else replace(current, posteriors=step.posteriors, p_none=p_none)
            )
            return replace(last, stopped_by=step.stopped_by)
        if p_tolerances > 0.0:
            updated = _updated_tolerance_probability(p_tolerances, step.p_none)
            if updated > TOLERANCE_PREFERRED:
                break
            current = _rescaled(current, (1.0 - updated) / (1.0 - p_tolerances), updated)
            p_tolerances, p_none, p_named = 0.0, updated, 1.0 - updated
        current = replace(current, posteriors=step.posteriors, p_none=p_none)
        progress(share_done + 0.15, "comparing indistinguishable effects")
        best, *others = members = indistinguishable_from_best(
            assessed.denoised, assessed.model, step.extended
        )
        probability = p_named * float(
            sum(step.probabilities[step.extended.index(one)] for one in members)
        )
        likely = p_named * (1.0 - step.p_none) >= 1.0 - TOLERANCE_PREFERRED
        accepted = step.gain >= 0.0 and probability >= MIN_PROBABILITY and (likely or not further)
        on_trial = not likely and not further
        if not (accepted or on_trial):
            break
        before, new = current, best.model.placed_effects[len(assessed.model.placed_effects) :]
        try:
            reassessed = assess(assessed.dataset, best.model, seed)
        except FitError:  # the fit to recordings as read diverges
            excluded = {*excluded, *map(str, new)}
            continue
        effects = [NamedEffect(placed, min(probability, 1.0), tuple(others), {}) for placed in new]
        current = replace(
            current,
            assessed=reassessed,
            effects=(*current.effects, *effects),
        )
        if on_trial:
            p_tolerances, accepted_so_far = step.p_none, current if accepted else before
    return accepted_so_far if p_tolerances > 0.0 else current


def _compare_next_effects(
    assessed: AssessedModel,
    progress: Progress,
    share_done: float,
    excluded: Collection[str],
    *,
    further: bool,
) -> _Step | None:
    """Compare all effects that a model may lack; None if no candidate is worth a fit."""
    extended = fit_candidates(
        assessed.denoised,
        assessed.model,
        assessed.test,
        lambda placed: progress(share_done, f"fitting {placed}"),
        excluded,
        further=further,
    )
    if not extended:
        return None
    extended[0] = best = split_places(assessed.denoised, extended[0], assessed.test)
    without, model, evidence = evidence_without(
        assessed.model, assessed.evidence, extended, assessed.test
    )
    p_none, probabilities = model_probabilities(without, extended, assessed.test.effect_count)
    stopped_by = _better_unlisted(assessed, best, without)
    if stopped_by:
        posteriors = weighted_posterior(assessed.model, assessed.evidence)
    else:
        posteriors = weighted_posterior(model, evidence, p_none)
        for one, weight in zip(extended, probabilities, strict=True):
            posteriors += weighted_posterior(one.model, one.evidence, weight)
    gain = best.evidence.log_evidence - without
    return _Step(extended, probabilities, p_none, gain, posteriors, stopped_by)


def _better_unlisted(assessed: AssessedModel, best: ExtendedModel, without: float) -> str:
    """Return the unlisted explanation that is decisively better than any listed effect.

    It replaces the best listed effect, and is evaluated without that effect's tolerance as well,
    which would explain a part of the same change.

    Parameters
    ----------
    assessed : AssessedModel
        The current model.
    best : ExtendedModel
        The model with the best listed effect.
    without : float
        Log evidence of the current model.

    Returns
    -------
    str
        Its description; empty if an effect or the tolerances are as good.
    """
    listed = max(best.evidence.log_evidence, without)

    def decisive(base: ModelEvidence) -> str:
        unlisted = best_unlisted_explanation(assessed.denoised, base)
        margin = FIRST_ORDER_ERROR * (listed - base.log_evidence)
        better = unlisted.log_evidence > listed + DECISIVE_EVIDENCE + margin
        return unlisted.description if better else ""

    description = decisive(assessed.evidence)
    if not description or best.evidence.log_evidence < without:
        return description
    new = tuple(
        placed
        for placed in best.model.placed_effects
        if placed not in assessed.model.placed_effects
    )
    return decisive(model_evidence(assessed.denoised, assessed.model, new))


def _rescaled(selection: Selection, factor: float, p_none: float) -> Selection:
    """Multiply the probabilities of all named effects by a factor."""
    effects = tuple(
        replace(e, probability=min(e.probability * factor, 1.0)) for e in selection.effects
    )
    return replace(selection, effects=effects, p_none=p_none)


def _updated_tolerance_probability(before: float, p_none: float) -> float:
    """Probability of the tolerances alone, after the step that follows an effect on trial.

    Three explanations remain: tolerances alone, the first effect, and the first effect with a
    second one.  The step compares the last two.  If o are the odds of the first effect against the
    tolerances and n is the probability that no second effect is present, the odds of the last two
    together are o/n.

    Parameters
    ----------
    before : float
        Probability of the tolerances alone when the first effect was added.
    p_none : float
        Probability n that nothing is missing beside the first effect.
    """
    odds = (1.0 - before) / before / max(p_none, _TINY)
    return 1.0 / (1.0 + odds)


def reconsider_pulses(
    selection: Selection, seed: int, progress: Progress, excluded: Collection[str] = ()
) -> Selection:
    """Repeat the selection without force pulses that were named before another effect.

    A pulse of free duration fits a part of most faults, and fits best while other effects are
    missing.  The selection is kept if a pulse is named again before any other effect, and if the
    largest number of effects was named: the cause is then not in the list, and other effects would
    stand in for it as well.

    Parameters
    ----------
    selection, seed, progress, excluded
        As in :func:`select_effects`.
    """
    pulses = [e for e in selection.effects if e.placed.run is not None]
    is_pulse = [e.placed.run is not None for e in selection.effects]
    followed = any(first and not second for first, second in pairwise(is_pulse))
    if not followed or len(is_pulse) >= MAX_EFFECTS:
        return selection
    progress(0.8, "selecting again without force pulses")
    assessed, kept = remove_effects(selection.assessed, list(selection.effects), pulses, seed)
    posteriors = weighted_posterior(assessed.model, assessed.evidence)
    start = replace(selection, assessed=assessed, effects=tuple(kept), posteriors=posteriors)
    other = select_effects(start, seed, progress, excluded, max_effects=len(kept) + 1)
    if any(e.placed.key == pulse.placed.key for e in other.effects for pulse in pulses):
        return selection
    if len(other.effects) > len(kept):
        other = select_effects(other, seed, progress, excluded)
    if {e.placed.key for e in other.effects} == {e.placed.key for e in selection.effects}:
        return selection
    # evidence is comparable only on the same denoised inputs
    denoised, old = other.assessed.denoised, selection.assessed.model
    behind = model_evidence(denoised, fit_again(denoised, old, old.placed_effects)).log_evidence
    return other if other.assessed.evidence.log_evidence > behind else selection
