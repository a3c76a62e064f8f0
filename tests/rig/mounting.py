"""What stands between a true acceleration and its sensor: brackets, panels, one-sided roads, hum.

A mounting takes the true motion of the half car and gives the accelerations that the four
sensors are carried along with.  Nothing here acts back on the car: brackets and panels are light,
and the roll of a car that is alike on both sides moves neither its heave nor its pitch.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from .compiled import compiled
from .motion import Motion

__all__ = [
    "Bracket",
    "Compressed",
    "Mounting",
    "OneSided",
    "Panel",
    "SensorTone",
    "oscillate",
    "transfer_coordinates",
]

Reals = npt.NDArray[np.float64]


class Mounting(Protocol):
    """Anything that moves a sensor differently from the point it should measure."""

    def carry(self, acceleration: Reals, time: Reals) -> Reals:
        """Return accelerations (4, n) of the sensors, from those (4, n) of their points, m/s^2."""
        ...


def transfer_coordinates(motion: Motion, mountings: Sequence[Mounting]) -> Reals:
    """Return accelerations (4, n) at the sensors, one mounting after the other, m/s^2."""
    acceleration = motion.acceleration
    for mounting in mountings:
        acceleration = mounting.carry(acceleration, motion.time)
    return acceleration


@compiled
def oscillate(base: Reals, step: float, omega: float, zeta: float) -> tuple[Reals, Reals]:
    """Relative motion w of a mass on a spring: w'' + 2 zeta omega w' + omega^2 w = -base.

    Classical Runge-Kutta from rest, ``base`` straight between its samples (m/s^2).
    Returns w (m) and w' (m/s) at the samples.
    """
    n = len(base)
    w, v = np.zeros(n), np.zeros(n)
    for k in range(n - 1):
        a0, a1 = base[k], base[k + 1]
        am = 0.5 * (a0 + a1)
        w0, v0 = w[k], v[k]
        f0 = -a0 - 2.0 * zeta * omega * v0 - omega * omega * w0
        w1, v1 = w0 + 0.5 * step * v0, v0 + 0.5 * step * f0
        f1 = -am - 2.0 * zeta * omega * v1 - omega * omega * w1
        w2, v2 = w0 + 0.5 * step * v1, v0 + 0.5 * step * f1
        f2 = -am - 2.0 * zeta * omega * v2 - omega * omega * w2
        w3, v3 = w0 + step * v2, v0 + step * f2
        f3 = -a1 - 2.0 * zeta * omega * v3 - omega * omega * w3
        w[k + 1] = w0 + step / 6.0 * (v0 + 2.0 * v1 + 2.0 * v2 + v3)
        v[k + 1] = v0 + step / 6.0 * (f0 + 2.0 * f1 + 2.0 * f2 + f3)
    return w, v


@dataclass(frozen=True)
class Bracket:
    """A sensor on an elastic bracket, which rings above the car's own motion.

    Attributes
    ----------
    channel : int
        Index in ``sensors.CHANNELS``.
    frequency : float
        Of the bracket with the sensor on it, Hz.
    zeta : float
        Damping ratio; sheet metal has 0.01 to 0.05.
    """

    channel: int
    frequency: float
    zeta: float = 0.03

    def carry(self, acceleration: Reals, time: Reals) -> Reals:
        """Return accelerations (4, n) of the sensors, m/s^2: base plus relative motion."""
        omega = 2.0 * math.pi * self.frequency
        out = acceleration.copy()
        w, v = oscillate(acceleration[self.channel], _step(time), omega, self.zeta)
        out[self.channel] = -2.0 * self.zeta * omega * v - omega * omega * w
        return out


@dataclass(frozen=True)
class Panel:
    """A sensor on a panel of the body, whose first mode adds to the body's own motion.

    Attributes
    ----------
    channel : int
        Index in ``sensors.CHANNELS``.
    frequency : float
        Of the panel, Hz.
    share : float
        How strongly the mode is driven and seen there: participation times mode shape.
    zeta : float
        Damping ratio.
    """

    channel: int
    frequency: float
    share: float
    zeta: float = 0.04

    def carry(self, acceleration: Reals, time: Reals) -> Reals:
        """Return accelerations (4, n) of the sensors, m/s^2."""
        omega = 2.0 * math.pi * self.frequency
        base = acceleration[self.channel]
        w, v = oscillate(base, _step(time), omega, self.zeta)
        out = acceleration.copy()
        out[self.channel] += self.share * (-base - 2.0 * self.zeta * omega * v - omega * omega * w)
        return out


@dataclass(frozen=True)
class OneSided:
    """A kerb, a stone or a pothole on the side of the sensors, and the car rolls.

    The wheels of one side are lifted by z(t) more than the mean of both, with the chassis rolling
    on springs and dampers of its own: r'' + 2 zeta omega r' + omega^2 r = omega^2 z + 2 zeta
    omega z', r being the rise of the chassis on that side.

    Attributes
    ----------
    lift : float
        Height of the obstacle over the mean of both sides, m.
    start, duration : float
        When the front wheel meets it and how long it is on it, s.
    behind : float
        Time by which the rear follows, s.
    frequency, zeta : float
        Of the roll, Hz, and its damping ratio.
    """

    lift: float
    start: float
    duration: float
    behind: float
    frequency: float = 1.9
    zeta: float = 0.35

    def carry(self, acceleration: Reals, time: Reals) -> Reals:
        """Return accelerations (4, n) of the sensors on that side, m/s^2."""
        omega = 2.0 * math.pi * self.frequency
        out = acceleration.copy()
        front, rear = self._rise(time), self._rise(time - self.behind)
        out[0] += front
        out[2] += rear
        mean = 0.5 * (front + rear)
        w, v = oscillate(mean, _step(time), omega, self.zeta)
        roll = -2.0 * self.zeta * omega * v - omega * omega * w
        out[1] += roll
        out[3] += roll
        return out

    def _rise(self, time: Reals) -> Reals:
        """Acceleration of a haversine-like rise that is smooth to its third derivative, m/s^2."""
        r = (time - self.start) / self.duration
        inside = (r > 0.0) & (r < 1.0)
        # z = lift sin^4(pi r): jerk is continuous at both ends
        turn = np.pi * r
        second = 4.0 * np.sin(turn) ** 2 * (3.0 * np.cos(turn) ** 2 - np.sin(turn) ** 2)
        return np.where(inside, self.lift * (np.pi / self.duration) ** 2 * second, 0.0)


@dataclass(frozen=True)
class Compressed:
    """A sensor that reads less and less of more and more: limit tanh(a/limit).

    Attributes
    ----------
    channel : int
        Index in ``sensors.CHANNELS``.
    limit : float
        What it never reads beyond, m/s^2.
    """

    channel: int
    limit: float

    def carry(self, acceleration: Reals, time: Reals) -> Reals:
        """Return accelerations (4, n) as the sensors feel them, m/s^2."""
        out = acceleration.copy()
        out[self.channel] = self.limit * np.tanh(out[self.channel] / self.limit)
        return out


@dataclass(frozen=True)
class SensorTone:
    """A sensor that is shaken by itself: a fan, a loose cable, an engine's bracket.

    Attributes
    ----------
    channel : int
        Index in ``sensors.CHANNELS``.
    frequency, amplitude : float
        Hz and m/s^2.
    wander : float
        Relative rms of slow wandering of the frequency.
    seed : int
        Of phase and wandering.
    """

    channel: int
    frequency: float
    amplitude: float
    wander: float = 0.005
    seed: int = 0

    def carry(self, acceleration: Reals, time: Reals) -> Reals:
        """Return accelerations (4, n) of the sensors, m/s^2."""
        rng = np.random.default_rng(self.seed)
        rate, phase, slow = rng.uniform(0.3, 1.2), *rng.uniform(0.0, 2.0 * np.pi, size=2)
        swing = self.wander * math.sqrt(2.0) * self.frequency / rate
        turn = 2.0 * np.pi * self.frequency * time
        turn = turn + phase + swing * np.sin(2.0 * np.pi * rate * time + slow)
        out = acceleration.copy()
        out[self.channel] += self.amplitude * np.sin(turn)
        return out


def _step(time: Reals) -> float:
    return float((time[-1] - time[0]) / (len(time) - 1))
