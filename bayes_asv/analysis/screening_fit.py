"""A quick fit of recordings, to check whether an input is consistent with them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from bayes_asv.domain.recording import Recording, nominal_rate
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.kalman import VALUE
from bayes_asv.models.cars import car_model
from bayes_asv.models.modes import nominal_modes
from bayes_asv.posterior.likelihood import WHITE, Posterior
from bayes_asv.posterior.newton import residual_functions
from bayes_asv.posterior.parameters import make_parameter_space
from bayes_asv.posterior.residual_ar import chance_factor, long_run_variance
from bayes_asv.preprocessing.activity import wheel_power
from bayes_asv.preprocessing.data_checks import dead_channels, min_sampling_rate
from bayes_asv.preprocessing.prepare import prepare
from bayes_asv.preprocessing.prepared_recording import PreparedRecording

__all__ = ["COARSE_STEPS", "STEPS", "ScreeningFit", "holds_throughout", "screening_fit"]

Array = NDArray[np.float64]

# Largest number of evaluations, for full and coarse fits; the right model needs six.
STEPS, COARSE_STEPS = 25, 6
# Bound on the dispersion, relative to that of noise that has passed the sensor's filter.
_MAX_DISPERSION = 2.0
_CHANCE = 0.05  # probability that a car at the bound exceeds it in any stretch
_MIN_POWER = 0.25  # least wheel power of a stretch, relative to the most active one
_FEWEST = 50  # least number of readings of an output in a stretch
# Noise factor above which the fit is repeated: the prior then has a noticeably larger weight.
_MORE_NOISE = 1.2


class ScreeningFit(NamedTuple):
    """A fit with declared noise levels, and its log posterior with scaled noise levels.

    Parameters
    ----------
    log_posterior : float
        Log posterior at the mode, not normalised, with all noise levels multiplied by one factor.
    noise_factor : float
        That factor, which makes the mean square of the normalised innovations one; at least one.
    dispersion : float
        Long-run variance of the innovations with declared noise levels, at least one.
    holds : bool
        Whether the dispersion is consistent with the declared noise.
    moved : dict of str to float
        Shifts of given values at the mode, in prior standard deviations.
    values : dict of str to float
        Parameters of the car at the mode, SI units.
    shared : (n,) array
        Coordinates of the car at the mode.
    """

    log_posterior: float
    noise_factor: float
    dispersion: float
    holds: bool
    moved: dict[str, float]
    values: dict[str, float]
    shared: Array


def screening_fit(
    recordings: Sequence[Recording], vehicle: Vehicle, car: str = "half", steps: int = STEPS
) -> ScreeningFit | None:
    """Fit recordings with declared noise levels.

    Return None if a channel is dead, or if the sampling rate is too low for the car.

    Parameters
    ----------
    recordings : sequence of Recording
        Runs of one car.
    vehicle : Vehicle
        The car as given.
    car : str
        Name of the car model.
    steps : int
        Largest number of evaluations.
    """
    model = car_model(car, vehicle)
    least = min_sampling_rate(nominal_modes(model))
    for recording in recordings:
        if nominal_rate(recording) < least or dead_channels(recording, vehicle, model):
            return None
    prepared = tuple(prepare(one, vehicle, model) for one in recordings)
    posterior = Posterior(make_parameter_space(vehicle, prepared), tuple(WHITE for _ in prepared))
    n = posterior.space.shared_dimension
    dimension = posterior.space.dimension

    def at(car_part: Array) -> Array:
        z = np.zeros(dimension)
        z[:n] = car_part
        return z

    residual, slopes = residual_functions(posterior, np.zeros(dimension), range(n))
    fit = least_squares(
        residual, np.zeros(n), slopes, bounds=(-20.0, 20.0), xtol=1e-4, ftol=1e-5, max_nfev=steps
    )
    z = at(fit.x)
    # with larger noise levels the prior has more weight, which moves the mode
    noise_factor, noisy = _noise_factor(posterior, z), z
    if noise_factor > _MORE_NOISE and steps > COARSE_STEPS:
        scale = np.append(np.full(fit.fun.size - n, noise_factor), np.ones(n))

        def scaled(part: Array) -> Array:
            return np.asarray(residual(part) / scale)

        def scaled_slopes(part: Array) -> Array:
            return np.asarray(slopes(part) / scale[:, None])

        refit = least_squares(
            scaled, fit.x, scaled_slopes, bounds=(-20.0, 20.0), xtol=1e-4, ftol=1e-5,
            max_nfev=steps,
        )  # fmt: skip
        noisy = at(refit.x)
        noise_factor = _noise_factor(posterior, noisy)
    value = float(posterior.log_posterior(noisy[None])[0])
    if not math.isfinite(value):
        return None
    count, square = _count_and_square(posterior, noisy)
    value += 0.5 * square * (1.0 - noise_factor**-2) - count * math.log(noise_factor)
    values = {name: float(x[0]) for name, x in posterior.space.values(z[None]).items()}
    moved = {}
    for p in model.parameters:
        if p.kind == "fraction":
            sd = p.terms[0][2]
            moved[p.name] = (values[p.name] - p.nominal) / sd if sd > 0.0 else 0.0
        elif p.kind == "given":
            sd = math.sqrt(sum((c * sd) ** 2 for _, c, sd in p.terms))
            moved[p.name] = math.log(values[p.name] / p.nominal) / sd if sd > 0.0 else 0.0
    variances = [
        long_run_variance(posterior.innovations(z, run), one.kind == VALUE, one.instants)
        for run, one in enumerate(prepared)
    ]
    dispersion = max(1.0, *variances)
    holds = dispersion < _MAX_DISPERSION * max(_filtered_noise_variance(one) for one in prepared)
    return ScreeningFit(value, noise_factor, dispersion, holds, moved, values, fit.x)


def holds_throughout(
    fit: ScreeningFit, recording: Recording, vehicle: Vehicle, car: str, seconds: float
) -> bool:
    """Whether a fit to a stretch of a recording explains the rest of it as well.

    Parameters
    ----------
    fit : ScreeningFit
        Fit to the stretch in which the wheels move most.
    recording : Recording
        The whole recording, with enough readings of every channel.
    vehicle, car : Vehicle and str
        As for :func:`screening_fit`.
    seconds : float
        Length of a stretch.  Those with less than `_MIN_POWER` of the wheel power of the most
        active one are left out: the errors of a converter at rest are not noise.

    Returns
    -------
    bool
    """
    model = car_model(car, vehicle)
    prepared = prepare(recording, vehicle, model)
    posterior = Posterior(make_parameter_space(vehicle, (prepared,)), (WHITE,))
    z = np.zeros(posterior.space.dimension)
    z[: len(fit.shared)] = fit.shared
    innovations, use = posterior.innovations(z, 0), prepared.kind == VALUE
    power = np.interp(prepared.instants, recording.time, wheel_power(recording, vehicle))
    first, last = float(prepared.instants[0]), float(prepared.instants[-1])
    count = max(round((last - first) / seconds), 1)
    edges = np.searchsorted(prepared.instants, np.linspace(first, last, count + 1))
    stretches = [slice(*ends) for ends in pairwise(edges)]
    powers = [float(np.mean(power[rows])) for rows in stretches]
    active_stretches = [
        rows
        for rows, mean_power in zip(stretches, powers, strict=True)
        if mean_power > _MIN_POWER * max(powers)
        and np.all(np.count_nonzero(use[rows], axis=0) > _FEWEST)
    ]
    # one of many stretches exceeds the bound by chance, so it has to do so significantly
    level = _CHANCE / max(len(active_stretches) * use.shape[1], 1)
    return all(
        long_run_variance(innovations[rows], use[rows], prepared.instants[rows])
        < _MAX_DISPERSION
        * _filtered_noise_variance(prepared)
        * chance_factor(use[rows], prepared.instants[rows], level)
        for rows in active_stretches
    )


def _count_and_square(posterior: Posterior, z: Array) -> tuple[int, float]:
    """Count the normalised innovations of all runs, and sum their squares."""
    innovations = np.concatenate(
        [posterior.innovations(z, run).ravel() for run in range(len(posterior.space.recordings))]
    )
    has_reading = np.isfinite(innovations) & (innovations != 0.0)
    return int(np.count_nonzero(has_reading)), float(np.sum(innovations[has_reading] ** 2))


def _noise_factor(posterior: Posterior, z: Array) -> float:
    """Root mean square of the normalised innovations, at least one."""
    count, square = _count_and_square(posterior, z)
    return math.sqrt(max(1.0, square / max(count, 1)))


def _filtered_noise_variance(recording: PreparedRecording) -> float:
    """Long-run variance of noise that has passed the outputs' filters, over that of white noise."""
    step = float(np.median(np.diff(recording.times[0])))
    poles = recording.poles[list(recording.outputs)]
    correlation = np.exp(-poles[poles > 0.0] * step)
    return float(np.max((1.0 + correlation) / (1.0 - correlation), initial=1.0))
