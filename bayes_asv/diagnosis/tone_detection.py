"""Tones that wander, in the innovations of several runs together.

An engine's speed drifts by some per cent within a run, so that its tone is one line for a moment
only, and a hump of several over the whole; it is heard in every run.  A weak one stands out of the
mean spectrum of segments as long as its line lasts, where no line of a single run does.

A jolt that rings has a hump as well; an engine hums in most moments.  And its speed does
not wander by half as much again: a body that shakes by itself from 8 to 36 Hz is no engine, and to
cut that out would cut out the gap.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.signal import sosfilt, sosfiltfilt, sosfreqz
from scipy.stats import chi2, f, gamma

from bayes_asv.preprocessing.tone_removal import Notch, notch_filter, notch_of, passing

__all__ = ["DetectedTones", "humming"]

Array = NDArray[np.float64]

_MOST = 16  # bands that are cut out; each of the tones of an engine that wanders takes several
_SEGMENTS = (2.5, 0.75, 0.45, 0.25)  # s: a tone that wanders is one line for as long
_BETWEEN = 4  # frequencies a line: between two lines a tone shows 0.4 of its energy in either
_SEEN_AS = np.array([[1.0, 0.0], [0.0, 1.0], [0.5**0.5, 0.5**0.5], [0.5**0.5, -(0.5**0.5)]])
"""Rows: the front alone, the rear alone, both alike, both opposite."""
_LOOKS = 6.0  # worth one each, a line: white runs hum as often as asked for (docs/method.md)
_FLOOR = 60.0  # Hz around a line whose median is its floor
_FEWEST = 17  # lines of a floor, where there are so many
_OF_ALL = 0.5  # lines that a floor may take
_LEAST = 1.5  # times its floor, below which a line may be a slope or the edge of a notch
_GAIN = 0.5  # of a notch, below which nothing is heard in it
_WIDEST = 1.5  # highest of the bands side by side over the lowest, where an engine wanders
_NEXT_TO = 2.6  # half-widths of a band, as far as the next one may be
_MOMENT = 0.25  # s
_AROUND = 1.5  # half-widths of a notch, in which a tone is asked whether it lasts
_STEADY = 0.55  # of the mean energy of all moments that the median one has of a tone that lasts
_SETTLED = 3.0  # time constants of the narrowest notch, in which the onset of a tone still rings
_SURE = -600.0  # logarithm of a probability, below which it is no number any more


class DetectedTones(NamedTuple):
    """Tones that were heard.

    Parameters
    ----------
    tones : tuple of Notch
        The strongest first.
    log_p : float
        Logarithm of how many tones as strong as that one white runs have; zero if there is none.
    """

    tones: tuple[Notch, ...] = ()
    log_p: float = 0.0


def humming(
    runs: Sequence[Array], rate: float, slowest: float, alarm: float, *, engine: bool = True
) -> DetectedTones:
    """Find tones in the innovations of all runs.

    The line that stands out most is cut out as wide as it may wander, and what is left is searched
    again.

    Parameters
    ----------
    runs : sequence of (R, 2) arrays
        Normalised innovations in time order; nan where a reading was missing.
    rate : float
        Pairs of readings a second, Hz.
    slowest : float
        Tones below are left out, Hz.
    alarm : float
        False tones that white runs may show.
    engine : bool
        Take for tones only what an engine may have: the strongest is there in most moments,
        and wanders through a narrow band.

    Returns
    -------
    DetectedTones
    """
    signals = [np.nan_to_num(nu) for nu in runs if len(nu)]
    found: list[Notch] = []
    first = 0.0
    while signals and len(found) < _MOST:
        left = _without(found, signals, rate)
        frequency, log_p = _loudest(left, rate, slowest, found) if left else (0.0, 0.0)
        if not log_p < math.log(alarm):
            break
        first = first if found else log_p
        found.append(notch_of(frequency))
    if engine and found and (_wide(found) or not _lasts(signals, found[0], rate)):
        return DetectedTones()
    return DetectedTones(tuple(found), first)


def _without(found: Sequence[Notch], signals: Sequence[Array], rate: float) -> list[Array]:
    """Return what is left without tones, once the filters have settled."""
    if not found:
        return list(signals)
    sections = notch_filter(found, rate)
    settled = round(_SETTLED / (2.0 * math.pi * min(n.half_width for n in found)) * rate)
    return [sosfilt(sections, x, axis=0)[settled:] for x in signals if len(x) > settled]


def _wide(found: Sequence[Notch]) -> bool:
    """Whether the bands side by side with the strongest are more than one tone that wanders."""
    low = high = found[0].frequency
    for _ in found:
        reached = _NEXT_TO * notch_of(high).half_width
        near = [n.frequency for n in found if low - reached <= n.frequency <= high + reached]
        low, high = min(near), max(near)
    return high > _WIDEST * low


def _lasts(runs: Sequence[Array], tone: Notch, rate: float) -> bool:
    """Whether a tone is there in most moments, and not in a few loud ones."""
    band = passing(Notch(tone.frequency, _AROUND * tone.half_width), rate)
    passed = float(np.mean(np.abs(sosfreqz(band, 2048)[1]) ** 4))  # forwards and backwards
    length = max(1, round(_MOMENT * rate))
    moments = [np.zeros(0)]
    for run in runs:
        if len(run) < 2 * length:
            continue
        power = np.sum(sosfiltfilt(band, run, axis=0) ** 2, axis=1)
        whole = power[: len(power) // length * length].reshape(-1, length)
        moments.append(whole.mean(axis=1) / (2.0 * passed * max(float(np.mean(run**2)), 1e-12)))
    each = np.concatenate(moments)
    if not len(each):
        return False
    freedom = 8.0 * _AROUND * tone.half_width * _MOMENT  # of noise in a moment, of both channels
    usual = float(np.median(each)) - float(chi2(freedom).median()) / freedom
    return usual > _STEADY * (float(np.mean(each)) - 1.0)


def _loudest(
    runs: Sequence[Array], rate: float, slowest: float, found: Sequence[Notch] = ()
) -> tuple[float, float]:
    """Frequency (Hz) of the line that stands out most, and the logarithm of its p-value.

    Looked for in segments of several lengths, in either channel and in both alike or opposite, as
    one force moves them.  Beforehand a tone is as likely in any octave.  What notches took from
    white innovations is given back, or their skirts would lower the floor of all others.
    """
    best, at = 0.0, 0.0
    lengths = _lengths(runs, rate)
    for n in lengths:
        frequency, power, segments = _spectra([x @ _SEEN_AS.T for x in runs], n, rate)
        gain = _gain(found, frequency, rate)
        # A line below what is asked for is as wide as this at its foot.
        usable = (frequency > slowest + rate / n) & (frequency < 0.5 * rate - 1.0) & (gain > _GAIN)
        if not np.any(usable):
            continue
        log_p = _standing_out(power / np.maximum(gain, _GAIN / 5.0)[:, None], n, rate, segments)
        octaves = frequency[usable] * np.mean(1.0 / frequency[usable])
        looks = _LOOKS * len(lengths) * np.count_nonzero(usable) / _BETWEEN
        likeliest = np.log(looks * octaves) + log_p[usable].min(axis=1)
        k = int(np.argmin(likeliest))
        if likeliest[k] < best:
            best, at = float(likeliest[k]), float(frequency[usable][k])
    return at, best


def _lengths(runs: Sequence[Array], rate: float) -> list[int]:
    """Return readings a segment, the longest first, none longer than a run of the usual length."""
    longest = max(len(x) for x in runs)
    shortest = min(len(x) for x in runs if 2 * len(x) >= longest)
    return sorted({min(round(seconds * rate), shortest) for seconds in _SEGMENTS}, reverse=True)


def _gain(found: Sequence[Notch], frequency: Array, rate: float) -> Array:
    """Share (F,) of white power that notches leave."""
    gain = np.ones(len(frequency))
    for sections in notch_filter(found, rate):
        gain *= np.abs(sosfreqz(sections[None], frequency, fs=rate)[1]) ** 2
    return gain


def _standing_out(power: Array, n: int, rate: float, segments: int) -> Array:
    """Logarithm (F, C) of the probability of a line as far above its floor in white noise.

    Infinite where a line is so little above it that it may be a slope.
    """
    lines = min(max(_FEWEST, round(_FLOOR * n / rate)), round(_OF_ALL * n / 2.0)) // 2 * 2 + 1
    ratio = np.array([seen / _floor(seen, lines, segments) for seen in power.T]).T
    freedom = 2.0 * segments
    # The floor is uncertain as well: a median is worth 0.64 of as many lines.
    log_p = _log_tail(ratio, freedom, 0.64 * lines * freedom)
    return np.where(ratio < _LEAST, np.inf, log_p)


def _spectra(runs: Sequence[Array], n: int, rate: float) -> tuple[Array, Array, int]:
    """Frequencies (F,), Hz, mean power (F, C) there of segments of n readings, and their number."""
    # White innovations do not leak into one another; a window would only cost energy.
    cut = [x[: len(x) // n * n].reshape(-1, n, x.shape[1]) for x in runs]
    segments = np.concatenate(cut)
    power = np.abs(np.fft.rfft(segments, _BETWEEN * n, axis=1)) ** 2 / n
    frequency = np.asarray(np.fft.rfftfreq(_BETWEEN * n, 1.0 / rate))
    return frequency, np.asarray(power.mean(axis=0)), len(segments)


def _floor(power: Array, lines: int, segments: int) -> Array:
    """Mean power (F,) that white noise around would have, from medians over lines."""
    middle = median_filter(power[::_BETWEEN], size=lines)
    half = lines // 2  # near its ends a spectrum has neighbours on one side only
    middle[:half], middle[len(middle) - half :] = middle[half], middle[-half - 1]
    floor = middle * segments / float(gamma(segments).median())
    return np.maximum(np.repeat(floor, _BETWEEN)[: len(power)], 1e-12)


def _log_tail(ratio: Array, a: float, b: float) -> Array:
    """Logarithm of the probability that F of a and b degrees of freedom is above a ratio.

    Where that is no number any more, Chernoff's bound on it stands for it.
    """
    with np.errstate(divide="ignore"):
        out = np.asarray(f(a, b).logsf(ratio))
        x = b / (b + a * ratio)
        bound = 0.5 * b * np.log(x * (a + b) / b) + 0.5 * a * np.log((1.0 - x) * (a + b) / a)
    return np.where(out > _SURE, out, np.minimum(bound, _SURE))
