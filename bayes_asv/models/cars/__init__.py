"""Cars that can be estimated, one file each, behind :class:`bayes_asv.models.car_model.CarModel`.

To add one, write a file with a function from a vehicle to its model and list it in `CARS` and its
wheels in `WHEELS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Final

from bayes_asv.models.cars import half, quarter, roll

if TYPE_CHECKING:
    from bayes_asv.domain.vehicle import Vehicle
    from bayes_asv.models.car_model import CarModel

__all__ = ["CARS", "WHEELS", "car_model", "cars_with"]

CARS: Final[dict[str, Callable[[Vehicle], CarModel]]] = {
    "half": half.half_car,
    "quarter-front": quarter.front_quarter_car,
    "quarter-rear": quarter.rear_quarter_car,
    "roll": roll.roll_car,
}
"""Cars by the name that ``--car`` takes."""

WHEELS: Final[dict[str, tuple[str, ...]]] = {
    "half": ("front_wheel", "rear_wheel"),
    "quarter-front": ("front_wheel",),
    "quarter-rear": ("rear_wheel",),
    "roll": ("front_left_wheel", "front_right_wheel", "rear_left_wheel", "rear_right_wheel"),
}
"""Channels of the wheel hubs that drive each car."""


def car_model(name: str, vehicle: Vehicle) -> CarModel:
    """Return the model of a car for a vehicle.

    Parameters
    ----------
    name : str
        One of `CARS`.
    vehicle : Vehicle
        Gives nominal and given values.

    Raises
    ------
    KeyError
        For an unknown name.
    InputError
        When the vehicle lacks what the car needs.
    """
    return CARS[name](vehicle)


def cars_with(channels: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the cars all of whose wheel hubs are among channels."""
    there = set(channels)
    return tuple(name for name, wheels in WHEELS.items() if there.issuperset(wheels))
