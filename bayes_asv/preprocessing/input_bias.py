"""Where the wheels' sensors read zero, and with that where the suspension is at rest.

To a linear car a wheel's zero that is off is a chassis' zero that is off: it follows no more than
that both move together.  A spring that stiffens or a stop that is met knows where the suspension
is.  A zero that is off by 0.1 m/s² moves the rest of a car that bounces at 1.4 Hz by 1.3 mm, in
every run by another amount, and a stop that is touched by half a millimetre is missed or met twice
as hard.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bayes_asv.filters.kalman import ORDER
from bayes_asv.models.effects import AXLES, Site
from bayes_asv.preprocessing.timeline import PreparedRecording
from bayes_asv.preprocessing.wheel_spline import WheelSignal, moments

__all__ = ["ZERO_SD", "axles_with_travel", "levelled", "moments_of_one"]

Array = NDArray[np.float64]

ZERO_SD = 0.15
"""How well the mean reading tells a zero, m/s²: the wheel's speed at both ends over the time."""


def axles_with_travel(sites: Sequence[Site]) -> tuple[str, ...]:
    """Axles that have a law which depends on where the suspension is."""
    found = {axle for site in sites if site.effect.travel for axle in site.axles}
    return tuple(axle for axle in AXLES if axle in found)


def moments_of_one(line: PreparedRecording) -> Array:
    """Moments (E, ORDER) of a wheel acceleration of 1 m/s²."""
    time = line.wheels[0].knots
    one = WheelSignal(CubicSpline(time, np.ones_like(time)), time, line.wheels[0].deviation)
    return moments(one, line.instants, ORDER)


def levelled(line: PreparedRecording) -> PreparedRecording:
    """Return a recording whose wheels read zero on the whole; the chassis above them as much less.

    Beginning and end count little: what a wheel's speed is there does not average out.
    """
    rest = np.array([_mean(wheel) for wheel in line.wheels])
    front, rear = (
        wheel._replace(spline=CubicSpline(wheel.knots, wheel.spline(wheel.knots) - level))
        for wheel, level in zip(line.wheels, rest, strict=True)
    )
    return replace(
        line,
        moments=line.moments - rest[:, None] * moments_of_one(line)[:, None],
        reading=line.reading - rest,
        wheels=(front, rear),
    )


def _mean(wheel: WheelSignal) -> float:
    weight = np.hanning(len(wheel.knots) + 2)[1:-1]
    return float(np.average(wheel.spline(wheel.knots), weights=weight))
