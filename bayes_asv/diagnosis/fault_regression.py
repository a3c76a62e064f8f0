"""Regression on unlisted faults: changes that no listed effect explains are added to the model.

The change that an unlisted fault makes to the predictions is written as a sum of the terms of
:mod:`.unlisted_fault_models`.  Their sizes β are coefficients of a regression.  With sensitivities
S, and with the model's own coordinates and the tolerances of all other effects projected out,

    ν = ν₀ − βᵀS,    β_k ~ N(0, τ²) with one τ for all terms of a kind of fault at one place.

The τ maximise the evidence (MacKay 1992, Neural Computation 4, 415).  Kinds are added one after
another, while each increases the evidence decisively and by more than the cost of its choice.
Constants that are not sizes, such as the frequency of a resonance, then maximise the evidence too.

A fault depends on the motion of the car that has it: after each step the model is fitted again, and
the changes are recomputed along its motion.  With the same sizes, they also change the simulation
of held-out recordings, along the motion there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from bayes_asv.diagnosis.denoised_model import DenoisedModel, denoised_model
from bayes_asv.diagnosis.model_assessment import AssessedModel, model_evidence
from bayes_asv.diagnosis.score_test import NuisanceProjection
from bayes_asv.diagnosis.simulation_error import transfer_frozen
from bayes_asv.diagnosis.thresholds import (
    DECISIVE_EVIDENCE,
    MIN_INFORMATION_SHARE,
    UNKNOWN_SIZE_COST,
)
from bayes_asv.diagnosis.tolerance_prior import ModelEvidence, projection_with_tolerances
from bayes_asv.diagnosis.unlisted_fault_models import (
    FaultTerm,
    PredictedMotion,
    UnnamedCause,
    fault_terms,
    predicted_motions,
    rms_travel,
)
from bayes_asv.diagnosis.unlisted_faults import unlisted_fault_sensitivities
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, fit_again
from bayes_asv.posterior.likelihood import Perturbation

__all__ = ["FaultRegression", "regress_on_unlisted_faults"]

Array = NDArray[np.float64]
Kind = tuple[str, str]
"""Name and place of an unlisted fault."""

_MAX_KINDS = 3  # largest number of kinds that are added
_ROUNDS = 2  # iterations between the changes and the motion
# Search for a fault's constants: largest number of evaluations, and tolerances of the logarithms of
# the constants and of the evidence (nats).
_TRIALS, _TOLERANCE, _GAIN = 40, 0.01, 0.1
_STARTS = 2  # starting points of that search
# Logarithm by which the constants may go beyond those of the forms: their widest spacing.  Farther
# out a fault is one of the car's own forces, as an inertia with a long time constant is a damper.
_BEYOND = math.log(4.0)
# Step of a scan over a frequency, in its logarithm: the width of a resonance with 3 % damping.
_SCAN_STEP = 0.06
# Prior standard deviations that are tried, in unit sizes: a hundredth of the damper's force or of a
# channel's reading.
_DEVIATIONS = np.exp(0.5 * np.arange(-2.0, 14.0))


@dataclass(frozen=True)
class FaultRegression:
    """A model with unlisted faults.

    Parameters
    ----------
    assessed : AssessedModel
        The model on recordings with the faults as perturbations; the covariance of its evidence
        contains that of the sizes.
    holdout : Dataset or None
        Held-out recordings with the faults as perturbations.
    causes : tuple of UnnamedCause
        Kinds of fault, the largest first.
    log_evidence : float
        Log evidence (nats) of the model with them, less the cost of their choice.
    """

    assessed: AssessedModel
    holdout: Dataset | None
    causes: tuple[UnnamedCause, ...]
    log_evidence: float


class _Regression(NamedTuple):
    """Terms with their sizes, along the motion of a model that contains them.

    Parameters
    ----------
    terms : tuple of FaultTerm
        K terms.
    deviations : dict
        Prior standard deviation of each kind, in unit sizes.
    sizes : (K,) array
        Factors on the changes of the terms.
    covariance : (K, K) array
        Covariance of the sizes.
    log_occam_factor : float
        Contribution of the priors and uncertainties of the sizes to the log evidence of the model
        with the faults at these sizes (nats).
    """

    terms: tuple[FaultTerm, ...] = ()
    deviations: Mapping[Kind, float] = {}
    sizes: Array = np.zeros(0)
    covariance: Array = np.zeros((0, 0))
    log_occam_factor: float = 0.0


class _Linearised:
    """A model linearised in the sizes of unlisted faults.

    Parameters
    ----------
    dataset, model : Dataset, FittedModel
        Denoised recordings with the current faults as perturbations, and the model at its mode.
    evidence : ModelEvidence
        Gives the tolerances of all other effects.
    current : _Regression
        The current faults.
    """

    def __init__(
        self, dataset: Dataset, model: FittedModel, evidence: ModelEvidence, current: _Regression
    ) -> None:
        self.denoised: DenoisedModel = denoised_model(dataset, model)
        posterior = self.denoised.filters[0].posterior
        self.motions: tuple[PredictedMotion, ...] = predicted_motions(
            self.denoised.dataset, posterior, model.mode.z
        )
        at_mode = replace(evidence, model=model, offsets=0.0 * evidence.offsets)
        self.projection: NuisanceProjection = projection_with_tolerances(
            self.denoised.derivatives, at_mode
        )
        if current.terms:
            self._restore_innovations(current)

    def _restore_innovations(self, current: _Regression) -> None:
        """Restore the innovations as they were before subtracting the fitted faults."""
        denoised = self.denoised
        changes = _perturbations(denoised.dataset, self.motions, current)
        change = denoised.concatenate(
            {run: denoised.filters[run].response(one) for run, one in enumerate(changes)}
        )
        self.projection = replace(
            self.projection,
            innovations=self.projection.innovations + change,
            gradient=self.projection.gradient + self.projection.sensitivities @ change,
        )

    def along(self, terms: Sequence[FaultTerm]) -> _Scores:
        """Compute gradient and information along some terms."""
        sensitivities, factors = unlisted_fault_sensitivities(self.denoised, terms, self.motions)
        gradient, information = self.projection.project_out(sensitivities)
        return _Scores(tuple(terms), sensitivities, factors, gradient, information)


class _Scores(NamedTuple):
    """Gradient (K,) and information (K, K) along K terms of unit size.

    Parameters
    ----------
    terms : tuple of FaultTerm
        The terms.
    sensitivities : (K, N) array
        Changes of the predictions, in standard deviations.
    factors : (K,) array
        Unit sizes.
    gradient, information : (K,) and (K, K) arrays
        Gradient and information, with nuisance directions projected out.
    """

    terms: tuple[FaultTerm, ...]
    sensitivities: Array
    factors: Array
    gradient: Array
    information: Array

    def members(self, kinds: Mapping[Kind, float]) -> tuple[list[int], Array]:
        """Return the informative terms of some kinds, and their prior standard deviations."""
        enough = np.diag(self.information) > MIN_INFORMATION_SHARE * np.sum(
            self.sensitivities**2, axis=1
        )
        terms_of_kinds = [
            k for k, term in enumerate(self.terms) if enough[k] and term.fault in kinds
        ]
        usual = [self.terms[k].kind.usual / float(self.factors[k]) for k in terms_of_kinds]
        deviations_of_kinds = [kinds[self.terms[k].fault] for k in terms_of_kinds]
        return terms_of_kinds, np.minimum(deviations_of_kinds, usual)

    def log_bayes_factor(self, kinds: Mapping[Kind, float]) -> float:
        """Log Bayes factor (nats) of kinds of fault, for given prior standard deviations."""
        terms_of_kinds, deviations = self.members(kinds)
        scaled = (
            deviations[:, None]
            * self.information[np.ix_(terms_of_kinds, terms_of_kinds)]
            * deviations
        )
        root = np.linalg.cholesky(np.eye(len(terms_of_kinds)) + scaled)
        explained = np.linalg.solve(root, deviations * self.gradient[terms_of_kinds])
        return float(0.5 * explained @ explained - np.log(np.diag(root)).sum())

    def most_evidence(self, kinds: Mapping[Kind, float]) -> dict[Kind, float]:
        """Maximise the evidence over the prior standard deviations, starting from given ones."""
        low, high = np.log(_DEVIATIONS[[0, -1]])

        def at(logs: Array) -> dict[Kind, float]:
            return dict(zip(kinds, np.exp(np.clip(logs, low, high)).tolist(), strict=True))

        def loss(logs: Array) -> float:
            return -self.log_bayes_factor(at(logs))

        return at(minimize(loss, np.log(list(kinds.values())), method="Nelder-Mead").x)

    def largest(self, kinds: Mapping[Kind, float], kind: Kind) -> float:
        """Log Bayes factor (nats) of kinds, maximised over the prior deviation of one of them."""
        return max(self.log_bayes_factor({**kinds, kind: d}) for d in _DEVIATIONS.tolist())

    def further(self, kinds: Mapping[Kind, float]) -> dict[Kind, float]:
        """Add the kind of the largest gain; return an empty dict if no gain exceeds its cost."""
        others = {term.fault for term in self.terms} - set(kinds)
        if not others:
            return {}
        trials = [
            (self.log_bayes_factor({**kinds, other: deviation}), other, deviation)
            for other in sorted(others)
            for deviation in _DEVIATIONS.tolist()
        ]
        gain, best, deviation = max(trials)
        cost = UNKNOWN_SIZE_COST + DECISIVE_EVIDENCE + math.log(len(others))
        return {**kinds, best: deviation} if gain > self.log_bayes_factor(kinds) + cost else {}

    def regression(self, kinds: Mapping[Kind, float]) -> _Regression:
        """Estimate the sizes of some kinds of fault."""
        terms_of_kinds, deviations = self.members(kinds)
        precision = self.information[np.ix_(terms_of_kinds, terms_of_kinds)] + np.diag(
            deviations**-2
        )
        covariance = np.linalg.inv(precision)
        factors, sizes = self.factors[terms_of_kinds], covariance @ self.gradient[terms_of_kinds]
        spread = np.linalg.slogdet(covariance)[1] - 2.0 * np.log(deviations).sum()
        return _Regression(
            tuple(self.terms[k] for k in terms_of_kinds),
            dict(kinds),
            factors * sizes,
            factors[:, None] * covariance * factors,
            0.5 * float(spread - np.sum((sizes / deviations) ** 2)),
        )


def regress_on_unlisted_faults(
    assessed: AssessedModel, holdout: Dataset | None
) -> FaultRegression | None:
    """Explain the residuals of a model by unlisted faults; None if none is decisive.

    Parameters
    ----------
    assessed : AssessedModel
        Model with all named effects.
    holdout : Dataset or None
        Held-out recordings.
    """
    dataset, model, evidence = assessed.denoised, assessed.model, assessed.evidence
    current = _Regression()
    at = _Linearised(dataset, model, evidence, current)
    all_terms = [
        term
        for term in fault_terms(at.denoised.dataset, rms_travel(at.motions))
        if not any(term.kind.within(placed, model.space.car) for placed in model.placed_effects)
    ]
    while len(current.deviations) < _MAX_KINDS:
        refined = [term for term in current.terms if term not in all_terms]
        kinds = at.along([*all_terms, *refined]).further(current.deviations)
        if not kinds:
            break
        new_terms = [
            term
            for term in all_terms
            if term.fault in kinds and term.fault not in current.deviations
        ]
        terms = [*current.terms, *new_terms]
        for _ in range(_ROUNDS):
            scores = _optimise_constants(at, terms, kinds)
            kinds = scores.most_evidence(kinds)
            current = scores.regression(kinds)
            terms = list(current.terms)
            changes = _perturbations(dataset, at.motions, current)
            dataset = replace(dataset, perturbations=changes)
            model = fit_again(dataset, model, model.placed_effects)
            if model.diverged:
                return None
            at = _Linearised(dataset, model, evidence, current)
    if not current.terms:
        return None
    scores = at.along(current.terms)
    cross = at.projection.sensitivities @ (scores.sensitivities / scores.factors[:, None]).T
    slope = np.linalg.solve(at.projection.precision, cross)[: len(model.mode.z)]
    evidence = model_evidence(dataset, model)
    spread = evidence.covariance + slope @ current.covariance @ slope.T
    changed = replace(
        assessed,
        dataset=replace(assessed.dataset, perturbations=dataset.perturbations),
        denoised=dataset,
        model=model,
        evidence=replace(evidence, covariance=spread),
    )
    perturbed_holdout = None if holdout is None else _perturb_holdout(holdout, model, current)
    choice = UNKNOWN_SIZE_COST + math.log(len({term.fault for term in all_terms}))
    log_evidence = (
        evidence.log_evidence + current.log_occam_factor - len(current.deviations) * choice
    )
    return FaultRegression(changed, perturbed_holdout, _causes(at, current, scores), log_evidence)


def _optimise_constants(
    at: _Linearised, terms: Sequence[FaultTerm], kinds: Mapping[Kind, float]
) -> _Scores:
    """Replace the terms of each kind with continuous constants by a single one, optimised.

    The constants maximise the evidence.  A kind keeps its terms if together they explain decisively
    more.
    """
    scores = at.along(terms)
    for kind in kinds:
        forms = [term for term in scores.terms if term.fault == kind and term.kind.continuous]
        if not forms:
            continue
        others = [term for term in scores.terms if term.fault != kind]
        one = _SingleForm(at, forms[0], at.along(others) if others else None, kinds)
        starts = sorted(_scan(forms), key=one.loss)[:_STARTS]
        logs = np.log(forms[0].kind.forms)
        bounds = list(zip(logs.min(axis=0) - _BEYOND, logs.max(axis=0) + _BEYOND, strict=True))
        fits = [
            minimize(
                one.loss, start, method="Nelder-Mead", bounds=bounds,
                options={
                    "maxfev": _TRIALS, "xatol": _TOLERANCE, "fatol": _GAIN,
                    "initial_simplex": _simplex(start),
                },
            )
            for start in starts
        ]  # fmt: skip
        best = min(fits, key=lambda fit: float(fit.fun))
        if -float(best.fun) > scores.largest(kinds, kind) - DECISIVE_EVIDENCE:
            scores = one.scores(best.x)
    return scores


@dataclass(frozen=True)
class _SingleForm:
    """A kind of fault with a single term, beside the terms of all other kinds.

    Parameters
    ----------
    at : _Linearised
        The model.
    like : FaultTerm
        A term of that kind.
    others : _Scores or None
        Scores of the terms of the other kinds.
    kinds : dict
        All kinds, with prior standard deviations.
    """

    at: _Linearised
    like: FaultTerm
    others: _Scores | None
    kinds: Mapping[Kind, float]

    def scores(self, logs: Array) -> _Scores:
        """Return the scores of all kinds, given the logarithms of the constants."""
        form = tuple(np.exp(logs).tolist())
        return _join_scores(self.at, self.others, self.at.along([self.like._replace(form=form)]))

    def loss(self, logs: Array) -> float:
        """Minus the log Bayes factor (nats), maximised over the prior standard deviation."""
        return -self.scores(logs).largest(self.kinds, self.like.fault)


def _scan(forms: Sequence[FaultTerm]) -> list[Array]:
    """Logarithms of constants over the range of some forms, with small steps in the first one."""
    logs = np.log([term.form for term in forms])
    first = logs[:, 0]
    count = 1 + math.ceil((first.max() - first.min()) / _SCAN_STEP)
    return [
        np.concatenate([[value], logs[0, 1:]])
        for value in np.linspace(first.min(), first.max(), count)
    ]


def _simplex(begin: Array) -> Array:
    """Return an initial simplex (d + 1, d) with edges of 0.1 in the logarithms."""
    return np.concatenate([begin[None], begin + 0.1 * np.eye(len(begin))])


def _join_scores(at: _Linearised, one: _Scores | None, other: _Scores) -> _Scores:
    """Join the scores of two sets of terms."""
    if one is None:
        return other
    sensitivities = np.concatenate([one.sensitivities, other.sensitivities])
    return _Scores(
        one.terms + other.terms,
        sensitivities,
        np.concatenate([one.factors, other.factors]),
        *at.projection.project_out(sensitivities),
    )


def _perturbations(
    dataset: Dataset, motions: Sequence[PredictedMotion], current: _Regression
) -> tuple[Perturbation, ...]:
    """Return the perturbation of each run by the faults."""
    of_terms = [term.faults(dataset, motions) for term in current.terms]
    out = []
    for run in range(len(dataset.recordings)):
        parts = zip(*(faults[run].perturbation for faults in of_terms), strict=True)
        out.append(
            Perturbation(*(np.tensordot(current.sizes, np.array(part), 1) for part in parts))
        )
    return tuple(out)


def _perturb_holdout(dataset: Dataset, model: FittedModel, current: _Regression) -> Dataset:
    """Return other recordings with the faults as perturbations, along their own motion."""
    for _ in range(_ROUNDS):
        posterior, z = transfer_frozen(dataset, model, same_runs=False)
        motions = predicted_motions(dataset, posterior, z)
        dataset = replace(dataset, perturbations=_perturbations(dataset, motions, current))
    return dataset


def _causes(at: _Linearised, current: _Regression, scores: _Scores) -> tuple[UnnamedCause, ...]:
    """Divide the change of the predictions among the kinds of fault."""
    sizes, dataset = current.sizes / scores.factors, at.denoised.dataset
    causes = []
    for kind in current.deviations:
        terms_of_kind = [k for k, term in enumerate(current.terms) if term.fault == kind]
        part = abs(float(sizes[terms_of_kind] @ scores.information[terms_of_kind] @ sizes))
        terms = [
            (current.sizes[k], current.terms[k].faults(dataset, at.motions)) for k in terms_of_kind
        ]
        runs = range(len(dataset.recordings))
        changes = [sum(size * faults[run].change for size, faults in terms) for run in runs]
        along = [terms[0][1][run].along for run in runs]
        of_kind = current.terms[terms_of_kind[0]].kind
        cause = UnnamedCause(
            *kind, part, of_kind.dimensions, tuple(changes), tuple(along), of_kind.element
        )
        if of_kind.opposite is not None and cause.equal_power < 0.0:
            cause = replace(cause, kind=of_kind.opposite)
        causes.append(cause)
    total = sum(cause.share for cause in causes)
    ordered = sorted(causes, key=lambda cause: -cause.share)
    return tuple(replace(cause, share=cause.share / total) for cause in ordered)
