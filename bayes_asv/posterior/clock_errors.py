"""Unknown offsets and drifts of clocks: a search over the whole prior, then a local expansion.

A shift of some channels in time changes the likelihood in no simple way, and where the motion is
nearly periodic the likelihood may have several maxima.  The recording is therefore prepared with
offsets on a grid over three prior deviations to either side, and the car fitted to each.  With n
readings, S the sum of squared innovations and φ their long-run variance, the profile is

    ℓ = −n/(2φ) log S + log prior.

Each of its maxima is refined: the recording is prepared at that offset and at neighbouring ones
(:class:`bayes_asv.preprocessing.prepared_recording.ClockVariants`), between which the
likelihood is a polynomial of second degree, so that the errors become parameters like all others.
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

_REACH = 3.0  # prior deviations to either side that are searched
# Maxima of the profile are as wide as the phase of the fastest motion that suspensions pass to the
# body allows: 1/(2π 20 Hz) is 8 ms, and a grid of half of that meets each of them.
_SPACING = 0.004  # s
_EVALUATIONS = 8  # of the Jacobian, a point of the grid
_LIVELY = 10.0  # s of a recording that are enough for a search
_FIRST_STEP = 0.001  # s, of the first expansion: an eighth of a turn at 20 Hz
_STEP = 1.5  # posterior deviations between the points of the last expansion,
_NARROWEST, _WIDEST = 0.6, 4.0  # and between which this may lie
_ROUNDS = 6
_MOST_MODES = 3
_KEPT = 8.0  # nats below the best up to which a maximum of the profile is refined
_REPORTED = 0.025  # probability from which a second mode is reported: a tail of an interval


class OffsetMode(NamedTuple):
    """A maximum of the profile of one run.

    Parameters
    ----------
    errors : tuple of ClockError
        What is unknown.
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
    """Recordings whose clocks have been compared.

    Parameters
    ----------
    prepared : tuple of PreparedRecording
        Ready for a fit with the errors of the clocks among its parameters.
    recordings : tuple of Recording
        The same with the errors at the mode declared in their metadata.
    modes : tuple of tuple of OffsetMode
        Of each run, the most probable first; empty for a run without an unknown error.
    jobs : tuple of _Job
        How each run is prepared.
    """

    jobs: tuple[_Job, ...]
    prepared: tuple[PreparedRecording, ...]
    recordings: tuple[Recording, ...]
    modes: tuple[tuple[OffsetMode, ...], ...]

    @property
    def ambiguity(self) -> str | None:
        """Sentence about runs with more than one possible offset; None where there are none."""
        for recording, modes in zip(self.prepared, self.modes, strict=True):
            rivals = [m for m in modes[1:] if m.probability > _REPORTED]
            if rivals:
                found = [_words(m) for m in (modes[0], *rivals)]
                return (
                    f"the offset of a clock in {recording.source} is ambiguous: "
                    f"{' or '.join(found)}; "
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
        """Return the recording with errors (K,) declared."""
        known = {(e.clock, e.kind): float(v) for e, v in zip(self.errors, x, strict=True)}
        out = self.recording
        for clock in self.clocks:
            offset = known.get((clock.name, "offset"), clock.offset)
            drift = known.get((clock.name, "drift"), clock.drift)
            out = with_declared_clock_error(out, self.vehicle, clock, offset, drift)
        return out

    @property
    def lively(self) -> _Job:
        """The same for the stretch of the recording in which the wheels move most, at full band."""
        recording = self.recording
        if self.below is not None:
            return self
        rows = most_active_rows(recording, self.vehicle, _LIVELY)
        return replace(self, recording=cut(recording, rows))

    def prepared(self, points: Sequence[Array]) -> list[PreparedRecording]:
        """Prepare the run at several errors, with the same readings at all of them."""
        copies = self._inside([self.at(x) for x in points])
        recordings, _, _ = prepare_runs(copies, self.vehicle, self.below, self.car)
        return common_readings(recordings)

    def _inside(self, copies: list[Recording]) -> list[Recording]:
        """Leave out outputs that lie outside the time of the inputs in one of the copies.

        In a band the grid then begins with the same reading of an output in each of them.
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
        """Prepare the run at errors x and around them."""
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
    """Find the offsets and drifts of clocks, and prepare recordings around them.

    Parameters
    ----------
    recordings : sequence of Recording
        Runs that passed :func:`bayes_asv.posterior.map_fit.prepare_runs`.
    vehicle, below, car, likelihood
        As for :func:`bayes_asv.estimation.estimate`.
    clocks : sequence of Clock
        Clocks with the priors of their errors.

    Returns
    -------
    ClockAlignment
    """
    jobs = [
        _Job(
            recording, vehicle, tuple(clocks), _unknown(recording, vehicle, clocks, car),
            below, car, likelihood,
        )
        for recording in recordings
    ]  # fmt: skip
    modes = tuple(_modes(job) if job.errors else () for job in jobs)
    drift = _common_drift(modes)
    prepared, timed = [], []
    for job, found in zip(jobs, modes, strict=True):
        if not found:
            one, *_ = job.prepared([job.centre])
            prepared.append(one)
            timed.append(job.at(job.centre))
            continue
        best = found[0]
        x = np.array(
            [
                drift[e.clock] if e.kind == "drift" else v
                for e, v in zip(job.errors, best.value, strict=True)
            ]
        )
        prepared.append(job.expanded(x, _STEP * best.sd))
        timed.append(job.at(x))
    return ClockAlignment(tuple(jobs), tuple(prepared), tuple(timed), modes)


def fit_aligned(timed: ClockAlignment, placed_effects: tuple[PlacedEffect, ...] = ()) -> MapFit:
    """Fit all runs together, and expand the likelihood again where its mode has moved.

    Parameters
    ----------
    timed : ClockAlignment
        Recordings whose clocks have been compared.
    placed_effects : tuple of PlacedEffect
        Effects that the car and its sensors have.
    """
    first = timed.jobs[0]
    if len(timed.jobs) == 1 and timed.modes[0] and not placed_effects:
        return timed.modes[0][0].fit
    recordings = timed.prepared
    for _ in range(_ROUNDS):
        fit = best_fit(recordings, first.vehicle, first.likelihood, placed_effects)
        settled, out = True, []
        for run, (job, recording) in enumerate(zip(timed.jobs, recordings, strict=True)):
            if recording.clock_variants is not None:
                x, step, good = _moved(
                    recording.clock_variants.middle,
                    recording.clock_variants.step,
                    *_at_mode(fit, run),
                )
                settled &= good
                recording = job.expanded(x, step)
            out.append(recording)
        if settled:
            break
        recordings = tuple(out)
    return fit


def _unknown(
    recording: Recording, vehicle: Vehicle, clocks: Sequence[Clock], car: str
) -> tuple[ClockError, ...]:
    """List errors of clocks that stamp some of the channels that are used, but not all."""
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


def _modes(job: _Job) -> tuple[OffsetMode, ...]:
    """Find the modes of one run, the most probable first."""
    starts = [job.centre]
    for k, error in enumerate(job.errors):
        if error.kind == "offset":  # one clock after the other, from the best of those before
            count = 2 * math.ceil(_REACH * error.sd / _SPACING) + 1
            grid = error.centre + error.sd * np.linspace(-_REACH, _REACH, count)
            points = [np.where(np.arange(len(job.errors)) == k, g, starts[0]) for g in grid]
            level = _profile(job, points)
            top = _maxima(level)
            starts = [points[j] for j in top if level[j] > level[top[0]] - _KEPT][:_MOST_MODES]
    found = [_refined(job, start) for start in starts]
    distinct = [found[0]]
    for other in found[1:]:
        if all(_apart(other, one) for one in distinct):
            distinct.append(other)
    if len(distinct) == 1:
        return (distinct[0]._replace(probability=1.0),)
    level = _profile(job, [one.value for one in distinct])
    weight = np.exp(level - level.max())
    weight /= weight.sum()
    named = [one._replace(probability=float(w)) for one, w in zip(distinct, weight, strict=True)]
    return tuple(sorted(named, key=lambda one: -one.probability))


def _maxima(level: Array) -> list[int]:
    """Local maxima of a profile, the highest first."""
    padded = np.concatenate([[-np.inf], level, [-np.inf]])
    top = np.flatnonzero((padded[1:-1] >= padded[:-2]) & (padded[1:-1] > padded[2:]))
    return sorted(top.tolist(), key=lambda j: -level[j])


def _apart(one: OffsetMode, other: OffsetMode) -> bool:
    """Whether two modes are more than their deviations apart."""
    return bool(np.any(np.abs(one.value - other.value) > 3.0 * np.maximum(one.sd, other.sd)))


def _profile(job: _Job, points: Sequence[Array]) -> Array:
    """Profile ℓ of one run at errors."""
    squares, dispersion = [], []
    recordings = job.lively.prepared(points)
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
        Errors of the clocks.
    """

    squares: float
    dispersion: float
    errors: Array
    error_sd: Array


def _least_squares(
    job: _Job, recording: PreparedRecording, clocks: Sequence[int]
) -> _LeastSquaresFit:
    """Fit the car, and errors of clocks by their numbers, to one run."""
    kind = job.likelihood
    if kind == "innovations" and any(noise is None for noise in recording.noise):
        kind = "coloured"  # what is left is not the sensors' noise where that is not known
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


def _refined(job: _Job, start: Array) -> OffsetMode:
    """Expand the likelihood around errors until its mode is where it was expanded."""
    span = float(job.recording.time[-1] - job.recording.time[0])
    first = [_FIRST_STEP if e.kind == "offset" else 2.0 * _FIRST_STEP / span for e in job.errors]
    x, step = start, np.minimum(first, job.sd)
    every = range(len(job.errors))
    for _ in range(_ROUNDS):
        found = _least_squares(job, job.expanded(x, step), every)
        x, step, settled = _moved(x, step, found.errors, np.minimum(found.error_sd, job.sd))
        if settled:
            break
    for _ in range(_ROUNDS):
        fit = best_fit((job.expanded(x, step),), job.vehicle, job.likelihood)
        value, sd = _at_mode(fit, 0)
        x, step, settled = _moved(x, step, value, sd)
        if settled:
            break
    return OffsetMode(job.errors, value, sd, 1.0, fit)


def _moved(x: Array, step: Array, value: Array, sd: Array) -> tuple[Array, Array, bool]:
    """Return where to expand next, and whether the last expansion was good enough."""
    near = np.abs(value - x) <= step
    settled = bool(np.all(near & (step <= _WIDEST * sd) & (step >= _NARROWEST * sd)))
    new = np.clip(_STEP * sd, 0.1 * step, 3.0 * step)
    return x + np.clip(value - x, -3.0 * step, 3.0 * step), new, settled


def _at_mode(fit: MapFit, run: int) -> tuple[Array, Array]:
    """Errors (K,) of a run's clocks at the mode of a fit, and their standard deviations."""
    value = fit.space.clock_errors(fit.mode.z[None], run)[0]
    picked = fit.space.clock_coordinates(run)
    scale = np.array([fit.space.coordinates[k].scale for k in picked])
    return value, scale * fit.mode.sd[picked]


def _common_drift(modes: Sequence[Sequence[OffsetMode]]) -> dict[str, float]:
    """Mean drift of each clock over all runs, weighted by what each run tells."""
    total: dict[str, float] = {}
    weight: dict[str, float] = {}
    for found in modes:
        for error, value, sd in zip(*found[0][:3], strict=True) if found else ():
            if error.kind == "drift":
                total[error.clock] = total.get(error.clock, 0.0) + value / sd**2
                weight[error.clock] = weight.get(error.clock, 0.0) + 1.0 / sd**2
    return {name: total[name] / weight[name] for name in total}


def _words(mode: OffsetMode) -> str:
    parts = [
        f"{error.clock} sampled {1e3 * abs(value):.2g} ms "
        f"{'later' if value > 0.0 else 'earlier'} than stamped"
        for error, value in zip(mode.errors, mode.value, strict=True)
        if error.kind == "offset"
    ]
    return f"{', '.join(parts)} (probability {mode.probability:.2g})"
