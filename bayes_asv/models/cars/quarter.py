"""The quarter car: the sprung mass of one axle on its suspension, without pitch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from bayes_asv.models.car_model import DAMPING_FACTOR, CarModel, Element, Values, estimated, given

if TYPE_CHECKING:
    from bayes_asv.domain.channels import Channel
    from bayes_asv.domain.vehicle import Vehicle

__all__ = ["front_quarter_car", "rear_quarter_car"]

Array = NDArray[np.float64]


def _mass(values: Values, axle: str) -> Array:
    share = values["wdf"] if axle == "front" else 1.0 - values["wdf"]
    return values["m"] * share


def _heave(values: Values) -> Array:
    return np.ones((len(values["m"]), 1, 1))


def _point(values: Values, channel: Channel) -> Array:
    return np.ones((len(values["m"]), 1))


def _quarter_car(vehicle: Vehicle, axle: Literal["front", "rear"]) -> CarModel:
    end = axle[0]
    damping, spring = f"c_{end}", f"k_{end}"

    def derived(values: Values) -> Values:
        critical = 2.0 * np.sqrt(values[spring] * _mass(values, axle))
        return {f"zeta_{end}": values[damping] / critical}

    return CarModel(
        name=f"quarter-{axle}",
        parameters=(
            estimated(damping, getattr(vehicle, damping), DAMPING_FACTOR),
            given("m", vehicle.m),
            given("wdf", vehicle.wdf, kind="fraction"),
            given(spring, getattr(vehicle, spring)),
        ),
        elements=(Element(axle, None, damping, spring),),
        coordinates=("heave",),
        inertia=lambda values: _mass(values, axle)[:, None],
        heights=_heave,
        point=_point,
        derived=derived,
    )


def front_quarter_car(vehicle: Vehicle) -> CarModel:
    """Return the front axle of a vehicle as a quarter car."""
    return _quarter_car(vehicle, "front")


def rear_quarter_car(vehicle: Vehicle) -> CarModel:
    """Return the rear axle of a vehicle as a quarter car."""
    return _quarter_car(vehicle, "rear")
