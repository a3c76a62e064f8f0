"""Tones that wander, in the innovations of several runs together.

An engine's speed drifts by some per cent within a run, so that its tone is one line for a moment
only, and a hump of several over the whole; it is heard in every run.  A weak one stands out of the
mean spectrum of segments as long as its line lasts, where no line of a single run does.

A jolt that rings has a hump as well; an engine hums for longer than a moment.  And its speed does
not wander by half as much again: a body that shakes by itself from 8 to 36 Hz is no engine, and to
cut that out would cut out the gap.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.signal import sosfilt, sosfiltfilt, sosfreqz
from scipy.stats import f, gamma

from bayes_asv.inference.tones import Notch, notch_filter, notch_of, passing

__all__ = ["humming"]

Array = NDArray[np.float64]

_MOST = 16  # bands that are cut out; each of the tones of an engine that wanders takes several
_SEGMENTS = (2.5, 0.75, 0.45, 0.25)  # s: a tone that wanders is a line for as long
_BETWEEN = 4  # frequencies a line: half a line beside it a tone has lost 0.6 of its energy
_SEEN_AS = np.array([[1.0, 0.0], [0.0, 1.0], [0.5**0.5, 0.5**0.5], [0.5**0.5, -(0.5**0.5)]])
_LOOKS = 6.0  # independent ones a line: three of the four directions, two of the frequencies
_MOMENT = 0.25  # s of each run, in which a jolt rings loudest
_MOST_AT_ONCE = 0.45  # of a tone's energy; of jolts a moment holds 0.56 or more
_WIDEST = 1.5  # highest of the bands side by side over the lowest, where an engine wanders
_BESIDE = 1.25  # half-widths of a band, as far as the next one may be
_BY_CHANCE = 1.5  # deviations by which noise makes the loudest of all moments louder
_NEIGHBOURS = 60  # lines of a spectrum whose median, with its own, is the floor of one


def humming(
    runs: Sequence[Array], rate: float, slowest: float, alarm: float, *, engine: bool = True
) -> tuple[Notch, ...]:
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
        Take for tones only what an engine may have: the strongest lasts for longer than a moment,
        and wanders through a narrow band.

    Returns
    -------
    tuple of Notch
        The strongest first.
    """
    signals = [np.nan_to_num(nu) for nu in runs]
    found: list[Notch] = []
    while len(found) < _MOST:
        sections = notch_filter(found, rate)
        left = [sosfilt(sections, x, axis=0) if found else x for x in signals]
        frequency = _loudest(left, rate, slowest, alarm)
        if frequency is None:
            break
        found.append(notch_of(frequency))
    if engine and found and (_wide(found) or not _lasts(signals, found[0], rate)):
        return ()
    return tuple(found)


def _wide(found: Sequence[Notch]) -> bool:
    """Whether the bands side by side with the strongest are more than one tone that wanders."""
    low = high = found[0].frequency
    for _ in found:
        reached = _BESIDE * notch_of(high).half_width
        near = [n.frequency for n in found if low - reached <= n.frequency <= high + reached]
        low, high = min(near), max(near)
    return high > _WIDEST * low


def _lasts(runs: Sequence[Array], tone: Notch, rate: float) -> bool:
    """Whether a tone is more than one loud moment of each run."""
    band = passing(tone, rate)
    passed = float(np.mean(np.abs(sosfreqz(band, 2048)[1]) ** 4))  # forwards and backwards
    length = max(1, round(_MOMENT * rate))
    freedom = 8.0 * tone.half_width * _MOMENT  # of noise in a moment, of both channels
    whole, loudest = 0.0, 0.0
    for run in runs:
        noise = passed * float(np.mean(run**2)) * 2.0
        power = np.sum(sosfiltfilt(band, run, axis=0) ** 2, axis=1) - noise
        whole += float(power.sum())
        most = float(uniform_filter1d(power, length).max())
        loudest += length * (most - _BY_CHANCE * noise * (2.0 / freedom) ** 0.5)
    return loudest < _MOST_AT_ONCE * whole


def _loudest(runs: Sequence[Array], rate: float, slowest: float, alarm: float) -> float | None:
    """Frequency (Hz) of the line that stands out most, if any does.

    Looked for in segments of several lengths, in either channel and in both alike or opposite, as
    one force moves them.  Beforehand a tone is as likely in any octave.  With white runs false
    tones are as many as asked for (1600 pairs of runs, seed 0: 0.8 % of 1, 4.3 % of 5).
    """
    best, at = alarm, None
    longest = min(len(x) for x in runs) / rate
    for seconds in _SEGMENTS:
        n = round(min(seconds, longest) * rate)
        frequency, power, segments = _spectra([x @ _SEEN_AS.T for x in runs], n, rate)
        usable = (frequency > slowest) & (frequency < 0.5 * rate - 1.0)
        lines = min(_NEIGHBOURS, int(0.4 * n)) // 2 * 2 + 1
        if np.count_nonzero(usable) < 2 * _BETWEEN or lines < 3:
            continue
        octaves = frequency / np.sum(usable) * np.sum(1.0 / frequency[usable])
        questions = _LOOKS * len(_SEGMENTS) * np.count_nonzero(usable) / _BETWEEN * octaves
        for seen in power.T:
            floor = median_filter(seen[::_BETWEEN], size=lines) * segments
            floor = np.repeat(floor / float(gamma(segments).median()), _BETWEEN)[: len(seen)]
            # The floor is uncertain as well: a median is worth 0.64 of as many lines.
            law = f(2.0 * segments, 0.64 * lines * 2.0 * segments)
            p = questions * law.sf(seen / np.maximum(floor, 1e-12))
            p[~usable] = np.inf
            k = int(np.argmin(p))
            if p[k] < best:
                best, at = float(p[k]), float(frequency[k])
    return at


def _spectra(runs: Sequence[Array], n: int, rate: float) -> tuple[Array, Array, int]:
    """Frequencies (F,), Hz, mean power (F, C) there of segments of n readings, and their number."""
    # White innovations do not leak into one another; a window would only cost energy.
    cut = [x[: len(x) // n * n].reshape(-1, n, x.shape[1]) for x in runs]
    segments = np.concatenate(cut)
    power = np.abs(np.fft.rfft(segments, _BETWEEN * n, axis=1)) ** 2 / n
    frequency = np.asarray(np.fft.rfftfreq(_BETWEEN * n, 1.0 / rate))
    return frequency, np.asarray(power.mean(axis=0)), len(segments)
