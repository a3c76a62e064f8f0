"""Parameters of the car that the online filter estimates, their coordinates and their priors.

Each parameter that is not exact is one coordinate: first the parameters of interest, then those of
force laws, then every given value with a standard deviation, then the scales of sensors.  All are
logarithms, except fractions and the parameters of force laws, which are standard normal.
Parameters whose priors share an unknown, such as the springs of both sides of an axle, are
correlated a priori.  Accelerations depend only on ratios to the mass, but the mass is a coordinate
as well, so that its uncertainty is included in all results.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bayes_asv.models.car_model import CarModel, CarParameter
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.tracking.effects import (
    EffectParameter,
    check_trackable,
    effect_parameters,
    with_car_effects,
)

__all__ = ["WALK_SHARE", "Coordinates", "coordinates"]

Array = NDArray[np.float64]

WALK_SHARE = 0.1
"""Relative change of a parameter during the time constant of its random walk, one standard
deviation."""


@dataclass(frozen=True)
class Coordinates:
    """Coordinates z of the filter, and the parameter vector of the model at z.

    Parameters
    ----------
    car : CarModel
        The car.
    names : tuple of str
        Names of the parameters of interest, of those of force laws, then of given values and
        ``gain <channel>``.
    base : (P + C + E,) array
        Parameter vector before changes by coordinates: the car's parameters, the gains of the
        sensors, and the coordinates of force laws.
    element : (p,) int array
        Element of that vector that each coordinate determines.
    log : (p,) bool array
        Whether that element is exp(centre + scale z) or centre + scale z.
    centre, scale : (p,) arrays
        Prior mean and standard deviation of the element or of its logarithm.
    factor : (p, p) array
        Upper triangular; its product Uᵀ U is the prior correlation.
    tied : dict of str to (str, float)
        Parameters that are a constant multiple of another one, with which they share an unknown.
    effects : tuple of EffectParameter
        Parameters of effects, those of force laws first.
    by_effect : (E', p) array
        Prior covariance of each of these parameters with the coordinates.
    """

    car: CarModel
    names: tuple[str, ...]
    base: Array
    element: NDArray[np.int64]
    log: NDArray[np.bool_]
    centre: Array
    scale: Array
    factor: Array
    tied: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    effects: tuple[EffectParameter, ...] = ()
    by_effect: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __len__(self) -> int:
        return len(self.names)

    @property
    def estimands(self) -> tuple[str, ...]:
        """Names of the parameters of interest, which come first."""
        return tuple(name for name in self.car.estimated if name in self.names)

    @property
    def placed_effects(self) -> tuple[PlacedEffect, ...]:
        """The effects."""
        return tuple(dict.fromkeys(effect.placed for effect in self.effects))

    @property
    def law_effects(self) -> tuple[EffectParameter, ...]:
        """Parameters of force laws; their coordinates follow the parameters of interest."""
        return tuple(e for e in self.effects if e.placed.effect.code >= 0)

    def effect_moments(self, mean: Array, covariance: Array) -> tuple[Array, Array]:
        """Means and standard deviations of the effects' coordinates.

        Parameters
        ----------
        mean, covariance : (p,) and (p, p) arrays
            Mean and covariance of the coordinates of the filter.
        """
        if not self.effects:
            return np.zeros(0), np.zeros(0)
        prior = self.factor.T @ self.factor
        regression = np.linalg.solve(prior, self.by_effect.T).T
        unexplained = 1.0 - np.sum(regression * self.by_effect, axis=1)
        variance = np.sum((regression @ covariance) * regression, axis=1) + np.maximum(
            unexplained, 0.0
        )
        return regression @ mean, np.sqrt(variance)

    def log_parameters(self, z: Array) -> Array:
        """Logarithms (…, na) of the parameters of interest (SI) at coordinates (…, na or more)."""
        na = len(self.estimands)
        return np.asarray(self.centre[:na] + self.scale[:na] * z[..., :na])

    def parameter_vectors(self, z: Array) -> Array:
        """Parameter vectors (W, P + C) of the model at coordinates (W, p)."""
        out = np.tile(self.base, (len(z), 1))
        value = self.centre + self.scale * z
        out[:, self.element] = np.where(self.log, np.exp(np.where(self.log, value, 0.0)), value)
        names = self.car.names
        for name, (other, ratio) in self.tied.items():
            out[:, names.index(name)] = ratio * out[:, names.index(other)]
        return out

    def parameter_noise(self, seconds: float | None) -> Array:
        """Process noise of the coordinates' random walk, variance per second (p,).

        Parameters
        ----------
        seconds : float or None
            Time constant, in which the parameters of interest change by :data:`WALK_SHARE` (one
            standard deviation); None for constant parameters.  Given values are always constant.
        """
        out = np.zeros(len(self))
        na = len(self.estimands)
        if seconds is not None:
            out[:na] = math.log1p(WALK_SHARE) ** 2 / seconds / self.scale[:na] ** 2
        return out


def coordinates(
    car: CarModel,
    channels: Sequence[str],
    scale_sd: Sequence[float] | None = None,
    placed_effects: Sequence[PlacedEffect] = (),
) -> Coordinates:
    """Set up the coordinates for a car.

    Parameters
    ----------
    car : CarModel
        Gives nominal values and priors.
    channels : sequence of C str
        Names of the channels.
    scale_sd : (C,) sequence of float, optional
        Relative standard deviation of each sensor's scale; zero if it is exact, which is the
        default.
    placed_effects : sequence of PlacedEffect
        Effects that the car or its sensors have.

    Returns
    -------
    Coordinates
        Coordinates with the priors of :mod:`bayes_asv.posterior.parameters`.

    Raises
    ------
    InputError
        For an effect that cannot be tracked.
    """
    check_trackable(car, placed_effects, channels)
    effects = effect_parameters(car, placed_effects)
    car = with_car_effects(car, placed_effects)
    scale_sd = [0.0] * len(channels) if scale_sd is None else scale_sd
    order = sorted(range(len(car.parameters)), key=lambda k: car.parameters[k].kind != "estimated")
    chosen: list[tuple[tuple[str, float, float], ...]] = []  # terms of each coordinate
    rows: list[tuple[str, int, bool, float, float]] = []
    tied: dict[str, tuple[str, float]] = {}
    by_terms: dict[object, CarParameter] = {}
    laws = [e for e in effects if e.placed.effect.code >= 0]
    first = len(car.parameters) + len(channels)
    for number in order:
        one = car.parameters[number]
        if one.kind != "estimated" and laws:
            for k, effect in enumerate(laws):
                chosen.append(((effect.name, 1.0, 1.0),))
                rows.append((effect.name, first + k, False, 0.0, 1.0))
            laws = []
        sd = _deviation(one.terms)
        if sd == 0.0:
            continue
        other = by_terms.setdefault((one.terms, one.kind), one)
        if other is not one:
            tied[one.name] = other.name, one.nominal / other.nominal
            continue
        chosen.append(one.terms)
        log = one.kind != "fraction"
        rows.append((one.name, number, log, math.log(one.nominal) if log else one.nominal, sd))
    for number, (name, sd) in enumerate(zip(channels, scale_sd, strict=True), len(car.parameters)):
        gain_terms = [(f"gain {name}", 1.0, sd)]
        gain_terms += [
            (effect.name, 1.0, effect.parameter.prior_scale)
            for effect in effects
            if name in effect.placed.channels(channels)
        ]
        if (total := _deviation(gain_terms)) > 0.0:
            chosen.append(tuple(gain_terms))
            rows.append((f"gain {name}", number, True, 0.0, total))
    names, element, log_, centre, scale = zip(*rows, strict=True)
    unknowns = sorted({name for terms in chosen for name, _, _ in terms})
    root = np.zeros((len(rows), len(unknowns)))
    for k, terms in enumerate(chosen):
        for name, weight, sd in terms:
            root[k, unknowns.index(name)] += weight * sd / scale[k]
    correlation = root @ root.T
    np.fill_diagonal(correlation, 1.0)
    return Coordinates(
        car=car,
        names=names,
        base=np.array(
            [p.nominal for p in car.parameters]
            + [1.0] * len(channels)
            + [0.0] * sum(e.placed.effect.code >= 0 for e in effects)
        ),
        element=np.array(element, np.int64),
        log=np.array(log_, np.bool_),
        centre=np.array(centre, np.float64),
        scale=np.array(scale, np.float64),
        factor=np.ascontiguousarray(np.linalg.cholesky(correlation).T),
        tied=tied,
        effects=effects,
        by_effect=root[:, [unknowns.index(effect.name) for effect in effects]].T,
    )


def _deviation(terms: Sequence[tuple[str, float, float]]) -> float:
    """Return the standard deviation of a sum of independent terms."""
    return math.sqrt(sum((weight * sd) ** 2 for _, weight, sd in terms))
