"""Eigenvalue modes of a car model."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.models.car_model import CarModel, Values, state_space
from bayes_asv.models.half_car_equations import HalfCar, deflection_form

__all__ = ["VibrationMode", "half_width", "modes", "nominal_modes"]


class VibrationMode(NamedTuple):
    """One mode of the chassis on its suspension.

    Parameters
    ----------
    natural : float
        Undamped natural frequency |λ|/2π, Hz.
    damped : float
        Frequency of oscillation ω√(1−ζ²)/2π, Hz; zero when the mode does not oscillate.
    ratio : float
        Damping ratio ζ = −Re λ/|λ|; one for each real pole of an overdamped mode.
    shape : (2,) complex array
        Displacement at the front and at the rear axle, the larger one scaled to 1.
    """

    natural: float
    damped: float
    ratio: float
    shape: NDArray[np.complex128]


def modes(car: HalfCar) -> list[VibrationMode]:
    """Modes of the car with its wheels held still, slowest first.

    An oscillating mode is one entry, an overdamped one two real poles with an entry each.

    Parameters
    ----------
    car : HalfCar
        Parameters in SI units.

    Returns
    -------
    list of VibrationMode
        The nominal car of Table 7.1 gives 2.03 Hz at ζ 0.54 and 2.99 Hz at ζ 0.82.
    """
    return _modes_of(deflection_form(car).A)


def nominal_modes(car: CarModel) -> list[VibrationMode]:
    """Modes of a car with its nominal parameters, slowest first.

    Zero eigenvalues, such as that of a twist of the wheels that the body cannot follow, are
    omitted.
    """
    return _modes_of(state_space(car, car.nominal, ()).A[0])


def half_width(car: CarModel, values: Values) -> float:
    """Half width ζ f of a resonance of the body at half its power, Hz, the mean over its modes.

    A mode's eigenvalues add up to −2 ζ ω, so that the mean is −tr A / 4π n for n elements.

    Parameters
    ----------
    car : CarModel
        The car.
    values : dict of str to (1,) array
        Its parameters, SI units.
    """
    A = state_space(car, values, ()).A[0]
    return float(-np.trace(A) / (4.0 * np.pi * len(car.elements)))


def _modes_of(A: NDArray[np.float64]) -> list[VibrationMode]:
    values, vectors = np.linalg.eig(A)
    fastest = float(np.max(np.abs(values)))
    vibration_modes = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value.imag < 0.0:
            continue  # the conjugate of another eigenvalue
        if abs(value) < 1e-6 * fastest:
            continue
        shape = vector[0::2]
        shape = shape / shape[int(np.argmax(np.abs(shape)))]
        natural = abs(value) / (2.0 * np.pi)
        vibration_modes.append(
            VibrationMode(
                natural=float(natural),
                damped=float(value.imag / (2.0 * np.pi)),
                ratio=float(-value.real / abs(value)),
                shape=shape.astype(np.complex128),
            )
        )
    return sorted(vibration_modes, key=lambda mode: mode.natural)
