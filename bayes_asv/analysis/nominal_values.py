"""Mistakes in nominal values, and implausible estimates.

Mistakes in nominal values hardly affect the likelihood; they are recognised by their size.  Dampers
wear independently, and seldom lose more than half of their damping.  A wrong unit, the rate of one
side instead of both, or a rate at the damper instead of at the wheel changes all dampers by the
same factor, or one of them by a factor between units.  With ρ the logarithms of estimated over
nominal damping, the hypotheses are::

    no mistake   ρ_e as stated, normal with a deviation of 0.1, or worn or set otherwise, split
                 normal with 0.35 downward and 0.2 upward, each with a probability of one half
    mistake      ρ_e + s_e as without a mistake, where s_e undoes it at element e

Nominal damping has a mistake with a prior probability of one tenth.

A pitch inertia is checked by the dynamic index i/(m l_f l_r), which is near one for all cars.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.analysis.input_hypotheses import REPORTED, Mistake
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.units import si_factor
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.car_model import CarModel

__all__ = ["NominalDamping", "implausible_values", "nominal_damping", "nominal_mistakes"]

Array = NDArray[np.float64]

# Standard deviations of ln(estimated/nominal): half of all dampers are as stated within a
# tolerance, the others are worn or set stiffer.
_TOLERANCE, _WORN, _STIFFER = 0.1, 0.35, 0.2
_AS_STATED = 0.5  # prior probability that a damper is as stated
_PRIOR = 0.1  # prior probability of a mistake in nominal damping; all kinds are equally likely
_UNITS = (  # ratio of two units, the larger one and the smaller one
    (12.0, "lbf·s/in", "lbf·s/ft"),
    (si_factor("lbf*s/in", "damping"), "lbf·s/in", "N·s/m"),
    (si_factor("lbf*s/ft", "damping"), "lbf·s/ft", "N·s/m"),
    (1e3, "N·s/mm", "N·s/m"),
)
_MOTION_RATIOS = np.linspace(0.35, 0.9, 45)  # motion ratios that are considered
_INDEX_RANGE = (0.3, 2.5)
"""Range of the dynamic index; that of cars is near one (Gillespie 1992, Fundamentals of Vehicle
Dynamics, ch. 5)."""

_RATIOS = (0.01, 3.0)
"""Range of the damping ratio of an axle.  Passenger cars have 0.2 to 0.4 and racing cars up to one
(Dixon 2007, The Shock Absorber Handbook, ch. 3); without oil in the damper the friction of its
bushes remains, and the rate of a racing damper at low speed is up to three times its mean.
"""
_RIDE_FREQUENCIES = (0.4, 12.0)
"""Range of the ride frequency, Hz: from half that of the softest car to nearly twice that of the
stiffest, whose springs are its tyres (Milliken & Milliken 1995, Race Car Vehicle Dynamics, ch. 16).
"""


def implausible_values(car: CarModel, values: Mapping[str, float]) -> list[Mistake]:
    """List implausible values of a fitted car.

    Parameters
    ----------
    car : CarModel
        The car that was estimated.
    values : mapping of str to float
        Its parameters as estimated, SI units.

    Returns
    -------
    list of Mistake
        One for each element whose damping ratio c/(2√(k m)) or natural frequency √(k/m)/2π, with m
        the sprung mass that it supports, is outside the range of real cars.
    """
    if car.derived is None:
        return []
    derived = car.derived({name: np.array([value]) for name, value in values.items()})
    out = []
    for element in car.elements:
        ratio = derived.get(element.damping.replace("c_", "zeta_", 1))
        if ratio is None:
            continue
        fix = "check channels, units, spring rates and sprung mass"
        zeta = float(ratio[0])
        frequency = zeta * values[element.spring] / (math.pi * values[element.damping])
        if not _RATIOS[0] <= zeta <= _RATIOS[1]:
            name = QUANTITIES[element.damping][1]
            what = f"the estimated {name} means a damping ratio of {zeta:.2g}"
            if element.axle is not None:
                wheel, body = f"{element.axle} wheel", f"{element.axle} chassis"
                fix = (
                    f"the {body} sensor hardly follows its wheel: it is dead, loose or in another "
                    "unit"
                    if zeta < _RATIOS[0]
                    else f"{wheel} and {body} move alike: their columns are exchanged, or both "
                    "sensors are on the same part"
                ) + f"; {fix}"
        elif not _RIDE_FREQUENCIES[0] <= frequency <= _RIDE_FREQUENCIES[1]:
            name = QUANTITIES[element.spring][1]
            what = f"the {name} and the mass on it mean a natural frequency of {frequency:.2g} Hz"
        else:
            continue
        out.append(Mistake(f"{what}, as no car has", fix, 1.0))
    return out


@dataclass(frozen=True)
class NominalDamping:
    """Possible mistakes in nominal damping, given the estimated rates.

    Parameters
    ----------
    mistakes : tuple of Mistake
        Mistakes that are probable enough to be reported, the most probable first.
    probability : float
        Probability of any mistake.
    names : frozenset of str
        Damping rates and the corresponding damping ratios.
    """

    mistakes: tuple[Mistake, ...]
    probability: float
    names: frozenset[str]

    def probability_below(self, name: str, p: float) -> float:
        """Return the probability that a quantity is below nominal, allowing for a mistake.

        If the nominal value is mistaken, the estimate gives no information about wear.

        Parameters
        ----------
        name : str
            Name of the quantity.
        p : float
            Probability that it is below the given nominal value.  It is returned unchanged if no
            mistake is probable enough to be reported, or if the quantity is unrelated to damping.
        """
        if not self.mistakes or name not in self.names:
            return p
        return p + self.probability * (0.5 - p)


def nominal_mistakes(
    vehicle: Vehicle, car: CarModel, values: Mapping[str, float], error: float = 0.0
) -> list[Mistake]:
    """Compare estimated values with nominal ones; list mistakes that are more probable than wear.

    Parameters
    ----------
    vehicle : Vehicle
        Nominal values.
    car : CarModel
        The car that was estimated.
    values : mapping of str to float
        Its parameters as estimated, SI units.
    error : float
        Standard deviation of the error of the logarithms of the estimated rates.

    Returns
    -------
    list of Mistake
        Mistakes in nominal damping, if any is more probable than wear, and in the pitch inertia.
    """
    damping = nominal_damping(car, values, error)
    mistakes = list(damping.mistakes) if damping.probability > 0.5 else []
    return mistakes + _inertia(vehicle, car, values)


def nominal_damping(
    car: CarModel, values: Mapping[str, float], error: float = 0.0
) -> NominalDamping:
    """Compute the probabilities of mistakes in nominal damping, against wear.

    Parameters
    ----------
    car : CarModel
        The car that was estimated.
    values : mapping of str to float
        Its damping rates as estimated, SI units.
    error : float
        As in :func:`nominal_mistakes`.
    """
    names = list(dict.fromkeys(element.damping for element in car.elements))
    nominal = {p.name: p.nominal for p in car.parameters}
    rho = np.array([math.log(values[name] / nominal[name]) for name in names])
    kinds = _kinds(names, np.array([nominal[name] for name in names]), rho)
    logs, texts = [float(_log_wear(rho, error)) + math.log(1.0 - _PRIOR)], []
    for kind in kinds:
        for change, text in kind:
            each = np.atleast_1d(_log_wear(rho + change, error))
            prior = math.log(_PRIOR / len(kinds) / len(kind) / len(each))
            logs.append(float(np.logaddexp.reduce(each)) + prior)
            texts.append(text)
    weights = np.exp(np.array(logs) - max(logs))
    weights = weights[1:] / weights.sum()
    ranked = sorted(zip(weights, texts, strict=True), key=lambda pair: -float(pair[0]))
    fix = "give the rate of all dampers of an axle together, at the wheel, and check the unit"
    ratios = [name.replace("c_", "zeta_", 1) for name in names]
    return NominalDamping(
        tuple(Mistake(text, fix, float(p)) for p, text in ranked if p > REPORTED),
        float(weights.sum()),
        frozenset([*names, *ratios]),
    )


def _kinds(names: list[str], nominal: Array, rho: Array) -> list[list[tuple[Array, str]]]:
    """Mistakes by kind: what undoes each in rho, for one or several sizes, and its description."""
    several = len(names) > 1
    every, elements = np.ones(len(names)), np.eye(len(names))
    sides = [
        (-math.log(2.0) * every, "nominal damping is given for one side of an axle only"),
        (math.log(2.0) * every, "nominal damping counts both sides of an axle twice"),
    ]
    units: list[tuple[Array, str]] = []
    for factor, large, small in _UNITS:
        for log, true, written in (
            (math.log(factor), large, small),
            (-math.log(factor), small, large),
        ):
            text = f"a value in {true} was given the unit {written}"
            units.append((-log * every, f"nominal damping has a wrong unit: {text}"))
            for name, alone in zip(names, elements, strict=True):
                if several:
                    text_of_one = f"the nominal {QUANTITIES[name][1]} has a wrong unit: {text}"
                    units.append((-log * alone, text_of_one))
    ratio = math.exp(0.5 * float(rho.mean()))  # if no damper is worn
    at_damper = (
        -2.0 * np.log(_MOTION_RATIOS)[:, None],
        "nominal damping is given at the damper instead of at the wheel "
        f"(motion ratio about {ratio:.2f})",
    )
    kinds = [sides, units, [at_damper]]
    if several:
        one_side = "is given for one side of the axle only"
        kinds.append(
            [
                (-math.log(2.0) * alone, f"the nominal {QUANTITIES[name][1]} {one_side}")
                for name, alone in zip(names, elements, strict=True)
            ]
        )
    if len(names) == 2:
        exchange = math.log(nominal[0] / nominal[1]) * np.array([1.0, -1.0])
        kinds.append([(exchange, "front and rear nominal damping are exchanged")])
    return kinds


def _log_wear(rho: Array, error: float) -> Array:
    """Log density of the logarithms of estimated over nominal damping, summed over elements."""
    below, above, tolerance = np.hypot((_WORN, _STIFFER, _TOLERANCE), error)
    width = np.where(rho < 0.0, below, above)
    worn = np.log(2.0 * (1.0 - _AS_STATED) / (below + above)) - 0.5 * (rho / width) ** 2
    stated = np.log(_AS_STATED / tolerance) - 0.5 * (rho / tolerance) ** 2
    density = np.logaddexp(stated, worn) - 0.5 * math.log(2.0 * math.pi)
    return np.asarray(np.sum(density, axis=-1))


def _inertia(vehicle: Vehicle, car: CarModel, values: Mapping[str, float]) -> list[Mistake]:
    needed = {"i", "m", "l", "wdf"}
    if not needed <= set(car.names):
        return []
    nominal = {p.name: p.nominal for p in car.parameters}
    given, estimated = _index(nominal), _index(values)
    low, high = _INDEX_RANGE
    if abs(math.log(estimated / given)) < math.log(2.0):
        return []  # an unusual car, in agreement with the recording
    if low <= estimated <= high and not low <= given <= high:
        return [
            Mistake(
                f"the nominal pitch inertia means a radius of gyration of {_gyration(nominal):.2f} "
                f"m on a wheelbase of {nominal['l']:.2f} m, which the recording contradicts",
                "check the units of pitch inertia, wheelbase and mass",
                1.0,
            )
        ]
    if not low <= estimated <= high:
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
