"""Four accelerometers of a half car: wheel hub and body above each axle."""

from __future__ import annotations

from typing import Final

from bayes_asv.domain.channels.channel import Channel

__all__ = ["GROUP"]

GROUP: Final = (
    Channel("front_wheel", "acceleration", "wheel", "front"),
    Channel("front_chassis", "acceleration", "body", "front"),
    Channel("rear_wheel", "acceleration", "wheel", "rear"),
    Channel("rear_chassis", "acceleration", "body", "rear"),
)
