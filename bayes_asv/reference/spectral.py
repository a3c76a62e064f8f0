"""Chapter 4: identification of modes from the peaks of a spectrum, and by subspaces.

The vertical velocities of both wheels are independent white noise, as on a road with displacement
density n⁻² at constant speed, and the car is damped to 10, 30 and 70 %.  The spectrum of the
chassis velocity is then the half car's transmissibility, and the chassis velocity is the output of
a linear system of four states driven by white noise, as operational modal analysis assumes.

Three methods are compared: the periodogram of one record (the reference's), the mean of many
periodograms (Welch 1967), and covariance-driven subspace identification.  The theoretical spectrum
shows whether an infinitely long record has a peak for each mode.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov
from scipy.signal import find_peaks, periodogram, welch

from bayes_asv.domain.quantities import NORMAL_975
from bayes_asv.models.discretization import exact_step
from bayes_asv.models.half_car_equations import HalfCar, LinearSystem, deflection_form
from bayes_asv.models.modes import VibrationMode, modes
from bayes_asv.reference.modal import Frequencies, subspace_modes

__all__ = [
    "DAMPINGS",
    "RECORD_LENGTHS",
    "IdentificationRate",
    "SpectralStudy",
    "simulate_white_noise",
    "spectral_study",
    "theoretical_spectrum",
    "velocity_form",
    "wilson_interval",
    "with_damping_ratio",
]

Array = NDArray[np.float64]

DAMPINGS = (0.1, 0.3, 0.7)
"""Damping ratios of both axles in chapter 4."""
RECORD_LENGTHS = (20.0, 600.0)
"""Record lengths, s: that of the reference (App. C.1) and thirty times as much."""
RATE = 20.0  # Hz, ten times the fast mode, as after the decimation of the reference
TOLERANCE = 0.05
"""Relative error of a damped frequency up to which a mode counts as identified."""

_BAND = (0.4, 2.0)  # times the lowest and highest natural frequency, the range searched for peaks
_FFT_POINTS = 2048  # zero padding, for a fine frequency grid
_SEGMENT = 10.0  # s; the resolution of 0.2 Hz separates the two modes
_BLOCK_ROWS = 20  # one second, in which the slow mode decays at 10 % damping and above


@dataclass(frozen=True)
class IdentificationRate:
    """How often all oscillating modes were identified from records of one length.

    Parameters
    ----------
    seconds : float
        Length of each record.
    peaks, subspace : int
        Records in which peaks and subspace identification found every oscillating mode.
    runs : int
        Number of records.
    natural, ratio : tuple of (median, 5 %, 95 %)
        Subspace estimates of the slow mode: natural frequency, Hz, and damping ratio.
    """

    seconds: float
    peaks: int
    subspace: int
    runs: int
    natural: tuple[float, float, float]
    ratio: tuple[float, float, float]


@dataclass(frozen=True)
class SpectralStudy:
    """Results of the spectral study at one damping.

    Parameters
    ----------
    damping : float
        Damping ratio of each axle.
    modes : tuple of VibrationMode
        Eigenvalue modes.
    peaks : tuple of two tuples of float
        Peaks, Hz, of the theoretical spectrum, front and rear.
    frequency, expected, single, mean : (F,), (F, 2), (F, 2), (F, 2) arrays
        Spectra of the chassis velocity: theoretical, of one short record, mean of one long record.
    readings : tuple of IdentificationRate
        One per length.
    """

    damping: float
    modes: tuple[VibrationMode, ...]
    peaks: tuple[tuple[float, ...], tuple[float, ...]]
    frequency: Array
    expected: Array
    single: Array
    mean: Array
    readings: tuple[IdentificationRate, ...]

    @property
    def peaks_visible(self) -> bool:
        """Whether the theoretical spectrum of either axle has a peak for every mode."""
        return max(map(len, self.peaks)) >= 2


def with_damping_ratio(car: HalfCar, ratio: float) -> HalfCar:
    """Return the car with both axles at a damping ratio ζ, c = 2 ζ √(k m_axle) (App. C.1)."""
    return car._replace(
        c_f=2.0 * ratio * math.sqrt(car.k_f * car.m * car.wdf),
        c_r=2.0 * ratio * math.sqrt(car.k_r * car.m * (1.0 - car.wdf)),
    )


def wilson_interval(hits: int, runs: int) -> tuple[float, float]:
    """Return the 95 % interval of a proportion (Wilson 1927)."""
    z = NORMAL_975
    middle = (hits + 0.5 * z * z) / (runs + z * z)
    half = z * math.sqrt(hits * (runs - hits) / runs + 0.25 * z * z) / (runs + z * z)
    return max(0.0, middle - half), min(1.0, middle + half)


def spectral_study(car: HalfCar, damping: float, runs: int, seed: int) -> SpectralStudy:
    """Identify a car's modes from its response to white noise.

    Parameters
    ----------
    car : HalfCar
        Its damping rates are replaced.
    damping : float
        Damping ratio of both axles.
    runs : int
        Number of records of each length.
    seed : int
        Seed of the records.

    Returns
    -------
    SpectralStudy
    """
    car = with_damping_ratio(car, damping)
    true_modes = tuple(modes(car))
    # the fast mode of the car of Table 4.1 is at 1.9 Hz; a stiffer car needs a higher rate
    rate = RATE * max(1.0, max(m.natural for m in true_modes) / 2.5)
    low, high = _BAND[0] * true_modes[0].natural, _BAND[1] * true_modes[-1].natural
    frequency: Array = np.fft.rfftfreq(_FFT_POINTS, 1.0 / rate).astype(np.float64)
    frequency = frequency[(frequency >= low) & (frequency <= high)]
    expected = theoretical_spectrum(car, frequency)
    peaks = [tuple(frequency[find_peaks(expected[:, axle])[0]].tolist()) for axle in (0, 1)]
    wanted = [m.damped for m in true_modes if m.damped > 0.0]
    readings, spectra = [], []
    for number, seconds in enumerate(RECORD_LENGTHS):
        rng = np.random.default_rng([seed, round(1000 * damping), number])
        records = simulate_white_noise(car, seconds, rate, runs, rng)
        power = _spectra(records, rate, (low, high))
        spectra.append(power[0])
        by_peak = sum(
            _identified(_most_prominent(p[:, 0], frequency, len(wanted)), wanted) for p in power
        )
        estimates = [subspace_modes(record, rate, _BLOCK_ROWS) for record in records]
        by_subspace = sum(
            _identified([m.damped for m in estimate if m.damped > 0.0], wanted)
            for estimate in estimates
        )
        slow = [nearest_mode(estimate, true_modes[0]) for estimate in estimates]
        readings.append(
            IdentificationRate(
                seconds, by_peak, by_subspace, runs,
                _median_and_quantiles([m.natural for m in slow if m]),
                _median_and_quantiles([m.ratio for m in slow if m]),
            )
        )  # fmt: skip
    return SpectralStudy(
        damping, true_modes, (peaks[0], peaks[1]), frequency, expected, spectra[0], spectra[1],
        tuple(readings),
    )  # fmt: skip


def nearest_mode(estimate: list[Frequencies], mode: VibrationMode) -> Frequencies | None:
    """Return the oscillating mode of an estimate nearest to a true mode, None without any."""
    candidates = [m for m in estimate if m.damped > 0.0]
    if not candidates:
        return None
    return min(candidates, key=lambda m: abs(math.log(m.natural / mode.natural)))


def _spectra(records: Array, rate: float, band: tuple[float, float]) -> Array:
    """Compute the spectral densities (R, F, 2) of records (R, N, 2) in a band."""
    points = round(_SEGMENT * rate)
    if records.shape[1] <= 2 * points:
        frequency, power = periodogram(records, rate, nfft=_FFT_POINTS, axis=1)
    else:
        frequency, power = welch(records, rate, nperseg=points, nfft=_FFT_POINTS, axis=1)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    return np.asarray(power[:, inside])


def _most_prominent(power: Array, frequency: Array, count: int) -> list[float]:
    """Return the frequencies of the most prominent peaks."""
    index, properties = find_peaks(power, prominence=0.0)
    best = index[np.argsort(properties["prominences"])[::-1][:count]]
    return [float(f) for f in frequency[best]]


def _identified(estimates: list[float], wanted: list[float]) -> bool:
    """Check that the estimated frequencies match the true ones one by one."""
    if len(estimates) != len(wanted):
        return False
    return all(
        abs(a / w - 1.0) <= TOLERANCE
        for a, w in zip(sorted(estimates), sorted(wanted), strict=True)
    )


def _median_and_quantiles(values: list[float]) -> tuple[float, float, float]:
    if not values:
        return math.nan, math.nan, math.nan
    low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
    return float(middle), float(low), float(high)


def velocity_form(car: HalfCar) -> LinearSystem:
    """Build the system from wheel velocities to chassis velocities, state (δ_f, ẋ_f, δ_r, ẋ_r).

    Parameters
    ----------
    car : HalfCar
        Parameters in SI units; x is the chassis at an axle, δ = x − u.

    Returns
    -------
    LinearSystem
        A (4, 4), B (4, 2), C (2, 4), D (2, 2); the poles are those of the deflection form.
    """
    A, B, _, _ = deflection_form(car)
    B = np.zeros_like(B)
    B[0, 0] = B[2, 1] = -1.0
    # forces come from δ̇ = ẋ − u̇, so the wheel velocity enters through the dampers as well
    B[1], B[3] = -A[1, [1, 3]], -A[3, [1, 3]]
    C = np.zeros((2, 4))
    C[0, 1] = C[1, 3] = 1.0
    return LinearSystem(A, B, C, np.zeros((2, 2)))


def simulate_white_noise(
    car: HalfCar, seconds: float, rate: float, runs: int, rng: np.random.Generator
) -> Array:
    """Simulate the chassis velocity over white noise, from stationary initial states.

    Parameters
    ----------
    car : HalfCar
        Parameters in SI units.
    seconds, rate : float
        Length, s, and sampling rate, Hz.  The noise is held between samples.
    runs : int
        Number of independent drives.
    rng : numpy Generator
        Source of initial states and noise.

    Returns
    -------
    (runs, N, 2) array
        Chassis velocity, front and rear, for a wheel velocity of spectral density one (m/s)²/Hz.
    """
    system = velocity_form(car)
    step = exact_step(system, 1.0 / rate)
    held = step.Gamma0 + step.Gamma1
    deviation = np.sqrt(0.5 * rate)  # one-sided density of one up to half the rate
    stationary = solve_discrete_lyapunov(step.Phi, deviation**2 * held @ held.T)
    n = round(seconds * rate)
    x = rng.standard_normal((runs, 4)) @ np.linalg.cholesky(stationary).T
    pushes = deviation * rng.standard_normal((n, runs, 2)) @ held.T
    out = np.empty((n, runs, 2))
    for k in range(n):
        out[k] = x[:, [1, 3]]
        x = x @ step.Phi.T + pushes[k]
    return np.moveaxis(out, 0, 1)


def theoretical_spectrum(car: HalfCar, frequency: Array) -> Array:
    """Compute the spectral density of the chassis velocity over that of the wheel velocity.

    Parameters
    ----------
    car : HalfCar
        Parameters in SI units.
    frequency : (F,) array
        Hz.

    Returns
    -------
    (F, 2) array
        |T_ff|² + |T_fr|² at the front axle, |T_rf|² + |T_rr|² at the rear.
    """
    A, B, C, _ = velocity_form(car)
    s = 2j * np.pi * frequency[:, None, None]
    transfer = C @ np.linalg.solve(s * np.eye(4) - A, np.broadcast_to(B, (len(frequency), 4, 2)))
    return np.asarray(np.sum(np.abs(transfer) ** 2, axis=2))
