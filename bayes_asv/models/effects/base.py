"""What an effect is: a law with its parameters, priors and usual tolerances.

A *tolerance* is the deviation of an effect that nobody would call a fault: data sheets allow
it, and a real car has a little of everything.  Naming an effect means that its main parameter
is given the wide prior instead.
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
    """Sizes of one car that priors are given in.

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
    """One parameter of an effect and what is believed of it once the effect is named.

    Parameters
    ----------
    name, unit : str
        As in ``docs/interfaces.md``; the unit is SI.
    form : {'linear', 'log', 'positive', 'sinh'}
        The value is ``centre + wide z``, ``centre exp(wide z)``, ``wide |z|`` or
        ``centre + wide sinh(z)`` of a standard normal z; the third is a half-normal prior, the
        last one has long tails, for what may be many times its usual size.
    centre, prior_scale : float
        See ``form``.
    initial_values : tuple of float
        Values from which a fit begins.
    prior_unit : {'', 'load', 'spring'}
        What ``centre``, ``prior_scale`` and ``initial_values`` are shares of; nothing when empty.
    shape : bool
        It only says how sharply a law bends, and is not reported.
    """

    name: str
    unit: str
    form: Form
    centre: float
    prior_scale: float
    initial_values: tuple[float, ...]
    prior_unit: str = ""
    shape: bool = False

    def size(self, scale: Scale) -> float:
        """Return what the prior's numbers are multiplied by for one car."""
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
    """Something that a car or a sensor may do and the linear half car does not.

    Parameters
    ----------
    name : str
        As in ``docs/interfaces.md``.
    title : str
        In words, for reports.
    acts : {'suspension', 'car', 'reading'}
        On the force of an axle, on a given value, or on what a sensor says.
    allowed_places : tuple of str
        Where it can be: axles, both of them alike, channels, groups of channels
        (:data:`bayes_asv.domain.clocks.GROUPS`), or an empty string.
    parameters : tuple of Parameter
        The first is the one that vanishes with the effect.
    tolerance_values : mapping or None
        Values of the parameters (times their ``per``) that are one deviation of what every car
        may have; None when nobody has a little of it.
    scaled_to_range : callable or None
        From the values that are a little of it, the travel (m) and the speed (m/s) that were used:
        the values of a law that is as straight over those, where they are less than usual.
    tolerance_ratio : callable or None
        From values and the values that are a little of it: how many times that they are, where
        that is not a matter of the first parameter alone.
    code : int
        Branch of :mod:`bayes_asv.filters.force_laws`; −1 for other effects.
    packed : callable or None
        From the parameters' values to the branch's p0 … p3.
    force : callable or None
        The readable form: what the law adds to −k δ − c δ̇ (N), as a function of the parameters'
        values, c, k, δ, δ̇ and the share of the recording that has gone by.
    drive : str
        The drive that shows it best, in words.
    split_between_axles : bool
        On both axles each gets half of the first parameter, in place of all of it.
    travel : bool
        The law depends on where the suspension is, so that it matters where that is at rest.
    on_car : callable or None
        Changes the car's parameters by name (each (W,)) in place, given the effect's own values,
        its place and the car.
    on_gain, on_pole : callable or None
        From the effect's values to the factor (W,) on the gain of the channel, or on the pole that
        the sensor's own noise passed.
    fault : {'', 'lag', 'bandwidth', 'drift'}
        What it does to the samples of a channel, see :mod:`bayes_asv.posterior.effects`.
    one_sided : bool
        There cannot be less than nothing of it.
    stops : {'', 'compression', 'extension'}
        The motion that it stops.
    in_one_run : bool
        It acts in one recording only, at a time of its own.
    on_damper : bool
        It changes the force of a damper over its speed.
    on_spring : bool
        It changes the force of a spring over its deflection.
    dissipative : bool
        Its force is against the rate of deflection and takes power beside that of the damper.
    contains : tuple of str
        Names of effects that are special forms of it.
    free_form : bool
        Its law is a curve without a formula: a damper with it has no single rate to hold against a
        nominal one.
    on_request : bool
        It is added where a user names it, or where no other effect explains what is left; no score
        test looks for it.
    fit_starts : tuple of mapping
        Values of parameters from which its fit begins, where it is on request.
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
        """Where it can be on any car: what may be at an axle may be at one corner of it.

        A push in one run is looked for at axles alone.
        """
        at_corners = set(AXLES) <= set(self.allowed_places) and not self.in_one_run
        return (*self.allowed_places, *CORNERS) if at_corners else self.allowed_places

    def tolerance_values_for(self, scale: Scale) -> dict[str, float]:
        """Values at one tolerance, for one car."""
        assert self.tolerance_values is not None
        return {p.name: self.tolerance_values[p.name] * p.size(scale) for p in self.parameters}

    def in_tolerances(self, values: Mapping[str, float], little: Mapping[str, float]) -> float:
        """Say how many times a little of it some values are.

        Parameters
        ----------
        values, little : mapping
            Values of its parameters, SI units, and those that are one tolerance.
        """
        if self.tolerance_ratio is not None:
            return self.tolerance_ratio(values, little)
        first = self.parameters[0]
        value, one = values[first.name], little[first.name]
        return math.log(value) / math.log(one) if first.form == "log" else value / one


@dataclass(frozen=True)
class PlacedEffect:
    """An effect at one place.

    Parameters
    ----------
    effect : Effect
        What.
    where : str
        An axle, ``both``, a corner, a channel, a group of channels, or an empty string.
    run : int or None
        The only recording in which it acts; None for all.
    """

    effect: Effect
    where: str
    run: int | None = None

    def __str__(self) -> str:
        """Name and place as the command line takes them."""
        return f"{self.effect.name}@{self.where}" if self.where else self.effect.name

    @property
    def key(self) -> tuple[str, int | None]:
        """What tells it from every other one."""
        return str(self), self.run

    def elements(self, car: CarModel) -> tuple[int, ...]:
        """Numbers of the suspension elements of a car at which it acts; none for a sensor."""
        return car.elements_at(self.where) if self.where else ()

    def channels(self, names: Sequence[str]) -> tuple[str, ...]:
        """Channels among some whose readings it changes: that of its place, or those of a group."""
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
        """Whether it is the same effect at a corner in common, or at the same place."""
        alike = self.where == other.where or bool(self.corners & other.corners)
        return self.effect.name == other.effect.name and alike

    def subsumes(self, other: PlacedEffect) -> bool:
        """Whether another effect at a corner in common is this one, or a special form of it."""
        form = other.effect.name in self.effect.contains and bool(self.corners & other.corners)
        return form or self.overlaps(other)

    def coordinate_name(self, parameter: Parameter) -> str:
        """Name of a parameter among the coordinates of a posterior."""
        own = f" {self.run}" if self.run is not None else ""
        return f"effect {self} {parameter.name}{own}"
