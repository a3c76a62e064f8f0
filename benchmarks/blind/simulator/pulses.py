"""Shapes of a push on the chassis, and the pulse of the page that is nearest to each."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares

from .kinds import Vector

__all__ = ["PULSES", "page_pulse"]


def _bell(u: Vector) -> Vector:
    """Return a nudge that swells and ebbs: Gaussian."""
    return np.asarray(np.exp(-0.5 * ((u - 0.5) / 0.17) ** 2))


def _flat_bell(u: Vector) -> Vector:
    """Return a lean against the car: exp(−x⁶)."""
    return np.asarray(np.exp(-((np.abs(u - 0.5) / 0.42) ** 6)))


def _tired_hold(u: Vector) -> Vector:
    """Return a pull that comes at once, sags to two thirds, and ends."""
    comes = 0.5 - 0.5 * np.cos(np.pi * np.clip(u / 0.12, 0.0, 1.0))
    goes = 0.5 + 0.5 * np.cos(np.pi * np.clip((u - 0.86) / 0.14, 0.0, 1.0))
    return np.asarray(comes * goes * (1.0 - 0.34 * np.clip(u, 0.0, 1.0)))


def _slow_release(u: Vector) -> Vector:
    """Return a grip that takes hold quickly and lets go slowly, with straight flanks."""
    return np.asarray(np.clip(np.minimum(u / 0.1, (1.0 - u) / 0.25), 0.0, 1.0))


PULSES: dict[str, Callable[[Vector], Vector]] = {
    "bell": _bell,
    "flat bell": _flat_bell,
    "tired hold": _tired_hold,
    "slow release": _slow_release,
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

    The fit is to the pulse itself and to its changes, with the rise free; the shape's own peak
    and its own times of half the peak are answers too.
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

            first = np.array([1.0, float(high[0]), width, np.log(rise)])
            fits.append(least_squares(misfit, first, max_nfev=200))
        found.append(min(fits, key=lambda fit: float(fit.cost)).x)
    found.append(np.array([float(np.max(target)), float(high[0]), width]))
    return {
        "force": [float(x[0]) for x in found],
        "start": [start + length * float(x[1]) for x in found],
        "duration": [length * float(x[2]) for x in found],
    }
