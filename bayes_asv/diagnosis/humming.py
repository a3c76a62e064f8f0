"""Tones that wander, in the innovations of several runs together.

An engine's speed drifts by some per cent within a run, so that its tone is a hump of several lines;
it is heard in both channels and in every run.  The hump of a weak one stands out of the mean
spectrum, averaged over as many lines, where no single line of a single run does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.signal import sosfilt, welch
from scipy.stats import f, gamma

from bayes_asv.inference.tones import Notch, notch_filter, notch_of

__all__ = ["humming"]

Array = NDArray[np.float64]

_MOST = 16
_SEGMENT = 2.5  # s of a spectrum
_WIDTHS = (1, 5, 11)  # lines that a tone may take
_NEIGHBOURS = 61  # lines of a spectrum whose median is the floor of the middle one


def humming(runs: Sequence[Array], rate: float, slowest: float, alarm: float) -> tuple[Notch, ...]:
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
    return tuple(found)


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
