"""Free laws of the dampers, where no listed effect explains what is left.

Where to first order a force of any dependence on the rate of deflection gains at least half of
what the best unlisted fault does, the axle at which it gains most gets a damping curve that may
rise in any way, each side its own, and a stiffness in series with it; then the other axle, if the
same holds there.  Further effects are selected beside these laws, and the validation removes those
that turn out unnecessary.  That model takes the place of the listed effects where it has decisively
more evidence.
"""

from __future__ import annotations

from dataclasses import replace

from bayes_asv.diagnosis.denoised_model import denoised_model
from bayes_asv.diagnosis.forward_selection import Progress, Selection, select_effects
from bayes_asv.diagnosis.misspecification_test import misspecification_tests
from bayes_asv.diagnosis.model_assessment import AssessedModel, assess
from bayes_asv.diagnosis.model_comparison import weighted_posterior
from bayes_asv.diagnosis.results import NamedEffect
from bayes_asv.diagnosis.thresholds import DECISIVE_EVIDENCE, MAX_EFFECTS, SIGNIFICANCE_LEVEL
from bayes_asv.diagnosis.tolerance_prior import projection_with_tolerances
from bayes_asv.diagnosis.unlisted_faults import best_unlisted_explanation, free_damper_evidence
from bayes_asv.models.effects import EFFECTS, Site
from bayes_asv.posterior.effect_fit import with_effects

__all__ = ["with_free_laws"]

_SHARE = 0.5  # of what the best unlisted fault gains, to first order
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
    stopped = bool(selection.stopped_by)
    if not (stopped or selection.effects or own.p_value < SIGNIFICANCE_LEVEL):
        return selection
    axles = list(dict.fromkeys(element.axle for element in linear.model.space.car.elements))
    found, enough = _axle_to_free(own, seed, stopped=stopped)
    if not found:
        return selection
    current, (axle, _) = linear, _axle_to_free(linear, seed)
    while axle in axles:
        axles.remove(axle)
        progress(0.7, f"fitting free laws of the {axle} damper")
        sites = [Site(EFFECTS[name], axle) for name in _LAWS]
        dataset, model = with_effects(current.dataset, sites, current.model)
        current = assess(dataset, model, seed)
        axle, _ = _axle_to_free(current, seed)
    if current is linear:
        return selection
    named = [NamedEffect(site, 1.0, (), {}) for site in current.model.sites]
    posteriors = weighted_posterior(current.model, current.evidence)
    start = replace(selection, assessed=current, effects=tuple(named), posteriors=posteriors)
    free = select_effects(start, seed, progress, max_effects=MAX_EFFECTS + len(named))
    gain = free.assessed.evidence.log_evidence - own.evidence.log_evidence
    return free if gain > enough else selection


def _axle_to_free(
    assessed: AssessedModel, seed: int, *, stopped: bool = False
) -> tuple[str, float]:
    """Axle whose damper law explains at least half of what the best unlisted fault does.

    The axle is empty where nothing is left, or where it looks like something else.  Behind it is
    the log evidence (nats) that is half of what that fault gains, or decisive where that is more.

    Parameters
    ----------
    assessed : AssessedModel
        The model so far.
    seed : int
        Seed of the tests.
    stopped : bool
        Something is known to be left.
    """
    if (
        not stopped
        and not misspecification_tests(assessed.denoised, assessed.evidence, seed).detected
    ):
        return "", 0.0
    denoised = denoised_model(assessed.denoised, assessed.evidence.model)
    projection = projection_with_tolerances(denoised.derivatives, assessed.evidence)
    gain, axle = free_damper_evidence(denoised, projection)
    best = best_unlisted_explanation(assessed.denoised, assessed.evidence).log_evidence
    enough = max(DECISIVE_EVIDENCE, _SHARE * (best - assessed.evidence.log_evidence))
    return (axle if gain > enough else ""), enough
