"""Shape of a force curve in words: ratios of slopes and forces that hold for any curve."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["SLOWEST", "CurveShape", "curve_shapes", "log_bend", "ratio"]

Array = NDArray[np.float64]

SLOWEST = 0.125
"""Share of the range used whose piece of the curve stands for the neighbourhood of rest."""

_LEAST_RATIO = 1e-3  # that is stated: a slope of nothing at all is a thousandth
_UNEQUAL = 1.1  # ratio of forces from which the sides are called unequal


class CurveShape(NamedTuple):
    """A statement about the force curve of a damper or a spring.

    Parameters
    ----------
    name : str
        What it says: ``unequal_sides``, or that it is flatter or steeper far from rest.
    side : {'compression', 'extension', 'both'}
        Where it holds.
    probability : float
        Posterior probability.
    ratio : (N,) array
        Draws of what it rests on: slope far from rest over slope near rest (geometric mean of both
        sides where it holds on both), or force in extension over force in compression.
    """

    name: str
    side: str
    probability: float
    ratio: Array


def ratio(above: Array, below: Array) -> Array:
    """Ratio of slopes or forces (N,), of which a draw may have one that is not positive."""
    least = _LEAST_RATIO * np.maximum(np.abs(above), np.abs(below))
    least = np.maximum(least, np.finfo(float).tiny)
    return np.asarray(np.maximum(above, least) / np.maximum(below, least))


def log_bend(near: Array, half: Array, full: Array) -> Array:
    """Logarithm of the slope far from rest over that near rest.

    Parameters
    ----------
    near, half, full : (N,) arrays
        Draws of the force at :data:`SLOWEST` of the range used, at half of it and at all of it, N.

    Returns
    -------
    (N,) array
        ln of the mean slope over the upper half of the range over that in its lowest eighth.
    """
    return np.log(ratio((full - half) / (1.0 - 0.5), near / SLOWEST))


def curve_shapes(
    bends: Mapping[str, Array], sides: Array, names: tuple[str, str], bent: float
) -> tuple[CurveShape, ...]:
    """State what is more probable than not of a curve.

    Parameters
    ----------
    bends : mapping of str to (N,) array
        :func:`log_bend` in compression and in extension.
    sides : (N,) array
        Force in extension over force in compression, :func:`ratio`.
    names : pair of str
        What a curve is called that is flatter far from rest, and one that is steeper.
    bent : float
        Ratio of slopes from which it is called so.
    """
    out = []
    for name, sign in zip(names, (-1.0, 1.0), strict=True):
        holds = {side: sign * bend > math.log(bent) for side, bend in bends.items()}
        everywhere = float(np.mean(np.logical_and(*holds.values())))
        if everywhere > 0.5:
            both = np.exp(0.5 * sum(bends.values()))
            out.append(CurveShape(name, "both", everywhere, np.asarray(both)))
            continue
        for side, true in holds.items():
            if np.mean(true) > 0.5:
                out.append(CurveShape(name, side, float(np.mean(true)), np.exp(bends[side])))
    unequal = float(np.mean(np.abs(np.log(sides)) > math.log(_UNEQUAL)))
    if unequal > 0.5:
        out.append(CurveShape("unequal_sides", "both", unequal, sides))
    return tuple(out)
