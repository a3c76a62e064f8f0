"""Channels that were resampled before they came here: recognised, and used at their own rate.

A program that exports all channels of a logger at one rate repeats the readings of a slower
channel, joins them by straight lines or cubics, or filters them.  Such a file has more rows than
readings; taken row by row it would give intervals that are too narrow.

What was held, or interpolated by polynomials, is a spline whose knots lie at the samples: between
rows there are exact linear relations, in a pattern that repeats as the knots pass the rows.  A
sensor's record, however smooth, has no such pattern.  What was low-passed ends at a cliff in its
spectrum, with its noise below and next to nothing above.
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
    """How readings were carried from one rate to another.

    Parameters
    ----------
    words : str
        For messages.
    degree : int
        Of the polynomials between two samples.
    multiplicity : int
        Of a knot of the spline that they form.
    """

    words: str
    degree: int
    multiplicity: int


HELD = Form("held at", 0, 1)
LINEAR = Form("interpolated linearly to", 1, 1)
CUBIC = Form("interpolated by a cubic spline to", 3, 1)
HERMITE = Form("interpolated by cubics to", 3, 2)

FORMS = (HELD, LINEAR, CUBIC, HERMITE)

_GRID = 0.1  # of a row's step by which a stamp may be off the even grid
_LIVELY = 2000  # rows that are looked at, those with the most motion
_FEWEST_ROWS = 60
# Ratios of rates: all fractions of small numbers, and what is common beside them.
_LARGEST = 12
_FURTHER = tuple(Fraction(p, 25) for p in range(1, 25)) + tuple(
    Fraction(1, q) for q in (15, 16, 20, 32, 40, 50, 64, 100)
)
_RELATIONS = 4  # that a window has at least
_MOST_RELATIONS = 16  # of a window that are looked at
_ABOVE_STEP = 2.0  # rms of the other relations over that of rounding where they tell something
# Where relations hold, they leave the rounding of the export, and in part that of the samples, or
# next to nothing of what they leave at other rows (a program rounds to digits, not to steps).
_ROUNDING, _EXACT = 1.7, 1e-3
# Some 500 patterns of up to 25 offsets are tested in each of four channels or more: at this level
# one record in fifty thousand passes by chance, and has to pass the rounding as well.
_ALARM = 1e-9
_LEAST_CONTRAST = 1.0  # of the logarithms of what relations leave at other rows and where they hold
_FEWEST_WINDOWS, _FEWEST_BLOCKS = 10, 5
# Relations of numbers that were not rounded again hold to the last digit; then no test is needed.
_LESS_THAN_ROUNDED, _PLAIN_CONTRAST = 0.01, 9.2
_ALIKE = 2.0  # ratio of rms of two patterns of relations that hold as well
_SEGMENTS = (256, 64)  # rows of which a spectrum is taken
_QUIET = 0.01  # share of the variance of a record in which there is noise alone
_STEADY = 4.0  # largest over least variance of stretches of noise
_CLIFF = 2.0**0.2  # ratio of frequencies on either side of a corner between which a cliff falls
_PLATEAU, _DROP = 12.0, 14.0  # dB in an octave before it, at most; dB that it falls, at least
_LEAK = 1e-5  # of the power of a plateau, that a filter of 50 dB lets through
_WIDEST = 0.42  # cycles a row: converters of genuine records end above
_SAME_STAMP = 2e-7  # s
_RELATIVE_ROUNDING = 3e-7  # of the largest value: that of single precision


class Resampling(NamedTuple):
    """How a channel was resampled.

    Parameters
    ----------
    form : Form or None
        None for a channel that was low-passed.
    ratio : Fraction
        Its own rate (twice its bandwidth, where it was low-passed) over that of its rows.
    origin : int
        A row at which a sample lies.
    """

    form: Form | None
    ratio: Fraction
    origin: int = 0


def find_resampling(values: Array) -> Resampling | None:
    """Recognise a channel that was held, interpolated or low-passed.

    Parameters
    ----------
    values : (N,) array
        Readings on an even grid of rows, in the unit in which they were rounded; NaN where one is
        missing.

    Returns
    -------
    Resampling or None
        None for a record as a sensor gives it, or for one that does not tell.
    """
    return _find_each([values])[0]


def _find_each(channels: list[Array]) -> list[Resampling | None]:
    """Do what :func:`find_resampling` does for several channels of a recording at once."""
    rows = [_lively(values, _LIVELY) for values in channels]
    parts = [values[one] for values, one in zip(channels, rows, strict=True)]
    told = [c for c, x in enumerate(parts) if np.count_nonzero(np.isfinite(x)) >= _FEWEST_ROWS]
    rounding = {c: _rounding(parts[c]) for c in told}
    lengths = {len(parts[c]) for c in told}
    alike = [[c for c in told if len(parts[c]) == length] for length in lengths]
    found: dict[int, list[_Pattern]] = {c: [] for c in told}
    for which in alike:
        stacked = np.stack([parts[c] for c in which])
        errors = np.array([rounding[c] for c in which])
        for form in FORMS:
            for ratio in _ratios(form):
                for n, one in _patterns(stacked, ratio, form, errors):
                    found[which[n]].append(one)
    return [
        _best(channels[c], found[c], rounding[c], rows[c].start) if c in found else None
        for c in range(len(channels))
    ]


def _best(values: Array, found: list[_Pattern], rounding: float, first: int) -> Resampling | None:
    """Pick one of the patterns that were found in a channel from its row ``first`` on."""
    if not found:
        share = _band(values, rounding)
        return None if share is None else Resampling(None, Fraction(share).limit_denominator(1000))
    # A spline with more knots, or of more freedom, has the same relations and others less.
    least = _ALIKE * min(one.residual_rms for one in found) + 1e-6 * rounding
    best = min((one for one in found if one.residual_rms <= least), key=lambda one: one.freedom)
    return Resampling(best.form, best.ratio, (best.origin + first) % best.ratio.denominator)


def _lively(values: Array, rows: int) -> slice:
    """Stretch of some rows with the most motion."""
    return most_active(np.nan_to_num(np.diff(values, prepend=values[0])) ** 2, rows)


def _rounding(values: Array) -> float:
    """Rms error of rounding, from the least difference of two values."""
    there = values[np.isfinite(values)]
    scale = float(np.max(np.abs(there)))
    apart = np.diff(np.unique(there))
    apart = apart[apart > 1e-12 * scale]
    step = float(apart.min()) if len(apart) else 0.0
    return max(step, _RELATIVE_ROUNDING * scale) / math.sqrt(12.0)


@lru_cache(maxsize=8)
def _ratios(form: Form) -> tuple[Fraction, ...]:
    """Ratios of rates, rising, at which a spline of a form leaves relations between rows."""
    small = {Fraction(p, q) for q in range(2, _LARGEST + 1) for p in range(1, q)}
    most = Fraction(9, 10) / form.multiplicity
    return tuple(sorted(ratio for ratio in small.union(_FURTHER) if ratio < most))


@lru_cache(maxsize=1024)
def _relations(ratio: Fraction, form: Form) -> Array:
    """Orthonormal relations (w, d) between w rows, the first of them at a sample."""
    left = 1.0 - form.multiplicity * float(ratio)
    rows = max(int((form.degree + 1 + _RELATIONS) / left), int(2.0 / float(ratio))) + 2
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
    """Relations that hold: a spline of a form and a ratio of rates, and rms of what is left."""

    form: Form
    ratio: Fraction
    origin: int
    residual_rms: float

    @property
    def freedom(self) -> Fraction:
        """Numbers a row that the spline takes."""
        return self.ratio * self.form.multiplicity


def _patterns(
    values: Array, ratio: Fraction, form: Form, rounding: Array
) -> Iterator[tuple[int, _Pattern]]:
    """Find channels (C, N) in which the relations of a form hold, again and again."""
    relations = _relations(ratio, form)
    period = ratio.denominator
    count = (values.shape[1] - len(relations) + 1) // period
    if count < _FEWEST_WINDOWS:
        return
    used = values[:, : count * period + len(relations) - 1]
    windows = np.lib.stride_tricks.sliding_window_view(used, len(relations), axis=1)
    left = windows.reshape(-1, len(relations)) @ relations
    energy = np.einsum("ij,ij->i", left, left).reshape(-1, count, period) / left.shape[1]
    # Where nothing moves, relations hold at any row.
    moving = energy.mean(axis=2) > (_ABOVE_STEP * rounding[:, None]) ** 2  # none that is missing
    blocks = np.count_nonzero(moving, axis=1)
    mean_energy = np.einsum("cbp,cb->cp", np.where(moving[:, :, None], energy, 0.0), moving)
    mean_energy /= np.maximum(blocks, 1)[:, None]
    bound = np.maximum((_ROUNDING * rounding) ** 2, _EXACT * mean_energy.sum(axis=1) / (period - 1))
    plausible = (blocks >= _FEWEST_WINDOWS) & (mean_energy.min(axis=1) <= bound)
    for n in np.flatnonzero(plausible).tolist():
        one = _pattern(energy[n, moving[n]], len(relations), ratio, form, float(rounding[n]))
        if one is not None:
            yield n, one


def _pattern(
    energy: Array, window: int, ratio: Fraction, form: Form, rounding: float
) -> _Pattern | None:
    """Find a row with a sample: one at which what relations leave (blocks, period) is least."""
    period = ratio.denominator
    logs = np.log(energy + (1e-3 * rounding) ** 2)
    contrast = (logs.sum(axis=1, keepdims=True) - logs) / (period - 1) - logs
    origin = int(np.argmax(contrast.mean(axis=0)))
    own = float(energy[:, origin].mean())
    others = (float(energy.mean()) * period - own) / (period - 1)
    mean = float(contrast[:, origin].mean())
    if own > max((_ROUNDING * rounding) ** 2, _EXACT * others):
        return None
    # Rounding leaves something of relations that hold by chance.
    if own < (_LESS_THAN_ROUNDED * rounding) ** 2 and mean > _PLAIN_CONTRAST:
        return _Pattern(form, ratio, origin, own**0.5)
    # Windows overlap, so that as many as share rows count once.
    blocks = len(energy) * period // max(window, period)
    if blocks < _FEWEST_BLOCKS:
        return None
    each = np.array([one.mean() for one in np.array_split(contrast[:, origin], blocks)])
    error = float(each.std(ddof=1)) / blocks**0.5
    if each.mean() < max(_LEAST_CONTRAST, error * float(t.isf(_ALARM, blocks - 1))):
        return None
    return _Pattern(form, ratio, origin, own**0.5)


def _band(values: Array, rounding: float) -> float | None:
    """Share of its band that a low-passed channel fills; None where its noise has no cliff.

    Roads and cars may end at any frequency: only where they are at rest is there noise alone.
    Noise that passed the pole of a sensor falls by 6 dB in an octave, and by 24 dB behind an
    analogue filter of fourth order.  A cliff is steeper than that, begins at a plateau that is not,
    and nothing but rounding is beyond it.  A motion that is steady for a while ends as steeply, but
    beyond it is the sensor's noise.
    """
    for length in _SEGMENTS:
        if np.count_nonzero(np.isfinite(values)) < 6 * length:
            continue
        frequency, power, count = _at_rest(values, length, rounding)
        floor = rounding**2 * float(np.sum(np.hanning(length) ** 2))
        for corner in frequency[(frequency > 6.0 / length) & (frequency < _WIDEST)]:
            plateau = power[(frequency > 0.5 * corner) & (frequency <= corner / _CLIFF)]
            beyond = power[frequency >= corner * _CLIFF]
            lower, upper = np.array_split(plateau, 2)
            if len(lower) < 2 or len(upper) < 2 or len(beyond) < 4:
                continue
            top, bottom = float(np.median(upper)), float(np.max(median_filter(beyond, 3)))
            slope = 20.0 * abs(np.log10(np.median(lower) / top))  # dB an octave
            noise = float(np.mean(beyond)) / (1.0 + 3.0 / math.sqrt(count * len(beyond))) - floor
            if noise > _LEAK * top:
                continue
            if slope < _PLATEAU and bottom < 10.0 ** (-0.1 * _DROP) * top:
                # Half the amplitude is left at the edge of a band.
                return 2.0 * float(frequency[power > 0.25 * top][-1])
    return None


def _at_rest(values: Array, length: int, rounding: float) -> tuple[Array, Array, int]:
    """Spectrum of the quietest stretches, if they hold noise alone, and their number.

    Empty where they do not.
    """
    if len(values) < 3 * length:
        return np.zeros(0), np.zeros(0), 0
    windows = np.lib.stride_tricks.sliding_window_view(values, length)[:: length // 2]
    variance = windows.var(axis=1)
    variance[~np.isfinite(variance)] = np.inf
    quiet = np.argsort(variance)[: max(3, len(windows) // 8)]
    least, most = float(variance[quiet[0]]), float(variance[quiet[-1]])
    # Noise is alike from one stretch to the next; the first sign of a motion is not.
    if not rounding**2 < most < min(_QUIET * float(np.nanvar(values)), _STEADY * least):
        return np.zeros(0), np.zeros(0), 0
    part = detrend(windows[quiet], axis=1) * np.hanning(length)
    power = np.mean(np.abs(np.fft.rfft(part, axis=1)) ** 2, axis=0)
    return np.asarray(np.fft.rfftfreq(length)), np.asarray(power) + 1e-30, len(quiet)


def at_own_rate(recording: Recording) -> Recording:
    """Replace channels that were resampled by the readings from which that was done.

    Parameters
    ----------
    recording : Recording
        As read.

    Returns
    -------
    Recording
        The same object where no channel was resampled; else one with a row for each time at which
        any channel has a reading, and a warning for what was found.
    """
    on_rows = [_on_rows(recording, c) for c in range(len(recording.channels))]
    told = iter(_find_each([values for values in on_rows if values is not None]))
    found = [None if values is None else next(told) for values in on_rows]
    if all(one is None for one in found):
        return recording
    found = [one or _like_others(recording.values[c], found) for c, one in enumerate(found)]
    # A program filters all channels alike, and the least bandwidth claims too much of none.
    bands = [one.ratio for one in found if one is not None and one.form is None]
    found = [
        one._replace(ratio=min(bands)) if one is not None and one.form is None else one
        for one in found
    ]
    columns = []
    for c, one in enumerate(found):
        there = np.isfinite(recording.values[c])
        time, values = recording.time[there], recording.values[c, there]
        columns.append((time, values) if one is None else _readings(time, values, one))
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
        warnings=(*recording.warnings, *_sentences(recording, found)),
    )


def _on_rows(recording: Recording, c: int) -> Array | None:
    """Return a channel on an even grid of rows; None where it has too few, or no such grid."""
    there = np.isfinite(recording.values[c])
    if np.count_nonzero(there) < _FEWEST_ROWS:
        return None
    rows = _rows(recording.time[there])
    if rows is None:
        return None
    values = np.full(int(rows[-1]) + 1, np.nan)
    values[rows] = recording.values[c, there]
    return values


def _rows(time: Array) -> NDArray[np.int64] | None:
    """Numbers of rows on an even grid; None where stamps are not on one."""
    steps = np.diff(time)
    step = float(np.median(steps))
    rows = np.concatenate([[0], np.cumsum(np.rint(steps / step))]).astype(np.int64)
    if rows[-1] > 2 * len(rows) or np.any(np.diff(rows) < 1):
        return None
    slope, first = np.polyfit(rows, time, 1)
    return rows if np.max(np.abs(time - first - slope * rows)) < _GRID * step else None


def _like_others(values: Array, found: list[Resampling | None]) -> Resampling | None:
    """Resampling of other channels, for one of the same rows that contradicts none of it.

    A sensor whose noise is hidden by the steps of its converter tells nothing by itself.
    """
    if not np.isfinite(values).all() or len(values) < _FEWEST_ROWS:
        return None
    rounding = _rounding(values)
    for one in found:
        if one is None:
            continue
        if one.form is None:
            if len(_at_rest(values, _SEGMENTS[-1], rounding)[0]) == 0:
                return one
            continue
        relations = _relations(one.ratio, one.form)
        if len(values) < one.origin + len(relations):
            continue
        windows = np.lib.stride_tricks.sliding_window_view(values, len(relations))
        left = windows[one.origin :: one.ratio.denominator] @ relations
        if np.mean(left**2) < (_ROUNDING * rounding) ** 2:
            return one
    return None


def _readings(time: Array, values: Array, one: Resampling) -> tuple[Array, Array]:
    """Return times and readings of a channel before it was resampled."""
    rows = _rows(time)
    assert rows is not None
    ratio = float(one.ratio)
    if one.form is None:
        # As many as the band holds, of the rows as they are.
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
        readings[~on_row] = _between(rows, values, samples, one.form)[~on_row]
    there = np.isfinite(readings)
    return np.interp(samples[there], rows, time), readings[there]


def _between(rows: NDArray[np.int64], values: Array, samples: Array, form: Form) -> Array:
    """Spline with its knots at samples through rows, at the samples; NaN beside missing rows."""
    out = np.full(len(samples), np.nan)
    for part in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(rows) > 1) + 1):
        low, high = float(rows[part[0]]), float(rows[part[-1]])
        mine = (samples >= low) & (samples <= high)
        inside = np.repeat(samples[(samples > low) & (samples < high)], form.multiplicity)
        ends = form.degree + 1
        if len(part) < len(inside) + ends or not mine.any():
            continue
        knots = np.concatenate([np.full(ends, low), inside, np.full(ends, high)])
        try:
            spline = make_lsq_spline(rows[part].astype(float), values[part], knots, form.degree)
        except (ValueError, np.linalg.LinAlgError):  # too few rows between two knots
            continue
        out[mine] = spline(samples[mine])
    return out


def _sentences(recording: Recording, found: list[Resampling | None]) -> list[str]:
    """Say what was found and what was done, once for channels that are alike."""
    source = Path(recording.source).name or "the recording"
    alike: dict[tuple[str, int, int], list[int]] = {}
    for c, one in enumerate(found):
        if one is not None:
            there = np.isfinite(recording.values[c])
            rate = 1.0 / float(np.median(np.diff(recording.time[there])))
            words = "low-passed" if one.form is None else one.form.words
            alike.setdefault((words, round(rate), round(rate * float(one.ratio))), []).append(c)
    out = []
    for (words, rate, own), channels in alike.items():
        names = [channel(recording.channels[c]).words for c in channels]
        listed = " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
        who = "all channels" if len(channels) == len(found) else f"the {listed}"
        be = "was" if len(channels) == 1 else "were"
        out.append(
            f"{who} of {source} {be} low-passed at {own / 2:g} Hz; of the {rate} rows a second, "
            f"{own} are used"
            if words == "low-passed"
            else f"{who} of {source} {be} read at {own} Hz and {words} {rate} Hz; the readings "
            f"at {own} Hz are used"
        )
    return out
