"""The cars of textbooks, for their modes: quarter, half with wheels, full and roll car.

Quarter car: Fig. 2.1 of the reference.  Full car: seven degrees of freedom, Fig. 2.2, after Holen.
The roll car is the one that the reference proposes (section 8.3.2): three degrees of freedom, the
positions and velocities of four wheels as eight inputs, and seven accelerometers, one a wheel and
three on the chassis.  The reference gives no equations and no places; here the chassis' three stand
above the front wheels and in the middle above the rear axle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.vehicle import Roll, Unsprung, Vehicle
from bayes_asv.models.assembly import CORNERS, Link, SecondOrder, assemble, corners
from bayes_asv.models.half_car_equations import LinearSystem

__all__ = [
    "FullCar7",
    "HalfCar4",
    "QuarterCar",
    "RollCar",
    "deflections",
    "full_car",
    "half_car4",
    "quarter_cars",
    "roll_car",
    "sensor_places",
    "stiffness",
    "warp",
]


@dataclass(frozen=True, slots=True)
class QuarterCar:
    """A sprung mass on a wheel on a tyre; coordinates are their heights, the input is the road's.

    Parameters
    ----------
    m, m_u : float
        Sprung and unsprung mass, kg.
    k, c : float
        Spring rate, N/m, and damping rate, N·s/m, of the suspension at the wheel.
    k_t, c_t : float
        Rate and damping of the tyre.
    """

    m: float
    m_u: float
    k: float
    c: float
    k_t: float
    c_t: float = 0.0

    coordinates = ("body", "wheel")
    inputs = ("road",)

    def system(self) -> SecondOrder:
        """Equations of motion: two coordinates, one input."""
        still, road = np.zeros(1), np.ones(1)
        return assemble(
            (self.m, self.m_u),
            (
                Link(np.array([1.0, -1.0]), still, self.k, self.c),
                Link(np.array([0.0, 1.0]), road, self.k_t, self.c_t),
            ),
        )


@dataclass(frozen=True, slots=True)
class HalfCar4:
    """Heave and pitch of the chassis and the heights of both axles, both sides together.

    With its wheels taken as inputs it is :class:`bayes_asv.models.half_car_equations.HalfCar`,
    which the reference uses from chapter 3 on.

    Parameters
    ----------
    m, i : float
        Sprung mass, kg, and its pitch inertia, kg·m².
    l_f, l_r : float
        Distances of the axles from the centre of gravity, m.
    m_uf, m_ur : float
        Unsprung mass of each axle, kg.
    k_f, k_r, c_f, c_r : float
        Rates of the suspension, N/m and N·s/m.
    k_tf, k_tr, c_tf, c_tr : float
        Rates of the tyres.
    """

    m: float
    i: float
    l_f: float
    l_r: float
    m_uf: float
    m_ur: float
    k_f: float
    k_r: float
    c_f: float
    c_r: float
    k_tf: float
    k_tr: float
    c_tf: float = 0.0
    c_tr: float = 0.0

    coordinates = ("heave", "pitch", "front wheels", "rear wheels")
    inputs = ("front road", "rear road")

    def system(self) -> SecondOrder:
        """Equations of motion: four coordinates, two inputs."""
        still, under = np.zeros(2), np.eye(2)
        return assemble(
            (self.m, self.i, self.m_uf, self.m_ur),
            (
                Link(np.array([1.0, self.l_f, -1.0, 0.0]), still, self.k_f, self.c_f),
                Link(np.array([1.0, -self.l_r, 0.0, -1.0]), still, self.k_r, self.c_r),
                Link(np.array([0.0, 0.0, 1.0, 0.0]), under[0], self.k_tf, self.c_tf),
                Link(np.array([0.0, 0.0, 0.0, 1.0]), under[1], self.k_tr, self.c_tr),
            ),
        )


Four = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class FullCar7:
    """Heave, pitch and roll of the chassis and the heights of four wheels.

    Holen's truck has two rigid axles, whose bounce and roll are the mean and the half difference
    of its wheels; here each wheel is a mass of its own.  Corners are in the order of
    :data:`bayes_asv.models.assembly.CORNERS`.

    Parameters
    ----------
    m, i, i_roll : float
        Sprung mass, kg, and its inertias in pitch and roll, kg·m².
    l_f, l_r, t_f, t_r : float
        Distances of the axles from the centre of gravity, and track widths, m.
    m_u, k, c, k_t, c_t : tuple of 4 float
        Unsprung mass (kg), suspension's and tyre's rates (N/m, N·s/m) of each corner.
    bar_f, bar_r : float
        Anti-roll bars: force at either wheel per difference of the two deflections, N/m.
    """

    m: float
    i: float
    i_roll: float
    l_f: float
    l_r: float
    t_f: float
    t_r: float
    m_u: Four
    k: Four
    c: Four
    k_t: Four
    c_t: Four = (0.0, 0.0, 0.0, 0.0)
    bar_f: float = 0.0
    bar_r: float = 0.0

    coordinates = ("heave", "pitch", "roll", *(f"{corner} wheel" for corner in CORNERS))
    inputs = tuple(f"{corner} road" for corner in CORNERS)

    def system(self) -> SecondOrder:
        """Equations of motion: seven coordinates, four inputs."""
        still, under, wheel = np.zeros(4), np.eye(4), np.eye(7)[3:]
        body = np.hstack([corners(self.l_f, self.l_r, self.t_f, self.t_r), np.zeros((4, 4))])
        stretch = body - wheel
        links = [Link(stretch[j], still, self.k[j], self.c[j]) for j in range(4)]
        links += [Link(wheel[j], under[j], self.k_t[j], self.c_t[j]) for j in range(4)]
        links += [
            Link(stretch[0] - stretch[1], still, self.bar_f, 0.0),
            Link(stretch[2] - stretch[3], still, self.bar_r, 0.0),
        ]
        return assemble((self.m, self.i, self.i_roll, *self.m_u), links)


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


def quarter_cars(vehicle: Vehicle) -> dict[str, QuarterCar]:
    """One front and one rear corner, each with its share of the sprung mass.

    Raises
    ------
    InputError
        If the file has no ``[unsprung]``.
    """
    wheels = _unsprung(vehicle)
    m, wdf = vehicle.m.value, vehicle.wdf.value
    return {
        "front": QuarterCar(
            0.5 * wdf * m, 0.5 * wheels.front_mass, 0.5 * vehicle.k_f.value,
            0.5 * vehicle.c_f.value, 0.5 * wheels.front_tyre_rate, 0.5 * wheels.front_tyre_damping,
        ),
        "rear": QuarterCar(
            0.5 * (1.0 - wdf) * m, 0.5 * wheels.rear_mass, 0.5 * vehicle.k_r.value,
            0.5 * vehicle.c_r.value, 0.5 * wheels.rear_tyre_rate, 0.5 * wheels.rear_tyre_damping,
        ),
    }  # fmt: skip


def half_car4(vehicle: Vehicle) -> HalfCar4:
    """Half car with wheels and tyres.

    Raises
    ------
    InputError
        If the file has no ``[unsprung]``.
    """
    wheels = _unsprung(vehicle)
    return HalfCar4(
        m=vehicle.m.value, i=vehicle.i.value, l_f=vehicle.l_f, l_r=vehicle.l_r,
        m_uf=wheels.front_mass, m_ur=wheels.rear_mass,
        k_f=vehicle.k_f.value, k_r=vehicle.k_r.value, c_f=vehicle.c_f.value, c_r=vehicle.c_r.value,
        k_tf=wheels.front_tyre_rate, k_tr=wheels.rear_tyre_rate,
        c_tf=wheels.front_tyre_damping, c_tr=wheels.rear_tyre_damping,
    )  # fmt: skip


def full_car(vehicle: Vehicle) -> FullCar7:
    """Whole car, left and right alike.

    Raises
    ------
    InputError
        If the file has no ``[unsprung]`` or no ``[roll]``.
    """
    wheels, roll = _unsprung(vehicle), _roll(vehicle)

    def split_between_axles(front: float, rear: float) -> tuple[float, float, float, float]:
        return (0.5 * front, 0.5 * front, 0.5 * rear, 0.5 * rear)

    return FullCar7(
        m=vehicle.m.value, i=vehicle.i.value, i_roll=roll.inertia.value,
        l_f=vehicle.l_f, l_r=vehicle.l_r, t_f=roll.front_track.value, t_r=roll.rear_track.value,
        m_u=split_between_axles(wheels.front_mass, wheels.rear_mass),
        k=split_between_axles(vehicle.k_f.value, vehicle.k_r.value),
        c=split_between_axles(vehicle.c_f.value, vehicle.c_r.value),
        k_t=split_between_axles(wheels.front_tyre_rate, wheels.rear_tyre_rate),
        c_t=split_between_axles(wheels.front_tyre_damping, wheels.rear_tyre_damping),
        bar_f=roll.front_bar, bar_r=roll.rear_bar,
    )  # fmt: skip


def roll_car(vehicle: Vehicle) -> RollCar:
    """Nominal car on four wheels, left and right alike: half of an axle's rates at each corner.

    Raises
    ------
    InputError
        If the file has no ``[roll]``.
    """
    roll = _roll(vehicle)
    track = roll.front_track.value
    c_f, c_r = 0.5 * vehicle.c_f.value, 0.5 * vehicle.c_r.value
    k_f, k_r = 0.5 * vehicle.k_f.value, 0.5 * vehicle.k_r.value
    return RollCar(
        c_fl=c_f, c_fr=c_f, c_rl=c_r, c_rr=c_r, i=vehicle.i.value, i_roll=roll.inertia.value,
        m=vehicle.m.value, l=vehicle.l.value, wdf=vehicle.wdf.value,
        k_fl=k_f, k_fr=k_f, k_rl=k_r, k_rr=k_r, t_f=track, t_r=roll.rear_track.value,
        bar_f=roll.front_bar, bar_r=roll.rear_bar,
        s_f=track if roll.front_sensors is None else roll.front_sensors,
    )  # fmt: skip


def _unsprung(vehicle: Vehicle) -> Unsprung:
    if vehicle.unsprung is None:
        raise InputError(
            f"{vehicle.source or 'vehicle'}: [unsprung]",
            "is missing, and this car has wheels and tyres",
            "add it with front_mass, rear_mass, front_tyre_rate and rear_tyre_rate",
        )
    return vehicle.unsprung


def _roll(vehicle: Vehicle) -> Roll:
    if vehicle.roll is None:
        raise InputError(
            f"{vehicle.source or 'vehicle'}: [roll]",
            "is missing, and this car rolls",
            "add it with front_track, rear_track and inertia",
        )
    return vehicle.roll
