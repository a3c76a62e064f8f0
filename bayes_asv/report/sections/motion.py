"""The part of a recording in which the wheels move, which figures against time show."""

from __future__ import annotations

from typing import Final

import numpy as np

from bayes_asv.report import svg
from bayes_asv.report.schema.estimate import Run

__all__ = ["motion_window"]

_MOVING: Final = 0.05  # of the largest wheel acceleration: the motion is above it
_BEFORE, _AFTER = 0.1, 0.4  # s shown around the motion


def motion_window(run: Run) -> tuple[float, float]:
    """First and last time that figures show: the motion of the wheels with a margin."""
    time = svg.curve_array(run.wheels.time)
    moving = np.zeros(len(time), dtype=bool)
    for curve in run.wheels.entries.values():
        size = np.abs(svg.curve_array(curve))
        if np.isfinite(size).any():
            moving |= size > _MOVING * np.nanmax(size)
    if not moving.any():
        return float(time[0]), float(time[-1])
    first, last = time[moving][[0, -1]]
    return max(float(first) - _BEFORE, float(time[0])), min(float(last) + _AFTER, float(time[-1]))
