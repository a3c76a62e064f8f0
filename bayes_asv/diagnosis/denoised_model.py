"""Sensitivities of the predictions: with denoised wheel inputs and filters of fixed gain.

Two effects would correlate a sensitivity with the innovations by which it is multiplied.

Errors in variables.  The filter assumes that the noise of a wheel is independent of its reading.
Without excitation by the road, the reading *is* the noise, and a derivative that is computed from
it shares that noise with the innovations (Carroll et al. 2006, *Measurement Error in Nonlinear
Models*, ch. 4).  The wheel signals are therefore denoised first: the noise that the outputs
identify is subtracted, and then everything below the noise floor of the sensor.  The output
readings change by the model's response to the difference, so that the innovations remain the same
(exactly for a linear car, to first order with a nonlinear force law).

The gain.  A coordinate of the car changes the simulation and also the filter: the variances of the
innovations and the weights of earlier ones.  The second part infers the coordinate from the noise
alone, with a bias if the noise is not as declared.  The sensitivity is therefore that of the free
simulation, passed through the filter with its gain fixed.  This is an estimating equation that is
unbiased for any noise (Godambe 1960, Ann. Math. Stat. 31, 1208; Liang & Zeger 1986, Biometrika 73,
13), with the weights of the declared noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.kalman import MISSING
from bayes_asv.filters.linearised_filter import LinearisedFilter, perturbation_response
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

# Time that a filter needs to estimate motion and biases, s.  Until then it linearises a force law
# with a kink over all speeds that the car may have, which biases the score of the law.
_SETTLING_TIME = 0.2


@dataclass(frozen=True)
class FixedGainFilter:
    """The filter of a model on one run, with fixed gain.

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
        Nominal readings (of sensors as declared) minus the free simulation, SI units.
    innovations, log_variances : (E, ny) arrays
        Normalised innovations and the logarithms of their variances.
    linearised : LinearisedFilter
        The filter along its path.
    """

    posterior: Posterior
    z: Array
    run: int
    start: Array
    residuals: Array
    innovations: Array
    log_variances: Array
    linearised: LinearisedFilter

    @property
    def has_reading(self) -> NDArray[np.bool_]:
        """Whether there is a reading (E, ny)."""
        return np.asarray(self.log_variances != 0.0)

    def sensitivity(self, posterior: Posterior, z: Array) -> Array:
        """Change of the predictions (N,) towards another model, in standard deviations.

        Parameters
        ----------
        posterior, z : Posterior, (D',) array
            The other model, on the same recordings.
        """
        change = _residuals(posterior, z, self.run, self.start) - self.residuals
        recording = self.posterior.space.recordings[self.run]
        return self.response(Perturbation.of_readings(recording, change))

    def response(self, perturbation: Perturbation) -> Array:
        """Change of the predictions (N,) by a perturbation of the run, in standard deviations."""
        return -perturbation_response(self.linearised, *perturbation)[self.has_reading]


def fixed_gain_filter(posterior: Posterior, z: Array, run: int) -> FixedGainFilter:
    """Return the filter of a model at coordinates (D,) on one run."""
    start = free_run(posterior, z, run).initial_state
    filtered, linearised = posterior.linearised_filter(z, run)
    residuals = _residuals(posterior, z, run, start)
    return FixedGainFilter(
        posterior, z, run, start, residuals, filtered.innovations[0], filtered.log_variances[0],
        linearised,
    )  # fmt: skip


def coordinate_sensitivities(filters: Sequence[FixedGainFilter], count: int) -> Array:
    """Differentiate the predictions of all runs along the coordinates of their model.

    Parameters
    ----------
    filters : sequence of FixedGainFilter
        One for each run.
    count : int
        Number of coordinates: those before the first noise level, which do not change predictions.

    Returns
    -------
    (count, N) array
        Derivatives in standard deviations of the innovations.
    """
    return np.concatenate([_run_sensitivities(one, count) for one in filters], axis=1)


def _run_sensitivities(fixed_gain: FixedGainFilter, count: int) -> Array:
    sensitivities = np.zeros((count, np.count_nonzero(fixed_gain.has_reading)))
    relevant = [
        k for k in fixed_gain.posterior.space.coordinates_of_run(fixed_gain.run) if k < count
    ]

    def sensitivity_along(k: int) -> Array:
        return (
            fixed_gain.sensitivity(
                fixed_gain.posterior, fixed_gain.z + STEP * np.eye(len(fixed_gain.z))[k]
            )
            / STEP
        )

    with shared_work(fixed_gain.posterior) as shared:
        assert shared.pool is not None
        sensitivities[relevant] = list(shared.pool.map(sensitivity_along, relevant))
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
        The model at its mode on them.
    dataset : Dataset
        Recordings with denoised inputs, and the model's sensor corrections.
    filters : tuple of FixedGainFilter
        Its filter on each run, without any tolerances.
    settled : (N,) bool array
        Whether the filter has settled at each innovation.
    derivatives : ScoreAndInformation
        The innovations and their derivatives along the model's coordinates; for those of the car
        with fixed gain.  Zero until the filter has settled.
    """

    model: FittedModel
    dataset: Dataset
    filters: tuple[FixedGainFilter, ...]
    settled: NDArray[np.bool_]
    derivatives: ScoreAndInformation

    def concatenate(self, by_run: Mapping[int, NDArray[np.float64]]) -> NDArray[np.float64]:
        """Concatenate changes of the predictions of some runs to one sensitivity (N,).

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
    """Denoise the wheel inputs of recordings such that a model's innovations remain the same."""
    recordings = tuple(
        _denoise_recording(dataset, model, run) for run in range(len(dataset.recordings))
    )
    denoised = replace(dataset, recordings=recordings, inputs_denoised=True)
    return update_corrections(
        denoised, replace(model, posterior=denoised.posterior(model.placed_effects))
    )


def fit_denoised(dataset: Dataset, model: FittedModel) -> tuple[Dataset, FittedModel]:
    """Denoise the inputs with a model, and find its mode on them.

    Denoised inputs depend on the model from which they are computed: compare the evidence of models
    only on the same denoised inputs.
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
        Model at its mode on them.
    """
    dataset = replace(dataset, sensor_corrections=model.posterior.sensor_corrections)
    posterior, z, count = (
        dataset.posterior(model.placed_effects),
        model.mode.z,
        model.space.shared_dimension,
    )
    filters = tuple(fixed_gain_filter(posterior, z, run) for run in range(len(dataset.recordings)))
    settled, at_mode = np.concatenate([_has_settled(one) for one in filters]), model.mode.slopes
    means, scales = at_mode.means.copy(), at_mode.scales.copy()
    means[:count], scales[:count] = coordinate_sensitivities(filters, count), 0.0
    derivatives = replace(at_mode, means=means * settled, scales=scales * settled)
    return DenoisedModel(model, dataset, filters, settled, derivatives)


def _has_settled(fixed_gain: FixedGainFilter) -> NDArray[np.bool_]:
    recording = fixed_gain.posterior.space.recordings[fixed_gain.run]
    any_reading = np.any(recording.kind != MISSING, axis=1)
    settled = recording.instants > recording.instants[any_reading][0] + _SETTLING_TIME
    return np.broadcast_to(settled[:, None], fixed_gain.has_reading.shape)[fixed_gain.has_reading]


def _denoise_recording(dataset: Dataset, model: FittedModel, run: int) -> PreparedRecording:
    recording, before, after = denoise_and_predict(
        model.posterior, model.mode.z, run, dataset.vehicle
    )
    return replace(recording, reading=recording.reading + after - before)
