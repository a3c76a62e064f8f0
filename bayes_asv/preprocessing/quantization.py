"""Noise of one sample of a channel, and quantization errors of signals that hardly move.

While a signal crosses many steps the error of its converter is white noise of step²/12.  While it
stands still a part of it stays as it is, up to about (step/π) exp(−2π² (σ/step)²) with noise σ
(Widrow & Kollár 2008, Quantization Noise, ch. 4), and what toggles between two counts is up to
step²/4 and autocorrelated as the noise is.  In a measured input either is a slow error that drives
the suspension of the model: before a bump, a car at rest with converters of ten bits would seem to
be pushed.  So the noise of a wheel at rest is increased, below the frequencies of a suspension, by
the constant and the autocorrelated part; and readings of a car at rest before and after its drive
are left out.
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
    "noise_level",
    "offset",
    "quiet_level",
    "slow_steps",
    "smallest_step",
    "spurious_drift",
    "still_variance",
    "with_noise_of_still_wheels",
    "without_standstill",
]

Array = NDArray[np.float64]

STILL_WINDOW = 0.1
"""Length of the window in which a channel stands still, s."""
STILL_STEPS = 2.5
"""Steps of its converter that a channel which stands still covers in this window."""
_HARMONICS = 20  # of a saw tooth, beyond which there is no error that stays
_TEETH = 0.5  # steps from reading to reading below which errors of a converter remember
_LEAD = 0.5  # s around a drive that are listened to
_FORGOTTEN = 0.15  # s after which a suspension has forgotten what its wheel did
_FEWEST = 200  # readings from which the top of a spectrum is looked at
# The noise of a sensor falls by 6 dB in an octave behind its pole, and by 24 dB behind an analogue
# filter of fourth order: where the upper third is 40 dB lower there is no such noise.
_EMPTY = 0.01
_SLIGHT = 0.05  # of the noise's power, below which nothing is doubted


def offset(step: float, noise: float) -> float:
    """Largest error of a converter that stays while a reading with noise ``noise`` stands still.

    Both in the unit of the reading.  The mean error goes with the place x between two steps as
    (step/π) Σₖ (−1)ᵏ/k exp(−2π² k² (σ/step)²) sin 2πk x, to half a step at most.
    """
    if step <= 0.0:
        return 0.0
    k = np.arange(1, _HARMONICS + 1)
    size = (-1.0) ** k / (math.pi * k) * np.exp(-2.0 * (math.pi * k * noise / step) ** 2)
    place = np.linspace(0.0, 0.5, 101)
    mean = np.sin(2.0 * math.pi * place[:, None] * k) @ size
    return step * min(float(np.abs(mean).max()), 0.5)


def with_noise_of_still_wheels(recording: PreparedRecording) -> PreparedRecording:
    """Increase the noise of wheels at rest by the errors of their converters.

    The outputs do not need this: 40 drives of the 2008 car without a fault, with its ten bits and
    the noise of its data sheets, gave 22 false alarms before, and one with the noise increased at
    the wheels.
    """
    beyond = [_beyond(recording, c) * is_stationary(recording, c) for c in recording.inputs]
    doubt = np.stack(beyond, axis=1) * recording.process_noise[:, : len(beyond)]
    spread = recording.noise_spread + np.hstack([np.zeros_like(doubt), doubt])
    return replace(recording, process_noise=spread, standstill_noise=doubt)


def without_standstill(recording: PreparedRecording) -> PreparedRecording:
    """Leave out the readings of a car at rest before and after its drive.

    At rest a coarse converter shows nothing but a zero that is off by up to a step; the longer the
    rest, the smaller its standard deviation would seem to be.
    """
    still = np.all([is_stationary(recording, c) for c in range(len(recording.channels))], axis=0)
    if still.all() or not still.any():
        return recording
    moving = recording.instants[~still]
    waits = (recording.instants < moving[0] - _LEAD) | (recording.instants > moving[-1] + _LEAD)
    return replace(recording, kind=np.where(waits[:, None], MISSING, recording.kind))


def is_stationary(recording: PreparedRecording, c: int) -> NDArray[np.bool_]:
    """Whether a channel stands still on a coarse converter at each instant (E,)."""
    return _covers_less(recording, c, lambda readings: STILL_STEPS)


def is_slow(recording: PreparedRecording, c: int) -> NDArray[np.bool_]:
    """Whether a channel crosses so few steps of a converter that its errors are autocorrelated.

    What moves by a part of a step from reading to reading errs in saw teeth of several readings.
    """
    return _covers_less(recording, c, slow_steps)


def slow_steps(readings: int) -> float:
    """Return the steps in a window below which the errors of a converter are autocorrelated."""
    return max(STILL_STEPS, _TEETH * readings)


def _covers_less(
    recording: PreparedRecording, c: int, steps: Callable[[int], float]
) -> NDArray[np.bool_]:
    """Whether a channel covers fewer steps than that in a window of some readings (E,)."""
    if _beyond(recording, c) == 0.0:
        return np.zeros(len(recording.instants), bool)
    there = np.isfinite(recording.values[c])
    time, signal = recording.times[c, there], recording.values[c, there]
    n = max(round(STILL_WINDOW / float(np.median(np.diff(time)))), 3)
    span = maximum_filter1d(signal, n) - minimum_filter1d(signal, n)
    less = (span < steps(n) * recording.quantization_steps[c]).astype(float)
    return np.asarray(np.interp(recording.instants, time, less) > 0.5)


def spurious_drift(recording: PreparedRecording, c: int) -> float:
    """Slope (m/s³) of a channel's zero that its converter alone can cause over a recording.

    A zero that moves by as much as a converter's offset, between the beginning and the end of a
    run, is no fault.
    """
    still = float(np.mean(is_stationary(recording, c)))
    largest = offset(float(recording.quantization_steps[c]), float(recording.noise[c] or 0.0))
    return (
        2.0 * largest * still / float(np.ptp(recording.times[c, np.isfinite(recording.values[c])]))
    )


def _beyond(recording: PreparedRecording, c: int) -> float:
    """Variance (m²/s⁴) of white noise as strong as the quantization error of a channel at rest."""
    time = recording.times[c, np.isfinite(recording.values[c])]
    if len(time) < 3:
        return 0.0
    every = float(np.median(np.diff(time)))
    return still_variance(
        float(recording.quantization_steps[c]),
        float(recording.noise[c] or 0.0),
        float(recording.poles[c]),
        every,
    )


def still_variance(step: float, noise: float, pole: float, every: float) -> float:
    """Variance of as strong white noise beyond what is believed of a channel that stands still.

    Zero where the converter is fine enough for its errors to be white noise at standstill as well.

    Parameters
    ----------
    step, noise : float
        Step of the converter, and noise of one sample, in the unit of the reading.
    pole : float
        Of the sensor's filter, rad/s; zero without one.
    every : float
        Time between two readings, s.
    """
    if step <= 0.0:
        return 0.0
    memory = np.exp(-pole * every * np.arange(1, 50)) if pole else np.zeros(1)
    stays = _FORGOTTEN / every * 0.5 * offset(step, noise) ** 2
    torn = 0.25 * step**2 * (1.0 + 4.0 / math.pi * float(np.arcsin(memory).sum()))
    known = step**2 / 12.0 + noise**2 * (1.0 + 2.0 * float(memory.sum()))
    beyond = max(torn - known, 0.0) + stays
    return beyond if beyond > _SLIGHT * known else 0.0


def smallest_step(signal: Array) -> float:
    """Smallest distance between two different readings; zero where all are equal."""
    steps = np.diff(np.unique(signal))
    steps = steps[steps > 1e-9 * np.ptp(signal)] if len(steps) else steps  # beyond rounding
    return float(steps.min()) if len(steps) else 0.0


def quiet_level(a: Array, step: float) -> float:
    """Noise of one sample (m/s²) of readings (N,), from the quietest quarter of their record.

    Third differences take out what is smooth; white noise of deviation σ gives them √20 σ.
    A hundredth of the channel's own deviation is the least that is believed, and what a converter
    of this step adds; where the step is not given (zero) it is read off.
    """
    a = a[np.isfinite(a)]
    quiet = float(np.quantile(np.abs(np.diff(a, 3)), 0.25)) / 0.3186 / math.sqrt(20.0)
    return _at_least(quiet, a, step)


def _at_least(level: float, a: Array, step: float) -> float:
    """Return a level, or the least that is believed of finite readings (N,)."""
    step = step or smallest_step(a)
    return max(level, 0.01 * float(np.std(a)), step / math.sqrt(12.0), 1e-6)


def noise_level(recording: PreparedRecording, c: int) -> float:
    """Noise of one sample of a channel, m/s², from its quiet quarter.

    White noise is as strong at every frequency.  Where the top of the spectrum is empty, what the
    third differences hold is motion, and the least that is believed is taken in its place.
    """
    if recording.noise_prior_centre is not None:
        return float(recording.noise_prior_centre[c])
    a, step = recording.values[c], float(recording.quantization_steps[c])
    quiet, top = quiet_level(a, step), _top_level(a)
    return quiet if top > _EMPTY * quiet else _at_least(top, a[np.isfinite(a)], step)


def _top_level(a: Array) -> float:
    """Deviation (m/s²) of white noise as strong as readings (N,) are at the top of their spectrum.

    It is the median of the periodogram (Hann's window) over the upper third of the frequencies; the
    median of χ² with two degrees of freedom is ln 2 of its mean.  Infinite for a few readings.
    """
    a = a[np.isfinite(a)]
    if len(a) < _FEWEST:
        return math.inf
    window = np.hanning(len(a))
    power = np.abs(np.fft.rfft((a - a.mean()) * window)) ** 2 / float(np.sum(window**2))
    upper = power[2 * len(power) // 3 :]
    return math.sqrt(float(np.median(upper)) / math.log(2.0))
