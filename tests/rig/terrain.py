"""What lies on the ground, and where: bumps, parking stops, rollers, rough road."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from .units import INCH, MPH

__all__ = [
    "DEFAULT_SPEEDS",
    "ISO_8608",
    "TERRAINS",
    "Feature",
    "Haversine",
    "Rollers",
    "Rough",
    "Sine",
    "Stop",
    "Terrain",
    "bump",
    "flat",
    "parking_stops",
    "rollers",
    "rough_road",
]

Reals = npt.NDArray[np.float64]

ISO_8608: Final[Mapping[str, float]] = {letter: 16e-6 * 4.0**k for k, letter in enumerate("ABCDEF")}
"""Displacement density at 0.1 cycles/m by class (geometric means), m^3."""


class Feature(Protocol):
    """A shape on the ground; starts at x = 0, is 0 before."""

    def height(self, x: Reals) -> Reals:
        """Return heights (m) at places ``x`` (m, rising with a uniform step)."""
        ...


@dataclass(frozen=True)
class Haversine:
    """A smooth bump, ``rise`` m high and ``length`` m long."""

    rise: float
    length: float

    def height(self, x: Reals) -> Reals:
        """Return heights (m) at places ``x`` (m)."""
        inside = (x > 0.0) & (x < self.length)
        shape = 0.5 * self.rise * (1.0 - np.cos(2.0 * np.pi * x / self.length))
        return np.where(inside, shape, 0.0)


@dataclass(frozen=True)
class Stop:
    """A parking stop: a trapezoid with ``base`` and ``top`` widths, ``rise`` high, m."""

    rise: float = 4.0 * INCH
    base: float = 6.0 * INCH
    top: float = 4.0 * INCH

    def height(self, x: Reals) -> Reals:
        """Return heights (m) at places ``x`` (m)."""
        ramp = 0.5 * (self.base - self.top)
        return np.interp(
            x, [0.0, ramp, self.base - ramp, self.base], [0.0, self.rise, self.rise, 0.0]
        )


@dataclass(frozen=True)
class Rollers:
    """A row of ``count`` rounded rollers of ``pitch`` m from crest to crest, ``rise`` m high."""

    rise: float
    pitch: float
    count: int

    def height(self, x: Reals) -> Reals:
        """Return heights (m) at places ``x`` (m)."""
        return Haversine(self.rise, self.pitch).height(
            np.where((x > 0.0) & (x < self.count * self.pitch), np.mod(x, self.pitch), -1.0)
        )


@dataclass(frozen=True)
class Sine:
    """A sine wave without end, coming in over ``fade`` m: ``amplitude`` and ``pitch`` in m."""

    amplitude: float
    pitch: float
    fade: float = 0.0

    def height(self, x: Reals) -> Reals:
        """Return heights (m) at places ``x`` (m)."""
        wave = self.amplitude * np.sin(2.0 * np.pi * x / self.pitch)
        return wave if self.fade == 0.0 else wave * _come_in(x, self.fade)


@dataclass(frozen=True)
class Rough:
    """Random road of density G(n) = ``density`` (n / 0.1)^-2 between two wave numbers.

    A sum of sine waves with independent normal amplitudes, on a period of ``period`` m, so that
    height and place do not depend on how long a stretch is asked for.

    Attributes
    ----------
    density : float
        One-sided, at 0.1 cycles/m, m^3.
    seed : int
        Of the road.
    lowest, highest : float
        Wave numbers, cycles/m; longer waves only lift the whole car.
    period : float
        Length after which the road repeats, m.
    fade : float
        Length over which it comes in, m.
    """

    density: float
    seed: int
    lowest: float = 0.05
    highest: float = 8.0
    period: float = 200.0
    fade: float = 1.0

    def height(self, x: Reals) -> Reals:
        """Return heights (m) at places ``x`` (m)."""
        rng = np.random.default_rng(self.seed)
        orders = np.arange(1, int(self.highest * self.period) + 1)
        waves = orders / self.period
        power = self.density * (waves / 0.1) ** -2.0 / self.period  # variance a wave, m^2
        power[waves < self.lowest] = 0.0
        pairs = rng.standard_normal((2, len(orders)))
        # a table by inverse FFT, then exact band-limited values by a fine cubic
        size = 1 << int(np.ceil(np.log2(self.period / 0.004)))
        spectrum = np.zeros(size // 2 + 1, dtype=np.complex128)
        spectrum[orders] = np.sqrt(power) * (pairs[0] - 1j * pairs[1]) * (size / 2.0)
        table = np.fft.irfft(spectrum, size)
        return _periodic_cubic(table, np.mod(x / self.period, 1.0) * size) * _come_in(x, self.fade)


@dataclass(frozen=True)
class Terrain:
    """Features at their places, behind a flat lead-in.

    Attributes
    ----------
    name : str
        Goes into file names and the truth.
    features : tuple of (place, Feature)
        Place of each feature's beginning, m from the end of the lead-in; heights add.
    lead_in : float
        Seconds of flat road before the front axle is above place 0. Negative: it is already
        that far into the features when the record begins. (The disc of the tyre touches an edge
        a little before the axle is above it.)
    """

    name: str
    features: tuple[tuple[float, Feature], ...] = ()
    lead_in: float = 0.4

    def height(self, x: Reals) -> Reals:
        """Return the bare profile (m) at places ``x`` (m, uniform)."""
        total = np.zeros_like(x)
        for place, feature in self.features:
            total += feature.height(x - place)
        return total


def flat() -> Terrain:
    """Return level ground, for parked records."""
    return Terrain("flat")


def bump(rise: float = 3.5 * INCH, length: float = 1.5) -> Terrain:
    """Return one smooth bump (m)."""
    return Terrain("bump", ((0.0, Haversine(rise, length)),))


def parking_stops(rise: float = 3.25 * INCH, gap: float = 12.0 * INCH) -> Terrain:
    """Return two parking stops, ``gap`` m clear between them, as the reference drove.

    A rise of 4 in drives the chassis sensors of half the cars into their rail at 7 mph, and the
    reference says that its speed was just slow enough not to: 3.25 in does the same here.
    """
    stop = Stop(rise=rise)
    return Terrain("stops", ((0.0, stop), (stop.base + gap, stop)))


def rollers(rise: float = 2.25 * INCH, pitch: float = 1.4, count: int = 40) -> Terrain:
    """Return a row of rollers (m)."""
    return Terrain("rollers", ((0.0, Rollers(rise, pitch, count)),))


def rough_road(seed: int = 0, iso: str = "E", factor: float = 1.0) -> Terrain:
    """Return random road of an ISO 8608 class (times a factor on its density), by seed."""
    return Terrain(f"rough-{iso}", ((0.0, Rough(factor * ISO_8608[iso], seed)),))


TERRAINS: Final[Mapping[str, Callable[[int], Terrain]]] = {
    "bump": lambda _seed: bump(),
    "stops": lambda _seed: parking_stops(),
    "rough": rough_road,
    "rollers": lambda _seed: rollers(),
    "flat": lambda _seed: flat(),
    "washboard": lambda _seed: replace(rollers(1.0 * INCH, 0.6), name="washboard"),
}
"""Terrains by name; each takes a seed, which only the random road uses."""

DEFAULT_SPEEDS: Final[Mapping[str, float]] = {
    "bump": 10.0 * MPH,
    "stops": 7.0 * MPH,
    "rough": 12.0 * MPH,
    "rollers": 8.0 * MPH,
    "flat": 0.0,
    "washboard": 10.0 * MPH,
}
"""Speeds (m/s) at which the nominal car hardly ever clips a sensor."""


def _come_in(x: Reals, length: float) -> Reals:
    """Weight that rises smoothly from 0 at x = 0 to 1 at ``length``."""
    r = np.clip(x / length, 0.0, 1.0)
    return r * r * r * (10.0 - 15.0 * r + 6.0 * r * r)


def _periodic_cubic(table: Reals, at: Reals) -> Reals:
    """Interpolate a periodic table at fractional places by a four-point cubic."""
    whole = np.floor(at).astype(np.int64)
    r = at - whole
    size = len(table)
    before, here = table[(whole - 1) % size], table[whole % size]
    after, later = table[(whole + 1) % size], table[(whole + 2) % size]
    return np.asarray(
        -r * (r - 1.0) * (r - 2.0) / 6.0 * before
        + (r + 1.0) * (r - 1.0) * (r - 2.0) / 2.0 * here
        - (r + 1.0) * r * (r - 2.0) / 2.0 * after
        + (r + 1.0) * r * (r - 1.0) / 6.0 * later
    )
