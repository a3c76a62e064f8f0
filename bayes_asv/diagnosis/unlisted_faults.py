"""How well faults that are not in the list explain the residuals of a model.

There are three kinds: faults of known direction; a free force at an axle, as short pulses that
follow each other through every run, whose amplitude is integrated out over a few sizes, so that the
number of pulses costs what it should; and time stamps that jitter.

A model that allows any force finds only what is large.  A test along the direction of a known fault
(:mod:`.unlisted_fault_models`) finds a hundredth of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_asv.diagnosis.denoised_model import DenoisedModel, denoised_model
from bayes_asv.diagnosis.residual_tests import jitter_log_likelihood_ratio
from bayes_asv.diagnosis.score_test import NuisanceProjection
from bayes_asv.diagnosis.thresholds import MIN_INFORMATION_SHARE, UNKNOWN_SIZE_COST
from bayes_asv.diagnosis.tolerance_prior import ModelEvidence, projection_with_tolerances
from bayes_asv.diagnosis.unlisted_fault_models import (
    UNIT_SHARE,
    FaultTerm,
    PredictedMotion,
    fault_terms,
    predicted_motions,
    rms_travel,
    unit_size,
)
from bayes_asv.filters.force_laws import OUTSIDE, excess_many, table_of_laws
from bayes_asv.models.effects.damper_curve import KNOTS as DAMPER_KNOTS
from bayes_asv.models.effects.spring_curve import KNOTS as SPRING_KNOTS
from bayes_asv.posterior.fitted_model import Dataset
from bayes_asv.posterior.likelihood import Perturbation, shared_work

__all__ = [
    "PARTS",
    "FreeLaw",
    "Part",
    "UnlistedExplanation",
    "UnlistedFaultScores",
    "best_unlisted_explanation",
    "free_force_evidence",
    "free_law_evidence",
    "free_laws",
    "pulse_sensitivities",
    "unlisted_fault_scores",
    "unlisted_fault_sensitivities",
]

Array = NDArray[np.float64]

Part = Literal["damper", "spring"]
"""What of a suspension a free law is of."""
PARTS: tuple[Part, ...] = ("damper", "spring")

_LAGS = ("hysteresis", "a damper in a soft mount")  # faults by which force lags velocity


def unlisted_fault_sensitivities(
    model: DenoisedModel, terms: Sequence[FaultTerm], motions: Sequence[PredictedMotion]
) -> tuple[Array, Array]:
    """Sensitivities (K, N) along unlisted faults, and the factors (K,) that their size has there.

    Parameters
    ----------
    model : DenoisedModel
        A model at its mode.
    terms : sequence of FaultTerm
        K faults.
    motions : sequence of PredictedMotion
        Motion of the car in each run.
    """

    def sensitivity(term: FaultTerm) -> tuple[Array, float]:
        faults = term.faults(model.dataset, motions)
        factor = unit_size(faults)
        responses = {
            run: model.filters[run].response(
                Perturbation(*(factor * part for part in fault.perturbation))
            )
            for run, fault in enumerate(faults)
        }
        changed = model.concatenate(responses)
        # a fault whose simulation diverges has no score
        return changed if np.all(np.isfinite(changed)) else np.zeros_like(changed), factor

    with shared_work(model.filters[0].posterior) as shared:
        assert shared.pool is not None
        found = list(shared.pool.map(sensitivity, terms))
    return np.array([one for one, _ in found]), np.array([factor for _, factor in found])


# Share of the jitter's gain that counts against one named effect: a variance that varies covers
# what several effects would have to share.
_JITTER_SHARE = 0.5
_PULSE_SPACING = 0.04  # s
_PULSE_FORCE = 0.01  # of an element's load
_AMPLITUDES = np.array([0.1, 0.3, 1.0, 3.0, 10.0])  # prior standard deviations, in pulse forces


class UnlistedFaultScores(NamedTuple):
    """Scores of K unlisted faults next to a model.

    Parameters
    ----------
    gradient : (K,) array
        Gradient of the log-likelihood along each, nuisance directions projected out.
    information : (K, K) array
        Its covariance under the model.
    sensitivities : (K, N) array
        Changes of the predictions, in standard deviations.
    terms : tuple of FaultTerm
        The faults.
    """

    gradient: Array
    information: Array
    sensitivities: Array
    terms: tuple[FaultTerm, ...]

    @property
    def descriptions(self) -> tuple[str, ...]:
        """What each fault is, and where."""
        return tuple(term.description for term in self.terms)

    @property
    def raw_information(self) -> Array:
        """Information (K,) before nuisance directions were projected out."""
        return np.asarray(np.sum(self.sensitivities**2, axis=1))

    @property
    def gains(self) -> Array:
        """Log-likelihood (K,) that each gains at its most probable size, nats."""
        own = np.diag(self.information)
        informative = own > MIN_INFORMATION_SHARE * self.raw_information
        return np.where(informative, 0.5 * self.gradient**2 / np.maximum(own, 1e-30), 0.0)


class UnlistedExplanation(NamedTuple):
    """The best explanation by something that is not in the list.

    Parameters
    ----------
    log_evidence : float
        Log evidence of the model with it.
    description : str
        What it is.
    """

    log_evidence: float
    description: str


def unlisted_fault_scores(
    model: DenoisedModel, projection: NuisanceProjection
) -> UnlistedFaultScores:
    """Score the unlisted faults of known direction.

    Parameters
    ----------
    model : DenoisedModel
        The model at its mode.
    projection : NuisanceProjection
        What it can reproduce.
    """
    motions = predicted_motions(model.dataset, model.filters[0].posterior, model.model.mode.z)
    terms = fault_terms(model.dataset, rms_travel(motions))
    sensitivities, _ = unlisted_fault_sensitivities(model, terms, motions)
    gradient, information = projection.project_out(sensitivities)
    return UnlistedFaultScores(gradient, information, sensitivities, terms)


def free_force_evidence(model: DenoisedModel, projection: NuisanceProjection) -> tuple[float, str]:
    """Log Bayes factor (nats) of a free force against none, and the axle at which it is largest.

    Parameters
    ----------
    model, projection
        As :func:`unlisted_fault_scores` takes them.
    """
    by_axle = {
        axle: _log_bayes_factor(*projection.project_out(pulse_sensitivities(model, axle)))
        for axle in model.model.space.car.axles
    }
    axle = max(by_axle, key=lambda name: by_axle[name])
    return by_axle[axle], axle


def free_law_evidence(
    model: DenoisedModel,
    projection: NuisanceProjection,
    scores: UnlistedFaultScores,
    part: Part,
) -> tuple[float, str]:
    """Log Bayes factor (nats) of a free law against none, and the axle where it is largest.

    To first order a damper law adds a force that is any piecewise linear function of the rate of
    deflection, and the unlisted faults by which force lags velocity; a spring law adds a force that
    is any piecewise linear function of deflection.

    Parameters
    ----------
    model, projection
        As :func:`unlisted_fault_scores` takes them.
    scores : UnlistedFaultScores
        Of the same model.
    part : {'damper', 'spring'}
        Whose law.
    """
    posterior, z = model.filters[0].posterior, model.model.mode.z
    motions = predicted_motions(model.dataset, posterior, z)
    car, values = posterior.space.car, posterior.space.values(z[None])
    knots = DAMPER_KNOTS if part == "damper" else SPRING_KNOTS
    by_axle = {}
    for axle in car.axles:
        own = [e for e, element in enumerate(car.elements) if element.axle == axle]
        if part == "damper":
            driven = [motion.velocity[:, own].T for motion in motions]
            names = [car.elements[e].damping for e in own]
        else:
            driven = [motion.deflection[:, own].T for motion in motions]
            names = [car.elements[e].spring for e in own]
        spread = float(np.std(np.concatenate(driven, axis=1)))
        size = UNIT_SHARE * spread * float(np.mean([values[name][0] for name in names]))
        hats = size * np.delete(np.eye(len(knots)), len(knots) // 2, axis=0)  # no force at rest
        changes = [[np.interp(x, knots, hat) for x in driven] for hat in hats]
        along = _force_sensitivities(model, own, changes)
        if part == "damper":
            places = {f"at the {car.elements[e].words}" for e in own}
            lags = [t.kind.name in _LAGS and t.kind.place in places for t in scores.terms]
            along = np.concatenate([along, scores.sensitivities[lags]])
        by_axle[axle] = _log_bayes_factor(*projection.project_out(along))
    axle = max(by_axle, key=lambda name: by_axle[name])
    return by_axle[axle], axle


def _force_sensitivities(
    model: DenoisedModel, elements: list[int], changes: list[list[Array]]
) -> Array:
    """Sensitivities (K, N) along forces (elements, E) of K kinds in every run."""

    def sensitivity(by_run: list[Array]) -> Array:
        responses = {}
        for run, forces in enumerate(by_run):
            recording = model.dataset.recordings[run]
            force = np.zeros((len(recording.elapsed), len(recording.car.elements)))
            force[:, elements] = forces.T
            nudge = Perturbation(
                np.zeros_like(recording.moments), np.zeros_like(recording.reading), force
            )
            responses[run] = model.filters[run].response(nudge)
        return model.concatenate(responses)

    with shared_work(model.model.posterior) as shared:
        assert shared.pool is not None
        return np.array(list(shared.pool.map(sensitivity, changes)))


def pulse_sensitivities(model: DenoisedModel, axle: str) -> Array:
    """Sensitivities (K, N) along short force pulses at one axle, in succession through every run.

    The elements of the axle share the force.  A pulse rises for as long as the next one takes to
    begin, so that equal pulses add up to a constant force.  They are added to the model, a named
    pulse in the same run included.
    """
    size = _PULSE_FORCE * model.model.space.sizes.load
    shares = model.model.space.car.shares(axle)
    runs = [(run, recording.elapsed) for run, recording in enumerate(model.dataset.recordings)]
    starts = [
        (run, start) for run, time in runs for start in np.arange(time[0], time[-1], _PULSE_SPACING)
    ]

    def sensitivity(at: tuple[int, float]) -> Array:
        run, start = at
        recording = model.dataset.recordings[run]
        pulse = table_of_laws([[0, OUTSIDE, size, start, _PULSE_SPACING, _PULSE_SPACING]])
        time = recording.elapsed
        rest = np.zeros(len(time))
        force = excess_many(pulse, 0, 0.0, 0.0, rest, rest, time, time[-1])[:, 0]
        perturbation = Perturbation(
            np.zeros_like(recording.moments),
            np.zeros_like(recording.reading),
            np.outer(force, shares),
        )
        return model.concatenate({run: model.filters[run].response(perturbation)})

    with shared_work(model.model.posterior) as shared:
        assert shared.pool is not None
        return np.array(list(shared.pool.map(sensitivity, starts)))


def _log_bayes_factor(gradient: Array, information: Array) -> float:
    """Log Bayes factor of normal amplitudes against none, averaged over their prior sizes.

    At a prior standard deviation s it is ½ Σ (s² u² / (1 + s² λ) − log(1 + s² λ)), with eigenvalues
    λ of the information and u the gradient along its eigenvectors.
    """
    if not np.all(np.isfinite(information)):  # a pulse that makes the model diverge
        return -math.inf
    eigenvalues, vectors = np.linalg.eigh(information)
    eigenvalues = np.maximum(eigenvalues, 0.0)
    squares = (vectors.T @ gradient) ** 2
    gains = [
        0.5
        * float(np.sum(squares * s**2 / (1.0 + s**2 * eigenvalues) - np.log1p(s**2 * eigenvalues)))
        for s in _AMPLITUDES
    ]
    return float(logsumexp(gains) - math.log(len(gains)))


def best_unlisted_explanation(dataset: Dataset, evidence: ModelEvidence) -> UnlistedExplanation:
    """Find the unlisted explanation of most evidence next to a model, to first order.

    Parameters
    ----------
    dataset : Dataset
        Recordings with denoised inputs.
    evidence : ModelEvidence
        The model under the tolerance prior of all other effects.
    """
    denoised = denoised_model(dataset, evidence.model)
    projection = projection_with_tolerances(denoised.derivatives, evidence)
    scores = unlisted_fault_scores(denoised, projection)
    return _best_explanation(dataset, evidence, denoised, projection, scores)


class FreeLaw(NamedTuple):
    """A damper or spring law of any form next to a model, to first order.

    Parameters
    ----------
    part : {'damper', 'spring'}
        Whose law.
    axle : str
        Where it gains most.
    gain : float
        Log evidence (nats) that it gains there.
    best_gain : float
        The same of the best unlisted explanation.
    """

    part: Part
    axle: str
    gain: float
    best_gain: float


def free_laws(
    dataset: Dataset, evidence: ModelEvidence, parts: Sequence[Part] = PARTS
) -> list[FreeLaw]:
    """Compare free laws with the best unlisted explanation; the one that gains most comes first.

    Parameters
    ----------
    dataset, evidence
        As :func:`best_unlisted_explanation` takes them.
    parts : sequence of {'damper', 'spring'}
        Whose laws.
    """
    denoised = denoised_model(dataset, evidence.model)
    projection = projection_with_tolerances(denoised.derivatives, evidence)
    scores = unlisted_fault_scores(denoised, projection)
    best = _best_explanation(dataset, evidence, denoised, projection, scores)
    best_gain = best.log_evidence - evidence.log_evidence
    laws = []
    for part in parts:
        gain, axle = free_law_evidence(denoised, projection, scores, part)
        laws.append(FreeLaw(part, axle, gain, best_gain))
    return sorted(laws, key=lambda law: -law.gain)


def _best_explanation(
    dataset: Dataset,
    evidence: ModelEvidence,
    denoised: DenoisedModel,
    projection: NuisanceProjection,
    scores: UnlistedFaultScores,
) -> UnlistedExplanation:
    best = int(np.argmax(scores.gains))
    gain = float(scores.gains[best])
    jitter, channel = jitter_log_likelihood_ratio(dataset, evidence.model, denoised.settled)
    force, axle = free_force_evidence(denoised, projection)
    base = evidence.log_evidence
    return max(
        UnlistedExplanation(
            base + gain - UNKNOWN_SIZE_COST - math.log(len(scores.descriptions)),
            scores.descriptions[best],
        ),
        UnlistedExplanation(
            base + force - math.log(len(evidence.model.space.car.axles)),
            f"an unknown force at the {axle} axle",
        ),
        UnlistedExplanation(
            base + _JITTER_SHARE * jitter - UNKNOWN_SIZE_COST - math.log(len(dataset.channels)),
            f"jittering time stamps ({channel.replace('_', ' ')})",
        ),
    )
