"""Mistakes in nominal values, which leave no trace in the likelihood: units, sides, motion ratio.

A damper that wears loses damping, each for itself, and seldom more than half of it.  A wrong unit,
one side for both, or a rate at the damper instead of at the wheel moves all dampers by the same
factor, or one by a factor of units.  With ρ the logarithms of estimated over nominal damping the
hypotheses are

    wear      ρ_e ~ split normal about 0, deviation 0.35 downward and 0.2 upward, for each element e
    mistake   ρ_e − f as with wear, f the logarithm of the mistake's factor

A pitch inertia is judged by the dynamic index i/(m l_f l_r), which lies near one for all cars.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.units import si_factor
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.car_model import CarModel

__all__ = ["INDEX_RANGE", "Mistake", "nominal_mistakes"]

Array = NDArray[np.float64]

_WORN, _STIFFER = 0.35, 0.2  # deviations of ln(estimated/nominal)
REPORTED = 0.05  # probability from which on a mistake is reported
_OFTEN = 4.0  # how much likelier than others the two mistakes are that most people make
_PRIOR = 0.1  # probability that nominal damping has one of the mistakes
_UNITS = (  # the larger unit over the smaller one
    (12.0, "lbf·s/in", "lbf·s/ft"),
    (si_factor("lbf*s/in", "damping"), "lbf·s/in", "N·s/m"),
    (si_factor("lbf*s/ft", "damping"), "lbf·s/ft", "N·s/m"),
    (1e3, "N·s/mm", "N·s/m"),
)
_MOTION_RATIOS = np.linspace(0.35, 0.9, 45)
INDEX_RANGE = (0.3, 2.5)
"""Dynamic index beyond which something is wrong; that of cars is near one (Gillespie 1992,
Fundamentals of Vehicle Dynamics, ch. 5)."""


@dataclass(frozen=True)
class Mistake:
    """A mistake that explains the recordings.

    Parameters
    ----------
    words : str
        What is probably wrong.
    fix : str
        What to do, in one line.
    probability : float
        Given that the input has a mistake of the list or none.
    """

    words: str
    fix: str
    probability: float


def nominal_mistakes(vehicle: Vehicle, car: CarModel, values: Mapping[str, float]) -> list[Mistake]:
    """Compare estimated values with nominal ones, and say where a mistake is likelier than wear.

    Parameters
    ----------
    vehicle : Vehicle
        Nominal values.
    car : CarModel
        The car that was estimated.
    values : mapping of str to float
        Its parameters as estimated, SI units.

    Returns
    -------
    list of Mistake
        The likeliest where it is likelier than wear.
    """
    return _dampers(car, values) + _inertia(vehicle, car, values)


def _dampers(car: CarModel, values: Mapping[str, float]) -> list[Mistake]:
    names = list(dict.fromkeys(element.damping for element in car.elements))
    nominal = {p.name: p.nominal for p in car.parameters}
    rho = np.array([math.log(values[name] / nominal[name]) for name in names])
    elements = np.arange(len(names))
    mistakes: list[tuple[float, Array, str]] = [
        (_OFTEN, rho - math.log(2.0), "nominal damping is given for one side of an axle only"),
        (1.0, rho + math.log(2.0), "nominal damping counts both sides of an axle twice"),
    ]
    for factor, large, small in _UNITS:
        for log, true, written in (
            (math.log(factor), large, small),
            (-math.log(factor), small, large),
        ):
            text = f"a value in {true} was given the unit {written}"
            mistakes.append((1.0, rho - log, f"nominal damping has a wrong unit: {text}"))
            for k, name in enumerate(names if len(names) > 1 else []):
                alone = rho - log * (elements == k)
                mistakes.append((1.0, alone, f"nominal {name} has a wrong unit: {text}"))
    squares = -2.0 * np.log(_MOTION_RATIOS)[:, None]
    ratio = math.exp(0.5 * float(rho.mean()))  # if no damper is worn
    mistakes.append(
        (
            _OFTEN,
            rho + squares,
            "nominal damping is given at the damper instead of at the wheel "
            f"(motion ratio about {ratio:.2f})",
        )
    )
    if len(names) == 2:
        exchange = math.log(nominal[names[0]] / nominal[names[1]]) * np.array([1.0, -1.0])
        mistakes.append((1.0, rho + exchange, "front and rear nominal damping are exchanged"))
    shares = np.array([share for share, _, _ in mistakes])
    each = np.log(_PRIOR * shares / shares.sum())
    logs = np.array(
        [float(_log_wear(rho)) + math.log(1.0 - _PRIOR)]
        + [
            float(np.logaddexp.reduce(np.atleast_1d(_log_wear(corrected))))
            - math.log(np.size(_log_wear(corrected)))
            + prior
            for (_, corrected, _), prior in zip(mistakes, each, strict=True)
        ]
    )
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    if weights[0] > 0.5:
        return []
    ranked = sorted(zip(weights[1:], mistakes, strict=True), key=lambda pair: -float(pair[0]))
    fix = "give the rate of all dampers of an axle together, at the wheel, and check the unit"
    return [Mistake(text, fix, float(p)) for p, (_, _, text) in ranked if p > REPORTED]


def _log_wear(rho: Array) -> Array:
    """Log density of the logarithms of estimated over nominal damping, summed over elements."""
    width = np.where(rho < 0.0, _WORN, _STIFFER)
    return np.asarray(
        np.sum(
            -0.5 * (rho / width) ** 2
            - math.log(0.5 * (_WORN + _STIFFER) * math.sqrt(2.0 * math.pi)),
            axis=-1,
        )
    )


def _inertia(vehicle: Vehicle, car: CarModel, values: Mapping[str, float]) -> list[Mistake]:
    needed = {"i", "m", "l", "wdf"}
    if not needed <= set(car.names):
        return []
    nominal = {p.name: p.nominal for p in car.parameters}
    given, found = _index(nominal), _index(values)
    low, high = INDEX_RANGE
    if abs(math.log(found / given)) < math.log(2.0):
        return []  # an unusual car, and the recording agrees
    if low <= found <= high and not low <= given <= high:
        return [
            Mistake(
                f"the nominal pitch inertia means a radius of gyration of {_gyration(nominal):.2f} "
                f"m on a wheelbase of {nominal['l']:.2f} m, which the recording contradicts",
                "check the units of pitch inertia, wheelbase and mass",
                1.0,
            )
        ]
    if not low <= found <= high:
        return [
            Mistake(
                "the estimated pitch inertia means a radius of gyration of "
                f"{_gyration(values):.2f} m on a wheelbase of {values['l']:.2f} m, as no car has",
                "check channels, places of the sensors and wheelbase; drive something that "
                "pitches the car",
                1.0,
            )
        ]
    return []


def _index(values: Mapping[str, float]) -> float:
    """Dynamic index i/(m l_f l_r)."""
    arms = values["l"] ** 2 * values["wdf"] * (1.0 - values["wdf"])
    return values["i"] / (values["m"] * arms)


def _gyration(values: Mapping[str, float]) -> float:
    return math.sqrt(values["i"] / values["m"])
