"""Models with effects, fitted to a set of recordings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import Channel
from bayes_asv.domain.errors import FitError
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.posterior.denoised_inputs import denoise_and_predict, simulate_nominal_outputs
from bayes_asv.posterior.effects import SensorCorrections, sensor_corrections
from bayes_asv.posterior.fisher_scoring import LaplaceApproximation, maximise_by_scoring
from bayes_asv.posterior.free_simulation import initial_state
from bayes_asv.posterior.likelihood import WHITE, Perturbation, Posterior, shared_work
from bayes_asv.posterior.parameters import ParameterSpace, make_parameter_space
from bayes_asv.preprocessing.measured_inputs import without_mean_input
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.quantization import with_noise_of_still_wheels, without_standstill

__all__ = [
    "Dataset",
    "FittedModel",
    "divergence_error",
    "fit_again",
    "fit_linear_car",
    "fit_model",
    "is_resolved",
    "make_dataset",
    "transfer_coordinates",
    "update_corrections",
    "update_corrections_at",
]  # fmt: skip

Array = NDArray[np.float64]

# Filter's initial variance, as a multiple of the mean square of the simulated initial state.
_INITIAL_VARIANCE = 4.0


@dataclass(frozen=True)
class Dataset:
    """Recordings, and the vehicle that they were taken with.

    Parameters
    ----------
    vehicle : Vehicle
        As given.
    recordings : tuple of PreparedRecording
        Recordings.
    sensor_corrections : tuple of SensorCorrections
        Corrections for sensor effects, one a recording.
    inputs_denoised : bool
        Whether most of the noise of the wheel sensors has been removed.
    perturbations : tuple of Perturbation
        Change that an unlisted fault makes to each recording; empty without one.
    """

    vehicle: Vehicle
    recordings: tuple[PreparedRecording, ...]
    sensor_corrections: tuple[SensorCorrections, ...]
    inputs_denoised: bool = False
    perturbations: tuple[Perturbation, ...] = ()

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Channels that any of the recordings has."""
        return tuple(
            dict.fromkeys(
                channel for recording in self.recordings for channel in recording.channels
            )
        )

    def posterior(
        self, placed_effects: tuple[PlacedEffect, ...], fixed_noise: bool = False
    ) -> Posterior:
        """Posterior of a model with effects; noise near its declared levels, or fixed there."""
        fixed_runs = frozenset(range(len(self.recordings))) if fixed_noise else frozenset()
        parameter_space = make_parameter_space(
            self.vehicle,
            self.recordings,
            fixed_noise_runs=fixed_runs,
            placed_effects=placed_effects,
            tight_noise=True,
        )
        return Posterior(
            parameter_space, (WHITE,) * len(self.recordings),
            sensor_corrections=self.sensor_corrections, perturbations=self.perturbations,
        )  # fmt: skip


def make_dataset(vehicle: Vehicle, recordings: tuple[PreparedRecording, ...]) -> Dataset:
    """Set up recordings, with sensor corrections computed from the readings themselves."""
    recordings = tuple(
        without_mean_input(with_noise_of_still_wheels(recording)) for recording in recordings
    )
    corrections = tuple(
        sensor_corrections(recording, vehicle, recording.reading) for recording in recordings
    )
    dataset = Dataset(vehicle, recordings, corrections)
    # Standstill before the drive determines the initial state, so trim it only afterwards.
    from_rest = [_limit_initial_covariance(dataset, run) for run in range(len(recordings))]
    return replace(dataset, recordings=tuple(map(without_standstill, from_rest)))


def _limit_initial_covariance(dataset: Dataset, run: int) -> PreparedRecording:
    """Limit the initial covariance to what the recording supports.

    A linear car may start in any state.  The filter linearises a nonlinear force law at its state
    estimate: with an initial standard deviation of a decimetre that linearisation would be wrong
    for the first second, and a filter that takes a sensor bias for suspension travel would engage
    stops that the car never reached.
    """
    posterior = dataset.posterior(())
    state, sd = initial_state(posterior, np.zeros(posterior.space.dimension), run)
    covariance = dataset.recordings[run].initial_covariance
    states = 2 * len(dataset.recordings[run].car.elements)
    shrink = np.ones(len(covariance))
    variance = _INITIAL_VARIANCE * (state**2 + sd**2)
    shrink[:states] = np.sqrt(np.minimum(1.0, variance / np.diag(covariance))[:states])
    return replace(
        dataset.recordings[run], initial_covariance=shrink[:, None] * covariance * shrink
    )


def update_corrections(dataset: Dataset, model: FittedModel) -> Dataset:
    """Recompute the corrections of sensor faults from the outputs that a model predicts."""
    return update_corrections_at(dataset, model.posterior, model.mode.z)


def update_corrections_at(dataset: Dataset, posterior: Posterior, z: Array) -> Dataset:
    """Recompute the corrections of sensor faults from the prediction at coordinates (D,).

    Raises
    ------
    FitError
        If the simulation diverges: these coordinates are of no car.
    """

    def corrections_of_run(run: int) -> SensorCorrections:
        declared = (
            simulate_nominal_outputs(posterior, z, run)
            if dataset.inputs_denoised
            else denoise_and_predict(posterior, z, run, dataset.vehicle).after
        )
        recording = dataset.recordings[run]
        if not np.all(np.isfinite(declared)):
            raise divergence_error(recording)
        return sensor_corrections(recording, dataset.vehicle, declared)

    with shared_work(posterior) as shared:
        assert shared.pool is not None
        corrections = list(shared.pool.map(corrections_of_run, range(len(dataset.recordings))))
    return replace(dataset, sensor_corrections=tuple(corrections))


def is_resolved(information: Array) -> NDArray[np.bool_]:
    """Whether double precision resolves the identity, the prior's precision, beside information."""
    return np.abs(information) < 1.0 / np.finfo(float).eps


def divergence_error(recording: PreparedRecording) -> FitError:
    """Return the error of a recording to which no car can be fitted."""
    return FitError(
        recording.source,
        f"the fit of the {recording.car.name} car diverges, so that it is no car at all",
        "check channels, signs, units and clocks, and the values in the vehicle file",
    )


@dataclass(frozen=True)
class FittedModel:
    """A model and its mode.

    Parameters
    ----------
    placed_effects : tuple of PlacedEffect
        Its effects, in the order in which they were added.
    posterior : Posterior
        Its posterior.
    mode : LaplaceApproximation
        Mode of the posterior.
    """

    placed_effects: tuple[PlacedEffect, ...]
    posterior: Posterior
    mode: LaplaceApproximation

    @property
    def space(self) -> ParameterSpace:
        """Coordinates and priors."""
        return self.posterior.space

    @property
    def diverged(self) -> bool:
        """Whether the fit has left all cars: double precision loses the prior beside the data."""
        precision = self.mode.slopes.precision()
        return not (math.isfinite(self.mode.log_posterior) and bool(np.all(is_resolved(precision))))

    def transfer(self, new: ParameterSpace) -> Array:
        """Coordinates of the mode in another model; shared coordinates keep their values."""
        return transfer_coordinates(self.space, self.mode.z, new, None, {})


def transfer_coordinates(
    old: ParameterSpace,
    z: Array,
    new: ParameterSpace,
    placed: PlacedEffect | None,
    values: Mapping[str, float],
) -> Array:
    """Coordinates in another model; shared coordinates keep their values.

    Parameters
    ----------
    old, z : ParameterSpace, (D,) array
        Current parameter space, and coordinates in it.
    new : ParameterSpace
        Parameter space of the other model.
    placed, values
        An added effect, and initial values of its parameters (SI units).  All other new coordinates
        start at the centre of their prior.
    """
    known = dict(zip(old.names, z, strict=True))
    out = np.array([known.get(name, 0.0) for name in new.names])
    if placed is not None:
        for parameter in placed.effect.parameters:
            k = new.index[placed.coordinate_name(parameter)]
            if parameter.name in values:
                out[k] = parameter.coordinate(values[parameter.name], new.sizes)
    return out


def fit_model(posterior: Posterior, start: Array, floor: float = -math.inf) -> FittedModel:
    """Maximise a posterior; stop early if its maximum cannot reach ``floor`` (nats)."""
    with shared_work(posterior) as shared:
        mode = maximise_by_scoring(shared, start, floor)
    return FittedModel(posterior.space.placed_effects, replace(posterior, pool=None), mode)


def fit_again(
    dataset: Dataset, model: FittedModel, placed_effects: tuple[PlacedEffect, ...]
) -> FittedModel:
    """Fit a model with effects to recordings, starting at the mode of another model."""
    posterior = dataset.posterior(placed_effects)
    return fit_model(posterior, model.transfer(posterior.space))


def fit_linear_car(dataset: Dataset) -> FittedModel:
    """Fit the linear car to the recordings of a dataset."""
    posterior = dataset.posterior(())
    return fit_model(posterior, np.zeros(posterior.space.dimension))
