"""An inertial unit on the body; the vehicle file gives its place."""

from __future__ import annotations

from typing import Final

from bayes_asv.domain.channels.channel import Channel

__all__ = ["GROUP"]

GROUP: Final = (
    Channel("body_vertical", "acceleration", "body"),
    Channel("body_pitch_rate", "angular_rate", "body", axis="pitch"),
)
