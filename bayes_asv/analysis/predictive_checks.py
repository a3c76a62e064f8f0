"""Posterior predictive checks: whether the fitted model would produce such recordings.

For draws of the posterior, the recording is simulated again.  The measured wheel accelerations
drive the car, with the initial state and the biases that fit best (initial states drawn from the
prior would dominate everything), and new noise of wheel and chassis sensors enters as in the model.
Peak, root mean square and the power in a few bands of the recording are compared with those of the
replicates (Rubin 1984; Gelman, Meng & Stern 1996), for

- the *reading*: visible to the user, but dominated by the motion that the wheels cause, so that
  only large faults are detected;
- the *residual* after initial state and biases are fitted, to the recording and to each replicate
  alike: a discrepancy T(y, θ), and the more sensitive check of the two.

The replicates contain only the half car and its sensors.  They have no residual autoregression,
since it describes motion that the half car does not contain, which these checks are to detect.  For
the same reason, no noise level is more than two prior standard deviations from its declared value.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.free_response import free_response
from bayes_asv.filters.kalman import (
    AT_LEAST,
    AT_MOST,
    VALUE,
    Measurements,
    StateSpace,
)  # fmt: skip
from bayes_asv.filters.noise_simulation import normals_needed, simulate_noise
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.tone_removal import Notch, notch_filter

__all__ = ["BANDS", "Check", "predictive_checks"]

Array = NDArray[np.float64]

BANDS = ((0.5, 5.0), (5.0, 15.0), (15.0, np.inf))
"""Frequency bands, Hz: body, wheel hop, and above."""

_CARS = 40  # draws of the posterior
_PATHS = 20  # noise realisations for each draw
_MOST_VALUES = 2_000_000  # bound on instants times replicates, which limits long recordings
_FEWEST_PATHS = 4  # least number of noise realisations for each draw
_TAPER = 0.1  # share of a record that is tapered before its power is computed
_MAX_NOISE_DEVIATION = 2.0  # bound on a noise level's distance from the declared one, prior sd
_EVEN = 1e-3  # unevenness of samples that needs no interpolation, in steps


class Check(NamedTuple):
    """One quantity of one chassis channel, measured and replicated.

    Parameters
    ----------
    output : int
        Number of the output.
    of : str
        ``reading`` or ``residual``.
    quantity : str
        ``peak``, the largest distance from the record's mean, or ``rms``.
    band : tuple of float or None
        Edges of the band, Hz; None for all frequencies.
    observed : float
        Value for the recording, m/s²; for a residual, its median over the posterior.
    replicated : (3,) array
        Quantiles 2.5, 50 and 97.5 % of the replicates, m/s².
    p_larger : float
        P(T(y_rep) ≥ T(y)).
    p : float
        Two-sided p-value.
    p_family : float
        Probability that the most extreme of all checks of the run is as extreme as this one.
    """

    output: int
    of: str
    quantity: str
    band: tuple[float, float] | None
    observed: float
    replicated: Array
    p_larger: float
    p: float
    p_family: float

    @property
    def larger(self) -> bool:
        """Whether the recording has a larger value than most replicates."""
        return self.p_larger < 0.5


def predictive_checks(posterior: Posterior, draws: Array, run: int, seed: int) -> tuple[Check, ...]:
    """Check one recording against replicates from its posterior.

    Parameters
    ----------
    posterior : Posterior
        The posterior.
    draws : (S, D) array
        Draws of its coordinates, equally weighted.
    run : int
        Which recording.
    seed : int
        Seed of the replicates.

    Returns
    -------
    tuple of Check
        Checks of readings and residuals of all outputs.
    """
    recording = posterior.space.recordings[run]
    rng = np.random.default_rng([seed, run, 9])
    count = len(recording.step)
    paths = max(min(_PATHS, _MOST_VALUES // (_CARS * count)), _FEWEST_PATHS)
    cars = min(_CARS, max(_MOST_VALUES // (paths * count), 8), len(draws))
    picked = draws[np.linspace(0, len(draws) - 1, cars).astype(int)]
    noises = posterior.space.noises(_clip_noise_levels(posterior, picked), run)
    views = [_View.of(recording, y) for y in range(len(recording.outputs))]
    low, high = _clipping_limits(recording, views)
    observed, replicated = [], []
    ny = len(views)
    normal_count = normals_needed(len(recording.wheels), ny)
    data = recording.measurements
    systems = posterior.space.state_space(picked, run)
    for k, point in enumerate(picked):
        system = systems.subset([k])
        fitted = free_run(posterior, point, run).output
        basis = _basis(system, data, views)
        normals = rng.standard_normal((count, paths, normal_count))
        noisy = simulate_noise(system, noises.subset([k]), data, normals)
        for y, view in enumerate(views):
            noisy[view.rows, :, y] = _apply_notches(noisy[view.rows, :, y], recording, view)
        measured = _stack_readings(recording.reading[:, None, :], views)
        replicates = np.clip(_stack_readings(fitted[:, None, :] + noisy, views), low, high)
        residual = [x - _stack_readings(fitted[:, None, :], views) for x in (measured, replicates)]
        projected = [e - basis @ (basis.T @ e) for e in residual]
        observed.append(_statistics(measured, projected[0], views))
        replicated.append(_statistics(replicates, projected[1], views))
    names = [
        (axle, of, quantity, band)
        for of in ("reading", "residual")
        for axle, view in enumerate(views)
        for quantity, band in (("peak", None), ("rms", None), *(("rms", b) for b in view.bands))
    ]
    return _compare_statistics(
        names, np.concatenate(observed, axis=1), np.stack(replicated, axis=1)
    )


def _clip_noise_levels(posterior: Posterior, draws: Array) -> Array:
    """Return draws (S, D) with noise levels clipped to a range about the declared ones."""
    out = draws.copy()
    levels = [k for k, one in enumerate(posterior.space.coordinates) if one.kind == "noise"]
    out[:, levels] = np.clip(out[:, levels], -_MAX_NOISE_DEVIATION, _MAX_NOISE_DEVIATION)
    return out


def _compare_statistics(
    names: list[tuple[int, str, str, tuple[float, float] | None]],
    observed: Array,
    replicated: Array,
) -> tuple[Check, ...]:
    """Compare observed (T, cars) with replicated (T, cars, paths) statistics."""
    log_ratio = (
        np.log(np.maximum(replicated, 1e-300)) - np.log(np.maximum(observed, 1e-300))[:, :, None]
    )
    log_ratio = log_ratio.reshape(len(log_ratio), -1)
    total = log_ratio.shape[1]
    larger = (1.0 + np.count_nonzero(log_ratio >= 0.0, axis=1)) / (total + 1.0)
    smaller = (1.0 + np.count_nonzero(log_ratio <= 0.0, axis=1)) / (total + 1.0)
    # the largest of all standardised distances (Westfall & Young 1993, single step)
    middle, sd = log_ratio.mean(axis=1), np.maximum(log_ratio.std(axis=1), 1e-12)
    largest_distance = np.max(np.abs(log_ratio - middle[:, None]) / sd[:, None], axis=0)
    distance = np.abs(middle) / sd
    family = (1.0 + np.count_nonzero(largest_distance >= distance[:, None], axis=1)) / (total + 1.0)
    return tuple(
        Check(
            *name,
            observed=float(np.median(observed[k])),
            replicated=np.quantile(replicated[k], [0.025, 0.5, 0.975]),
            p_larger=float(larger[k]),
            p=float(min(1.0, 2.0 * min(larger[k], smaller[k]))),
            p_family=float(family[k]),
        )
        for k, name in enumerate(names)
    )


@dataclass(frozen=True)
class _View:
    """The readings of one output, and the even grid and taper for their power.

    Parameters
    ----------
    rows : (M,) int array
        Instants at which this output has a value.
    rate : float
        Readings per second, Hz.
    lower_index, share : (L,) arrays
        Even grid: index of the reading before each point, and weight of the one after it.
    window : (L,) array
        Taper.
    bands : tuple of (float, float)
        Bands with at least two spectral lines.
    """

    rows: NDArray[np.int64]
    rate: float
    lower_index: NDArray[np.int64]
    share: Array
    window: Array
    bands: tuple[tuple[float, float], ...]

    @classmethod
    def of(cls, recording: PreparedRecording, axle: int) -> _View:
        rows = np.flatnonzero(recording.kind[:, axle] == VALUE)
        time = recording.instants[rows]
        step = float(np.median(np.diff(time)))
        grid = time[0] + step * np.arange(int((time[-1] - time[0]) / step + 1e-6) + 1)
        before = np.clip(np.searchsorted(time, grid, "right") - 1, 0, len(time) - 2)
        share = np.clip((grid - time[before]) / (time[before + 1] - time[before]), 0.0, 1.0)
        share = np.where(np.abs(share - np.round(share)) < _EVEN, np.round(share), share)
        place = np.linspace(0.0, 1.0, len(grid))
        edge = np.clip(np.minimum(place, 1.0 - place) / (0.5 * _TAPER), 0.0, 1.0)
        lines = np.fft.rfftfreq(len(grid), step)
        top = 0.5 / step
        bands = [(low, min(high, top)) for low, high in BANDS if low < top]
        return cls(
            rows,
            1.0 / step,
            before,
            share,
            np.sin(0.5 * np.pi * edge) ** 2,
            tuple(b for b in bands if np.count_nonzero((lines >= b[0]) & (lines <= b[1])) > 1),
        )

    def statistics(self, values: Array) -> Array:
        """Peak, root mean square and that in each band (2 + B, K) of records (M, K)."""
        values = values - values.mean(axis=0)
        share = self.share[:, None]
        even = (1.0 - share) * values[self.lower_index] + share * values[self.lower_index + 1]
        power = np.abs(np.fft.rfft(even * self.window[:, None], axis=0)) ** 2
        power[1:] *= 2.0
        power /= len(even) * float(np.sum(self.window**2))
        lines = np.fft.rfftfreq(len(even), 1.0 / self.rate)
        rows = [np.max(np.abs(values), axis=0), np.sqrt(np.mean(values**2, axis=0))]
        for low, high in self.bands:
            inside = (lines >= low) & (lines <= high)
            rows.append(np.sqrt(power[inside].sum(axis=0)))
        return np.stack(rows)


def _stack_readings(values: Array, views: list[_View]) -> Array:
    """Select the readings (M, K) from values at instants (E, K, ny), output after output."""
    return np.concatenate([values[view.rows, :, axle] for axle, view in enumerate(views)])


def _statistics(reading: Array, residual: Array, views: list[_View]) -> Array:
    """All statistics (T, K) of records (M, K) and of their residuals."""
    ends = np.cumsum([len(view.rows) for view in views])[:-1]
    return np.concatenate(
        [
            view.statistics(part)
            for values in (reading, residual)
            for view, part in zip(views, np.split(values, ends), strict=True)
        ]
    )


def _basis(system: StateSpace, data: Measurements, views: list[_View]) -> Array:
    """Orthonormal basis (M, U) of the outputs due to initial state and biases."""
    no_input = data._replace(moments=np.zeros_like(data.moments))
    columns, _ = free_response(system, no_input, np.eye(len(data.initial_covariance)))
    basis, _ = np.linalg.qr(_stack_readings(np.moveaxis(columns, 0, 1), views))
    return np.asarray(basis)


def _apply_notches(noise: Array, recording: PreparedRecording, view: _View) -> Array:
    """Filter noise (M, K) with the notches that removed tones from the recording."""
    if not recording.notches:
        return noise
    from scipy.signal import sosfilt

    sections = notch_filter([Notch(*notch) for notch in recording.notches], view.rate)
    return np.asarray(sosfilt(sections, noise, axis=0))


def _clipping_limits(recording: PreparedRecording, views: list[_View]) -> tuple[Array, Array]:
    """Limits (M, 1) at which the outputs of this recording were clipped; infinite if not."""
    low, high = [], []
    for y, view in enumerate(views):
        top = recording.reading[recording.kind[:, y] == AT_LEAST, y]
        bottom = recording.reading[recording.kind[:, y] == AT_MOST, y]
        low.append(np.full(len(view.rows), bottom.max() if len(bottom) else -np.inf))
        high.append(np.full(len(view.rows), top.min() if len(top) else np.inf))
    return np.concatenate(low)[:, None], np.concatenate(high)[:, None]
