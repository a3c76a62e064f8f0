"""What a run is driven with, and how an effect changes it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from tests.rig import ChassisForce, Mounting, RigCar, SensorSpec, Term, with_terms
from tests.rig.laws import LinearDamper

__all__ = ["Axle", "Effect", "Seen", "World", "axles", "less", "with_extra"]

Axle = Literal["front", "rear"]


@dataclass(frozen=True)
class World:
    """Everything that is true about a car and its sensors.

    Parameters
    ----------
    car : RigCar
        With its suspension laws.
    sensors : SensorSpec
        As they are, not as declared.
    forces : tuple of ChassisForce
        Outside forces.
    mountings : tuple of Mounting
        What is between points and sensors.
    """

    car: RigCar
    sensors: SensorSpec
    forces: tuple[ChassisForce, ...] = ()
    mountings: tuple[Mounting, ...] = ()


@dataclass(frozen=True)
class Seen:
    """What the drives to be fitted reach before anything is added; front, rear.

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
        """Largest deflection either way, m."""
        front, rear = (max(pair) for pair in zip(self.bump, self.droop, strict=True))
        return front, rear


@dataclass(frozen=True)
class Effect:
    """An effect whose size is still free.

    Parameters
    ----------
    name, where : str
        As in the document of a diagnosis; ``where`` empty when it has no place.
    change : callable
        Takes a world without the effect and a size, returns the world with it.
    told : callable
        Its parameters in the words of ``docs/interfaces.md``, SI, of a size.
    first, largest : float
        Size to try first for a noncentrality of ten, and size that no car has more of.
    tolerance : float
        Size that a data sheet leaves open at one deviation.
    run : int or None
        The fitted run that has it, where it comes once; all runs have it otherwise.
    """

    name: str
    where: str
    change: Callable[[World, float], World]
    told: Callable[[float], dict[str, float]]
    first: float
    largest: float
    tolerance: float
    run: int | None = None


def axles(where: str) -> tuple[Axle, ...]:
    """Axles that a place of the suspension stands for."""
    if where == "both":
        return ("front", "rear")
    return ("front",) if where == "front" else ("rear",)


def with_extra(world: World, where: str, terms: Callable[[RigCar, Axle], Sequence[Term]]) -> World:
    """Add terms to the laws of some axles.

    ``terms`` is asked an axle at a time.  What replaces a linear damper comes with a negative
    linear one beside it, so that several effects add up.
    """
    car = world.car
    for axle in axles(where):
        car = with_terms(car, axle, *terms(world.car, axle))
    return replace(world, car=car)


def less(c: float) -> Term:
    """Return the linear damper taken out again."""
    return LinearDamper(-c)
