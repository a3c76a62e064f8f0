"""Names of the accelerometer channels, in the order used throughout the package."""

from __future__ import annotations

from typing import Final

__all__ = ["CHANNELS", "ROLL_CHANNELS"]

CHANNELS: Final = ("front_wheel", "front_chassis", "rear_wheel", "rear_chassis")
"""Row order of every (4, N) array: front before rear, wheel before chassis."""

ROLL_CHANNELS: Final = (
    "front_left_wheel",
    "front_right_wheel",
    "rear_left_wheel",
    "rear_right_wheel",
    "front_left_chassis",
    "front_right_chassis",
    "rear_chassis",
)
"""Row order of every (7, N) array of the roll car: wheels before chassis."""
