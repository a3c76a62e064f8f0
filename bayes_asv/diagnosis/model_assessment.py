"""A model during the search, with its denoised inputs, score test and evidence."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from bayes_asv.diagnosis.denoised_model import denoised_model, fit_denoised
from bayes_asv.diagnosis.results import NamedEffect
from bayes_asv.diagnosis.score_test import ScoreTest, family_p_value, score_test, with_best_pulses
from bayes_asv.diagnosis.thresholds import NEEDED_EVIDENCE
from bayes_asv.diagnosis.tolerance_prior import (
    ModelEvidence,
    evidence_as_tolerance,
    tolerance_evidence,
)
from bayes_asv.models.effects import BOTH, PlacedEffect
from bayes_asv.models.effects.piecewise_slope import KNOT_ERROR
from bayes_asv.posterior.effect_fit import Candidate, candidates
from bayes_asv.posterior.fitted_model import (
    Dataset,
    FittedModel,
    divergence_error,
    fit_again,
    fit_linear_car,
    update_corrections,
)
from bayes_asv.posterior.free_simulation import free_run

__all__ = [
    "AssessedModel",
    "assess",
    "fit_pooled",
    "model_evidence",
    "prune",
    "refit",
    "refit_shared",
    "remove_effects",
    "submodel",
    "supported_by_holdout",
]


@dataclass(frozen=True)
class AssessedModel:
    """A fitted model, its scores along candidate effects, and its evidence.

    Parameters
    ----------
    dataset : Dataset
        Recordings as read, with sensor corrections from the model's predictions.
    denoised : Dataset
        The same recordings with denoised inputs.
    model : FittedModel
        The model at its mode on the denoised inputs.
    test : ScoreTest
        Scores of all candidate effects.
    evidence : ModelEvidence
        The model under the tolerance prior of all other effects.
    p_value : float
        Family-wise p-value of the test for a missing effect.
    """

    dataset: Dataset
    denoised: Dataset
    model: FittedModel
    test: ScoreTest
    evidence: ModelEvidence
    p_value: float

    @property
    def on_inputs_as_read(self) -> FittedModel:
        """The model with the posterior of recordings as read, at its mode on denoised inputs."""
        return replace(self.model, posterior=self.dataset.posterior(self.model.placed_effects))


def assess(dataset: Dataset, model: FittedModel, seed: int) -> AssessedModel:
    """Fit a model on denoised inputs, and compute the scores of every candidate effect.

    Raises
    ------
    FitError
        If the fit diverges.
    """
    dataset, denoised, model = _fit_denoised_inputs(dataset, model)
    steps = score_test(denoised_model(denoised, model), candidates(model, dataset.vehicle))
    test = with_best_pulses(steps)
    evidence = tolerance_evidence(model, test)
    if not math.isfinite(evidence.log_evidence):
        raise divergence_error(dataset.recordings[0])
    return AssessedModel(dataset, denoised, model, test, evidence, family_p_value(steps, seed))


def _fit_denoised_inputs(
    dataset: Dataset, model: FittedModel
) -> tuple[Dataset, Dataset, FittedModel]:
    """Return recordings as read and with denoised inputs, and the model at its mode on the latter.

    Sensor corrections are computed from the model's predictions, which sensor effects change; two
    rounds are needed then.
    """
    rounds = 2 if any(placed.effect.acts == "reading" for placed in model.placed_effects) else 1
    for _ in range(rounds):
        model = replace(model, posterior=dataset.posterior(model.placed_effects))
        dataset = update_corrections(dataset, model)
    return dataset, *fit_denoised(
        dataset, replace(model, posterior=dataset.posterior(model.placed_effects))
    )


def refit(model: FittedModel, dataset: Dataset) -> FittedModel:
    """Fit a model again to its recordings, after a change or with others appended."""
    return _refit(model, dataset, model.placed_effects)


def refit_shared(model: FittedModel, dataset: Dataset) -> FittedModel:
    """Fit a model to other recordings; effects of a single run are left out."""
    return _refit(model, dataset, tuple(s for s in model.placed_effects if s.run is None))


def _refit(
    model: FittedModel, dataset: Dataset, placed_effects: tuple[PlacedEffect, ...]
) -> FittedModel:
    dataset = update_corrections(dataset, fit_again(dataset, model, placed_effects))
    return fit_again(dataset, model, placed_effects)


def fit_pooled(
    assessed: AssessedModel, holdout: Dataset | None
) -> tuple[Dataset, FittedModel, ModelEvidence]:
    """Fit a model to its own recordings and the held-out ones together.

    Parameters
    ----------
    assessed : AssessedModel
        Model with all named effects.
    holdout : Dataset or None
        Held-out recordings; without any, the model is returned as it is.

    Returns
    -------
    Dataset, FittedModel, ModelEvidence
        All recordings with denoised inputs, the model fitted to them, and its evidence.
    """
    fitted = assessed.dataset
    if holdout is None:
        return assessed.denoised, assessed.model, assessed.evidence
    recordings, corrections = (
        (*fitted.recordings, *holdout.recordings),
        (*fitted.sensor_corrections, *holdout.sensor_corrections),
    )
    pooled = replace(fitted, recordings=recordings, sensor_corrections=corrections)
    _, denoised, model = _fit_denoised_inputs(pooled, refit(assessed.model, pooled))
    return denoised, model, model_evidence(denoised, model)


def submodel(assessed: AssessedModel, placed_effects: tuple[PlacedEffect, ...]) -> FittedModel:
    """Fit the model with some of its effects only, on its denoised inputs."""
    return fit_again(assessed.denoised, assessed.model, placed_effects)


def remove_effects(
    assessed: AssessedModel, effects: list[NamedEffect], removed: list[NamedEffect], seed: int
) -> tuple[AssessedModel, list[NamedEffect]]:
    """Remove effects from a model; return it with the remaining ones."""
    kept = [e for e in effects if e not in removed]
    if not kept:  # from the nominal car: the effects may have moved it to another local mode
        return assess(assessed.dataset, fit_linear_car(assessed.dataset), seed), kept
    return assess(assessed.dataset, submodel(assessed, tuple(e.placed for e in kept)), seed), kept


def prune(
    assessed: AssessedModel, effects: list[NamedEffect], seed: int
) -> tuple[AssessedModel, list[NamedEffect]]:
    """Remove effects that later ones have made unnecessary, and those within the error of knots."""
    k = 0
    while len(effects) > 1 and k < len(effects):
        placed = effects[k].placed
        if _evidence_for(assessed, (placed,)) < NEEDED_EVIDENCE or _is_within_error_of_knots(
            assessed.model, placed
        ):
            assessed, effects = remove_effects(assessed, effects, [effects[k]], seed)
        else:
            k += 1
    return assessed, effects


def supported_by_holdout(
    assessed: AssessedModel, holdout: Dataset, effects: list[NamedEffect]
) -> bool:
    """Whether held-out recordings reduce the evidence for effects by no more than two nats.

    The simulation error on held-out recordings may increase by chance; their predictive evidence
    tells whether an effect is wrong there (Kass & Raftery 1995, J. Am. Stat. Assoc. 90, 773).

    Parameters
    ----------
    assessed : AssessedModel
        Model with all named effects.
    holdout : Dataset
        Held-out recordings.
    effects : list of NamedEffect
        Some of the named effects, tested together.
    """
    pooled, model, evidence = fit_pooled(assessed, holdout)
    fitted_count = len(assessed.dataset.recordings)  # these come first
    fit = replace(
        pooled,
        recordings=pooled.recordings[:fitted_count],
        sensor_corrections=pooled.sensor_corrections[:fitted_count],
    )
    own_model = fit_again(fit, model, model.placed_effects)
    own_evidence = model_evidence(fit, own_model)
    placed_effects = tuple(e.placed for e in effects)
    on_fit = replace(assessed, denoised=fit, model=own_model, evidence=own_evidence)
    on_all = replace(assessed, denoised=pooled, model=model, evidence=evidence)
    lost = _evidence_for(on_fit, placed_effects)
    lost -= _evidence_for(on_all, placed_effects)
    return not lost > NEEDED_EVIDENCE


def _is_within_error_of_knots(model: FittedModel, placed: PlacedEffect) -> bool:
    """Whether an effect is within its tolerance at a place where a law is free.

    Between its knots a free law differs from that of the car.  In precise recordings other effects
    gain evidence by making up for that, as small as they are.  An external force has no tolerance;
    it is compared with the error of the free law's own force.
    """
    effect = placed.effect
    if effect.free_form or not (effect.in_one_run or effect.tolerance_values):
        return False
    laws = [s for s in model.placed_effects if s.effect.free_form and s.corners & placed.corners]
    if not laws:
        return False
    values = model.space.effects(model.mode.z)[placed]
    if effect.in_one_run:
        at_each = 0.5 if placed.where == BOTH else 1.0
        return at_each * abs(values["force"]) < KNOT_ERROR * _largest_force(model, laws)
    tolerance = effect.tolerance_values_for(model.space.sizes)
    return abs(effect.in_tolerances(values, tolerance)) < 1.0


def _largest_force(model: FittedModel, laws: list[PlacedEffect]) -> float:
    """Largest force of some free laws in the simulated runs, N."""
    space, z = model.space, model.mode.z
    elements, values = space.car.elements, space.values(z[None])
    largest = 0.0
    for run, placed in product(range(len(space.recordings)), laws):
        states = free_run(model.posterior, z, run).states
        for e in placed.elements(space.car):
            on_damper = placed.effect.on_damper
            rate = values[elements[e].damping if on_damper else elements[e].spring]
            force = states[:, e - len(elements)] - float(rate[0]) * states[:, 2 * e + on_damper]
            largest = max(largest, float(np.abs(force).max()))
    return largest


def _evidence_for(assessed: AssessedModel, placed_effects: tuple[PlacedEffect, ...]) -> float:
    """Log evidence (nats) that a model loses without some of its effects."""
    rest = submodel(
        assessed, tuple(s for s in assessed.model.placed_effects if s not in placed_effects)
    )
    tolerances = _tolerances(assessed.denoised, rest)
    as_tolerance = evidence_as_tolerance(
        placed_effects, assessed.model, assessed.evidence, tolerances
    )
    without = _model_evidence(assessed.denoised, rest, tolerances).log_evidence
    return assessed.evidence.log_evidence - max(without, as_tolerance)


def model_evidence(
    denoised: Dataset, model: FittedModel, without: tuple[PlacedEffect, ...] = ()
) -> ModelEvidence:
    """Evidence of a model under the tolerance prior of all effects that it does not contain.

    Parameters
    ----------
    denoised, model : Dataset, FittedModel
        Recordings with denoised inputs, and the model at its mode on them.
    without : tuple of PlacedEffect
        Effects whose tolerances are excluded as well.
    """
    tolerances = [
        candidate
        for candidate in _tolerances(denoised, model)
        if not any(placed.overlaps(candidate.placed) for placed in without)
    ]
    return _model_evidence(denoised, model, tolerances)


def _model_evidence(
    denoised: Dataset, model: FittedModel, tolerances: list[Candidate]
) -> ModelEvidence:
    return tolerance_evidence(model, score_test(denoised_model(denoised, model), tolerances))


def _tolerances(denoised: Dataset, model: FittedModel) -> list[Candidate]:
    return [c for c in candidates(model, denoised.vehicle) if c.tolerance]
