"""Suspension deflections of an axle or of a corner, at the wheel."""

from __future__ import annotations

from typing import Final

from bayes_asv.domain.channels.channel import Channel

__all__ = ["GROUP"]

GROUP: Final = (
    Channel("front_travel", "deflection", "suspension", "front"),
    Channel("rear_travel", "deflection", "suspension", "rear"),
    Channel("front_left_travel", "deflection", "suspension", "front", "left"),
    Channel("front_right_travel", "deflection", "suspension", "front", "right"),
    Channel("rear_left_travel", "deflection", "suspension", "rear", "left"),
    Channel("rear_right_travel", "deflection", "suspension", "rear", "right"),
)
