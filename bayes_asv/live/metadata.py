"""Metadata of a live view: names, units, curves, nominal values and travel limits."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from bayes_asv.domain.channels import CHANNELS, Channel
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.units import display_units, si_factor
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.car_model import CarModel
from bayes_asv.models.cars import car_model
from bayes_asv.report.words import plain, readable_unit

__all__ = ["MeasuredOutput", "Parameter", "ViewMetadata", "view_metadata"]


@dataclass(frozen=True)
class Parameter:
    """A parameter as it is displayed.

    Parameters
    ----------
    name : str
        Such as ``c_f``, ``c_r`` or ``i``.
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
class MeasuredOutput:
    """A measured output as it is displayed.

    Parameters
    ----------
    key : str
        Name of its curves: that of the suspension element below it, or its channel in words.
    label, unit, sign : str
        Name in words, unit as people write it, and what is positive.
    factor : float
        SI units in one display unit.
    """

    key: str
    label: str
    unit: str
    sign: str
    factor: float


@dataclass(frozen=True)
class ViewMetadata:
    """What the views need to know about the car and the recording; display units.

    Parameters
    ----------
    vehicle, source : str
        Printable names.
    parameters : tuple of na Parameter
        Such as c_f, c_r and i.
    outputs : tuple of ny MeasuredOutput
        What is measured beside the wheels.
    elements : tuple of ne str
        Suspension elements: ``front``, ``rear_left``, ….
    deflection : (str, float)
        Unit as people write it, and its value in SI units.
    limits : tuple of ne (float or None, float or None)
        Of each element: deflection at the bump stop (negative) and at the droop stop (positive).
    dampers : tuple of ne int
        Place among the parameters of each element's damping rate.
    force : (str, float)
        Unit as people write it, and the force, in that unit, of a damper with a rate of one at a
        speed of one deflection a second.
    live : bool
        Whether the rows come from a port at this moment.
    duration : float or None
        Length of the recording, s; None if it is unknown.
    """

    vehicle: str
    source: str
    parameters: tuple[Parameter, ...]
    outputs: tuple[MeasuredOutput, ...]
    elements: tuple[str, ...]
    deflection: tuple[str, float]
    limits: tuple[tuple[float | None, float | None], ...]
    dampers: tuple[int, ...]
    force: tuple[str, float]
    live: bool
    duration: float | None

    @cached_property
    def traces(self) -> tuple[str, ...]:
        """Names of the curves against time.

        Element by element what is measured above it and its deflection, then the other outputs.
        """
        names: list[str] = []
        for element in self.elements:
            if any(output.key == element for output in self.outputs):
                names += _output_curves(element)
            names += [f"{element} deflection{edge}" for edge in ("", " low", " high")]
        for output in self.outputs:
            if output.key not in self.elements:
                names += _output_curves(output.key)
        return (*names, "nis", "nis low", "nis high")

    @cached_property
    def band_sides(self) -> tuple[int, ...]:
        """For each of the curves: the lower (-1) or upper (1) edge of a band, or a curve (0)."""
        return tuple(
            -1 if name.endswith(" low") else 1 if name.endswith(" high") else 0
            for name in self.traces
        )


def _output_curves(key: str) -> list[str]:
    return [f"{key} {what}" for what in _OUTPUT_CURVES]


_OUTPUT_CURVES = ("measured", "predicted", "predicted low", "predicted high")
_SIGNS = {
    "acceleration": "up positive", "deflection": "extension positive",
    "angular_rate": "nose or left side up positive",
}  # fmt: skip


def _measured_output(channel: Channel, car: CarModel, vehicle: Vehicle) -> MeasuredOutput:
    above = [e.name for e in car.elements if (e.axle, e.side) == (channel.axle, channel.side)]
    chassis = channel.part == "body" and channel.axis is None and above
    label = f"{channel.words} acceleration" if channel.quantity == "acceleration" else channel.words
    unit = display_units(vehicle.units)[channel.dimension]
    return MeasuredOutput(
        above[0] if chassis else channel.words, label, readable_unit(unit),
        _SIGNS[channel.quantity], si_factor(unit, channel.dimension),
    )  # fmt: skip


def view_metadata(
    vehicle: Vehicle,
    source: str,
    duration: float | None,
    *,
    car: str = "half",
    channels: Sequence[str] = CHANNELS,
    live: bool = False,
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
    car : str
        Model of the car, see :data:`bayes_asv.models.cars.CARS`.
    channels : sequence of str
        Channels of the recording.
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
    model = car_model(car, vehicle)
    for name in model.estimated:
        dimension, label = QUANTITIES[name]
        parameters.append(
            Parameter(
                name,
                label,
                readable_unit(units[dimension]),
                factor(dimension),
                float(model.nominal[name][0]) / factor(dimension),
            )
        )
    length = factor("deflection")
    limits = []
    for element in model.elements:
        ends = [f"{element.axle}_{end}" for end in ("bump", "droop")]
        bump, droop = (getattr(vehicle.travel, end) for end in ends)
        limits.append(
            (None if bump is None else -bump / length, None if droop is None else droop / length)
        )
    return ViewMetadata(
        vehicle=plain(vehicle.name) or "unnamed vehicle",
        source=plain(source if live else os.path.basename(source)),
        parameters=tuple(parameters),
        outputs=tuple(
            _measured_output(channel, model, vehicle)
            for channel in map(vehicle.channel, channels)
            if model.has_channel(channel) and not channel.is_input
        ),
        elements=tuple(element.name for element in model.elements),
        deflection=(readable_unit(units["deflection"]), length),
        limits=tuple(limits),
        dampers=tuple(model.estimated.index(element.damping) for element in model.elements),
        force=(readable_unit(units["force"]), factor("damping") * length / factor("force")),
        live=live,
        duration=None if duration is None or not math.isfinite(duration) else duration,
    )
