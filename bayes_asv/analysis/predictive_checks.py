"""Posterior predictive checks: whether the fitted model would produce such recordings.

For draws of the posterior the recording is made again: the car runs over the measured wheel
accelerations from the initial state and with the biases that fit best (a start drawn from the
prior would drown everything), and fresh noise of wheel and chassis sensors goes the way it
goes in the model.  Peak, root mean square and the power in a few bands of the measured record
are then looked for among those of the replicates (Rubin 1984; Gelman, Meng & Stern 1996)

- of the *reading*: what a user sees, but dominated by the motion that the wheels cause, so
  that only gross faults show;
- of the *residual*, what is left once start and biases were fitted, to the record and to each
  replicate alike: a discrepancy T(y, θ), and the sharper test of the two.

The replicates know the half car and its sensors alone.  A colour found in the innovations is
left out on purpose: it describes what the half car does not know, which is looked for here.  So
does a noise level that has swollen, and no level is taken farther than two prior deviations
from what the vehicle file says of the sensor.
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
"""Body, wheel hop, and above: Hz."""

_CARS = 40  # draws of the posterior, and
_PATHS = 20  # records of noise for each
_MOST_VALUES = 2_000_000  # instants times replicates: a long record is made again less often
_FEWEST_PATHS = 4
_TAPER = 0.1  # share of a record over which its ends are faded before the power is taken
_BELIEVED = 2.0  # prior deviations of a noise level
_EVEN = 1e-3  # of a step: unevenness that needs no interpolation


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
        Edges in Hz of what the root mean square is taken of; None for the whole record.
    observed : float
        Of the record, m/s²; for a residual its median over the posterior.
    replicated : (3,) array
        Quantiles 2.5, 50 and 97.5 % of the replicates, m/s².
    p_larger : float
        P(T(y_rep) ≥ T(y)).
    p : float
        The same two-sided.
    p_family : float
        Probability that the worst of all checks of the run is as far out as this one.
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
        """Whether the record has more of it than most replicates."""
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
        Same seed, same replicates.

    Returns
    -------
    tuple of Check
        Reading and residual of both chassis channels.
    """
    recording = posterior.space.recordings[run]
    rng = np.random.default_rng([seed, run, 9])
    count = len(recording.step)
    paths = max(min(_PATHS, _MOST_VALUES // (_CARS * count)), _FEWEST_PATHS)
    cars = min(_CARS, max(_MOST_VALUES // (paths * count), 8), len(draws))
    picked = draws[np.linspace(0, len(draws) - 1, cars).astype(int)]
    noises = posterior.space.noises(_believed(posterior, picked), run)
    views = [_View.of(recording, y) for y in range(len(recording.outputs))]
    low, high = _rails(recording, views)
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
            noisy[view.rows, :, y] = _notched(noisy[view.rows, :, y], recording, view)
        measured = _stacked(recording.reading[:, None, :], views)
        made = np.clip(_stacked(fitted[:, None, :] + noisy, views), low, high)
        residual = [x - _stacked(fitted[:, None, :], views) for x in (measured, made)]
        left = [e - basis @ (basis.T @ e) for e in residual]
        observed.append(_statistics(measured, left[0], views))
        replicated.append(_statistics(made, left[1], views))
    names = [
        (axle, of, quantity, band)
        for of in ("reading", "residual")
        for axle, view in enumerate(views)
        for quantity, band in (("peak", None), ("rms", None), *(("rms", b) for b in view.bands))
    ]
    return _compared(names, np.concatenate(observed, axis=1), np.stack(replicated, axis=1))


def _believed(posterior: Posterior, draws: Array) -> Array:
    """Draws (S, D) with noise levels no farther from the given ones than is believed."""
    out = draws.copy()
    levels = [k for k, one in enumerate(posterior.space.coordinates) if one.kind == "noise"]
    out[:, levels] = np.clip(out[:, levels], -_BELIEVED, _BELIEVED)
    return out


def _compared(
    names: list[tuple[int, str, str, tuple[float, float] | None]], observed: Array, made: Array
) -> tuple[Check, ...]:
    """Set observed (T, cars) against replicated (T, cars, paths) statistics."""
    ahead = np.log(np.maximum(made, 1e-300)) - np.log(np.maximum(observed, 1e-300))[:, :, None]
    ahead = ahead.reshape(len(ahead), -1)
    total = ahead.shape[1]
    larger = (1.0 + np.count_nonzero(ahead >= 0.0, axis=1)) / (total + 1.0)
    smaller = (1.0 + np.count_nonzero(ahead <= 0.0, axis=1)) / (total + 1.0)
    # The largest of all standardised distances (Westfall & Young 1993, single step).
    middle, sd = ahead.mean(axis=1), np.maximum(ahead.std(axis=1), 1e-12)
    farthest = np.max(np.abs(ahead - middle[:, None]) / sd[:, None], axis=0)
    far = np.abs(middle) / sd
    family = (1.0 + np.count_nonzero(farthest >= far[:, None], axis=1)) / (total + 1.0)
    return tuple(
        Check(
            *name,
            observed=float(np.median(observed[k])),
            replicated=np.quantile(made[k], [0.025, 0.5, 0.975]),
            p_larger=float(larger[k]),
            p=float(min(1.0, 2.0 * min(larger[k], smaller[k]))),
            p_family=float(family[k]),
        )
        for k, name in enumerate(names)
    )


@dataclass(frozen=True)
class _View:
    """The readings of one chassis channel, and how their power is taken.

    Parameters
    ----------
    rows : (M,) int array
        Instants at which this channel has a value.
    rate : float
        Readings a second, Hz.
    lower_index, share : (L,) arrays
        Even grid: the reading before each point, and the share of the one after it.
    window : (L,) array
        Taper.
    bands : tuple of (float, float)
        Bands in which the record has at least two lines.
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
        left = np.clip(np.searchsorted(time, grid, "right") - 1, 0, len(time) - 2)
        share = np.clip((grid - time[left]) / (time[left + 1] - time[left]), 0.0, 1.0)
        share = np.where(np.abs(share - np.round(share)) < _EVEN, np.round(share), share)
        place = np.linspace(0.0, 1.0, len(grid))
        edge = np.clip(np.minimum(place, 1.0 - place) / (0.5 * _TAPER), 0.0, 1.0)
        lines = np.fft.rfftfreq(len(grid), step)
        top = 0.5 / step
        bands = [(low, min(high, top)) for low, high in BANDS if low < top]
        return cls(
            rows,
            1.0 / step,
            left,
            share,
            np.sin(0.5 * np.pi * edge) ** 2,
            tuple(b for b in bands if np.count_nonzero((lines >= b[0]) & (lines <= b[1])) > 1),
        )

    def statistics(self, values: Array) -> Array:
        """Peak, root mean square and that of each band (2 + B, K) of records (M, K)."""
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


def _stacked(values: Array, views: list[_View]) -> Array:
    """Take readings (M, K) out of values at instants (E, K, ny), output after output."""
    return np.concatenate([values[view.rows, :, axle] for axle, view in enumerate(views)])


def _statistics(reading: Array, residual: Array, views: list[_View]) -> Array:
    """All statistics (T, K) of records (M, K) and of what is left of them."""
    ends = np.cumsum([len(view.rows) for view in views])[:-1]
    return np.concatenate(
        [
            view.statistics(part)
            for values in (reading, residual)
            for view, part in zip(views, np.split(values, ends), strict=True)
        ]
    )


def _basis(system: StateSpace, data: Measurements, views: list[_View]) -> Array:
    """Orthonormal basis (M, U) of what initial state and biases can explain."""
    still = data._replace(moments=np.zeros_like(data.moments))
    columns, _ = free_response(system, still, np.eye(len(data.initial_covariance)))
    basis, _ = np.linalg.qr(_stacked(np.moveaxis(columns, 0, 1), views))
    return np.asarray(basis)


def _notched(noise: Array, recording: PreparedRecording, view: _View) -> Array:
    """Noise (M, K) after the notches that cut tones out of the recording."""
    if not recording.notches:
        return noise
    from scipy.signal import sosfilt

    sections = notch_filter([Notch(*notch) for notch in recording.notches], view.rate)
    return np.asarray(sosfilt(sections, noise, axis=0))


def _rails(recording: PreparedRecording, views: list[_View]) -> tuple[Array, Array]:
    """Where each output of this recording was cut off (M, 1); infinite where none was."""
    low, high = [], []
    for y, view in enumerate(views):
        top = recording.reading[recording.kind[:, y] == AT_LEAST, y]
        bottom = recording.reading[recording.kind[:, y] == AT_MOST, y]
        low.append(np.full(len(view.rows), bottom.max() if len(bottom) else -np.inf))
        high.append(np.full(len(view.rows), top.min() if len(top) else np.inf))
    return np.concatenate(low)[:, None], np.concatenate(high)[:, None]
