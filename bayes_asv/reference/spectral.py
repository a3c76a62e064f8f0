"""Chapter 4 again: whether modes can be read from the peaks of a spectrum, and how else.

Drives over white noise with the car damped to 10, 30 and 70 %, read in three ways: the spectrum of
one record (the reference's), the mean of many (Welch 1967), and covariance-driven subspace
identification.  What an endless record would show is computed exactly and says whether there is
a peak to be read at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks, periodogram, welch

from bayes_asv.models.half_car import HalfCar
from bayes_asv.models.modes import Mode, modes
from bayes_asv.reference.modal import Frequencies
from bayes_asv.reference.subspace import subspace_modes
from bayes_asv.reference.whitenoise import expected_spectrum, white_drive

__all__ = ["DAMPINGS", "LENGTHS", "Reading", "Study", "damped_to", "spectral_study", "wilson"]

Array = NDArray[np.float64]

DAMPINGS = (0.1, 0.3, 0.7)
"""Damping ratios of both axles (chapter 4)."""
LENGTHS = (20.0, 600.0)
"""Seconds: the reference's record (App. C.1), and thirty times as long."""
RATE = 20.0  # Hz, ten times the fast mode; the reference keeps 1 of 20 samples as well
CLOSE = 0.05
"""A mode counts as read when its damped frequency is within this share."""

_BAND = (0.4, 2.0)  # of the slowest and of the fastest natural frequency: where peaks are sought
_PADDED = 2048  # points of a spectrum, so that a peak's place is not the grid's
_SEGMENT = 10.0  # s; shorter ones smooth more, and at 0.2 Hz still part the two modes
_BLOCKS = 20  # one second of covariances: the slow mode has decayed by then at 10 % and above


@dataclass(frozen=True)
class Reading:
    """How well modes were read from records of one length.

    Parameters
    ----------
    seconds : float
        Length of each record.
    peaks, subspace : int
        Records in which every oscillating mode was read, from peaks and by subspaces.
    runs : int
        Records in all.
    natural, ratio : tuple of (median, 5 %, 95 %)
        Subspace identification's answers for the slow mode: Hz, and damping ratio.
    """

    seconds: float
    peaks: int
    subspace: int
    runs: int
    natural: tuple[float, float, float]
    ratio: tuple[float, float, float]


@dataclass(frozen=True)
class Study:
    """The spectral approach on one car.

    Parameters
    ----------
    damping : float
        Damping ratio of each axle.
    modes : tuple of Mode
        Eigenvalue modes.
    peaks : tuple of two tuples of float
        Peaks (Hz) of an endless record's spectrum, front and rear.
    frequency, expected, single, mean : (F,), (F, 2), (F, 2), (F, 2) arrays
        Spectra of the chassis' velocity: endless record, one short record, one long record's mean.
    readings : tuple of Reading
        One a length.
    """

    damping: float
    modes: tuple[Mode, ...]
    peaks: tuple[tuple[float, ...], tuple[float, ...]]
    frequency: Array
    expected: Array
    single: Array
    mean: Array
    readings: tuple[Reading, ...]

    @property
    def readable(self) -> bool:
        """Whether an endless record shows a peak for every mode at one axle at least."""
        return max(map(len, self.peaks)) >= 2


def damped_to(car: HalfCar, ratio: float) -> HalfCar:
    """Return the car with both axles damped to a ratio, c = 2 ζ √(k m_axle) (App. C.1)."""
    return car._replace(
        c_f=2.0 * ratio * math.sqrt(car.k_f * car.m * car.wdf),
        c_r=2.0 * ratio * math.sqrt(car.k_r * car.m * (1.0 - car.wdf)),
    )


def wilson(hits: int, runs: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson 1927)."""
    z = 1.959964
    middle = (hits + 0.5 * z * z) / (runs + z * z)
    half = z * math.sqrt(hits * (runs - hits) / runs + 0.25 * z * z) / (runs + z * z)
    return max(0.0, middle - half), min(1.0, middle + half)


def spectral_study(car: HalfCar, damping: float, runs: int, seed: int) -> Study:
    """Try to read a car's modes from its motion over white noise.

    Parameters
    ----------
    car : HalfCar
        Its damping rates are replaced.
    damping : float
        Ratio of both axles.
    runs : int
        Records of each length.
    seed : int
        Same seed, same records.

    Returns
    -------
    Study
    """
    car = damped_to(car, damping)
    found = tuple(modes(car))
    # the fast mode is at 1.9 Hz for the car of Table 4.1; a stiffer car is sampled faster
    rate = RATE * max(1.0, max(m.natural for m in found) / 2.5)
    low, high = _BAND[0] * found[0].natural, _BAND[1] * found[-1].natural
    frequency: Array = np.fft.rfftfreq(_PADDED, 1.0 / rate).astype(np.float64)
    frequency = frequency[(frequency >= low) & (frequency <= high)]
    expected = expected_spectrum(car, frequency)
    peaks = [tuple(frequency[find_peaks(expected[:, axle])[0]].tolist()) for axle in (0, 1)]
    wanted = [m.damped for m in found if m.damped > 0.0]
    readings, spectra = [], []
    for number, seconds in enumerate(LENGTHS):
        rng = np.random.default_rng([seed, round(1000 * damping), number])
        records = white_drive(car, seconds, rate, runs, rng)
        power = _spectra(records, rate, (low, high))
        spectra.append(power[0])
        by_peak = sum(_read(_highest(p[:, 0], frequency, len(wanted)), wanted) for p in power)
        answers = [subspace_modes(record, rate, _BLOCKS) for record in records]
        by_subspace = sum(
            _read([a.damped for a in answer if a.damped > 0.0], wanted) for answer in answers
        )
        slow = [nearest(answer, found[0]) for answer in answers]
        readings.append(
            Reading(
                seconds, by_peak, by_subspace, runs,
                _spread([a.natural for a in slow if a]), _spread([a.ratio for a in slow if a]),
            )
        )  # fmt: skip
    return Study(
        damping, found, (peaks[0], peaks[1]), frequency, expected, spectra[0], spectra[1],
        tuple(readings),
    )  # fmt: skip


def nearest(answer: list[Frequencies], mode: Mode) -> Frequencies | None:
    """Find the oscillating mode of an answer that is nearest to a true one; None without any."""
    moving = [a for a in answer if a.damped > 0.0]
    return min(moving, key=lambda a: abs(math.log(a.natural / mode.natural))) if moving else None


def _spectra(records: Array, rate: float, band: tuple[float, float]) -> Array:
    """Spectral densities (R, F, 2) of records (R, N, 2) in a band."""
    points = round(_SEGMENT * rate)
    if records.shape[1] <= 2 * points:
        frequency, power = periodogram(records, rate, nfft=_PADDED, axis=1)
    else:
        frequency, power = welch(records, rate, nperseg=points, nfft=_PADDED, axis=1)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    return np.asarray(power[:, inside])


def _highest(power: Array, frequency: Array, count: int) -> list[float]:
    """Frequencies of the peaks that stand out most, the ones a person would take for modes."""
    at, about = find_peaks(power, prominence=0.0)
    best = at[np.argsort(about["prominences"])[::-1][:count]]
    return [float(f) for f in frequency[best]]


def _read(answers: list[float], wanted: list[float]) -> bool:
    """Whether each wanted frequency has an answer of its own close to it, and no answer is left."""
    if len(answers) != len(wanted):
        return False
    return all(
        abs(a / w - 1.0) <= CLOSE for a, w in zip(sorted(answers), sorted(wanted), strict=True)
    )


def _spread(values: list[float]) -> tuple[float, float, float]:
    if not values:
        return math.nan, math.nan, math.nan
    low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
    return float(middle), float(low), float(high)
