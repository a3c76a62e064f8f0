"""Parameters of effects in the vehicle's units."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.units import display_units, from_si
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.effects import Parameter, Site

__all__ = ["effect_value", "effects_document"]

Array = NDArray[np.float64]
Document = dict[str, Any]

_DIMENSIONS = {
    "N": "force", "N/m": "stiffness", "m": "length", "m/s": "velocity", "s": "time",
}  # fmt: skip


def effects_document(effects: dict[Site, dict[str, Array]], vehicle: Vehicle) -> list[Document]:
    """Tell the effects of an extended model, with draws (any shape) of their parameters in SI."""
    return [
        {
            "name": site.effect.name,
            "where": site.where or None,
            "title": site.effect.title,
            "parameters": {
                p.name: effect_value(p, draws[p.name].ravel(), site, vehicle)
                for p in site.effect.parameters
                if p.name in draws
            },
        }
        for site, draws in effects.items()
    ]


def effect_value(parameter: Parameter, draws: Array, site: Site, vehicle: Vehicle) -> Document:
    """Mean and 95 % interval of one parameter from draws (N,), SI units."""
    factor, unit = _unit(parameter.unit, vehicle)
    if parameter.unit == "share":  # of the declared corner
        factor, unit = float(vehicle.sensor(site.where).bandwidth or 1.0), "Hz"
    low, high = np.quantile(draws, [0.025, 0.975]) * factor
    return {"mean": float(draws.mean() * factor), "eti95": [float(low), float(high)], "unit": unit}


def _unit(unit: str, vehicle: Vehicle) -> tuple[float, str]:
    """Factor from SI and the unit in which a parameter is shown."""
    shown = display_units(vehicle.units)
    if unit in _DIMENSIONS:
        dimension = _DIMENSIONS[unit]
        return float(from_si(1.0, shown[dimension], dimension)), shown[dimension]
    length = float(from_si(1.0, shown["length"], "length"))
    if unit == "1/m^2":
        return length**-2, f"1/{shown['length']}^2"
    if unit == "m/s^3":
        return float(from_si(1.0, shown["acceleration"], "acceleration")), (
            f"{shown['acceleration']}/s"
        )
    return 1.0, unit
