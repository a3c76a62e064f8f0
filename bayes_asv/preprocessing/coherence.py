"""How much of the chassis' motion the wheels can explain at all.

Whatever a linear relation between both wheels and one chassis channel leaves over, no half car
explains either: multiple coherence bounds every linear model from above (Bendat & Piersol,
Random Data, 2010, ch. 7).  Spectra are averaged over windows (Welch 1967); K windows and two
inputs leave (K − 2)/K of the rest on average, which is made good.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.kalman import VALUE
from bayes_asv.models.half_car import HalfCar
from bayes_asv.models.modes import modes
from bayes_asv.preprocessing.band import ABOVE_MODES, too_short
from bayes_asv.preprocessing.data_checks import DOUBTFUL
from bayes_asv.preprocessing.timeline import PreparedRecording

__all__ = ["FEWEST_WINDOWS", "Coherence", "coherence", "mend"]

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
    power : (F, 2) array
        Power of the front and of the rear chassis, (m/s²)²/Hz.
    left : (F, 2) array
        Power that no linear relation with both wheels explains.
    windows : float
        Number of independent windows it stands on.
    """

    frequency: Array
    power: Array
    left: Array
    windows: float

    def explained(self, low: float, high: float) -> Array:
        """Share (2,) of the power from one frequency to another that the wheels can explain."""
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
    for axle in range(2):
        use = line.kind[:, axle] == VALUE
        signals.append(np.interp(time, line.instants[use], line.reading[use, axle]))
    pieces = np.stack([np.stack(signals)[:, s : s + n] for s in starts])  # (K, 4, n)
    pieces = pieces - pieces.mean(axis=2, keepdims=True)
    taper = np.hanning(n + 2)[1:-1]
    spectra = np.fft.rfft(pieces * taper)[:, :, 1:]
    cross = np.einsum("kaf,kbf->fab", spectra, spectra.conj())
    cross *= 2.0 / (len(starts) * rate * np.sum(taper**2))
    wheels = cross[:, :2, :2]
    power = np.einsum("faa->fa", cross)[:, 2:].real
    across = cross[:, 2:, :2]
    gain = np.linalg.solve(wheels.transpose(0, 2, 1), across.transpose(0, 2, 1))
    met = np.einsum("fba,fab->fa", gain, across.conj()).real
    left = np.clip((power - met) * windows / (windows - 2.0), 0.0, power)
    frequency = np.asarray(np.fft.rfftfreq(n, 1.0 / rate)[1:], np.float64)
    return Coherence(frequency, power, left, windows)


def mend(line: PreparedRecording, vehicle: Vehicle, left: Array, top: float) -> list[str]:
    """Say why a fit at full band explains too little, where a band would explain more.

    Parameters
    ----------
    line : PreparedRecording
        A recording, laid out at full band.
    vehicle : Vehicle
        Its nominal modes say where to look: from twice the fastest one downwards.
    left : (2,) array
        Share of the power below ``top`` that the fitted half car leaves, front and rear.
    top : float
        Hz.

    Returns
    -------
    list of str
        Empty when the fit leaves little more than any linear relation would, when no band is
        worth a try, or when the recording is too short to tell.
    """
    found = modes(HalfCar(*(getattr(vehicle, name).value for name in HalfCar._fields)))
    slowest, fastest = found[0].natural, found[-1].natural
    span = float(line.times[0, -1] - line.times[0, 0])
    window = min(span / _WINDOWS, _LONGEST / slowest)
    seen = coherence(line, window) if window * slowest >= _SHORTEST else None
    if seen is None:
        return []
    bound = 1.0 - seen.explained(0.0, top)
    if not np.any((left > DOUBTFUL**2) & (left > _DRAWN * bound)):
        return []
    for below in range(int(_HIGHEST * fastest), 0, -1):
        if below < ABOVE_MODES * fastest or too_short(line, below) is not None:
            break
        share = 100.0 * seen.explained(0.0, below)
        if np.all(share >= 100.0 * _WORTH):
            front, rear = 100.0 * np.clip(1.0 - left, 0.0, 1.0)
            best = 100.0 * (1.0 - bound)
            return [
                f"the fitted half car explains only {front:.0f} and {rear:.0f} % of the front and "
                f"rear chassis' motion below {top:.2g} Hz in {line.source}, where a linear "
                f"relation with both wheels explains {best[0]:.0f} and {best[1]:.0f} %: what is "
                f"above drew it away; below {below} Hz the wheels explain {share[0]:.0f} and "
                f"{share[1]:.0f} %: try --below {below}"
            ]
    return []
