"""Things that go wrong and are not in the list: they have a signature, and get no name.

A slack model that allows anything finds only what is large.  What is known to go wrong with cars
and their sensors has a direction, and a test along a direction finds a hundred times less: a damper
in a rubber mount, play, hysteresis, a damper that depends on travel or grows with the square of its
speed, a mass on a spring, a bracket that rings, a sensor that sits elsewhere or whose clock runs.
Each is worked out along the motion that the model found.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import cont2discrete, lfilter

from bayes_asv.diagnosis.denoised_model import DenoisedModel
from bayes_asv.domain.channels import CHANNELS
from bayes_asv.filters.kalman import MISSING, ORDER
from bayes_asv.posterior.fitted_model import Dataset
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.posterior.likelihood import Perturbation, Posterior, shared_work
from bayes_asv.preprocessing.timeline import PreparedRecording
from bayes_asv.preprocessing.wheel_spline import WheelSignal, moments
from bayes_asv.preprocessing.wiener_filter import clear_wheel, denoised, sample_noise

__all__ = ["decoy_rows"]

Array = NDArray[np.float64]
Force = Callable[[Array, Array, Array], Array]
"""From time (s), deflection (m) and its rate (m/s) to a force on the chassis (N), all (E,)."""

_LAGS = (0.001, 0.004, 0.015)  # s, c/k of a damper's mount
_PLAY = (0.05, 0.2, 0.5)  # shares of the rms deflection
_YIELD = (0.05, 0.2, 0.6)  # the same, over which hysteresis turns
_SEATS = (2.5, 3.0, 3.5, 4.2, 5.0, 6.0)  # Hz, as far apart as a seat's resonance is wide
_SEATED = {"the front": (1.0, 0.0), "the middle": (0.5, 0.5), "the rear": (0.0, 1.0)}  # share
# Hz.  A bracket stiff enough to ring above what the car excites still reads high by f²/f₀²; rings
# that end at 70 Hz left one at 187 Hz to be called a lag and a bandwidth.
_RINGS = (15.0, 21.0, 30.0, 42.0, 60.0, 85.0, 120.0, 170.0, 240.0)
_FINER = 4  # steps of a system to one of its signal
_SMALL = 0.01  # of the damper's rms force, and of a channel's rms


class _Change(NamedTuple):
    """What a decoy changes in one run, of any size.

    Parameters
    ----------
    words : str
        What it is.
    nudge : Perturbation
        The change.
    power, reference : float
        Its mean square, and that of what it is to be a small share of.
    """

    words: str
    nudge: Perturbation
    power: float
    reference: float


class _Motion(NamedTuple):
    """How a car moves in one run.

    Parameters
    ----------
    calm : (E, 2) array
        What the chassis sensors would read without noise, m/s².
    delta, rate : (E, 2) arrays
        Deflections (m) and their rates (m/s) as the car has them, ahead of the sensors' filter.
    """

    calm: Array
    delta: Array
    rate: Array


def decoy_rows(quiet: DenoisedModel) -> tuple[Array, tuple[str, ...]]:
    """Signatures (K, N) of what has no name, with a few words on each.

    Parameters
    ----------
    quiet : DenoisedModel
        A model at its mode.
    """
    where, target, z = quiet.where, quiet.stands[0].target, quiet.stage.mode.z
    runs = range(len(where.lines))
    motions = [_motion(where, target, z, run) for run in runs]
    travel = np.sqrt(np.mean([m.delta.var(axis=0) for m in motions], axis=0))
    speed = np.sqrt(np.mean([m.rate.var(axis=0) for m in motions], axis=0))
    car = target.space.cars(z[None])[0]

    def of_run(run: int) -> list[_Change]:
        return list(_changes(where, run, motions[run], car, travel, speed))

    def one(k: int) -> Array:
        # The same thing is in all runs, as strong in each as the motion there makes it.
        power = sum(there[k].power for there in changes)
        size = _SMALL * math.sqrt(sum(there[k].reference for there in changes))
        factor = size / math.sqrt(max(power, 1e-24))
        nudges = [Perturbation(*(factor * part for part in there[k].nudge)) for there in changes]
        return quiet.joined({run: quiet.stands[run].nudged(nudges[run]) for run in runs})

    with shared_work(target) as shared:
        assert shared.pool is not None
        changes = list(shared.pool.map(of_run, runs))
        words = tuple(change.words for change in changes[0])
        rows = np.array(list(shared.pool.map(one, range(len(words)))))
    return rows, words


def _motion(where: Dataset, target: Posterior, z: Array, run: int) -> _Motion:
    # From the readings themselves, or from states that follow them, a change would share their
    # noise: it follows from a simulation.
    line = where.lines[run]
    calm, states, _ = free_run(target, z, run)
    time = line.instants - line.instants[0]
    pole = target.patterns[run].pole
    delta, rate = states[:, [0, 2]], states[:, [1, 3]]
    faster = np.empty_like(rate)
    for axle in range(2):
        noise = sample_noise(line, 2 * axle)
        faster[:, axle] = denoised(time, CubicSpline(time, rate[:, axle])(time, 1), noise, None)
    return _Motion(calm, delta + rate / pole, rate + faster / pole)


def _changes(
    where: Dataset, run: int, motion: _Motion, car: Array, travel: Array, speed: Array
) -> Iterator[_Change]:
    """Every decoy of one run; ``travel`` and ``speed`` (2,) are rms values over all runs."""
    line = where.lines[run]
    nothing = Perturbation(
        np.zeros_like(line.moments), np.zeros_like(line.reading), np.zeros_like(line.reading)
    )
    time = line.instants - line.instants[0]
    for axle, name in enumerate(("front", "rear")):
        delta, rate = motion.delta[:, axle], motion.rate[:, axle]
        of_damper = float(car[axle] ** 2 * rate.var())
        for words, law in _laws(float(travel[axle]), float(speed[axle])):
            force = np.zeros_like(line.reading)
            force[:, axle] = law(time, delta, rate)
            power = float(force[:, axle].var())
            yield _Change(f"{words} at the {name}", nothing._replace(force=force), power, of_damper)
    for frequency in _SEATS:
        for place, share in _SEATED.items():
            moved = _oscillator(time, motion.calm @ np.array(share), frequency, 0.2)
            force = np.outer(moved, share)
            of_damper = float(car[0] ** 2 * motion.rate[:, 0].var())
            yield _Change(
                f"a mass on a spring near {place}",
                nothing._replace(force=force),
                float(moved.var()),
                of_damper,
            )
    for c, channel in enumerate(CHANNELS):
        for words, change in _sensor(line, motion.calm, c):
            corner = where.vehicle.sensor(channel).bandwidth
            nudge, power, reference = _put(nothing, line, motion.calm, c, change, corner)
            yield _Change(f"{words} ({channel.replace('_', ' ')})", nudge, power, reference)


def _laws(travel: float, speed: float) -> Iterator[tuple[str, Force]]:
    """Force laws that have no name, for an axle's rms deflection and rms rate."""
    for lag in _LAGS:
        yield "a damper in a soft mount", partial(_in_a_mount, lag)
    for share in _PLAY:
        yield "play", partial(_with_play, share * travel)
    for share in _YIELD:
        yield "hysteresis", partial(_hysteresis, share * travel)
    yield "a damper that depends on travel", lambda t, d, v: -v * d**2
    yield "a damper that depends on travel", lambda t, d, v: -v * d
    yield "a damper that stiffens with speed", lambda t, d, v: -v * np.abs(v)
    yield "a damper that stiffens with speed", lambda t, d, v: -(v**3)
    yield "a spring that is not symmetric", lambda t, d, v: -(d**2)
    yield "a spring that is not symmetric", lambda t, d, v: -d * np.abs(d)


def _through(time: Array, signal: Array, system: tuple[list[float], list[float]]) -> Array:
    """Signal behind a linear system that was at rest, between its samples a spline.

    A straight line between samples would be half a step late to what follows its slope.
    """
    even = np.linspace(time[0], time[-1], _FINER * len(time))
    top, bottom = (np.array(part, np.float64) for part in system)
    numerator, denominator, _ = cont2discrete((top, bottom), even[1] - even[0], "foh")
    first = float(signal[0])
    steady = first * system[0][-1] / system[1][-1]
    moved = CubicSpline(time, signal - first)(even)
    out = steady + lfilter(np.ravel(numerator), denominator, moved)
    return np.interp(time, even, out)


def _slow(time: Array, signal: Array, lag: float) -> Array:
    """Signal behind a first-order lag."""
    return _through(time, signal, ([1.0], [lag, 1.0]))


def _in_a_mount(lag: float, time: Array, delta: Array, rate: Array) -> Array:
    """Return what a damper in series with a spring does less than without."""
    return rate - _slow(time, rate, lag)


def _with_play(gap: float, time: Array, delta: Array, rate: Array) -> Array:
    """Return what a damper with play does less: its end waits until the play is used up."""
    end = float(delta[0])
    out = np.zeros_like(rate)
    for k in range(len(delta)):
        if delta[k] > end + gap:
            end, out[k] = float(delta[k]) - gap, rate[k]
        elif delta[k] < end - gap:
            end, out[k] = float(delta[k]) + gap, rate[k]
    return np.asarray(rate - out)


def _hysteresis(travel: float, time: Array, delta: Array, rate: Array) -> Array:
    """Friction that yields over a travel: an elastic-plastic element of unit force."""
    out = np.zeros_like(delta)
    for k in range(1, len(delta)):
        out[k] = np.clip(out[k - 1] - (delta[k] - delta[k - 1]) / travel, -1.0, 1.0)
    return out


def _oscillator(time: Array, base: Array, frequency: float, damping: float) -> Array:
    """Force of a unit mass on a spring and damper that stands on a moving base."""
    w = 2.0 * np.pi * frequency
    # mass that moves with the base: −a; relative motion adds what the spring passes late
    return _through(time, base, ([1.0, 0.0, 0.0], [1.0, 2.0 * damping * w, w**2]))


def _sensor(
    line: PreparedRecording, calm: Array, c: int
) -> Iterator[tuple[str, Callable[[Array, Array], Array]]]:
    """Yield changes of one channel as functions of its times and samples."""
    for frequency in _RINGS:
        w = 2.0 * np.pi * frequency

        def ringing(time: Array, signal: Array, w: float = w) -> Array:
            return _through(time, signal, ([1.0, 0.0, 0.0], [1.0, 0.06 * w, w**2]))

        yield f"a mounting that rings near {frequency:.0f} Hz", ringing

    def running(time: Array, signal: Array) -> Array:
        return np.asarray((time - time[0]) * CubicSpline(time, signal)(time, 1))

    yield "a clock that runs", running
    yield "a scale that bends", lambda time, signal: signal**2
    yield "a scale that bends", lambda time, signal: signal**3
    if c % 2 == 1:
        axle = 1 if c == 1 else 0  # the other chassis channel

        def placed(time: Array, signal: Array) -> Array:
            other = np.interp(time, line.instants, calm[:, axle])
            return np.asarray(signal - other)

        yield "a sensor that sits elsewhere", placed


def _put(
    nothing: Perturbation,
    line: PreparedRecording,
    calm: Array,
    c: int,
    change: Callable[[Array, Array], Array],
    corner: float | None,
) -> tuple[Perturbation, float, float]:
    """Change a channel by something that follows from its own samples: the change, and powers."""
    axle = c // 2
    if c % 2 == 0:
        knots, own = clear_wheel(line, axle, corner)
        value = change(knots, own)
        signal = WheelSignal(CubicSpline(knots, value), knots, line.wheels[axle].deviation)
        driven = np.zeros_like(line.moments)
        driven[:, axle] = moments(signal, line.instants, ORDER)
        return nothing._replace(moments=driven), float(value.var()), float(own.var())
    there = line.kind[:, axle] != MISSING
    signal = calm[there, axle]
    value = change(line.instants[there], signal)
    reading = np.zeros_like(line.reading)
    reading[there, axle] = value
    return nothing._replace(reading=reading), float(value.var()), float(signal.var())
