"""Explanations that these data cannot tell apart.

Two explanations are indistinguishable when one, fitted to the noise-free prediction of the other,
comes so close that noise would hide the difference, or when the data prefer neither.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.model_assessment import AssessedModel, model_evidence, submodel
from bayes_asv.diagnosis.model_comparison import ExtendedModel
from bayes_asv.diagnosis.results import NamedEffect
from bayes_asv.diagnosis.score_test import nuisance_projection
from bayes_asv.diagnosis.thresholds import DISTINGUISHABLE_DISTANCE
from bayes_asv.posterior.effect_candidates import Candidate
from bayes_asv.posterior.effect_fit import added
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, fitted
from bayes_asv.posterior.free_simulation import free_run

__all__ = [
    "indistinguishable_from_best",
    "similar_candidates",
    "squared_distance",
    "with_indistinguishable",
]

Array = NDArray[np.float64]

_NO_PREFERENCE = 3.0  # nats: the data do not prefer one to the other by 20 : 1
_CLEARLY_WORSE = 25.0  # nats, at which the evidence alone distinguishes an explanation
_MAX_COMPARED = 4  # explanations, after the best
_MAX_REFITTED = 2  # sites, in the place of each named effect


def squared_distance(dataset: Dataset, one: FittedModel, other: FittedModel) -> float:
    """Squared whitened distance of ``other`` after a fit to the noise-free prediction of ``one``.

    Noise levels are held at the given ones, so that they cannot cover the difference.
    """
    recordings = tuple(
        replace(recording, reading=free_run(one.target, one.mode.z, run).output)
        for run, recording in enumerate(dataset.lines)
    )
    predicted = replace(dataset, lines=recordings)
    modes = []
    for model in (one, other):
        posterior = predicted.target(model.sites, hold=True)
        modes.append(fitted(posterior, model.transfer(posterior.space)).mode)
    # the misfit of the first to its own prediction is that of the initial state alone
    return max(2.0 * (modes[0].log_posterior - modes[1].log_posterior), 0.0)


def indistinguishable_from_best(
    dataset: Dataset, extended: list[ExtendedModel]
) -> list[ExtendedModel]:
    """Explanations that the data cannot tell from the first one, that one included."""
    best = extended[0]
    out = [best]
    for other in extended[1 : 1 + _MAX_COMPARED]:
        behind = best.evidence.log_evidence - other.evidence.log_evidence
        if not behind < _CLEARLY_WORSE:
            continue
        if behind < _NO_PREFERENCE or (
            squared_distance(dataset, best.model, other.model) < DISTINGUISHABLE_DISTANCE
        ):
            out.append(other)
    return out


def with_indistinguishable(
    assessed: AssessedModel, effects: tuple[NamedEffect, ...]
) -> tuple[NamedEffect, ...]:
    """Add to each named effect what the data cannot tell from it next to all others.

    When the effect was named, other effects were still missing, which may have distinguished
    explanations that are indistinguishable in the finished model.

    Parameters
    ----------
    assessed : AssessedModel
        With all named effects.
    effects : tuple of NamedEffect
        Named effects; a single one was compared in the finished model already.
    """
    if len(effects) < 2:
        return effects
    return tuple(_with_indistinguishable(assessed, one) for one in effects)


def _with_indistinguishable(assessed: AssessedModel, effect: NamedEffect) -> NamedEffect:
    groups = similar_candidates(assessed, effect)
    if not groups:
        return effect
    rest = submodel(assessed, tuple(s for s in assessed.model.sites if s != effect.site))
    extended = [ExtendedModel(effect.site, assessed.model, assessed.evidence)]
    extended += [_in_its_place(assessed, rest, group) for group in groups[:_MAX_REFITTED]]
    known = {str(other.site) for other in effect.indistinguishable}
    others = indistinguishable_from_best(assessed.denoised, extended)[1:]
    new = [one for one in others if str(one.site) not in known]
    return replace(effect, indistinguishable=(*effect.indistinguishable, *new))


def similar_candidates(assessed: AssessedModel, effect: NamedEffect) -> list[list[Candidate]]:
    """Candidates, by site, that change the predictions as an effect does; the closest first.

    To first order: what remains of the effect's change of the predictions after projection on the
    candidate's is indistinguishable from nothing.

    Parameters
    ----------
    assessed : AssessedModel
        With all named effects.
    effect : NamedEffect
        One of these.
    """
    model, test = assessed.model, assessed.test
    names = [effect.site.coordinate_name(p) for p in effect.site.effect.parameters]
    own = np.array([name in names for name in model.space.names])
    derivatives = test.derivatives
    change = model.mode.z[own] @ derivatives.means[own]
    projection = nuisance_projection(
        derivatives.only(~own), model.mode.z[~own], test.quantization_drifts
    )
    _, information = projection.project_out(np.vstack([change, test.sensitivities]))
    cross, size = information[0, 1:], np.diag(information)[1:]
    rest = information[0, 0] - cross**2 / np.maximum(size, 1e-12)
    groups: dict[tuple[str, int | None], list[Candidate]] = {}
    for k in np.argsort(rest):
        candidate = test.candidates[k]
        if rest[k] < DISTINGUISHABLE_DISTANCE and not effect.site.meets(candidate.site):
            groups.setdefault(candidate.site.key, []).append(candidate)
    return list(groups.values())


def _in_its_place(
    assessed: AssessedModel, rest: FittedModel, group: list[Candidate]
) -> ExtendedModel:
    """Fit another effect in the place of one."""
    model = added(assessed.denoised, rest, group)
    evidence = model_evidence(assessed.denoised, model)
    return ExtendedModel(group[0].site, model, evidence)
