"""Free laws of the dampers, where no listed effect explains what is left.

The axle at which a free force gains most gets a damping curve that may rise in any way, each side
its own, and a stiffness in series with it; then the other axle, where
it gains most there.  Laws
that turn out unnecessary are removed, and further effects are selected beside them.  That model
takes the place of the listed effects where it has decisively more evidence.
"""

from __future__ import annotations

from dataclasses import replace

from bayes_asv.diagnosis.forward_selection import Progress, Selection, select_effects
from bayes_asv.diagnosis.misspecification_test import misspecification_tests
from bayes_asv.diagnosis.model_assessment import AssessedModel, assess, prune
from bayes_asv.diagnosis.model_comparison import weighted_posterior
from bayes_asv.diagnosis.results import NamedEffect
from bayes_asv.diagnosis.thresholds import DECISIVE_EVIDENCE, MAX_EFFECTS
from bayes_asv.models.effects import EFFECTS, Site
from bayes_asv.posterior.effect_fit import with_effects

__all__ = ["with_free_laws"]

_LAWS = ("damper_hysteresis", "damper_curve")


def with_free_laws(
    selection: Selection, linear: AssessedModel, seed: int, progress: Progress
) -> Selection:
    """Return the selection with free laws of the dampers where those explain decisively more.

    Parameters
    ----------
    selection : Selection
        The effects of the list that were selected.
    linear : AssessedModel
        The linear car on the same recordings.
    seed : int
        Seed of the tests.
    progress : callable
        See :data:`bayes_asv.diagnosis.forward_selection.Progress`.
    """
    own = selection.assessed
    left = misspecification_tests(own.denoised, own.evidence, seed)
    if not (left.detected or selection.stopped_by):
        return selection
    current = linear
    left = misspecification_tests(linear.denoised, linear.evidence, seed)
    axles = list(dict.fromkeys(element.axle for element in linear.model.space.car.elements))
    while left.detected and left.axle in axles:
        axles.remove(left.axle)
        progress(0.7, f"fitting free laws of the {left.axle} damper")
        sites = [Site(EFFECTS[name], left.axle) for name in _LAWS]
        dataset, model = with_effects(current.dataset, sites, current.model)
        current = assess(dataset, model, seed)
        left = misspecification_tests(current.denoised, current.evidence, seed)
    named = [NamedEffect(site, 1.0, (), {}) for site in current.model.sites]
    current, named = prune(current, named, seed)
    posteriors = weighted_posterior(current.model, current.evidence)
    start = replace(selection, assessed=current, effects=tuple(named), posteriors=posteriors)
    free = select_effects(start, seed, progress, max_effects=MAX_EFFECTS + len(named))
    gain = free.assessed.evidence.log_evidence - own.evidence.log_evidence
    return free if gain > DECISIVE_EVIDENCE else selection
