"""The car that the reference proposes (section 8.3.2): heave, pitch and roll on four wheels.

Three degrees of freedom, the positions and velocities of four wheels as eight inputs, and seven
accelerometers: one a wheel and three on the chassis.  The reference gives no equations and no
places; here the chassis' three stand above the front wheels and in the middle above the rear axle.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.models.assembly import CORNERS, Link, SecondOrder, assemble, corners
from bayes_asv.models.half_car import LinearSystem

__all__ = ["RollCar", "deflections", "sensor_places", "stiffness", "warp"]

Array = NDArray[np.float64]


class RollCar(NamedTuple):
    """Physical parameters of the roll car, in SI units; rates are those of one corner.

    Parameters
    ----------
    c_fl, c_fr, c_rl, c_rr : float
        Damping rates, N·s/m.
    i, i_roll : float
        Pitch and roll inertia of the sprung mass about its centre of gravity, kg·m².
    m : float
        Sprung mass, kg.
    l, wdf : float
        Wheel base, m, and share of the sprung weight on the front axle.
    k_fl, k_fr, k_rl, k_rr : float
        Spring rates, N/m.
    t_f, t_r : float
        Track widths, m.
    bar_f, bar_r : float
        Anti-roll bars: force at either wheel per difference of the two deflections, N/m.
    s_f : float
        Distance between the two front chassis sensors, m.
    """

    c_fl: float
    c_fr: float
    c_rl: float
    c_rr: float
    i: float
    i_roll: float
    m: float
    l: float
    wdf: float
    k_fl: float
    k_fr: float
    k_rl: float
    k_rr: float
    t_f: float
    t_r: float
    bar_f: float
    bar_r: float
    s_f: float

    @property
    def l_f(self) -> float:
        """Distance from the centre of gravity to the front axle, m."""
        return self.l * (1.0 - self.wdf)

    @property
    def l_r(self) -> float:
        """Distance from the centre of gravity to the rear axle, m."""
        return self.l * self.wdf

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return ("heave", "pitch", "roll")

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(f"{corner} wheel" for corner in CORNERS)

    @property
    def corners(self) -> Array:
        """Heights at the corners (4, 3) for unit heave, pitch and roll."""
        return corners(self.l_f, self.l_r, self.t_f, self.t_r)

    def system(self) -> SecondOrder:
        """Equations of motion with wheel positions as inputs: three coordinates, four inputs."""
        H, under = self.corners, np.eye(4)
        k, c = self[9:13], self[0:4]
        links = [Link(H[j], under[j], k[j], c[j]) for j in range(4)]
        links += [
            Link(H[0] - H[1], under[0] - under[1], self.bar_f, 0.0),
            Link(H[2] - H[3], under[2] - under[3], self.bar_r, 0.0),
        ]
        return assemble((self.m, self.i, self.i_roll), links)


def sensor_places(car: RollCar) -> Array:
    """Heights (3, 3) of the chassis sensors for unit heave, pitch and roll.

    Front left, front right, rear middle.
    """
    return np.array(
        [
            [1.0, car.l_f, 0.5 * car.s_f],
            [1.0, car.l_f, -0.5 * car.s_f],
            [1.0, -car.l_r, 0.0],
        ]
    )


def warp(car: RollCar) -> Array:
    """Give the wheel heights (4,), of unit length, that no motion of a rigid chassis follows.

    Front and rear axle turn against each other.  It is at right angles to the columns of
    :attr:`RollCar.corners`.
    """
    n = np.array([1.0 / car.t_f, -1.0 / car.t_f, -1.0 / car.t_r, 1.0 / car.t_r])
    return np.asarray(n / np.linalg.norm(n))


def stiffness(car: RollCar) -> Array:
    """Return the forces (4, 4) down on the chassis at the corners per unit of deflection, N/m."""
    K = np.diag(car[9:13])
    for bar, a, b in ((car.bar_f, 0, 1), (car.bar_r, 2, 3)):
        K[a, a] += bar
        K[b, b] += bar
        K[a, b] -= bar
        K[b, a] -= bar
    return K


def deflections(car: RollCar) -> LinearSystem:
    """State (δ, δ̇) of four corners, input wheel, output chassis accelerations.

    With δ = chassis minus wheel (extension positive), H the corners and P the places of the
    sensors::

        F = −K δ − C δ̇           q̈ = M⁻¹ Hᵀ F
        δ̈ = H q̈ − ü              y = P q̈

    Four deflections of a chassis with three degrees of freedom are one too many: along
    :func:`warp` nothing answers, δ̈ = −ü, and this part of the input is integrated twice.  It
    reaches the chassis only where front and rear differ in k t or c t (with bars: in roll
    stiffness), and the filter has to know that it drifts.

    Parameters
    ----------
    car : RollCar
        Parameters in SI units.

    Returns
    -------
    LinearSystem
        A (8, 8), B (8, 4), C (3, 8), D (3, 4); D is zero.
    """
    H = car.corners
    body = (H / np.array([car.m, car.i, car.i_roll])).T  # M⁻¹ Hᵀ
    answer = -body @ np.hstack([stiffness(car), np.diag(car[0:4])])  # q̈ per unit of (δ, δ̇)
    A = np.vstack([np.hstack([np.zeros((4, 4)), np.eye(4)]), H @ answer])
    B = np.vstack([np.zeros((4, 4)), -np.eye(4)])
    return LinearSystem(A, B, sensor_places(car) @ answer, np.zeros((3, 4)))
