"""Things that go wrong and are not in the list: they have a signature, and get no name.

A slack model that allows anything finds only what is large.  What is known to go wrong with cars
and their sensors has a direction, and a test along a direction finds a hundred times less: a damper
in a rubber mount, play, hysteresis, a damper that depends on travel or grows with the square of its
speed, a mass on a spring, a bracket that rings, a sensor that sits elsewhere or whose clock runs.
Each is worked out along the motion that the model found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import cont2discrete, lfilter

from bayes_asv.channels import CHANNELS
from bayes_asv.diagnosis.clear import Quiet
from bayes_asv.inference.denoised import clear_wheel, denoised
from bayes_asv.inference.freerun import free_run
from bayes_asv.inference.likelihood import Nudge, Target, shared_work
from bayes_asv.inference.noise_level import noise_level
from bayes_asv.inference.stage import Setting
from bayes_asv.inference.timeline import Timeline
from bayes_asv.inference.wheels import WheelSignal, moments
from bayes_asv.kernels.innovations import MISSING, ORDER

__all__ = ["decoy_rows"]

Array = NDArray[np.float64]
Force = Callable[[Array, Array, Array], Array]
"""From time (s), deflection (m) and its rate (m/s) to a force on the chassis (N), all (E,)."""

_LAGS = (0.001, 0.004, 0.015)  # s, c/k of a damper's mount
_PLAY = (0.05, 0.2, 0.5)  # shares of the rms deflection
_YIELD = (0.05, 0.2, 0.6)  # the same, over which hysteresis turns
_SEATS = (2.5, 4.0, 6.0)  # Hz
_RINGS = (15.0, 25.0, 40.0, 70.0)  # Hz
_FINER = 4  # steps of a system to one of its signal
_SMALL = 0.01  # of the damper's rms force, and of a channel's rms


def decoy_rows(quiet: Quiet) -> tuple[Array, tuple[str, ...]]:
    """Signatures (K, N) of what has no name, with a few words on each.

    Parameters
    ----------
    quiet : Quiet
        A model at its mode.
    """
    where, target, z = quiet.where, quiet.target, quiet.stage.mode.z
    runs = range(len(where.lines))
    # From the readings themselves, or from states that follow them, a change would share their
    # noise: it follows from a simulation.
    calm = [free_run(target, z, run)[:2] for run in runs]
    passes = [target.scored(z, run) for run in runs]
    nudges = [list(_nudges(where, target, z, run, *calm[run])) for run in runs]
    words = tuple(name for name, _ in nudges[0])

    def one(k: int) -> Array:
        parts = []
        for run in runs:
            nu, _, _ = target.scored(z, run, nudges[run][k][1])
            parts.append((passes[run][0] - nu)[passes[run][1] != 0.0])
        return np.concatenate(parts) * quiet.settled

    with shared_work(target) as shared:
        assert shared.pool is not None
        rows = np.array(list(shared.pool.map(one, range(len(words)))))
    return rows, words


def _nudges(
    where: Setting, target: Target, z: Array, run: int, calm: Array, states: Array
) -> Iterator[tuple[str, Nudge]]:
    """Every decoy of one run."""
    line = where.lines[run]
    car = target.space.cars(z[None])[0]
    nothing = Nudge(
        np.zeros_like(line.moments), np.zeros_like(line.reading), np.zeros_like(line.reading)
    )
    time = line.instants - line.instants[0]
    pole = target.patterns[run].pole
    for axle, name in enumerate(("front", "rear")):
        delta, rate = states[:, 2 * axle], states[:, 2 * axle + 1]
        # The car itself moves ahead of what its sensors' filter passes.
        noise = line.noise[2 * axle] or noise_level(line, 2 * axle)
        faster = denoised(time, CubicSpline(time, rate)(time, 1), noise, None)
        delta, rate = delta + rate / pole, rate + faster / pole
        level = _SMALL * car[axle] * float(rate.std())
        for words, force in _laws(float(delta.std()), float(rate.std())):
            value = force(time, delta, rate)
            size = float(np.std(value))
            if not size > 0.0:
                continue
            added = np.zeros_like(line.reading)
            added[:, axle] = level * value / size
            yield f"{words} at the {name}", nothing._replace(force=added)
    for frequency in _SEATS:
        for place, share in (("front", (1.0, 0.0)), ("rear", (0.0, 1.0))):
            moved = _oscillator(time, calm @ np.array(share), frequency, 0.2)
            added = np.outer(moved, share)
            added *= _SMALL * car[0] * float(states[:, 1].std()) / max(float(np.std(moved)), 1e-12)
            yield f"a mass on a spring near the {place}", nothing._replace(force=added)
    for c, channel in enumerate(CHANNELS):
        for words, change in _sensor(line, calm, c):
            corner = where.vehicle.sensor(channel).bandwidth
            nudge = _put(nothing, line, calm, c, change, corner)
            yield f"{words} ({channel.replace('_', ' ')})", nudge


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
    line: Timeline, calm: Array, c: int
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
    nothing: Nudge,
    line: Timeline,
    calm: Array,
    c: int,
    change: Callable[[Array, Array], Array],
    corner: float | None,
) -> Nudge:
    """Change a channel by a little of something that follows from its own samples."""
    axle = c // 2
    if c % 2 == 0:
        knots, own = clear_wheel(line, axle, corner)
        value = change(knots, own)
        value *= _SMALL * float(np.std(own)) / max(float(np.std(value)), 1e-12)
        signal = WheelSignal(CubicSpline(knots, value), knots, line.wheels[axle].deviation)
        driven = np.zeros_like(line.moments)
        driven[:, axle] = moments(signal, line.instants, ORDER)
        return nothing._replace(moments=driven)
    there = line.kind[:, axle] != MISSING
    signal = calm[there, axle]
    value = change(line.instants[there], signal)
    value *= _SMALL * float(np.std(signal)) / max(float(np.std(value)), 1e-12)
    reading = np.zeros_like(line.reading)
    reading[there, axle] = value
    return nothing._replace(reading=reading)
