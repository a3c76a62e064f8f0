"""A recording prepared for a filter: steps, readings and their times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import Channel
from bayes_asv.filters.kalman import MISSING, VALUE, Measurements
from bayes_asv.models.car_model import CarModel, Output
from bayes_asv.preprocessing.removed_band import RemovedBand
from bayes_asv.preprocessing.wheel_spline import WheelSignal

__all__ = [
    "ClockError",
    "ClockVariants",
    "PreparedRecording",
    "common_readings",
    "interpolation_weights",
    "with_clock_variants",
]  # fmt: skip

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class ClockError(NamedTuple):
    """An unknown error of a clock, with a normal prior.

    Parameters
    ----------
    clock : str
        Name of the clock.
    kind : {'offset', 'drift'}
        An offset (s) belongs to one run, a drift (relative) to all of them.
    centre, sd : float
        Mean and standard deviation of the prior.
    """

    clock: str
    kind: Literal["offset", "drift"]
    centre: float
    sd: float


@dataclass(frozen=True, eq=False)
class ClockVariants:
    """A recording prepared with other clock errors; K errors, M = (K + 1)(K + 2) / 2.

    A smooth function of the errors x, such as the log-likelihood, is interpolated from its values
    at M points: the recording itself has the errors x₀, and the variants have x₀ ± h_i e_i and
    x₀ + h_i e_i + h_j e_j.  These determine a polynomial of second degree.

    Parameters
    ----------
    errors : tuple of K ClockError
        The unknown errors.
    middle, step : (K,) arrays
        x₀ and h.
    recordings : tuple of M − 1 PreparedRecording
        The recording at the other points, in the order of :meth:`points`, with the same readings.
    """

    errors: tuple[ClockError, ...]
    middle: Array
    step: Array
    recordings: tuple[PreparedRecording, ...]

    @staticmethod
    def points(count: int) -> Array:
        """Points (M − 1, K) other than the middle, in steps."""
        unit = np.eye(count)
        pairs = [unit[i] + unit[j] for i in range(count) for j in range(i)]
        return np.array([*unit, *-unit, *pairs]).reshape(-1, count)

    def weights(self, errors: Array) -> Array:
        """Weights (W, M) of the values at the middle and at :meth:`points`, for errors (W, K)."""
        return interpolation_weights((errors - self.middle) / self.step)


def interpolation_weights(u: Array) -> Array:
    """Weights (W, M) of a polynomial of second degree at u (W, K), see :class:`ClockVariants`."""
    count = u.shape[1]
    pairs = [u[:, i] * u[:, j] for i in range(count) for j in range(i)]
    both = np.stack(pairs, axis=1) if pairs else np.zeros((len(u), 0))
    others = u * (u.sum(axis=1, keepdims=True) - u)
    single = [0.5 * (u**2 + u) - others, 0.5 * (u**2 - u), both]
    middle = 1.0 - np.sum(u**2, axis=1) + both.sum(axis=1)
    return np.hstack([middle[:, None], *single])


@dataclass(frozen=True, eq=False)
class PreparedRecording:
    """One recording, ready for a filter; E instants, nu inputs, ny outputs, C channels.

    Parameters
    ----------
    car : CarModel
        The car that it is prepared for.
    channels : tuple of Channel
        Channels of the recording that the car uses.
    inputs, outputs : tuples of int
        Indices of the measured inputs, in the order of the car's elements, and of the outputs.
    step, moments, process_noise, kind, reading, extra_variance, initial_covariance
        As in :class:`bayes_asv.filters.kalman.Measurements`.
    ends_group : (E,) bool array
        True at the last instant of a group of adjacent readings.
    instants : (E,) array
        Times at the ends of steps, s.
    group_instants : (R, ny) int array
        Indices of the instants of the readings of each group, -1 where one is missing.
    wheels : tuple of WheelSignal
        Interpolated inputs.
    values : (C, N) array
        All channels in SI units, with equal bandwidths, NaN where missing.
    times : (C, N) array
        True sampling time of each reading, s.
    clipped : (C, N) bool array
        Readings at a rail.
    noise : tuple of float or None
        Declared standard deviation of one sample of each channel, SI units.
    quantization_steps : (C,) array
        Quantisation step of each channel, SI units; 0 where not given.
    poles : (C,) array
        Pole of the filter that the readings of a channel passed, rad/s; 0 without one.
    bias_directions : (nu, nd) array
        Directions of biases of the inputs that the outputs do not absorb.
    start_time : float
        First time stamp of the recording, s.
    source : str
        File name without its folder, for messages and reports.
    scale_sd : (C,) array
        Relative standard deviation of each sensor's scale; 0 if it is exact or not in counts.
    below : float or None
        Upper edge of the band, Hz; None at full band.
    noise_prior_centre : (C,) array or None
        Centre of the prior of undeclared noise levels, SI units; None for the level in the quarter
        of the record with the least motion.
    notches : tuple of (frequency, half-width)
        Bands that were removed from all channels, Hz.
    removed_band : RemovedBand or None
        Correction of the likelihood for these bands.
    standstill_noise : (E, nu) array or None
        Process noise added at standstill for quantisation error.
    clock_variants : ClockVariants or None
        The recording with other clock errors, if these are unknown.
    log_sha256 : str
        Hash of the file from which it was read, or empty; pieces of one log have the same hash.
    """

    car: CarModel
    channels: tuple[Channel, ...]
    inputs: tuple[int, ...]
    outputs: tuple[int, ...]
    step: Array
    moments: Array
    process_noise: Array
    kind: NDArray[np.int8]
    ends_group: Flags
    reading: Array
    extra_variance: Array
    initial_covariance: Array
    instants: Array
    group_instants: NDArray[np.int64]
    wheels: tuple[WheelSignal, ...]
    values: Array
    times: Array
    clipped: Flags
    noise: tuple[float | None, ...]
    quantization_steps: Array
    poles: Array
    bias_directions: Array
    start_time: float
    source: str
    scale_sd: Array = field(default_factory=lambda: np.zeros(0))
    below: float | None = None
    noise_prior_centre: Array | None = None
    notches: tuple[tuple[float, float], ...] = ()
    removed_band: RemovedBand | None = None
    standstill_noise: Array | None = None
    log_sha256: str = ""
    clock_variants: ClockVariants | None = None

    @property
    def measurements(self) -> Measurements:
        """Steps and readings for a filter."""
        return Measurements(
            self.step,
            self.moments,
            self.process_noise,
            self.kind,
            self.reading,
            self.extra_variance,
            self.initial_covariance,
        )

    @property
    def output_models(self) -> tuple[Output, ...]:
        """Models of the outputs, including whether each passed the common filter."""
        pole = float(np.max(self.poles[list(self.inputs)], initial=0.0))
        return tuple(
            Output(self.channels[c], 1.0 / pole if pole > 0.0 and self.poles[c] == 0.0 else 0.0)
            for c in self.outputs
        )

    @property
    def accelerations(self) -> tuple[int, ...]:
        """Indices, among the outputs, of those that measure an acceleration.

        They respond to a force on the body without delay.  At a frequency ω, the response of an
        angular rate or a deflection is smaller by a factor ω or ω².
        """
        return tuple(
            y for y, c in enumerate(self.outputs) if self.channels[c].quantity == "acceleration"
        )

    @cached_property
    def rigid_gain(self) -> Array:
        """Outputs (ny, nu) if wheels and body accelerate together, for the nominal car."""
        nominal = self.car.nominal
        followed = np.linalg.pinv(self.car.heights(nominal)[0])
        out = np.zeros((len(self.outputs), len(self.inputs)))
        for y in self.accelerations:
            out[y] = self.car.point(nominal, self.channels[self.outputs[y]])[0] @ followed
        return out

    @property
    def order(self) -> tuple[int, ...]:
        """Indices of the channels in the order of a filter's noise: inputs, then outputs."""
        return (*self.inputs, *self.outputs)

    @property
    def elapsed(self) -> Array:
        """Times at the ends of steps since the recording began (E,), s."""
        return self.instants - self.start_time

    @property
    def noise_spread(self) -> Array:
        """Process noise of each step (E, 2 nu), without that added at standstill."""
        if self.standstill_noise is None:
            return self.process_noise
        return self.process_noise - np.hstack(
            [np.zeros_like(self.standstill_noise), self.standstill_noise]
        )

    def paired(self, values: Array) -> Array:
        """Arrange values at instants (E, ny) by groups of readings (R, ny), nan where missing."""
        out = np.full(self.group_instants.shape, np.nan)
        for y in range(self.group_instants.shape[1]):
            has_reading = self.group_instants[:, y] >= 0
            at = self.group_instants[has_reading, y]
            value = self.kind[at, y] == VALUE
            out[has_reading, y] = np.where(value, values[at, y], np.nan)
        return out

    @property
    def readings(self) -> int:
        """Number of output readings used."""
        return int(np.count_nonzero(self.kind != MISSING))

    @property
    def reading_step(self) -> float:
        """Usual time between two groups of output readings, s."""
        return float(np.median(np.diff(self.instants[self.group_instants.max(axis=1)])))


def with_clock_variants(
    recording: PreparedRecording, change: Callable[[PreparedRecording], PreparedRecording]
) -> PreparedRecording:
    """Apply a change to a recording and to its clock variants."""
    if recording.clock_variants is None:
        return change(recording)
    without_variants = replace(recording, clock_variants=None)
    first, *others = common_readings(
        [change(one) for one in (without_variants, *recording.clock_variants.recordings)]
    )
    return replace(
        first, clock_variants=replace(recording.clock_variants, recordings=tuple(others))
    )


def common_readings(recordings: Sequence[PreparedRecording]) -> list[PreparedRecording]:
    """Keep only readings that all variants of a recording have.

    At either end, a shift moves readings out of the time in which all channels were sampled, and
    likelihoods of different readings cannot be compared.
    """
    rows = [
        [_rows(recording, y) for y in range(len(recording.outputs))] for recording in recordings
    ]
    out = []
    for recording, rows_of_outputs in zip(recordings, rows, strict=True):
        kind = recording.kind.copy()
        for y, own_rows in enumerate(rows_of_outputs):
            lost = ~np.logical_and.reduce([np.isin(own_rows, other[y]) for other in rows])
            kind[np.flatnonzero(recording.kind[:, y] != MISSING)[lost], y] = MISSING
        out.append(replace(recording, kind=kind))
    return out


def _rows(recording: PreparedRecording, output: int) -> NDArray[np.int64]:
    """Rows of the recording that contain the readings of an output."""
    times = recording.times[recording.outputs[output]]
    at = recording.instants[recording.kind[:, output] != MISSING]
    after = np.clip(np.searchsorted(times, at), 1, len(times) - 1)
    return np.asarray(after - (at - times[after - 1] < times[after] - at), np.int64)
