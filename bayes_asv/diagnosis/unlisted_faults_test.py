"""How well faults that are not in the list explain the residuals of a model.

There are three kinds: faults of known direction (:mod:`.unlisted_faults`); a free force at an axle,
as short pulses that follow each other through every run, whose amplitude is integrated out over a
few sizes, so that the number of pulses costs what it should; and time stamps that jitter.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_asv.diagnosis.denoised_model import DenoisedModel, denoised_model
from bayes_asv.diagnosis.residual_tests import jitter_log_likelihood_ratio
from bayes_asv.diagnosis.score_test import NuisanceProjection
from bayes_asv.diagnosis.thresholds import MIN_INFORMATION_SHARE, UNKNOWN_SIZE_COST
from bayes_asv.diagnosis.tolerance_prior import ModelEvidence, projection_with_tolerances
from bayes_asv.diagnosis.unlisted_faults import unlisted_fault_sensitivities
from bayes_asv.filters.force_laws import OUTSIDE, excess_many
from bayes_asv.posterior.fitted_model import Dataset
from bayes_asv.posterior.likelihood import Perturbation, shared_work

__all__ = [
    "UnlistedExplanation",
    "UnlistedFaultScores",
    "best_unlisted_explanation",
    "free_force_evidence",
    "pulse_sensitivities",
    "unlisted_fault_scores",
]

Array = NDArray[np.float64]

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
    descriptions : tuple of str
        What each fault is.
    """

    gradient: Array
    information: Array
    sensitivities: Array
    descriptions: tuple[str, ...]

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
    sensitivities, descriptions = unlisted_fault_sensitivities(model)
    gradient, information = projection.project_out(sensitivities)
    return UnlistedFaultScores(gradient, information, sensitivities, descriptions)


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


def pulse_sensitivities(model: DenoisedModel, axle: str) -> Array:
    """Sensitivities (K, N) along short force pulses at one axle, in succession through every run.

    The elements of the axle share the force.  A pulse rises for as long as the next one takes to
    begin, so that equal pulses add up to a constant force.  They are added to the model, a named
    pulse in the same run included.
    """
    size = _PULSE_FORCE * model.model.space.sizes.load
    shares = model.model.space.car.shares(axle)
    runs = [(run, recording.elapsed) for run, recording in enumerate(model.dataset.lines)]
    starts = [
        (run, start) for run, time in runs for start in np.arange(time[0], time[-1], _PULSE_SPACING)
    ]

    def sensitivity(at: tuple[int, float]) -> Array:
        run, start = at
        recording = model.dataset.lines[run]
        pulse = np.array([[0, OUTSIDE, size, start, _PULSE_SPACING, _PULSE_SPACING]])
        time = recording.elapsed
        rest = np.zeros(len(time))
        force = excess_many(pulse, 0, 0.0, 0.0, rest, rest, time, time[-1])[:, 0]
        perturbation = Perturbation(
            np.zeros_like(recording.moments),
            np.zeros_like(recording.reading),
            np.outer(force, shares),
        )
        return model.concatenate({run: model.filters[run].response(perturbation)})

    with shared_work(model.model.target) as shared:
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
