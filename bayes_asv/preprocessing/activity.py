"""The stretch of a recording in which its wheels move most."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle

__all__ = ["FEWEST_ROWS", "cut", "most_active", "most_active_rows", "wheel_power"]

Array = NDArray[np.float64]

FEWEST_ROWS = 100
"""Least number of rows of a recording, or of a stretch of one."""


def wheel_power(recording: Recording, vehicle: Vehicle) -> Array:
    """Sum of squared accelerations of all wheels at each row (N,); without wheels, all channels."""
    wheels = [c for c, n in enumerate(recording.channels) if vehicle.channel(n).is_input]
    values = recording.values[wheels or slice(None)]
    motion = np.nan_to_num(values - np.nanmedian(values, axis=1, keepdims=True))
    return np.asarray(np.sum(motion**2, axis=0))


def most_active(power: Array, rows: int) -> slice:
    """Return the stretch of ``rows`` rows with the most power (N,), or all rows if N is smaller."""
    if rows >= len(power):
        return slice(0, len(power))
    running = np.concatenate([[0.0], np.cumsum(power)])
    first = int(np.argmax(running[rows:] - running[:-rows]))
    return slice(first, first + rows)


def most_active_rows(recording: Recording, vehicle: Vehicle, seconds: float) -> slice:
    """Return the rows of the stretch of some seconds in which the wheels move most.

    It has at least a hundred rows, since the time column may be wrong.
    """
    rows = max(int(seconds / float(np.median(np.diff(recording.time)))), FEWEST_ROWS)
    return most_active(wheel_power(recording, vehicle), rows)


def cut(recording: Recording, rows: slice) -> Recording:
    """Return some rows of a recording."""
    return replace(recording, time=recording.time[rows], values=recording.values[:, rows])
