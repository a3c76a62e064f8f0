"""Effects in the online filter: their coordinates, and force laws as tables for compiled code.

An effect that a user names has the wide prior of its parameters, as in ``estimate``.  Parameters of
a force law are additional coordinates.  A wrong given value or gain is an additional term in the
prior of an existing coordinate; the size of the effect is computed from that coordinate by linear
regression.  A force that cannot be negative may become so in the filter, whose distributions are
normal; its reported distribution is conditional on a positive value, as with a half-normal prior.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import truncnorm

from bayes_asv.domain.errors import InputError
from bayes_asv.filters.force_laws import table_of_laws
from bayes_asv.filters.ukf_state import GRID, LawTable
from bayes_asv.models.car_model import CarModel
from bayes_asv.models.effects import Parameter, PlacedEffect, Scale
from bayes_asv.posterior.car_prior import effect_scale

__all__ = [
    "EffectParameter",
    "check_trackable",
    "effect_parameters",
    "law_table",
    "with_car_effects",
]

Array = NDArray[np.float64]

_PROBABILITIES = (np.arange(1000) + 0.5) / 1000  # levels of the quantiles that represent draws
_NODES = (-math.sqrt(3.0), 0.0, math.sqrt(3.0))  # Gauss–Hermite nodes
_FIX = "estimate with it instead, or leave it out"


@dataclass(frozen=True)
class EffectParameter:
    """A parameter of an effect that is tracked.

    Parameters
    ----------
    placed : PlacedEffect
        The effect and its place.
    parameter : Parameter
        Parameter of the effect.
    size : float
        Factor on the numbers of its prior for this car.
    linear : bool
        Whether it is the factor on a fraction of the car, one plus ``prior_scale`` times its
        coordinate.
    """

    placed: PlacedEffect
    parameter: Parameter
    size: float
    linear: bool = False

    @property
    def name(self) -> str:
        """Unique name."""
        return self.placed.coordinate_name(self.parameter)

    def values(self, z: Array) -> Array:
        """Values at standard normal coordinates; a force has the sign of its coordinate."""
        one = self.parameter
        if self.linear:
            return np.asarray(self.size * (one.centre + one.prior_scale * z))
        if one.form == "positive":
            return np.asarray(self.size * one.prior_scale * z)
        return np.asarray(one.value(z, Scale(self.size, self.size)))

    def quantiles(self, p: Array, mean: float, sd: float) -> Array:
        """Quantiles of the value for a normal coordinate; a force is truncated to positive ones."""
        if self.parameter.form == "positive" and not self.linear:
            return self.values(mean + sd * truncnorm.ppf(p, -mean / sd, math.inf))
        return self.values(mean + sd * ndtri(p))

    def draws(self, mean: float, sd: float) -> Array:
        """Quantiles at evenly spaced probabilities, in place of draws."""
        return self.quantiles(_PROBABILITIES, mean, sd)

    def moments(self, mean: Array, sd: Array) -> tuple[Array, Array]:
        """Means and standard deviations of the value along a recording, each (N,).

        By Gauss–Hermite quadrature with three nodes.
        """
        values = np.stack([self.values(mean + side * sd) for side in _NODES])
        weights = np.array([1.0, 4.0, 1.0]) / 6.0
        average = weights @ values
        return average, np.sqrt(weights @ (values - average) ** 2)


def check_trackable(
    car: CarModel, placed_effects: Sequence[PlacedEffect], channels: Sequence[str]
) -> None:
    """Refuse effects that cannot be tracked online.

    Raises
    ------
    InputError
        If an effect cannot be tracked.
    """
    for placed in placed_effects:
        effect, where = placed.effect, f"--with {placed}"
        if effect.in_one_run:
            raise InputError(
                where, "cannot be tracked: when it acts is known only after the drive",
                "let diagnose look for it",
            )  # fmt: skip
        if effect.name == "damper_fade":
            raise InputError(
                where, "has no meaning online: it is a loss up to the end of a recording",
                "leave it out, and follow the damper with --forget 60",
            )  # fmt: skip
        if effect.fault:
            raise InputError(
                where,
                "cannot be tracked: undoing it needs readings before and after the one at hand",
                _FIX,
            )
        if all(parameter.memory for parameter in effect.parameters):
            raise InputError(
                where, "cannot be tracked: its force has a state of its own in each damper", _FIX
            )
        if effect.code >= 0 and not _is_separable(placed, effect_scale(car)):
            raise InputError(
                where, "cannot be tracked: its law is no table of one parameter each", _FIX
            )
        if effect.acts == "suspension" and not placed.elements(car):
            raise InputError(
                where, f"is at no suspension of the {car.name} car", "name another place"
            )
        if effect.acts == "reading" and not placed.channels(channels):
            raise InputError(where, "is of a channel that is not measured", "name another channel")
        if effect.acts == "car" and not _affected(car, placed):
            raise InputError(where, f"changes nothing of the {car.name} car", "leave it out")
    for k, placed in enumerate(placed_effects):
        if any(placed.overlaps(other) for other in placed_effects[:k]):
            raise InputError(f"--with {placed}", "is named twice", "leave one of them out")


def effect_parameters(
    car: CarModel, placed_effects: Sequence[PlacedEffect]
) -> tuple[EffectParameter, ...]:
    """List the parameters of effects that are tracked, those of force laws first."""
    scale = effect_scale(car)
    order = sorted(placed_effects, key=lambda placed: placed.effect.acts != "suspension")
    return tuple(
        EffectParameter(placed, one, one.size(scale), _of_fraction(car, placed))
        for placed in order
        for one in placed.effect.parameters
        if not one.memory
    )


def with_car_effects(car: CarModel, placed_effects: Sequence[PlacedEffect]) -> CarModel:
    """Return a car with a term in the prior of given values for each effect that changes them."""
    parameters = list(car.parameters)
    for placed in placed_effects:
        if placed.effect.acts != "car":
            continue
        one = placed.effect.parameters[0]
        for k in _affected(car, placed):
            wide = one.prior_scale
            if parameters[k].kind == "fraction":
                wide *= parameters[k].nominal
            term = (placed.coordinate_name(one), 1.0, wide)
            parameters[k] = replace(parameters[k], terms=(*parameters[k].terms, term))
    return replace(car, parameters=tuple(parameters))


def law_table(
    car: CarModel, effects: Sequence[EffectParameter], first: int, pole: float
) -> LawTable:
    """Tabulate the force laws of effects over their coordinates.

    Parameters
    ----------
    car : CarModel
        The car.
    effects : sequence of EffectParameter
        From :func:`effect_parameters`.
    first : int
        Index of the first of them among the parameters of the filter's model.
    pole : float
        Pole of the filter that all readings passed, rad/s.
    """
    rows: list[list[float]] = []
    entry: list[tuple[int, int, int]] = []
    numbers: list[Array] = []
    placed_effects = dict.fromkeys(e.placed for e in effects if e.placed.effect.code >= 0)
    for placed in placed_effects:
        of_placed = [(k, e) for k, e in enumerate(effects) if e.placed == placed]
        centre = {one.name: one.centre for one in placed.effect.parameters if one.memory}
        centre |= {e.parameter.name: float(e.values(np.zeros(1))[0]) for _, e in of_placed}
        packed = _packed(placed, centre)
        varying = []
        for k, e in of_placed:
            tabulated = np.array(
                [_packed(placed, {**centre, e.parameter.name: float(v)}) for v in e.values(GRID)]
            )
            varying_columns = np.flatnonzero(np.any(tabulated != packed, axis=0))
            varying += [(2 + int(c), first + k, tabulated[:, c]) for c in varying_columns]
        for element in placed.elements(car):
            entry += [(len(rows), column, parameter) for column, parameter, _ in varying]
            numbers += [values for _, _, values in varying]
            rows.append([float(element), float(placed.effect.code), *packed])
    return LawTable(
        pole=pole,
        rows=table_of_laws(rows),
        entry=np.array(entry, np.int64).reshape(-1, 3),
        number=np.array(numbers).reshape(-1, len(GRID)),
    )


def _packed(placed: PlacedEffect, values: dict[str, float]) -> Array:
    assert placed.effect.packed is not None
    return np.array(placed.effect.packed(values))


def _is_separable(placed: PlacedEffect, scale: Scale) -> bool:
    """Whether each number of a law is a function of one parameter only.

    Changing two parameters then changes the numbers as changing one after the other does.
    """
    points = (-0.7, 0.0, 0.9)
    parameters = placed.effect.parameters
    values = {p.name: [float(p.value(z, scale)) for z in points] for p in parameters}

    def packed(at: dict[str, int]) -> Array:
        return _packed(placed, {n: v[at.get(n, 1)] for n, v in values.items()})

    for a in parameters:
        for b in parameters:
            if a is b:
                continue
            changed = np.flatnonzero(packed({a.name: 0}) != packed({}))
            if np.any(packed({a.name: 0, b.name: 2})[changed] != packed({a.name: 0})[changed]):
                return False
    return True


def _affected(car: CarModel, placed: PlacedEffect) -> list[int]:
    """Return the indices of the parameters of a car that an effect changes."""
    assert placed.effect.on_car is not None
    one = placed.effect.parameters[0]
    values = car.nominal
    placed.effect.on_car(values, {one.name: np.array([1.1])}, placed.where, car)
    return [k for k, p in enumerate(car.parameters) if values[p.name][0] != p.nominal]


def _of_fraction(car: CarModel, placed: PlacedEffect) -> bool:
    if placed.effect.acts != "car":
        return False
    return any(car.parameters[k].kind == "fraction" for k in _affected(car, placed))
