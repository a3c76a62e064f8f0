"""Channels of a recording: what a sensor measures, where, and what a car model takes it for.

A channel is a value.  Whatever is measured at a wheel hub drives a car model (a *measured input*);
everything else is what the model has to explain (a *measured output*).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

__all__ = [
    "BODY_CHANNELS", "CHANNELS", "DEFAULT_CHANNELS", "KNOWN_CHANNELS", "ROLL_CHANNELS",
    "TRAVEL_CHANNELS", "Channel", "channel",
]  # fmt: skip

Quantity = Literal["acceleration", "angular_rate", "deflection"]
Axle = Literal["front", "rear"]
Side = Literal["left", "right"]
Axis = Literal["pitch", "roll"]


@dataclass(frozen=True, slots=True)
class Channel:
    """One measured quantity at one place.

    Parameters
    ----------
    name : str
        As in files and reports, for example ``front_wheel``.
    quantity : {'acceleration', 'angular_rate', 'deflection'}
        Vertical acceleration (m/s², upward positive), angular rate of the body (rad/s), or
        suspension deflection (m, extension positive).
    part : {'wheel', 'body', 'suspension'}
        A wheel hub, the body, or the suspension between the two.
    axle : {'front', 'rear'} or None
        Axle of a wheel or a suspension, or the axle above which a sensor sits on the body.
    side : {'left', 'right'} or None
        Side of the car; None for an axle as a whole, and for the middle of the body.
    position : float or None
        Place on the body where it is not above an axle, m ahead of the rear axle.
    axis : {'pitch', 'roll'} or None
        Coordinate of the body whose rate an angular rate is, with its sign; pitch is nose-up
        positive.  None for everything else.
    """

    name: str
    quantity: Quantity
    part: Literal["wheel", "body", "suspension"]
    axle: Axle | None = None
    side: Side | None = None
    position: float | None = None
    axis: Axis | None = None

    @property
    def is_input(self) -> bool:
        """Whether it drives the car model: the acceleration of a wheel hub does."""
        return self.part == "wheel"

    @property
    def words(self) -> str:
        """Its name in words."""
        return self.name.replace("_", " ")

    @property
    def dimension(self) -> str:
        """Physical dimension of its readings, as :mod:`bayes_asv.domain.units` names it."""
        return "deflection" if self.quantity == "deflection" else self.quantity

    @property
    def si_unit(self) -> str:
        """SI unit of its readings."""
        return {"acceleration": "m/s^2", "angular_rate": "rad/s", "deflection": "m"}[self.quantity]


def _wheel(axle: Axle, side: Side | None = None) -> Channel:
    name = f"{axle}_wheel" if side is None else f"{axle}_{side}_wheel"
    return Channel(name, "acceleration", "wheel", axle, side)


def _body(axle: Axle, side: Side | None = None) -> Channel:
    name = f"{axle}_chassis" if side is None else f"{axle}_{side}_chassis"
    return Channel(name, "acceleration", "body", axle, side)


def _travel(axle: Axle, side: Side | None = None) -> Channel:
    name = f"{axle}_travel" if side is None else f"{axle}_{side}_travel"
    return Channel(name, "deflection", "suspension", axle, side)


DEFAULT_CHANNELS: Final = (_wheel("front"), _body("front"), _wheel("rear"), _body("rear"))
"""Four accelerometers of a half car: wheel hub and body above each axle."""

ROLL_CAR_CHANNELS: Final = (
    _wheel("front", "left"),
    _wheel("front", "right"),
    _wheel("rear", "left"),
    _wheel("rear", "right"),
    _body("front", "left"),
    _body("front", "right"),
    _body("rear"),
)
"""Seven accelerometers of a car that rolls: one a wheel, three on the body."""

TRAVEL_CHANNELS: Final = (
    _travel("front"),
    _travel("rear"),
    _travel("front", "left"),
    _travel("front", "right"),
    _travel("rear", "left"),
    _travel("rear", "right"),
)
"""Suspension deflections of an axle or of a corner, at the wheel."""

BODY_CHANNELS: Final = (
    Channel("body_vertical", "acceleration", "body"),
    Channel("body_pitch_rate", "angular_rate", "body", axis="pitch"),
)
"""An inertial unit on the body; its place is given by the vehicle file."""

_KNOWN: Final = {
    one.name: one
    for one in (*DEFAULT_CHANNELS, *ROLL_CAR_CHANNELS, *TRAVEL_CHANNELS, *BODY_CHANNELS)
}

CHANNELS: Final = tuple(one.name for one in DEFAULT_CHANNELS)
"""Names of the default channels, in the order used in files and in arrays."""

ROLL_CHANNELS: Final = tuple(one.name for one in ROLL_CAR_CHANNELS)
"""Names of the channels of a car that rolls."""


KNOWN_CHANNELS: Final = tuple(_KNOWN)
"""Names of all channels, in the order in which a reader puts those of a half car."""


def channel(name: str) -> Channel:
    """Return the channel of a name.

    Raises
    ------
    KeyError
        When there is none.
    """
    return _KNOWN[name]
