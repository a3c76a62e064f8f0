"""From recordings to the posterior's mode: what every kind of answer begins with."""

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
    excess_noise_sentence,
    explained_power_findings,
    model_bandwidth,
)
from bayes_asv.posterior.fitted_model import (
    FittedModel,
    fit_linear_car,
    make_dataset,
    transfer_coordinates,
    update_corrections_at,
)
from bayes_asv.posterior.free_simulation import free_run, unexplained_in_band
from bayes_asv.posterior.identifiability import unidentified_after_fit
from bayes_asv.posterior.likelihood import WHITE, Posterior, ResidualAR, shared_work
from bayes_asv.posterior.newton import PosteriorMode, find_mode
from bayes_asv.posterior.parameters import ParameterSpace, make_parameter_space
from bayes_asv.posterior.residual_ar import fit_residual_ar
from bayes_asv.preprocessing.data_checks import (
    suggest_band,
)
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

_COLOUR_ROUNDS = 3


@dataclass(frozen=True)
class MapFit:
    """The mode of a posterior, and whether the data can answer at all.

    Parameters
    ----------
    posterior : Posterior
        The posterior with the colour of each run's innovations.
    mode : Mode
        Its mode and curvature.
    reasons, warnings : tuple of str
        Why no answer may be given; what to know otherwise.
    misfit_reasons : tuple of str
        Those of the reasons that say that a recording is not of this car.
    shares : tuple of float or None
        In a band, the share of its readings that each run counts for; see
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
    """Find the mode of the posterior, with the residual autoregression of the innovations there.

    Parameters
    ----------
    recordings : tuple of PreparedRecording
        Recordings that passed :func:`prepare_runs`.
    vehicle : Vehicle
        Gives the priors.
    likelihood : str
        ``innovations`` or ``output-error``.
    placed_effects : tuple of PlacedEffect
        Effects that the car and its sensors have; innovations are then taken to be white.

    Returns
    -------
    MapFit
        Its reasons say when the mode answers nothing or explains too little.
    """
    shares: tuple[float | None, ...] = ()
    near = None
    if likelihood == "innovations" and recordings[0].below is not None:
        mode, posterior, shares = fit_in_band(recordings, vehicle)
    elif placed_effects:
        mode, posterior, near = _with_effects(recordings, vehicle, placed_effects)
    else:
        mode, posterior = _at_full_band(recordings, vehicle, likelihood)
    return replace(_judged(posterior, mode, shares), tight_noise_fit=near)


def fit_near_declared_noise(found: MapFit, vehicle: Vehicle) -> MapFit:
    """Climb to the mode with noise levels near the declared ones and white innovations.

    Where the model lacks something, noise levels that are free swell until it is noise, and a
    colour gives the parts of the spectrum that the model explains worst the least weight; the
    parameters then follow the rest of it.

    Parameters
    ----------
    found : MapFit
        From :func:`best_fit`, on the whole band.
    vehicle : Vehicle
        Gives the priors.
    """
    near = found.tight_noise_fit or fit_linear_car(make_dataset(vehicle, found.space.recordings))
    top = near.mode
    mode = PosteriorMode(top.z, top.covariance, top.log_posterior, top.converged)
    return replace(_judged(near.posterior, mode, ()), tight_noise_fit=near)


def _judged(posterior: Posterior, mode: PosteriorMode, shares: tuple[float | None, ...]) -> MapFit:
    """Check whether the data identify the parameters and the model explains them, at the mode."""
    parameter_space = posterior.space
    # Where the search did not converge, the sampler decides.
    reasons, warnings = (
        unidentified_after_fit(parameter_space, mode) if mode.converged else ([], [])
    )
    faults: list[str] = []
    noise = {name: float(x[0]) for name, x in parameter_space.nuisance(mode.z[None]).items()}
    for run, recording in enumerate(parameter_space.recordings):
        free = free_run(posterior, mode.z, run)
        why, notes = explained_power_findings(recording, free, bool(shares))
        if recording.below is None and (why or notes):
            top = model_bandwidth(recording)
            why += suggest_band(recording, unexplained_in_band(recording, free, top) ** 2, top)
        faults += why
        warnings += notes + excess_noise_sentence(recording, noise, run) + _cut_out(recording)
        if shares:
            warnings += band_notes(recording, shares[run])
    return MapFit(posterior, mode, (*reasons, *faults), tuple(warnings), shares, tuple(faults))


def _at_full_band(
    recordings: tuple[PreparedRecording, ...], vehicle: Vehicle, likelihood: str
) -> tuple[PosteriorMode, Posterior]:
    """Climb to the mode, cut tones out, and climb again with the colour that is left."""
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
    return _with_colour(posterior, mode, vehicle)


def _with_effects(
    recordings: tuple[PreparedRecording, ...],
    vehicle: Vehicle,
    placed_effects: tuple[PlacedEffect, ...],
) -> tuple[PosteriorMode, Posterior, FittedModel]:
    """Climb to the mode of a model with effects, its noise levels free.

    Returns the model with noise levels near the declared ones as well.
    """
    alone = tuple(replace(recording, clock_variants=None) for recording in recordings)
    dataset, model = with_effects(make_dataset(vehicle, alone), placed_effects)
    whole = make_parameter_space(vehicle, recordings, placed_effects=model.placed_effects)
    others = _retimed_patterns(recordings, vehicle, model)
    posterior = Posterior(
        whole,
        (WHITE,) * len(recordings),
        sensor_corrections=dataset.sensor_corrections,
        retimed_corrections=others,
    )
    start = model.transfer(whole)
    start[whole.shared_dimension :] = whole.origin[whole.shared_dimension :]
    with shared_work(posterior) as shared:
        return find_mode(shared, start), posterior, model


def _retimed_patterns(
    recordings: tuple[PreparedRecording, ...], vehicle: Vehicle, model: FittedModel
) -> tuple[tuple[SensorCorrections, ...], ...]:
    """Patterns of each run at other errors of its clocks, by what a fitted model predicts."""
    count = max(
        len(recording.clock_variants.recordings) if recording.clock_variants is not None else 0
        for recording in recordings
    )
    found = []
    for k in range(count):
        there = tuple(
            replace(x, clock_variants=None)
            if x.clock_variants is None
            else x.clock_variants.recordings[k]
            for x in recordings
        )
        dataset = make_dataset(vehicle, there)
        posterior = dataset.posterior(model.placed_effects)
        z = transfer_coordinates(model.space, model.mode.z, posterior.space, None, {})
        found.append(update_corrections_at(dataset, posterior, z).sensor_corrections)
    return tuple(zip(*found, strict=True)) if found else ()


def _cut_out(recording: PreparedRecording) -> list[str]:
    """Say which tones were cut out of a run."""
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
    """Cut the tones of an engine out of every run; None where there are none.

    They are looked for in accelerations alone.  What is left of a deflection or a rate that is
    read next to exactly is no noise: a fit that is off by a ten-thousandth of a prior deviation
    leaves the spectrum of the car's own motion, which falls by a factor of a hundred from 5 to
    20 Hz, and a line on that slope stands out of the median of its neighbours as a tone does.
    """
    out, any_found = [], False
    for run, recording in enumerate(posterior.space.recordings):
        nu = recording.paired(posterior.innovations(mode.z, run))
        used, rate = nu[:, list(recording.accelerations)], 1.0 / recording.reading_step
        modes = own_modes(recording.car, vehicle.unsprung)
        tones = engine_tones(find_tones(used, rate), [used], rate, modes)
        any_found |= bool(tones)
        out.append(
            with_clock_variants(recording, partial(notched, notches=tones)) if tones else recording
        )
    return tuple(out) if any_found else None


def _with_colour(
    posterior: Posterior, mode: PosteriorMode, vehicle: Vehicle
) -> tuple[PosteriorMode, Posterior]:
    """Look at the colour of what is left, and climb again until it settles.

    Under a colour a run's noise levels are held: left free they swell, since a colour makes
    good for whatever filter they stand for.
    """
    whole = posterior.space
    colours: tuple[ResidualAR, ...] = posterior.residual_ars
    for _ in range(_COLOUR_ROUNDS):
        found = tuple(
            _colour_of(posterior, mode, run) for run in range(len(posterior.space.recordings))
        )
        if all(c.order == 0 for c in (*found, *colours)):
            break
        colours = found
        hold = frozenset(run for run, c in enumerate(found) if c.order > 0)
        parameter_space = make_parameter_space(vehicle, whole.recordings, whole.likelihood, hold)
        start = parameter_space.origin
        start[: parameter_space.shared_dimension] = mode.z[: parameter_space.shared_dimension]
        mode, posterior = find_mode_threaded(Posterior(parameter_space, found), start)
    return mode, posterior


def _colour_of(posterior: Posterior, mode: PosteriorMode, run: int) -> ResidualAR:
    """Colour of one run's innovations, scaled for what a filter took out of them."""
    recording = posterior.space.recordings[run]
    found = fit_residual_ar(recording.paired(posterior.innovations(mode.z, run, WHITE)))
    if found.order == 0:
        return WHITE
    left = 1.0 if recording.removed_band is None else recording.removed_band.retained_power
    return found._replace(root=found.root * math.sqrt(left))
