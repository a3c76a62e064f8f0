"""Unlisted faults of mounts, sensors, converters, supplies and loggers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .blueprint import Blueprint
from .kinds import CHANNELS, Vector
from .scene import Scene
from .sensors import Motion, Sensing

__all__ = ["SENSING_FAULTS", "crosstalk"]

Maker = Callable[[Scene, np.random.Generator], Blueprint]
Change = Callable[[Vector, Motion, int], Vector]


def _channel(rng: np.random.Generator, kinds: str = "") -> str:
    return str(rng.choice([c for c in CHANNELS if c.endswith(kinds)]))


def _peak(scene: Scene, channel: str) -> float:
    """Largest reading without a fault, m/s²."""
    number = CHANNELS.index(channel)
    return max(float(np.max(np.abs(rows[:, number]))) for rows in scene.base[:2])


def _mounted(channel: str, change: Change) -> Sensing:
    """Return a change of the acceleration that one sensor feels."""

    def mount(motion: Motion, run: int) -> Motion:
        felt = change(motion.acceleration[channel], motion, run)
        return Motion(
            motion.begin,
            motion.step,
            {**motion.acceleration, channel: felt},
            motion.pitch,
            motion.pitching,
        )

    return Sensing(mount=mount)


def _soft_saturation(scene: Scene, rng: np.random.Generator) -> Blueprint:
    channel = _channel(rng)
    peak = _peak(scene, channel)

    def sensing(size: float) -> Sensing:
        top = peak / size
        return _mounted(channel, lambda a, motion, run: top * np.tanh(a / top))

    name = "unlisted:soft_saturation"
    return Blueprint(name, channel, "tanh of the amplifier", (0.03, 2.0), sensing=sensing)


def _slew(scene: Scene, rng: np.random.Generator) -> Blueprint:
    channel = _channel(rng)
    number = 0 if "front" in channel else 2
    number += int(channel.endswith("chassis"))
    motions = scene.motions(scene.history)
    fastest = max(float(np.max(np.abs(np.diff(m.acceleration[channel])))) for m in motions[:2])

    def sensing(size: float) -> Sensing:
        most = fastest * (1.0 - size)

        def change(a: Vector, motion: Motion, run: int) -> Vector:
            follows, now = [], float(a[0])
            for wanted in a.tolist():
                now += min(max(wanted - now, -most), most)
                follows.append(now)
            return np.array(follows)

        return _mounted(channel, change)

    return Blueprint("unlisted:slew_limit", channel, "slew rate", (0.02, 0.985), sensing=sensing)


def _reference(scene: Scene, rng: np.random.Generator) -> Blueprint:
    channel, warms = _channel(rng), float(rng.uniform(0.5, 1.5))
    sign = float(rng.choice([-1.0, 1.0]))

    def sensing(size: float) -> Sensing:
        def change(a: Vector, motion: Motion, run: int) -> Vector:
            t = np.maximum(motion.times, 0.0)
            return a * (1.0 + sign * size * (1.0 - 2.0 * np.exp(-t / warms)))

        return _mounted(channel, change)

    name = "unlisted:warming_reference"
    return Blueprint(name, channel, "gain that settles", (0.001, 0.5), sensing=sensing)


def _rattle(scene: Scene, rng: np.random.Generator) -> Blueprint:
    channel = _channel(rng, "chassis")
    tone = float(rng.uniform(0.2, 0.38)) * scene.rate * float(rng.uniform(0.5, 1.0))
    tone, fades = min(tone, 140.0), float(rng.uniform(0.02, 0.05))
    threshold = 0.4 * _peak(scene, channel)

    def sensing(size: float) -> Sensing:
        def change(a: Vector, motion: Motion, run: int) -> Vector:
            t, felt, last = motion.times, a.copy(), -1.0
            for hit in np.flatnonzero((np.abs(a[1:]) > threshold) & (np.abs(a[:-1]) <= threshold)):
                if t[hit] - last > 0.05:
                    last = float(t[hit])
                    u = np.maximum(t - last, 0.0)
                    felt += size * np.exp(-u / fades) * np.sin(2.0 * np.pi * tone * u)
            return felt

        return _mounted(channel, change)

    name = "unlisted:rattling_bracket"
    return Blueprint(name, channel, "ringing after hits", (0.01, 30.0), sensing=sensing)


def _whine(scene: Scene, rng: np.random.Generator) -> Blueprint:
    hit = [str(c) for c in rng.choice(CHANNELS, 2, replace=False)]
    low = float(rng.uniform(0.08, 0.14)) * min(scene.rate, 500.0)
    rise, beat = float(rng.uniform(4.0, 10.0)), float(rng.uniform(1.2, 2.6))
    phases = rng.uniform(0.0, 6.28, 3)

    def sensing(size: float) -> Sensing:
        def wave(times: Vector, run: int) -> Vector:
            turn = 2.0 * np.pi * (low * times + 0.5 * rise * times**2) + phases[run]
            swell = 0.6 + 0.4 * np.sin(2.0 * np.pi * beat * times)
            return np.asarray(size * swell * np.sin(turn))

        return Sensing(shift=dict.fromkeys(hit, wave))

    name = "unlisted:alternator_whine"
    return Blueprint(name, None, "chirp on two channels", (0.003, 5.0), sensing=sensing)


def _cross_axis(scene: Scene, rng: np.random.Generator) -> Blueprint:
    channel = _channel(rng, "chassis")
    above, sign = 0.5 * scene.car.height, float(rng.choice([-1.0, 1.0]))

    def sensing(size: float) -> Sensing:
        def change(a: Vector, motion: Motion, run: int) -> Vector:
            along = 9.80665 * motion.pitch + above * motion.pitching
            return a + sign * size * along

        return _mounted(channel, change)

    name = "unlisted:cross_axis"
    return Blueprint(name, channel, "share of fore-and-aft", (0.002, 0.5), sensing=sensing)


def _range_switch(scene: Scene, rng: np.random.Generator) -> Blueprint:
    channel, sign = _channel(rng), float(rng.choice([-1.0, 1.0]))
    switch = float(rng.uniform(0.3, 0.5)) * _peak(scene, channel)

    def sensing(size: float) -> Sensing:
        def change(a: Vector, motion: Motion, run: int) -> Vector:
            return np.where(np.abs(a) > switch, (1.0 + sign * size) * a, a)

        return _mounted(channel, change)

    name = "unlisted:range_switch"
    return Blueprint(name, channel, "gain above a threshold", (0.001, 0.5), sensing=sensing)


def _stuck_bit(scene: Scene, rng: np.random.Generator) -> Blueprint:
    channel = _channel(rng, "chassis")
    number, step = CHANNELS.index(channel), scene.declared.sensors[channel].step
    at = float(rng.uniform(0.0, 1.0))

    def sensing(size: float) -> Sensing:
        weight = step * max(1.0, float(np.rint(size / step)))

        def rows(values: Vector, times: Vector, run: int) -> Vector:
            out = values.copy()
            codes = np.floor(out[:, number] / weight + at)
            out[:, number] -= weight * np.mod(codes, 2.0)
            return out

        return Sensing(rows=rows)

    name = "unlisted:stuck_bit"
    return Blueprint(name, channel, "one bit always zero", (2.0 * step, 4.0), sensing=sensing)


def _events(scene: Scene, rng: np.random.Generator) -> list[tuple[Vector, Vector]]:
    """Return times (s) and relative lengths of disturbances in each run."""
    found: list[tuple[Vector, Vector]] = []
    for times in scene.times:
        count = int(rng.integers(5, 9))
        at = np.sort(rng.uniform(0.45, float(times[-1]) - 0.25, count))
        found.append((at, rng.uniform(0.4, 1.6, count)))
    return found


def _repeated(scene: Scene, rng: np.random.Generator) -> Blueprint:
    events = _events(scene, rng)

    def sensing(size: float) -> Sensing:
        def rows(values: Vector, times: Vector, run: int) -> Vector:
            out = values.copy()
            for at, length in zip(*events[run], strict=True):
                first = int(np.searchsorted(times, at))
                last = first + int(np.rint(size * length * scene.rate))
                out[first + 1 : last + 1] = out[first]
            return out

        return Sensing(rows=rows)

    span = (0.7 / scene.rate, 0.12)
    return Blueprint("unlisted:repeated_rows", None, "rows held", span, sensing=sensing)


def _filled(scene: Scene, rng: np.random.Generator) -> Blueprint:
    events = _events(scene, rng)
    board = str(rng.choice(["front", "rear"]))
    numbers = [n for n, c in enumerate(CHANNELS) if c.startswith(board)]

    def sensing(size: float) -> Sensing:
        def rows(values: Vector, times: Vector, run: int) -> Vector:
            out = values.copy()
            for at, length in zip(*events[run], strict=True):
                first = int(np.searchsorted(times, at))
                last = min(first + 1 + int(np.rint(size * length * scene.rate)), len(out) - 1)
                share = (np.arange(first, last + 1) - first) / max(last - first, 1)
                for n in numbers:
                    out[first : last + 1, n] = (1 - share) * out[first, n] + share * out[last, n]
            return out

        return Sensing(rows=rows)

    span = (1.0 / scene.rate, 0.2)
    return Blueprint("unlisted:interpolated_gaps", None, "straight lines", span, sensing=sensing)


def _wander(scene: Scene, rng: np.random.Generator) -> Blueprint:
    group = [c for c in CHANNELS if c.endswith("chassis")]
    if rng.random() < 0.5:
        group = [c for c in CHANNELS if c.startswith("rear")]
    pace, phases = float(rng.uniform(0.5, 1.1)), rng.uniform(0.0, 6.28, 3)

    def sensing(size: float) -> Sensing:
        def late(times: Vector, run: int) -> Vector:
            return np.asarray(size * np.sin(2.0 * np.pi * pace * times + phases[run]))

        return Sensing(late=dict.fromkeys(group, late))

    name = "unlisted:wandering_clock"
    return Blueprint(name, None, "sinus of the delay", (0.00002, 0.015), sensing=sensing)


def _sag(scene: Scene, rng: np.random.Generator) -> Blueprint:
    events, fades = _events(scene, rng), float(rng.uniform(0.04, 0.12))
    depth = {c: float(rng.uniform(0.5, 1.0)) for c in CHANNELS}

    def shift_of(channel: str, size: float) -> Callable[[Vector, int], Vector]:
        def shift(times: Vector, run: int) -> Vector:
            total = np.zeros(len(times))
            for at, strong in zip(*(x[:4] for x in events[run]), strict=True):
                u = np.maximum(times - at, 0.0)
                total -= np.where(
                    times > at, strong * -np.expm1(-u / 0.004) * np.exp(-u / fades), 0
                )
            return size * depth[channel] * total

        return shift

    def sensing(size: float) -> Sensing:
        return Sensing(shift={c: shift_of(c, size) for c in CHANNELS})

    name = "unlisted:supply_sag"
    return Blueprint(name, None, "dips of all zeros", (0.003, 8.0), sensing=sensing)


def _spikes(scene: Scene, rng: np.random.Generator) -> Blueprint:
    channel, events = _channel(rng, "chassis"), _events(scene, rng)

    def sensing(size: float) -> Sensing:
        def shift(times: Vector, run: int) -> Vector:
            total = np.zeros(len(times))
            for at, strong in zip(*events[run], strict=True):
                total[int(np.searchsorted(times, at))] = size * (strong - 1.0) / 0.6
            return total

        return Sensing(shift={channel: shift})

    name = "unlisted:connector_spikes"
    return Blueprint(name, channel, "single samples", (0.03, 25.0), sensing=sensing)


def crosstalk(scene: Scene, rng: np.random.Generator) -> tuple[Blueprint, float]:
    """Return a share of one channel in another, from 0.5 to 3 %, and that share."""
    source, target = (str(c) for c in rng.choice(CHANNELS, 2, replace=False))

    def sensing(size: float) -> Sensing:
        return _mounted(target, lambda a, motion, run: a + size * motion.acceleration[source])

    size = float(np.exp(rng.uniform(np.log(0.005), np.log(0.03))))
    form = f"{source} in {target}"
    return Blueprint("unlisted:crosstalk", target, form, (0.005, 0.03), sensing=sensing), size


SENSING_FAULTS: dict[str, Maker] = {
    "soft_saturation": _soft_saturation,
    "slew_limit": _slew,
    "warming_reference": _reference,
    "rattling_bracket": _rattle,
    "alternator_whine": _whine,
    "cross_axis": _cross_axis,
    "range_switch": _range_switch,
    "stuck_bit": _stuck_bit,
    "repeated_rows": _repeated,
    "interpolated_gaps": _filled,
    "wandering_clock": _wander,
    "supply_sag": _sag,
    "connector_spikes": _spikes,
}
