"""Predictions of a model from denoised inputs.

The noise of the wheel sensors drives both the simulation and the innovations.  Corrections or
derivatives that are computed from the simulation must not contain that noise: a chassis sensor lag
of 2.3 ms was estimated 15 % too small, and a narrower filter fitted better than the true lag.

Therefore the conditional mean of the wheel noise given all readings is subtracted from the wheel
readings.  With wheel noise n, chassis noise e and the frequency response G of the car, the residual
of a free run is r = e − G n.  The reading less the mean of n given r,

    u + σ_n² Gᴴ (σ_e² + G σ_n² Gᴴ)⁻¹ r,

is independent of r, while u itself shares n with it.  This is the statistic of the conditional
score (Stefanski & Carroll 1987, Biometrika 74, 703; Carroll et al. 2006, ch. 7), evaluated at each
frequency, and the smoother of a filter with noisy inputs.  G is the response of the linear car;
nonlinear forces are left out.  At frequencies where the power of r exceeds that of all noise, the
model lacks something; only the share of the power that noise explains is then attributed to it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import uniform_filter1d

from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.kalman import ORDER, VALUE, SensorNoise
from bayes_asv.posterior.free_simulation import free_run, simulate_from
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.preprocessing.measured_inputs import denoise_wheel
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.removed_band import frequency_response
from bayes_asv.preprocessing.wheel_spline import WheelSignal, moments

__all__ = ["DenoisedInputs", "denoise_and_predict", "simulate_nominal_outputs", "without_noise"]

_OVERSAMPLING = 2  # points of the even time grid per sample
_AVERAGED_BINS = 17  # frequency bins over which power is averaged
# Average power relative to noise above which the model lacks something: noise alone hardly reaches
# it with so many bins.
_NOISE_LIMIT = 1.5


def without_noise(posterior: Posterior, z: Array, run: int) -> PreparedRecording:
    """Subtract the conditional mean of wheel-sensor noise given the chassis readings.

    Parameters
    ----------
    posterior : Posterior
        Posterior with sensor corrections.
    z : (D,) array
        Coordinates.
    run : int
        Which recording.

    Returns
    -------
    PreparedRecording
        With denoised ``wheels``; their ``moments`` are unchanged.
    """
    recording = posterior.space.recordings[run]
    time = np.arange(
        recording.instants[0], recording.instants[-1], recording.reading_step / _OVERSAMPLING
    )
    noise_of_wheels = _noise(posterior, z, run, time)
    wheels = []
    for wheel, noise in zip(recording.wheels, noise_of_wheels, strict=True):
        value = wheel.spline(wheel.knots) - np.interp(wheel.knots, time, noise, 0.0, 0.0)
        wheels.append(wheel._replace(spline=CubicSpline(wheel.knots, value)))
    return replace(recording, wheels=tuple(wheels))


def _noise(posterior: Posterior, z: Array, run: int, time: Array) -> Array:
    """Conditional mean noise (nu, T) of the inputs' sensors on an even grid (T,), m/s²."""
    recording = posterior.space.recordings[run]
    residuals = recording.reading - free_run(posterior, z, run)[0]
    ny = residuals.shape[1]
    has_reading = [recording.kind[:, y] == VALUE for y in range(ny)]
    even = np.stack(
        [np.interp(time, recording.instants[t], residuals[t, y]) for y, t in enumerate(has_reading)]
    )
    even -= even.mean(axis=1, keepdims=True)
    n = 2 * len(time)  # zero padding, so that the end does not wrap around to the beginning
    frequency = np.fft.rfftfreq(n, time[1] - time[0])
    spectrum = np.fft.rfft(even, n).T[..., None]
    # The response of a body rate to a constant input diverges; replace it at zero frequency.
    response = np.zeros((len(frequency), ny, len(recording.wheels)), complex)
    response[1:] = frequency_response(posterior.space.state_space(z[None], run), frequency[1:])
    response[0] = response[1].real
    adjoint = np.conj(np.swapaxes(response, 1, 2))
    noise = posterior.space.noises(z[None], run)
    power = _power(noise, frequency, recording.reading_step)
    nu = len(recording.wheels)
    inputs, outputs = power[:, :nu], power[:, nu:]
    density = outputs[:, :, None] * np.eye(ny) + (response * inputs[:, None]) @ adjoint
    whitened = np.linalg.solve(density, spectrum)
    # linear interpolation between samples reduces the power
    share = (
        _OVERSAMPLING * np.cos(0.5 * np.pi * frequency * recording.reading_step) ** 4 * len(time)
    )
    relative_power = np.sum((np.conj(spectrum) * whitened).real, axis=(1, 2)) / (
        ny * share + 1e-3 * n
    )
    excess = np.maximum(1.0, uniform_filter1d(relative_power, _AVERAGED_BINS) / _NOISE_LIMIT)
    mean_noise = -inputs[..., None] * (adjoint @ whitened) / excess[:, None, None]
    return np.asarray(np.fft.irfft(mean_noise[..., 0].T, n)[:, : len(time)])


def _power(noise: SensorNoise, frequency: Array, step: float) -> Array:
    """Noise power (F, nu + ny) of inputs and outputs at each frequency, as sample variance."""
    correlation = np.exp(-noise.poles[0] * step)
    shape = (1.0 - correlation**2) / np.maximum(
        1.0 + correlation**2 - 2.0 * correlation * np.cos(2.0 * np.pi * frequency[:, None] * step),
        1e-12,
    )
    return np.asarray(noise.white[0] + noise.filtered[0] * shape)


Array = NDArray[np.float64]


class DenoisedInputs(NamedTuple):
    """A recording with denoised wheel readings, and predictions from them.

    Parameters
    ----------
    recording : PreparedRecording
        With denoised wheels and their moments.
    before, after : (E, ny) arrays
        Simulated chassis readings of sensors as declared, driven by the wheels as read and by the
        denoised wheels, m/s².
    """

    recording: PreparedRecording
    before: Array
    after: Array


def denoise_and_predict(
    posterior: Posterior, z: Array, run: int, vehicle: Vehicle
) -> DenoisedInputs:
    """Denoise the wheel readings of a recording, and simulate the chassis from them.

    Parameters
    ----------
    posterior : Posterior
        Posterior with sensor corrections.
    z : (D,) array
        Coordinates.
    run : int
        Which recording.
    vehicle : Vehicle
        Gives declared bandwidths.
    """
    recording = without_noise(posterior, z, run)
    input_moments = recording.moments.copy()
    for u, (wheel, c) in enumerate(zip(recording.wheels, recording.inputs, strict=True)):
        knots, signal = denoise_wheel(
            recording, u, vehicle.sensor(recording.channels[c].name).bandwidth
        )
        denoised = WheelSignal(CubicSpline(knots, signal), knots, wheel.sd)
        input_moments[:, u] = moments(denoised, recording.instants, ORDER)
    denoised_recording = replace(recording, moments=input_moments)
    initial = free_run(posterior, z, run)[2]
    before, after = (
        simulate_from(posterior, z, run, posterior.as_declared(z, run, one), initial)[0]
        for one in (recording, denoised_recording)
    )
    return DenoisedInputs(denoised_recording, before, after)


def simulate_nominal_outputs(posterior: Posterior, z: Array, run: int) -> Array:
    """Simulate the chassis readings (E, ny) of sensors as declared in a run, m/s²."""
    initial = free_run(posterior, z, run)[2]
    return simulate_from(posterior, z, run, posterior.as_declared(z, run), initial)[0]
