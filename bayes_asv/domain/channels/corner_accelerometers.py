"""Accelerometers of a car that rolls: wheel hub of each corner and body above the front corners.

The third sensor on its body is ``rear_chassis``, in the middle above the rear axle.
"""

from __future__ import annotations

from typing import Final

from bayes_asv.domain.channels.channel import Channel

__all__ = ["GROUP"]

GROUP: Final = (
    Channel("front_left_wheel", "acceleration", "wheel", "front", "left"),
    Channel("front_right_wheel", "acceleration", "wheel", "front", "right"),
    Channel("rear_left_wheel", "acceleration", "wheel", "rear", "left"),
    Channel("rear_right_wheel", "acceleration", "wheel", "rear", "right"),
    Channel("front_left_chassis", "acceleration", "body", "front", "left"),
    Channel("front_right_chassis", "acceleration", "body", "front", "right"),
)
