"""Wrong given values: a factor on an axle's spring rate or on the front weight fraction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bayes_asv.models.effects.base import AXLES, Effect, Parameter

if TYPE_CHECKING:
    from bayes_asv.models.car_model import CarModel

__all__ = ["SPRING_RATE", "WEIGHT_DISTRIBUTION"]

Array = NDArray[np.float64]


def _spring(
    car: dict[str, Array], values: Mapping[str, Array], where: str, model: CarModel
) -> None:
    for e in model.elements_at(where):
        name = model.elements[e].spring
        car[name] = car[name] * values["factor"]


def _weight(
    car: dict[str, Array], values: Mapping[str, Array], where: str, model: CarModel
) -> None:
    """Shift the weight fraction by a share of its nominal value.

    A factor on the fraction itself would make the joint posterior of the two a curved ridge.
    """
    for parameter in model.parameters:
        if parameter.kind == "fraction":
            shift = parameter.nominal * (values["factor"] - 1.0)
            car[parameter.name] = car[parameter.name] + shift


SPRING_RATE = Effect(
    name="spring_rate",
    title="a spring rate that is not the given one",
    acts="car",
    allowed_places=AXLES,
    parameters=(Parameter("factor", "", "log", 1.0, 0.3, (1.0,)),),
    tolerance_values={"factor": 1.003},
    on_car=_spring,
    drive="a long ride at the frequency of the body's own motion",
)
WEIGHT_DISTRIBUTION = Effect(
    name="weight_distribution",
    title="a weight distribution that is not the given one",
    acts="car",
    allowed_places=("",),
    parameters=(Parameter("factor", "", "log", 1.0, 0.1, (1.0,)),),
    tolerance_values={"factor": 1.002},
    on_car=_weight,
    drive="front and rear over bumps one at a time",
)
