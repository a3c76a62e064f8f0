"""Detection of resampled channels, and their reduction to the original rate.

A program that exports all channels of a logger at one rate repeats the readings of a slower
channel, joins them by straight lines or cubics, or filters them.  Such a file has more rows than
readings; taken row by row, it would give intervals that are too narrow.

A channel that was held, or interpolated by polynomials, is a spline with knots at its samples:
neighbouring rows obey exact linear relations, in a pattern that repeats with the position of the
knots between rows.  The record of a sensor, however smooth, has no such pattern.  The spectrum of a
low-passed channel falls off a cliff, with noise below it and almost nothing above.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_lsq_spline
from scipy.linalg import null_space
from scipy.ndimage import median_filter
from scipy.signal import detrend
from scipy.stats import t

from bayes_asv.domain.channels import channel
from bayes_asv.domain.recording import Recording
from bayes_asv.preprocessing.activity import most_active

__all__ = ["Resampling", "at_own_rate", "find_resampling"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Form(NamedTuple):
    """A method of resampling.

    Parameters
    ----------
    words : str
        Description for messages.
    degree : int
        Degree of the polynomials between samples.
    multiplicity : int
        Multiplicity of the knots of the spline that they form.
    """

    words: str
    degree: int
    multiplicity: int


HELD = Form("held at", 0, 1)
LINEAR = Form("interpolated linearly to", 1, 1)
CUBIC = Form("interpolated by a cubic spline to", 3, 1)
HERMITE = Form("interpolated by cubics to", 3, 2)

FORMS = (HELD, LINEAR, CUBIC, HERMITE)

_GRID = 0.1  # largest deviation of a stamp from the even grid, in row steps
_ACTIVE_ROWS = 2000  # number of rows that are tested, those with the most motion
_FEWEST_ROWS = 60  # least number of rows
# Ratios of rates: all fractions with a denominator up to this, and other common ones.
_LARGEST = 12
_FURTHER = tuple(Fraction(p, 25) for p in range(1, 25)) + tuple(
    Fraction(1, q) for q in (15, 16, 20, 32, 40, 50, 64, 100)
)
_RELATIONS = 4  # least number of relations of a window
_MOST_RELATIONS = 16  # largest number of relations of a window that are used
# Least rms of the relations over that of rounding errors, for rows with enough motion.
_ABOVE_STEP = 2.0
# Largest rms residual of relations that hold: in rounding errors (of the export, and partly of the
# samples), or in mean squares at other rows (some programs round to digits, not to steps).
_ROUNDING, _EXACT = 1.7, 1e-3
# Level of the test.  Some 500 patterns with up to 25 offsets are tested in each of four or more
# channels: by chance, one record in fifty thousand passes, and must also pass the rounding.
_ALARM = 1e-9
# Least difference between the log residuals at other rows and at those where relations hold.
_LEAST_CONTRAST = 1.0
_FEWEST_WINDOWS, _FEWEST_BLOCKS = 10, 5  # least number of windows, and of independent blocks
# Residual, in rounding errors, and contrast of relations that hold to the last digit, because
# numbers were not rounded again; no test is needed then.
_LESS_THAN_ROUNDED, _PLAIN_CONTRAST = 0.01, 9.2
_ALIKE = 2.0  # ratio of rms residuals of two patterns that hold equally well
_SEGMENTS = (256, 64)  # lengths of the segments of a spectrum, rows
_QUIET = 0.01  # variance of stretches of noise, relative to that of the record
_STEADY = 4.0  # largest ratio of the variances of stretches of noise
_CLIFF = 2.0**0.2  # half width of a cliff, as a ratio of frequencies
_PLATEAU, _DROP = 12.0, 14.0  # largest slope before a cliff, dB per octave, and its least drop, dB
_LEAK = 1e-5  # power above a cliff relative to the plateau, for a filter of 50 dB
_WIDEST = 0.42  # highest cliff, cycles per row: converters of genuine records end above
_SAME_STAMP = 2e-7  # difference below which time stamps are equal, s
_RELATIVE_ROUNDING = 3e-7  # rounding relative to the largest value: that of single precision


class Resampling(NamedTuple):
    """How a channel was resampled.

    Parameters
    ----------
    form : Form or None
        Method; None for a channel that was low-passed.
    ratio : Fraction
        Original rate (twice the bandwidth, if low-passed) over the rate of the rows.
    origin : int
        A row at which there is a sample.
    """

    form: Form | None
    ratio: Fraction
    origin: int = 0


def find_resampling(values: Array) -> Resampling | None:
    """Recognise a channel that was held, interpolated or low-passed.

    Parameters
    ----------
    values : (N,) array
        Readings on an even grid of rows, in the unit in which they were rounded; NaN where missing.

    Returns
    -------
    Resampling or None
        None for an original record, or for one that is not sufficient to decide.
    """
    return _find_each([values])[0]


def _find_each(channels: list[Array]) -> list[Resampling | None]:
    """Apply :func:`find_resampling` to several channels of a recording at once."""
    rows = [_most_active_rows(values, _ACTIVE_ROWS) for values in channels]
    parts = [values[one] for values, one in zip(channels, rows, strict=True)]
    usable = [c for c, x in enumerate(parts) if np.count_nonzero(np.isfinite(x)) >= _FEWEST_ROWS]
    rounding = {c: _rounding(parts[c]) for c in usable}
    lengths = {len(parts[c]) for c in usable}
    alike = [[c for c in usable if len(parts[c]) == length] for length in lengths]
    patterns: dict[int, list[_Pattern]] = {c: [] for c in usable}
    for which in alike:
        stacked = np.stack([parts[c] for c in which])
        errors = np.array([rounding[c] for c in which])
        for form in FORMS:
            for ratio in _ratios(form):
                for n, one in _find_patterns(stacked, ratio, form, errors):
                    patterns[which[n]].append(one)
    return [
        _choose_pattern(channels[c], patterns[c], rounding[c], rows[c].start)
        if c in patterns
        else None
        for c in range(len(channels))
    ]


def _choose_pattern(
    values: Array, patterns: list[_Pattern], rounding: float, first: int
) -> Resampling | None:
    """Choose one of the patterns that were found in a channel from row ``first`` on."""
    if not patterns:
        share = _filled_band(values, rounding)
        return None if share is None else Resampling(None, Fraction(share).limit_denominator(1000))
    # a spline with fewer degrees of freedom obeys the relations of one with more, too
    least = _ALIKE * min(one.residual_rms for one in patterns) + 1e-6 * rounding
    best = min((one for one in patterns if one.residual_rms <= least), key=lambda one: one.freedom)
    return Resampling(best.form, best.ratio, (best.origin + first) % best.ratio.denominator)


def _most_active_rows(values: Array, rows: int) -> slice:
    """Stretch of ``rows`` rows with the most motion."""
    return most_active(np.nan_to_num(np.diff(values, prepend=values[0])) ** 2, rows)


def _rounding(values: Array) -> float:
    """Rms rounding error, from the smallest difference between two values."""
    finite = values[np.isfinite(values)]
    scale = float(np.max(np.abs(finite)))
    differences = np.diff(np.unique(finite))
    differences = differences[differences > 1e-12 * scale]
    step = float(differences.min()) if len(differences) else 0.0
    return max(step, _RELATIVE_ROUNDING * scale) / math.sqrt(12.0)


@lru_cache(maxsize=8)
def _ratios(form: Form) -> tuple[Fraction, ...]:
    """Ratios of rates, in rising order, for which a spline implies relations between rows."""
    small = {Fraction(p, q) for q in range(2, _LARGEST + 1) for p in range(1, q)}
    most = Fraction(9, 10) / form.multiplicity
    return tuple(sorted(ratio for ratio in small.union(_FURTHER) if ratio < most))


@lru_cache(maxsize=1024)
def _relations(ratio: Fraction, form: Form) -> Array:
    """Orthonormal relations (w, d) between w rows, the first of which is at a sample."""
    free_share = 1.0 - form.multiplicity * float(ratio)
    rows = max(int((form.degree + 1 + _RELATIONS) / free_share), int(2.0 / float(ratio))) + 2
    samples = np.arange(0, rows) / float(ratio)
    grid = np.arange(rows, dtype=float)
    if form.degree == 0:
        space = (np.searchsorted(samples, grid + 1e-9)[:, None] == np.arange(1, rows)).astype(float)
        space = space[:, space.any(axis=0)]
    else:
        inside = np.repeat(samples[(samples > 0.0) & (samples < rows - 1.0)], form.multiplicity)
        ends = form.degree + 1
        knots = np.concatenate([np.zeros(ends), inside, np.full(ends, rows - 1.0)])
        space = BSpline.design_matrix(grid, knots, form.degree).toarray()
    return np.asarray(null_space(space.T)[:, :_MOST_RELATIONS])


class _Pattern(NamedTuple):
    """Relations that hold, for a method and a ratio of rates, with their rms residual."""

    form: Form
    ratio: Fraction
    origin: int
    residual_rms: float

    @property
    def freedom(self) -> Fraction:
        """Degrees of freedom of the spline, per row."""
        return self.ratio * self.form.multiplicity


def _find_patterns(
    values: Array, ratio: Fraction, form: Form, rounding: Array
) -> Iterator[tuple[int, _Pattern]]:
    """Find channels (C, N) in which the relations of a method hold periodically."""
    relations = _relations(ratio, form)
    period = ratio.denominator
    count = (values.shape[1] - len(relations) + 1) // period
    if count < _FEWEST_WINDOWS:
        return
    whole_periods = values[:, : count * period + len(relations) - 1]
    windows = np.lib.stride_tricks.sliding_window_view(whole_periods, len(relations), axis=1)
    residuals = windows.reshape(-1, len(relations)) @ relations
    energy = (
        np.einsum("ij,ij->i", residuals, residuals).reshape(-1, count, period) / residuals.shape[1]
    )
    # at rest, relations hold at any row; the comparison is false for missing readings
    moving = energy.mean(axis=2) > (_ABOVE_STEP * rounding[:, None]) ** 2
    blocks = np.count_nonzero(moving, axis=1)
    mean_energy = np.einsum("cbp,cb->cp", np.where(moving[:, :, None], energy, 0.0), moving)
    mean_energy /= np.maximum(blocks, 1)[:, None]
    bound = np.maximum((_ROUNDING * rounding) ** 2, _EXACT * mean_energy.sum(axis=1) / (period - 1))
    plausible = (blocks >= _FEWEST_WINDOWS) & (mean_energy.min(axis=1) <= bound)
    for n in np.flatnonzero(plausible).tolist():
        one = _test_pattern(energy[n, moving[n]], len(relations), ratio, form, float(rounding[n]))
        if one is not None:
            yield n, one


def _test_pattern(
    energy: Array, window: int, ratio: Fraction, form: Form, rounding: float
) -> _Pattern | None:
    """Find a row with a sample: the one with the smallest residual energy (blocks, period)."""
    period = ratio.denominator
    logs = np.log(energy + (1e-3 * rounding) ** 2)
    contrast = (logs.sum(axis=1, keepdims=True) - logs) / (period - 1) - logs
    origin = int(np.argmax(contrast.mean(axis=0)))
    energy_at_origin = float(energy[:, origin].mean())
    others = (float(energy.mean()) * period - energy_at_origin) / (period - 1)
    mean = float(contrast[:, origin].mean())
    if energy_at_origin > max((_ROUNDING * rounding) ** 2, _EXACT * others):
        return None
    # relations that hold by chance would have rounding errors
    if energy_at_origin < (_LESS_THAN_ROUNDED * rounding) ** 2 and mean > _PLAIN_CONTRAST:
        return _Pattern(form, ratio, origin, energy_at_origin**0.5)
    # windows that share rows are not independent
    blocks = len(energy) * period // max(window, period)
    if blocks < _FEWEST_BLOCKS:
        return None
    each = np.array([one.mean() for one in np.array_split(contrast[:, origin], blocks)])
    error = float(each.std(ddof=1)) / blocks**0.5
    if each.mean() < max(_LEAST_CONTRAST, error * float(t.isf(_ALARM, blocks - 1))):
        return None
    return _Pattern(form, ratio, origin, energy_at_origin**0.5)


def _filled_band(values: Array, rounding: float) -> float | None:
    """Share of the frequency band that a low-passed channel fills; None if there is no cliff.

    The motion of roads and cars may end at any frequency; only at rest does a channel consist of
    noise alone.  Noise falls by 6 dB per octave behind the pole of a sensor, and by 24 dB behind an
    analogue filter of fourth order.  A cliff is steeper than that, begins at a plateau that is not,
    and has only rounding errors above.  A steady motion may end as steeply, but has the noise of
    the sensor above it.
    """
    for length in _SEGMENTS:
        if np.count_nonzero(np.isfinite(values)) < 6 * length:
            continue
        frequency, power, count = _noise_spectrum(values, length, rounding)
        floor = rounding**2 * float(np.sum(np.hanning(length) ** 2))
        for corner in frequency[(frequency > 6.0 / length) & (frequency < _WIDEST)]:
            plateau = power[(frequency > 0.5 * corner) & (frequency <= corner / _CLIFF)]
            beyond = power[frequency >= corner * _CLIFF]
            lower, upper = np.array_split(plateau, 2)
            if len(lower) < 2 or len(upper) < 2 or len(beyond) < 4:
                continue
            top, bottom = float(np.median(upper)), float(np.max(median_filter(beyond, 3)))
            slope = 20.0 * abs(np.log10(np.median(lower) / top))  # dB per octave
            noise = float(np.mean(beyond)) / (1.0 + 3.0 / math.sqrt(count * len(beyond))) - floor
            if noise > _LEAK * top:
                continue
            if slope < _PLATEAU and bottom < 10.0 ** (-0.1 * _DROP) * top:
                # at the band edge, half of the amplitude remains
                return 2.0 * float(frequency[power > 0.25 * top][-1])
    return None


def _noise_spectrum(values: Array, length: int, rounding: float) -> tuple[Array, Array, int]:
    """Spectrum of the stretches with least motion, if they consist of noise, and their number.

    Otherwise the spectrum is empty.
    """
    if len(values) < 3 * length:
        return np.zeros(0), np.zeros(0), 0
    windows = np.lib.stride_tricks.sliding_window_view(values, length)[:: length // 2]
    variance = windows.var(axis=1)
    variance[~np.isfinite(variance)] = np.inf
    quiet = np.argsort(variance)[: max(3, len(windows) // 8)]
    least, most = float(variance[quiet[0]]), float(variance[quiet[-1]])
    # the variance of noise is similar in all stretches, that of a small motion is not
    if not rounding**2 < most < min(_QUIET * float(np.nanvar(values)), _STEADY * least):
        return np.zeros(0), np.zeros(0), 0
    part = detrend(windows[quiet], axis=1) * np.hanning(length)
    power = np.mean(np.abs(np.fft.rfft(part, axis=1)) ** 2, axis=0)
    return np.asarray(np.fft.rfftfreq(length)), np.asarray(power) + 1e-30, len(quiet)


def at_own_rate(recording: Recording) -> Recording:
    """Replace resampled channels by their original readings.

    Parameters
    ----------
    recording : Recording
        Recording as read.

    Returns
    -------
    Recording
        The same object if no channel was resampled.  Otherwise a recording with a row for each time
        at which any channel has a reading, and warnings that describe the resampling.
    """
    on_rows = [_on_even_grid(recording, c) for c in range(len(recording.channels))]
    resamplings = iter(_find_each([values for values in on_rows if values is not None]))
    found_by_channel = [None if values is None else next(resamplings) for values in on_rows]
    if all(one is None for one in found_by_channel):
        return recording
    found_by_channel = [
        one or _resampling_of_others(recording.values[c], found_by_channel)
        for c, one in enumerate(found_by_channel)
    ]
    # a program filters all channels alike; the smallest bandwidth is the safe choice
    bands = [one.ratio for one in found_by_channel if one is not None and one.form is None]
    found_by_channel = [
        one._replace(ratio=min(bands)) if one is not None and one.form is None else one
        for one in found_by_channel
    ]
    columns = []
    for c, one in enumerate(found_by_channel):
        finite = np.isfinite(recording.values[c])
        time, values = recording.time[finite], recording.values[c, finite]
        columns.append((time, values) if one is None else _original_readings(time, values, one))
    stamps = np.unique(np.concatenate([time for time, _ in columns]))
    stamps = stamps[np.diff(stamps, prepend=-np.inf) > _SAME_STAMP]
    values = np.full((len(columns), len(stamps)), np.nan)
    for c, (time, readings) in enumerate(columns):
        values[c, np.searchsorted(stamps, time + _SAME_STAMP, side="right") - 1] = readings
    return replace(
        recording,
        time=stamps,
        values=values,
        metadata=tuple(pair for pair in recording.metadata if pair[0] != "sample_rate"),
        warnings=(*recording.warnings, *_sentences(recording, found_by_channel)),
    )


def _on_even_grid(recording: Recording, c: int) -> Array | None:
    """Return a channel on an even grid of rows; None if it has too few, or if there is no grid."""
    finite = np.isfinite(recording.values[c])
    if np.count_nonzero(finite) < _FEWEST_ROWS:
        return None
    rows = _row_indices(recording.time[finite])
    if rows is None:
        return None
    values = np.full(int(rows[-1]) + 1, np.nan)
    values[rows] = recording.values[c, finite]
    return values


def _row_indices(time: Array) -> NDArray[np.int64] | None:
    """Return the indices of rows on an even grid; None if time stamps are uneven."""
    steps = np.diff(time)
    step = float(np.median(steps))
    rows = np.concatenate([[0], np.cumsum(np.rint(steps / step))]).astype(np.int64)
    if rows[-1] > 2 * len(rows) or np.any(np.diff(rows) < 1):
        return None
    slope, first = np.polyfit(rows, time, 1)
    return rows if np.max(np.abs(time - first - slope * rows)) < _GRID * step else None


def _resampling_of_others(values: Array, resamplings: list[Resampling | None]) -> Resampling | None:
    """Resampling of the other channels, if this channel is consistent with it.

    A sensor whose noise is smaller than the steps of its converter has no information of its own.
    """
    if not np.isfinite(values).all() or len(values) < _FEWEST_ROWS:
        return None
    rounding = _rounding(values)
    for one in resamplings:
        if one is None:
            continue
        if one.form is None:
            if len(_noise_spectrum(values, _SEGMENTS[-1], rounding)[0]) == 0:
                return one
            continue
        relations = _relations(one.ratio, one.form)
        if len(values) < one.origin + len(relations):
            continue
        windows = np.lib.stride_tricks.sliding_window_view(values, len(relations))
        residuals = windows[one.origin :: one.ratio.denominator] @ relations
        if np.mean(residuals**2) < (_ROUNDING * rounding) ** 2:
            return one
    return None


def _original_readings(time: Array, values: Array, one: Resampling) -> tuple[Array, Array]:
    """Return the times and readings of a channel before resampling."""
    rows = _row_indices(time)
    assert rows is not None
    ratio = float(one.ratio)
    if one.form is None:
        # keep as many of the rows as correspond to the bandwidth
        kept = np.diff(np.floor(rows * ratio + 1e-9), prepend=-1.0) > 0.0
        return time[kept], values[kept]
    first = int(np.ceil((rows[0] - one.origin) * ratio - 1e-9))
    last = int(np.floor((rows[-1] - one.origin) * ratio + 1e-9))
    samples = one.origin + np.arange(first, last + 1) / ratio
    at = np.rint(samples)
    on_row = np.abs(samples - at) < 1e-6
    if one.form.degree == 0:
        at, on_row = np.ceil(samples - 1e-6), np.ones(len(samples), bool)
    place = np.minimum(np.searchsorted(rows, at), len(rows) - 1)
    on_row &= rows[place] == at
    readings = np.where(on_row, values[place], np.nan)
    if not on_row.all():
        readings[~on_row] = _spline_at_samples(rows, values, samples, one.form)[~on_row]
    has_value = np.isfinite(readings)
    return np.interp(samples[has_value], rows, time), readings[has_value]


def _spline_at_samples(rows: NDArray[np.int64], values: Array, samples: Array, form: Form) -> Array:
    """Least-squares spline with knots at samples, evaluated there; NaN beside missing rows."""
    out = np.full(len(samples), np.nan)
    for part in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(rows) > 1) + 1):
        low, high = float(rows[part[0]]), float(rows[part[-1]])
        in_part = (samples >= low) & (samples <= high)
        inside = np.repeat(samples[(samples > low) & (samples < high)], form.multiplicity)
        ends = form.degree + 1
        if len(part) < len(inside) + ends or not in_part.any():
            continue
        knots = np.concatenate([np.full(ends, low), inside, np.full(ends, high)])
        try:
            spline = make_lsq_spline(rows[part].astype(float), values[part], knots, form.degree)
        except (ValueError, np.linalg.LinAlgError):  # too few rows between two knots
            continue
        out[in_part] = spline(samples[in_part])
    return out


def _sentences(recording: Recording, resamplings: list[Resampling | None]) -> list[str]:
    """Messages about resampled channels, one for all channels with the same resampling."""
    source = Path(recording.source).name or "the recording"
    alike: dict[tuple[str, int, int], list[int]] = {}
    for c, one in enumerate(resamplings):
        if one is not None:
            finite = np.isfinite(recording.values[c])
            rate = 1.0 / float(np.median(np.diff(recording.time[finite])))
            words = "low-passed" if one.form is None else one.form.words
            alike.setdefault((words, round(rate), round(rate * float(one.ratio))), []).append(c)
    out = []
    for (words, rate, original_rate), channels in alike.items():
        names = [channel(recording.channels[c]).words for c in channels]
        listed = " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
        who = "all channels" if len(channels) == len(resamplings) else f"the {listed}"
        be = "was" if len(channels) == 1 else "were"
        out.append(
            f"{who} of {source} {be} low-passed at {original_rate / 2:g} Hz; "
            f"of the {rate} rows a second, {original_rate} are used"
            if words == "low-passed"
            else f"{who} of {source} {be} read at {original_rate} Hz and {words} {rate} Hz; "
            f"the readings at {original_rate} Hz are used"
        )
    return out
