"""Multiple coherence between the wheels and the body: what a linear model can explain.

Whatever a linear relation between both wheels and one chassis channel leaves over, no half car
explains either: multiple coherence bounds every linear model from above (Bendat & Piersol,
Random Data, 2010, ch. 7).  Spectra are averaged over windows (Welch 1967); K windows and two
inputs leave (K − 2)/K of the rest on average, which is made good.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.kalman import VALUE
from bayes_asv.models.modes import nominal_modes
from bayes_asv.preprocessing.band import ABOVE_MODES, too_short
from bayes_asv.preprocessing.data_checks import MAX_UNEXPLAINED
from bayes_asv.preprocessing.timeline import PreparedRecording

__all__ = ["FEWEST_WINDOWS", "Coherence", "coherence", "suggest_band"]

Array = NDArray[np.float64]

FEWEST_WINDOWS = 8  # below it two inputs explain a good part of anything

_WINDOWS = 10.0  # in a recording
_SHORTEST, _LONGEST = 3.0, 8.0  # periods of the slowest mode in a window
_HIGHEST = 2.0  # times the fastest mode: all that a half car is about lies below
_WORTH = 0.8  # share explained that makes a band worth a try
_DRAWN = 1.5  # times the bound: a half car that leaves more was fitted to something else


@dataclass(frozen=True)
class Coherence:
    """What any linear relation between wheels and chassis leaves over, by frequency.

    Parameters
    ----------
    frequency : (F,) array
        Hz, without zero.
    power : (F, ny) array
        Power of each output, its unit squared over Hz.
    left : (F, ny) array
        Power that no linear relation with the inputs explains.
    windows : float
        Number of independent windows it stands on.
    """

    frequency: Array
    power: Array
    left: Array
    windows: float

    def explained(self, low: float, high: float) -> Array:
        """Share (ny,) of the power from one frequency to another that the wheels can explain."""
        band = (self.frequency > low) & (self.frequency <= high)
        return np.asarray(1.0 - self.left[band].sum(axis=0) / self.power[band].sum(axis=0))


def coherence(line: PreparedRecording, window: float) -> Coherence | None:
    """Multiple coherence of both wheels with each chassis channel.

    Parameters
    ----------
    line : PreparedRecording
        A recording.
    window : float
        Length of a window, s: its inverse is the resolution.

    Returns
    -------
    Coherence or None
        None when the recording has not :data:`FEWEST_WINDOWS` windows.
    """
    first = max(w.knots[0] for w in line.wheels)
    last = min(w.knots[-1] for w in line.wheels)
    rate = 1.0 / line.reading_step
    time = np.arange(first, last, 1.0 / rate)
    n = int(window * rate)
    starts = np.arange(0, len(time) - n + 1, max(n // 2, 1))
    windows = 0.5 * (len(starts) + 1)  # overlapping halves are worth about that many
    if n < 8 or windows < FEWEST_WINDOWS:
        return None
    signals = [w.spline(time) for w in line.wheels]
    for y in range(len(line.outputs)):
        use = line.kind[:, y] == VALUE
        signals.append(np.interp(time, line.instants[use], line.reading[use, y]))
    nu = len(line.wheels)
    pieces = np.stack([np.stack(signals)[:, s : s + n] for s in starts])  # (K, nu + ny, n)
    pieces = pieces - pieces.mean(axis=2, keepdims=True)
    taper = np.hanning(n + 2)[1:-1]
    spectra = np.fft.rfft(pieces * taper)[:, :, 1:]
    cross = np.einsum("kaf,kbf->fab", spectra, spectra.conj())
    cross *= 2.0 / (len(starts) * rate * np.sum(taper**2))
    wheels = cross[:, :nu, :nu]
    power = np.einsum("faa->fa", cross)[:, nu:].real
    across = cross[:, nu:, :nu]
    gain = np.linalg.solve(wheels.transpose(0, 2, 1), across.transpose(0, 2, 1))
    met = np.einsum("fba,fab->fa", gain, across.conj()).real
    left = np.clip((power - met) * windows / (windows - nu), 0.0, power)
    frequency = np.asarray(np.fft.rfftfreq(n, 1.0 / rate)[1:], np.float64)
    return Coherence(frequency, power, left, windows)


def suggest_band(line: PreparedRecording, left: Array, top: float) -> list[str]:
    """Say why a fit at full band explains too little, where a band would explain more.

    Parameters
    ----------
    line : PreparedRecording
        A recording, laid out at full band.
    left : (ny,) array
        Share of the power of each output below ``top`` that the fitted car leaves.
    top : float
        Hz.

    Returns
    -------
    list of str
        Empty when the fit leaves little more than any linear relation would, when no band is
        worth a try, or when the recording is too short to tell.
    """
    found = nominal_modes(line.car)  # where to look: from twice the fastest one downwards
    slowest, fastest = found[0].natural, found[-1].natural
    span = float(line.times[0, -1] - line.times[0, 0])
    window = min(span / _WINDOWS, _LONGEST / slowest)
    seen = coherence(line, window) if window * slowest >= _SHORTEST else None
    if seen is None:
        return []
    bound = 1.0 - seen.explained(0.0, top)
    if not np.any((left > MAX_UNEXPLAINED**2) & (left > _DRAWN * bound)):
        return []
    for below in range(int(_HIGHEST * fastest), 0, -1):
        if below < ABOVE_MODES * fastest or too_short(line, below) is not None:
            break
        share = 100.0 * seen.explained(0.0, below)
        if np.all(share >= 100.0 * _WORTH):
            names = _listed([line.channels[c].words for c in line.outputs])
            fitted, best, in_band = (
                _listed([f"{100.0 * x:.0f}" for x in values])
                for values in (np.clip(1.0 - left, 0.0, 1.0), 1.0 - bound, share / 100.0)
            )
            return [
                f"the fitted {line.car.name} car explains only {fitted} % of {names} below "
                f"{top:.2g} Hz in {line.source}, where a linear relation with the wheels explains "
                f"{best} %: what is above drew the fit away; below {below} Hz the wheels explain "
                f"{in_band} %: try --below {below}"
            ]
    return []


def _listed(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
