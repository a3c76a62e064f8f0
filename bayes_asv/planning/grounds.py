"""What a team can lay on the ground or find, with dimensions, and how a tyre feels it.

The recording comes from wheel hubs, and a tyre does not follow a corner: a disc of the tyre's
radius rolls over the profile without sinking in, and the contact patch averages what is left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

__all__ = ["ISO_8608", "KINDS", "Ground", "ground_under_tyre"]

Array = NDArray[np.float64]

KINDS = ("bump", "stops", "rollers", "rough")

# Displacement density at 0.1 cycles/m, geometric means of ISO 8608:2016, table A.1, m³.
ISO_8608 = {"A": 16e-6, "B": 64e-6, "C": 256e-6, "D": 1024e-6, "E": 4096e-6}

_STOP_BASE, _STOP_TOP = 0.15, 0.10  # m along the drive: concrete stops are 6 in wide, 4 in on top
_LONGEST_WAVE, _SHORTEST_WAVE = 20.0, 0.15  # m; the tyre averages over anything shorter
_RADIUS = 0.27  # m, half of a 21 in tyre
# A tyre touches the ground along two thirds of the chord that its circle would leave in it.
_TOUCHING = 2.0 / 3.0
_GRID = 0.005  # m


@dataclass(frozen=True)
class Ground:
    """A shape on level ground, the same under both sides of the car.

    Parameters
    ----------
    kind : str
        One of :data:`KINDS`.
    height : float
        Of a bump or stop above the ground, or from trough to crest of a roller, m; 0 for a
        rough road.
    length : float
        Of a bump along the drive, clear distance between two stops, or pitch of the rollers,
        m; 0 for a rough road.
    count : int
        Number of bumps, stops or rollers; 0 for a rough road.
    iso : str
        ISO 8608 class of a rough road, else empty.
    """

    kind: str
    height: float = 0.0
    length: float = 0.0
    count: int = 0
    iso: str = ""

    @property
    def extent(self) -> float:
        """Length of what lies on the ground, m; infinite for a rough road."""
        if self.kind == "rough":
            return math.inf
        if self.kind == "stops":
            return self.count * _STOP_BASE + (self.count - 1) * self.length
        return self.count * self.length

    def profile(self, x: Array, seed: int = 0) -> Array:
        """Height (m) of the bare ground at distances x (m, rising); level before 0.

        Parameters
        ----------
        x : (N,) array
            Distances, m.
        seed : int
            Draws a rough road, whose waves have the density G(n) = G₀ (n/0.1)⁻² of ISO 8608.
        """
        if self.kind == "rough":
            return _rough(x, ISO_8608[self.iso], seed)
        if self.kind == "stops":
            ramp = 0.5 * (_STOP_BASE - _STOP_TOP)
            corners = np.array([0.0, ramp, _STOP_BASE - ramp, _STOP_BASE])
            each = [
                np.interp(x - k * (_STOP_BASE + self.length), corners, [0.0, 1.0, 1.0, 0.0])
                for k in range(self.count)
            ]
            return np.asarray(self.height * np.sum(each, axis=0))
        inside = (x > 0.0) & (x < self.extent)
        wave = 0.5 * self.height * (1.0 - np.cos(2.0 * np.pi * x / self.length))
        return np.where(inside, wave, 0.0)


def _rough(x: Array, density: float, seed: int) -> Array:
    """Random road: waves of random phase, equally spaced in the logarithm of their number."""
    rng = np.random.default_rng([seed, 8608])
    edges = np.geomspace(1.0 / _LONGEST_WAVE, 1.0 / _SHORTEST_WAVE, 161)
    number = np.sqrt(edges[1:] * edges[:-1])
    power = density * (number / 0.1) ** -2.0 * np.diff(edges)
    # normal amplitudes: a road of one seed is as smooth or rough as chance has it
    pair = rng.normal(size=(2, len(number))) * np.sqrt(power)
    phase = 2.0 * np.pi * x[:, None] * number
    come_in = np.clip(x, 0.0, 1.0)
    weight = come_in**3 * (10.0 - 15.0 * come_in + 6.0 * come_in**2)
    return np.asarray((np.sin(phase) @ pair[0] + np.cos(phase) @ pair[1]) * weight)


def ground_under_tyre(
    ground: Ground, reach: float, behind: float, flattened: float, seed: int = 0
) -> CubicSpline:
    """Height that a hub on a stiff tyre would follow, as a curve over distance.

    Parameters
    ----------
    ground : Ground
        What lies there.
    reach : float
        How far the front axle drives beyond its beginning, m.
    behind : float
        How far before its beginning the curve starts, m.
    flattened : float
        Static deflection of the tyre, m: it makes the contact patch.
    seed : int
        Of a rough road.

    Returns
    -------
    CubicSpline
        Height (m) at distances (m) from the beginning.
    """
    # a raised cosine, which carries most in its middle, is half as wide as it is long
    patch_length = 2.0 * _TOUCHING * 2.0 * math.sqrt(2.0 * _RADIUS * flattened)
    margin = _RADIUS + patch_length
    x = np.arange(-behind - margin, reach + margin, _GRID)
    height = ground.profile(x, seed)
    half = int(_RADIUS / _GRID)
    across = _GRID * np.arange(-half, half + 1)
    sag = _RADIUS - np.sqrt(np.maximum(_RADIUS**2 - across**2, 0.0))
    rolled = np.max(
        [np.roll(height, int(k)) - s for k, s in zip(range(-half, half + 1), sag, strict=True)],
        axis=0,
    )
    patch = 1.0 + np.cos(np.linspace(-np.pi, np.pi, max(round(patch_length / _GRID), 3) | 1))
    smooth = np.convolve(np.pad(rolled, len(patch) // 2, mode="edge"), patch / patch.sum(), "valid")
    return CubicSpline(x, smooth)
