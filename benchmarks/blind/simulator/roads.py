"""Roads: height of the surface over distance, and how fast it is driven.

Each road is drawn with a peak height of about one; the case scales it. What a wheel follows is the
road averaged over the length of its contact patch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .kinds import Span, Vector
from .signals import spline

__all__ = ["ROADS", "Profile", "Road", "draw_road"]

SPACING = 0.01
"""Distance between the points of a road, m."""

Shape = Callable[[np.random.Generator, Vector], tuple[Vector, float]]


def _ramp(s: Vector, begin: float, length: float) -> Vector:
    """Step from 0 to 1 that begins at ``begin`` and is even in slope at both ends."""
    u = np.clip((s - begin) / length, 0.0, 1.0)
    return np.asarray(u * u * (3.0 - 2.0 * u))


def _hump(s: Vector, begin: float, rise: float, top: float) -> Vector:
    """Rise, plateau and fall."""
    return _ramp(s, begin, rise) - _ramp(s, begin + rise + top, rise)


def _cushions(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    gap = float(rng.uniform(2.6, 5.0))
    rise, top = float(rng.uniform(0.35, 0.7)), float(rng.uniform(0.5, 1.3))
    second = float(rng.uniform(0.6, 1.0))
    h = _hump(s, 0.0, rise, top) + second * _hump(s, gap, rise * 0.8, top)
    return h, gap + 2.0 * rise + top


def _potholes(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    h, at = np.zeros_like(s), 0.0
    for _ in range(int(rng.integers(3, 6))):
        length, depth = float(rng.uniform(0.35, 0.9)), float(rng.uniform(0.45, 1.0))
        edge = float(rng.uniform(0.06, 0.15))
        h -= depth * _hump(s, at, edge, length)
        at += length + float(rng.uniform(0.9, 2.6))
    return h, at


def _cobbles(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    """Setts of about 0.3 m on a subsoil that has settled: two humps in the spectrum."""
    n = np.sort(rng.uniform(0.12, 3.2, 90))
    power = 1.0 / (1.0 + (n / 0.3) ** 2.4) + 0.012 * np.exp(-(((n - 2.9) / 0.5) ** 2))
    phase = rng.uniform(0.0, 2.0 * np.pi, len(n))
    h = np.cos(2.0 * np.pi * np.outer(s, n) + phase) @ np.sqrt(power)
    window = _ramp(s, 0.0, 1.2)
    h = h * window
    return h / np.max(np.abs(h)), 30.0


def _loading_ramp(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    up, top = float(rng.uniform(1.0, 1.8)), float(rng.uniform(1.6, 3.0))
    down = float(rng.uniform(0.25, 0.6))
    lip = 0.15 * _hump(s, up + top + down + 1.4, 0.2, 0.15)
    return _ramp(s, 0.0, up) - _ramp(s, up + top, down) + lip, up + top + down + 2.2


def _frost_heaves(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    h, at = np.zeros_like(s), 0.0
    for _ in range(int(rng.integers(4, 7))):
        length = float(rng.uniform(1.3, 3.6))
        lean = float(rng.uniform(0.25, 0.75))
        size = float(rng.uniform(0.4, 1.0)) * (1.0 if rng.random() < 0.75 else -0.7)
        h += size * (_ramp(s, at, lean * length) - _ramp(s, at + lean * length, length))
        at += length * float(rng.uniform(0.8, 1.5))
    return h, at + 2.0


def _railway_crossing(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    width = float(rng.uniform(1.4, 1.7))
    h = 0.9 * np.where((s > 0) & (s < 9.0), 0.5 - 0.5 * np.cos(2.0 * np.pi * s / 9.0), 0.0)
    for track in (2.2, 2.2 + float(rng.uniform(3.2, 4.0))):
        for rail in (0.0, width):
            proud = float(rng.uniform(0.2, 0.5))
            h += proud * _hump(s, track + rail, 0.05, 0.1)
            h -= 0.8 * proud * _hump(s, track + rail + 0.2, 0.05, 0.12)
    return h, 9.5


def _sine_sweep(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    """Swells whose wavelength shrinks with distance, and whose height shrinks with it."""
    longest, shortest = float(rng.uniform(2.8, 4.2)), float(rng.uniform(0.65, 0.95))
    reach = float(rng.uniform(11.0, 15.0))
    at = np.clip(s, 0.0, reach)
    log = np.log(longest / shortest) / reach
    wavelength = longest * np.exp(-log * at)
    phase = 2.0 * np.pi * (np.exp(log * at) - 1.0) / (log * longest)
    h = (wavelength / longest) ** float(rng.uniform(1.0, 1.5)) * np.sin(phase)
    return h * _ramp(s, 0.0, 0.5) * (1.0 - _ramp(s, reach - 0.8, 0.8)), reach


def _expansion_joints(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    """Slabs that have tilted: a step at each joint, a slope in between."""
    h, at = np.zeros_like(s), 0.0
    slab = float(rng.uniform(2.2, 3.4))
    for _ in range(6):
        step = float(rng.uniform(0.5, 1.0))
        h += step * (_ramp(s, at, 0.08) - _ramp(s, at + 0.2, slab - 0.3))
        at += slab
    return h, at


def _corrugations(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    """Washboard of a dirt track whose depth comes and goes, with a long wave below it."""
    wave = float(rng.uniform(0.85, 1.3))
    beat = 0.6 + 0.4 * np.sin(2.0 * np.pi * s / float(rng.uniform(3.5, 7.0)) + rng.uniform(0, 6.28))
    wander = 0.5 * np.sin(2.0 * np.pi * s / 5.3 + float(rng.uniform(0.0, 6.28)))
    long = 0.8 * np.sin(2.0 * np.pi * s / float(rng.uniform(4.0, 6.5)))
    h = 0.55 * beat * np.sin(2.0 * np.pi * s / wave + wander) + long
    return h * _ramp(s, 0.0, 1.0), 30.0


def _kerb_drop(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    """Up a driveway, along the pavement, and off the kerb."""
    up, top = float(rng.uniform(1.4, 2.2)), float(rng.uniform(1.0, 2.4))
    return _ramp(s, 0.0, up) - _ramp(s, up + top, float(rng.uniform(0.12, 0.2))), up + top + 1.2


def _logs(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    """Half-buried logs across a track, unevenly spaced."""
    h, at = np.zeros_like(s), 0.0
    for _ in range(int(rng.integers(3, 6))):
        size, breadth = float(rng.uniform(0.45, 1.0)), float(rng.uniform(0.25, 0.45))
        u = np.clip((s - at) / breadth, 0.0, 1.0)
        h += size * np.sin(np.pi * u) ** 1.5
        at += float(rng.uniform(1.0, 3.2))
    return h, at + 0.5


@dataclass(frozen=True)
class Road:
    """A kind of road: shape, range of speeds (m/s), and whether it goes on to the end of a run."""

    shape: Shape
    speed: Span
    lasting: bool


ROADS: dict[str, Road] = {
    "speed cushions": Road(_cushions, (2.6, 4.6), False),
    "potholes": Road(_potholes, (2.6, 4.8), False),
    "cobbles": Road(_cobbles, (3.5, 6.5), True),
    "loading ramp": Road(_loading_ramp, (2.0, 3.4), False),
    "frost heaves": Road(_frost_heaves, (3.5, 6.0), True),
    "railway crossing": Road(_railway_crossing, (3.0, 5.0), False),
    "sine sweep": Road(_sine_sweep, (3.6, 5.6), True),
    "expansion joints": Road(_expansion_joints, (4.5, 7.5), True),
    "corrugations": Road(_corrugations, (3.4, 6.0), True),
    "kerb drop": Road(_kerb_drop, (1.8, 3.2), False),
    "logs": Road(_logs, (2.4, 4.2), False),
}


@dataclass(frozen=True)
class Profile:
    """A road as it was drawn.

    ``reach`` is where it ends (m), ``speed`` that of the first drive (m/s); points ``s`` (m),
    heights ``h`` as the contact patch follows them (peak about one).
    """

    kind: str
    reach: float
    speed: float
    s: Vector
    h: Vector

    def height_and_slope(self, at: Vector) -> tuple[Vector, Vector]:
        """Height and slope at distances ``at`` (m), flat outside."""
        curve = spline(self.s, self.h)
        inside = np.clip(at, self.s[0], self.s[-1])
        slope = np.where(at == inside, curve(inside, 1), 0.0)
        return np.asarray(curve(inside)), np.asarray(slope)


def draw_road(kind: str, rng: np.random.Generator) -> Profile:
    """Draw a road of a kind; it begins at distance 0."""
    road = ROADS[kind]
    s = np.arange(-2.0, 36.0, SPACING)
    h, reach = road.shape(rng, s)
    patch = round(float(rng.uniform(0.16, 0.26)) / SPACING)
    kernel = np.hanning(patch + 2)[1:-1]
    smooth = np.convolve(h, kernel / kernel.sum(), "same")
    smooth[:patch], smooth[-patch:] = smooth[patch], smooth[-patch - 1]
    return Profile(kind, reach, float(rng.uniform(*road.speed)), s, smooth)
