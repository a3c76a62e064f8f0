"""Detection of wandering tones in the innovations of several runs together.

The speed of an engine drifts by some per cent within a run: its tone is a single spectral line only
within a short segment, and a peak over several lines in the whole run; and it is present in every
run.  In the mean spectrum of segments within which the tone is a single line, a weak tone exceeds
its neighbours, even if it does not in the spectrum of any whole run.

Two other causes have such a peak as well: a shock that excites a resonance, while an engine's tone
is present at most times; and vibration of the body over a wide band, while an engine's speed does
not vary by a factor of 1.5.
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

_SEGMENTS = (2.5, 0.75, 0.45, 0.25)  # lengths of a segment, s
# Frequencies evaluated per spectral line: half way between two lines, each has only 0.4 of a tone's
# energy.
_OVERSAMPLING = 4
# Effective number of tests per line and direction; gives the intended false-alarm rate
# (docs/method.md).
_TESTS_PER_DIRECTION = 1.5
_FLOOR_WIDTH = 60.0  # width around a line whose median power is the floor, Hz
_MIN_FLOOR_LINES = 17  # least number of lines for the floor, if the spectrum has as many
_MAX_FLOOR_SHARE = 0.5  # largest share of all lines for the floor
# Least ratio of a line to its floor; a smaller one may be a slope or the edge of a notch.
_MIN_RATIO = 1.5
_MIN_GAIN = 0.5  # gain of the notches below which no tone is searched for
_LOG_P_UNDERFLOW = -600.0  # log-probability below which a bound is used


class DetectedTones(NamedTuple):
    """Tones that were detected.

    Parameters
    ----------
    tones : tuple of Notch
        Tones, the strongest first.
    log_p : float
        Logarithm of the p-value of the strongest one: the expected number of tones of at least that
        strength in white runs.  Zero if there is no tone.
    """

    tones: tuple[Notch, ...] = ()
    log_p: float = 0.0


def detect_tones(
    runs: Sequence[Array], rate: float, slowest: float, alarm: float, *, engine: bool = True
) -> DetectedTones:
    """Find tones in the innovations of all runs.

    The most significant line is removed with the band in which it may wander, and the search is
    repeated.

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
        Accept only tones of an engine: the strongest one is present at most times, and adjacent
        ones cover a narrow band.
    """
    signals = [np.nan_to_num(nu) for nu in runs if len(nu)]
    tones: list[Notch] = []
    first = 0.0
    while signals and len(tones) < MOST_TONES:
        remaining = _remove_tones(tones, signals, rate)
        frequency, log_p = (
            _most_significant(remaining, rate, slowest, tones) if remaining else (0.0, 0.0)
        )
        if not log_p < math.log(alarm):
            break
        first = first if tones else log_p
        tones.append(notch_of(frequency))
    if engine and tones and (is_wide(tones) or not is_persistent(signals, tones[0], rate)):
        return DetectedTones()
    return DetectedTones(tuple(tones), first)


def _remove_tones(tones: Sequence[Notch], signals: Sequence[Array], rate: float) -> list[Array]:
    """Remove tones from signals, and the settling time of the notch filters."""
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

    Segments of several lengths are searched in several directions, since one force moves several
    channels.  The prior density of a tone is uniform over the logarithm of its frequency.  The
    power that notches remove from white innovations is compensated, since their skirts would lower
    the floor of other lines.
    """
    best_log_p, best_frequency = 0.0, 0.0
    lengths = _segment_lengths(runs, rate)
    directions = _channel_directions(runs[0].shape[1])
    for n in lengths:
        frequency, power, segments = _spectra([x @ directions.T for x in runs], n, rate)
        gain = _notch_gain(tones, frequency, rate)
        # the main lobe of a line below the lowest frequency is as wide as this
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
        if corrected[k] < best_log_p:
            best_log_p, best_frequency = float(corrected[k]), float(frequency[usable][k])
    return best_frequency, best_log_p


def _channel_directions(count: int) -> Array:
    """Return unit vectors (rows): each channel, and each pair in phase and in antiphase."""
    single = np.eye(count)
    pairs = [
        0.5**0.5 * (single[a] + sign * single[b])
        for a in range(count)
        for b in range(a + 1, count)
        for sign in (1.0, -1.0)
    ]
    return np.vstack([single, *pairs])


def _segment_lengths(runs: Sequence[Array], rate: float) -> list[int]:
    """Return numbers of readings per segment, the longest first, at most that of a usual run."""
    longest = max(len(x) for x in runs)
    shortest = min(len(x) for x in runs if 2 * len(x) >= longest)
    return sorted({min(round(seconds * rate), shortest) for seconds in _SEGMENTS}, reverse=True)


def _notch_gain(tones: Sequence[Notch], frequency: Array, rate: float) -> Array:
    """Share (F,) of white-noise power that notches pass."""
    gain = np.ones(len(frequency))
    for sections in notch_filter(tones, rate):
        gain *= np.abs(sosfreqz(sections[None], frequency, fs=rate)[1]) ** 2
    return gain


def _log_p_values(power: Array, n: int, rate: float, segments: int) -> Array:
    """Log-probability (F, C) of a line at least as far above its floor in white noise.

    Infinite for a line so little above its floor that it may be a slope of the spectrum.
    """
    neighbours = min(
        max(_MIN_FLOOR_LINES, round(_FLOOR_WIDTH * n / rate)), round(_MAX_FLOOR_SHARE * n / 2.0)
    )
    neighbours = neighbours // 2 * 2 + 1
    ratio = np.array([one / _noise_floor(one, neighbours, segments) for one in power.T]).T
    freedom = 2.0 * segments
    # the floor is uncertain as well: a median has 0.64 of the efficiency of a mean
    log_p = _log_f_tail(ratio, freedom, 0.64 * neighbours * freedom)
    return np.where(ratio < _MIN_RATIO, np.inf, log_p)


def _spectra(runs: Sequence[Array], n: int, rate: float) -> tuple[Array, Array, int]:
    """Frequencies (F,), Hz, mean power (F, C) of segments of n readings, and their number."""
    # white innovations do not leak between lines; a window would only reduce the energy
    parts = [x[: len(x) // n * n].reshape(-1, n, x.shape[1]) for x in runs]
    segments = np.concatenate(parts)
    power = np.abs(np.fft.rfft(segments, _OVERSAMPLING * n, axis=1)) ** 2 / n
    frequency = np.asarray(np.fft.rfftfreq(_OVERSAMPLING * n, 1.0 / rate))
    return frequency, np.asarray(power.mean(axis=0)), len(segments)


def _noise_floor(power: Array, neighbours: int, segments: int) -> Array:
    """Mean power (F,) of white noise, from running medians over lines."""
    median = median_filter(power[::_OVERSAMPLING], size=neighbours)
    half = neighbours // 2  # near its ends, a spectrum has neighbours on one side only
    median[:half], median[len(median) - half :] = median[half], median[-half - 1]
    floor = median * segments / float(gamma(segments).median())
    return np.maximum(np.repeat(floor, _OVERSAMPLING)[: len(power)], 1e-12)


def _log_f_tail(ratio: Array, a: float, b: float) -> Array:
    """Log-probability that F with a and b degrees of freedom exceeds a ratio.

    If it underflows, Chernoff's bound is used.
    """
    with np.errstate(divide="ignore"):
        out = np.asarray(f(a, b).logsf(ratio))
        x = b / (b + a * ratio)
        bound = 0.5 * b * np.log(x * (a + b) / b) + 0.5 * a * np.log((1.0 - x) * (a + b) / a)
    return np.where(out > _LOG_P_UNDERFLOW, out, np.minimum(bound, _LOG_P_UNDERFLOW))
