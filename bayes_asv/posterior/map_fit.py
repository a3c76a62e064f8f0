"""The maximum a posteriori (MAP) fit: from recordings to the mode of the posterior."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.posterior.band_fit import find_mode_threaded, fit_in_band
from bayes_asv.posterior.band_fit import notes as band_notes
from bayes_asv.posterior.effect_fit import with_effects
from bayes_asv.posterior.effects import SensorCorrections
from bayes_asv.posterior.fit_checks import (
    band_advice,
    excess_noise_sentence,
    explained_power_findings,
)
from bayes_asv.posterior.fitted_model import (
    FittedModel,
    fit_linear_car,
    make_dataset,
    transfer_coordinates,
    update_corrections_at,
)
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.posterior.identifiability import unidentified_after_fit
from bayes_asv.posterior.likelihood import WHITE, Posterior, ResidualAR, shared_work
from bayes_asv.posterior.newton import PosteriorMode, find_mode
from bayes_asv.posterior.parameters import ParameterSpace, make_parameter_space
from bayes_asv.posterior.residual_ar import fit_residual_ar
from bayes_asv.preprocessing.prepared_recording import PreparedRecording, with_clock_variants
from bayes_asv.preprocessing.tone_removal import (
    engine_tones,
    find_tones,
    main_tones,
    notched,
    own_modes,
)

__all__ = [
    "MapFit",
    "best_fit",
    "fit_near_declared_noise",
]

Array = NDArray[np.float64]

_AR_ROUNDS = 3  # alternations between residual autoregression and mode


@dataclass(frozen=True)
class MapFit:
    """The mode of a posterior, and whether the data determine the parameters.

    Parameters
    ----------
    posterior : Posterior
        The posterior, with the residual autoregression of each run.
    mode : PosteriorMode
        Its mode and curvature.
    reasons, warnings : tuple of str
        Reasons to refuse an estimate, and warnings.
    misfit_reasons : tuple of str
        The reasons that say that the car model does not fit a recording.
    shares : tuple of float or None
        In a band, the likelihood weight of each run; see
        :class:`bayes_asv.posterior.band_fit.BandFit`.
    tight_noise_fit : FittedModel or None
        The same model with noise levels near the declared ones, where that was fitted.
    """

    posterior: Posterior
    mode: PosteriorMode
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]
    shares: tuple[float | None, ...] = ()
    misfit_reasons: tuple[str, ...] = ()
    tight_noise_fit: FittedModel | None = None

    @property
    def space(self) -> ParameterSpace:
        """Coordinates and priors."""
        return self.posterior.space


def best_fit(
    recordings: tuple[PreparedRecording, ...],
    vehicle: Vehicle,
    likelihood: str = "innovations",
    placed_effects: tuple[PlacedEffect, ...] = (),
) -> MapFit:
    """Find the mode of the posterior, with a residual autoregression estimated there.

    Parameters
    ----------
    recordings : tuple of PreparedRecording
        Recordings from :func:`bayes_asv.preprocessing.run_preparation.prepare_runs`.
    vehicle : Vehicle
        Gives the priors.
    likelihood : str
        ``innovations`` or ``output-error``.
    placed_effects : tuple of PlacedEffect
        Effects that the car and its sensors have; the innovations are then assumed to be white.

    Returns
    -------
    MapFit
        Its reasons say whether parameters are unidentified or the model explains too little.
    """
    shares: tuple[float | None, ...] = ()
    tight_noise_fit = None
    if likelihood == "innovations" and recordings[0].below is not None:
        mode, posterior, shares = fit_in_band(recordings, vehicle)
    elif placed_effects:
        mode, posterior, tight_noise_fit = _fit_with_effects(recordings, vehicle, placed_effects)
    else:
        mode, posterior = _fit_full_band(recordings, vehicle, likelihood)
    return replace(_check_fit(posterior, mode, shares), tight_noise_fit=tight_noise_fit)


def fit_near_declared_noise(found: MapFit, vehicle: Vehicle) -> MapFit:
    """Find the mode with noise levels near the declared ones and white innovations.

    Where the model lacks something, free noise levels grow until noise explains the misfit, and an
    autoregression gives the least weight to the frequencies that the model explains worst; the
    parameters then follow the rest of the spectrum.

    Parameters
    ----------
    found : MapFit
        From :func:`best_fit`, on the whole band.
    vehicle : Vehicle
        Gives the priors.
    """
    tight_noise_fit = found.tight_noise_fit or fit_linear_car(
        make_dataset(vehicle, found.space.recordings)
    )
    tight_mode = tight_noise_fit.mode
    mode = PosteriorMode(
        tight_mode.z, tight_mode.covariance, tight_mode.log_posterior, tight_mode.converged
    )
    return replace(_check_fit(tight_noise_fit.posterior, mode, ()), tight_noise_fit=tight_noise_fit)


def _check_fit(
    posterior: Posterior, mode: PosteriorMode, shares: tuple[float | None, ...]
) -> MapFit:
    """Check at the mode whether the data identify the parameters and the model explains them."""
    parameter_space = posterior.space
    # Where the search did not converge, the sampler decides.
    reasons, warnings = (
        unidentified_after_fit(parameter_space, mode) if mode.converged else ([], [])
    )
    faults: list[str] = []
    noise = {name: float(x[0]) for name, x in parameter_space.nuisance(mode.z[None]).items()}
    for run, recording in enumerate(parameter_space.recordings):
        free = free_run(posterior, mode.z, run)
        fit_reasons, notes = explained_power_findings(recording, free, bool(shares))
        if fit_reasons or notes:
            fit_reasons += band_advice(recording, free)
        faults += fit_reasons
        warnings += (
            notes
            + excess_noise_sentence(recording, noise, run)
            + _removed_tones_sentence(recording)
        )
        if shares:
            warnings += band_notes(recording, shares[run])
    return MapFit(posterior, mode, (*reasons, *faults), tuple(warnings), shares, tuple(faults))


def _fit_full_band(
    recordings: tuple[PreparedRecording, ...], vehicle: Vehicle, likelihood: str
) -> tuple[PosteriorMode, Posterior]:
    """Find the mode, remove tones, and find it again with a residual autoregression."""
    parameter_space = make_parameter_space(vehicle, recordings, likelihood)
    mode, posterior = find_mode_threaded(Posterior(parameter_space, (WHITE,) * len(recordings)))
    if likelihood != "innovations":
        return mode, posterior
    without_tones = _without_tones(posterior, mode, vehicle)
    if without_tones is not None:
        parameter_space = make_parameter_space(vehicle, without_tones, likelihood)
        mode, posterior = find_mode_threaded(
            Posterior(parameter_space, (WHITE,) * len(without_tones))
        )
    return _fit_with_residual_ar(posterior, mode, vehicle)


def _fit_with_effects(
    recordings: tuple[PreparedRecording, ...],
    vehicle: Vehicle,
    placed_effects: tuple[PlacedEffect, ...],
) -> tuple[PosteriorMode, Posterior, FittedModel]:
    """Find the mode of a model with effects and free noise levels.

    Also return the model with noise levels near the declared ones.
    """
    without_clocks = tuple(replace(recording, clock_variants=None) for recording in recordings)
    dataset, model = with_effects(make_dataset(vehicle, without_clocks), placed_effects)
    space = make_parameter_space(vehicle, recordings, placed_effects=model.placed_effects)
    retimed_corrections = _retimed_corrections(recordings, vehicle, model)
    posterior = Posterior(
        space,
        (WHITE,) * len(recordings),
        sensor_corrections=dataset.sensor_corrections,
        retimed_corrections=retimed_corrections,
    )
    start = model.transfer(space)
    start[space.shared_dimension :] = space.origin[space.shared_dimension :]
    with shared_work(posterior) as shared:
        return find_mode(shared, start), posterior, model


def _retimed_corrections(
    recordings: tuple[PreparedRecording, ...], vehicle: Vehicle, model: FittedModel
) -> tuple[tuple[SensorCorrections, ...], ...]:
    """Sensor corrections of each run's clock variants, from the prediction of a fitted model."""
    count = max(
        len(recording.clock_variants.recordings) if recording.clock_variants is not None else 0
        for recording in recordings
    )
    corrections = []
    for k in range(count):
        variants = tuple(
            replace(x, clock_variants=None)
            if x.clock_variants is None
            else x.clock_variants.recordings[k]
            for x in recordings
        )
        dataset = make_dataset(vehicle, variants)
        posterior = dataset.posterior(model.placed_effects)
        z = transfer_coordinates(model.space, model.mode.z, posterior.space, None, {})
        corrections.append(update_corrections_at(dataset, posterior, z).sensor_corrections)
    return tuple(zip(*corrections, strict=True)) if corrections else ()


def _removed_tones_sentence(recording: PreparedRecording) -> list[str]:
    """Say which tones were removed from a run."""
    if not recording.notches:
        return []
    tones = [f"{frequency:.0f}" for frequency in main_tones(recording.notches)]
    several = " and ".join([", ".join(tones[:-1]), tones[-1]] if len(tones) > 1 else tones)
    return [
        f"something shakes the frame at {several} Hz in {recording.source}, an engine perhaps; the "
        "motion at these frequencies was cut out of all channels"
    ]


def _without_tones(
    posterior: Posterior, mode: PosteriorMode, vehicle: Vehicle
) -> tuple[PreparedRecording, ...] | None:
    """Remove the tones of an engine from every run; None if there are none.

    Only accelerations are searched.  The residual of a nearly noise-free deflection or rate is not
    noise: if the fit is off by a ten-thousandth of a prior standard deviation, the residual has the
    spectrum of the car's own motion.  That falls by a factor of a hundred from 5 to 20 Hz, and a
    frequency on such a slope exceeds the median of its neighbours as a tone does.
    """
    out, any_found = [], False
    for run, recording in enumerate(posterior.space.recordings):
        nu = recording.paired(posterior.innovations(mode.z, run))
        accelerations, rate = nu[:, list(recording.accelerations)], 1.0 / recording.reading_step
        modes = own_modes(recording.car, vehicle.unsprung)
        tones = engine_tones(find_tones(accelerations, rate), [accelerations], rate, modes)
        any_found |= bool(tones)
        out.append(
            with_clock_variants(recording, partial(notched, notches=tones)) if tones else recording
        )
    return tuple(out) if any_found else None


def _fit_with_residual_ar(
    posterior: Posterior, mode: PosteriorMode, vehicle: Vehicle
) -> tuple[PosteriorMode, Posterior]:
    """Alternate between the residual autoregression and the mode until they settle.

    The noise levels of a run with an autoregression are fixed: free ones would grow, since the
    autoregression compensates for whatever filter they imply.
    """
    space = posterior.space
    residual_ars: tuple[ResidualAR, ...] = posterior.residual_ars
    for _ in range(_AR_ROUNDS):
        fitted = tuple(
            _residual_ar_of_run(posterior, mode, run)
            for run in range(len(posterior.space.recordings))
        )
        if all(c.order == 0 for c in (*fitted, *residual_ars)):
            break
        residual_ars = fitted
        fixed_runs = frozenset(run for run, c in enumerate(fitted) if c.order > 0)
        parameter_space = make_parameter_space(
            vehicle, space.recordings, space.likelihood, fixed_runs
        )
        start = parameter_space.origin
        start[: parameter_space.shared_dimension] = mode.z[: parameter_space.shared_dimension]
        mode, posterior = find_mode_threaded(Posterior(parameter_space, fitted), start)
    return mode, posterior


def _residual_ar_of_run(posterior: Posterior, mode: PosteriorMode, run: int) -> ResidualAR:
    """Autoregression of one run's innovations, scaled by the power that notches retained."""
    recording = posterior.space.recordings[run]
    fitted = fit_residual_ar(recording.paired(posterior.innovations(mode.z, run, WHITE)))
    if fitted.order == 0:
        return WHITE
    retained_power = (
        1.0 if recording.removed_band is None else recording.removed_band.retained_power
    )
    return fitted._replace(root=fitted.root * math.sqrt(retained_power))
