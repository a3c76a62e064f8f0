"""Sensitivities of the predictions: on denoised wheel inputs, through filters of fixed gain.

Two things would correlate a sensitivity with the innovations that it is multiplied by.

Errors in variables.  The filter takes a wheel's noise to be independent of its reading.  Where the
road gives nothing, the reading *is* the noise, and a derivative along it shares that noise with the
innovations (Carroll et al. 2006, *Measurement Error in Nonlinear Models*, ch. 4).  The wheel
signals are therefore denoised first: they lose what the outputs show to be noise, and then what
does not stand above a sensor's noise.  The output readings change by what the model makes of the
difference, so that the innovations stay what they were (exactly for a linear car, to first order
with a force law in it).

The gain.  A car coordinate changes the simulation and, with it, the filter: the variances of the
innovations and the weight of earlier ones.  Its second part infers the coordinate from the noise
alone, which is biased where the noise is not as declared.  The sensitivity is therefore that of the
free simulation, seen through the filter at fixed gain: an estimating equation that is unbiased
whatever the noise is (Godambe 1960, Ann. Math. Stat. 31, 1208; Liang & Zeger 1986, Biometrika 73,
13), with the weights of the declared noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.kalman import MISSING
from bayes_asv.posterior.denoised_inputs import denoise_and_predict
from bayes_asv.posterior.fisher_scoring import STEP, ScoreAndInformation
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, fit_model, update_corrections
from bayes_asv.posterior.free_simulation import free_run, simulate_from
from bayes_asv.posterior.likelihood import Perturbation, Posterior, shared_work
from bayes_asv.preprocessing.prepared_recording import PreparedRecording

__all__ = [
    "DenoisedModel",
    "FixedGainFilter",
    "coordinate_sensitivities",
    "denoise",
    "denoised_model",
    "fit_denoised",
    "fixed_gain_filter",
]

Array = NDArray[np.float64]

_PERTURBATION = 0.1  # largest change of a reading, in standard deviations: a law is linear there
# Time in which a filter finds motion and biases, s.  Meanwhile it linearises a force law with a
# kink over all the speeds that the car may have, which biases the score of the law.
_SETTLING_TIME = 0.2


@dataclass(frozen=True)
class FixedGainFilter:
    """The filter of a model on one run, its gain held.

    Parameters
    ----------
    posterior : Posterior
        Posterior of the model.
    z : (D,) array
        Coordinates of the model.
    run : int
        Index of the recording.
    start : (nx + nd + ny,) array
        Initial state of the free simulation, as :func:`free_run` returns it.
    residuals : (E, ny) array
        Readings, as sensors as declared would have given them, minus the free simulation, SI units.
    innovations, log_variances : (E, ny) arrays
        Normalised innovations and the logarithms of their variances.
    """

    posterior: Posterior
    z: Array
    run: int
    start: Array
    residuals: Array
    innovations: Array
    log_variances: Array

    @property
    def has_reading(self) -> NDArray[np.bool_]:
        """Where there is a reading (E, ny)."""
        return np.asarray(self.log_variances != 0.0)

    def sensitivity(self, posterior: Posterior, z: Array) -> Array:
        """Change of the predictions (N,) towards another model, in standard deviations.

        Parameters
        ----------
        posterior, z : Posterior, (D',) array
            The other model, on the same recordings.
        """
        change = _residuals(posterior, z, self.run, self.start) - self.residuals
        valid = self.has_reading
        largest = float(np.max(np.abs(change)[valid] * np.exp(-0.5 * self.log_variances[valid])))
        if not 0.0 < largest < np.inf:
            return np.full(np.count_nonzero(valid), 0.0 if largest == 0.0 else np.nan)
        scale = _PERTURBATION / largest
        recording = self.posterior.space.recordings[self.run]
        perturbation = Perturbation(
            np.zeros_like(recording.moments),
            scale * change,
            np.zeros((len(change), len(recording.car.elements))),
        )
        return self.response(perturbation) / scale

    def response(self, perturbation: Perturbation) -> Array:
        """Change of the predictions (N,) by a perturbation of the run, in standard deviations."""
        perturbed = self.posterior.innovations_and_variances(self.z, self.run, perturbation)[0]
        return np.asarray((self.innovations - perturbed)[self.has_reading])


def fixed_gain_filter(posterior: Posterior, z: Array, run: int) -> FixedGainFilter:
    """Return the filter of a model at coordinates (D,) on one run."""
    start = free_run(posterior, z, run).initial_state
    innovations, log_variances, _ = posterior.innovations_and_variances(z, run)
    residuals = _residuals(posterior, z, run, start)
    return FixedGainFilter(posterior, z, run, start, residuals, innovations, log_variances)


def coordinate_sensitivities(filters: Sequence[FixedGainFilter], count: int) -> Array:
    """Differentiate the predictions of all runs along a model's own coordinates.

    Parameters
    ----------
    filters : sequence of FixedGainFilter
        One for each run.
    count : int
        Number of coordinates: those before the first noise level, which changes no prediction.

    Returns
    -------
    (count, N) array
        In standard deviations of the innovations.
    """
    return np.concatenate([_run_sensitivities(one, count) for one in filters], axis=1)


def _run_sensitivities(at: FixedGainFilter, count: int) -> Array:
    sensitivities = np.zeros((count, np.count_nonzero(at.has_reading)))
    relevant = [k for k in at.posterior.space.coordinates_of_run(at.run) if k < count]

    def along(k: int) -> Array:
        return at.sensitivity(at.posterior, at.z + STEP * np.eye(len(at.z))[k]) / STEP

    with shared_work(at.posterior) as shared:
        assert shared.pool is not None
        sensitivities[relevant] = list(shared.pool.map(along, relevant))
    return sensitivities


def _residuals(posterior: Posterior, z: Array, run: int, start: Array) -> Array:
    inputs = posterior.as_declared(z, run)
    return np.asarray(inputs.reading - simulate_from(posterior, z, run, inputs, start)[0])


@dataclass(frozen=True)
class DenoisedModel:
    """A model fitted on denoised inputs, with its sensitivities.

    Parameters
    ----------
    model : FittedModel
        The model at its mode there.
    dataset : Dataset
        Recordings with denoised inputs, and the model's sensor corrections.
    filters : tuple of FixedGainFilter
        Its filter on each run, without any tolerances.
    settled : (N,) bool array
        Innovations after the filter has found the motion.
    derivatives : ScoreAndInformation
        The innovations and their changes along the model's coordinates, those of the car through
        the filter at fixed gain; zero where the filter has not settled.
    """

    model: FittedModel
    dataset: Dataset
    filters: tuple[FixedGainFilter, ...]
    settled: NDArray[np.bool_]
    derivatives: ScoreAndInformation

    def concatenate(self, by_run: Mapping[int, NDArray[np.float64]]) -> NDArray[np.float64]:
        """Join changes of the predictions of some runs to one sensitivity (N,).

        Parameters
        ----------
        by_run : mapping of int to (M,) array
            Change in standard deviations by index of the run; other runs do not change.
        """
        parts = [
            by_run[run] if run in by_run else np.zeros(np.count_nonzero(one.has_reading))
            for run, one in enumerate(self.filters)
        ]
        return np.asarray(np.concatenate(parts) * self.settled)


def denoise(dataset: Dataset, model: FittedModel) -> Dataset:
    """Denoise the wheel inputs of recordings; a model's innovations stay what they were."""
    recordings = tuple(_denoised(dataset, model, run) for run in range(len(dataset.recordings)))
    denoised = replace(dataset, recordings=recordings, inputs_denoised=True)
    return update_corrections(
        denoised, replace(model, posterior=denoised.posterior(model.placed_effects))
    )


def fit_denoised(dataset: Dataset, model: FittedModel) -> tuple[Dataset, FittedModel]:
    """Denoise the inputs by a model, and find its mode on them.

    The denoised inputs depend on the model that denoised them: compare the evidence of models on
    the same ones only.
    """
    denoised = denoise(dataset, model)
    return denoised, fit_model(denoised.posterior(model.placed_effects), model.mode.z)


def denoised_model(dataset: Dataset, model: FittedModel) -> DenoisedModel:
    """Compute the sensitivities of a model that was fitted on denoised inputs.

    Parameters
    ----------
    dataset : Dataset
        Recordings with denoised inputs.
    model : FittedModel
        At its mode on them.
    """
    dataset = replace(dataset, sensor_corrections=model.posterior.sensor_corrections)
    posterior, z, count = (
        dataset.posterior(model.placed_effects),
        model.mode.z,
        model.space.shared_dimension,
    )
    filters = tuple(fixed_gain_filter(posterior, z, run) for run in range(len(dataset.recordings)))
    settled, at_mode = np.concatenate([_settled(one) for one in filters]), model.mode.slopes
    means, scales = at_mode.means.copy(), at_mode.scales.copy()
    means[:count], scales[:count] = coordinate_sensitivities(filters, count), 0.0
    derivatives = replace(at_mode, means=means * settled, scales=scales * settled)
    return DenoisedModel(model, dataset, filters, settled, derivatives)


def _settled(one: FixedGainFilter) -> NDArray[np.bool_]:
    recording = one.posterior.space.recordings[one.run]
    any_reading = np.any(recording.kind != MISSING, axis=1)
    settled = recording.instants > recording.instants[any_reading][0] + _SETTLING_TIME
    return np.broadcast_to(settled[:, None], one.has_reading.shape)[one.has_reading]


def _denoised(dataset: Dataset, model: FittedModel, run: int) -> PreparedRecording:
    recording, before, after = denoise_and_predict(
        model.posterior, model.mode.z, run, dataset.vehicle
    )
    return replace(recording, reading=recording.reading + after - before)
