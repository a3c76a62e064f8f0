"""Shapes of a push on the chassis, and the pulse of the page that is nearest to each."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares

from .kinds import Vector

__all__ = ["PULSES", "page_pulse"]


def _even(u: Vector) -> Vector:
    """Rise, hold and fall with straight flanks; u runs from 0 to 1 over the push."""
    return np.asarray(np.clip(np.minimum(u / 0.2, (1.0 - u) / 0.2), 0.0, 1.0))


def _cosine(u: Vector) -> Vector:
    """Return a tug of a tow rope: 1 − cos."""
    return np.where((u > 0.0) & (u < 1.0), 0.5 - 0.5 * np.cos(2.0 * np.pi * u), 0.0)


def _half_sine(u: Vector) -> Vector:
    """Return a shove by a person: half a sine."""
    return np.where((u > 0.0) & (u < 1.0), np.sin(np.pi * np.clip(u, 0.0, 1.0)), 0.0)


def _lift(u: Vector) -> Vector:
    """Return a force that comes with a step of tanh and goes with another."""
    return np.asarray(0.5 * (np.tanh((u - 0.1) / 0.035) - np.tanh((u - 0.9) / 0.035)))


PULSES: dict[str, Callable[[Vector], Vector]] = {
    "trapezium": _even,
    "tug": _cosine,
    "half sine": _half_sine,
    "tanh flanks": _lift,
}


def _page(t: Vector, p: Vector) -> Vector:
    """Return the page's pulse: force, start, duration and rise; it falls from start + duration."""

    def ramp(x: Vector) -> Vector:
        s = np.clip(x, 0.0, 1.0)
        return s * s * (3.0 - 2.0 * s)

    rise = float(np.exp(p[3]))
    x = (t - p[1]) / rise + 0.5  # the page counts from half of the amplitude
    return np.asarray(p[0] * (ramp(x) - ramp(x - p[2] / rise)))


def page_pulse(
    shape: Callable[[Vector], Vector], start: float, length: float
) -> dict[str, list[float]]:
    """Return forces (of one), starts (s) and durations (s) of the page's pulse that fit a shape.

    The fit is to the pulse itself and to its changes, with the rise free and short.
    """
    u = np.linspace(-0.6, 1.6, 881)
    target = shape(u)
    high = u[target > 0.5 * float(np.max(target))]
    width = float(high[-1] - high[0])
    found = []
    for changes in (False, True):
        fits = []
        for rise in (0.05, 0.2, 0.5):

            def misfit(p: Vector, changes: bool = changes) -> Vector:
                gap = _page(u, p) - target
                return np.asarray(np.diff(gap) * 30.0) if changes else gap

            first = np.array([1.0, float(high[0]) - 0.5 * rise, width, np.log(rise)])
            fits.append(least_squares(misfit, first, max_nfev=200))
        found.append(min(fits, key=lambda fit: float(fit.cost)).x)
    return {
        "force": [float(x[0]) for x in found],
        "start": [start + length * float(x[1]) for x in found],
        "duration": [length * float(x[2]) for x in found],
    }
