"""Unlisted faults of clocks, buffers and cables: what happens to samples on their way to a file."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .blueprint import Blueprint
from .kinds import CHANNELS, Vector
from .scene import Scene
from .sensors import Sensing

__all__ = ["LOGGING_FAULTS"]

Maker = Callable[[Scene, np.random.Generator], Blueprint]


def _channel(rng: np.random.Generator) -> str:
    return str(rng.choice(CHANNELS))


def _board(rng: np.random.Generator) -> list[str]:
    """Channels of one of the two boards, front or rear."""
    board = str(rng.choice(["front", "rear"]))
    return [c for c in CHANNELS if c.startswith(board)]


def _slipped(scene: Scene, rng: np.random.Generator) -> Blueprint:
    group, places = _board(rng), []
    for times in scene.times:
        count = int(rng.integers(2, 4))
        places.append(np.sort(rng.uniform(1.1, float(times[-1]) - 0.8, count)))

    def sensing(size: float) -> Sensing:
        def late(times: Vector, run: int) -> Vector:
            lost = np.searchsorted(places[run], times)
            return np.asarray(size * lost)

        return Sensing(late=dict.fromkeys(group, late))

    name = "unlisted:slipped_samples"
    return Blueprint(name, None, "stairs of the delay", (0.00002, 0.02), sensing=sensing)


def _jitter(scene: Scene, rng: np.random.Generator) -> Blueprint:
    group = _board(rng)
    shakes = [rng.standard_normal(len(times)) for times in scene.times]

    def sensing(size: float) -> Sensing:
        def late(times: Vector, run: int) -> Vector:
            return np.asarray(size * shakes[run])

        return Sensing(late=dict.fromkeys(group, late))

    name = "unlisted:sampling_jitter"
    return Blueprint(name, None, "random moments", (0.00003, 0.004), sensing=sensing)


def _bursts(scene: Scene, rng: np.random.Generator) -> Blueprint:
    channel, crackles = _channel(rng), []
    for times in scene.times:
        loud = np.zeros(len(times))
        for at in rng.uniform(0.3, float(times[-1]) - 0.3, int(rng.integers(3, 6))):
            loud[np.abs(times - at) < float(rng.uniform(0.03, 0.08))] = 1.0
        crackles.append(loud * rng.standard_t(4.0, len(times)))

    def sensing(size: float) -> Sensing:
        return Sensing(shift={channel: lambda times, run: size * crackles[run]})

    name = "unlisted:chafed_cable"
    return Blueprint(name, channel, "bursts of noise", (0.01, 10.0), sensing=sensing)


def _swapped(scene: Scene, rng: np.random.Generator) -> Blueprint:
    channel = _channel(rng)
    number, places = CHANNELS.index(channel), []
    for times in scene.times:
        blocks = np.arange(scene.rate, scene.rate * (float(times[-1]) - 0.6) - 8, 8)
        places.append(rng.permutation(blocks.astype(np.int64)))

    def sensing(size: float) -> Sensing:
        # size is the number of buffers of eight samples
        def rows(values: Vector, times: Vector, run: int) -> Vector:
            out = values.copy()
            for at in places[run][: int(np.ceil(size))]:
                first = int(at)
                early, late = out[first : first + 4, number], out[first + 4 : first + 8, number]
                out[first : first + 8, number] = np.concatenate([late, early])
            return out

        return Sensing(rows=rows)

    name = "unlisted:swapped_buffers"
    return Blueprint(name, channel, "halves exchanged", (0.6, 40.0), sensing=sensing)


def _echo(scene: Scene, rng: np.random.Generator) -> Blueprint:
    channel, behind = _channel(rng), float(rng.uniform(0.02, 0.07))

    def sensing(size: float) -> Sensing:
        delays, weights = np.array([0.0, behind]), np.array([1.0 - size, size])
        return Sensing(spread={channel: (delays, weights)})

    name = "unlisted:ring_buffer_echo"
    return Blueprint(name, channel, "an old sample mixed in", (0.001, 0.4), sensing=sensing)


LOGGING_FAULTS: dict[str, Maker] = {
    "slipped_samples": _slipped,
    "sampling_jitter": _jitter,
    "chafed_cable": _bursts,
    "swapped_buffers": _swapped,
    "ring_buffer_echo": _echo,
}
