"""The cars of the textbook models made from a vehicle file."""

from __future__ import annotations

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.vehicle import Roll, Unsprung, Vehicle
from bayes_asv.models.full_car import FullCar7
from bayes_asv.models.half_car_wheels import HalfCar4
from bayes_asv.models.quarter_car import QuarterCar
from bayes_asv.models.roll_car import RollCar

__all__ = ["full_car", "half_car4", "quarter_cars", "roll_car"]


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
