"""Model comparison: the leading candidates fitted in full, their probabilities and their average.

The scores select candidates.  Each is added to the model with its own wide prior and fitted from
several starts, everything else free.  Laplace's evidence, the tolerances of all other effects
integrated out, compares them with one another and with the model as it is.  The car's quantities
are averaged over all of these by their probabilities.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
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

_SITES_PER_RANKING = 4
_MIN_SQUARE = 1.0  # squared score below which a candidate is not fitted
# The same for a further effect, which has to gain more than three nats: a fit that gains them where
# two were expected has left the mode of what is named already.
_MIN_SQUARE_FURTHER = 4.0
_MAX_STARTS = 4  # of one effect at its place
_HOPELESS = 60.0  # nats behind the best at which a fit is not finished
_CLOSE = 5.0  # nats behind the best within which the tolerances are integrated out closely
_PULSE_SQUARE = 15.0  # squared score that the best of all force pulses has where there is none
_DRAWS = 4000
_MIN_WEIGHT = 0.005  # weight below which an explanation is left out of the average


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
    """Candidates of one effect at its place that are worth a fit.

    Parameters
    ----------
    candidates : list of Candidate
        Sets of values to start from.
    expected_gain : float
        Nats that the best of them gains to first order.
    """

    candidates: list[Candidate]
    expected_gain: float


def leading_candidates(
    test: ScoreTest, excluded: Collection[str] = (), *, further: bool = False
) -> list[CandidateGroup]:
    """Return the candidates worth a fit, by effect and place, the most promising first.

    One ranking takes the rest of the car to be nominal, the other gives every other effect its
    tolerance.

    Parameters
    ----------
    test : ScoreTest
        Of all candidates.
    excluded : collection of str
        Sites that are left out.
    further : bool
        The model has an effect or another cause already, so that a candidate has to gain more.
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
            if squares[k] < least or (key not in taken and len(taken) == _SITES_PER_RANKING):
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
    """Return a candidate at its most probable size to first order, where size is a factor."""
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
    """Fit every leading candidate in full; the most probable first.

    Parameters
    ----------
    dataset : Dataset
        Recordings with denoised inputs.
    model : FittedModel
        The model so far.
    test : ScoreTest
        Of all candidates there.
    on_effect : callable
        Called with each effect before it is fitted.
    excluded : collection of str
        Sites that are not fitted.
    further : bool
        As :func:`leading_candidates` takes it.
    """
    extended, tests = [], []
    floor = -math.inf
    for group in leading_candidates(test, excluded, further=further):
        placed = group.candidates[0].placed
        on_effect(str(placed))
        larger = fit_with_effect(dataset, model, group.candidates, group.expected_gain, floor)
        floor = max(floor, larger.mode.log_posterior - _HOPELESS)
        others = score_test(denoised_model(dataset, larger), _other_tolerances(placed, test))
        evidence = tolerance_evidence(larger, others, rough=True)
        if math.isfinite(evidence.log_evidence):  # a fit that diverged is no explanation
            extended.append(ExtendedModel(placed, larger, evidence))
            tests.append(others)
    return _with_close_evidence(extended, tests)


def _with_close_evidence(
    models: list[ExtendedModel], tests: list[ScoreTest]
) -> list[ExtendedModel]:
    """Integrate the tolerances closely for the best models; sorted, the best first."""
    models, rough = list(models), set(range(len(models)))
    while rough:
        best = max(one.evidence.log_evidence for one in models)
        k = max(rough, key=lambda k: models[k].evidence.log_evidence)
        if models[k].evidence.log_evidence < best - _CLOSE:
            break
        rough.remove(k)
        close = tolerance_evidence(models[k].model, tests[k])
        if math.isfinite(close.log_evidence):
            models[k] = replace(models[k], evidence=close)
    return sorted(models, key=lambda one: -one.evidence.log_evidence)


def evidence_without(
    model: FittedModel, evidence: ModelEvidence, extended: list[ExtendedModel], test: ScoreTest
) -> tuple[float, FittedModel, ModelEvidence]:
    """Log evidence of the model without any further effect, and the fit that it comes from.

    Each approximation leaves something out, first of all the tolerances beyond first order, so that
    the largest is the best one.

    Parameters
    ----------
    model : FittedModel
        The model so far.
    evidence : ModelEvidence
        The same, tolerances to first order.
    extended : list of ExtendedModel
        From :func:`fit_candidates`.
    test : ScoreTest
        Of all candidates there.
    """
    best = extended[0].evidence.log_evidence
    approximations = [(evidence.log_evidence, model, evidence)]
    for one in extended:
        if one.evidence.log_evidence > best - _CLOSE:  # the others' evidence is rough
            new = [s for s in one.model.placed_effects if s not in model.placed_effects]
            value = evidence_as_tolerance(new, one.model, one.evidence, test.candidates)
            approximations.append((value, one.model, one.evidence))
    return max(approximations, key=lambda approximation: approximation[0])


def split_places(dataset: Dataset, extended: ExtendedModel, test: ScoreTest) -> ExtendedModel:
    """Give each axle, or each side of one, values of its own where that gains enough evidence."""
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
        Log evidence of the model as it is.
    extended : list of ExtendedModel
        From :func:`fit_candidates`; effects that were not fitted are taken to be impossible.
    effect_count : int
        Number of effects, each at each place, that share the prior probability of a missing effect.
    """
    joint = np.array([np.log(PRIOR_NONE) + without])
    prior = np.log((1.0 - PRIOR_NONE) / effect_count)
    joint = np.concatenate([joint, [prior + one.evidence.log_evidence for one in extended]])
    probabilities = np.exp(joint - logsumexp(joint))
    return float(probabilities[0]), probabilities[1:]


class WeightedPosterior(NamedTuple):
    """One explanation in a model average: a Gaussian with its weight.

    Parameters
    ----------
    weight : float
        Probability of the explanation.
    model : FittedModel
        Whose coordinates the Gaussian has.
    mean, covariance : (D,) and (D, D) arrays
        Of the Gaussian.
    """

    weight: float
    model: FittedModel
    mean: Array
    covariance: Array


def weighted_posterior(
    model: FittedModel, evidence: ModelEvidence, weight: float = 1.0
) -> list[WeightedPosterior]:
    """Return the posterior of one explanation; none where its weight is negligible."""
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
    model: FittedModel, evidence: ModelEvidence, seed: int
) -> tuple[tuple[DampingRates, ...], dict[str, Array]]:
    """Draw the rates of dampers whose force is not proportional to speed.

    Returns
    -------
    tuple of DampingRates
        Under the tolerance prior, speeds driven at the model's mode.
    dict of str to (N,) array
        Rates of dampers with a free curve, and their damping ratios, in place of the model's own.
    """
    rng = np.random.default_rng([seed, 53])
    mean = model.mode.z + evidence.mode_shift
    z = draw_cars(model.space, mean, evidence.covariance, MAX_DRAWS, rng)
    draws = model.space.quantities(z, seed)
    dampers = damping_rates(model.posterior, model.mode.z, z, draws)
    rates = with_equal_power(draws, dampers)
    return dampers, {name: x for name, x in rates.items() if x is not draws[name]}


def draw_springs(model: FittedModel, evidence: ModelEvidence, seed: int) -> tuple[SpringCurve, ...]:
    """Draw the curves of springs that have a free one, under the tolerance prior.

    Deflections driven are those at the model's mode.
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
