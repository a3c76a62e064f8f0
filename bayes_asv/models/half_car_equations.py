"""The linear half car, in deflection coordinates and in the reference's own.

Suspension forces depend on deflection only, so absolute position never enters: with the
wheel accelerations as inputs and the chassis accelerations as outputs the car is a stable
system of four states, and nothing is integrated twice.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["HalfCar", "LinearSystem", "deflection_form", "position_form"]

Array = NDArray[np.float64]


class HalfCar(NamedTuple):
    """Physical parameters of the half car, both sides of an axle lumped, in SI units.

    Parameters
    ----------
    c_f, c_r : float
        Damping rates of the front and rear suspension, N·s/m.
    i : float
        Pitch inertia of the sprung mass about its centre of gravity, kg·m².
    m : float
        Sprung mass, kg.
    l : float
        Wheel base, m.
    wdf : float
        Share of the sprung weight on the front axle.
    k_f, k_r : float
        Spring rates of the front and rear suspension, N/m.
    """

    c_f: float
    c_r: float
    i: float
    m: float
    l: float
    wdf: float
    k_f: float
    k_r: float

    @property
    def l_f(self) -> float:
        """Distance from the centre of gravity to the front axle, m."""
        return self.l * (1.0 - self.wdf)

    @property
    def l_r(self) -> float:
        """Distance from the centre of gravity to the rear axle, m."""
        return self.l * self.wdf

    @property
    def k_g(self) -> float:
        """Radius of gyration in pitch, m."""
        return float(np.sqrt(self.i / self.m))

    @property
    def zeta_f(self) -> float:
        """Damping ratio of the front axle alone, c_f / (2 √(k_f m wdf)) (App. C.1)."""
        return float(self.c_f / (2.0 * np.sqrt(self.k_f * self.m * self.wdf)))

    @property
    def zeta_r(self) -> float:
        """Damping ratio of the rear axle alone, c_r / (2 √(k_r m (1 − wdf))) (App. C.1)."""
        return float(self.c_r / (2.0 * np.sqrt(self.k_r * self.m * (1.0 - self.wdf))))


class LinearSystem(NamedTuple):
    """ẋ = A x + B u,  y = C x + D u."""

    A: Array
    B: Array
    C: Array
    D: Array


def deflection_form(car: HalfCar) -> LinearSystem:
    """State (δ_f, δ̇_f, δ_r, δ̇_r), input wheel, output chassis accelerations.

    With δ = chassis minus wheel (extension positive)::

        F_f = −k_f δ_f − c_f δ̇_f                     F_r = −k_r δ_r − c_r δ̇_r
        a_f = (1/m + l_f²/i) F_f + (1/m − l_f l_r/i) F_r
        a_r = (1/m − l_f l_r/i) F_f + (1/m + l_r²/i) F_r
        δ̈_f = a_f − ü_f                              δ̈_r = a_r − ü_r

    It follows from eq. 3.1 of the reference with θ nose-up (its Fig. 3.2 has θ nose-down
    and l_f where l_r belongs) and is the system of its eq. 5.5 in other coordinates.

    Parameters
    ----------
    car : HalfCar
        Parameters in SI units.

    Returns
    -------
    LinearSystem
        A (4, 4), B (4, 2), C (2, 4), D (2, 2); D is zero.
    """
    ff = 1.0 / car.m + car.l_f**2 / car.i
    fr = 1.0 / car.m - car.l_f * car.l_r / car.i
    rr = 1.0 / car.m + car.l_r**2 / car.i
    C = np.array(
        [
            [-ff * car.k_f, -ff * car.c_f, -fr * car.k_r, -fr * car.c_r],
            [-fr * car.k_f, -fr * car.c_f, -rr * car.k_r, -rr * car.c_r],
        ]
    )
    A = np.zeros((4, 4))
    A[0, 1] = A[2, 3] = 1.0
    A[1], A[3] = C[0], C[1]
    B = np.zeros((4, 2))
    B[1, 0] = B[3, 1] = -1.0
    return LinearSystem(A, B, C, np.zeros((2, 2)))


def position_form(car: HalfCar) -> LinearSystem:
    """State (θ, θ̇, x, ẋ), input (u_f, u̇_f, u_r, u̇_r), output the state (eq. 5.5, 5.6).

    θ is the pitch angle, nose-up positive (rad), x the heave of the centre of gravity (m).

    Parameters
    ----------
    car : HalfCar
        Parameters in SI units.

    Returns
    -------
    LinearSystem
        A, B, C, D, each (4, 4).
    """
    c_f, c_r, i, m, _, _, k_f, k_r = car
    l_f, l_r = car.l_f, car.l_r
    A = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [
                -(k_r * l_r**2 + k_f * l_f**2) / i,
                -(c_r * l_r**2 + c_f * l_f**2) / i,
                (k_r * l_r - k_f * l_f) / i,
                (c_r * l_r - c_f * l_f) / i,
            ],
            [0.0, 0.0, 0.0, 1.0],
            [
                (k_r * l_r - k_f * l_f) / m,
                (c_r * l_r - c_f * l_f) / m,
                -(k_r + k_f) / m,
                -(c_r + c_f) / m,
            ],
        ]
    )
    B = np.array(
        [
            [0.0, 0.0, 0.0, 0.0],
            [k_f * l_f / i, c_f * l_f / i, -l_r * k_r / i, -l_r * c_r / i],
            [0.0, 0.0, 0.0, 0.0],
            [k_f / m, c_f / m, k_r / m, c_r / m],
        ]
    )
    return LinearSystem(A, B, np.eye(4), np.zeros((4, 4)))
