"""A car with its sensors as they really are, and how an effect changes them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from tests.rig import ChassisForce, Mounting, RigCar, SensorSpec, Term, with_terms
from tests.rig.laws import LinearDamper

__all__ = ["Axle", "Effect", "MotionRange", "World", "axles", "minus_damper", "with_terms_at"]

Axle = Literal["front", "rear"]


@dataclass(frozen=True)
class World:
    """A car and its sensors as they really are.

    Parameters
    ----------
    car : RigCar
        With its suspension laws.
    sensors : SensorSpec
        With their true properties, not the declared ones.
    forces : tuple of ChassisForce
        External forces.
    mountings : tuple of Mounting
        Mounts between points on the car and sensors.
    """

    car: RigCar
    sensors: SensorSpec
    forces: tuple[ChassisForce, ...] = ()
    mountings: tuple[Mounting, ...] = ()


@dataclass(frozen=True)
class MotionRange:
    """Range of motion of the fitted drives, without any effect; front and rear.

    Parameters
    ----------
    bump, droop : pair of float
        Largest compression and extension, m.
    rate : pair of float
        Largest rate, m/s.
    """

    bump: tuple[float, float]
    droop: tuple[float, float]
    rate: tuple[float, float]

    @property
    def travel(self) -> tuple[float, float]:
        """Largest deflection in either direction, m."""
        front, rear = (max(pair) for pair in zip(self.bump, self.droop, strict=True))
        return front, rear


@dataclass(frozen=True)
class Effect:
    """An effect of variable size.

    Parameters
    ----------
    name, where : str
        As in the document of a diagnosis; ``where`` is empty if it has no place.
    change : callable
        From a world without the effect and a size to the world with it.
    parameters : callable
        From a size to the values of its parameters, named as in ``docs/interfaces.md``, SI.
    first, largest : float
        First guess of the size for a noncentrality of ten, and the largest size to use.
    tolerance : float
        Size that data sheets allow, as one standard deviation.
    run : int or None
        The only fitted run with the effect; None if all runs have it.
    """

    name: str
    where: str
    change: Callable[[World, float], World]
    parameters: Callable[[float], dict[str, float]]
    first: float
    largest: float
    tolerance: float
    run: int | None = None


def axles(where: str) -> tuple[Axle, ...]:
    """Return the axles of a place on the suspension."""
    if where == "both":
        return ("front", "rear")
    return ("front",) if where == "front" else ("rear",)


def with_terms_at(
    world: World, where: str, terms: Callable[[RigCar, Axle], Sequence[Term]]
) -> World:
    """Add terms to the force laws of some axles.

    ``terms`` is called for each axle.  A term that replaces the linear damper comes with a negative
    linear damper, so that several effects add up.
    """
    car = world.car
    for axle in axles(where):
        car = with_terms(car, axle, *terms(world.car, axle))
    return replace(world, car=car)


def minus_damper(c: float) -> Term:
    """Return a negative linear damper, which cancels the car's own."""
    return LinearDamper(-c)
