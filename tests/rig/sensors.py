"""Four accelerometers and two logger boards: from true accelerations to rows of a file."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

from .motion import Motion, lagrange
from .units import INCH

__all__ = ["CHANNELS", "Adc", "Reading", "SensorSpec", "draw_biases", "low_pass", "sense"]

Reals = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Four = tuple[float, float, float, float]

CHANNELS: Final = ("front_wheel", "front_chassis", "rear_wheel", "rear_chassis")
_WHEEL_STEP: Final = 5.945 * INCH
_CHASSIS_STEP: Final = 2.470 * INCH


@dataclass(frozen=True)
class Adc:
    """The converter: ``zero`` counts at rest, ``scale`` m/s^2 a count, 0 to ``top``."""

    zero: Four = (569.5, 641.0, 581.5, 636.0)
    scale: Four = (_WHEEL_STEP, _CHASSIS_STEP, _WHEEL_STEP, _CHASSIS_STEP)
    top: int = 1023


@dataclass(frozen=True)
class SensorSpec:
    """Sensors and boards, channels in the order of :data:`CHANNELS`, SI.

    The same class says what is true (given to ``drive``) and what is declared (given to
    ``vehicle_toml``); a sensor effect is a difference between the two.

    Attributes
    ----------
    bandwidth : four floats
        Of a first-order low-pass, Hz; ``inf`` for none.
    delay : four floats
        How much later than its row a channel is sampled, s.
    gain : four floats
        Reading over truth.
    bias : four floats
        Added, m/s^2.
    drift : four floats
        Slope of the bias, m/s^3, zero at t = 0.
    noise : four floats
        Rms of one sample, m/s^2, steps of the converter left out.
    noise_kind : {'filtered', 'white'}
        White noise that passes the sensor's own filter (correlation exp(-2 pi f dt) between
        samples), or independent from sample to sample.
    adc : Adc or None
        None gives readings without steps or rails.
    clock_offset, clock_ppm : (front, rear)
        The board samples at t (1 + ppm 1e-6) + offset when its row says t, s.
    jitter : float
        Rms of uneven row times, s; stamps tell the truth.
    hidden_jitter : float
        Rms of uneven sampling that the stamps do not tell, s.
    dropped : float
        Share of rows lost.
    burst : int
        Rows lost at a time.
    chassis_offset : (front, rear)
        How far forward of its axle line a chassis sensor sits, m.
    """

    bandwidth: Four = (50.0, 50.0, 50.0, 50.0)
    delay: Four = (0.0, 0.000675, 0.0, 0.000675)
    gain: Four = (1.0, 1.0, 1.0, 1.0)
    bias: Four = (0.0, 0.0, 0.0, 0.0)
    drift: Four = (0.0, 0.0, 0.0, 0.0)
    noise: Four = (1.6 * INCH, 0.9 * INCH, 1.6 * INCH, 0.9 * INCH)
    noise_kind: Literal["filtered", "white"] = "filtered"
    adc: Adc | None = Adc()
    clock_offset: tuple[float, float] = (0.0, 0.0)
    clock_ppm: tuple[float, float] = (0.0, 0.0)
    jitter: float = 0.0
    hidden_jitter: float = 0.0
    dropped: float = 0.0
    burst: int = 1
    chassis_offset: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def ideal(cls) -> SensorSpec:
        """Return sensors without filter, delay, noise or steps."""
        off = (0.0, 0.0, 0.0, 0.0)
        return cls(bandwidth=(math.inf,) * 4, delay=off, noise=off, adc=None)

    @classmethod
    def clean(cls) -> SensorSpec:
        """Return sensors with the default filters and delays, but no noise and no steps."""
        return cls(noise=(0.0, 0.0, 0.0, 0.0), adc=None)


@dataclass(frozen=True)
class Reading:
    """What the logger wrote, and what it should have been.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Stamps of the rows, s.
    values, clean : ndarray, shape (4, n)
        Readings; and the filtered, delayed truth without gain, bias, noise and steps, m/s^2.
    counts : ndarray of int, shape (4, n), or None
        Converter output.
    clipped : ndarray of bool, shape (4, n)
        At a rail.
    """

    time: Reals
    values: Reals
    clean: Reals
    counts: Integers | None
    clipped: npt.NDArray[np.bool_]


def draw_biases(spec: SensorSpec, rng: np.random.Generator, sd: float = 4.0 * INCH) -> SensorSpec:
    """Return the sensors with a bias drawn on every channel (``sd`` in m/s^2)."""
    a, b, c, d = (sd * rng.standard_normal(4)).tolist()
    return replace(spec, bias=(a, b, c, d))


def low_pass(values: Reals, step: float, bandwidth: float) -> Reals:
    """Pass evenly spaced values through a first-order low-pass, exact for cubics between them.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Input, at rest before its first value.
    step : float
        Spacing, s.
    bandwidth : float
        Corner, Hz.

    Returns
    -------
    ndarray, shape (n,)
        y' = a (u - y) with a = 2 pi bandwidth, at the same times.
    """
    if math.isinf(bandwidth):
        return values
    decay = 2.0 * math.pi * bandwidth * step
    nodes, weights = np.polynomial.legendre.leggauss(16)
    r = 0.5 * (nodes + 1.0)
    kernel = 0.5 * weights * decay * np.exp(-decay * (1.0 - r))
    taps = np.array(
        [
            kernel @ (-r * (r - 1.0) * (r - 2.0) / 6.0),
            kernel @ ((r + 1.0) * (r - 1.0) * (r - 2.0) / 2.0),
            kernel @ (-(r + 1.0) * r * (r - 2.0) / 2.0),
            kernel @ ((r + 1.0) * r * (r - 1.0) / 6.0),
        ]
    )
    padded = np.concatenate([values[:1], values, values[-1:]])
    driven = np.convolve(padded, taps[::-1], mode="valid")  # entry k carries step k to k + 1
    filtered = np.empty_like(values)
    filtered[0] = values[0]
    hold = math.exp(-decay)
    filtered[1:] = lfilter([1.0], [1.0, -hold], driven, zi=np.array([hold * values[0]]))[0]
    return filtered


def sense(
    motion: Motion,
    spec: SensorSpec,
    wheelbase: float,
    rate: float,
    seconds: float,
    seed: np.random.SeedSequence,
) -> Reading:
    """Sample a motion as the sensors and boards would.

    Every kind of chance, and the noise of every channel, has a stream of its own: switching one
    off leaves the others alone, and a longer record begins like a shorter one.
    """
    jitter, drops, *noise = (np.random.default_rng(child) for child in seed.spawn(6))
    rows = round(rate * seconds)
    time = np.arange(rows) / rate
    uneven = np.clip(jitter.standard_normal((2, rows)), -3.0, 3.0)
    time = time + spec.jitter * uneven[0]
    if rows and spec.jitter > 0.0:
        time = np.maximum.accumulate(np.maximum(time, 0.0)) + 1e-9 * np.arange(rows)
    kept = _kept(rows, spec, drops)
    filtered = _filtered(motion, spec, wheelbase)
    clean = np.empty((4, rows))
    readings = np.empty((4, rows))
    for j in range(4):
        board = j // 2
        instants = time * (1.0 + 1e-6 * spec.clock_ppm[board]) + spec.clock_offset[board]
        instants = instants + spec.hidden_jitter * uneven[1] + spec.delay[j]
        clean[j] = lagrange(filtered[j : j + 1], (instants - motion.t_start) / motion.step)[0]
        readings[j] = spec.gain[j] * clean[j] + spec.bias[j] + spec.drift[j] * instants
        readings[j] += spec.noise[j] * _noise(noise[j].standard_normal(rows), instants, spec, j)
    time, clean, readings = time[kept], clean[:, kept], readings[:, kept]
    if spec.adc is None:
        return Reading(time, readings, clean, None, np.zeros(readings.shape, dtype=np.bool_))
    zero = np.array(spec.adc.zero)[:, None]
    scale = np.array(spec.adc.scale)[:, None]
    counts = np.clip(np.rint(readings / scale + zero), 0, spec.adc.top).astype(np.int64)
    clipped = (counts == 0) | (counts == spec.adc.top)
    return Reading(time, (counts - zero) * scale, clean, counts, clipped)


def _filtered(motion: Motion, spec: SensorSpec, wheelbase: float) -> Reals:
    """Put all four true accelerations through their filters, on the internal grid."""
    true = motion.acceleration
    pitch = (true[1] - true[3]) / wheelbase
    front, rear = spec.chassis_offset
    mounted = (true[0], true[1] + front * pitch, true[2], true[3] + rear * pitch)
    pairs = zip(mounted, spec.bandwidth, strict=True)
    return np.stack([low_pass(row, motion.step, bandwidth) for row, bandwidth in pairs])


def _noise(unit: Reals, instants: Reals, spec: SensorSpec, channel: int) -> Reals:
    """Give unit noise the memory of the channel's filter, exactly, at any instants."""
    bandwidth = spec.bandwidth[channel]
    if spec.noise_kind == "white" or math.isinf(bandwidth) or len(unit) < 2:
        return unit
    keep = np.exp(-2.0 * math.pi * bandwidth * np.abs(np.diff(instants)))
    fresh = np.sqrt(1.0 - keep**2) * unit[1:]
    if np.ptp(keep) < 1e-12:
        start = np.array([keep[0] * unit[0]])
        later = lfilter([1.0], [1.0, -keep[0]], fresh, zi=start)[0]
        return np.concatenate([unit[:1], later])
    coloured = unit.copy()
    for k in range(len(keep)):
        coloured[k + 1] = keep[k] * coloured[k] + fresh[k]
    return coloured


def _kept(rows: int, spec: SensorSpec, rng: np.random.Generator) -> npt.NDArray[np.bool_]:
    """Choose the rows that arrive; the first always does, or the time of the run would shift."""
    lost = rng.random(rows) < spec.dropped / spec.burst
    gone = lost.copy()
    for later in range(1, spec.burst):
        gone[later:] |= lost[:-later]
    gone[:1] = False
    return ~gone
