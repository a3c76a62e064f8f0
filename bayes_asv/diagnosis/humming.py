"""Tones that wander, in the innovations of several runs together.

An engine's speed drifts by some per cent within a run, so that its tone is a hump of several lines;
it is heard in both channels and in every run.  The hump of a weak one stands out of the mean
spectrum, averaged over as many lines, where no single line of a single run does.  A jolt that rings
has a hump as well; an engine hums for longer than a moment.  And it has lines: a body that shakes
by itself from 8 to 36 Hz is no engine, and to cut that out would cut out the gap.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.signal import sosfilt, sosfiltfilt, sosfreqz, welch
from scipy.stats import f, gamma

from bayes_asv.inference.tones import Notch, notch_filter, notch_of, passing

__all__ = ["humming"]

Array = NDArray[np.float64]

_MOST = 16  # bands that are cut out; four tones of an engine that wander take up to four each
_SEGMENT = 2.5  # s of a spectrum
_WIDTHS = (1, 5, 11)  # lines that a tone may take
_MOMENT = 0.25  # s of each run, in which a jolt rings loudest
_MOST_AT_ONCE = 0.45  # of a tone's energy; of weak tones it holds up to 0.34, of jolts 0.56 or more
_NEIGHBOURS = 61  # lines of a spectrum whose median is the floor of the middle one


def humming(
    runs: Sequence[Array], rate: float, slowest: float, alarm: float, *, engine: bool = True
) -> tuple[Notch, ...]:
    """Find tones in the innovations of all runs.

    The band that stands out most is cut out, and what is left is searched again.

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
        and there is an end to them.

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
    if engine and found and (len(found) == _MOST or not _lasts(signals, found[0], rate)):
        return ()
    return tuple(found)


def _lasts(runs: Sequence[Array], tone: Notch, rate: float) -> bool:
    """Whether a tone is more than one loud moment of each run."""
    band = passing(tone, rate)
    passed = float(np.mean(np.abs(sosfreqz(band, 2048)[1]) ** 4))  # forwards and backwards
    length = max(1, round(_MOMENT * rate))
    whole, loudest = 0.0, 0.0
    for run in runs:
        power = np.sum(sosfiltfilt(band, run, axis=0) ** 2, axis=1) - passed * np.mean(run**2) * 2
        whole += float(power.sum())
        loudest += length * float(uniform_filter1d(power, length).max())
    return loudest < _MOST_AT_ONCE * whole


def _loudest(runs: Sequence[Array], rate: float, slowest: float, alarm: float) -> float | None:
    """Frequency (Hz) of the band that stands out most, if any does."""
    n = min(min(len(x) for x in runs), round(_SEGMENT * rate))
    counts = [len(x) // n for x in runs]
    # White innovations do not leak into one another; a window would only cost energy.
    spectra = [welch(x, rate, "boxcar", nperseg=n, noverlap=0, axis=0) for x in runs]
    frequency = spectra[0][0]
    mean = np.average([power for _, power in spectra], axis=0, weights=counts)
    lines = min(_NEIGHBOURS, len(frequency) // 2 * 2 - 1)
    usable = (frequency > slowest) & (frequency < 0.5 * rate - 1.0)
    questions = 3 * len(_WIDTHS) * int(np.count_nonzero(usable))
    best, at = alarm / max(questions, 1), None
    for power, channels in ((mean[:, 0], 1), (mean[:, 1], 1), (mean.mean(axis=1), 2)):
        pairs = channels * sum(counts)  # of degrees of freedom, a line
        floor = median_filter(power, size=lines) / (float(gamma(pairs).median()) / pairs)
        for width in _WIDTHS:
            ratio = uniform_filter1d(power, width) / np.maximum(floor, 1e-12)
            degrees = 2.0 * pairs * width
            # The floor is uncertain as well: a median is worth 0.64 of as many lines.
            p = f(degrees, 0.64 * lines * 2.0 * pairs).sf(ratio)
            p[~usable] = 1.0
            k = int(np.argmin(p))
            if p[k] < best:
                best, at = float(p[k]), float(frequency[k])
    return at
