"""What the reference prints: the figures of its tables, and the cars they describe."""

from __future__ import annotations

import math
from typing import Final

from bayes_asv.domain.units import to_si
from bayes_asv.models.half_car import HalfCar

__all__ = [
    "TABLE_41",
    "TABLE_42",
    "TABLE_51",
    "TABLE_51_FOUND",
    "TABLE_71",
    "TABLE_81",
    "UNITS",
    "car_of",
    "car_of_table_41",
    "car_of_table_51",
    "car_of_table_71",
]

UNITS: Final = {
    "m": ("lbf*s^2/in", "mass"),
    "l": ("in", "length"),
    "wdf": ("", "dimensionless"),
    "k_f": ("lbf/in", "stiffness"),
    "k_r": ("lbf/in", "stiffness"),
    "c_f": ("lbf*s/in", "damping"),
    "c_r": ("lbf*s/in", "damping"),
    "i": ("lbf*s^2*in", "pitch_inertia"),
    "k_g": ("in", "length"),
    "zeta_f": ("", "dimensionless"),
    "zeta_r": ("", "dimensionless"),
}
"""Unit and dimension of every quantity.  The reference writes lb for pounds force."""

TABLE_41: Final = {
    "m": 2.0, "k_g": 20.0, "wdf": 0.4, "l": 60.0, "k_f": 60.0, "k_r": 60.0,
    "zeta_f": 0.1, "zeta_r": 0.1,
}  # fmt: skip
"""The car on which the spectrum was tried."""

TABLE_42: Final = {
    "damped": (1.11, 1.57),
    "ratio": (0.099, 0.149),
    "natural": (1.23, 1.85),
}
"""Its modes, slow and fast: frequencies in Hz."""

TABLE_51: Final = {
    "m": 1.3587, "wdf": 0.47, "l": 66.0, "k_f": 100.0, "k_r": 100.0,
    "k_g": 10.0, "zeta_f": 0.7, "zeta_r": 0.5,
}  # fmt: skip
"""The car on which the grey box was tried."""

TABLE_51_FOUND: Final = {"k_g": 9.985, "zeta_f": 0.7176, "zeta_r": 0.5108}
"""What the grey box made of it."""

TABLE_71: Final = {
    "m": 1.294, "k_g": 22.0, "i": 626.0, "wdf": 0.47, "l": 68.0, "k_f": 100.0, "k_r": 100.0,
    "c_f": 7.2, "c_r": 10.0, "zeta_f": 0.461, "zeta_r": 0.603,
}  # fmt: skip
"""The 2008 Baja car."""

TABLE_81: Final = {
    "i": (796.0, 667.0, 626.0),
    "c_f": (9.2, 8.3, 7.2),
    "c_r": (10.4, 12.4, 10.0),
    "k_g": (24.8, 22.7, 22.0),
}
"""Its result: from 400 Hz data, from 800 Hz data, and the 2008 Baja car."""


def car_of(figures: dict[str, float]) -> HalfCar:
    """Turn printed figures into a car.

    Parameters
    ----------
    figures : dict of str to float
        In the units of :data:`UNITS`.  Without ``i`` it follows from ``k_g``, without a damping
        rate from its ratio, ``c = 2 ζ √(k m_axle)`` (App. C.1).

    Returns
    -------
    HalfCar
        SI units.
    """
    m, wdf = figures["m"], figures["wdf"]
    front = 2.0 * math.sqrt(figures["k_f"] * m * wdf)
    rear = 2.0 * math.sqrt(figures["k_r"] * m * (1.0 - wdf))
    whole = {
        "c_f": figures["c_f"] if "c_f" in figures else figures["zeta_f"] * front,
        "c_r": figures["c_r"] if "c_r" in figures else figures["zeta_r"] * rear,
        "i": figures["i"] if "i" in figures else m * figures["k_g"] ** 2,
        **{name: figures[name] for name in ("m", "l", "wdf", "k_f", "k_r")},
    }
    return HalfCar(**{name: to_si(value, *UNITS[name]) for name, value in whole.items()})


def car_of_table_41(ratio: float = 0.1) -> HalfCar:
    """Return the car of Table 4.1, both axles damped to a ratio (chapter 4: 0.1, 0.3, 0.7)."""
    return car_of({**TABLE_41, "zeta_f": ratio, "zeta_r": ratio})


def car_of_table_51() -> HalfCar:
    """Return the simulated car of Table 5.1."""
    return car_of(TABLE_51)


def car_of_table_71() -> HalfCar:
    """Return the Baja car of Table 7.1."""
    return car_of(TABLE_71)
