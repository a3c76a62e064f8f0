"""The accelerometer channels, in the one order used everywhere."""

from __future__ import annotations

from typing import Final

__all__ = ["CHANNELS", "ROLL_CHANNELS"]

CHANNELS: Final = ("front_wheel", "front_chassis", "rear_wheel", "rear_chassis")
"""Order of the rows of every (4, N) array: wheel before chassis, front before rear."""

ROLL_CHANNELS: Final = (
    "front_left_wheel",
    "front_right_wheel",
    "rear_left_wheel",
    "rear_right_wheel",
    "front_left_chassis",
    "front_right_chassis",
    "rear_chassis",
)
"""Order of the rows of every (7, N) array of a car that rolls: wheels before chassis."""
