"""Definition of an effect: a law with its parameters, priors and usual tolerances.

A *tolerance* is the size of an effect in a healthy car (one standard deviation across cars), such
as data sheets allow.  Naming an effect replaces this prior of its main parameter with a wide one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.clocks import GROUPS, members

if TYPE_CHECKING:
    from bayes_asv.models.car_model import CarModel

__all__ = ["AXLES", "BOTH", "CORNERS", "Effect", "Form", "Parameter", "PlacedEffect", "Scale"]

Array = NDArray[np.float64]

AXLES = ("front", "rear")
BOTH = "both"
CORNERS = tuple(f"{axle}_{side}" for axle in AXLES for side in ("left", "right"))
Form = Literal["linear", "log", "positive", "sinh"]
Acts = Literal["suspension", "car", "reading"]


@dataclass(frozen=True)
class Scale:
    """Units of one car in which priors are given.

    Parameters
    ----------
    load : float
        Static load of the mean suspension element, N.
    spring : float
        Mean spring rate, N/m.
    """

    load: float
    spring: float


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect, with its prior in a model that includes the effect.

    Parameters
    ----------
    name, unit : str
        As in ``docs/interfaces.md``; the unit is SI.
    form : {'linear', 'log', 'positive', 'sinh'}
        With a standard normal z and the scale s, the value is ``centre + s z``,
        ``centre exp(s z)``, ``s |z|`` or ``centre + s sinh(z)``; the third is a half-normal prior,
        the last one is heavy-tailed, for parameters that may be many times their usual size.
    centre, prior_scale : float
        See ``form``.
    initial_values : tuple of float
        Initial values of a fit.
    prior_unit : {'', 'load', 'spring'}
        Unit of ``centre``, ``prior_scale`` and ``initial_values``, see :class:`Scale`; SI if empty.
    shape : bool
        Whether it determines only the shape of a law, and is not reported.
    memory : bool
        Whether it determines only how a force depends on the past, which ``track`` neglects.
    form_spread : float
        Standard deviation of the logarithm of the parameter (of a ratio: of its logarithm) over the
        formulas that nature may have chosen instead of the effect's; ``benchmarks/law_forms.py``
        computes it.
    """

    name: str
    unit: str
    form: Form
    centre: float
    prior_scale: float
    initial_values: tuple[float, ...]
    prior_unit: str = ""
    shape: bool = False
    memory: bool = False
    form_spread: float = 0.0

    def size(self, scale: Scale) -> float:
        """Return the factor on the numbers of the prior for one car."""
        return float(getattr(scale, self.prior_unit)) if self.prior_unit else 1.0

    def value(self, z: Array | float, scale: Scale) -> Array:
        """Value for standard normal coordinates."""
        size = self.size(scale)
        if self.form == "log":
            return np.asarray(size * self.centre * np.exp(self.prior_scale * np.asarray(z)))
        if self.form == "positive":
            return np.asarray(size * self.prior_scale * np.abs(z))
        if self.form == "sinh":
            return np.asarray(size * (self.centre + self.prior_scale * np.sinh(np.asarray(z))))
        return np.asarray(size * (self.centre + self.prior_scale * np.asarray(z)))

    @property
    def is_ratio(self) -> bool:
        """Whether one means that there is no effect."""
        return self.form == "log" and not self.unit

    def in_other_forms(self, values: Array, normal: Array) -> Array:
        """Values (N,) in formulas that nature may have chosen, from standard normal draws (N,)."""
        factor = np.exp(self.form_spread * normal)
        return np.asarray(values**factor if self.is_ratio else values * factor)

    def coordinate(self, value: float, scale: Scale) -> float:
        """Coordinate of a value; the inverse of :meth:`value`."""
        value = value / self.size(scale)
        if self.form == "log":
            return math.log(value / self.centre) / self.prior_scale
        if self.form == "positive":
            return abs(value) / self.prior_scale
        if self.form == "sinh":
            return math.asinh((value - self.centre) / self.prior_scale)
        return (value - self.centre) / self.prior_scale


@dataclass(frozen=True, eq=False)
class Effect:
    """A deviation of a car or a sensor from the linear model.

    Parameters
    ----------
    name : str
        As in ``docs/interfaces.md``.
    title : str
        Description for reports.
    acts : {'suspension', 'car', 'reading'}
        Whether it changes the force of an axle, a given value, or the reading of a sensor.
    allowed_places : tuple of str
        Places: axles, both axles alike, channels, groups of channels
        (:data:`bayes_asv.domain.clocks.GROUPS`), or an empty string for the car.
    parameters : tuple of Parameter
        The first is the size, which vanishes without the effect.
    tolerance_values : mapping or None
        Parameter values at one tolerance (1 sd across healthy cars), in units of ``prior_unit``;
        None if healthy cars never show the effect.
    scaled_to_range : callable or None
        From values at one tolerance, and the travel (m) and speed (m/s) of the drive: values with
        the same nonlinearity over that range, if it is smaller than usual.
    tolerance_ratio : callable or None
        From parameter values and the values at one tolerance: size in tolerances; None for the
        ratio of the first parameter (of its logarithm, if that is log-normal).
    code : int
        Branch of :mod:`bayes_asv.filters.force_laws`; −1 for other effects.
    packed : callable or None
        From the parameters' values to the branch's numbers p0, p1, ….
    force : callable or None
        Reference implementation: force in addition to −k δ − c δ̇, N, as a function of the
        parameters' values, c, k, δ, δ̇ and the elapsed share of the recording.
    drive : str
        The drive that shows it best, in words.
    split_between_axles : bool
        Whether an effect on both axles has half of the first parameter at each, instead of all.
    travel : bool
        Whether the law depends on the absolute deflection, so that the static position matters.
    on_car : callable or None
        Changes the car's parameters by name (each (W,)) in place, given the effect's own values,
        place and car.
    on_gain, on_pole : callable or None
        From the effect's values to the factor (W,) on the gain of the channel, or on the pole of
        the filter that the sensor's noise passed.
    fault : {'', 'lag', 'bandwidth', 'drift'}
        Change of the samples of a channel, see :mod:`bayes_asv.posterior.effects`.
    one_sided : bool
        Whether the size cannot be negative.
    stops : {'', 'compression', 'extension'}
        Direction of the motion that a travel stop limits; empty for other effects.
    in_one_run : bool
        Whether it acts in one recording only, in an interval with an unknown start.
    on_damper : bool
        Whether it changes the force–velocity curve of a damper.
    on_spring : bool
        Whether it changes the force–deflection curve of a spring.
    dissipative : bool
        Whether its force opposes the rate of deflection, and dissipates power in addition to the
        damper.
    contains : tuple of str
        Names of effects that are special cases of it.
    free_form : bool
        Whether its law is a curve without a formula; a damper with such a curve has no single rate
        to compare with the nominal one.
    on_request : bool
        Whether it is added only if a user names it or if no other effect explains the residuals;
        score tests do not include it.
    fit_starts : tuple of mapping
        Initial values of its fit, if it is on request.
    """

    name: str
    title: str
    acts: Acts
    allowed_places: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    tolerance_values: Mapping[str, float] | None = None
    scaled_to_range: Callable[[Mapping[str, float], float, float], dict[str, float]] | None = None
    tolerance_ratio: Callable[[Mapping[str, float], Mapping[str, float]], float] | None = None
    code: int = -1
    packed: Callable[[Mapping[str, float]], tuple[float, ...]] | None = None
    force: Callable[..., Array] | None = None
    drive: str = ""
    split_between_axles: bool = False
    travel: bool = False
    on_car: Callable[[dict[str, Array], Mapping[str, Array], str, CarModel], None] | None = None
    on_gain: Callable[[Mapping[str, Array]], Array] | None = None
    on_pole: Callable[[Mapping[str, Array]], Array] | None = None
    fault: Literal["", "lag", "bandwidth", "drift"] = ""
    one_sided: bool = False
    stops: Literal["", "compression", "extension"] = ""
    in_one_run: bool = False
    on_damper: bool = False
    on_spring: bool = False
    dissipative: bool = False
    contains: tuple[str, ...] = ()
    free_form: bool = False
    on_request: bool = False
    fit_starts: tuple[Mapping[str, float], ...] = ({},)

    @property
    def places(self) -> tuple[str, ...]:
        """Places on any car: the allowed ones, and for effects at axles also the corners.

        An external force in one run is considered at axles only.
        """
        at_corners = set(AXLES) <= set(self.allowed_places) and not self.in_one_run
        return (*self.allowed_places, *CORNERS) if at_corners else self.allowed_places

    def tolerance_values_for(self, scale: Scale) -> dict[str, float]:
        """Parameter values at one tolerance for one car, SI units."""
        assert self.tolerance_values is not None
        return {p.name: self.tolerance_values[p.name] * p.size(scale) for p in self.parameters}

    def in_tolerances(self, values: Mapping[str, float], tolerance: Mapping[str, float]) -> float:
        """Return the size of the effect in tolerances.

        Parameters
        ----------
        values, tolerance : mapping
            Parameter values, and those at one tolerance, SI units.
        """
        if self.tolerance_ratio is not None:
            return self.tolerance_ratio(values, tolerance)
        first = self.parameters[0]
        value, one = values[first.name], tolerance[first.name]
        return math.log(value) / math.log(one) if first.form == "log" else value / one


@dataclass(frozen=True)
class PlacedEffect:
    """An effect at one place.

    Parameters
    ----------
    effect : Effect
        The effect.
    where : str
        An axle, ``both``, a corner, a channel, a group of channels, or an empty string.
    run : int or None
        The only recording in which it acts; None for all.
    """

    effect: Effect
    where: str
    run: int | None = None

    def __str__(self) -> str:
        """Name and place in the syntax of the command line."""
        return f"{self.effect.name}@{self.where}" if self.where else self.effect.name

    @property
    def key(self) -> tuple[str, int | None]:
        """Unique key: name with place, and run."""
        return str(self), self.run

    def elements(self, car: CarModel) -> tuple[int, ...]:
        """Return the indices of the suspension elements at which it acts; none for a sensor."""
        return car.elements_at(self.where) if self.where else ()

    def channels(self, names: Sequence[str]) -> tuple[str, ...]:
        """Channels among the given ones whose readings it changes."""
        if self.effect.acts != "reading":
            return ()
        if self.where in GROUPS:
            return members(self.where, names)
        return tuple(name for name in names if name == self.where)

    @property
    def corners(self) -> frozenset[str]:
        """Corners of a car at which it acts; none for a sensor or the car."""
        return frozenset(c for c in CORNERS if self.where in (c, c.partition("_")[0], BOTH))

    def overlaps(self, other: PlacedEffect) -> bool:
        """Whether another effect is the same one at the same place or at a common corner."""
        alike = self.where == other.where or bool(self.corners & other.corners)
        return self.effect.name == other.effect.name and alike

    def subsumes(self, other: PlacedEffect) -> bool:
        """Whether another effect at a common corner is the same one, or a special case of it."""
        form = other.effect.name in self.effect.contains and bool(self.corners & other.corners)
        return form or self.overlaps(other)

    def coordinate_name(self, parameter: Parameter) -> str:
        """Name of a parameter among the coordinates of a posterior."""
        own = f" {self.run}" if self.run is not None else ""
        return f"effect {self} {parameter.name}{own}"
