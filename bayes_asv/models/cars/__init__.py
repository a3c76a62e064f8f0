"""Cars that can be estimated, one file each, behind :class:`bayes_asv.models.car_model.CarModel`.

To add one, write a file with a function from a vehicle to its model and list it in `CARS`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from bayes_asv.models.cars import half, quarter, roll

if TYPE_CHECKING:
    from bayes_asv.domain.vehicle import Vehicle
    from bayes_asv.models.car_model import CarModel

__all__ = ["CARS", "car_model"]

CARS: Final[dict[str, Callable[[Vehicle], CarModel]]] = {
    "half": half.half_car,
    "quarter-front": quarter.front_quarter_car,
    "quarter-rear": quarter.rear_quarter_car,
    "roll": roll.roll_car,
}
"""Cars by the name that ``--car`` takes."""


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
