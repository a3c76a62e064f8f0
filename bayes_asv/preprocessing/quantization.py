"""Noise of one sample of a channel, quantisation errors of signals at rest, and missing codes.

While a signal crosses many steps, its quantisation error is white noise of variance step²/12.  At
rest, a part of the error is constant, up to about (step/π) exp(−2π² (σ/step)²) with noise σ (Widrow
& Kollár 2008, Quantization Noise, ch. 4), and a reading that toggles between two counts has an
error of up to step²/4, autocorrelated as the noise is.  In a measured input, both are slow errors
that drive the suspension of the model: before a bump, a car at rest with ten-bit converters would
appear to move.  The noise of a wheel at rest is therefore increased, below the frequencies of a
suspension, by the constant and the autocorrelated part; and readings at standstill before and after
the drive are left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from bayes_asv.filters.kalman import MISSING
from bayes_asv.preprocessing.prepared_recording import PreparedRecording

__all__ = [
    "STILL_STEPS",
    "STILL_WINDOW",
    "is_slow",
    "is_stationary",
    "missing_bit",
    "noise_level",
    "offset",
    "quiet_level",
    "slow_steps",
    "smallest_step",
    "spurious_drift",
    "still_variance",
    "top_level",
    "with_noise_of_still_wheels",
    "without_standstill",
]

Array = NDArray[np.float64]

STILL_WINDOW = 0.1
"""Length of the window that decides whether a channel is at rest, s."""
STILL_STEPS = 2.5
"""Largest range of a channel at rest in this window, in steps of its converter."""
_HARMONICS = 20  # number of harmonics of the sawtooth error that are added up
# Change between readings, in steps, below which quantisation errors are autocorrelated.
_TEETH = 0.5
_LEAD = 0.5  # seconds kept before and after the drive
_SUSPENSION_MEMORY = 0.15  # time after which the suspension has forgotten an input, s
_FEWEST = 200  # least number of readings for an estimate from the top of the spectrum
# Ratio of levels below which the top of a spectrum has no sensor noise: such noise falls by 6 dB
# per octave behind a pole and by 24 dB behind an analogue filter of fourth order, not by 40 dB.
_EMPTY = 0.01
_MIN_PERIODS = 3  # least number of periods of a missing bit within the range of a channel
_MAX_CODES = 2**15  # number of bins in the distribution of readings, at most
_PADDED = 16  # bins of its spectrum for each bin of the distribution
# Share of a period that is empty: half of it, as far as the period is known, or three quarters for
# the bit of second lowest weight; all of it is empty between the converter's own codes.
_EMPTY_SHARES = (0.45, 0.8)
_MISSING_CHANCE = 1e-6  # probability by chance below which codes count as missing
_SLIGHT = 0.05  # increase of the noise variance that is ignored, relative


def offset(step: float, noise: float) -> float:
    """Largest constant error of a converter for a reading at rest with noise ``noise``.

    All in the unit of the reading.  At a position x between two steps, the mean error is
    (step/π) Σₖ (−1)ᵏ/k exp(−2π² k² (σ/step)²) sin 2πk x, at most half a step.
    """
    if step <= 0.0:
        return 0.0
    k = np.arange(1, _HARMONICS + 1)
    size = (-1.0) ** k / (math.pi * k) * np.exp(-2.0 * (math.pi * k * noise / step) ** 2)
    place = np.linspace(0.0, 0.5, 101)
    mean = np.sin(2.0 * math.pi * place[:, None] * k) @ size
    return step * min(float(np.abs(mean).max()), 0.5)


def with_noise_of_still_wheels(recording: PreparedRecording) -> PreparedRecording:
    """Increase the noise of wheels at rest by their quantisation errors.

    The outputs do not need this: on 40 drives of the 2008 car without a fault, with its ten bits
    and the noise of its data sheets, there were 22 false alarms before, and one with the noise of
    the wheels increased.
    """
    excess = [
        _excess_variance(recording, c) * is_stationary(recording, c) for c in recording.inputs
    ]
    standstill_noise = np.stack(excess, axis=1) * recording.process_noise[:, : len(excess)]
    process_noise = recording.noise_spread + np.hstack(
        [np.zeros_like(standstill_noise), standstill_noise]
    )
    return replace(recording, process_noise=process_noise, standstill_noise=standstill_noise)


def without_standstill(recording: PreparedRecording) -> PreparedRecording:
    """Leave out readings at standstill before and after the drive.

    At rest, a coarse converter reads a constant that is wrong by up to a step; the longer the car
    waits, the smaller the standard deviation of this constant would appear.
    """
    still = np.all([is_stationary(recording, c) for c in range(len(recording.channels))], axis=0)
    if still.all() or not still.any():
        return recording
    moving = recording.instants[~still]
    is_waiting = (recording.instants < moving[0] - _LEAD) | (
        recording.instants > moving[-1] + _LEAD
    )
    return replace(recording, kind=np.where(is_waiting[:, None], MISSING, recording.kind))


def is_stationary(recording: PreparedRecording, c: int) -> NDArray[np.bool_]:
    """Whether a channel with a coarse converter is at rest at each instant (E,)."""
    return _range_is_below(recording, c, lambda readings: STILL_STEPS)


def is_slow(recording: PreparedRecording, c: int) -> NDArray[np.bool_]:
    """Whether a channel moves so slowly that its quantisation errors are autocorrelated (E,).

    If it changes by a fraction of a step between readings, its error is a sawtooth over several
    readings.
    """
    return _range_is_below(recording, c, slow_steps)


def slow_steps(readings: int) -> float:
    """Return the range in a window, in steps, below which errors are autocorrelated."""
    return max(STILL_STEPS, _TEETH * readings)


def _range_is_below(
    recording: PreparedRecording, c: int, steps: Callable[[int], float]
) -> NDArray[np.bool_]:
    """Whether the range of a channel in a window is less than some steps (E,)."""
    if _excess_variance(recording, c) == 0.0:
        return np.zeros(len(recording.instants), bool)
    finite = np.isfinite(recording.values[c])
    time, signal = recording.times[c, finite], recording.values[c, finite]
    n = max(round(STILL_WINDOW / float(np.median(np.diff(time)))), 3)
    span = maximum_filter1d(signal, n) - minimum_filter1d(signal, n)
    below = (span < steps(n) * recording.quantization_steps[c]).astype(float)
    return np.asarray(np.interp(recording.instants, time, below) > 0.5)


def spurious_drift(recording: PreparedRecording, c: int) -> float:
    """Slope (m/s³) of a channel's offset that its converter can cause over a recording.

    A change of the offset by as much as the error of the converter is not a fault.
    """
    still = float(np.mean(is_stationary(recording, c)))
    largest = offset(float(recording.quantization_steps[c]), float(recording.noise[c] or 0.0))
    return (
        2.0 * largest * still / float(np.ptp(recording.times[c, np.isfinite(recording.values[c])]))
    )


def _excess_variance(recording: PreparedRecording, c: int) -> float:
    """Variance (m²/s⁴) of white noise equivalent to the quantisation error of a channel at rest."""
    time = recording.times[c, np.isfinite(recording.values[c])]
    if len(time) < 3:
        return 0.0
    interval = float(np.median(np.diff(time)))
    return still_variance(
        float(recording.quantization_steps[c]),
        float(recording.noise[c] or 0.0),
        float(recording.poles[c]),
        interval,
    )


def still_variance(step: float, noise: float, pole: float, every: float) -> float:
    """Additional variance of white noise that is equivalent to quantisation errors at rest.

    Zero if the converter is fine enough for its errors to be white at rest as well.

    Parameters
    ----------
    step, noise : float
        Step of the converter, and noise of one sample, in the unit of the reading.
    pole : float
        Pole of the sensor's filter, rad/s; zero without one.
    every : float
        Time between two readings, s.
    """
    if step <= 0.0:
        return 0.0
    correlations = np.exp(-pole * every * np.arange(1, 50)) if pole else np.zeros(1)
    constant = _SUSPENSION_MEMORY / every * 0.5 * offset(step, noise) ** 2
    toggling = 0.25 * step**2 * (1.0 + 4.0 / math.pi * float(np.arcsin(correlations).sum()))
    known = step**2 / 12.0 + noise**2 * (1.0 + 2.0 * float(correlations.sum()))
    excess = max(toggling - known, 0.0) + constant
    return excess if excess > _SLIGHT * known else 0.0


def smallest_step(signal: Array) -> float:
    """Smallest distance between two different readings; zero if all are equal."""
    steps = np.diff(np.unique(signal))
    steps = steps[steps > 1e-9 * np.ptp(signal)] if len(steps) else steps  # beyond rounding
    return float(steps.min()) if len(steps) else 0.0


def missing_bit(signal: Array, step: float) -> float:
    """Weight of a bit that a converter never sets, or never clears; zero without one.

    Readings then fall into every other interval of that width, so that the spectrum of their
    distribution has a line at a period of two weights.  (Missing codes are a test of IEEE Std 1241,
    Terminology and Test Methods for Analog-to-Digital Converters.)  A signal that passes from one
    interval to the next would by chance be read in the empty half between them about every second
    time; it counts as a fault if the probability of none in all its passages, times the number of
    periods that were tried, is below one in a million.  The bit of lowest weight is not found:
    without it, a converter only has coarser steps.

    Parameters
    ----------
    signal : (N,) array
        Finite readings, in any unit.
    step : float
        Step of the converter in that unit; zero if it is not known.
    """
    span = float(np.ptp(signal)) if len(signal) else 0.0
    if not span > 0.0:
        return 0.0
    bins = min(math.ceil(span / (step or smallest_step(signal))) + 1, _MAX_CODES)
    counts = np.histogram(signal, bins, (signal.min() - 0.5 * span / bins, signal.max()))[0]
    line = np.abs(np.fft.rfft(counts, _PADDED * bins))[_MIN_PERIODS * _PADDED :]
    if not len(line):
        return 0.0
    periods = _MIN_PERIODS + int(np.argmax(line)) / _PADDED  # in the whole range
    place = (signal - signal.min()) / span * periods
    there = np.sort(place % 1.0)
    gaps = np.diff(there, append=there[0] + 1.0)
    if not _EMPTY_SHARES[0] < gaps.max() < _EMPTY_SHARES[1]:
        return 0.0
    after_gap = there[(int(np.argmax(gaps)) + 1) % len(there)]
    passages = int(np.count_nonzero(np.diff(np.floor(place - after_gap + 1e-9))))
    by_chance = 2.0**-passages * len(line)
    return 0.5 * span / periods if by_chance < _MISSING_CHANCE else 0.0


def quiet_level(a: Array, step: float) -> float:
    """Noise of one sample (m/s²) of readings (N,), from the quarter with the least motion.

    Third differences remove smooth motion; for white noise of standard deviation σ, theirs is
    √20 σ.  Lower bounds are a hundredth of the channel's standard deviation, and the noise of a
    converter with this step; a step of zero is replaced by the smallest step in the record.
    """
    a = a[np.isfinite(a)]
    quiet = float(np.quantile(np.abs(np.diff(a, 3)), 0.25)) / 0.3186 / math.sqrt(20.0)
    return _bounded_level(quiet, a, step)


def _bounded_level(level: float, a: Array, step: float) -> float:
    """Return a noise level, or its lower bound for finite readings (N,)."""
    step = step or smallest_step(a)
    return max(level, 0.01 * float(np.std(a)), step / math.sqrt(12.0), 1e-6)


def noise_level(recording: PreparedRecording, c: int) -> float:
    """Noise of one sample of a channel, m/s², from its quarter with least motion.

    White noise has the same density at every frequency.  If the top of the spectrum is empty, the
    third differences contain motion, and the lower bound is used.
    """
    if recording.noise_prior_centre is not None:
        return float(recording.noise_prior_centre[c])
    a, step = recording.values[c], float(recording.quantization_steps[c])
    quiet, top = quiet_level(a, step), top_level(a)
    return quiet if top > _EMPTY * quiet else _bounded_level(top, a[np.isfinite(a)], step)


def top_level(a: Array) -> float:
    """Level (m/s²) of white noise with the density of readings (N,) at the top of their spectrum.

    It is the median of the periodogram (Hann window) over the upper third of the frequencies; the
    median of χ² with two degrees of freedom is ln 2 of its mean.  Infinite for a few readings.
    """
    a = a[np.isfinite(a)]
    if len(a) < _FEWEST:
        return math.inf
    window = np.hanning(len(a))
    power = np.abs(np.fft.rfft((a - a.mean()) * window)) ** 2 / float(np.sum(window**2))
    upper = power[2 * len(power) // 3 :]
    return math.sqrt(float(np.median(upper)) / math.log(2.0))
