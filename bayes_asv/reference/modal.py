"""Table 4.2, in the way of App. C.1 and right.

Coordinates are the displacements of the chassis at the front and at the rear axle.  App. C.1 writes
their mass matrix with m/4, which puts the centre of gravity at mid-wheelbase whatever ``wdf``
says, and takes the damped frequency as ω(1−ζ): the square in ``sqrt(1-zeta)^2`` stands outside
the root.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.models.half_car import HalfCar
from bayes_asv.models.modes import Mode
from bayes_asv.models.second_order import second_order_modes

__all__ = ["Frequencies", "axle_matrices", "closed_form", "printed_damped", "printed_matrices"]

Array = NDArray[np.float64]


class Frequencies(NamedTuple):
    """One mode as Table 4.2 tells it: Hz, and the damping ratio."""

    damped: float
    ratio: float
    natural: float


def axle_matrices(car: HalfCar) -> tuple[Array, Array, Array]:
    """M, C, K of the half car in displacements at the axles, SI units.

    With x = wdf·x_f + (1−wdf)·x_r (eq. 6.2 without its division by l) and θ = (x_f − x_r)/l
    (eq. 6.1) the kinetic energy ½mẋ² + ½iθ̇² gives M; springs and dampers act at the axles.
    """
    heave = np.array([car.wdf, 1.0 - car.wdf])
    pitch = np.array([1.0, -1.0]) / car.l
    M = car.m * np.outer(heave, heave) + car.i * np.outer(pitch, pitch)
    return M, np.diag([car.c_f, car.c_r]), np.diag([car.k_f, car.k_r])


def printed_matrices(car: HalfCar) -> tuple[Array, Array, Array]:
    """M, C, K as App. C.1 writes them: M with m/4 throughout."""
    _, C, K = axle_matrices(car)
    turn = car.i / car.l**2
    quarter = car.m / 4.0
    M = np.array([[quarter + turn, quarter - turn], [quarter - turn, quarter + turn]])
    return M, C, K


def printed_damped(mode: Mode) -> float:
    """Damped frequency as App. C.1 has it, ω(1−ζ)/2π, Hz."""
    return mode.natural * (1.0 - mode.ratio)


def printed_way(car: HalfCar) -> tuple[Frequencies, ...]:
    """Table 4.2 in the reference's way."""
    found = second_order_modes(*printed_matrices(car))
    return tuple(Frequencies(printed_damped(m), m.ratio, m.natural) for m in found)


def right_way(car: HalfCar) -> tuple[Frequencies, ...]:
    """Table 4.2 with the mass where ``wdf`` puts it, and ω√(1−ζ²)."""
    found = second_order_modes(*axle_matrices(car))
    return tuple(Frequencies(m.damped, m.ratio, m.natural) for m in found)


def closed_form(M: Array, K: Array) -> tuple[float, float]:
    """Undamped frequencies (Hz) of two degrees of freedom, from the quadratic det(K − ω²M) = 0."""
    a = M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0]
    b = -(M[0, 0] * K[1, 1] + M[1, 1] * K[0, 0] - M[0, 1] * K[1, 0] - M[1, 0] * K[0, 1])
    c = K[0, 0] * K[1, 1] - K[0, 1] * K[1, 0]
    # the larger root first: the smaller one then loses no digits to cancellation
    large = (-b + math.sqrt(b * b - 4.0 * a * c)) / (2.0 * a)
    small = c / (a * large)
    return math.sqrt(small) / (2.0 * math.pi), math.sqrt(large) / (2.0 * math.pi)
