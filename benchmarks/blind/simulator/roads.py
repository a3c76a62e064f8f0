"""Roads: height of the surface over distance, and how fast it is driven.

Each road is drawn with a peak height of about one; the case scales it. What a wheel follows is the
road averaged over the length of its contact patch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .kinds import Span, Vector
from .signals import spline

__all__ = ["ROADS", "Profile", "Road", "draw_road"]

SPACING = 0.01
"""Distance between the points of a road, m."""

ENDLESS = 30.0
"""Reach of a road that is as long as it is driven, m."""

Shape = Callable[[np.random.Generator, Vector], tuple[Vector, float]]


def _ramp(s: Vector, begin: float, length: float) -> Vector:
    """Step from 0 to 1 that begins at ``begin`` and is even in slope at both ends."""
    u = np.clip((s - begin) / length, 0.0, 1.0)
    return np.asarray(u * u * (3.0 - 2.0 * u))


def _arc(s: Vector, begin: float, length: float) -> Vector:
    """Segment of a flat circle of height one."""
    u = (s - begin) / length
    return np.where((u > 0.0) & (u < 1.0), 4.0 * u * (1.0 - u), 0.0)


def _round_top(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    """One or two road humps with the profile of a segment of a circle."""
    length = float(rng.uniform(1.6, 3.7))
    h, reach = _arc(s, 0.0, length), length
    if rng.random() < 0.5:
        gap = length + float(rng.uniform(0.8, 2.5))
        h = h + float(rng.uniform(0.5, 1.0)) * _arc(s, gap, 0.7 * length)
        reach = gap + 0.7 * length
    return h, reach


def _cable_ramps(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    """Narrow protectors over cables, with flanks and a flat top."""
    h, at = np.zeros_like(s), 0.0
    flank, top = float(rng.uniform(0.16, 0.30)), float(rng.uniform(0.05, 0.14))
    for _ in range(int(rng.integers(2, 5))):
        rising = np.clip((s - at) / flank, 0.0, 1.0)
        falling = np.clip((s - at - flank - top) / flank, 0.0, 1.0)
        h = h + float(rng.uniform(0.75, 1.0)) * (rising - falling)
        at += 2.0 * flank + top + float(rng.uniform(0.7, 2.4))
    return h, at


def _gully(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    """Lay a drain across the road: a shallow valley, with a grating that stands proud in it."""
    width = float(rng.uniform(1.1, 2.4))
    middle = 0.5 * width
    h = -_arc(s, 0.0, width)
    proud = float(rng.uniform(0.12, 0.35))
    h = h + proud * np.exp(-(((s - middle) / 0.16) ** 4))
    again = width + float(rng.uniform(1.0, 2.8))
    h = h - float(rng.uniform(0.3, 0.8)) * _arc(s, again, 0.6 * width)
    return h, again + 0.6 * width


def _tree_roots(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    """Asphalt that roots have lifted: each bump rises at once and falls off slowly."""
    h, at = np.zeros_like(s), 0.0
    for _ in range(int(rng.integers(4, 8))):
        steep = float(rng.uniform(0.07, 0.16))
        u = np.maximum(s - at, 0.0) / steep
        h = h + float(rng.uniform(0.35, 1.0)) * u**2 * np.exp(2.0 - u) / 4.0
        at += float(rng.gamma(2.5, 0.5)) + 0.35
    return h, at + 0.8


def _bridge(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    """Build a hump-backed bridge with a settled joint at either end."""
    length = float(rng.uniform(3.4, 6.0))
    u = np.clip(s / length, 0.0, 1.0)
    h = np.sin(np.pi * u) ** 2
    for at in (0.0, length):
        h = h - float(rng.uniform(0.10, 0.22)) * np.exp(-(((s - at) / 0.14) ** 2))
    return h, length + 0.4


def _kerb_climb(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    """Up a dropped kerb, over the footway, and down a long driveway."""
    face, level = float(rng.uniform(0.14, 0.26)), float(rng.uniform(1.2, 2.2))
    down = float(rng.uniform(1.6, 2.8))
    up = np.sin(0.5 * np.pi * np.clip(s / face, 0.0, 1.0))
    fall = np.clip((s - face - level) / down, 0.0, 1.0)
    return up * (1.0 - fall), face + level + down


def _steel_plates(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    """Plates over trenches; each lies skew, so that one edge is higher than the other."""
    h, at = np.zeros_like(s), 0.0
    for _ in range(2):
        length, edge = float(rng.uniform(1.2, 2.2)), float(rng.uniform(0.05, 0.10))
        near, far = rng.uniform(0.45, 1.0, 2)
        on = _ramp(s, at, edge) - _ramp(s, at + length, edge)
        h = h + on * (near + (far - near) * np.clip((s - at) / length, 0.0, 1.0))
        at += length + float(rng.uniform(0.9, 2.4))
    return h, at


def _gravel(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    """Strew a gravel road: displacement spectrum that falls as n^-2, as ISO 8608 has it."""
    n = np.sort(np.geomspace(0.12, 4.0, 110) * rng.uniform(0.98, 1.02, 110))
    height = np.sqrt(np.gradient(n)) / n
    phase = rng.uniform(0.0, 2.0 * np.pi, len(n))
    h = np.cos(2.0 * np.pi * np.outer(s, n) + phase) @ height
    return h / np.max(np.abs(h)), ENDLESS


def _stone_field(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    """Stones of all sizes at random places, some four in a wheelbase."""
    h, at = np.zeros_like(s), 0.0
    while at < 34.0:
        breadth = float(rng.uniform(0.10, 0.24))
        h = h + float(rng.exponential(0.4)) * np.exp(-(((s - at) / breadth) ** 2))
        at += float(rng.exponential(0.55)) + 0.1
    return h / np.max(h), ENDLESS


def _pump_track(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    """Rollers of a cycle track: round crests, short hollows, none like the one before."""
    h, at = np.zeros_like(s), 0.0
    while at < 34.0:
        length = float(rng.uniform(0.9, 2.3))
        u = np.clip((s - at) / length, 0.0, 1.0)
        h = h + (length / 2.3) ** 1.3 * np.sin(np.pi * u) ** 1.5
        at += length * float(rng.uniform(1.0, 1.15))
    return h, ENDLESS


def _patched_lane(rng: np.random.Generator, s: Vector) -> tuple[Vector, float]:
    """Lay a lane with patches: its level walks at random, smoothed, with steps between patches."""
    walk = np.cumsum(rng.standard_normal(len(s))) * np.sqrt(SPACING)
    slow = np.convolve(walk, np.hanning(161) / np.hanning(161).sum(), "same")
    trend = np.convolve(walk, np.ones(601) / 601.0, "same")
    h, at = 0.9 * (slow - trend), 0.0
    while at < 34.0:
        length = float(rng.uniform(0.8, 3.0))
        h = h + float(rng.normal(0.0, 0.15)) * (_ramp(s, at, 0.09) - _ramp(s, at + length, 0.09))
        at += length
    return h / np.max(np.abs(h)), ENDLESS


@dataclass(frozen=True)
class Road:
    """A kind of road: shape, and range of speeds (m/s)."""

    shape: Shape
    speed: Span


ROADS: dict[str, Road] = {
    "round-top hump": Road(_round_top, (2.8, 5.0)),
    "cable ramps": Road(_cable_ramps, (2.2, 4.2)),
    "drain gully": Road(_gully, (2.6, 4.8)),
    "tree roots": Road(_tree_roots, (2.8, 5.0)),
    "hump-backed bridge": Road(_bridge, (3.6, 6.0)),
    "kerb climb": Road(_kerb_climb, (1.9, 3.4)),
    "steel plates": Road(_steel_plates, (2.6, 4.6)),
    "gravel": Road(_gravel, (3.4, 6.6)),
    "stone field": Road(_stone_field, (2.6, 4.8)),
    "pump track": Road(_pump_track, (3.2, 5.4)),
    "patched lane": Road(_patched_lane, (3.6, 7.0)),
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

    @property
    def lasting(self) -> bool:
        """Whether the road is as long as it is driven."""
        return self.reach >= ENDLESS

    def faded(self, end: float) -> Profile:
        """Return the road between even ground before 0 and behind ``end`` (m)."""
        window = _ramp(self.s, 0.0, 1.2) * (1.0 - _ramp(self.s, end - 1.2, 1.2))
        return replace(self, reach=end, h=self.h * window)

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
    patch = round(float(rng.uniform(0.14, 0.24)) / SPACING)
    kernel = np.hanning(patch + 2)[1:-1]
    smooth = np.convolve(h, kernel / kernel.sum(), "same")
    smooth[:patch], smooth[-patch:] = smooth[patch], smooth[-patch - 1]
    return Profile(kind, reach, float(rng.uniform(*road.speed)), s, smooth)
