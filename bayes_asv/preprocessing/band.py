"""Low-pass filtering of recordings, for estimates below a frequency.

An engine, a body that bends, a seat: above some frequency a car does what no half car does.
One filter on all four channels leaves the linear relation between wheels and chassis as it is,
so the motion below a frequency obeys the same half car.  The filter is symmetric, so nothing
is delayed; what it cannot know at the ends is left out.  Filtered readings repeat each other:
the chassis keeps two readings a period of the band's edge, which is all there is below it,
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

ABOVE_MODES = 1.2  # times the fastest mode: below it a rate is no longer in the band
_REACH = 2.0  # periods of the band's edge that the filter looks back and ahead
_KAISER = 4.55  # 50 dB in the stop band (Kaiser 1974), which then begins at 1.37 times the edge
_SHORT = 0.125  # of a period: a gap that a spline crosses without harm in the band
STEPS_IN_PERIOD = 16.0  # at least, in a period: what drives the car is smooth
# Up to this many samples in a period of the edge, a cubic spline between them misses less than 2 %
# of the amplitude, (2π/4)⁴/384.
_SAMPLES_A_PERIOD = 4.0
_NO_GAP = 1.5  # rows: readings that stand no further apart than that lack none between them
_FEWEST = 32  # pairs of chassis readings
# What the half car leaves unexplained in a band is not the sensors' noise; before the fit it is
# taken to be a tenth of the motion, to within the usual factor for a level that nobody gave.
_LEFT = 0.1


def check_band(below: float, car: CarModel) -> None:
    """Refuse a band that the car's own motion does not fit in.

    Parameters
    ----------
    below : float
        Upper edge, Hz.
    car : CarModel
        The car.

    Raises
    ------
    InputError
        When the edge is not above the fastest nominal mode.
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
        Where half of the amplitude is left, Hz.
    rate : float
        Samples a second, Hz.

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
    """Say that too little of a recording is left once the filter has been fed, or None.

    Parameters
    ----------
    recording : PreparedRecording
        A recording, laid out at full band.
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
        A recording, laid out at full band, not :func:`too_short`.
    below : float
        Upper edge of the band, Hz.

    Returns
    -------
    PreparedRecording
        All channels filtered, on one even grid in true time; chassis readings at twice the
        band's edge (or the sampling rate, where that is lower).  Readings that the filter mixes
        with clipped samples, or with a gap longer than an eighth of a period, are missing.
        Noise levels are those after the filter.

    Raises
    ------
    InputError
        When the recording has fewer than four samples in a period of the band's upper edge.
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
        at = recording.times[c, usable[c]]
        if c in recording.inputs:
            curve = recording.wheels[recording.inputs.index(c)].spline
        else:
            curve = CubicSpline(at, recording.values[c, usable[c]])
        values[c] = np.convolve(curve(grid), weights, "valid")
        longest = max(_SHORT / below, _NO_GAP / rate)
        guessed = _guessed(grid, at, recording.times[c, recording.clipped[c]], longest)
        mixed[c] = np.convolve(guessed, np.ones(len(weights)), "valid") > 0.5
    left_out = mixed | np.any(mixed[list(recording.inputs)], axis=0)
    kept = np.arange(0, len(time), max(int(rate / (2.0 * below) + 1e-6), 1))
    left_out[:, np.setdiff1d(np.arange(len(time)), kept)] = True
    step = 1.0 / (STEPS_IN_PERIOD * below)
    wheels = tuple(
        _wheel(wheel, time, values[c], step)
        for wheel, c in zip(recording.wheels, recording.inputs, strict=True)
    )
    times = np.tile(time, (len(channels), 1))
    railed = np.zeros(values.shape, bool)
    reading = np.where(left_out, np.nan, values)
    plan = schedule(
        reading, times, (railed, railed), wheels, recording.outputs, recording.car, step
    )
    # The wheels keep every sample and with it the density of their noise; a filtered chassis
    # reading has what is left of it.
    passed = float(np.sqrt(np.sum(weights**2)))
    share = np.array([1.0 if channel.is_input else passed for channel in recording.channels])
    level = share * _at_rest(recording.poles, rate)
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
        noise_prior_centre=_LEFT * np.std(values, axis=1) / passed * share,
    )


def _guessed(grid: Array, at: Array, clipped: Array, longest: float) -> Flags:
    """Points of a grid between usable readings that are too far apart or have a clipped one."""
    far = np.diff(at) > longest
    if len(clipped):
        far[np.clip(np.searchsorted(at, clipped) - 1, 0, len(far) - 1)] = True
    inside = np.clip(np.searchsorted(at, grid, "right") - 1, 0, len(far) - 1)
    return np.asarray(far[inside] & (grid > at[inside]) & (grid < at[inside + 1]))


def _at_rest(poles: Array, rate: float) -> Array:
    """Deviation of white noise as dense below a sensor's pole as noise of deviation one.

    How much of that noise passed the pole is not known: half of it, as the prior says.
    """
    rho = np.exp(-poles / rate)
    dense = np.where(poles > 0.0, (1.0 + rho) / np.maximum(1.0 - rho, 1e-9), 1.0)
    return np.asarray(np.sqrt(0.5 * (1.0 + dense)))


def _wheel(whole: WheelSignal, time: Array, filtered: Array, step: float) -> WheelSignal:
    """Interpolate a filtered wheel; what the full band left unknown between samples stays.

    It is averaged over a step, since a step looks at its middle alone.
    """
    middle = 0.5 * (time[1:] + time[:-1])
    at = np.clip(np.searchsorted(whole.knots, middle) - 1, 0, len(whole.sd) - 1)
    count = max(round(step / (time[1] - time[0])), 1)
    power = np.convolve(whole.sd[at] ** 2, np.full(count, 1.0 / count), "same")
    return WheelSignal(CubicSpline(time, filtered), time, np.sqrt(power))
