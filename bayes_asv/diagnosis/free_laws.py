"""Free laws of dampers and springs, where no listed effect explains what is left.

Where to first order a force of any dependence on the rate of deflection, or on deflection, gains at
least half of what the best unlisted fault does, the axle at which it gains most gets a law of that
part: a damping curve that may rise in any way, each side its own, and a stiffness in series with
it; or such a curve of the spring.  The other axle follows if the same holds there.  Further effects
are selected beside these laws, and the validation removes those that turn out unnecessary.  That
model takes the place of the listed effects where its evidence is larger by as much as was asked of
the law, and its error on held-out recordings is not.  The part whose law gains more is tried first,
and the other one only if that fails.
"""

from __future__ import annotations

from dataclasses import replace

from bayes_asv.diagnosis.forward_selection import Progress, Selection, select_effects
from bayes_asv.diagnosis.misspecification_test import misspecification_tests
from bayes_asv.diagnosis.model_assessment import AssessedModel, assess
from bayes_asv.diagnosis.model_comparison import weighted_posterior
from bayes_asv.diagnosis.results import NamedEffect
from bayes_asv.diagnosis.simulation_error import compare_errors
from bayes_asv.diagnosis.thresholds import DECISIVE_EVIDENCE, MAX_EFFECTS, SIGNIFICANCE_LEVEL
from bayes_asv.diagnosis.unlisted_faults import FreeLaw, Part, free_laws
from bayes_asv.models.effects import EFFECTS, PlacedEffect
from bayes_asv.posterior.effect_fit import with_effects
from bayes_asv.posterior.fitted_model import Dataset

__all__ = ["with_free_laws"]

_SHARE = 0.5  # of what the best unlisted explanation gains to first order
_LAWS: dict[Part, tuple[str, ...]] = {
    "damper": ("damper_hysteresis", "damper_curve"),
    "spring": ("spring_curve",),
}


def with_free_laws(
    selection: Selection,
    linear: AssessedModel,
    holdout: Dataset | None,
    seed: int,
    progress: Progress,
) -> Selection:
    """Return the selection with free laws of a part where those explain decisively more.

    Parameters
    ----------
    selection : Selection
        The effects of the list that were selected.
    linear : AssessedModel
        The linear car on the same recordings.
    holdout : Dataset or None
        Held-out recordings.
    seed : int
        Seed of the tests.
    progress : callable
        See :data:`bayes_asv.diagnosis.forward_selection.Progress`.
    """
    own = selection.assessed
    if not (selection.stopped_by or selection.effects or own.p_value < SIGNIFICANCE_LEVEL):
        return selection
    if not (selection.stopped_by or _something_left(own, seed)):
        return selection
    for left in free_laws(own.denoised, own.evidence):
        if not _explains_enough(left):
            break
        free = _with_laws_of(left.part, selection, linear, seed, progress)
        if free is None:
            continue
        gain = free.assessed.evidence.log_evidence - own.evidence.log_evidence
        if not _explains_enough(left._replace(gain=gain)):
            continue
        models = own.model, free.assessed.model
        if holdout is None or not compare_errors(holdout, *models, seed).worse:
            return free
    return selection


def _with_laws_of(
    part: Part, selection: Selection, linear: AssessedModel, seed: int, progress: Progress
) -> Selection | None:
    """Select effects beside free laws of one part; None where none explains enough."""
    current, law = linear, _law(part, linear)
    axles = list(linear.model.space.car.axles)
    while law.axle in axles and _explains_enough(law):
        axles.remove(law.axle)
        progress(0.7, f"fitting free laws of the {law.axle} {part}")
        placed_effects = [PlacedEffect(EFFECTS[name], law.axle) for name in _LAWS[part]]
        dataset, model = with_effects(current.dataset, placed_effects, current.model)
        current = assess(dataset, model, seed)
        if not _something_left(current, seed):
            break
        law = _law(part, current)
    if current is linear:
        return None
    named = [NamedEffect(placed, 1.0, (), {}) for placed in current.model.placed_effects]
    posteriors = weighted_posterior(current.model, current.evidence)
    start = replace(selection, assessed=current, effects=tuple(named), posteriors=posteriors)
    return select_effects(start, seed, progress, max_effects=MAX_EFFECTS + len(named))


def _law(part: Part, assessed: AssessedModel) -> FreeLaw:
    return free_laws(assessed.denoised, assessed.evidence, (part,))[0]


def _something_left(assessed: AssessedModel, seed: int) -> bool:
    return misspecification_tests(assessed.denoised, assessed.evidence, seed).detected


def _explains_enough(law: FreeLaw) -> bool:
    """Whether a law gains decisively, and half of what the best unlisted explanation does."""
    return law.gain > max(DECISIVE_EVIDENCE, _SHARE * law.best_gain)
