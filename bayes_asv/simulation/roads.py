"""Road profiles as wheel hubs follow them, smooth enough to have an acceleration.

A tyre rolls over an edge along an arc, so every corner is rounded over the length of a contact
patch.  The dynamics of tyre and unsprung mass are not modelled, because the half car takes the
motion of the hubs as its input.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.units import INCH, MPH
from bayes_asv.simulation import ROADS

__all__ = ["Road", "road"]

Array = NDArray[np.float64]
Shape = Callable[[Array], Array]


@dataclass(frozen=True)
class Road:
    """A road profile and the speed of the car.

    Parameters
    ----------
    name : str
        One of :data:`bayes_asv.simulation.ROADS`.
    speed : float
        Speed, m/s.
    height : callable
        Hub height, m, at distances (N,), m; zero before distance 0.
    """

    name: str
    speed: float
    height: Shape


def _blend(s: Array) -> Array:
    """Rise from 0 to 1 as a quintic, with two continuous derivatives."""
    t = np.clip(s, 0.0, 1.0)
    return np.asarray(t**3 * (10.0 - 15.0 * t + 6.0 * t**2))


def _bump(x: Array) -> Array:
    """One smooth bump, 3 in high and 36 in long."""
    length, height = 36 * INCH, 3 * INCH
    return height * (_blend(2.0 * x / length) - _blend(2.0 * x / length - 1.0))


def _stops(x: Array) -> Array:
    """Two parking stops 12 in apart, as a hub crosses them on a soft tyre.

    A soft 22 in tyre absorbs 1 in of the 4 in of concrete.  The hub climbs the remaining 3 in over
    a distance of 14 in and has come down half way when the second stop lifts it again.
    """
    height, ramp = 3 * INCH, 14 * INCH
    pitch = 18 * INCH  # 6 in of stop and 12 in between
    total = np.zeros_like(x)
    for k in range(2):
        s = x - k * pitch
        total += height * (_blend(s / ramp) - _blend((s - ramp) / ramp))
    return total


def _rollers(x: Array) -> Array:
    """Eight sine rollers, 2 in from trough to crest and 60 in long."""
    wave = 60 * INCH
    fade = _blend(x / wave) - _blend((x - 7 * wave) / wave)
    return fade * INCH * np.sin(2.0 * math.pi * x / wave)


def _waves(rng: np.random.Generator, low: float, high: float, power: float) -> Shape:
    """Sum of 120 sines with wavenumbers k from low to high, 1/m, and spectral density k^-power."""
    k = np.exp(np.linspace(math.log(low), math.log(high), 121))
    middle, width = np.sqrt(k[1:] * k[:-1]), np.diff(k)
    amplitude = middle ** (-0.5 * power) * np.sqrt(2.0 * width)
    phase = rng.uniform(0.0, 2.0 * math.pi, len(middle))

    def height(x: Array) -> Array:
        waves = np.sin(2.0 * math.pi * x[:, None] * middle + phase) @ amplitude
        return np.asarray(waves * _blend(x))

    return height


def _rough(rng: np.random.Generator) -> Shape:
    """Random road of ISO 8608 class E: displacement density n⁻², wavelengths 10 m to 0.4 m."""
    shape = _waves(rng, 0.1, 2.5, 2.0)
    density = 1024e-6 * 0.1**2  # Gd(n₀) n₀², m; class E at n₀ = 0.1 1/m
    return lambda x: math.sqrt(density) * shape(x)


def _noise(rng: np.random.Generator) -> Shape:
    """Road whose hub acceleration is white from 0.5 to 20 Hz at the default speed."""
    speed = _SPEEDS["noise"]
    shape = _waves(rng, 0.5 / speed, 20.0 / speed, 4.0)
    rms = 8.0  # m/s²
    span = 19.5 / speed
    scale = rms / (math.sqrt(span) * (2.0 * math.pi * speed) ** 2)
    return lambda x: scale * shape(x)


_SPEEDS = {
    "bump": 10 * MPH,
    "stops": 7 * MPH,
    "rough": 15 * MPH,
    "rollers": 12 * MPH,
    "noise": 10 * MPH,
}


def road(name: str, rng: np.random.Generator, speed: float | None = None) -> Road:
    """Make a road by name.

    Parameters
    ----------
    name : str
        One of :data:`ROADS`: ``bump``, ``stops``, ``rough``, ``rollers``, ``noise``.
    rng : numpy Generator
        Source of the random roads.
    speed : float, optional
        Speed, m/s; each road has a default suitable for a small car.

    Returns
    -------
    Road

    Raises
    ------
    ValueError
        If the name is unknown.
    """
    if name not in _SPEEDS:
        raise ValueError(f"no road {name!r}; there are {', '.join(ROADS)}")
    shapes: dict[str, Callable[[], Shape]] = {
        "bump": lambda: _bump,
        "stops": lambda: _stops,
        "rollers": lambda: _rollers,
        "rough": lambda: _rough(rng),
        "noise": lambda: _noise(rng),
    }
    return Road(name, _SPEEDS[name] if speed is None else speed, shapes[name]())
