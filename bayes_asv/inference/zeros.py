"""Where the wheels' sensors read zero, and with that where the suspension is at rest.

To a linear car a wheel's zero that is off is a chassis' zero that is off: it follows no more than
that both move together.  A spring that stiffens or a stop that is met knows where the suspension
is.  A zero that is off by 0.1 m/s² moves the rest of a car that bounces at 1.4 Hz by 1.3 mm, in
every run by another amount, and a stop that is touched by half a millimetre is missed or met twice
as hard.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bayes_asv.inference.timeline import Timeline
from bayes_asv.model.effects import AXLES, Site

__all__ = ["ZERO_SD", "axles_with_travel", "mean_reading"]

ZERO_SD = 0.15
"""How well the mean reading tells a zero, m/s²: the wheel's speed at both ends over the time."""


def axles_with_travel(sites: Sequence[Site]) -> tuple[str, ...]:
    """Axles that have a law which depends on where the suspension is."""
    found = {axle for site in sites if site.effect.travel for axle in site.axles}
    return tuple(axle for axle in AXLES if axle in found)


def mean_reading(line: Timeline, axle: int) -> float:
    """Mean reading of a wheel's sensor, m/s², beginning and end of the record counting little."""
    wheel = line.wheels[axle]
    weight = np.hanning(len(wheel.knots) + 2)[1:-1]
    return float(np.average(wheel.spline(wheel.knots), weights=weight))
