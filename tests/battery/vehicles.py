"""Vehicle families of the battery: those of development, and others for the test only."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np

from tests.rig import RigCar, baja, table51

__all__ = ["FAMILIES", "Family", "Fleet", "nominal_car"]

Fleet = Literal["dev", "test"]


@dataclass(frozen=True)
class Family:
    """A family of cars.

    Parameters
    ----------
    car : callable
        Returns its typical member.
    travel : float
        Largest suspension deflection of a drive, m.
    """

    car: Callable[[], RigCar]
    travel: float


def _of(
    name: str, *, m: float, wdf: float, l: float, ride: tuple[float, float],
    zeta: tuple[float, float], gyration: float, unsprung: float, tyre: float,
    radius: float, patch: float,
) -> RigCar:  # fmt: skip
    """Build a car from ride frequencies (Hz), damping ratios and its radius of gyration (m).

    ``unsprung`` is the share of an axle's sprung mass, ``tyre`` its stiffness over the spring's.
    """
    axles = (m * wdf, m * (1.0 - wdf))
    k_f, k_r = (a * (2.0 * math.pi * f) ** 2 for a, f in zip(axles, ride, strict=True))
    c_f, c_r = (2.0 * z * math.sqrt(k * a) for z, k, a in zip(zeta, (k_f, k_r), axles, strict=True))
    return RigCar(
        name=name, m=m, wdf=wdf, l=l, k_f=k_f, k_r=k_r, c_f=c_f, c_r=c_r, i=m * gyration**2,
        m_uf=unsprung * axles[0], m_ur=unsprung * axles[1], k_tf=tyre * k_f, k_tr=tyre * k_r,
        c_tf=0.01 * c_f * tyre, c_tr=0.01 * c_r * tyre, tyre_radius=radius, contact_patch=patch,
    )  # fmt: skip


def _city_car() -> RigCar:
    return _of("city car", m=760.0, wdf=0.6, l=2.35, ride=(1.35, 1.6), zeta=(0.3, 0.28),
               gyration=1.05, unsprung=0.13, tyre=8.0, radius=0.28, patch=0.14)  # fmt: skip


def _hill_climber() -> RigCar:
    return _of("hill climber", m=330.0, wdf=0.44, l=2.0, ride=(2.4, 2.6), zeta=(0.5, 0.55),
               gyration=0.75, unsprung=0.17, tyre=4.5, radius=0.27, patch=0.13)  # fmt: skip


def _hatchback() -> RigCar:
    return _of("hatchback", m=1080.0, wdf=0.57, l=2.55, ride=(1.25, 1.45), zeta=(0.33, 0.3),
               gyration=1.2, unsprung=0.12, tyre=8.5, radius=0.3, patch=0.16)  # fmt: skip


def _formula() -> RigCar:
    return _of("formula", m=205.0, wdf=0.47, l=1.58, ride=(3.0, 3.3), zeta=(0.55, 0.6),
               gyration=0.6, unsprung=0.22, tyre=5.0, radius=0.25, patch=0.12)  # fmt: skip


def _buggy() -> RigCar:
    return _of("long-travel buggy", m=520.0, wdf=0.41, l=2.6, ride=(1.5, 1.7), zeta=(0.4, 0.45),
               gyration=0.98, unsprung=0.2, tyre=6.5, radius=0.36, patch=0.25)  # fmt: skip


FAMILIES: Final[Mapping[Fleet, Mapping[str, Family]]] = {
    "dev": {
        "baja": Family(baja, 0.1),
        "city car": Family(_city_car, 0.07),
        "hill climber": Family(_hill_climber, 0.05),
    },
    "test": {
        "table 5.1": Family(table51, 0.07),
        "hatchback": Family(_hatchback, 0.07),
        "formula": Family(_formula, 0.03),
        "buggy": Family(_buggy, 0.14),
    },
}
"""Families by fleet; disjoint."""


def nominal_car(family: Family, rng: np.random.Generator) -> RigCar:
    """Draw the nominal car of a team: a member of the family.

    Mass and springs 10 %, wheel base 4 %, dampers 15 %, inertia 10 % (log-normal), weight
    fraction 0.015; unsprung masses and tyres 15 %.
    """
    car = family.car()

    def about(value: float, spread: float) -> float:
        return value * math.exp(spread * float(rng.standard_normal()))

    spreads = {"m": 0.1, "l": 0.04, "k_f": 0.1, "k_r": 0.1, "c_f": 0.15, "c_r": 0.15, "i": 0.1,
               "m_uf": 0.15, "m_ur": 0.15, "k_tf": 0.15, "k_tr": 0.15}  # fmt: skip
    drawn: dict[str, Any] = {
        key: about(getattr(car, key), spread) for key, spread in spreads.items()
    }
    wdf = float(np.clip(car.wdf + 0.015 * rng.standard_normal(), 0.35, 0.65))
    return replace(car, wdf=wdf, **drawn)
