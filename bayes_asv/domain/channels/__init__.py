"""The channels that a recording can have, one file a group; to add one, see docs/extending.md.

A reader puts the columns of a file in the order of registration.
"""

from __future__ import annotations

from typing import Final

from bayes_asv.domain.channels import (
    accelerometers,
    body_imu,
    corner_accelerometers,
    suspension_travel,
)
from bayes_asv.domain.channels.channel import Axis, Axle, Channel, Part, Quantity, Side

__all__ = [
    "CHANNELS", "KNOWN_CHANNELS", "ROLL_CHANNELS", "Axis", "Axle", "Channel", "Part", "Quantity",
    "Side", "channel",
]  # fmt: skip

_REGISTERED: Final = {
    one.name: one
    for group in (
        corner_accelerometers.GROUP,
        accelerometers.GROUP,
        suspension_travel.GROUP,
        body_imu.GROUP,
    )
    for one in group
}

KNOWN_CHANNELS: Final = tuple(_REGISTERED)
"""Names of all channels, in the order of files and arrays."""

CHANNELS: Final = tuple(one.name for one in accelerometers.GROUP)
"""Names of the four accelerometers of the half car."""

ROLL_CHANNELS: Final = (*(one.name for one in corner_accelerometers.GROUP), "rear_chassis")
"""Names of the seven accelerometers of the roll car."""


def channel(name: str) -> Channel:
    """Return the channel of a name.

    Raises
    ------
    KeyError
        When there is none.
    """
    return _REGISTERED[name]
