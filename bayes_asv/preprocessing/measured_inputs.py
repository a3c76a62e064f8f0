"""Measured inputs of a run: their biases, and their signal with most of the noise removed.

For a linear car, a bias of a wheel sensor is equivalent to one of the body's sensors.  The force of
a progressive spring or of a stop, however, depends on the position of the suspension.  A bias of
0.1 m/s² shifts the rest position of a car that bounces at 1.4 Hz by 1.3 mm, differently in every
run, and a stop that is touched by half a millimetre is missed or met twice as hard.

The corrections for a lag, a corner frequency or a bracket are computed from the wheel's reading.
Computed from the raw reading, they would share its noise, which also drives the innovations, and a
smooth drive would appear to have lags.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import uniform_filter1d

from bayes_asv.filters.kalman import ORDER
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.quantization import noise_level
from bayes_asv.preprocessing.wheel_spline import WheelSignal, moments

__all__ = [
    "INPUT_BIAS_SD",
    "denoise_wheel",
    "denoised",
    "sample_noise",
    "unit_input_moments",
    "without_mean_input",
]

Array = NDArray[np.float64]

INPUT_BIAS_SD = 0.15
"""Standard deviation of a bias that is estimated by the mean reading, m/s²: the difference of the
wheel's speeds at both ends, over the duration."""


def unit_input_moments(recording: PreparedRecording) -> Array:
    """Moments (E, ORDER) of an input of 1 m/s²."""
    time = recording.wheels[0].knots
    one = WheelSignal(CubicSpline(time, np.ones_like(time)), time, recording.wheels[0].sd)
    return moments(one, recording.instants, ORDER)


def without_mean_input(recording: PreparedRecording) -> PreparedRecording:
    """Subtract the mean of each input from it and from the outputs of the body above.

    The ends of the recording have small weights, since the speed of a wheel there does not average
    out.
    """
    means = np.array([_mean(wheel) for wheel in recording.wheels])
    wheels = tuple(
        wheel._replace(spline=CubicSpline(wheel.knots, wheel.spline(wheel.knots) - level))
        for wheel, level in zip(recording.wheels, means, strict=True)
    )
    return replace(
        recording,
        moments=recording.moments - means[:, None] * unit_input_moments(recording)[:, None],
        reading=recording.reading - recording.rigid_gain @ means,
        wheels=wheels,
    )


def _mean(wheel: WheelSignal) -> float:
    weight = np.hanning(len(wheel.knots) + 2)[1:-1]
    return float(np.average(wheel.spline(wheel.knots), weights=weight))


_AVERAGED_BINS = 9  # frequency bins over which power is averaged
_CERTAIN = 2.0  # ratio of power to noise below which a frequency is removed


def denoise_wheel(
    recording: PreparedRecording, number: int, corner: float | None
) -> tuple[Array, Array]:
    """Knots (K,) of a wheel's signal, s, and its readings there with most of the noise removed.

    Parameters
    ----------
    recording : PreparedRecording
        A recording.
    number : int
        Number of the input.
    corner : float or None
        Corner frequency of the wheel's sensor, Hz.
    """
    wheel = recording.wheels[number]
    noise = sample_noise(recording, recording.inputs[number])
    return wheel.knots, denoised(wheel.knots, wheel.spline(wheel.knots), noise, corner)


def sample_noise(recording: PreparedRecording, c: int) -> float:
    """Return the standard deviation of one sample of a channel, m/s²: noise, and quantisation."""
    given = recording.noise[c]
    return math.hypot(
        noise_level(recording, c) if given is None else given,
        float(recording.quantization_steps[c]) / math.sqrt(12.0),
    )


def denoised(time: Array, signal: Array, noise: float, corner: float | None) -> Array:
    """Wiener filter: keep a signal where its spectrum exceeds that of the noise (Wiener 1949).

    Parameters
    ----------
    time : (N,) array
        Time stamps, s, almost even.
    signal : (N,) array
        Readings.
    noise : float
        Standard deviation of the noise of one reading.
    corner : float or None
        Corner frequency of the sensor's filter, Hz.  The noise may have passed the filter or not;
        the larger density of the two is used.

    Returns
    -------
    (N,) array
    """
    n = len(signal)
    even = np.linspace(time[0], time[-1], n)
    values = np.interp(even, time, signal)
    trend = np.linspace(values[0], values[-1], n)
    detrended = values - trend
    # the odd extension of a record that begins and ends at zero has no jumps
    spectrum = np.fft.rfft(np.concatenate([detrended, -detrended[::-1]]))
    frequency = np.fft.rfftfreq(2 * n, even[1] - even[0])
    floor = np.full(len(frequency), noise**2)
    if corner is not None:
        shape = 1.0 / (1.0 + (frequency / corner) ** 2)
        floor = np.maximum(floor, noise**2 * shape / shape.mean())
    power = uniform_filter1d(np.abs(spectrum) ** 2 / (2 * n), _AVERAGED_BINS)
    passed = np.clip(1.0 - _CERTAIN * floor / np.maximum(power, 1e-300), 0.0, None)
    filtered = np.fft.irfft(spectrum * passed, 2 * n)[:n] + trend
    return np.asarray(signal + np.interp(time, even, filtered - values))
