"""How strongly, and how fast, an engine shakes the frame.

What the chassis do in the band of a tone, beyond a simulation from the wheels, is a force times the
car's response there, and noise.  The force acts at the front axle, at the rear, or on both alike;
where it explains most is taken.  Noise is what the bands on either side hold, so that a tone that
hardly stands out of it is no larger for it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import hilbert, sosfiltfilt
from scipy.stats import t

from bayes_asv.filters.kalman import VALUE
from bayes_asv.models.half_car import HalfCar
from bayes_asv.posterior.fitted_model import Dataset, FittedModel
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.preprocessing.tone_removal import Notch, passing

__all__ = ["Measured", "shaking"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_PLACES = np.array([[1.0, 0.0], [0.0, 1.0], [0.5, 0.5]])
# Half-widths of its notch in which a tone is measured (in one, what wanders out of it made forces
# of 4 to 15 N come out 2 to 9 % low), and from there to the middle of bands beside it; of those
# that hold no other tone the nearest on each side is taken.
_WIDE, _ASIDE = 2.0, (4.5, 6.5, 8.5)
_NEXT_TO_NOTHING = 1e-12  # m²/s⁴, of noise in any case
_LOWEST = 3.0  # Hz, of such a band: below it the car moves
_LOST = 0.06  # of the power, deviation: what wanders out of the band
_BLOCK = 0.5  # s, of the jackknife: longer than an engine's phase remembers


class Measured(NamedTuple):
    """A value with its equal-tailed 95 % interval.

    Parameters
    ----------
    value, low, high : float
        In one unit.
    """

    value: float
    low: float
    high: float


class _Heard(NamedTuple):
    """Chassis accelerations of one run.

    Parameters
    ----------
    inside : (R, 2) complex array
        Analytic signal in the band of the tone, m/s².
    noise : (2, 2) complex array
        Covariance of noise alone there.
    rate : float
        Pairs of readings a second, Hz.
    """

    inside: Complex
    noise: Complex
    rate: float


def shaking(
    where: Dataset, stage: FittedModel, tones: Sequence[Notch]
) -> tuple[Measured, Measured]:
    """Frequency (Hz) of the strongest tone, and amplitude (N) of the net force on the chassis.

    Parameters
    ----------
    where, stage : Dataset, FittedModel
        Recordings as they are, at least one of them fast enough for it, and a model at its mode.
    tones : sequence of Notch
        The strongest first; others are no noise.

    Returns
    -------
    Measured, Measured
        Intervals by the jackknife over half seconds of all runs (Efron & Tibshirani 1993, *An
        Introduction to the Bootstrap*, ch. 11), Student's t; the speed may wander within them.
    """
    heard = list(_heard(where, stage, tones))
    responses = [_response(where, stage, tones[0].frequency, place) for place in _PLACES]
    explained = [sum(_explained(one, h) for one in heard) for h in responses]
    h = responses[int(np.argmax(explained))]
    return _jackknifed(np.concatenate([_blocks(one, h) for one in heard]), tones[0])


def _heard(where: Dataset, stage: FittedModel, tones: Sequence[Notch]) -> Iterator[_Heard]:
    tone, others = tones[0], tones[1:]
    wide = _WIDE * tone.half_width
    for run, line in enumerate(where.lines):
        rate = 1.0 / line.reading_step
        if tone.frequency >= 0.5 * rate:
            continue
        output, _, _ = free_run(stage.target, stage.mode.z, run)
        left = np.nan_to_num(
            line.paired(np.where(line.kind == VALUE, line.reading - output, np.nan))
        )
        inside = _analytic(left, Notch(tone.frequency, wide), rate)
        beside = [_analytic(left, Notch(f, wide), rate) for f in _aside(tone, others, rate)]
        noise: Complex = np.eye(2, dtype=np.complex128) * _NEXT_TO_NOTHING
        for b in beside or [inside]:  # of a band with nothing beside it nothing is sure to be tone
            noise = np.asarray(noise + (b.T @ b.conj()) / (len(b) * max(len(beside), 1)))
        yield _Heard(inside, noise, rate)


def _aside(tone: Notch, others: Sequence[Notch], rate: float) -> list[float]:
    """Middles (Hz) of the bands on either side that hold no tone."""
    wide = _WIDE * tone.half_width
    out = []
    for side in (-1.0, 1.0):
        for far in _ASIDE:
            f = tone.frequency + side * far * tone.half_width
            there = f - wide > _LOWEST and f + wide < 0.5 * rate
            if there and all(abs(f - o.frequency) > wide + o.half_width for o in others):
                out.append(f)
                break
    return out


def _analytic(signal: Array, tone: Notch, rate: float) -> Complex:
    return np.asarray(hilbert(sosfiltfilt(passing(tone, rate), signal, axis=0), axis=0))


def _response(where: Dataset, stage: FittedModel, frequency: float, place: Array) -> Complex:
    """Chassis readings (2,) over a force of one newton, its wheels as they are measured."""
    car = HalfCar(*stage.space.cars(stage.mode.z[None])[0])
    cross = 1.0 / car.m - car.l_f * car.l_r / car.i
    mobility = np.array(
        [[1.0 / car.m + car.l_f**2 / car.i, cross], [cross, 1.0 / car.m + car.l_r**2 / car.i]]
    )
    w = 2.0 * math.pi * frequency
    strut = np.diag([car.k_f + 1j * w * car.c_f, car.k_r + 1j * w * car.c_r])
    moved = np.linalg.solve(np.eye(2) - mobility @ strut / w**2, mobility @ place)
    pole = float(where.lines[0].poles[1])
    return np.asarray(moved / (1.0 + 1j * w / pole) if pole else moved)


def _weights(one: _Heard, h: Complex) -> tuple[Complex, float]:
    """Row (2,) that makes a force of two readings, and the power of its noise, N²."""
    pulled = np.linalg.solve(one.noise, h).conj()
    information = float((pulled @ h).real)
    return np.asarray(pulled / information), 1.0 / information


def _explained(one: _Heard, h: Complex) -> float:
    """Energy of a run that a force with a response explains, in units of the noise."""
    row, noise = _weights(one, h)
    return float(np.sum(np.abs(one.inside @ row) ** 2) / noise)


def _blocks(one: _Heard, h: Complex) -> Array:
    """Sum time (s), power beyond noise (N²), weight and weighted Hz over half seconds (B, 4)."""
    row, noise = _weights(one, h)
    force = one.inside @ row
    count = max(int(len(force) / (_BLOCK * one.rate)), 1)
    out = []
    for part in np.array_split(force, count):
        power = float(np.sum(np.abs(part) ** 2) - noise * len(part))
        turn = np.sum(part[1:] * part[:-1].conj())  # from one reading to the next
        hertz = float(np.angle(turn)) * one.rate / (2.0 * math.pi)
        out.append([len(part), power, abs(turn), abs(turn) * hertz])
    return np.array(out) / one.rate


def _jackknifed(blocks: Array, tone: Notch) -> tuple[Measured, Measured]:
    """Frequency and amplitude of all blocks (B, 4), with intervals."""
    whole, n = blocks.sum(axis=0), len(blocks)

    def told(sums: Array) -> Array:
        return np.stack([sums[..., 3] / sums[..., 2], sums[..., 1] / sums[..., 0]])

    value = told(whole)
    if n > 2:
        without = told(whole - blocks)
        spread = (n - 1.0) / n * np.sum((without - without.mean(axis=1)[:, None]) ** 2, axis=1)
        reach = float(t.isf(0.025, n - 1)) * np.sqrt(spread)
    else:
        reach = np.array([tone.half_width, value[1]])
    (frequency, power), (wide, uneven) = value, reach
    uneven = math.hypot(uneven, 1.96 * _LOST * power)
    force = [math.sqrt(max(p, 0.0)) for p in (power, power - uneven, power + uneven)]
    return Measured(frequency, frequency - wide, frequency + wide), Measured(*force)
