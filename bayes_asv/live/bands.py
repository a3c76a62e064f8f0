"""95 % bands of normal and log-normal quantities."""

from __future__ import annotations

import math
from typing import Final

__all__ = ["Z95", "normal_below"]

Z95: Final = 1.959963984540054
"""A normal variable lies within so many deviations with a probability of 95 %."""


def normal_below(distance: float, sd: float) -> float:
    """Probability that a normal variable lies below its mean plus a distance.

    Parameters
    ----------
    distance : float
        In the variable's unit.
    sd : float
        Its deviation, likewise, not negative.

    Returns
    -------
    float
        Between 0 and 1; a half at a distance of zero, whatever the deviation.
    """
    if sd <= 0.0:
        return 0.5 if distance == 0.0 else float(distance > 0.0)
    return 0.5 * math.erfc(-distance / (sd * math.sqrt(2.0)))
