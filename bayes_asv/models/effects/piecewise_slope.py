"""Integral of a slope that is piecewise linear between knots and constant beyond them."""

from __future__ import annotations

import numpy as np

from bayes_asv.models.effects.base import Array

__all__ = ["integral"]


def integral(knots: Array, slopes: Array, x: Array) -> Array:
    """Integrate a piecewise linear slope from zero.

    Parameters
    ----------
    knots : (K,) array
        Where the slope is given, rising, as many on either side of the middle one, which is zero.
    slopes : (K,) array
        The slope there.
    x : (N,) array
        Upper limits, in the unit of the knots.

    Returns
    -------
    (N,) array
        ∫₀ˣ of the slope, in its unit times that of the knots.
    """
    areas = np.concatenate([[0.0], np.cumsum(0.5 * (slopes[1:] + slopes[:-1]) * np.diff(knots))])
    areas -= areas[len(knots) // 2]
    j = np.clip(np.searchsorted(knots, x) - 1, 0, len(knots) - 2)
    inside = np.clip(x, knots[0], knots[-1])
    at = np.interp(inside, knots, slopes)
    total = areas[j] + 0.5 * (slopes[j] + at) * (inside - knots[j]) + at * (x - inside)
    return np.asarray(total)
