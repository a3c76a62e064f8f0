"""Metadata of a live view: names, units, nominal values and travel limits."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass

from bayes_asv.domain.channels import AXLES
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.units import display_units, si_factor
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.report.words import plain, readable_unit
from bayes_asv.tracking.frames import PARAMETERS

__all__ = ["AXLES", "Parameter", "ViewMetadata", "view_metadata"]


@dataclass(frozen=True)
class Parameter:
    """A parameter as it is displayed.

    Parameters
    ----------
    name : str
        ``c_f``, ``c_r`` or ``i``.
    label, unit : str
        Name in words, and unit as people write it.
    factor : float
        SI units in one display unit.
    nominal : float
        In the display unit.
    """

    name: str
    label: str
    unit: str
    factor: float
    nominal: float


@dataclass(frozen=True)
class ViewMetadata:
    """What the views need to know about the car and the recording; display units.

    Parameters
    ----------
    vehicle, source : str
        Printable names.
    parameters : tuple of 3 Parameter
        c_f, c_r, i.
    acceleration, deflection : (str, float)
        Unit as people write it, and its value in SI units.
    limits : tuple of 2 (float or None, float or None)
        Front and rear: deflection at the bump stop (negative) and at the droop stop (positive).
    live : bool
        Whether the rows come from a port at this moment.
    duration : float or None
        Length of the recording, s; None if it is unknown.
    """

    vehicle: str
    source: str
    parameters: tuple[Parameter, ...]
    acceleration: tuple[str, float]
    deflection: tuple[str, float]
    limits: tuple[tuple[float | None, float | None], ...]
    live: bool
    duration: float | None


def view_metadata(
    vehicle: Vehicle, source: str, duration: float | None, *, live: bool = False
) -> ViewMetadata:
    """Collect what the views need.

    Parameters
    ----------
    vehicle : Vehicle
        Its ``units`` are the display units.
    source : str
        File or port.
    duration : float or None
        Length of the recording, s.
    live : bool
        Whether the rows come from a port at this moment.

    Returns
    -------
    ViewMetadata
        In display units.
    """
    units = display_units(vehicle.units)

    def factor(dimension: str) -> float:
        return si_factor(units[dimension], dimension)

    parameters = []
    for name in PARAMETERS:
        dimension, label = QUANTITIES[name]
        parameters.append(
            Parameter(
                name,
                label,
                readable_unit(units[dimension]),
                factor(dimension),
                getattr(vehicle, name).value / factor(dimension),
            )
        )
    length = factor("deflection")
    limits = []
    for axle in AXLES:
        bump, droop = (getattr(vehicle.travel, f"{axle}_{end}") for end in ("bump", "droop"))
        limits.append(
            (None if bump is None else -bump / length, None if droop is None else droop / length)
        )
    return ViewMetadata(
        vehicle=plain(vehicle.name) or "unnamed vehicle",
        source=plain(source if live else os.path.basename(source)),
        parameters=tuple(parameters),
        acceleration=(readable_unit(units["acceleration"]), factor("acceleration")),
        deflection=(readable_unit(units["deflection"]), length),
        limits=tuple(limits),
        live=live,
        duration=None if duration is None or not math.isfinite(duration) else duration,
    )
