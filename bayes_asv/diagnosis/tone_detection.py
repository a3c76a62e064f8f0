"""Detection of tones that wander, in the innovations of several runs together.

An engine's speed drifts by some per cent within a run: its tone is a single line only within a
short segment, a hump of several over the whole run, and it is present in every run.  A weak one
stands out of the mean spectrum of segments as short as its line lasts, where no line of a single
run does.

Two things have a hump as well and are no engine: a shock that excites a resonance, whereas an
engine's tone is present at most times; and a body whose vibration covers a wide band, whereas an
engine's speed does not vary by half as much again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.signal import sosfilt, sosfreqz
from scipy.stats import f, gamma

from bayes_asv.preprocessing.tone_removal import (
    MOST_TONES,
    SETTLING_TIME_CONSTANTS,
    Notch,
    is_persistent,
    is_wide,
    notch_filter,
    notch_of,
)

__all__ = ["DetectedTones", "detect_tones"]

Array = NDArray[np.float64]

_SEGMENTS = (2.5, 0.75, 0.45, 0.25)  # s, how long a wandering tone may be a single line
_OVERSAMPLING = 4  # frequencies a line: half way between two lines each has 0.4 of a tone's energy
# Effective number of tests a line and direction: gives the intended false-alarm rate
# (docs/method.md).
_TESTS_PER_DIRECTION = 1.5
_FLOOR_WIDTH = 60.0  # Hz around a line, whose median power is its floor
_MIN_FLOOR_LINES = 17  # where there are so many
_MAX_FLOOR_SHARE = 0.5  # of all lines
_MIN_RATIO = 1.5  # of a line to its floor; below it may be a slope or the edge of a notch
_MIN_GAIN = 0.5  # of a notch, below which no tone is looked for in it
_LOG_P_UNDERFLOW = -600.0  # below which a log-probability is replaced by a bound


class DetectedTones(NamedTuple):
    """Tones that were detected.

    Parameters
    ----------
    tones : tuple of Notch
        The strongest first.
    log_p : float
        Logarithm of the p-value of the strongest: of how many tones as strong as that white runs
        have on average; zero if there is none.
    """

    tones: tuple[Notch, ...] = ()
    log_p: float = 0.0


def detect_tones(
    runs: Sequence[Array], rate: float, slowest: float, alarm: float, *, engine: bool = True
) -> DetectedTones:
    """Find tones in the innovations of all runs.

    The most significant line is removed, as wide as it may wander, and the rest is searched again.

    Parameters
    ----------
    runs : sequence of (R, n) arrays
        Normalised innovations of n channels in time order; nan where a reading is missing.
    rate : float
        Groups of readings a second, Hz.
    slowest : float
        Lowest frequency of a tone, Hz.
    alarm : float
        Accepted number of false tones in white runs.
    engine : bool
        Accept only what an engine may have: the strongest tone is present at most times and
        wanders through a narrow band.
    """
    signals = [np.nan_to_num(nu) for nu in runs if len(nu)]
    tones: list[Notch] = []
    first = 0.0
    while signals and len(tones) < MOST_TONES:
        rest = _without(tones, signals, rate)
        frequency, log_p = _most_significant(rest, rate, slowest, tones) if rest else (0.0, 0.0)
        if not log_p < math.log(alarm):
            break
        first = first if tones else log_p
        tones.append(notch_of(frequency))
    if engine and tones and (is_wide(tones) or not is_persistent(signals, tones[0], rate)):
        return DetectedTones()
    return DetectedTones(tuple(tones), first)


def _without(tones: Sequence[Notch], signals: Sequence[Array], rate: float) -> list[Array]:
    """Remove tones from signals, and the time in which the filters settle."""
    if not tones:
        return list(signals)
    sections = notch_filter(tones, rate)
    settled = round(
        SETTLING_TIME_CONSTANTS / (2.0 * math.pi * min(n.half_width for n in tones)) * rate
    )
    return [sosfilt(sections, x, axis=0)[settled:] for x in signals if len(x) > settled]


def _most_significant(
    runs: Sequence[Array], rate: float, slowest: float, tones: Sequence[Notch] = ()
) -> tuple[float, float]:
    """Frequency (Hz) of the most significant line, and the logarithm of its p-value.

    Searched for in segments of several lengths and in four directions, since one force moves both
    channels.  The prior density of a tone is uniform over the logarithm of its frequency.  What
    notches took from white innovations is compensated, or their skirts would lower the floor of all
    other lines.
    """
    smallest, at = 0.0, 0.0
    lengths = _lengths(runs, rate)
    directions = _directions(runs[0].shape[1])
    for n in lengths:
        frequency, power, segments = _spectra([x @ directions.T for x in runs], n, rate)
        gain = _gain(tones, frequency, rate)
        # a line below the lowest frequency is as wide as this at its foot
        low, high = slowest + rate / n, 0.5 * rate - 1.0
        usable = (frequency > low) & (frequency < high) & (gain > _MIN_GAIN)
        if not np.any(usable):
            continue
        flat = power / np.maximum(gain, _MIN_GAIN / 5.0)[:, None]
        log_p = _log_p_values(flat, n, rate, segments)
        octaves = frequency[usable] * np.mean(1.0 / frequency[usable])
        per_line = _TESTS_PER_DIRECTION * len(directions)
        tests = per_line * len(lengths) * np.count_nonzero(usable) / _OVERSAMPLING
        corrected = np.log(tests * octaves) + log_p[usable].min(axis=1)
        k = int(np.argmin(corrected))
        if corrected[k] < smallest:
            smallest, at = float(corrected[k]), float(frequency[usable][k])
    return at, smallest


def _directions(count: int) -> Array:
    """Rows: each of some channels, and each pair of them in phase and in antiphase."""
    single = np.eye(count)
    pairs = [
        0.5**0.5 * (single[a] + sign * single[b])
        for a in range(count)
        for b in range(a + 1, count)
        for sign in (1.0, -1.0)
    ]
    return np.vstack([single, *pairs])


def _lengths(runs: Sequence[Array], rate: float) -> list[int]:
    """Return readings a segment, the longest first, none longer than a run of the usual length."""
    longest = max(len(x) for x in runs)
    shortest = min(len(x) for x in runs if 2 * len(x) >= longest)
    return sorted({min(round(seconds * rate), shortest) for seconds in _SEGMENTS}, reverse=True)


def _gain(tones: Sequence[Notch], frequency: Array, rate: float) -> Array:
    """Share (F,) of white power that notches pass."""
    gain = np.ones(len(frequency))
    for sections in notch_filter(tones, rate):
        gain *= np.abs(sosfreqz(sections[None], frequency, fs=rate)[1]) ** 2
    return gain


def _log_p_values(power: Array, n: int, rate: float, segments: int) -> Array:
    """Log-probability (F, C) of a line as far above its floor in white noise.

    Infinite where a line is so little above it that it may be a slope of the spectrum.
    """
    neighbours = min(
        max(_MIN_FLOOR_LINES, round(_FLOOR_WIDTH * n / rate)), round(_MAX_FLOOR_SHARE * n / 2.0)
    )
    neighbours = neighbours // 2 * 2 + 1
    ratio = np.array([one / _floor(one, neighbours, segments) for one in power.T]).T
    freedom = 2.0 * segments
    # The floor is uncertain as well: a median has the efficiency 0.64 of a mean of as many lines.
    log_p = _log_f_tail(ratio, freedom, 0.64 * neighbours * freedom)
    return np.where(ratio < _MIN_RATIO, np.inf, log_p)


def _spectra(runs: Sequence[Array], n: int, rate: float) -> tuple[Array, Array, int]:
    """Frequencies (F,), Hz, mean power (F, C) there of segments of n readings, and their number."""
    # White innovations do not leak from line to line; a window would only cost energy.
    parts = [x[: len(x) // n * n].reshape(-1, n, x.shape[1]) for x in runs]
    segments = np.concatenate(parts)
    power = np.abs(np.fft.rfft(segments, _OVERSAMPLING * n, axis=1)) ** 2 / n
    frequency = np.asarray(np.fft.rfftfreq(_OVERSAMPLING * n, 1.0 / rate))
    return frequency, np.asarray(power.mean(axis=0)), len(segments)


def _floor(power: Array, neighbours: int, segments: int) -> Array:
    """Mean power (F,) of white noise, from running medians over lines."""
    median = median_filter(power[::_OVERSAMPLING], size=neighbours)
    half = neighbours // 2  # near its ends a spectrum has neighbours on one side only
    median[:half], median[len(median) - half :] = median[half], median[-half - 1]
    floor = median * segments / float(gamma(segments).median())
    return np.maximum(np.repeat(floor, _OVERSAMPLING)[: len(power)], 1e-12)


def _log_f_tail(ratio: Array, a: float, b: float) -> Array:
    """Log-probability that F of a and b degrees of freedom exceeds a ratio.

    Where it underflows, Chernoff's bound replaces it.
    """
    with np.errstate(divide="ignore"):
        out = np.asarray(f(a, b).logsf(ratio))
        x = b / (b + a * ratio)
        bound = 0.5 * b * np.log(x * (a + b) / b) + 0.5 * a * np.log((1.0 - x) * (a + b) / a)
    return np.where(out > _LOG_P_UNDERFLOW, out, np.minimum(bound, _LOG_P_UNDERFLOW))
