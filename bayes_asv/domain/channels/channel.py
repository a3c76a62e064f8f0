"""A channel of a recording: what a sensor measures, where, and what a car model takes it for.

A channel is a value.  Whatever is measured at a wheel hub drives a car model (a *measured input*);
everything else is what the model has to explain (a *measured output*).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from bayes_asv.domain.units import si_unit

__all__ = ["AXLES", "Axis", "Axle", "Channel", "Part", "Quantity", "Side"]

Quantity = Literal["acceleration", "angular_rate", "deflection"]
Part = Literal["wheel", "body", "suspension"]
Axle = Literal["front", "rear"]
Side = Literal["left", "right"]
Axis = Literal["pitch", "roll"]

AXLES: Final[tuple[Axle, ...]] = ("front", "rear")


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
        Coordinate of the body whose rate an angular rate is: pitch is nose-up positive, roll is
        left-side-up positive.  None for everything else.
    """

    name: str
    quantity: Quantity
    part: Part
    axle: Axle | None = None
    side: Side | None = None
    position: float | None = None
    axis: Axis | None = None

    @property
    def is_input(self) -> bool:
        """Whether it drives the car model: the acceleration of a wheel hub does."""
        return self.part == "wheel"

    @property
    def has_own_position(self) -> bool:
        """Whether its sensor may sit anywhere on the body, so that the vehicle file says where."""
        return self.part == "body" and self.quantity == "acceleration" and self.axle is None

    @property
    def words(self) -> str:
        """Its name in words."""
        return self.name.replace("_", " ")

    @property
    def dimension(self) -> str:
        """Physical dimension of its readings, as :mod:`bayes_asv.domain.units` names it."""
        return self.quantity

    @property
    def si_unit(self) -> str:
        """SI unit of its readings."""
        return si_unit(self.dimension)
