"""Measured inputs of a run: their biases, and their signal without most of its noise.

To a linear car a bias of a wheel sensor is a bias of the body's sensors: both move together.  A
spring that stiffens or a stop that is met depends on where the suspension is.  A bias of 0.1 m/s²
moves the rest of a car that bounces at 1.4 Hz by 1.3 mm, in every run by another amount, and a stop
that is touched by half a millimetre is missed or met twice as hard.

What a lag, a corner or a bracket would change follows from the wheel's own reading; worked out from
the raw one it would share the reading's noise, which drives the innovations as well, and a smooth
drive would show lags that are not there.
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
"""How well the mean reading gives a bias, m/s²: the wheel's speed at both ends over the time."""


def unit_input_moments(recording: PreparedRecording) -> Array:
    """Moments (E, ORDER) of an input of 1 m/s²."""
    time = recording.wheels[0].knots
    one = WheelSignal(CubicSpline(time, np.ones_like(time)), time, recording.wheels[0].sd)
    return moments(one, recording.instants, ORDER)


def without_mean_input(recording: PreparedRecording) -> PreparedRecording:
    """Return a recording whose inputs have mean zero; the body above them reads as much less.

    Beginning and end count little: what a wheel's speed is there does not average out.
    """
    rest = np.array([_mean(wheel) for wheel in recording.wheels])
    wheels = tuple(
        wheel._replace(spline=CubicSpline(wheel.knots, wheel.spline(wheel.knots) - level))
        for wheel, level in zip(recording.wheels, rest, strict=True)
    )
    return replace(
        recording,
        moments=recording.moments - rest[:, None] * unit_input_moments(recording)[:, None],
        reading=recording.reading - recording.rigid_gain @ rest,
        wheels=wheels,
    )


def _mean(wheel: WheelSignal) -> float:
    weight = np.hanning(len(wheel.knots) + 2)[1:-1]
    return float(np.average(wheel.spline(wheel.knots), weights=weight))


_LINES = 9  # of a spectrum that are averaged
_CERTAIN = 2.0  # times the noise that a line has to hold before any of it passes


def denoise_wheel(
    recording: PreparedRecording, number: int, corner: float | None
) -> tuple[Array, Array]:
    """Knots (K,) of a wheel's signal, s, and its readings there without most of their noise.

    Parameters
    ----------
    recording : PreparedRecording
        A recording.
    number : int
        Number of the input.
    corner : float or None
        Of the wheel's sensor, Hz.
    """
    wheel = recording.wheels[number]
    noise = sample_noise(recording, recording.inputs[number])
    return wheel.knots, denoised(wheel.knots, wheel.spline(wheel.knots), noise, corner)


def sample_noise(recording: PreparedRecording, c: int) -> float:
    """Deviation of one sample of a channel, m/s²: noise as given, or heard, and its steps."""
    given = recording.noise[c]
    return math.hypot(
        noise_level(recording, c) if given is None else given,
        float(recording.quantization_steps[c]) / math.sqrt(12.0),
    )


def denoised(time: Array, signal: Array, noise: float, corner: float | None) -> Array:
    """Pass a signal where its spectrum stands above that of its noise (Wiener 1949).

    Parameters
    ----------
    time : (N,) array
        Stamps, s; next to even.
    signal : (N,) array
        Readings.
    noise : float
        Deviation of one reading.
    corner : float or None
        Of the sensor's filter, Hz; its noise may have passed it or not, and the larger
        density of the two counts.

    Returns
    -------
    (N,) array
    """
    n = len(signal)
    even = np.linspace(time[0], time[-1], n)
    values = np.interp(even, time, signal)
    trend = np.linspace(values[0], values[-1], n)
    left = values - trend
    # Turned round at both ends, a record that begins and ends at zero has no edges.
    spectrum = np.fft.rfft(np.concatenate([left, -left[::-1]]))
    frequency = np.fft.rfftfreq(2 * n, even[1] - even[0])
    floor = np.full(len(frequency), noise**2)
    if corner is not None:
        shape = 1.0 / (1.0 + (frequency / corner) ** 2)
        floor = np.maximum(floor, noise**2 * shape / shape.mean())
    power = uniform_filter1d(np.abs(spectrum) ** 2 / (2 * n), _LINES)
    passed = np.clip(1.0 - _CERTAIN * floor / np.maximum(power, 1e-300), 0.0, None)
    quiet = np.fft.irfft(spectrum * passed, 2 * n)[:n] + trend
    return np.asarray(signal + np.interp(time, even, quiet - values))
