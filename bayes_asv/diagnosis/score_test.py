"""Score test: how strongly the innovations support each candidate effect.

The sensitivity g_j (N,) of a candidate is the change of the predictions, in standard deviations of
the innovations ν, that its values make through the filter at fixed gain (:mod:`.denoised_model`).
What the model can reproduce by its own coordinates is projected out in the metric of its posterior.
With M the sensitivities along these coordinates, P their posterior precision and ∇ the remaining
gradient of the log-posterior,

    U_j = g_jᵀν − g_jᵀMᵀP⁻¹∇,    I_jk = g_jᵀg_k − g_jᵀMᵀP⁻¹M g_k,    s_j = U_j / √I_jj.

A given value that is tightly known therefore reproduces little.  Innovations are martingale
differences, and sensitivities depend on their past alone: under the model s_j is standard normal to
first order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.denoised_model import DenoisedModel
from bayes_asv.filters.kalman import VALUE
from bayes_asv.models.outputs import relative_offset
from bayes_asv.posterior.effect_candidates import Candidate
from bayes_asv.posterior.fisher_scoring import ScoreAndInformation
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, transfer_coordinates
from bayes_asv.posterior.likelihood import shared_work
from bayes_asv.preprocessing.quantization import spurious_drift
from bayes_asv.preprocessing.timeline import PreparedRecording

__all__ = ["NuisanceProjection", "ScoreTest", "nuisance_projection", "score_test", "standardized"]

Array = NDArray[np.float64]

_NO_INFORMATION = 1e-8  # information below which a score is zero


@dataclass(frozen=True)
class NuisanceProjection:
    """Directions that a model can reproduce, at its mode.

    Parameters
    ----------
    sensitivities : (G, N) array
        Changes of the predictions along its own coordinates and along tolerances, in standard
        deviations.
    precision : (G, G) array
        Posterior precision of these.
    gradient : (G,) array
        Gradient of the log-posterior along them.
    innovations : (N,) array
        Normalised innovations.
    """

    sensitivities: Array
    precision: Array
    gradient: Array
    innovations: Array

    def project_out(self, sensitivities: Array) -> tuple[Array, Array]:
        """Return gradient (K,) and information (K, K) along sensitivities (K, N).

        The gradient that remains at the mode counts: the mode is found to a few thousandths of a
        nat, which is not negligible for a sensitivity that the model can almost reproduce.
        """
        cross = self.sensitivities @ sensitivities.T
        solved = np.linalg.solve(self.precision, np.column_stack([self.gradient, cross]))
        gradient = sensitivities @ self.innovations - cross.T @ solved[:, 0]
        return gradient, sensitivities @ sensitivities.T - cross.T @ solved[:, 1:]


def nuisance_projection(
    derivatives: ScoreAndInformation, z: Array, tolerances: Array, offsets: Array | None = None
) -> NuisanceProjection:
    """Return what a model can reproduce by its coordinates and by tolerances.

    Parameters
    ----------
    derivatives : ScoreAndInformation
        The model's innovations and their changes along its coordinates, on denoised inputs.
    z : (D,) array
        Its mode.
    tolerances : (G, N) array
        Sensitivities along standard normal coordinates that the model does not have.
    offsets : (G,) array, optional
        Values of these that the model's innovations contain; zero by default.
    """
    sensitivities = np.concatenate([derivatives.means, tolerances])
    precision = sensitivities @ sensitivities.T + np.eye(len(sensitivities))
    own = len(derivatives.means)
    precision[:own, :own] = derivatives.precision()
    centre = np.zeros(len(tolerances)) if offsets is None else offsets
    along_tolerances = tolerances @ derivatives.nu - centre
    gradient = np.concatenate([derivatives.gradient(z), along_tolerances])
    return NuisanceProjection(sensitivities, precision, gradient, derivatives.nu)


@dataclass(frozen=True)
class ScoreTest:
    """Gradient and information along K candidates, from the N innovations of a model.

    Parameters
    ----------
    candidates : tuple of Candidate
        The candidates.
    sensitivities : (K, N) array
        Changes of the predictions by each, in standard deviations.
    gradient : (K,) array
        Gradient U of the log-likelihood, nuisance directions projected out.
    information : (K, K) array
        Information I, nuisance directions projected out.
    derivatives : ScoreAndInformation
        The innovations and their changes along the model's coordinates, on the same denoised
        inputs.
    quantization_drifts : (G, N) array
        Sensitivities along drifts that coarse converters may feign, standard normal; nuisance
        directions as well.
    """

    candidates: tuple[Candidate, ...]
    sensitivities: Array
    gradient: Array
    information: Array
    derivatives: ScoreAndInformation
    quantization_drifts: Array

    @property
    def site_count(self) -> int:
        """Number of effects and places; one that may act in several runs counts once."""
        return len({str(c.site) for c in self.candidates})

    @property
    def standardized_scores(self) -> Array:
        """Scores s (K,), each standard normal when nothing is missing; 0 without information."""
        return standardized(self.gradient, np.diag(self.information))


def standardized(gradient: Array, information: Array) -> Array:
    """Standardise gradients (K,) by their own information (K,); 0 without information."""
    sd = np.sqrt(np.maximum(information, _NO_INFORMATION))
    return np.where(information > _NO_INFORMATION, gradient / sd, 0.0)


def score_test(denoised: DenoisedModel, candidates: list[Candidate]) -> ScoreTest:
    """Compute gradient and information along candidates at a model's mode."""
    model, dataset = denoised.model, denoised.dataset
    z = model.mode.z

    def sensitivity(candidate: Candidate) -> Array:
        posterior = dataset.target((*model.sites, candidate.site))
        extended = transfer_coordinates(
            model.space, z, posterior.space, candidate.site, candidate.values
        )
        by_run = {}
        for run, at in enumerate(denoised.filters):
            if candidate.site.run not in (None, run):
                continue
            if candidate.edge:  # an added force leaves the gain as it is: one pass is enough
                predicted = at.innovations - posterior.innovations_and_variances(extended, run)[0]
                by_run[run] = predicted[at.has_reading]
            else:
                by_run[run] = at.sensitivity(posterior, extended)
        joined = denoised.concatenate(by_run)
        # a law whose simulation diverges has no score
        return joined if np.all(np.isfinite(joined)) else np.zeros_like(joined)

    with shared_work(model.target) as shared:
        assert shared.pool is not None
        sensitivities = np.array(list(shared.pool.map(sensitivity, candidates)))
    sensitivities = sensitivities.reshape(len(candidates), -1)
    drifts = _quantization_drifts(dataset, model, candidates, sensitivities)
    projection = nuisance_projection(denoised.derivatives, z, drifts)
    gradient, information = projection.project_out(sensitivities)
    return ScoreTest(
        tuple(candidates), sensitivities, gradient, information, denoised.derivatives, drifts
    )


def _quantization_drifts(
    dataset: Dataset, model: FittedModel, candidates: list[Candidate], sensitivities: Array
) -> Array:
    """Sensitivities (G, N) along offset drifts that coarse converters may feign, run by run."""
    counts = [_reading_count(model, run) for run in range(len(dataset.lines))]
    ends = np.cumsum(counts)
    out = []
    for k, candidate in enumerate(candidates):
        if candidate.site.effect.fault != "drift":
            continue
        one = candidate.values[candidate.site.effect.parameters[0].name]
        for recording, end, count in zip(dataset.lines, ends, counts, strict=True):
            slope = _feigned_slope(recording, candidate.site.where)
            if slope > 0.0:
                drift = np.zeros(sensitivities.shape[1])
                drift[end - count : end] = sensitivities[k, end - count : end] * slope / one
                out.append(drift)
    return np.array(out).reshape(len(out), sensitivities.shape[1])


def _feigned_slope(recording: PreparedRecording, name: str) -> float:
    """Slope of a channel's drift that converters may feign in a run, in units of the effect's.

    A drift of an input is one of the accelerations that follow it, which stand for both.
    """
    names = [channel.name for channel in recording.channels]
    if name not in names:
        return 0.0
    c = names.index(name)
    slope = spurious_drift(recording, c) / relative_offset(recording.channels[c].quantity)
    follows = np.round(recording.rigid_gain, 12)  # what an inverse leaves of zero is no gain
    if c in recording.inputs:
        return 0.0 if np.any(follows[:, recording.inputs.index(c)]) else slope
    for gain, wheel in zip(follows[recording.outputs.index(c)], recording.inputs, strict=True):
        slope = float(np.hypot(slope, gain * spurious_drift(recording, wheel)))
    return slope


def _reading_count(model: FittedModel, run: int) -> int:
    recording = model.space.timelines[run]
    return int(np.count_nonzero(recording.kind == VALUE))
