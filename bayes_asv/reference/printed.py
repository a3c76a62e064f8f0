"""Printed figures of the reference's tables, the cars they describe, and its errata."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from bayes_asv.domain.units import to_si
from bayes_asv.models.half_car_equations import HalfCar

__all__ = [
    "TABLE_41",
    "TABLE_42",
    "TABLE_51",
    "TABLE_51_FOUND",
    "TABLE_71",
    "TABLE_81",
    "UNITS",
    "Erratum",
    "car_of_table_41",
    "car_of_table_51",
    "car_of_table_71",
    "errata",
    "half_car_from",
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
"""Car of the spectral study."""

TABLE_42: Final = {
    "damped": (1.11, 1.57),
    "ratio": (0.099, 0.149),
    "natural": (1.23, 1.85),
}
"""Modes of that car, slow and fast: frequencies in Hz."""

TABLE_51: Final = {
    "m": 1.3587, "wdf": 0.47, "l": 66.0, "k_f": 100.0, "k_r": 100.0,
    "k_g": 10.0, "zeta_f": 0.7, "zeta_r": 0.5,
}  # fmt: skip
"""Car of the grey-box study."""

TABLE_51_FOUND: Final = {"k_g": 9.985, "zeta_f": 0.7176, "zeta_r": 0.5108}
"""Grey-box estimates of that car."""

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
"""Results: from 400 Hz data, from 800 Hz data, and the values of the 2008 Baja car."""


def half_car_from(figures: dict[str, float]) -> HalfCar:
    """Convert printed figures to a half car.

    Parameters
    ----------
    figures : dict of str to float
        In the units of :data:`UNITS`.  A missing ``i`` is computed from ``k_g``, a missing damping
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
    """Return the car of Table 4.1 with both axles at a damping ratio (chapter 4: 0.1, 0.3, 0.7)."""
    return half_car_from({**TABLE_41, "zeta_f": ratio, "zeta_r": ratio})


def car_of_table_51() -> HalfCar:
    """Return the simulated car of Table 5.1."""
    return half_car_from(TABLE_51)


def car_of_table_71() -> HalfCar:
    """Return the Baja car of Table 7.1."""
    return half_car_from(TABLE_71)


class Erratum(NamedTuple):
    """One erratum: place, printed and correct statement, and reason."""

    where: str
    printed: str
    right: str
    why: str


_ERRATA: Final = (
    Erratum(
        "Section 2.2, chassis modes", "bounce, pitch, roll, warp", "bounce, pitch, roll",
        "a rigid chassis has three; in warp the front and rear axles tilt against each other",
    ),
    Erratum(
        "Fig. 3.2, F_r", "lever l_f", "lever l_r",
        "the rear axle is l_r from the centre of gravity; App. C.2 is correct",
    ),
    Erratum(
        "Fig. 3.2, eq. 3.1", "θ nose-down", "θ nose-up",
        "eq. 5.5 and 6.1 are nose-up: x_f = x + l_f θ, x_r = x − l_r θ, i θ̈ = l_f F_f − l_r F_r",
    ),
    Erratum(
        "Eq. 6.2", "(wdf x_f + (1−wdf) x_r) / l", "wdf x_f + (1−wdf) x_r",
        "a weighted mean of two displacements is a displacement",
    ),
    Erratum(
        "Table 4.2, natural frequencies", "1.23 and 1.85 Hz", "1.193 and 1.911 Hz",
        "the mass matrix of App. C.1 has m/4 whatever wdf is",
    ),
    Erratum(
        "Table 4.2, damped frequencies", "1.11 and 1.57 Hz", "1.187 and 1.891 Hz",
        "ω(1−ζ) instead of ω√(1−ζ²)",
    ),
    Erratum(
        "Chapter 4, 70 % damping", "second mode critically damped", "overdamped",
        "two real poles, at 1.51 and 2.35 Hz",
    ),
    Erratum(
        "Section 6.3.3, interval", "(OCR1A − 1) / f_timer", "(OCR1A + 1) / f_timer",
        "a timer that counts from zero to OCR1A takes OCR1A + 1 cycles",
    ),
    Erratum(
        "Section 6.3.3, channel offset", "well below 1 % of 1 ms", "0.675 ms",
        "App. C.2 puts the chassis channels 0.675 ms later, half a sample at 800 Hz",
    ),
    Erratum(
        "Section 8.1, 800 Hz data", "a constant chosen by hand", "a bias that is estimated",
        "a bias is a property of the sensor and belongs in the model with its uncertainty",
    ),
    Erratum(
        "Table A.1", "Audio, MAX9814L01, by Nordic", "nRF24L01 radio",
        "the part by Nordic in section 6.2.3",
    ),
)  # fmt: skip


def errata() -> tuple[Erratum, ...]:
    """Return all errata, in the order of the reference."""
    return _ERRATA
