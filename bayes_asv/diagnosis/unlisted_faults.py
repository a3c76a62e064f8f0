"""Scores and evidence of faults that are not in the list.

There are three kinds: faults with a known direction; a free force at an axle, as a succession of
short pulses through every run, whose amplitudes are integrated out for a few prior sizes, so that
their number is penalised; and jitter of time stamps.

A free force is detected only if it is large.  A test along the direction of a known fault
(:mod:`.unlisted_fault_models`) detects a hundredth of it.
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
    lag_terms,
    predicted_motions,
    rms_travel,
    unit_size,
)
from bayes_asv.models.effects import EFFECTS, PlacedEffect
from bayes_asv.models.effects.damper_curve import KNOTS as DAMPER_KNOTS
from bayes_asv.models.effects.spring_curve import KNOTS as SPRING_KNOTS
from bayes_asv.posterior.effects import force_history
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
"""Part of a suspension that has a free law."""
PARTS: tuple[Part, ...] = ("damper", "spring")


def unlisted_fault_sensitivities(
    model: DenoisedModel, terms: Sequence[FaultTerm], motions: Sequence[PredictedMotion]
) -> tuple[Array, Array]:
    """Sensitivities (K, N) along unlisted faults of unit size, and those sizes (K,).

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
        # a fault whose simulation diverges gets no score
        return changed if np.all(np.isfinite(changed)) else np.zeros_like(changed), factor

    with shared_work(model.filters[0].posterior) as shared:
        assert shared.pool is not None
        results = list(shared.pool.map(sensitivity, terms))
    return np.array([one for one, _ in results]), np.array([factor for _, factor in results])


# Share of the gain by jitter that is compared with one named effect: a variable variance also
# includes the gains of several effects.
_JITTER_SHARE = 0.5
_PULSE_SPACING = 0.04  # time between pulses, s
_PULSE_FORCE = 0.01  # unit force of a pulse, as a share of an element's static load
_AMPLITUDES = np.array([0.1, 0.3, 1.0, 3.0, 10.0])  # prior standard deviations, in unit forces


class UnlistedFaultScores(NamedTuple):
    """Scores of K unlisted faults beside a model.

    Parameters
    ----------
    gradient : (K,) array
        Gradient of the log-likelihood along each, with nuisance directions projected out.
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
        """Descriptions of the faults."""
        return tuple(term.description for term in self.terms)

    @property
    def one_sided(self) -> NDArray[np.bool_]:
        """Whether only a positive size of each (K,) is unlisted, since its opposite is listed."""
        return np.array([term.kind.opposite is not None for term in self.terms])

    @property
    def raw_information(self) -> Array:
        """Information (K,) before the projection of nuisance directions."""
        return np.asarray(np.sum(self.sensitivities**2, axis=1))

    @property
    def gains(self) -> Array:
        """Gain of log-likelihood (K,) by each at its most probable size, nats."""
        own_information = np.diag(self.information)
        informative = own_information > MIN_INFORMATION_SHARE * self.raw_information
        informative &= ~(self.one_sided & (self.gradient < 0.0))
        return np.where(
            informative, 0.5 * self.gradient**2 / np.maximum(own_information, 1e-30), 0.0
        )


class UnlistedExplanation(NamedTuple):
    """The best explanation by something that is not in the list.

    Parameters
    ----------
    log_evidence : float
        Log evidence of the model with it.
    description : str
        Its description.
    """

    log_evidence: float
    description: str


def unlisted_fault_scores(
    model: DenoisedModel, projection: NuisanceProjection
) -> UnlistedFaultScores:
    """Score the unlisted faults with known directions.

    Parameters
    ----------
    model : DenoisedModel
        The model at its mode.
    projection : NuisanceProjection
        Projection of changes that it can reproduce.
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
        As in :func:`unlisted_fault_scores`.
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
    part: Part,
) -> tuple[float, str]:
    """Log Bayes factor (nats) of a free law against none, and the axle at which it is largest.

    To first order, a damper law adds a force that is any piecewise linear function of the rate of
    deflection, and those faults in which the force lags the velocity; a spring law adds a
    force that is any piecewise linear function of deflection.

    Parameters
    ----------
    model, projection
        As in :func:`unlisted_fault_scores`.
    part : {'damper', 'spring'}
        Part that has the law.
    """
    posterior, z = model.filters[0].posterior, model.model.mode.z
    motions = predicted_motions(model.dataset, posterior, z)
    car, values = posterior.space.car, posterior.space.values(z[None])
    knots = DAMPER_KNOTS if part == "damper" else SPRING_KNOTS
    by_axle = {}
    for axle in car.axles:
        of_axle = [e for e, element in enumerate(car.elements) if element.axle == axle]
        if part == "damper":
            driven = [motion.velocity[:, of_axle].T for motion in motions]
            names = [car.elements[e].damping for e in of_axle]
        else:
            driven = [motion.deflection[:, of_axle].T for motion in motions]
            names = [car.elements[e].spring for e in of_axle]
        spread = float(np.std(np.concatenate(driven, axis=1)))
        size = UNIT_SHARE * spread * float(np.mean([values[name][0] for name in names]))
        hats = size * np.delete(np.eye(len(knots)), len(knots) // 2, axis=0)  # no force at rest
        changes = [[np.interp(x, knots, hat) for x in driven] for hat in hats]
        sensitivities = _force_sensitivities(model, of_axle, changes)
        if part == "damper":
            lags = lag_terms(model.dataset, rms_travel(motions), of_axle)
            along_lags, _ = unlisted_fault_sensitivities(model, lags, motions)
            sensitivities = np.concatenate([sensitivities, along_lags])
        by_axle[axle] = _log_bayes_factor(*projection.project_out(sensitivities))
    axle = max(by_axle, key=lambda name: by_axle[name])
    return by_axle[axle], axle


def _force_sensitivities(
    model: DenoisedModel, elements: list[int], changes: list[list[Array]]
) -> Array:
    """Sensitivities (K, N) along K sets of forces, each with arrays (elements, E) by run."""

    def sensitivity(by_run: list[Array]) -> Array:
        responses = {}
        for run, forces in enumerate(by_run):
            recording = model.dataset.recordings[run]
            force = np.zeros((len(recording.elapsed), len(recording.car.elements)))
            force[:, elements] = forces.T
            responses[run] = model.filters[run].response(Perturbation.of_forces(recording, force))
        return model.concatenate(responses)

    with shared_work(model.model.posterior) as shared:
        assert shared.pool is not None
        return np.array(list(shared.pool.map(sensitivity, changes)))


def pulse_sensitivities(model: DenoisedModel, axle: str) -> Array:
    """Sensitivities (K, N) along short force pulses at one axle, in succession through every run.

    The elements of the axle share the force.  The rise time of a pulse equals their spacing, so
    that equal pulses add up to a constant force.  They are added to the model, including any named
    pulse in the same run.
    """
    size = _PULSE_FORCE * model.model.space.sizes.load
    force = PlacedEffect(EFFECTS["external_force"], axle)
    runs = [(run, recording.elapsed) for run, recording in enumerate(model.dataset.recordings)]
    starts = [
        (run, start) for run, time in runs for start in np.arange(time[0], time[-1], _PULSE_SPACING)
    ]

    def sensitivity(at: tuple[int, float]) -> Array:
        run, start = at
        recording = model.dataset.recordings[run]
        pulse = {"force": size, "start": start, "duration": _PULSE_SPACING, "rise": _PULSE_SPACING}
        added = Perturbation.of_forces(recording, force_history(recording, {force: pulse}, run))
        return model.concatenate({run: model.filters[run].response(added)})

    with shared_work(model.model.posterior) as shared:
        assert shared.pool is not None
        return np.array(list(shared.pool.map(sensitivity, starts)))


def _log_bayes_factor(gradient: Array, information: Array) -> float:
    """Log Bayes factor of normal amplitudes against none, averaged over their prior sizes.

    For a prior standard deviation s it is ½ Σ (s² u² / (1 + s² λ) − log(1 + s² λ)), with the
    eigenvalues λ of the information and the gradient u along its eigenvectors.
    """
    if not np.all(np.isfinite(information)):  # a pulse that makes the simulation diverge
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
    """Find the unlisted explanation with the largest evidence beside a model, to first order.

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
    """A free damper or spring law beside a model, to first order.

    Parameters
    ----------
    part : {'damper', 'spring'}
        Part that has the law.
    axle : str
        Axle at which it gains most.
    gain : float
        Gain of log evidence at that axle, nats.
    best_gain : float
        Gain of log evidence by the best unlisted explanation, nats.
    """

    part: Part
    axle: str
    gain: float
    best_gain: float


def free_laws(
    dataset: Dataset, evidence: ModelEvidence, parts: Sequence[Part] = PARTS
) -> list[FreeLaw]:
    """Compare free laws with the best unlisted explanation; the largest gain comes first.

    Parameters
    ----------
    dataset, evidence
        As in :func:`best_unlisted_explanation`.
    parts : sequence of {'damper', 'spring'}
        Parts whose laws are compared.
    """
    denoised = denoised_model(dataset, evidence.model)
    projection = projection_with_tolerances(denoised.derivatives, evidence)
    scores = unlisted_fault_scores(denoised, projection)
    best = _best_explanation(dataset, evidence, denoised, projection, scores)
    best_gain = best.log_evidence - evidence.log_evidence
    laws = []
    for part in parts:
        gain, axle = free_law_evidence(denoised, projection, part)
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
