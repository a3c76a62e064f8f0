"""Low-pass filtering of recordings, for estimates below a frequency.

Above some frequency, a car moves in ways in which no half car does: engine, bending of the body,
seat.  A common filter on all four channels does not change the linear relation between wheels and
chassis, so the motion below a frequency obeys the same half car.  The filter is symmetric and adds
no delay; values at the ends that it cannot compute are left out.  Filtered readings are redundant:
the chassis keeps two readings per period of the band edge, which contain all information below it,
while the wheels, which are inputs, keep every sample.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bayes_asv.domain.errors import InputError
from bayes_asv.models.car_model import CarModel
from bayes_asv.models.modes import nominal_modes
from bayes_asv.preprocessing.prepare import schedule
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.wheel_spline import WheelSignal

__all__ = [
    "ABOVE_MODES",
    "STEPS_IN_PERIOD",
    "check_band",
    "low_pass",
    "low_pass_recording",
    "too_short",
]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

ABOVE_MODES = 1.2  # least band edge, in frequencies of the fastest mode
_REACH = 2.0  # half length of the filter, in periods of the band edge
_KAISER = 4.55  # Kaiser's β for 50 dB (Kaiser 1974); the stop band begins at 1.37 times the edge
_SHORT = 0.125  # longest gap that is interpolated by a spline, in periods of the band edge
STEPS_IN_PERIOD = 16.0  # least number of filter steps per period of the band edge
# Least number of samples per period of the band edge: the error of a cubic spline is then below 2 %
# of the amplitude, (2π/4)⁴/384.
_SAMPLES_A_PERIOD = 4.0
_NO_GAP = 1.5  # distance of readings up to which none is missing between them, rows
_FEWEST = 32  # least number of pairs of chassis readings
# Prior centre of the residuals of the half car in a band, relative to the motion.  They are not
# sensor noise, and their level is undeclared.
_RESIDUAL_SHARE = 0.1


def check_band(below: float, car: CarModel) -> None:
    """Refuse a band that does not contain the modes of the car.

    Parameters
    ----------
    below : float
        Upper edge, Hz.
    car : CarModel
        The car.

    Raises
    ------
    InputError
        If the edge is not above the fastest nominal mode.
    """
    fastest = nominal_modes(car)[-1]
    least = ABOVE_MODES * fastest.natural
    if not below >= least:
        raise InputError(
            f"--below {below:g}",
            f"leaves out motion of this car, which moves at up to {fastest.natural:.2g} Hz",
            f"give at least {math.ceil(10.0 * least) / 10.0:g}",
        )


def low_pass(below: float, rate: float) -> Array:
    """Weights of a symmetric low-pass filter that add up to one.

    Parameters
    ----------
    below : float
        Frequency at which half of the amplitude remains, Hz.
    rate : float
        Sampling rate, Hz.

    Returns
    -------
    (2M + 1,) array
        A windowed sinc: its gain is within 0.005 of 1 up to 0.63 of the edge, and below 0.004
        from 1.37 of it on.
    """
    reach = max(math.ceil(_REACH * rate / below), 1)
    lag = np.arange(-reach, reach + 1)
    weights = np.sinc(2.0 * below / rate * lag) * np.kaiser(2 * reach + 1, _KAISER)
    return np.asarray(weights / weights.sum())


def too_short(recording: PreparedRecording, below: float) -> str | None:
    """Message that a recording is too short for the filter of a band, or None.

    Parameters
    ----------
    recording : PreparedRecording
        A recording, prepared at full band.
    below : float
        Upper edge of the band, Hz.
    """
    span = float(recording.times[0, -1] - recording.times[0, 0])
    lost = 2.0 * _REACH / below
    needed = lost + _FEWEST / (2.0 * below)
    if span >= needed:
        return None
    return (
        f"{recording.source} is too short for the motion below {below:g} Hz alone: {span:.1f} s, "
        f"of which the filter takes {lost:.1f}; record {needed:.1f} s or more, or take a wider band"
    )


def low_pass_recording(recording: PreparedRecording, below: float) -> PreparedRecording:
    """Keep the motion below a frequency.

    Parameters
    ----------
    recording : PreparedRecording
        A recording, prepared at full band, not :func:`too_short`.
    below : float
        Upper edge of the band, Hz.

    Returns
    -------
    PreparedRecording
        All channels filtered, on one even grid in true time; chassis readings at twice the band
        edge (or the sampling rate, if that is lower).  Readings into which the filter mixes clipped
        samples, or a gap longer than an eighth of a period, are missing.  Noise levels are those
        after the filter.

    Raises
    ------
    InputError
        If the recording has fewer than four samples per period of the band edge.
    """
    rate = 1.0 / float(np.median(np.diff(recording.times[0])))
    if below > rate / _SAMPLES_A_PERIOD:
        raise InputError(
            f"--below {below:g}",
            f"is too near the sampling rate of {recording.source}, {rate:.4g} Hz",
            f"give at most {math.floor(rate / _SAMPLES_A_PERIOD):g}, or leave --below out",
        )
    weights = low_pass(below, rate)
    reach = len(weights) // 2
    usable = np.isfinite(recording.values) & ~recording.clipped
    channels = range(len(recording.channels))
    first = max(recording.times[c, usable[c]][0] for c in channels)
    last = min(recording.times[c, usable[c]][-1] for c in channels)
    grid = first + np.arange(math.floor((last - first) * rate + 1e-6) + 1) / rate
    time = grid[reach : len(grid) - reach]
    values = np.empty((len(channels), len(time)))
    mixed = np.empty(values.shape, bool)
    for c in channels:
        usable_times = recording.times[c, usable[c]]
        if c in recording.inputs:
            spline = recording.wheels[recording.inputs.index(c)].spline
        else:
            spline = CubicSpline(usable_times, recording.values[c, usable[c]])
        values[c] = np.convolve(spline(grid), weights, "valid")
        longest = max(_SHORT / below, _NO_GAP / rate)
        guessed = _interpolated_points(
            grid, usable_times, recording.times[c, recording.clipped[c]], longest
        )
        mixed[c] = np.convolve(guessed, np.ones(len(weights)), "valid") > 0.5
    left_out = mixed | np.any(mixed[list(recording.inputs)], axis=0)
    kept = np.arange(0, len(time), max(int(rate / (2.0 * below) + 1e-6), 1))
    left_out[:, np.setdiff1d(np.arange(len(time)), kept)] = True
    step = 1.0 / (STEPS_IN_PERIOD * below)
    wheels = tuple(
        _filtered_wheel(wheel, time, values[c], step)
        for wheel, c in zip(recording.wheels, recording.inputs, strict=True)
    )
    times = np.tile(time, (len(channels), 1))
    railed = np.zeros(values.shape, bool)
    reading = np.where(left_out, np.nan, values)
    plan = schedule(
        reading, times, (railed, railed), wheels, recording.outputs, recording.car, step
    )
    # The wheels keep every sample and thus the spectral density of their noise; the noise of a
    # chassis reading is that after the filter.
    noise_gain = float(np.sqrt(np.sum(weights**2)))
    share = np.array([1.0 if channel.is_input else noise_gain for channel in recording.channels])
    level = share * _low_frequency_level(recording.poles, rate)
    return replace(
        recording,
        **plan._asdict(),
        wheels=wheels,
        values=values,
        times=times,
        clipped=railed,
        noise=tuple(
            None if n is None else n * s for n, s in zip(recording.noise, level, strict=True)
        ),
        quantization_steps=recording.quantization_steps * share,
        poles=np.zeros(len(channels)),
        below=below,
        noise_prior_centre=_RESIDUAL_SHARE * np.std(values, axis=1) / noise_gain * share,
    )


def _interpolated_points(grid: Array, at: Array, clipped: Array, longest: float) -> Flags:
    """Find points of a grid between usable readings that are far apart or have a clipped one."""
    far = np.diff(at) > longest
    if len(clipped):
        far[np.clip(np.searchsorted(at, clipped) - 1, 0, len(far) - 1)] = True
    inside = np.clip(np.searchsorted(at, grid, "right") - 1, 0, len(far) - 1)
    return np.asarray(far[inside] & (grid > at[inside]) & (grid < at[inside + 1]))


def _low_frequency_level(poles: Array, rate: float) -> Array:
    """Level of white noise with the low-frequency density of sensor noise of unit variance.

    Half of the noise is assumed to have passed the pole, as the prior of the filtered share.
    """
    rho = np.exp(-poles / rate)
    dense = np.where(poles > 0.0, (1.0 + rho) / np.maximum(1.0 - rho, 1e-9), 1.0)
    return np.asarray(np.sqrt(0.5 * (1.0 + dense)))


def _filtered_wheel(
    full_band: WheelSignal, time: Array, filtered: Array, step: float
) -> WheelSignal:
    """Interpolate a filtered wheel, and keep the interpolation error of the full band.

    The error is averaged over a step, since a filter step uses its value in the middle only.
    """
    middle = 0.5 * (time[1:] + time[:-1])
    at = np.clip(np.searchsorted(full_band.knots, middle) - 1, 0, len(full_band.sd) - 1)
    count = max(round(step / (time[1] - time[0])), 1)
    power = np.convolve(full_band.sd[at] ** 2, np.full(count, 1.0 / count), "same")
    return WheelSignal(CubicSpline(time, filtered), time, np.sqrt(power))
