"""Regression on unlisted faults: what no listed effect explains joins the model without a name.

A fault that is not in the list changes the predictions along what :mod:`.unlisted_fault_models`
writes down, as the terms of a series add up to a function.  Their sizes β are coefficients of a
regression: with sensitivities S, and the model's own coordinates and the tolerances of all other
effects projected out,

    ν = ν₀ − βᵀS,    β_k ~ N(0, τ²) with one τ for all terms of a kind of fault at one place.

The τ are those of largest evidence (MacKay 1992, Neural Computation 4, 415).  Kinds are added one
after another, while each makes the evidence larger by what its choice costs and decisively more.
A constant that is no size, such as the frequency of a resonance, is then that of largest evidence.

A fault acts along the motion of the car that has it, and not of the one without: after each step
the model is fitted again, and the changes are worked out along its motion.  The same sizes then
change the simulation of held-out recordings along their own motion.
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
from bayes_asv.diagnosis.results import UnnamedCause
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
"""What an unlisted fault is, and where."""

_MAX_KINDS = 3
_ROUNDS = 2  # of working the changes out along the motion
# Of the search for a fault's own constants: trials, and logarithm and evidence (nats) that are left
_TRIALS, _TOLERANCE, _GAIN = 40, 0.01, 0.1
_BEGINS = 2  # forms that it begins at
_SCAN_STEP = 0.06  # of the logarithm of a frequency: the width of a resonance with 3 % damping
# Prior standard deviations, in sizes of a hundredth of the damper's force or of a channel's reading
_DEVIATIONS = np.exp(0.5 * np.arange(-2.0, 14.0))


@dataclass(frozen=True)
class FaultRegression:
    """A model with an unlisted fault, for which it has no name.

    Parameters
    ----------
    assessed : AssessedModel
        The model on the recordings less what the fault changes; the covariance of its evidence
        contains that of the sizes.
    holdout : Dataset or None
        Held-out recordings less what the fault changes there.
    causes : tuple of UnnamedCause
        Kinds of fault, the largest first.
    log_evidence : float
        Log evidence (nats) of the model with them, their choice paid for.
    """

    assessed: AssessedModel
    holdout: Dataset | None
    causes: tuple[UnnamedCause, ...]
    log_evidence: float


class _Regression(NamedTuple):
    """Terms with their sizes, along the motion of a model that has them.

    Parameters
    ----------
    terms : tuple of FaultTerm
        K terms.
    deviations : dict
        Prior standard deviation of each kind, in unit sizes.
    sizes : (K,) array
        Factors of the faults as they are written down.
    covariance : (K, K) array
        Of these.
    log_occam_factor : float
        What the sizes' priors and uncertainties add to the log evidence of the model with the
        faults at these sizes (nats).
    """

    terms: tuple[FaultTerm, ...] = ()
    deviations: Mapping[Kind, float] = {}
    sizes: Array = np.zeros(0)
    covariance: Array = np.zeros((0, 0))
    log_occam_factor: float = 0.0


class _Linearized:
    """A model, expanded along unlisted faults at its motion.

    Parameters
    ----------
    dataset, model : Dataset, FittedModel
        Denoised recordings less what the faults change so far, and the model at its mode there.
    evidence : ModelEvidence
        Gives the tolerances of all other effects.
    now : _Regression
        The faults so far.
    """

    def __init__(
        self, dataset: Dataset, model: FittedModel, evidence: ModelEvidence, now: _Regression
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
        if now.terms:
            self._put_back(now)

    def _put_back(self, now: _Regression) -> None:
        """Take the innovations for those before the faults so far were taken off them."""
        own = self.denoised
        changes = _perturbations(own.dataset, self.motions, now)
        change = own.concatenate(
            {run: own.filters[run].response(one) for run, one in enumerate(changes)}
        )
        self.projection = replace(
            self.projection,
            innovations=self.projection.innovations + change,
            gradient=self.projection.gradient + self.projection.sensitivities @ change,
        )

    def along(self, terms: Sequence[FaultTerm]) -> _Scores:
        """Return gradient and information along some terms."""
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
        Nuisance directions projected out.
    """

    terms: tuple[FaultTerm, ...]
    sensitivities: Array
    factors: Array
    gradient: Array
    information: Array

    def members(self, kinds: Mapping[Kind, float]) -> tuple[list[int], Array]:
        """Return the terms of some kinds that say anything, and their prior deviations."""
        enough = np.diag(self.information) > MIN_INFORMATION_SHARE * np.sum(
            self.sensitivities**2, axis=1
        )
        own = [k for k, term in enumerate(self.terms) if enough[k] and term.fault in kinds]
        usual = [self.terms[k].kind.usual / float(self.factors[k]) for k in own]
        of_kinds = [kinds[self.terms[k].fault] for k in own]
        return own, np.minimum(of_kinds, usual)

    def log_bayes_factor(self, kinds: Mapping[Kind, float]) -> float:
        """Log evidence (nats) that kinds of fault gain, at given prior deviations."""
        own, deviations = self.members(kinds)
        scaled = deviations[:, None] * self.information[np.ix_(own, own)] * deviations
        root = np.linalg.cholesky(np.eye(len(own)) + scaled)
        explained = np.linalg.solve(root, deviations * self.gradient[own])
        return float(0.5 * explained @ explained - np.log(np.diag(root)).sum())

    def most_evidence(self, kinds: Mapping[Kind, float]) -> dict[Kind, float]:
        """Return the prior deviations of largest evidence, starting at given ones."""
        low, high = np.log(_DEVIATIONS[[0, -1]])

        def at(logs: Array) -> dict[Kind, float]:
            return dict(zip(kinds, np.exp(np.clip(logs, low, high)).tolist(), strict=True))

        def loss(logs: Array) -> float:
            return -self.log_bayes_factor(at(logs))

        return at(minimize(loss, np.log(list(kinds.values())), method="Nelder-Mead").x)

    def largest(self, kinds: Mapping[Kind, float], kind: Kind) -> float:
        """Log evidence (nats) that kinds gain, at the prior deviation of one that gains most."""
        return max(self.log_bayes_factor({**kinds, kind: d}) for d in _DEVIATIONS.tolist())

    def further(self, kinds: Mapping[Kind, float]) -> dict[Kind, float]:
        """Add the kind that gains most; nothing where none is worth its cost."""
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
        own, deviations = self.members(kinds)
        precision = self.information[np.ix_(own, own)] + np.diag(deviations**-2)
        covariance = np.linalg.inv(precision)
        factors, sizes = self.factors[own], covariance @ self.gradient[own]
        spread = np.linalg.slogdet(covariance)[1] - 2.0 * np.log(deviations).sum()
        return _Regression(
            tuple(self.terms[k] for k in own),
            dict(kinds),
            factors * sizes,
            factors[:, None] * covariance * factors,
            0.5 * float(spread - np.sum((sizes / deviations) ** 2)),
        )


def regress_on_unlisted_faults(
    assessed: AssessedModel, holdout: Dataset | None
) -> FaultRegression | None:
    """Explain what a model leaves by unlisted faults; None where nothing decisive is found.

    Parameters
    ----------
    assessed : AssessedModel
        With all named effects.
    holdout : Dataset or None
        Held-out recordings.
    """
    dataset, model, evidence = assessed.denoised, assessed.model, assessed.evidence
    now = _Regression()
    at = _Linearized(dataset, model, evidence, now)
    every = fault_terms(at.denoised.dataset, rms_travel(at.motions))
    while len(now.deviations) < _MAX_KINDS:
        refined = [term for term in now.terms if term not in every]
        kinds = at.along([*every, *refined]).further(now.deviations)
        if not kinds:
            break
        own = [term for term in every if term.fault in kinds and term.fault not in now.deviations]
        terms = [*now.terms, *own]
        for _ in range(_ROUNDS):
            scores = _refined(at, terms, kinds)
            kinds = scores.most_evidence(kinds)
            now = scores.regression(kinds)
            terms = list(now.terms)
            changes = _perturbations(dataset, at.motions, now)
            dataset = replace(dataset, perturbations=changes)
            model = fit_again(dataset, model, model.placed_effects)
            if not math.isfinite(model.mode.log_posterior):
                return None
            at = _Linearized(dataset, model, evidence, now)
    if not now.terms:
        return None
    scores = at.along(now.terms)
    cross = at.projection.sensitivities @ (scores.sensitivities / scores.factors[:, None]).T
    slope = np.linalg.solve(at.projection.precision, cross)[: len(model.mode.z)]
    evidence = model_evidence(dataset, model)
    spread = evidence.covariance + slope @ now.covariance @ slope.T
    changed = replace(
        assessed,
        dataset=replace(assessed.dataset, perturbations=dataset.perturbations),
        denoised=dataset,
        model=model,
        evidence=replace(evidence, covariance=spread),
    )
    held = None if holdout is None else _apply(holdout, model, now)
    choice = UNKNOWN_SIZE_COST + math.log(len({term.fault for term in every}))
    log_evidence = evidence.log_evidence + now.log_occam_factor - len(now.deviations) * choice
    return FaultRegression(changed, held, _causes(at, now, scores), log_evidence)


def _refined(at: _Linearized, terms: Sequence[FaultTerm], kinds: Mapping[Kind, float]) -> _Scores:
    """Replace the terms of each kind by the one form of largest evidence, where any is possible.

    A kind keeps the terms that it has where they explain decisively more together.
    """
    scores = at.along(terms)
    for kind in kinds:
        forms = [term for term in scores.terms if term.fault == kind and term.kind.continuous]
        if not forms:
            continue
        others = [term for term in scores.terms if term.fault != kind]
        one = _SingleForm(at, forms[0], at.along(others) if others else None, kinds)
        begins = sorted(_scan(forms), key=one.loss)[:_BEGINS]
        fits = [
            minimize(
                one.loss, begin, method="Nelder-Mead",
                options={
                    "maxfev": _TRIALS, "xatol": _TOLERANCE, "fatol": _GAIN,
                    "initial_simplex": _simplex(begin),
                },
            )
            for begin in begins
        ]  # fmt: skip
        best = min(fits, key=lambda fit: float(fit.fun))
        if -float(best.fun) > scores.largest(kinds, kind) - DECISIVE_EVIDENCE:
            scores = one.scores(best.x)
    return scores


@dataclass(frozen=True)
class _SingleForm:
    """A kind of fault in one form beside all other kinds.

    Parameters
    ----------
    at : _Linearized
        The model.
    like : FaultTerm
        A term of that kind.
    others : _Scores or None
        Terms of the other kinds.
    kinds : dict
        All kinds, with prior deviations.
    """

    at: _Linearized
    like: FaultTerm
    others: _Scores | None
    kinds: Mapping[Kind, float]

    def scores(self, logs: Array) -> _Scores:
        """Return the scores with logarithms of the form's constants."""
        form = tuple(np.exp(logs).tolist())
        return _joined(self.at, self.others, self.at.along([self.like._replace(form=form)]))

    def loss(self, logs: Array) -> float:
        """Minus the log evidence that it gains, at the prior deviation of most."""
        return -self.scores(logs).largest(self.kinds, self.like.fault)


def _scan(forms: Sequence[FaultTerm]) -> list[Array]:
    """Logarithms of constants over the range of some forms, the first in small steps."""
    logs = np.log([term.form for term in forms])
    first = logs[:, 0]
    count = 1 + math.ceil((first.max() - first.min()) / _SCAN_STEP)
    return [
        np.concatenate([[value], logs[0, 1:]])
        for value in np.linspace(first.min(), first.max(), count)
    ]


def _simplex(begin: Array) -> Array:
    """Return points (d + 1, d) a tenth around one of logarithms."""
    return np.concatenate([begin[None], begin + 0.1 * np.eye(len(begin))])


def _joined(at: _Linearized, one: _Scores | None, other: _Scores) -> _Scores:
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
    dataset: Dataset, motions: Sequence[PredictedMotion], now: _Regression
) -> tuple[Perturbation, ...]:
    """Return what the faults change in each run."""
    of_terms = [term.faults(dataset, motions) for term in now.terms]
    out = []
    for run in range(len(dataset.recordings)):
        parts = zip(*(faults[run].perturbation for faults in of_terms), strict=True)
        out.append(Perturbation(*(np.tensordot(now.sizes, np.array(part), 1) for part in parts)))
    return tuple(out)


def _apply(dataset: Dataset, model: FittedModel, now: _Regression) -> Dataset:
    """Return other recordings less what the faults change along their own motion."""
    for _ in range(_ROUNDS):
        posterior, z = transfer_frozen(dataset, model, own=False)
        motions = predicted_motions(dataset, posterior, z)
        dataset = replace(dataset, perturbations=_perturbations(dataset, motions, now))
    return dataset


def _causes(at: _Linearized, now: _Regression, scores: _Scores) -> tuple[UnnamedCause, ...]:
    """Divide the change of the predictions among the kinds of fault."""
    sizes, dataset = now.sizes / scores.factors, at.denoised.dataset
    found = []
    for kind in now.deviations:
        own = [k for k, term in enumerate(now.terms) if term.fault == kind]
        part = abs(float(sizes[own] @ scores.information[own] @ sizes))
        terms = [(now.sizes[k], now.terms[k].faults(dataset, at.motions)) for k in own]
        runs = range(len(dataset.recordings))
        changes = [sum(size * faults[run].change for size, faults in terms) for run in runs]
        along = [terms[0][1][run].along for run in runs]
        dimensions = now.terms[own[0]].kind.dimensions
        found.append((part, (*kind, dimensions, tuple(changes), tuple(along))))
    whole = sum(part for part, _ in found)
    return tuple(
        UnnamedCause(kind, place, part / whole, dimensions, changes, along)
        for part, (kind, place, dimensions, changes, along) in sorted(found, key=lambda x: -x[0])
    )
