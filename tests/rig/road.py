"""From a bare profile to what the hub feels, as piecewise cubics for the kernel."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.ndimage import grey_dilation

from .terrain import Terrain

__all__ = ["GRID", "Road", "lay"]

Reals = npt.NDArray[np.float64]

GRID = 0.002  # m; the envelope leaves nothing shorter than centimetres


@dataclass(frozen=True)
class Road:
    """A road that is the truth from here on: C2 piecewise cubics on a uniform grid.

    Attributes
    ----------
    coefficients : ndarray, shape (pieces, 4)
        Of 1, r, r^2, r^3 with r the way into the piece, m.
    start, grid : float
        Place of the first knot, and the step between knots, m.
    """

    coefficients: Reals
    start: float
    grid: float


@functools.lru_cache(maxsize=32)
def lay(terrain: Terrain, begin: float, end: float, radius: float, patch: float) -> Road:
    """Lay a terrain out between two places (m) and roll a tyre's envelope over it.

    First a disc of ``radius`` rolls over the profile without sinking in (its centre follows a
    grey dilation), then a raised-cosine weight averages over ``patch``.
    """
    margin = radius + patch + 0.1  # a spline is at its worst near its ends
    steps = int(np.ceil((end - begin + 2.0 * margin) / GRID)) + 1
    start = begin - margin
    x = start + GRID * np.arange(steps, dtype=np.float64)
    z = terrain.height(x)
    if radius > 0.0:
        reach = int(radius / GRID)
        across = GRID * np.arange(-reach, reach + 1)
        disc = np.sqrt(np.maximum(radius**2 - across**2, 0.0)) - radius
        z = np.asarray(grey_dilation(z, structure=disc, mode="nearest"), dtype=np.float64)
    if patch > 2.0 * GRID:
        reach = round(0.5 * patch / GRID)
        across = np.arange(-reach, reach + 1) / reach
        weight = 1.0 + np.cos(np.pi * across)
        padded = np.pad(z, reach, mode="edge")
        z = np.convolve(padded, weight / weight.sum(), mode="valid")
    curve = CubicSpline(x, z)
    coefficients = np.ascontiguousarray(curve.c[::-1].T)
    coefficients.setflags(write=False)
    return Road(coefficients, start, GRID)
