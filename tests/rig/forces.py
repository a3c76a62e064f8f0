"""Outside forces on the chassis: an engine that shakes the frame, pushes, any function of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

__all__ = ["ChassisForce", "Engine", "ForceFunction", "Push"]

Reals = npt.NDArray[np.float64]


class ChassisForce(Protocol):
    """Anything that pushes the chassis at its axle lines."""

    def at(self, t: Reals) -> tuple[Reals, Reals]:
        """Return upward forces (N) at the front and rear axle line at times ``t`` (s)."""
        ...


@dataclass(frozen=True)
class Engine:
    """A single-cylinder engine bolted to the frame.

    The speed wanders by a few slow sine waves, whose phase is integrated exactly.

    Attributes
    ----------
    frequency : float
        Mean crankshaft frequency, Hz.
    amplitude : float
        First-order force, N.
    harmonics : tuple of (order, share)
        Force of every order as a share of ``amplitude``; 0.5 is the firing of a four-stroke.
    front_share : float
        Share of the force that comes in at the front axle line; the engine sits at the rear.
    wander : float
        Relative rms of the slow wandering of the frequency.
    seed : int
        Of the wandering and the phases.
    """

    frequency: float = 32.0
    amplitude: float = 120.0
    harmonics: tuple[tuple[float, float], ...] = ((0.5, 0.25), (1.0, 1.0), (2.0, 0.35), (3.0, 0.1))
    front_share: float = 0.2
    wander: float = 0.02
    seed: int = 0

    def at(self, t: Reals) -> tuple[Reals, Reals]:
        """Return upward forces (N) at the front and rear axle line at times ``t`` (s)."""
        rng = np.random.default_rng(self.seed)
        slow = rng.uniform(0.15, 1.5, size=4)
        offsets = rng.uniform(0.0, 2.0 * np.pi, size=4)
        turns = self.frequency * t
        depth = self.wander * np.sqrt(2.0 / len(slow)) * self.frequency
        for rate, offset in zip(slow, offsets, strict=True):
            turns = turns + depth * np.sin(2.0 * np.pi * rate * t + offset) / (2.0 * np.pi * rate)
        force = np.zeros_like(t)
        for order, share in self.harmonics:
            phase = rng.uniform(0.0, 2.0 * np.pi)
            force += self.amplitude * share * np.sin(2.0 * np.pi * order * turns + phase)
        return self.front_share * force, (1.0 - self.front_share) * force


@dataclass(frozen=True)
class Push:
    """A steady force for a while, coming and going smoothly.

    Attributes
    ----------
    force : float
        Upward, N.
    start, duration : float
        When half the force is reached, and how long until half is gone, s.
    where : {'front', 'rear', 'both'}
        Axle line; 'both' gives each half.
    rise : float
        Time of coming and going, s.
    """

    force: float
    start: float
    duration: float
    where: Literal["front", "rear", "both"] = "both"
    rise: float = 0.02

    def at(self, t: Reals) -> tuple[Reals, Reals]:
        """Return upward forces (N) at the front and rear axle line at times ``t`` (s)."""
        up = _smooth_step((t - self.start) / self.rise + 0.5)
        down = _smooth_step((t - self.start - self.duration) / self.rise + 0.5)
        force = self.force * (up - down)
        front = {"front": 1.0, "rear": 0.0, "both": 0.5}[self.where]
        return front * force, (1.0 - front) * force


@dataclass(frozen=True)
class ForceFunction:
    """Any functions of time; each takes an array of times (s) and returns forces (N)."""

    front: Callable[[Reals], Reals] | None = None
    rear: Callable[[Reals], Reals] | None = None

    def at(self, t: Reals) -> tuple[Reals, Reals]:
        """Return upward forces (N) at the front and rear axle line at times ``t`` (s)."""
        zero = np.zeros_like(t)
        return (
            zero if self.front is None else self.front(t),
            zero if self.rear is None else self.rear(t),
        )


def _smooth_step(r: Reals) -> Reals:
    """Rise from 0 to 1 over 0..1 with two continuous derivatives."""
    r = np.clip(r, 0.0, 1.0)
    return r * r * r * (10.0 - 15.0 * r + 6.0 * r * r)
