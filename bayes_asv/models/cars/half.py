"""The half car: heave and pitch on two axles, both sides of an axle together."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bayes_asv.models.car_model import (
    DAMPING_FACTOR,
    INERTIA_FACTOR,
    CarModel,
    Element,
    Values,
    estimated,
    given,
)

if TYPE_CHECKING:
    from bayes_asv.domain.channels import Channel
    from bayes_asv.domain.vehicle import Vehicle

__all__ = ["ahead", "half_car"]

Array = NDArray[np.float64]


def ahead(values: Values, channel: Channel) -> Array:
    """Distance (W,) of a place on the body ahead of the centre of gravity, m."""
    if channel.position is not None:
        return channel.position - values["l"] * values["wdf"]
    if channel.axle == "front":
        return values["l"] * (1.0 - values["wdf"])
    return -values["l"] * values["wdf"]


def _inertia(values: Values) -> Array:
    return np.stack([values["m"], values["i"]], axis=1)


def _heights(values: Values) -> Array:
    l_f, l_r = values["l"] * (1.0 - values["wdf"]), values["l"] * values["wdf"]
    one = np.ones_like(l_f)
    return np.stack([np.stack([one, l_f], axis=1), np.stack([one, -l_r], axis=1)], axis=1)


def _point(values: Values, channel: Channel) -> Array:
    x = ahead(values, channel)
    return np.stack([np.ones_like(x), x], axis=1)


def _derived(values: Values) -> Values:
    """Radius of gyration and the damping ratio of each axle alone (App. C.1 of the reference)."""
    front, rear = values["wdf"] * values["m"], (1.0 - values["wdf"]) * values["m"]
    return {
        "k_g": np.sqrt(values["i"] / values["m"]),
        "zeta_f": values["c_f"] / (2.0 * np.sqrt(values["k_f"] * front)),
        "zeta_r": values["c_r"] / (2.0 * np.sqrt(values["k_r"] * rear)),
    }


def half_car(vehicle: Vehicle) -> CarModel:
    """Return the half car of a vehicle."""
    return CarModel(
        name="half",
        parameters=(
            estimated("c_f", vehicle.c_f, DAMPING_FACTOR),
            estimated("c_r", vehicle.c_r, DAMPING_FACTOR),
            estimated("i", vehicle.i, INERTIA_FACTOR),
            given("m", vehicle.m),
            given("l", vehicle.l),
            given("wdf", vehicle.wdf, kind="fraction"),
            given("k_f", vehicle.k_f),
            given("k_r", vehicle.k_r),
        ),
        elements=(
            Element("front", None, "c_f", "k_f"),
            Element("rear", None, "c_r", "k_r"),
        ),
        coordinates=("heave", "pitch"),
        inertia=_inertia,
        heights=_heights,
        point=_point,
        derived=_derived,
        ratios={"k_g": {"i": 0.5, "m": -0.5}},
    )
