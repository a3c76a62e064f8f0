"""Tones of an engine: found by their peaks, and cut out of all channels alike.

An engine shakes the frame at the multiples of half its speed.  Its tones are not only noise of
the chassis: through dampers and tyres they are in the wheels' readings as well, where no road
made them, so that the half car would explain a tone by a tone.  No colour of the chassis' noise
mends that; what the data say in the band of a tone must not count at all.  A filter common to
all channels leaves the linear relation between wheels and chassis as it is (so a notch does),
and the noise in the notch is gone with the tone.
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
from bayes_asv.preprocessing.missing_band import missing_band
from bayes_asv.preprocessing.prepare import schedule
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
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

MOST_TONES = 16
_NARROWEST, _WIDEST = 2.0, 8.0  # Hz, half-width of a notch: it rings as long as it is narrow
_WANDER = 0.05  # of its frequency that a tone wanders to either side
# Idling engines turn at 600 rev/min and more, and fast ones at 15 000; what shakes a frame are
# half orders (a cylinder of a four-stroke engine fires every other turn) up to the fourth.
IDLE_FREQUENCY, _MOST_ORDER = 10.0, 4.0  # Hz; turns
_ORDERS_OFF = 0.03  # relative error of the ratio of two tones of an engine
_LOWEST = 0.5 * IDLE_FREQUENCY
_NEAR_HALF_RATE = 0.95  # of half the rate: what is above is an image of slow motion
_MOST_ROWS = 4  # rows after which the work of a logger repeats itself
_MAX_WANDER = 1.5  # highest over lowest frequency of adjacent bands of one tone
_ADJACENT = 2.6  # half-widths of a band, as far as the next one may be
_MOMENT = 0.25  # s
_AROUND = 1.5  # half-widths of a notch in which the persistence of a tone is judged
_PERSISTENT = 0.55  # least median over mean energy of all moments, beyond noise
_SEGMENT = 2.5  # s of a spectrum
_NEIGHBOURS = 41  # lines of a spectrum whose median is the floor of the middle one
_ALARM = 1e-4  # false tones a spectrum of white noise
_LINES = 256  # of the filter's power, from zero to half the rate
SETTLING_TIME_CONSTANTS = (
    3.0  # time constants of the narrowest notch until it has forgotten its beginning
)


class Notch(NamedTuple):
    """A band that is cut out.

    Parameters
    ----------
    frequency, half_width : float
        Hz; at half a width from the middle half of the power is left.
    """

    frequency: float
    half_width: float


def notch_filter(notches: Sequence[Notch], rate: float) -> Array:
    """Second-order sections of a cascade of notches with unit gain at rest.

    Parameters
    ----------
    notches : sequence of Notch
        Bands to cut out.
    rate : float
        Samples a second, Hz.

    Returns
    -------
    (T, 6) array
        As :func:`scipy.signal.sosfilt` takes them: zeros on the unit circle, poles behind them.
    """
    out = np.tile([1.0, 0.0, 0.0, 1.0, 0.0, 0.0], (len(notches), 1))
    for k, notch in enumerate(notches):
        if notch.frequency >= 0.5 * rate:  # filtered away, or folded to where nobody looks
            continue
        angle = 2.0 * math.pi * notch.frequency / rate
        radius = math.exp(-2.0 * math.pi * notch.half_width / rate)
        zeros = np.array([1.0, -2.0 * math.cos(angle), 1.0])
        poles = np.array([1.0, -2.0 * radius * math.cos(angle), radius**2])
        out[k] = [*(zeros * poles.sum() / zeros.sum()), *poles]
    return out


def band_pass_filter(notch: Notch, rate: float) -> Array:
    """Second-order sections (T, 6) that pass the band of a notch, at ``rate`` samples a second."""
    from scipy.signal import butter

    edges = np.array([notch.frequency - notch.half_width, notch.frequency + notch.half_width])
    inside = np.clip(edges, 0.5, [0.47 * rate, 0.49 * rate])
    band = butter(2, inside, "bandpass", fs=rate, output="sos")
    return np.asarray(band, np.float64)


def find_tones(nu: Array, rate: float, alarm: float = _ALARM) -> tuple[Notch, ...]:
    """Find tones in the innovations of one run.

    The line that stands out most of its neighbourhood is cut out, and what is left is searched
    again.

    Parameters
    ----------
    nu : (R, n) array
        Normalised innovations of the accelerations of one run, in time order; nan where a reading
        was missing.
    rate : float
        Groups of readings a second, Hz.
    alarm : float
        False tones that a white record may show.

    Returns
    -------
    tuple of Notch
        Empty when no line stands out by more than white records show that often.
    """
    from scipy.signal import sosfilt

    signal = np.nan_to_num(nu)
    notches: list[Notch] = []
    while signal.size and len(notches) < MOST_TONES:
        left = sosfilt(notch_filter(notches, rate), signal, axis=0) if notches else signal
        frequency = _peak(left, rate, alarm)
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

    An engine turns at 600 rev/min or more, whatever else the car does, so that at least one of its
    tones is above 10 Hz, is present at most times, and covers a narrow band.  It is not tied to the
    clock of the logger.  A mode of the car has a wide line, and no harmonics: a tone within such a
    line is an engine's only if it has.

    Parameters
    ----------
    tones : sequence of Notch
        As found, the strongest first.
    runs : sequence of (R, n) arrays
        Signals in which they were found.
    rate : float
        Groups of readings a second, Hz.
    modes : sequence of (frequency, damping ratio)
        Modes of the car and of its wheels, Hz.

    Returns
    -------
    tuple of Notch
        In the order given.
    """
    signals = [np.nan_to_num(run) for run in runs]
    longest = max((len(run) for run in signals), default=1)
    bin_width = rate / longest

    def plain(tone: Notch) -> bool:
        f = tone.frequency
        if f < IDLE_FREQUENCY or f > _NEAR_HALF_RATE * 0.5 * rate:
            return False
        if any(abs(f - rate / rows) < 1.5 * bin_width for rows in range(2, _MOST_ROWS + 1)):
            return False
        beside = [
            t for t in tones if _harmonic(t, tone, bin_width) and not _at_mode(t.frequency, modes)
        ]
        if _at_mode(f, modes) and not beside:
            return False
        return is_persistent(signals, tone, rate)

    if not tones or is_wide(tones):
        return ()
    own = [tone for tone in tones if plain(tone)]
    return tuple(
        tone
        for tone in tones
        if any(
            abs(tone.frequency - one.frequency) < _ADJACENT * one.half_width
            or _harmonic(tone, one, bin_width)
            for one in own
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


def _at_mode(frequency: float, modes: Sequence[tuple[float, float]]) -> bool:
    """Whether a frequency is within the half-power band of a mode."""
    return any(abs(frequency - f) < ratio * f for f, ratio in modes)


def _harmonic(tone: Notch, other: Notch, bin_width: float) -> bool:
    """Whether two tones are different multiples of half a speed, as far as lines (Hz) tell."""
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
    """Whether the bands adjacent to the strongest are more than one tone that wanders."""
    low = high = tones[0].frequency
    for _ in tones:
        reach = _ADJACENT * notch_of(high).half_width
        adjacent = [n.frequency for n in tones if low - reach <= n.frequency <= high + reach]
        low, high = min(adjacent), max(adjacent)
    return high > _MAX_WANDER * low


def is_persistent(runs: Sequence[Array], tone: Notch, rate: float) -> bool:
    """Whether a tone is present at most times, and not in a few strong moments.

    Parameters
    ----------
    runs : sequence of (R, n) arrays
        Normalised innovations, without gaps.
    tone : Notch
        Where.
    rate : float
        Groups of readings a second, Hz.
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
    # of noise in a moment, of all channels
    freedom = 4.0 * runs[0].shape[1] * _AROUND * tone.half_width * _MOMENT
    median = float(np.median(energy)) - float(chi2(freedom).median()) / freedom
    return bool(median > _PERSISTENT * (float(np.mean(energy)) - 1.0))


def notch_of(frequency: float) -> Notch:
    """Return a notch as wide as a tone at a frequency (Hz) may wander."""
    return Notch(frequency, min(max(_WANDER * frequency, _NARROWEST), _WIDEST))


def main_tones(notches: Sequence[tuple[float, float]]) -> tuple[float, ...]:
    """Frequencies (Hz) of the tones, rising, each once however many notches it took."""
    kept: list[float] = []
    for frequency, half_width in notches:  # the strongest came first
        if all(abs(frequency - other) > 2.0 * half_width for other in kept):
            kept.append(frequency)
    return tuple(sorted(kept))


def notched(recording: PreparedRecording, notches: Sequence[Notch]) -> PreparedRecording:
    """Cut bands out of all channels of a recording.

    Parameters
    ----------
    recording : PreparedRecording
        A recording, laid out at full band.
    notches : sequence of Notch
        Bands to cut out.

    Returns
    -------
    PreparedRecording
        What is left once the filters have forgotten where the record began; what went by since
        then is counted from there all the same.  A clipped chassis
        reading is missing: a bound does not pass a filter.
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
        values[c, np.isin(recording.times[c], at)] = _cut(curve, at, rate, sections)
    narrowest = min(notch.half_width for notch in notches)
    settled = max(recording.times[:, 0]) + SETTLING_TIME_CONSTANTS / (2.0 * math.pi * narrowest)
    wheels = tuple(
        _wheel(wheel, values[c], recording.times[c], recording.clipped[c], settled)
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
        removed_band=missing_band(np.abs(response) ** 2, len(plan.group_instants), step, system),
        notches=tuple(notches),
        standstill_noise=None,
        start_time=recording.instants[0] if recording.start_time is None else recording.start_time,
    )


def _peak(left: Array, rate: float, alarm: float) -> float | None:
    """Frequency (Hz) of the line that stands out most, if any does."""
    from scipy.ndimage import median_filter
    from scipy.signal import welch
    from scipy.stats import f, gamma

    n = min(len(left), round(_SEGMENT * rate))
    # Half of a segment is the next one's: a Hann window makes that 0.55 of an independent one.
    segments = max(1.0, 0.55 * (2.0 * len(left) / n - 1.0))
    frequency, power = welch(left, rate, nperseg=n, noverlap=n // 2, axis=0)
    neighbours = min(_NEIGHBOURS, len(power) // 2 * 2 - 1)
    floor = median_filter(power, size=(neighbours, 1))
    half = neighbours // 2  # near its ends a spectrum has neighbours on one side only
    floor[:half], floor[-half:] = floor[half], floor[-half - 1]
    ratio = power / np.maximum(floor, 1e-12) * gamma(segments).median() / segments
    ratio[(frequency < _LOWEST) | (frequency > 0.5 * rate - 1.0)] = 0.0
    best, column = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
    # The floor is uncertain as well: a median is worth 0.64, Hann lines 0.67 of as many lines.
    degrees = 2.0 * segments
    limit = float(f(degrees, 0.4 * neighbours * degrees).isf(alarm / power.size))
    return float(frequency[best]) if ratio[best, column] > limit else None


def _cut(curve: CubicSpline, at: Array, rate: float, sections: Array) -> Array:
    """Filter a curve sampled at any times; at even ones nothing is interpolated."""
    from scipy.signal import sosfilt, sosfilt_zi

    grid = at[0] + np.arange(round((at[-1] - at[0]) * rate) + 1) / rate
    even = len(grid) == len(at) and bool(np.max(np.abs(grid - at)) < 1e-6 / rate)
    value = curve(at if even else grid)
    rest = float(np.mean(value[: max(round(0.05 * rate), 2)]))
    filtered, _ = sosfilt(sections, value, zi=rest * sosfilt_zi(sections))
    return filtered if even else np.asarray(CubicSpline(grid, filtered)(at))


def _wheel(
    whole: WheelSignal, filtered: Array, times: Array, clipped: NDArray[np.bool_], settled: float
) -> WheelSignal:
    """Interpolate a filtered wheel once the filter has settled."""
    there = np.isfinite(filtered) & (times >= settled)
    knots, value = times[there], filtered[there]
    deviation = interpolation_sd(knots, value)
    middle = 0.5 * (knots[1:] + knots[:-1])
    at = np.clip(np.searchsorted(whole.knots, middle) - 1, 0, len(whole.sd) - 1)
    # Beside a clipped sample more is unknown than the sharpness of the curve tells.
    beside = clipped[there][1:] | clipped[there][:-1]
    deviation = np.where(beside, np.maximum(deviation, whole.sd[at]), deviation)
    return WheelSignal(CubicSpline(knots, value), knots, deviation)
