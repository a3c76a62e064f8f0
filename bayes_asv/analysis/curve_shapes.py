"""Shape of a force curve: ratios of slopes and forces that are defined for any curve."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["SLOWEST", "CurveShape", "curve_shapes", "log_bend", "ratio"]

Array = NDArray[np.float64]

SLOWEST = 0.125
"""Share of the range used that counts as near rest."""

_LEAST_RATIO = 1e-3  # least ratio that is stated, for slopes that are zero or negative
_UNEQUAL = 1.1  # ratio of forces above which the sides are called unequal


class CurveShape(NamedTuple):
    """A statement about the force curve of a damper or a spring.

    Parameters
    ----------
    name : str
        ``unequal_sides``, or the name of a curve that is flatter or steeper far from rest.
    side : {'compression', 'extension', 'both'}
        Side to which it applies.
    probability : float
        Posterior probability.
    ratio : (N,) array
        Draws of the ratio on which it is based: slope far from rest over slope near rest (geometric
        mean of both sides if it applies to both), or force in extension over force in compression.
    """

    name: str
    side: str
    probability: float
    ratio: Array


def ratio(above: Array, below: Array) -> Array:
    """Ratio of slopes or forces (N,); values that are not positive are replaced by small ones."""
    least = _LEAST_RATIO * np.maximum(np.abs(above), np.abs(below))
    least = np.maximum(least, np.finfo(float).tiny)
    return np.asarray(np.maximum(above, least) / np.maximum(below, least))


def log_bend(near_rest: Array, half: Array, full: Array) -> Array:
    """Logarithm of the slope far from rest over that near rest.

    Parameters
    ----------
    near_rest, half, full : (N,) arrays
        Draws of the force at :data:`SLOWEST` of the range used, at half of it and at all of it, N.

    Returns
    -------
    (N,) array
        ln of the mean slope over the upper half of the range over that in its lowest eighth.
    """
    return np.log(ratio((full - half) / (1.0 - 0.5), near_rest / SLOWEST))


def curve_shapes(
    bends: Mapping[str, Array], sides: Array, names: tuple[str, str], bent: float
) -> tuple[CurveShape, ...]:
    """Make the statements about a curve that are more probable than not.

    Parameters
    ----------
    bends : mapping of str to (N,) array
        :func:`log_bend` in compression and in extension.
    sides : (N,) array
        Force in extension over force in compression, :func:`ratio`.
    names : pair of str
        Names of a curve that is flatter far from rest, and of one that is steeper.
    bent : float
        Ratio of slopes above which these names apply.
    """
    out = []
    for name, sign in zip(names, (-1.0, 1.0), strict=True):
        holds = {side: sign * bend > math.log(bent) for side, bend in bends.items()}
        everywhere = float(np.mean(np.logical_and(*holds.values())))
        if everywhere > 0.5:
            both = np.exp(0.5 * sum(bends.values()))
            out.append(CurveShape(name, "both", everywhere, np.asarray(both)))
            continue
        for side, in_draws in holds.items():
            if np.mean(in_draws) > 0.5:
                out.append(CurveShape(name, side, float(np.mean(in_draws)), np.exp(bends[side])))
    unequal = float(np.mean(np.abs(np.log(sides)) > math.log(_UNEQUAL)))
    if unequal > 0.5:
        out.append(CurveShape("unequal_sides", "both", unequal, sides))
    return tuple(out)
