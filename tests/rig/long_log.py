"""An hour of driving: bumps far apart, and between them all that tells nothing about a damper.

The log is driven piece by piece; every piece begins and ends at rest on level ground, so that the
pieces join without a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from .car import RigCar
from .forces import ChassisForce, Push
from .run import drive
from .sensors import SensorSpec
from .terrain import ISO_8608, Feature, Haversine, Rough, Terrain
from .units import INCH, STANDARD_GRAVITY

__all__ = ["Drop", "LongLog", "Part", "Stretch", "hour", "long_log"]

Reals = npt.NDArray[np.float64]
Kind = Literal["standing", "cruising", "bump", "rough", "braking", "cornering", "jump"]

_RATE: Final = 4000.0  # internal steps a second: wheel hop is at 8 Hz
_CRUISE: Final = 8.0  # m/s
_SLOW: Final = 4.5  # m/s, over bumps
_FAST: Final = 9.0  # m/s, over the edge of a table


@dataclass(frozen=True)
class Stretch:
    """A feature that fades out over ``fade`` m at the end of ``length`` m."""

    feature: Feature
    length: float
    fade: float = 4.0

    def height(self, x: Reals) -> Reals:
        """Return heights (m) at places ``x`` (m)."""
        left = np.clip((self.length - x) / self.fade, 0.0, 1.0)
        return self.feature.height(x) * left * left * (3.0 - 2.0 * left)


@dataclass(frozen=True)
class Drop:
    """A table ``rise`` m high: a smooth ramp up over ``ramp`` m, then an edge."""

    rise: float
    ramp: float

    def height(self, x: Reals) -> Reals:
        """Return heights (m) at places ``x`` (m)."""
        r = np.clip(x / self.ramp, 0.0, 1.0)
        return np.where(x < self.ramp, self.rise * r * r * (3.0 - 2.0 * r), 0.0)


@dataclass(frozen=True)
class Part:
    """What happens for a while: its kind, duration (s), and size.

    The size is the rise of a bump or a table (m), the letter of a road by number (0 is A, a
    fraction is between), or the share of gravity at which the car brakes or corners.
    """

    kind: Kind
    seconds: float
    size: float = 0.0


@dataclass(frozen=True)
class LongLog:
    """Stamps (N,) in s, readings (4, N) in m/s², and the begin and end (s) of every part."""

    time: Reals
    channels: Reals
    parts: tuple[tuple[Part, float, float], ...]

    def of(self, kind: Kind) -> list[tuple[float, float]]:
        """Begin and end (s) of the parts of one kind."""
        return [(begin, end) for part, begin, end in self.parts if part.kind == kind]


def long_log(
    car: RigCar, parts: Sequence[Part], rate: float, sensors: SensorSpec, seed: int
) -> LongLog:
    """Drive parts one after the other.

    Parameters
    ----------
    car, sensors : RigCar, SensorSpec
        Truth.
    parts : sequence of Part
        In order of time; cruising lies under everything but standing.
    rate : float
        Rows a second.
    seed : int
        Of the noise, and of the roads.

    Returns
    -------
    LongLog
    """
    rows, ends, at = [], [], 0.0
    for k, part in enumerate(parts):
        n = round(part.seconds * rate)
        terrain, speed, forces = _of(part, car, seed + k)
        run = drive(
            car, terrain, speed, rate, n / rate, sensors, seed + 100_000 + k, forces=forces,
            internal_rate=_RATE,
        )  # fmt: skip
        readings = run.channels
        if part.kind == "cornering":
            readings = readings + _leaning(run.time, part, sensors)
        rows.append(readings)
        ends.append((part, at, at + n / rate))
        at += n / rate
    channels = np.concatenate(rows, axis=1)
    return LongLog(np.arange(channels.shape[1]) / rate, channels, tuple(ends))


def hour(minutes: float, bumps: int, seed: int) -> list[Part]:
    """Return the parts of a drive: bumps at random times, and all else between them."""
    rng = np.random.default_rng(seed)
    others: list[Part] = [
        Part("standing", 20.0), Part("braking", 8.0, 0.5), Part("cornering", 9.0, 0.6),
        Part("jump", 6.0, 0.5), Part("rough", 15.0, 3.0),
    ]  # fmt: skip
    some = [others[k % len(others)] for k in range(max(bumps // 2, len(others)))]
    some += [Part("bump", 5.0, rise) for rise in (1.5 + 2.0 * rng.random(bumps)) * INCH]
    order = rng.permutation(len(some))
    left = 60.0 * minutes - sum(part.seconds for part in some)
    share = rng.dirichlet(np.full(len(some) + 1, 4.0)) * left
    parts = [Part("standing", 0.3 * share[0]), Part("cruising", 0.7 * share[0])]
    for k, seconds in zip(order, share[1:], strict=True):
        parts += [some[k], Part("cruising", seconds)]
    return [replace(part, seconds=round(part.seconds, 1)) for part in parts]


def _of(part: Part, car: RigCar, seed: int) -> tuple[Terrain, float, list[ChassisForce]]:
    """Terrain, speed and outside forces of a part."""
    if part.kind == "standing":
        return Terrain("flat"), 0.0, []
    speed = {"bump": _SLOW, "rough": _SLOW, "jump": _FAST}.get(part.kind, _CRUISE)
    lead = 0.4
    ahead = max(part.seconds - lead - 2.0, 0.5) * speed - car.l
    density = ISO_8608["A"] * 4.0 ** (part.size if part.kind == "rough" else -0.5)
    road = Stretch(Rough(density, seed), ahead, min(4.0, 0.3 * ahead))
    features: list[tuple[float, Feature]] = [(0.0, road)]
    forces: list[ChassisForce] = []
    if part.kind == "bump":
        features.append((speed * 0.6, Haversine(part.size, 1.5)))
    elif part.kind == "jump":
        features.append((speed * 0.6, Drop(part.size, 6.0)))
    elif part.kind == "braking":  # m a h / l, down at the front and up at the rear
        transfer = part.size * STANDARD_GRAVITY * car.m * 0.5 / car.l
        begin, length = 1.0, part.seconds - 4.0
        forces = [
            Push(-transfer, begin, length, "front", rise=0.4),
            Push(transfer, begin, length, "rear", rise=0.4),
        ]
    elif part.kind == "cornering":  # the side with the sensors goes down
        transfer = part.size * STANDARD_GRAVITY * car.m * 0.25
        forces = [Push(-transfer, 1.0, part.seconds - 4.0, "both", rise=0.6)]
    return Terrain(part.kind, tuple(features), lead), speed, forces


def _leaning(time: Reals, part: Part, sensors: SensorSpec) -> Reals:
    """Lateral acceleration that a leaning body's sensors read (4, n), in steps of the converter."""
    r = np.clip(np.minimum(time - 0.7, part.seconds - 2.7 - time) / 0.6, 0.0, 1.0)
    lean = 0.06 * part.size * STANDARD_GRAVITY * r * r * (3.0 - 2.0 * r)
    step = np.array(sensors.adc.scale if sensors.adc is not None else (1e-9,) * 4)[:, None]
    return np.asarray(np.rint(np.array([[0.0], [-1.0], [0.0], [-1.0]]) * lean / step) * step)
