"""The channels that a recording can have, one file a group; to add one, see docs/extending.md.

A reader puts the columns of a file in the order of registration.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from bayes_asv.domain.channels import (
    accelerometers,
    body_imu,
    corner_accelerometers,
    suspension_travel,
)
from bayes_asv.domain.channels.channel import AXLES, Axis, Axle, Channel, Part, Quantity, Side

__all__ = [
    "AXLES", "CHANNELS", "KNOWN_CHANNELS", "ROLL_CHANNELS", "Axis", "Axle", "Channel", "Part",
    "Quantity", "Side", "channel", "missing_inputs",
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


def missing_inputs(names: Collection[str]) -> tuple[str, ...]:
    """Return the wheel hubs without which no car model can explain the channels of a recording.

    The hubs are those of the axles or, where most of those measured are, those of the corners.
    One axle alone is a quarter car: then everything else has to be measured on it as well.
    """
    measured = [channel(name) for name in names]
    hubs = [one for one in measured if one.is_input]
    sides = [one.side is not None for one in hubs or measured]
    corners = 2 * sum(sides) > len(sides)
    needed = [
        one for one in _REGISTERED.values() if one.is_input and (one.side is not None) == corners
    ]
    missing = [one for one in needed if one.name not in names]
    others = [one for one in measured if not one.is_input]
    if hubs and others and not corners and {one.axle for one in measured} == {hubs[0].axle}:
        return ()
    return tuple(one.name for one in missing)
