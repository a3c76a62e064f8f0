"""Unknown offsets and drifts of clocks: a search over the whole prior, then a local expansion.

The log-likelihood is not a simple function of a shift of some channels in time, and where the
motion is nearly periodic it may have several maxima.  The recording is therefore prepared with
offsets on a grid over three prior standard deviations to either side, and the car is fitted at each
of them.  With n readings, S the sum of squared innovations and φ their long-run variance, the
profile is

    ℓ = −n/(2φ) log S + log prior.

Each of its maxima is refined: the recording is prepared at that offset and at neighbouring ones
(:class:`bayes_asv.preprocessing.prepared_recording.ClockVariants`).  The log-likelihood is
interpolated between them by a polynomial of second degree, so that clock errors become parameters
like all others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from bayes_asv.domain.clocks import Clock, with_declared_clock_error
from bayes_asv.domain.recording import Recording, sample_times
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.kalman import VALUE
from bayes_asv.models.cars import car_model
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.posterior.likelihood import WHITE, Posterior
from bayes_asv.posterior.map_fit import MapFit, best_fit
from bayes_asv.posterior.parameters import make_parameter_space
from bayes_asv.posterior.residual_ar import long_run_variance
from bayes_asv.preprocessing.activity import cut, most_active_rows
from bayes_asv.preprocessing.prepare import used_channels
from bayes_asv.preprocessing.prepared_recording import (
    ClockError,
    ClockVariants,
    PreparedRecording,
    common_readings,
)
from bayes_asv.preprocessing.run_preparation import prepare_runs

__all__ = ["ClockAlignment", "OffsetMode", "align_clocks", "fit_aligned"]

Array = NDArray[np.float64]

_SEARCH_RANGE = 3.0  # half width of the search, prior standard deviations
# Spacing of the search grid, s: half the width of a maximum of the profile, which is about
# 1/(2π 20 Hz) = 8 ms for the fastest motion that a suspension transmits to the body.
_SPACING = 0.004
_EVALUATIONS = 8  # largest number of function evaluations of a fit at a grid point
_SEARCH_SECONDS = 10.0  # length of the most active stretch that is used for the search
_FIRST_STEP = 0.001  # distance of the points of the first expansion, s: 0.13 rad at 20 Hz
_STEP = 1.5  # distance of the points of the last expansion, posterior sd
_NARROWEST, _WIDEST = 0.6, 4.0  # range in which that distance is accepted, posterior sd
_ROUNDS = 6  # largest number of expansions
_MAX_MODES = 3  # largest number of maxima that are refined
_MODE_DEPTH = 8.0  # depth below the highest maximum to which maxima are refined, nats
# Probability above which a further mode is reported: one tail of a 95 % interval.
_REPORTED = 0.025


class OffsetMode(NamedTuple):
    """A maximum of the profile of one run.

    Parameters
    ----------
    errors : tuple of ClockError
        The unknown clock errors, K of them.
    value, sd : (K,) arrays
        Errors at the mode, and their posterior standard deviations.
    probability : float
        Share of the profile's weight among all modes of the run.
    fit : MapFit
        Fit of the run alone.
    """

    errors: tuple[ClockError, ...]
    value: Array
    sd: Array
    probability: float
    fit: MapFit


@dataclass(frozen=True)
class ClockAlignment:
    """Recordings with aligned clocks.

    Parameters
    ----------
    prepared : tuple of PreparedRecording
        Recordings prepared for a fit with clock errors among its parameters.
    recordings : tuple of Recording
        Recordings with the clock errors at the mode declared in their metadata.
    modes : tuple of tuple of OffsetMode
        Modes of each run, the most probable first; empty for a run without unknown clock errors.
    jobs : tuple of _Job
        How each run is prepared.
    """

    jobs: tuple[_Job, ...]
    prepared: tuple[PreparedRecording, ...]
    recordings: tuple[Recording, ...]
    modes: tuple[tuple[OffsetMode, ...], ...]

    @property
    def ambiguity(self) -> str | None:
        """Sentence about runs with more than one possible offset; None if there are none."""
        for recording, modes in zip(self.prepared, self.modes, strict=True):
            rivals = [m for m in modes[1:] if m.probability > _REPORTED]
            if rivals:
                descriptions = [_describe(m) for m in (modes[0], *rivals)]
                return (
                    f"the offset of a clock in {recording.source} is ambiguous: "
                    f"{' or '.join(descriptions)}; "
                    "the estimate uses the first; give the offset in [clocks] with its sd, or "
                    "record a single sharp bump"
                )
        return None


@dataclass(frozen=True)
class _Job:
    """One run, and how it is prepared and fitted."""

    recording: Recording
    vehicle: Vehicle
    clocks: tuple[Clock, ...]
    errors: tuple[ClockError, ...]
    below: float | None
    car: str
    likelihood: str

    @property
    def centre(self) -> Array:
        return np.array([error.centre for error in self.errors])

    @property
    def sd(self) -> Array:
        return np.array([error.sd for error in self.errors])

    def at(self, x: Array) -> Recording:
        """Return the recording with clock errors (K,) declared."""
        known = {(e.clock, e.kind): float(v) for e, v in zip(self.errors, x, strict=True)}
        out = self.recording
        for clock in self.clocks:
            offset = known.get((clock.name, "offset"), clock.offset)
            drift = known.get((clock.name, "drift"), clock.drift)
            out = with_declared_clock_error(out, self.vehicle, clock, offset, drift)
        return out

    @property
    def active(self) -> _Job:
        """Job for the stretch in which the wheels move most; at full bandwidth only."""
        recording = self.recording
        if self.below is not None:
            return self
        rows = most_active_rows(recording, self.vehicle, _SEARCH_SECONDS)
        return replace(self, recording=cut(recording, rows))

    def prepared(self, points: Sequence[Array]) -> list[PreparedRecording]:
        """Prepare the run with several sets of clock errors, with the same readings in each."""
        copies = self._inside([self.at(x) for x in points])
        recordings, _, _ = prepare_runs(copies, self.vehicle, self.below, self.car)
        return common_readings(recordings)

    def _inside(self, copies: list[Recording]) -> list[Recording]:
        """Remove output readings outside the time span of the inputs in any of the copies.

        In a band, the output grid then starts at the same reading in all copies.
        """
        used = used_channels(self.recording, self.vehicle, car_model(self.car, self.vehicle))
        inputs = [c for c in used if self.vehicle.channel(self.recording.channels[c]).is_input]
        outside = np.zeros(self.recording.values.shape, bool)
        for copy in copies:
            times = sample_times(copy, self.vehicle)
            first, last = times[inputs, 0].max(), times[inputs, -1].min()
            outside |= (times < first) | (times > last)
        outside[inputs] = False
        values = np.where(outside, np.nan, self.recording.values)
        return [replace(copy, values=values) for copy in copies]

    def expanded(self, x: Array, step: Array) -> PreparedRecording:
        """Prepare the run at clock errors x, with variants around them."""
        points = [x, *(x + step * u for u in ClockVariants.points(len(x)))]
        middle, *others = self.prepared(points)
        return replace(middle, clock_variants=ClockVariants(self.errors, x, step, tuple(others)))


def align_clocks(
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    clocks: Sequence[Clock],
    below: float | None = None,
    car: str = "half",
    likelihood: str = "innovations",
) -> ClockAlignment:
    """Find the offsets and drifts of clocks, and prepare recordings with variants around them.

    Parameters
    ----------
    recordings : sequence of Recording
        Runs that passed :func:`bayes_asv.preprocessing.run_preparation.prepare_runs`.
    vehicle, below, car, likelihood
        As for :func:`bayes_asv.estimation.estimate`.
    clocks : sequence of Clock
        Clocks, with the priors of their errors.

    Returns
    -------
    ClockAlignment
    """
    jobs = [
        _Job(
            recording, vehicle, tuple(clocks), _unknown_errors(recording, vehicle, clocks, car),
            below, car, likelihood,
        )
        for recording in recordings
    ]  # fmt: skip
    modes = tuple(_find_modes(job) if job.errors else () for job in jobs)
    drift = _common_drift(modes)
    prepared, aligned = [], []
    for job, modes_of_run in zip(jobs, modes, strict=True):
        if not modes_of_run:
            one, *_ = job.prepared([job.centre])
            prepared.append(one)
            aligned.append(job.at(job.centre))
            continue
        best = modes_of_run[0]
        x = np.array(
            [
                drift[e.clock] if e.kind == "drift" else v
                for e, v in zip(job.errors, best.value, strict=True)
            ]
        )
        prepared.append(job.expanded(x, _STEP * best.sd))
        aligned.append(job.at(x))
    return ClockAlignment(tuple(jobs), tuple(prepared), tuple(aligned), modes)


def fit_aligned(alignment: ClockAlignment, placed_effects: tuple[PlacedEffect, ...] = ()) -> MapFit:
    """Fit all runs together, and expand the likelihood again if its mode has moved.

    Parameters
    ----------
    alignment : ClockAlignment
        Recordings with aligned clocks.
    placed_effects : tuple of PlacedEffect
        Effects that the car and its sensors have.
    """
    first = alignment.jobs[0]
    if len(alignment.jobs) == 1 and alignment.modes[0] and not placed_effects:
        return alignment.modes[0][0].fit
    recordings = alignment.prepared
    for _ in range(_ROUNDS):
        fit = best_fit(recordings, first.vehicle, first.likelihood, placed_effects)
        converged, out = True, []
        for run, (job, recording) in enumerate(zip(alignment.jobs, recordings, strict=True)):
            if recording.clock_variants is not None:
                x, step, adequate = _next_expansion(
                    recording.clock_variants.middle,
                    recording.clock_variants.step,
                    *_at_mode(fit, run),
                )
                converged &= adequate
                recording = job.expanded(x, step)
            out.append(recording)
        if converged:
            break
        recordings = tuple(out)
    return fit


def _unknown_errors(
    recording: Recording, vehicle: Vehicle, clocks: Sequence[Clock], car: str
) -> tuple[ClockError, ...]:
    """List unknown errors of the clocks that stamp some, but not all, of the used channels."""
    used = used_channels(recording, vehicle, car_model(car, vehicle))
    names = [recording.channels[c] for c in used]
    out = []
    for clock in clocks:
        stamped = [name for name in names if name in clock.channels]
        if not 0 < len(stamped) < len(names):
            continue
        if clock.offset_sd > 0.0:
            out.append(ClockError(clock.name, "offset", clock.offset, clock.offset_sd))
        if clock.drift_sd > 0.0:
            out.append(ClockError(clock.name, "drift", clock.drift, clock.drift_sd))
    return tuple(out)


def _find_modes(job: _Job) -> tuple[OffsetMode, ...]:
    """Find the modes of one run, the most probable first."""
    starts = [job.centre]
    for k, error in enumerate(job.errors):
        if error.kind == "offset":  # one clock after another, starting from the best offsets so far
            count = 2 * math.ceil(_SEARCH_RANGE * error.sd / _SPACING) + 1
            grid = error.centre + error.sd * np.linspace(-_SEARCH_RANGE, _SEARCH_RANGE, count)
            points = [np.where(np.arange(len(job.errors)) == k, g, starts[0]) for g in grid]
            level = _profile(job, points)
            maxima = _maxima(level)
            starts = [points[j] for j in maxima if level[j] > level[maxima[0]] - _MODE_DEPTH][
                :_MAX_MODES
            ]
    refined = [_refine_mode(job, start) for start in starts]
    distinct = [refined[0]]
    for other in refined[1:]:
        if all(_are_distinct(other, one) for one in distinct):
            distinct.append(other)
    if len(distinct) == 1:
        return (distinct[0]._replace(probability=1.0),)
    level = _profile(job, [one.value for one in distinct])
    weight = np.exp(level - level.max())
    weight /= weight.sum()
    weighted = [one._replace(probability=float(w)) for one, w in zip(distinct, weight, strict=True)]
    return tuple(sorted(weighted, key=lambda one: -one.probability))


def _maxima(level: Array) -> list[int]:
    """Local maxima of a profile, the highest first."""
    padded = np.concatenate([[-np.inf], level, [-np.inf]])
    top = np.flatnonzero((padded[1:-1] >= padded[:-2]) & (padded[1:-1] > padded[2:]))
    return sorted(top.tolist(), key=lambda j: -level[j])


def _are_distinct(one: OffsetMode, other: OffsetMode) -> bool:
    """Whether two modes are more than three standard deviations apart."""
    return bool(np.any(np.abs(one.value - other.value) > 3.0 * np.maximum(one.sd, other.sd)))


def _profile(job: _Job, points: Sequence[Array]) -> Array:
    """Profile log-likelihood ℓ of one run at clock errors."""
    squares, dispersion = [], []
    recordings = job.active.prepared(points)
    for recording in recordings:
        fit = _least_squares(job, recording, ())
        squares.append(fit.squares)
        dispersion.append(fit.dispersion)
    best = int(np.argmin(squares))
    z = (np.array(points) - job.centre) / job.sd
    weight = 0.5 * recordings[best].readings / max(dispersion[best], 1.0)
    return np.asarray(-weight * np.log(squares) - 0.5 * np.sum(z**2, axis=1))


class _LeastSquaresFit(NamedTuple):
    """A least-squares fit with the noise levels at the centre of their prior.

    Parameters
    ----------
    squares : float
        Sum of squared innovations and coordinates.
    dispersion : float
        Long-run variance of the innovations over their variance.
    errors, error_sd : (K,) arrays
        Estimates of the clock errors, and their standard deviations.
    """

    squares: float
    dispersion: float
    errors: Array
    error_sd: Array


def _least_squares(
    job: _Job, recording: PreparedRecording, clocks: Sequence[int]
) -> _LeastSquaresFit:
    """Fit the car, and the clock errors with the given indices, to one run."""
    kind = job.likelihood
    if kind == "innovations" and any(noise is None for noise in recording.noise):
        kind = "coloured"  # without declared noise, residuals are not taken for sensor noise
    posterior = Posterior(make_parameter_space(job.vehicle, (recording,), kind), (WHITE,))
    parameter_space = posterior.space
    every = parameter_space.clock_coordinates(0)
    free = [*range(parameter_space.shared_dimension), *(every[k] for k in clocks)]
    scale = parameter_space.scales(1.0)[free]

    def at(x: Array) -> Array:
        z = parameter_space.origin
        z[free] += scale * x
        return z

    def residual(x: Array) -> Array:
        z = at(x)
        both = np.concatenate([posterior.innovations(z, 0).ravel(), z])
        return np.asarray(np.nan_to_num(both, nan=1e6, posinf=1e6, neginf=-1e6))

    fit = least_squares(
        residual, np.zeros(len(free)), bounds=(-7.0, 7.0), xtol=1e-4, ftol=1e-5,
        max_nfev=_EVALUATIONS,
    )  # fmt: skip
    z = at(fit.x)
    use = recording.kind == VALUE
    nu = posterior.innovations(z, 0)
    variance = float(np.mean(nu[use] ** 2))
    spread = long_run_variance(nu, use, recording.instants)
    covariance = np.linalg.pinv(np.asarray(fit.jac).T @ np.asarray(fit.jac))
    sd = scale * np.sqrt(max(variance, spread) * np.diag(covariance))
    return _LeastSquaresFit(
        2.0 * float(fit.cost),
        spread / variance,
        parameter_space.clock_errors(z[None], 0)[0],
        np.array(
            [parameter_space.coordinates[k].scale * sd[free.index(k)] for k in every if k in free]
        ),
    )


def _refine_mode(job: _Job, start: Array) -> OffsetMode:
    """Expand the likelihood around its mode until the mode lies within the expansion."""
    span = float(job.recording.time[-1] - job.recording.time[0])
    first = [_FIRST_STEP if e.kind == "offset" else 2.0 * _FIRST_STEP / span for e in job.errors]
    x, step = start, np.minimum(first, job.sd)
    every = range(len(job.errors))
    for _ in range(_ROUNDS):
        fit_to_clocks = _least_squares(job, job.expanded(x, step), every)
        x, step, converged = _next_expansion(
            x, step, fit_to_clocks.errors, np.minimum(fit_to_clocks.error_sd, job.sd)
        )
        if converged:
            break
    for _ in range(_ROUNDS):
        fit = best_fit((job.expanded(x, step),), job.vehicle, job.likelihood)
        value, sd = _at_mode(fit, 0)
        x, step, converged = _next_expansion(x, step, value, sd)
        if converged:
            break
    return OffsetMode(job.errors, value, sd, 1.0, fit)


def _next_expansion(x: Array, step: Array, value: Array, sd: Array) -> tuple[Array, Array, bool]:
    """Return centre and step of the next expansion, and whether the last one was adequate."""
    is_inside = np.abs(value - x) <= step
    adequate = bool(np.all(is_inside & (step <= _WIDEST * sd) & (step >= _NARROWEST * sd)))
    new = np.clip(_STEP * sd, 0.1 * step, 3.0 * step)
    return x + np.clip(value - x, -3.0 * step, 3.0 * step), new, adequate


def _at_mode(fit: MapFit, run: int) -> tuple[Array, Array]:
    """Clock errors (K,) of a run at the mode of a fit, and their standard deviations."""
    value = fit.space.clock_errors(fit.mode.z[None], run)[0]
    picked = fit.space.clock_coordinates(run)
    scale = np.array([fit.space.coordinates[k].scale for k in picked])
    return value, scale * fit.mode.sd[picked]


def _common_drift(modes: Sequence[Sequence[OffsetMode]]) -> dict[str, float]:
    """Mean drift of each clock over all runs, weighted by inverse variance."""
    total: dict[str, float] = {}
    weight: dict[str, float] = {}
    for modes_of_run in modes:
        for error, value, sd in zip(*modes_of_run[0][:3], strict=True) if modes_of_run else ():
            if error.kind == "drift":
                total[error.clock] = total.get(error.clock, 0.0) + value / sd**2
                weight[error.clock] = weight.get(error.clock, 0.0) + 1.0 / sd**2
    return {name: total[name] / weight[name] for name in total}


def _describe(mode: OffsetMode) -> str:
    parts = [
        f"{error.clock} sampled {1e3 * abs(value):.2g} ms "
        f"{'later' if value > 0.0 else 'earlier'} than stamped"
        for error, value in zip(mode.errors, mode.value, strict=True)
        if error.kind == "offset"
    ]
    return f"{', '.join(parts)} (probability {mode.probability:.2g})"
