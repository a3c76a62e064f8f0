"""A force curve whose slope is piecewise linear between knots and constant beyond them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayes_asv.filters.force_laws import KNOT_RATIO
from bayes_asv.models.effects.base import Array

__all__ = ["KNOT_ERROR", "USUAL_STEP", "between_knots", "integral", "slopes_of_steps", "step_names"]

USUAL_STEP = 0.22
"""Scale of the prior of the steps of ln g from knot to knot."""
KNOT_ERROR = (2.0 / 3.0) * 0.5 * USUAL_STEP * (KNOT_RATIO - 1.0)
"""Largest usual error of the force between two knots, as a share: midway a random walk of ln g
differs from its straight course by half a step; 2/3 of that on average, over the √2 − 1 of the
force that accumulates between them."""

_MOST = 50.0  # bound on |ln g|, to avoid overflow


def step_names(count: int) -> tuple[str, ...]:
    """Return the names of the steps of ln g, outward from rest, to ``count`` knots on each side."""
    return tuple(f"{side}_{k + 1}" for side in ("compression", "extension") for k in range(count))


def slopes_of_steps(values: Mapping[str, float], names: tuple[str, ...]) -> Array:
    """Return relative slopes g at all knots, 1 at rest.

    Parameters
    ----------
    values : mapping of str to float
        The step of ln g from each knot to the next one.
    names : tuple of str
        Names of the steps, from :func:`step_names`.
    """
    steps = np.array([values[name] for name in names])
    compression, extension = (np.cumsum(side) for side in np.split(steps, 2))
    logs = np.concatenate([compression[::-1], [0.0], extension])
    return np.asarray(np.exp(np.clip(logs, -_MOST, _MOST)))


def between_knots(force: Array) -> Array:
    """Add to draws (N, P) of a force what lies between the knots, independent at each point.

    The standard deviation is half of :data:`KNOT_ERROR`.
    """
    normal = np.random.default_rng(force.shape).standard_normal(force.shape)
    return np.asarray(force * (1.0 + 0.5 * KNOT_ERROR * normal))


def integral(knots: Array, slopes: Array, x: Array) -> Array:
    """Integrate a piecewise linear slope from zero.

    Parameters
    ----------
    knots : (K,) array
        Increasing knots, the same number on each side of the middle one, which is zero.
    slopes : (K,) array
        Slopes at the knots.
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
