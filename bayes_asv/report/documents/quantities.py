"""Draws as summaries, and SI values in the units of a document."""

from __future__ import annotations

import math
import platform
from collections.abc import Iterable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any, TypedDict, overload

import numpy as np
from numpy.typing import NDArray

from bayes_asv import __version__
from bayes_asv.analysis.curve_shapes import CurveShape
from bayes_asv.analysis.damping_rates import DampingRates
from bayes_asv.analysis.nominal_values import NominalDamping
from bayes_asv.analysis.spring_curves import SpringCurve
from bayes_asv.domain.quantities import NORMAL_975, QUANTITIES
from bayes_asv.domain.units import display_units, from_si
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.effects import Parameter as EffectParameter
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.models.outputs import relative_offset
from bayes_asv.report.schema import parts as schema
from bayes_asv.report.schema.parts import (
    Effect,
    EffectValue,
    Parameter,
    Provenance,
    Quantity,
    SourceFile,
)

__all__ = [
    "NORMAL_975",
    "SummaryFields",
    "Units",
    "damper_rates",
    "effect_unit",
    "effect_value",
    "effects",
    "parameter",
    "possible_mistakes",
    "provenance",
    "spring_curve",
    "summary",
    "without_single_rate",
]

Array = NDArray[np.float64]


_EFFECT_DIMENSIONS = {
    "N": "force", "N/m": "stiffness", "m": "length", "m/s": "velocity", "s": "time",
}  # fmt: skip


class SummaryFields(TypedDict):
    """Fields of :class:`~bayes_asv.report.schema.parts.Summary`."""

    mean: float
    median: float
    sd: float
    eti95: list[float]


class Units:
    """Display units of a system.

    Parameters
    ----------
    system : {'US', 'SI'}
        As in the vehicle file.
    """

    def __init__(self, system: str) -> None:
        self._units = display_units(system)

    def unit(self, dimension: str) -> str:
        """Return the unit of a dimension such as ``damping``."""
        return self._units[dimension]

    def unit_of(self, name: str) -> str:
        """Return the unit of a parameter such as ``c_f``."""
        return self._units[QUANTITIES[name][0]]

    @overload
    def convert(self, value: float, dimension: str) -> float: ...
    @overload
    def convert(self, value: Array, dimension: str) -> Array: ...
    def convert(self, value: float | Array, dimension: str) -> float | Array:
        """Convert from SI."""
        factor = float(from_si(1.0, self._units[dimension], dimension))
        return value * factor if isinstance(value, np.ndarray) else float(value) * factor

    @overload
    def convert_parameter(self, value: float, name: str) -> float: ...
    @overload
    def convert_parameter(self, value: Array, name: str) -> Array: ...
    def convert_parameter(self, value: float | Array, name: str) -> float | Array:
        """Convert a parameter such as ``c_f`` from SI."""
        return self.convert(value, QUANTITIES[name][0])

    def curve(self, values: Array, dimension: str = "time") -> list[float | None]:
        """Convert a curve from SI, with six significant digits; None where it has no number."""
        converted = self.convert(values, dimension)
        return [float(f"{v:.6g}") if math.isfinite(v) else None for v in converted]


def summary(draws: Array) -> SummaryFields:
    """Mean, median, standard deviation and equal-tailed 95 % interval of draws."""
    x = draws.ravel()
    low, median, high = (float(q) for q in np.quantile(x, [0.025, 0.5, 0.975]))
    return {
        "mean": float(x.mean()), "median": median, "sd": float(x.std(ddof=1)), "eti95": [low, high]
    }  # fmt: skip


def parameter(name: str, draws: Array, vehicle: Vehicle, nominal: float | None = None) -> Parameter:
    """Summarise the draws (N,) of a parameter, SI units, in the vehicle's units and in SI.

    The nominal value (SI units) is that of the vehicle file unless it is given.
    """
    units, si = Units(vehicle.units), Units("SI")
    if nominal is None:
        given = getattr(vehicle, name)
        nominal = float(given if isinstance(given, float) else given.value)
    return Parameter(
        label=QUANTITIES[name][1],
        unit=units.unit_of(name),
        **summary(units.convert_parameter(draws, name)),
        nominal=units.convert_parameter(nominal, name),
        p_below_nominal=float(np.mean(draws < nominal)),
        si=Quantity(unit=si.unit_of(name), **summary(draws), nominal=nominal),
    )


def possible_mistakes(found: NominalDamping | None) -> list[schema.PossibleMistake]:
    """Entries of mistakes in nominal damping that explain the estimated rates as well."""
    mistakes = () if found is None else found.mistakes
    return [
        schema.PossibleMistake(words=m.words, fix=m.fix, probability=m.probability)
        for m in mistakes
    ]


def damper_rates(damper: DampingRates, units: Units) -> schema.DampingRates:
    """Entry of a damper whose force is not proportional to speed."""

    def rate(draws: Array) -> EffectValue:
        return _value(units.convert(draws, "damping"), units.unit("damping"))

    return schema.DampingRates(
        element=damper.element,
        speed=units.convert(damper.speed, "velocity"),
        speed_unit=units.unit("velocity"),
        at_rest=rate(damper.at_rest),
        equal_power=rate(damper.equal_power),
        compression=rate(damper.compression),
        extension=rate(damper.extension),
        shapes=[schema.DamperShape(**_shape(one)) for one in damper.shapes],
    )


def spring_curve(spring: SpringCurve, nominal: float, units: Units) -> schema.SpringCurve:
    """Entry of a spring with a free curve; the nominal stiffness is in N/m."""

    def stiffness(draws: Array) -> EffectValue:
        return _value(units.convert(draws, "stiffness"), units.unit("stiffness"))

    low, median, high = (
        units.curve(curve, "force")
        for curve in np.quantile(spring.force, [0.025, 0.5, 0.975], axis=0)
    )
    compression, extension = spring.travel
    return schema.SpringCurve(
        element=spring.element,
        travel=[units.convert(x, "deflection") for x in (-compression, extension)],
        unit=units.unit("deflection"),
        force_unit=units.unit("force"),
        at_rest=stiffness(spring.at_rest),
        compression=stiffness(spring.compression),
        extension=stiffness(spring.extension),
        shapes=[schema.SpringShape(**_shape(one)) for one in spring.shapes],
        deflection=units.curve(spring.deflection, "deflection"),
        median=median,
        band95=[low, high],
        nominal=units.curve(nominal * spring.deflection, "force"),
    )


def _shape(shape: CurveShape) -> dict[str, Any]:
    # of a positive ratio the mean is geometric: that of skewed draws may be beyond most of them
    ratio = _value(shape.ratio)
    ratio.mean = float(np.exp(np.mean(np.log(shape.ratio))))
    return {**shape._asdict(), "ratio": ratio}


def _value(draws: Array, unit: str = "") -> EffectValue:
    """Mean and 95 % interval of draws (N,)."""
    low, high = (float(q) for q in np.quantile(draws, [0.025, 0.975]))
    return EffectValue(mean=float(np.mean(draws)), eti95=[low, high], unit=unit)


def without_single_rate(dampers: Iterable[DampingRates]) -> set[str]:
    """Names of the parameters of dampers with a free curve, which no nominal value is held to."""
    return {name for damper in dampers if damper.free_form for name in damper.names}


def effects(draws: Mapping[PlacedEffect, Mapping[str, Array]], vehicle: Vehicle) -> list[Effect]:
    """Effects with draws (any shape) of their parameters, SI units."""
    return [
        Effect(
            name=placed.effect.name,
            where=placed.where or None,
            title=placed.effect.title,
            parameters={
                p.name: effect_value(p, values[p.name].ravel(), placed, vehicle)
                for p in placed.effect.parameters
                if p.name in values
            },
        )
        for placed, values in draws.items()
    ]


def effect_value(
    parameter: EffectParameter, draws: Array, placed: PlacedEffect, vehicle: Vehicle
) -> EffectValue:
    """Mean and 95 % interval of one parameter of an effect from draws (N,), SI units.

    The interval includes that nature may have chosen another formula than the effect's.
    """
    units = Units(vehicle.units)
    factor, unit = effect_unit(parameter.unit, units)
    if parameter.unit == "share":  # of the declared bandwidth
        factor, unit = float(vehicle.sensor(placed.where).bandwidth or 1.0), "Hz"
    if parameter.unit == "m/s^3":  # of another quantity as large a share of its offset
        channel = vehicle.channel(placed.where)
        factor = relative_offset(channel.quantity) * units.convert(1.0, channel.dimension)
        unit = f"{units.unit(channel.dimension)}/s"
    normal = np.random.default_rng(len(draws)).standard_normal(len(draws))
    widened = parameter.in_other_forms(draws, normal)
    low, high = (float(q) * factor for q in np.quantile(widened, [0.025, 0.975]))
    return EffectValue(mean=float(draws.mean()) * factor, eti95=[low, high], unit=unit)


def effect_unit(unit: str, units: Units) -> tuple[float, str]:
    """Factor from SI, and the unit in which a parameter of an effect is shown."""
    if unit in _EFFECT_DIMENSIONS:
        dimension = _EFFECT_DIMENSIONS[unit]
        return units.convert(1.0, dimension), units.unit(dimension)
    if unit == "1/m^2":
        return units.convert(1.0, "length") ** -2, f"1/{units.unit('length')}^2"
    return 1.0, unit


def provenance(
    recordings: Iterable[tuple[str, str]], vehicle: Vehicle, packages: Iterable[str], seed: int
) -> Provenance:
    """Files (source and hash of each recording), versions and seed."""
    return Provenance(
        recordings=[SourceFile(file=Path(source).name, sha256=h) for source, h in recordings],
        vehicle=SourceFile(file=Path(vehicle.source).name, sha256=vehicle.sha256),
        bayes_asv=__version__,
        python=platform.python_version(),
        packages={name: metadata.version(name) for name in packages},
        seed=seed,
    )
