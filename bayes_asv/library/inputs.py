"""Vehicles and shipped examples, and the checks of what a function of the library is given."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from dataclasses import fields, replace
from html import escape
from pathlib import Path
from typing import Final

from bayes_asv.domain import recording as domain
from bayes_asv.domain import vehicle as vehicles
from bayes_asv.domain.channel_map import ChannelMap
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.units import display_units, from_si, parse_quantity, to_si
from bayes_asv.library.recordings import as_channel_map, check_different

__all__ = [
    "Vehicle",
    "check_car",
    "check_inputs",
    "check_vehicle",
    "example",
    "positive_quantity",
    "read_vehicle",
]

_NOMINAL: Final = ("c_f", "c_r", "i")
_GIVEN: Final = ("m", "l", "wdf", "k_f", "k_r")


class Vehicle(vehicles.Vehicle):
    """A car: given values, nominal values and sensors, in SI units.

    Made by :func:`read_vehicle`; ``dataclasses.replace`` changes a value.
    """

    __slots__ = ()

    def to_toml(self) -> str:
        """Return the text of a vehicle file, in the vehicle's display units."""
        return vehicles.to_toml(self)

    def __repr__(self) -> str:
        values = ", ".join(f"{name} {self._shown(name)}" for name in (*_NOMINAL, *_GIVEN))
        return f"<Vehicle {self.name[:60]!r}: {values}>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th>{name}</th><td>{escape(QUANTITIES[name][1])}</td>"
            f"<td>{escape(self._shown(name))}</td><td>{escape(self._deviation(name))}</td></tr>"
            for name in (*_NOMINAL, *_GIVEN)
        )
        return (
            f"<div><b>{escape(self.name)}</b><table><thead><tr><th></th><th>quantity</th>"
            f"<th>value</th><th>sd</th></tr></thead><tbody>{rows}</tbody></table></div>"
        )

    def _shown(self, name: str) -> str:
        dimension = QUANTITIES[name][0]
        unit = display_units(self.units)[dimension]
        value = from_si(getattr(self, name).value, unit, dimension)
        return f"{value:.4g} {unit}".rstrip()

    def _deviation(self, name: str) -> str:
        given = getattr(self, name)
        if given.sd is None:
            return "not given"
        return f"{100.0 * given.sd / given.value:.2g} %" if given.sd else "exact"


def read_vehicle(path: PathLike, *, channels: PathLike | ChannelMap | None = None) -> Vehicle:
    """Read a vehicle file.

    Parameters
    ----------
    path : str or os.PathLike
        A TOML file, described in ``docs/vehicle.md``.
    channels : str, os.PathLike or ChannelMap, optional
        A channel map or its file, instead of that of the vehicle file; it says where sensors on the
        body sit.

    Returns
    -------
    Vehicle

    Raises
    ------
    InputError
        If the file cannot be read or a value is implausible; the message names key and fix.
    """
    car = vehicles.read_vehicle(path)
    mapped = as_channel_map(channels)
    if mapped is not None:
        car = car.with_channel_map(mapped)
    return Vehicle(**{f.name: getattr(car, f.name) for f in fields(car)})


def example(name: str) -> Path:
    """Return the path of a recording or a vehicle that is shipped with the package.

    Parameters
    ----------
    name : str
        Such as ``"stops-400hz.csv"`` or ``"baja2008.toml"``.

    Returns
    -------
    pathlib.Path

    Raises
    ------
    InputError
        If there is no such file; the message names those that there are.
    """
    from bayes_asv.shipped import shipped

    folder = "vehicles" if name.endswith(".toml") else "recordings"
    try:
        return shipped(folder, name)
    except FileNotFoundError:
        there = sorted(p.name for p in shipped(folder).iterdir() if p.suffix in (".csv", ".toml"))
        raise InputError(name, "is not shipped", f"there are {', '.join(there)}") from None


def check_inputs(
    function: str, recordings: object, vehicle: object, *, car: str | None = None
) -> tuple[tuple[domain.Recording, ...], vehicles.Vehicle]:
    """Check what a function of the library was given, before it computes.

    Parameters
    ----------
    function : str
        Its name, for messages.
    recordings : Recording or iterable of Recording
        What was measured.
    vehicle : Vehicle
        The car.
    car : str, optional
        Model of the car whose inputs must be among the channels; by default the channels must be
        the four of the half car.

    Returns
    -------
    recordings : tuple of Recording
        At least one, all different.
    vehicle : Vehicle

    Raises
    ------
    TypeError
        If an argument is of another type; the message says how to write the call.
    InputError
        If a recording has other channels or is given twice.
    """
    call = f"write asv.{function}(recordings, vehicle)"
    check_car(car)
    car_given = check_vehicle(function, vehicle, call)
    runs: list[domain.Recording] = []
    given: Iterable[object]
    if isinstance(recordings, domain.Recording | str | os.PathLike) or hasattr(
        recordings, "columns"
    ):
        given = [recordings]
    elif isinstance(recordings, Iterable):
        given = recordings
    else:
        raise TypeError(f"{function}: the recordings are {_kind(recordings)}; {call}")
    for run in given:
        if not isinstance(run, domain.Recording):
            fix = call
            if isinstance(run, str | os.PathLike):
                fix = f"read the file first: asv.read_recording({os.fspath(run)!r})"
            elif hasattr(run, "columns"):
                fix = "convert the table first: asv.Recording.from_dataframe(table)"
            raise TypeError(f"{function}: a recording is {_kind(run)}; {fix}")
        if car is None:
            domain.require_half_car(run)
        else:
            from bayes_asv.models.cars import car_model
            from bayes_asv.preprocessing.prepare import used_channels

            used_channels(run, car_given, car_model(car, car_given))
        check_different(runs, run)
        # messages and reports name each recording
        runs.append(run if run.source else replace(run, source=f"recording {len(runs) + 1}"))
    if not runs:
        raise InputError(function, "no recording was given", "give at least one")
    return tuple(runs), car_given


def check_car(car: str | None) -> None:
    """Refuse a name that no model of a car has."""
    from bayes_asv.models.cars import CARS

    if car is not None and car not in CARS:
        raise InputError(f"car={car!r}", "there is no such car", f"give one of {', '.join(CARS)}")


def check_vehicle(function: str, vehicle: object, call: str = "") -> vehicles.Vehicle:
    """Check that a vehicle is one; the message says how to write the call."""
    if isinstance(vehicle, vehicles.Vehicle):
        return vehicle
    fix = call or f"write asv.{function}(vehicle)"
    if isinstance(vehicle, str | os.PathLike):
        fix = f"read the file first: asv.read_vehicle({os.fspath(vehicle)!r})"
    raise TypeError(f"{function}: the vehicle is {_kind(vehicle)}; {fix}")


def _kind(value: object) -> str:
    return f"a {type(value).__name__}" if value is not None else "missing"


def positive_quantity(
    name: str,
    text: str | None,
    dimension: str,
    example: str,
    limits: tuple[float, float] = (0.0, math.inf),
) -> float | None:
    """Read a positive quantity with its unit.

    Parameters
    ----------
    name : str
        Of the argument, for messages.
    text : str or None
        Such as ``"12 mph"``.
    dimension : str
        As in :mod:`bayes_asv.domain.units`.
    example : str
        A text that fits.
    limits : pair of float
        Smallest and largest value, SI units.

    Returns
    -------
    float or None
        SI units; None for None.

    Raises
    ------
    InputError
        If it is not such a quantity.
    """
    if text is None:
        return None
    if not isinstance(text, str):
        raise InputError(name, f"{text!r} has no unit", f"write '{example}'")
    try:
        value = to_si(*parse_quantity(text), dimension)
    except InputError as fault:
        raise InputError(name, f"{fault.where} {fault.what}", f"write '{example}'") from None
    low, high = limits
    if not (low <= value <= high and 0.0 < value < math.inf):
        if high == math.inf:
            raise InputError(name, "has to be above zero", f"write '{example}'")
        raise InputError(name, f"has to be between {low:g} and {high:g} in SI units")
    return value
