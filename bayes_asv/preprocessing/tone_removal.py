"""Tones of an engine: detection of their spectral peaks, and removal from all channels.

An engine shakes the frame at multiples of half its speed.  Its tones are not only noise of the
chassis: through dampers and tyres they also reach the wheel readings.  No road caused them there,
but the half car would explain one tone by the other.  An autoregression of the chassis noise does
not correct this; the data in the band of a tone must not be used at all.  A common notch filter on
all channels does not change the linear relation between wheels and chassis, and removes the noise
in its band along with the tone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bayes_asv.domain.vehicle import Unsprung
from bayes_asv.models.car_model import CarModel, state_space
from bayes_asv.models.modes import nominal_modes
from bayes_asv.preprocessing.prepare import schedule
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.removed_band import removed_band
from bayes_asv.preprocessing.wheel_spline import WheelSignal, interpolation_sd

__all__ = [
    "IDLE_FREQUENCY",
    "MOST_TONES",
    "SETTLING_TIME_CONSTANTS",
    "Notch",
    "band_pass_filter",
    "engine_tones",
    "find_tones",
    "is_persistent",
    "is_wide",
    "main_tones",
    "notch_filter",
    "notch_of",
    "notched",
    "own_modes",
]  # fmt: skip

Array = NDArray[np.float64]

MOST_TONES = 16  # largest number of tones
_NARROWEST, _WIDEST = 2.0, 8.0  # range of the half-width of a notch, Hz; a narrow one rings longer
_WANDER = 0.05  # relative wander of a tone's frequency to either side
# Lowest speed of an engine, Hz (600 rev/min), and highest order of its tones in cycles per turn;
# half orders occur because a cylinder of a four-stroke engine fires every other turn.
IDLE_FREQUENCY, _MOST_ORDER = 10.0, 4.0
_ORDERS_OFF = 0.03  # relative error of the ratio of two tones of an engine
_LOWEST = 0.5 * IDLE_FREQUENCY  # lowest frequency of a tone, Hz
# Highest frequency of a tone, relative to half the sampling rate; slow motion has images above it.
_NEAR_HALF_RATE = 0.95
_MOST_ROWS = 4  # longest period of a logger's own work, rows
_MAX_WANDER = 1.5  # largest ratio of the frequencies of adjacent bands of one tone
_ADJACENT = 2.6  # largest distance of adjacent bands, half-widths
_MOMENT = 0.25  # length of the intervals over which persistence is tested, s
_AROUND = 1.5  # bandwidth in which persistence is tested, half-widths of a notch
_PERSISTENT = 0.55  # least median over mean energy of all intervals, beyond noise
_SEGMENT = 2.5  # length of a segment of a spectrum, s
_NEIGHBOURS = 41  # number of spectral lines whose median is the floor of the middle one
_FALSE_TONES = 1e-4  # false tones per spectrum of white noise
_LINES = 256  # number of frequencies of the filter's power, from zero to half the sampling rate
SETTLING_TIME_CONSTANTS = 3.0  # settling time of filters, in time constants of the narrowest notch


class Notch(NamedTuple):
    """A band that is removed.

    Parameters
    ----------
    frequency, half_width : float
        Centre and half-width, Hz; at a distance of the half-width, half of the power remains.
    """

    frequency: float
    half_width: float


def notch_filter(notches: Sequence[Notch], rate: float) -> Array:
    """Second-order sections of a cascade of notches with unit gain at rest.

    Parameters
    ----------
    notches : sequence of Notch
        Bands to remove.
    rate : float
        Sampling rate, Hz.

    Returns
    -------
    (T, 6) array
        Sections for :func:`scipy.signal.sosfilt`, with zeros on the unit circle and poles inside.
    """
    out = np.tile([1.0, 0.0, 0.0, 1.0, 0.0, 0.0], (len(notches), 1))
    for k, notch in enumerate(notches):
        if notch.frequency >= 0.5 * rate:  # beyond half the sampling rate
            continue
        angle = 2.0 * math.pi * notch.frequency / rate
        radius = math.exp(-2.0 * math.pi * notch.half_width / rate)
        zeros = np.array([1.0, -2.0 * math.cos(angle), 1.0])
        poles = np.array([1.0, -2.0 * radius * math.cos(angle), radius**2])
        out[k] = [*(zeros * poles.sum() / zeros.sum()), *poles]
    return out


def band_pass_filter(notch: Notch, rate: float) -> Array:
    """Second-order sections (T, 6) that pass the band of a notch; ``rate`` is the sampling rate."""
    from scipy.signal import butter

    edges = np.array([notch.frequency - notch.half_width, notch.frequency + notch.half_width])
    inside = np.clip(edges, 0.5, [0.47 * rate, 0.49 * rate])
    band = butter(2, inside, "bandpass", fs=rate, output="sos")
    return np.asarray(band, np.float64)


def find_tones(nu: Array, rate: float, alarm: float = _FALSE_TONES) -> tuple[Notch, ...]:
    """Find tones in the innovations of one run.

    The line that exceeds its neighbourhood most is removed, and the search is repeated.

    Parameters
    ----------
    nu : (R, n) array
        Normalised innovations of the accelerations of one run, in time order; nan where a reading
        is missing.
    rate : float
        Groups of readings per second, Hz.
    alarm : float
        Expected number of false tones in white noise.

    Returns
    -------
    tuple of Notch
        Notches for the tones; empty if no line is significant.
    """
    from scipy.signal import sosfilt

    signal = np.nan_to_num(nu)
    notches: list[Notch] = []
    while signal.size and len(notches) < MOST_TONES:
        remaining = sosfilt(notch_filter(notches, rate), signal, axis=0) if notches else signal
        frequency = _strongest_line(remaining, rate, alarm)
        if frequency is None:
            break
        notches.append(notch_of(frequency))
    return tuple(notches)


def engine_tones(
    tones: Sequence[Notch],
    runs: Sequence[Array],
    rate: float,
    modes: Sequence[tuple[float, float]] = (),
) -> tuple[Notch, ...]:
    """Select the tones that an engine can have.

    An engine always turns at 600 rev/min or more, so at least one of its tones is above 10 Hz, is
    present at most times, and covers a narrow band.  It is not related to the clock of the logger.
    A mode of the car has a wide line and no harmonics; a tone within such a line is that of an
    engine only if it has harmonics.

    Parameters
    ----------
    tones : sequence of Notch
        Tones, the strongest first.
    runs : sequence of (R, n) arrays
        Signals in which they were found.
    rate : float
        Groups of readings per second, Hz.
    modes : sequence of (frequency, damping ratio)
        Modes of the car and of its wheels, Hz.

    Returns
    -------
    tuple of Notch
        Tones of the engine, in the given order.
    """
    signals = [np.nan_to_num(run) for run in runs]
    longest = max((len(run) for run in signals), default=1)
    bin_width = rate / longest

    def is_engine_tone(tone: Notch) -> bool:
        f = tone.frequency
        if f < IDLE_FREQUENCY or f > _NEAR_HALF_RATE * 0.5 * rate:
            return False
        if any(abs(f - rate / rows) < 1.5 * bin_width for rows in range(2, _MOST_ROWS + 1)):
            return False
        beside = [
            t
            for t in tones
            if _is_harmonic(t, tone, bin_width) and not _is_at_mode(t.frequency, modes)
        ]
        if _is_at_mode(f, modes) and not beside:
            return False
        return is_persistent(signals, tone, rate)

    if not tones or is_wide(tones):
        return ()
    engine = [tone for tone in tones if is_engine_tone(tone)]
    return tuple(
        tone
        for tone in tones
        if any(
            abs(tone.frequency - one.frequency) < _ADJACENT * one.half_width
            or _is_harmonic(tone, one, bin_width)
            for one in engine
        )
    )


def own_modes(car: CarModel, unsprung: Unsprung | None = None) -> list[tuple[float, float]]:
    """Natural frequencies (Hz) and damping ratios of a nominal car and, if given, of its wheels."""
    out = [(mode.natural, mode.ratio) for mode in nominal_modes(car)]
    if unsprung is None:
        return out
    nominal = {name: float(np.ravel(x)[0]) for name, x in car.nominal.items()}
    for axle in ("front", "rear"):
        mass = getattr(unsprung, f"{axle}_mass")
        rate = getattr(unsprung, f"{axle}_tyre_rate") + nominal.get(f"k_{axle[0]}", 0.0)
        damping = getattr(unsprung, f"{axle}_tyre_damping") + nominal.get(f"c_{axle[0]}", 0.0)
        out.append(
            (math.sqrt(rate / mass) / (2.0 * math.pi), 0.5 * damping / math.sqrt(rate * mass))
        )
    return out


def _is_at_mode(frequency: float, modes: Sequence[tuple[float, float]]) -> bool:
    """Whether a frequency is within the half-power band of a mode."""
    return any(abs(frequency - f) < ratio * f for f, ratio in modes)


def _is_harmonic(tone: Notch, other: Notch, bin_width: float) -> bool:
    """Whether two tones are different multiples of half a speed, to within the resolution (Hz)."""
    orders = range(1, round(2.0 * _MOST_ORDER) + 1)
    return any(
        i != j
        and abs(tone.frequency - other.frequency * i / j)
        < _ORDERS_OFF * tone.frequency + 0.5 * bin_width
        for i in orders
        for j in orders
        if other.frequency * 2.0 / j >= IDLE_FREQUENCY
    )


def is_wide(tones: Sequence[Notch]) -> bool:
    """Whether the bands adjacent to the strongest one are wider than one wandering tone."""
    low = high = tones[0].frequency
    for _ in tones:
        reach = _ADJACENT * notch_of(high).half_width
        adjacent = [n.frequency for n in tones if low - reach <= n.frequency <= high + reach]
        low, high = min(adjacent), max(adjacent)
    return high > _MAX_WANDER * low


def is_persistent(runs: Sequence[Array], tone: Notch, rate: float) -> bool:
    """Whether a tone is present at most times, and not in a few short bursts only.

    Parameters
    ----------
    runs : sequence of (R, n) arrays
        Normalised innovations, without gaps.
    tone : Notch
        Band of the tone.
    rate : float
        Groups of readings per second, Hz.
    """
    from scipy.signal import sosfiltfilt, sosfreqz
    from scipy.stats import chi2

    band = band_pass_filter(Notch(tone.frequency, _AROUND * tone.half_width), rate)
    passed = float(np.mean(np.abs(sosfreqz(band, 2048)[1]) ** 4))  # forwards and backwards
    length = max(1, round(_MOMENT * rate))
    moments = [np.zeros(0)]
    for run in runs:
        if len(run) < 2 * length:
            continue
        power = np.sum(sosfiltfilt(band, run, axis=0) ** 2, axis=1)
        whole = power[: len(power) // length * length].reshape(-1, length)
        noise = run.shape[1] * passed * max(float(np.mean(run**2)), 1e-12)
        moments.append(whole.mean(axis=1) / noise)
    energy = np.concatenate(moments)
    if not len(energy):
        return False
    # degrees of freedom of the noise of all channels in an interval
    freedom = 4.0 * runs[0].shape[1] * _AROUND * tone.half_width * _MOMENT
    median = float(np.median(energy)) - float(chi2(freedom).median()) / freedom
    return bool(median > _PERSISTENT * (float(np.mean(energy)) - 1.0))


def notch_of(frequency: float) -> Notch:
    """Return a notch that covers the wander of a tone at a frequency (Hz)."""
    return Notch(frequency, min(max(_WANDER * frequency, _NARROWEST), _WIDEST))


def main_tones(notches: Sequence[tuple[float, float]]) -> tuple[float, ...]:
    """Frequencies (Hz) of the tones in rising order; several notches of one tone count once."""
    kept: list[float] = []
    for frequency, half_width in notches:  # the strongest came first
        if all(abs(frequency - other) > 2.0 * half_width for other in kept):
            kept.append(frequency)
    return tuple(sorted(kept))


def notched(recording: PreparedRecording, notches: Sequence[Notch]) -> PreparedRecording:
    """Remove bands from all channels of a recording.

    Parameters
    ----------
    recording : PreparedRecording
        A recording, prepared at full band.
    notches : sequence of Notch
        Bands to remove.

    Returns
    -------
    PreparedRecording
        The filtered recording, without the settling time of the filters; elapsed times still count
        from the original beginning.  Clipped chassis readings are missing, since a bound does not
        pass a filter.
    """
    from scipy.signal import sosfreqz

    values = np.full_like(recording.values, np.nan)
    rate = 1.0 / float(np.median(np.diff(recording.times[0])))
    sections = notch_filter(notches, rate)
    usable = np.isfinite(recording.values) & ~recording.clipped
    for c in range(len(recording.channels)):
        if c in recording.inputs:
            wheel = recording.wheels[recording.inputs.index(c)]
            curve, at = wheel.spline, wheel.knots
        else:
            at = recording.times[c, usable[c]]
            curve = CubicSpline(at, recording.values[c, usable[c]])
        values[c, np.isin(recording.times[c], at)] = _filter_curve(curve, at, rate, sections)
    narrowest = min(notch.half_width for notch in notches)
    settled = max(recording.times[:, 0]) + SETTLING_TIME_CONSTANTS / (2.0 * math.pi * narrowest)
    wheels = tuple(
        _filtered_wheel(wheel, values[c], recording.times[c], recording.clipped[c], settled)
        for wheel, c in zip(recording.wheels, recording.inputs, strict=True)
    )
    railed = np.zeros(values.shape, bool)
    values[:, np.all(recording.times < settled, axis=0)] = np.nan
    plan = schedule(
        values, recording.times, (railed, railed), wheels, recording.outputs, recording.car
    )
    step = 1.0 / rate
    phase = (np.arange(_LINES) + 0.5) * math.pi / _LINES
    _, response = sosfreqz(sections, phase)
    system = state_space(recording.car, recording.car.nominal, recording.output_models)
    return replace(
        recording,
        **plan._asdict(),
        wheels=wheels,
        values=values,
        removed_band=removed_band(np.abs(response) ** 2, len(plan.group_instants), step, system),
        notches=tuple(notches),
        standstill_noise=None,
    )


def _strongest_line(signal: Array, rate: float, alarm: float) -> float | None:
    """Frequency (Hz) of the most significant line; None if no line is significant."""
    from scipy.ndimage import median_filter
    from scipy.signal import welch
    from scipy.stats import f, gamma

    n = min(len(signal), round(_SEGMENT * rate))
    # with an overlap of one half and a Hann window, a segment is worth 0.55 independent ones
    segments = max(1.0, 0.55 * (2.0 * len(signal) / n - 1.0))
    frequency, power = welch(signal, rate, nperseg=n, noverlap=n // 2, axis=0)
    neighbours = min(_NEIGHBOURS, len(power) // 2 * 2 - 1)
    floor = median_filter(power, size=(neighbours, 1))
    half = neighbours // 2  # near its ends a spectrum has neighbours on one side only
    floor[:half], floor[-half:] = floor[half], floor[-half - 1]
    ratio = power / np.maximum(floor, 1e-12) * gamma(segments).median() / segments
    ratio[(frequency < _LOWEST) | (frequency > 0.5 * rate - 1.0)] = 0.0
    best, column = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
    # the floor is uncertain as well: the efficiency of a median is 0.64, that of Hann lines 0.67
    degrees = 2.0 * segments
    limit = float(f(degrees, 0.4 * neighbours * degrees).isf(alarm / power.size))
    return float(frequency[best]) if ratio[best, column] > limit else None


def _filter_curve(curve: CubicSpline, at: Array, rate: float, sections: Array) -> Array:
    """Filter a curve that is sampled at arbitrary times; even times need no interpolation."""
    from scipy.signal import sosfilt, sosfilt_zi

    grid = at[0] + np.arange(round((at[-1] - at[0]) * rate) + 1) / rate
    even = len(grid) == len(at) and bool(np.max(np.abs(grid - at)) < 1e-6 / rate)
    value = curve(at if even else grid)
    rest = float(np.mean(value[: max(round(0.05 * rate), 2)]))
    filtered, _ = sosfilt(sections, value, zi=rest * sosfilt_zi(sections))
    return filtered if even else np.asarray(CubicSpline(grid, filtered)(at))


def _filtered_wheel(
    unfiltered: WheelSignal,
    filtered: Array,
    times: Array,
    clipped: NDArray[np.bool_],
    settled: float,
) -> WheelSignal:
    """Interpolate a filtered wheel once the filter has settled."""
    usable = np.isfinite(filtered) & (times >= settled)
    knots, value = times[usable], filtered[usable]
    deviation = interpolation_sd(knots, value)
    middle = 0.5 * (knots[1:] + knots[:-1])
    at = np.clip(np.searchsorted(unfiltered.knots, middle) - 1, 0, len(unfiltered.sd) - 1)
    # beside a clipped sample, the uncertainty is larger than that from the sharpness of the curve
    beside = clipped[usable][1:] | clipped[usable][:-1]
    deviation = np.where(beside, np.maximum(deviation, unfiltered.sd[at]), deviation)
    return WheelSignal(CubicSpline(knots, value), knots, deviation)
