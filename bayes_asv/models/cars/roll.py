"""The roll car that the reference proposes (section 8.3.2): heave, pitch and roll on four wheels.

Each corner has a damper and a spring of its own; rates of the vehicle file, which are those of an
axle, are halved.  The springs of an axle share one unknown, what is common to both sides, and have
another for what differs, both as wide as the file says of the axle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.errors import InputError
from bayes_asv.models.car_model import (
    DAMPING_FACTOR,
    INERTIA_FACTOR,
    CarModel,
    CarParameter,
    Element,
    Values,
    constant,
    estimated,
    given,
    prior_log_sd,
)
from bayes_asv.models.cars.half import ahead

if TYPE_CHECKING:
    from bayes_asv.domain.channels import Channel
    from bayes_asv.domain.vehicle import Vehicle

__all__ = ["roll_car"]

Array = NDArray[np.float64]

_CORNERS = (("front", "left"), ("front", "right"), ("rear", "left"), ("rear", "right"))


def _inertia(values: Values) -> Array:
    return np.stack([values["m"], values["i"], values["i_roll"]], axis=1)


def _row(x: Array, y: Array) -> Array:
    """Heights (W, 3) of a place x ahead of and y to the left of the centre of gravity."""
    return np.stack([np.ones_like(x), x, y], axis=1)


def _heights(values: Values) -> Array:
    l_f, l_r = values["l"] * (1.0 - values["wdf"]), values["l"] * values["wdf"]
    half_f, half_r = 0.5 * values["t_f"], 0.5 * values["t_r"]
    return np.stack(
        [_row(l_f, half_f), _row(l_f, -half_f), _row(-l_r, half_r), _row(-l_r, -half_r)], axis=1
    )


def _point(values: Values, channel: Channel) -> Array:
    x = ahead(values, channel)
    if channel.side is None:
        return _row(x, np.zeros_like(x))
    apart = values["s_f"] if channel.axle == "front" else values["t_r"]
    return _row(x, (0.5 if channel.side == "left" else -0.5) * apart)


def _bars(values: Values) -> Array:
    """Stiffness of both anti-roll bars: force at either wheel per difference of deflections."""
    out = np.zeros((len(values["m"]), 4, 4))
    for name, a, b in (("bar_f", 0, 1), ("bar_r", 2, 3)):
        out[:, a, a] += values[name]
        out[:, b, b] += values[name]
        out[:, a, b] -= values[name]
        out[:, b, a] -= values[name]
    return out


def _spring(vehicle: Vehicle, end: str, side: str) -> CarParameter:
    rate = getattr(vehicle, f"k_{end}")
    sd, sign = prior_log_sd(rate), 1.0 if side == "l" else -1.0
    terms = ((f"k_{end}", 1.0, sd), (f"split_{end}", sign, sd))
    return CarParameter(f"k_{end}{side}", 0.5 * rate.value, terms)


def roll_car(vehicle: Vehicle) -> CarModel:
    """Return the roll car of a vehicle.

    Raises
    ------
    InputError
        If the vehicle has no ``[roll]``.
    """
    roll = vehicle.roll
    if roll is None:
        raise InputError(
            f"{vehicle.source or 'vehicle'}: [roll]",
            "is missing, and the roll car needs it",
            "add it with front_track, rear_track and inertia",
        )
    track = given("t_f", roll.front_track)
    sensors = (
        CarParameter("s_f", track.nominal, track.terms)  # right above the wheels
        if roll.front_sensors is None
        else constant("s_f", roll.front_sensors)
    )
    dampers = tuple(
        estimated(f"c_{end}{side}", getattr(vehicle, f"c_{end}"), DAMPING_FACTOR, 0.5)
        for end in "fr"
        for side in "lr"
    )
    springs = tuple(_spring(vehicle, end, side) for end in "fr" for side in "lr")
    return CarModel(
        name="roll",
        parameters=(
            *dampers,
            estimated("i", vehicle.i, INERTIA_FACTOR),
            estimated("i_roll", roll.inertia, INERTIA_FACTOR),
            given("m", vehicle.m),
            given("l", vehicle.l),
            given("wdf", vehicle.wdf, kind="fraction"),
            *springs,
            track,
            given("t_r", roll.rear_track),
            constant("bar_f", roll.front_bar),
            constant("bar_r", roll.rear_bar),
            sensors,
        ),
        elements=tuple(
            Element(axle, side, f"c_{axle[0]}{side[0]}", f"k_{axle[0]}{side[0]}")  # type: ignore[arg-type]
            for axle, side in _CORNERS
        ),
        coordinates=("heave", "pitch", "roll"),
        inertia=_inertia,
        heights=_heights,
        point=_point,
        stiffness=_bars,
    )
