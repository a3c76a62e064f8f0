"""Model comparison: full fits of the leading candidates, their probabilities, and model averaging.

The scores select candidates.  Each is added to the model with its own wide prior and fitted from
several starting points, with all other parameters free.  Laplace's evidence, with the tolerances of
all other effects integrated out, compares the extended models with each other and with the current
model.  The car's quantities are averaged over all of them, weighted by their probabilities.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_asv.analysis.damping_rates import (
    MAX_DRAWS,
    DampingRates,
    damping_rates,
    with_equal_power,
)
from bayes_asv.analysis.spring_curves import SpringCurve, spring_curves
from bayes_asv.diagnosis.denoised_model import denoised_model
from bayes_asv.diagnosis.score_test import ScoreTest, one_sided_squares, score_test, standardized
from bayes_asv.diagnosis.thresholds import PRIOR_NONE, SPLIT_EVIDENCE
from bayes_asv.diagnosis.tolerance_prior import (
    ModelEvidence,
    evidence_as_tolerance,
    marginal_scores,
    tolerance_evidence,
)
from bayes_asv.diagnosis.unlisted_fault_models import UnnamedCause
from bayes_asv.models.effects import BOTH, PlacedEffect
from bayes_asv.posterior.effect_fit import Candidate, fit_with_effect
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, fit_model
from bayes_asv.posterior.model_error import draw_cars

__all__ = [
    "CandidateGroup",
    "ExtendedModel",
    "WeightedPosterior",
    "draw_dampers",
    "draw_effects",
    "draw_quantities",
    "draw_springs",
    "evidence_without",
    "fit_candidates",
    "leading_candidates",
    "model_probabilities",
    "split_places",
    "weighted_posterior",
]

Array = NDArray[np.float64]

_EFFECTS_PER_RANKING = 4  # placed effects that each ranking contributes
_MIN_SQUARE = 1.0  # squared score below which a candidate is not fitted
# Squared score below which a further candidate is not fitted.  A further effect has to gain more
# than three nats; a fit that gains that much where two were predicted has left the mode of the
# effects that are named already.
_MIN_SQUARE_FURTHER = 4.0
_MAX_STARTS = 4  # candidates of one placed effect that serve as starting points
_MAX_DEFICIT = 60.0  # nats behind the best model at which a fit is stopped early
# Nats behind the best model within which the evidence is computed with the mode found again.
_REFINED_DEFICIT = 5.0
_PULSE_SQUARE = 15.0  # typical largest squared score over all force pulses if there is no pulse
_DRAWS = 4000  # draws of a model average
_MIN_WEIGHT = 0.005  # probability below which a model is left out of the average


@dataclass(frozen=True)
class ExtendedModel:
    """A model with one more effect.

    Parameters
    ----------
    placed : PlacedEffect
        The effect that is added.
    model : FittedModel
        The model with it, at its mode.
    evidence : ModelEvidence
        Its evidence and posterior under the tolerance prior of all other effects.
    """

    placed: PlacedEffect
    model: FittedModel
    evidence: ModelEvidence


@dataclass(frozen=True)
class CandidateGroup:
    """Starting points for the fit of one effect at its place.

    Parameters
    ----------
    candidates : list of Candidate
        Sets of starting values.
    expected_gain : float
        Gain that the best of their scores predicts, nats.
    """

    candidates: list[Candidate]
    expected_gain: float


def leading_candidates(
    test: ScoreTest, excluded: Collection[str] = (), *, further: bool = False
) -> list[CandidateGroup]:
    """Return the candidates that are worth a fit, by effect and place, highest scores first.

    There are two rankings by squared score: in one, all other effects are absent; in the other,
    they may be present within their tolerances.

    Parameters
    ----------
    test : ScoreTest
        Scores of all candidates.
    excluded : collection of str
        Placed effects that are left out, by name.
    further : bool
        Whether an effect or another cause has been found already; a further candidate needs a
        higher score.
    """
    least = _MIN_SQUARE_FURTHER if further else _MIN_SQUARE
    scores = test.standardized_scores
    marginal = standardized(*marginal_scores(test))
    groups: dict[tuple[str, int | None], CandidateGroup] = {}
    gain = 0.5 * one_sided_squares(scores, test)
    pulses = np.array([c.placed.effect.in_one_run for c in test.candidates])
    for ranked in (scores, marginal):
        squares = one_sided_squares(ranked, test) - _PULSE_SQUARE * pulses
        taken: list[tuple[str, int | None]] = []
        for k in np.argsort(-squares):
            candidate = test.candidates[k]
            key = candidate.placed.key
            if squares[k] < least or (key not in taken and len(taken) == _EFFECTS_PER_RANKING):
                continue
            if str(candidate.placed) in excluded:
                continue
            if key not in taken:
                taken.append(key)
            group = groups.get(key, CandidateGroup([], 0.0))
            starts = group.candidates
            if len(starts) < _MAX_STARTS and candidate not in starts:
                starts = [*starts, candidate, *_at_first_order_size(candidate, test, k)]
            groups[key] = CandidateGroup(starts, max(group.expected_gain, float(gain[k])))
    return list(groups.values())


def _at_first_order_size(candidate: Candidate, test: ScoreTest, k: int) -> list[Candidate]:
    """Return a candidate at its most probable size to first order, if its size is a factor."""
    first = candidate.placed.effect.parameters[0]
    information = float(test.information[k, k])
    size_is_factor = first.form != "log" or first.prior_unit
    if not size_is_factor or information < 1.0:
        return []
    size = float(candidate.values[first.name]) * float(test.gradient[k]) / information
    if first.form in ("positive", "log") and size <= 0.0:
        return []
    return [replace(candidate, values={**candidate.values, first.name: size}, is_start=True)]


def fit_candidates(
    dataset: Dataset,
    model: FittedModel,
    test: ScoreTest,
    on_effect: Callable[[str], None] = lambda placed: None,
    excluded: Collection[str] = (),
    *,
    further: bool = False,
) -> list[ExtendedModel]:
    """Fit every leading candidate in full; return the most probable first.

    Parameters
    ----------
    dataset : Dataset
        Recordings with denoised inputs.
    model : FittedModel
        The current model.
    test : ScoreTest
        Scores of all candidates at its mode.
    on_effect : callable
        Called with each effect before it is fitted.
    excluded : collection of str
        Placed effects that are not fitted, by name.
    further : bool
        As in :func:`leading_candidates`.
    """
    extended, tests = [], []
    floor = -math.inf
    for group in leading_candidates(test, excluded, further=further):
        placed = group.candidates[0].placed
        on_effect(str(placed))
        larger = fit_with_effect(dataset, model, group.candidates, group.expected_gain, floor)
        floor = max(floor, larger.mode.log_posterior - _MAX_DEFICIT)
        others = score_test(denoised_model(dataset, larger), _other_tolerances(placed, test))
        evidence = tolerance_evidence(larger, others, rough=True)
        if math.isfinite(evidence.log_evidence):  # leave out fits that diverged
            extended.append(ExtendedModel(placed, larger, evidence))
            tests.append(others)
    return _refine_evidence(extended, tests)


def _refine_evidence(models: list[ExtendedModel], tests: list[ScoreTest]) -> list[ExtendedModel]:
    """Refine the evidence of the best models; return all, the best first."""
    models, rough = list(models), set(range(len(models)))
    while rough:
        best = max(one.evidence.log_evidence for one in models)
        k = max(rough, key=lambda k: models[k].evidence.log_evidence)
        if models[k].evidence.log_evidence < best - _REFINED_DEFICIT:
            break
        rough.remove(k)
        refined = tolerance_evidence(models[k].model, tests[k])
        if math.isfinite(refined.log_evidence):
            models[k] = replace(models[k], evidence=refined)
    return sorted(models, key=lambda one: -one.evidence.log_evidence)


def evidence_without(
    model: FittedModel, evidence: ModelEvidence, extended: list[ExtendedModel], test: ScoreTest
) -> tuple[float, FittedModel, ModelEvidence]:
    """Log evidence of the model without any further effect, and the fit on which it is based.

    It is approximated from the model itself and from each extended model.  Every approximation
    leaves something out, mainly the tolerances beyond first order, so the largest one is the best.

    Parameters
    ----------
    model : FittedModel
        The current model.
    evidence : ModelEvidence
        Its evidence, with tolerances to first order.
    extended : list of ExtendedModel
        From :func:`fit_candidates`.
    test : ScoreTest
        Scores of all candidates at the mode of the current model.
    """
    best = extended[0].evidence.log_evidence
    approximations = [(evidence.log_evidence, model, evidence)]
    for one in extended:
        if one.evidence.log_evidence > best - _REFINED_DEFICIT:  # the others' evidence is rough
            new = [s for s in one.model.placed_effects if s not in model.placed_effects]
            value = evidence_as_tolerance(new, one.model, one.evidence, test.candidates)
            approximations.append((value, one.model, one.evidence))
    return max(approximations, key=lambda approximation: approximation[0])


def split_places(dataset: Dataset, extended: ExtendedModel, test: ScoreTest) -> ExtendedModel:
    """Give each axle, or each side of an axle, its own values if that gains enough evidence."""
    model = extended.model
    car, effect = model.space.car, extended.placed.effect
    elements = extended.placed.elements(car)
    places = (
        car.axles if extended.placed.where == BOTH else [car.elements[e].name for e in elements]
    )
    if len(places) < 2 or not set(places) <= set(effect.places):
        return extended
    split = tuple(replace(extended.placed, where=place) for place in places)
    placed_effects = (*(s for s in model.placed_effects if s != extended.placed), *split)
    posterior = dataset.posterior(placed_effects)
    start = model.transfer(posterior.space)
    for placed in split:
        for p in placed.effect.parameters:
            z = model.mode.z[model.space.names.index(extended.placed.coordinate_name(p))]
            start[posterior.space.names.index(placed.coordinate_name(p))] = z
    fit = fit_model(posterior, start)
    others = score_test(denoised_model(dataset, fit), _other_tolerances(extended.placed, test))
    evidence = tolerance_evidence(fit, others)
    if evidence.log_evidence < extended.evidence.log_evidence + SPLIT_EVIDENCE:
        return extended
    return ExtendedModel(extended.placed, fit, evidence)


def _other_tolerances(placed: PlacedEffect, test: ScoreTest) -> list[Candidate]:
    """List the tolerances of all effects but one."""
    return [c for c in test.candidates if c.tolerance and not placed.overlaps(c.placed)]


def model_probabilities(
    without: float, extended: list[ExtendedModel], effect_count: int
) -> tuple[float, Array]:
    """Posterior probability that nothing is missing, and of each extended model (K,).

    Parameters
    ----------
    without : float
        Log evidence of the current model.
    extended : list of ExtendedModel
        From :func:`fit_candidates`; effects that were not fitted get zero probability.
    effect_count : int
        Number of candidate effects, counted once for each place; they share the prior probability
        of a missing effect.
    """
    joint = np.array([np.log(PRIOR_NONE) + without])
    prior = np.log((1.0 - PRIOR_NONE) / effect_count)
    joint = np.concatenate([joint, [prior + one.evidence.log_evidence for one in extended]])
    probabilities = np.exp(joint - logsumexp(joint))
    return float(probabilities[0]), probabilities[1:]


class WeightedPosterior(NamedTuple):
    """One model of a model average: a Gaussian posterior with its weight.

    Parameters
    ----------
    weight : float
        Probability of the model.
    model : FittedModel
        The model, which defines the coordinates.
    mean, covariance : (D,) and (D, D) arrays
        Mean and covariance of its posterior.
    """

    weight: float
    model: FittedModel
    mean: Array
    covariance: Array


def weighted_posterior(
    model: FittedModel, evidence: ModelEvidence, weight: float = 1.0
) -> list[WeightedPosterior]:
    """Return the posterior of one model; an empty list if its weight is negligible."""
    if weight < _MIN_WEIGHT:
        return []
    mean = model.mode.z + evidence.mode_shift
    return [WeightedPosterior(weight, model, mean, evidence.covariance)]


def draw_quantities(posteriors: list[WeightedPosterior], seed: int) -> dict[str, Array]:
    """Draw the car's quantities from a model average, 4000 draws each, SI units."""
    rng = np.random.default_rng([seed, 51])
    weights = np.array([one.weight for one in posteriors])
    counts = rng.multinomial(_DRAWS, weights / weights.sum())
    parts = [
        model.space.quantities(draw_cars(model.space, mean, covariance, n, rng), seed)
        for n, (_, model, mean, covariance) in zip(counts, posteriors, strict=True)
        if n > 1
    ]
    names = set.intersection(*(set(p) for p in parts))
    return {n: np.concatenate([p[n] for p in parts]) for n in sorted(names)}


def draw_dampers(
    model: FittedModel, evidence: ModelEvidence, seed: int, unnamed: Sequence[UnnamedCause] = ()
) -> tuple[tuple[DampingRates, ...], dict[str, Array]]:
    """Draw the rates of dampers whose force is not proportional to speed.

    The power of an unlisted force at the element is part of that of its damper.  A curve that may
    have any shape and such a force explain the same motion in part; the recordings determine the
    power of both together, and not how it is divided.

    Parameters
    ----------
    model, evidence : FittedModel, ModelEvidence
        Model with all named effects, and its posterior under the tolerance prior.
    seed : int
        Seed of the draws.
    unnamed : sequence of UnnamedCause
        Unlisted faults in the model, whose sizes are taken as known.

    Returns
    -------
    tuple of DampingRates
        Rates under the tolerance prior, over the speeds driven at the model's mode.
    dict of str to (N,) array
        Rates and damping ratios of dampers with a free curve, which replace those of the model.
    """
    rng = np.random.default_rng([seed, 53])
    mean = model.mode.z + evidence.mode_shift
    z = draw_cars(model.space, mean, evidence.covariance, MAX_DRAWS, rng)
    draws = model.space.quantities(z, seed)
    dampers = tuple(
        _with_unlisted_forces(damper, unnamed)
        for damper in damping_rates(model.posterior, model.mode.z, z, draws)
    )
    rates = with_equal_power(draws, dampers)
    return dampers, {name: x for name, x in rates.items() if x is not draws[name]}


def _with_unlisted_forces(damper: DampingRates, unnamed: Sequence[UnnamedCause]) -> DampingRates:
    """Add the power of the unlisted forces at a damper's element to its rate of equal power."""
    added = sum(cause.equal_power for cause in unnamed if cause.element == damper.element)
    total = damper.equal_power + added
    over_rate = damper.over_rate * total / damper.equal_power
    return replace(damper, equal_power=total, over_rate=over_rate)


def draw_springs(model: FittedModel, evidence: ModelEvidence, seed: int) -> tuple[SpringCurve, ...]:
    """Draw the free curves of springs under the tolerance prior.

    Each covers the deflections driven at the model's mode.
    """
    if not any(
        placed.effect.on_spring and placed.effect.free_form for placed in model.placed_effects
    ):
        return ()
    rng = np.random.default_rng([seed, 59])
    mean = model.mode.z + evidence.mode_shift
    z = draw_cars(model.space, mean, evidence.covariance, MAX_DRAWS, rng)
    return spring_curves(model.posterior, model.mode.z, z, model.space.quantities(z, seed))


def draw_effects(
    model: FittedModel, evidence: ModelEvidence, seed: int
) -> dict[str, dict[str, Array]]:
    """Draw the parameters of a model's effects under the tolerance prior, by effect and place."""
    rng = np.random.default_rng([seed, 52])
    mean = model.mode.z + evidence.mode_shift
    z = draw_cars(model.space, mean, evidence.covariance, _DRAWS, rng)
    return {str(placed): values for placed, values in model.space.effect_draws(z).items()}
