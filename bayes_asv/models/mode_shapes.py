"""Vibration modes of the cars in heights, and the dominant motion of each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig

from bayes_asv.models.assembly import CORNERS, corners
from bayes_asv.models.modes import VibrationMode
from bayes_asv.models.textbook_cars import FullCar7, HalfCar4, QuarterCar, RollCar

__all__ = ["Car", "CarMode", "car_modes", "places", "second_order_modes"]


def second_order_modes(M: Array, C: Array, K: Array) -> list[VibrationMode]:
    """Modes of a damped system, slowest first.

    Solved as the generalised eigenproblem of the symmetric pencil ``[C M; M 0]``, ``[K 0; 0 −M]``
    (Craig & Kurdila, Fundamentals of Structural Dynamics, 2006, ch. 10), which the reference uses
    in App. C.1 and which has no inverse in it.

    Parameters
    ----------
    M, C, K : (n, n) arrays
        Mass, damping and stiffness, in any one system of units.

    Returns
    -------
    list of VibrationMode
        Frequencies in cycles per unit of time; an oscillating mode is one entry, as is each real
        pole.  Shapes are (n,), in the coordinates of the matrices, the largest entry 1.
    """
    n = len(M)
    zero = np.zeros((n, n))
    left = np.block([[K, zero], [zero, -M]])
    right = -np.block([[C, M], [M, zero]])
    values, vectors = eig(left, right)
    vibration_modes = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value.imag < 0.0:
            continue  # the conjugate of another eigenvalue
        shape = vector[:n] / vector[int(np.argmax(np.abs(vector[:n])))]
        size = float(abs(value))
        vibration_modes.append(
            VibrationMode(
                natural=size / (2.0 * np.pi),
                damped=float(value.imag / (2.0 * np.pi)),
                # a free coordinate (no spring) has its pole at zero, and no ratio
                ratio=float(-value.real / size) if size > 0.0 else 0.0,
                shape=shape.astype(np.complex128),
            )
        )
    return sorted(vibration_modes, key=lambda mode: mode.natural)


Array = NDArray[np.float64]
Car = QuarterCar | HalfCar4 | FullCar7 | RollCar


class CarMode(NamedTuple):
    """A mode of a car.

    Parameters
    ----------
    mode : VibrationMode
        Frequency, damping and shape in heights at :func:`places`, the largest one 1.
    kind : str
        Motion with the largest share: ``bounce``, ``pitch``, ``roll``, ``hop`` of both wheels of an
        axle in phase, ``tramp`` of both in antiphase.
    share : float
        Share of that motion in the kinetic energy.
    """

    mode: VibrationMode
    kind: str
    share: float


def places(car: Car) -> tuple[tuple[str, ...], Array]:
    """Names of the points whose heights are given, and the matrix from coordinates to heights."""
    if isinstance(car, QuarterCar):
        return ("body", "wheel"), np.eye(2)
    if isinstance(car, HalfCar4):
        body = np.array([[1.0, car.l_f, 0.0, 0.0], [1.0, -car.l_r, 0.0, 0.0]])
        names = ("body front", "body rear", "wheels front", "wheels rear")
        return names, np.vstack([body, np.eye(4)[2:]])
    over = corners(car.l_f, car.l_r, car.t_f, car.t_r)
    chassis = tuple(f"body {corner}" for corner in CORNERS)
    if isinstance(car, RollCar):
        return chassis, over
    wheels = tuple(f"wheel {corner}" for corner in CORNERS)
    zero = np.zeros((4, 4))
    return (*chassis, *wheels), np.block([[over, zero], [np.zeros((4, 3)), np.eye(4)]])


def car_modes(car: Car, damped: bool = True) -> list[CarMode]:
    """Modes of a car with its inputs held at zero, slowest first.

    Parameters
    ----------
    car : QuarterCar, HalfCar4, FullCar7 or RollCar
        In SI units.
    damped : bool
        Whether to include damping; False gives the undamped modes of textbooks.

    Returns
    -------
    list of CarMode
        An oscillating mode is one entry, as is each real pole.
    """
    system = car.system()
    _, heights = places(car)
    kinds, roots = _kinds(car)
    out = []
    for mode in second_order_modes(system.M, system.C if damped else 0.0 * system.C, system.K):
        shape = heights @ mode.shape
        energy = np.abs(roots @ mode.shape) ** 2
        largest = int(np.argmax(energy))
        out.append(
            CarMode(
                mode._replace(shape=shape / shape[int(np.argmax(np.abs(shape)))]),
                kinds[largest],
                float(energy[largest] / energy.sum()),
            )
        )
    return out


def _kinds(car: Car) -> tuple[tuple[str, ...], Array]:
    """Motions among which the kinetic energy is divided.

    The motions of the two wheels of an axle are in phase and in antiphase; wheels of equal mass
    have no cross term between the two.

    Returns
    -------
    names : tuple of str
        Names of the motions.
    roots : (n, n) array
        Matrix whose product with the velocities has squares in proportion to the energies.
    """
    root = np.sqrt(car.system().M)
    if isinstance(car, QuarterCar):
        return ("bounce", "hop"), root
    if isinstance(car, HalfCar4):
        return ("bounce", "pitch", "front hop", "rear hop"), root
    if isinstance(car, RollCar):
        return ("bounce", "pitch", "roll"), root
    pair = np.array([[1.0, 1.0], [1.0, -1.0]]) / np.sqrt(2.0)
    turn = np.eye(7)
    turn[3:5, 3:5] = turn[5:7, 5:7] = pair
    names = ("bounce", "pitch", "roll", "front hop", "front tramp", "rear hop", "rear tramp")
    return names, turn @ root
