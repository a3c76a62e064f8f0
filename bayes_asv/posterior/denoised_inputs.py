"""Predictions of a model from denoised inputs.

A wheel's noise drives the simulation and the innovations alike.  A pattern or a derivative that
follows from the simulation must not have it: a lag of 2.3 ms of a chassis sensor came out 15 %
short, and a narrower filter fitted better than the lag that was there.

So each wheel's reading is used less the conditional mean of its noise given all readings.  With
the noise n of the wheels, e of the chassis and the car's response G, a free run leaves
r = e − G n.  The reading less the mean of n given r,

    u + σ_n² Gᴴ (σ_e² + G σ_n² Gᴴ)⁻¹ r,

has nothing more to do with r.  What is worked out from it is not moved by the noise that is
still to be explained; with u itself, the two share n.  This is the statistic of the conditional
score (Stefanski & Carroll 1987, Biometrika 74, 703; Carroll et al. 2006, ch. 7), line by line of
the spectrum, and the smoother of a filter that takes the wheels for noisy inputs.  G is the linear
car's: what a law adds is left out.  Lines in which r is louder than all noise together hold
something that is missing from the model; what they hold is shared out among noise and that.
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
from bayes_asv.preprocessing.missing_band import frequency_response
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.wheel_spline import WheelSignal, moments

__all__ = ["DenoisedInputs", "denoise_and_predict", "simulate_nominal_outputs", "without_noise"]

_FINER = 2  # points of the even grid to a sample
_LINES = 17  # of a spectrum whose power is averaged
_CHANCE = 1.5  # times the noise's power, which so many lines hardly reach without anything in them


def without_noise(posterior: Posterior, z: Array, run: int) -> PreparedRecording:
    """Return a recording whose wheels' readings have lost what the chassis show to be noise.

    Parameters
    ----------
    posterior : Posterior
        With sensor corrections.
    z : (D,) array
        Coordinates.
    run : int
        Which recording.

    Returns
    -------
    PreparedRecording
        With other :attr:`wheels`; their moments are as they were.
    """
    recording = posterior.space.recordings[run]
    time = np.arange(recording.instants[0], recording.instants[-1], recording.reading_step / _FINER)
    added = _noise(posterior, z, run, time)
    wheels = []
    for wheel, noise in zip(recording.wheels, added, strict=True):
        value = wheel.spline(wheel.knots) - np.interp(wheel.knots, time, noise, 0.0, 0.0)
        wheels.append(wheel._replace(spline=CubicSpline(wheel.knots, value)))
    return replace(recording, wheels=tuple(wheels))


def _noise(posterior: Posterior, z: Array, run: int, time: Array) -> Array:
    """Mean noise (nu, T) of the inputs' sensors at even instants (T,), m/s²."""
    recording = posterior.space.recordings[run]
    left = recording.reading - free_run(posterior, z, run)[0]
    ny = left.shape[1]
    there = [recording.kind[:, y] == VALUE for y in range(ny)]
    even = np.stack(
        [np.interp(time, recording.instants[t], left[t, y]) for y, t in enumerate(there)]
    )
    even -= even.mean(axis=1, keepdims=True)
    n = 2 * len(time)  # zeros behind it, so that the end does not run into the beginning
    frequency = np.fft.rfftfreq(n, time[1] - time[0])
    spectrum = np.fft.rfft(even, n).T[..., None]
    # A body rate answers a constant input without bound; at rest nothing is left of it.
    response = np.zeros((len(frequency), ny, len(recording.wheels)), complex)
    response[1:] = frequency_response(posterior.space.state_space(z[None], run), frequency[1:])
    response[0] = response[1].real
    back = np.conj(np.swapaxes(response, 1, 2))
    noise = posterior.space.noises(z[None], run)
    power = _power(noise, frequency, recording.reading_step)
    nu = len(recording.wheels)
    inputs, outputs = power[:, :nu], power[:, nu:]
    density = outputs[:, :, None] * np.eye(ny) + (response * inputs[:, None]) @ back
    whitened = np.linalg.solve(density, spectrum)
    # A straight line between two samples has less power than a reading.
    share = _FINER * np.cos(0.5 * np.pi * frequency * recording.reading_step) ** 4 * len(time)
    loud = np.sum((np.conj(spectrum) * whitened).real, axis=(1, 2)) / (ny * share + 1e-3 * n)
    louder = np.maximum(1.0, uniform_filter1d(loud, _LINES) / _CHANCE)
    found = -inputs[..., None] * (back @ whitened) / louder[:, None, None]
    return np.asarray(np.fft.irfft(found[..., 0].T, n)[:, : len(time)])


def _power(noise: SensorNoise, frequency: Array, step: float) -> Array:
    """Power (F, nu + ny) of the noise of inputs and outputs, as a sample's variance."""
    passed = np.exp(-noise.poles[0] * step)
    shape = (1.0 - passed**2) / np.maximum(
        1.0 + passed**2 - 2.0 * passed * np.cos(2.0 * np.pi * frequency[:, None] * step), 1e-12
    )
    return np.asarray(noise.white[0] + noise.filtered[0] * shape)


Array = NDArray[np.float64]


class DenoisedInputs(NamedTuple):
    """A recording on denoised wheels.

    Parameters
    ----------
    recording : PreparedRecording
        With moments of wheels that have lost what the chassis show to be noise, and those wheels.
    before, after : (E, ny) arrays
        What sensors as declared would have read of the chassis above the wheels as they are, and
        above denoised ones, m/s².
    """

    recording: PreparedRecording
    before: Array
    after: Array


def denoise_and_predict(
    posterior: Posterior, z: Array, run: int, vehicle: Vehicle
) -> DenoisedInputs:
    """Quieten the wheels of a recording, and simulate the chassis above them.

    Parameters
    ----------
    posterior : Posterior
        With sensor corrections.
    z : (D,) array
        Coordinates.
    run : int
        Which recording.
    vehicle : Vehicle
        Gives declared bandwidths.
    """
    recording = without_noise(posterior, z, run)
    driven = recording.moments.copy()
    for u, (wheel, c) in enumerate(zip(recording.wheels, recording.inputs, strict=True)):
        knots, signal = denoise_wheel(
            recording, u, vehicle.sensor(recording.channels[c].name).bandwidth
        )
        denoised = WheelSignal(CubicSpline(knots, signal), knots, wheel.sd)
        driven[:, u] = moments(denoised, recording.instants, ORDER)
    still = replace(recording, moments=driven)
    begin = free_run(posterior, z, run)[2]
    before, after = (
        simulate_from(posterior, z, run, posterior.as_declared(z, run, one), begin)[0]
        for one in (recording, still)
    )
    return DenoisedInputs(still, before, after)


def simulate_nominal_outputs(posterior: Posterior, z: Array, run: int) -> Array:
    """Simulate what chassis sensors as declared would have read (E, ny) in a run, m/s²."""
    begin = free_run(posterior, z, run)[2]
    return simulate_from(posterior, z, run, posterior.as_declared(z, run), begin)[0]
