"""Families of small cars: what is true of a car, and what its owner knows about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .kinds import Span, Vector

__all__ = ["FAMILIES", "GRAVITY", "Car", "Family", "draw_car", "geometry"]

GRAVITY = 9.80665
"""Standard gravity, m/s²."""


@dataclass(frozen=True)
class Car:
    """A half car on tyres. Rates are of both sides of an axle together, at the wheel.

    ``m`` sprung mass (kg), ``wheelbase`` (m), ``wdf`` front weight fraction, ``k`` spring rates
    (N/m), ``c`` damping rates (N·s/m), ``i`` pitch inertia (kg·m²), ``unsprung`` masses (kg),
    ``tyre`` rates (N/m) and ``tyre_damping`` (N·s/m); pairs are front and rear.
    """

    m: float
    wheelbase: float
    wdf: float
    k: Span
    c: Span
    i: float
    unsprung: Span
    tyre: Span
    tyre_damping: Span
    height: float

    @property
    def ahead(self) -> float:
        """Distance of the front axle ahead of the centre of gravity, m."""
        return (1.0 - self.wdf) * self.wheelbase

    @property
    def behind(self) -> float:
        """Distance of the rear axle behind the centre of gravity, m."""
        return self.wdf * self.wheelbase

    @property
    def mean_load(self) -> float:
        """Load of the mean axle, sprung mass only, N."""
        return 0.5 * self.m * GRAVITY


def geometry(car: Car) -> Vector:
    """Rows: what heave and pitch move at the front and at the rear axle."""
    return np.array([[1.0, car.ahead], [1.0, -car.behind]])


@dataclass(frozen=True)
class Family:
    """Ranges from which the cars of a family are drawn.

    ``ride`` frequencies of each axle (Hz), ``damping`` ratios, ``index`` i/(m a b), ``hop``
    frequency of the axle on its tyres (Hz), ``unsprung`` mass of an axle (kg), ``travel`` largest
    deflection driven (m), ``sds`` relative standard deviations declared for sprung mass, front
    weight fraction and spring rates, ``units`` those of the vehicle file.
    """

    name: str
    m: Span
    wheelbase: Span
    wdf: Span
    ride: tuple[Span, Span]
    damping: tuple[Span, Span]
    index: Span
    hop: Span
    unsprung: tuple[Span, Span]
    height: Span
    travel: Span
    sds: tuple[Span, Span, Span]
    units: str


FAMILIES: dict[str, Family] = {
    family.name: family
    for family in (
        Family(
            "golf cart",
            (370.0, 520.0), (1.62, 1.76), (0.40, 0.46),
            ((1.7, 2.2), (1.8, 2.3)), ((0.16, 0.30), (0.18, 0.32)), (0.85, 1.20),
            (10.0, 13.5), ((26.0, 34.0), (40.0, 54.0)), (0.55, 0.70), (0.025, 0.050),
            ((0.008, 0.014), (0.008, 0.014), (0.04, 0.07)), "US",
        ),
        Family(
            "cross kart",
            (285.0, 345.0), (1.74, 1.92), (0.39, 0.45),
            ((1.9, 2.5), (2.1, 2.7)), ((0.35, 0.58), (0.35, 0.58)), (0.62, 0.88),
            (11.0, 14.5), ((30.0, 38.0), (36.0, 46.0)), (0.34, 0.42), (0.040, 0.080),
            ((0.005, 0.010), (0.006, 0.012), (0.03, 0.05)), "SI mm",
        ),
        Family(
            "solar racer",
            (185.0, 255.0), (2.30, 2.75), (0.50, 0.62),
            ((1.9, 2.6), (2.0, 2.8)), ((0.18, 0.34), (0.18, 0.34)), (0.45, 0.68),
            (13.0, 17.0), ((14.0, 22.0), (12.0, 18.0)), (0.40, 0.52), (0.015, 0.032),
            ((0.004, 0.008), (0.005, 0.009), (0.02, 0.05)), "SI",
        ),
        Family(
            "tandem city car",
            (455.0, 570.0), (1.62, 1.78), (0.41, 0.47),
            ((1.6, 2.0), (1.75, 2.2)), ((0.22, 0.36), (0.24, 0.38)), (0.70, 0.98),
            (11.0, 14.0), ((34.0, 44.0), (46.0, 58.0)), (0.50, 0.60), (0.030, 0.055),
            ((0.005, 0.010), (0.006, 0.010), (0.03, 0.06)), "SI mm",
        ),
        Family(
            "kei van",
            (690.0, 860.0), (2.20, 2.46), (0.50, 0.57),
            ((1.3, 1.65), (1.4, 1.85)), ((0.20, 0.32), (0.18, 0.30)), (0.95, 1.28),
            (10.0, 12.5), ((58.0, 74.0), (66.0, 86.0)), (0.60, 0.74), (0.040, 0.070),
            ((0.006, 0.012), (0.006, 0.012), (0.05, 0.08)), "SI",
        ),
        Family(
            "hill-climb single-seater",
            (330.0, 430.0), (2.20, 2.48), (0.39, 0.45),
            ((2.7, 3.5), (2.8, 3.7)), ((0.42, 0.68), (0.42, 0.68)), (0.52, 0.74),
            (14.0, 18.0), ((30.0, 38.0), (34.0, 44.0)), (0.28, 0.34), (0.014, 0.028),
            ((0.004, 0.008), (0.005, 0.010), (0.02, 0.04)), "SI",
        ),
        Family(
            "side-by-side",
            (560.0, 720.0), (2.02, 2.42), (0.42, 0.48),
            ((1.15, 1.5), (1.25, 1.65)), ((0.26, 0.44), (0.28, 0.46)), (0.78, 1.05),
            (8.5, 11.0), ((62.0, 78.0), (70.0, 90.0)), (0.62, 0.76), (0.060, 0.110),
            ((0.008, 0.015), (0.008, 0.015), (0.04, 0.07)), "US",
        ),
        Family(
            "velomobile",
            (96.0, 128.0), (1.24, 1.42), (0.56, 0.66),
            ((2.2, 2.9), (2.3, 3.1)), ((0.14, 0.28), (0.14, 0.28)), (0.55, 0.80),
            (14.0, 19.0), ((7.0, 11.0), (4.5, 7.0)), (0.40, 0.50), (0.014, 0.030),
            ((0.005, 0.010), (0.008, 0.014), (0.04, 0.07)), "SI mm",
        ),
    )
}  # fmt: skip


def draw_car(family: Family, rng: np.random.Generator) -> Car:
    """Draw a car of a family."""

    def pick(span: Span) -> float:
        return float(rng.uniform(*span))

    m, length, wdf = pick(family.m), round(pick(family.wheelbase), 3), pick(family.wdf)
    corner = (m * wdf, m * (1.0 - wdf))
    omega = (2.0 * np.pi * pick(family.ride[0]), 2.0 * np.pi * pick(family.ride[1]))
    ratio = (pick(family.damping[0]), pick(family.damping[1]))
    unsprung = (pick(family.unsprung[0]), pick(family.unsprung[1]))
    hop = (2.0 * np.pi * pick(family.hop), 2.0 * np.pi * pick(family.hop))
    k = (corner[0] * omega[0] ** 2, corner[1] * omega[1] ** 2)
    c = (2.0 * ratio[0] * corner[0] * omega[0], 2.0 * ratio[1] * corner[1] * omega[1])
    tyre = (unsprung[0] * hop[0] ** 2 - k[0], unsprung[1] * hop[1] ** 2 - k[1])
    tyre = (max(tyre[0], 4.0 * k[0]), max(tyre[1], 4.0 * k[1]))
    loss = rng.uniform(0.02, 0.05, 2)
    tyre_damping = (
        float(2.0 * loss[0] * np.sqrt(tyre[0] * unsprung[0])),
        float(2.0 * loss[1] * np.sqrt(tyre[1] * unsprung[1])),
    )
    i = pick(family.index) * m * (1.0 - wdf) * wdf * length**2
    return Car(m, length, wdf, k, c, i, unsprung, tyre, tyre_damping, pick(family.height))
