"""The four accelerometer channels, in the one order used everywhere."""

from __future__ import annotations

from typing import Final

__all__ = ["CHANNELS"]

CHANNELS: Final = ("front_wheel", "front_chassis", "rear_wheel", "rear_chassis")
"""Order of the rows of every (4, N) array: wheel before chassis, front before rear."""
