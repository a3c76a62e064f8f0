"""Free laws of dampers and springs, for data that no listed effect explains.

To first order, a free damper law adds a force that is any function of the rate of deflection, and a
free spring law one that is any function of deflection.  If such a law gains at least half of what
the best unlisted fault gains, the axle with the largest gain gets it: a monotonic damping curve,
different in compression and rebound, with a stiffness in series if that is needed; or a monotonic
spring curve.  The other axle follows if the same holds there.  Further effects are selected beside
these laws, and the validation removes those that turn out to be unnecessary.  The resulting model
replaces that with listed effects if its evidence is larger by the amount required of the law, and
its error on held-out recordings is not larger.  The part whose law gains more is tried first, and
the other one only if that fails.
"""

from __future__ import annotations

from dataclasses import replace

from bayes_asv.diagnosis.forward_selection import Selection, select_effects
from bayes_asv.diagnosis.misspecification_test import misspecification_tests
from bayes_asv.diagnosis.model_assessment import AssessedModel, assess, prune
from bayes_asv.diagnosis.model_comparison import weighted_posterior
from bayes_asv.diagnosis.results import NamedEffect
from bayes_asv.diagnosis.simulation_error import compare_errors
from bayes_asv.diagnosis.thresholds import DECISIVE_EVIDENCE, MAX_EFFECTS, SIGNIFICANCE_LEVEL
from bayes_asv.diagnosis.unlisted_faults import FreeLaw, Part, free_laws
from bayes_asv.domain.errors import FitError
from bayes_asv.domain.progress import Progress
from bayes_asv.models.effects import EFFECTS, PlacedEffect
from bayes_asv.posterior.effect_fit import with_effects
from bayes_asv.posterior.fitted_model import Dataset

__all__ = ["with_free_laws"]

# Least gain of a free law, as a share of what the best unlisted explanation gains to first order.
_MIN_SHARE = 0.5
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
    """Return a selection with free laws of a part, if they explain decisively more.

    Parameters
    ----------
    selection : Selection
        The selected listed effects.
    linear : AssessedModel
        The linear car on the same recordings.
    holdout : Dataset or None
        Held-out recordings.
    seed : int
        Seed of the tests.
    progress : callable
        See :data:`bayes_asv.domain.progress.Progress`.
    """
    listed = selection.assessed
    if not (selection.stopped_by or selection.effects or listed.p_value < SIGNIFICANCE_LEVEL):
        return selection
    if not (selection.stopped_by or _is_misspecified(listed, seed)):
        return selection
    for law in free_laws(listed.denoised, listed.evidence):
        if not _explains_enough(law):
            break
        free = _select_with_laws(law.part, selection, linear, seed, progress)
        if free is None:
            continue
        gain = free.assessed.evidence.log_evidence - listed.evidence.log_evidence
        if not _explains_enough(law._replace(gain=gain)):
            continue
        models = listed.model, free.assessed.model
        if holdout is None or not compare_errors(holdout, *models, seed).worse:
            return free
    return selection


def _select_with_laws(
    part: Part, selection: Selection, linear: AssessedModel, seed: int, progress: Progress
) -> Selection | None:
    """Select effects beside free laws of one part; None if no law explains enough."""
    current, law = linear, _best_free_law(part, linear)
    named: list[NamedEffect] = []
    axles = list(linear.model.space.car.axles)
    while law.axle in axles and _explains_enough(law):
        axles.remove(law.axle)
        progress(0.7, f"fitting free laws of the {law.axle} {part}")
        placed_effects = [PlacedEffect(EFFECTS[name], law.axle) for name in _LAWS[part]]
        named += [NamedEffect(placed, 1.0, (), {}) for placed in placed_effects]
        try:
            dataset, model = with_effects(current.dataset, placed_effects, current.model)
            current, named = prune(assess(dataset, model, seed), named, seed)
        except FitError:
            return None
        if not _is_misspecified(current, seed):
            break
        law = _best_free_law(part, current)
    if current is linear:
        return None
    posteriors = weighted_posterior(current.model, current.evidence)
    start = replace(selection, assessed=current, effects=tuple(named), posteriors=posteriors)
    return select_effects(start, seed, progress, max_effects=MAX_EFFECTS + len(named))


def _best_free_law(part: Part, assessed: AssessedModel) -> FreeLaw:
    return free_laws(assessed.denoised, assessed.evidence, (part,))[0]


def _is_misspecified(assessed: AssessedModel, seed: int) -> bool:
    return misspecification_tests(assessed.denoised, assessed.evidence, seed).detected


def _explains_enough(law: FreeLaw) -> bool:
    """Whether a law gains decisively, and half of what the best unlisted explanation gains."""
    return law.gain > max(DECISIVE_EVIDENCE, _MIN_SHARE * law.best_gain)
