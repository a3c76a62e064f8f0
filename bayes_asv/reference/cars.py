"""Modes of the cars beyond the half car as plain data and in lines for a terminal."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from bayes_asv import __version__
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.from_vehicle import full_car, half_car4, quarter_cars, roll_car
from bayes_asv.models.mode_shapes import Car, car_modes, places
from bayes_asv.reference.document import clean, mode_document
from bayes_asv.report.readable import percent, plain

__all__ = ["CAR_MODES_SCHEMA", "TITLES", "car_modes_document", "car_modes_lines"]

Document = dict[str, Any]

CAR_MODES_SCHEMA: Final = "bayes_asv/car_modes/1"

TITLES: Final[Mapping[str, str]] = {
    "quarter": "quarter car, two degrees of freedom",
    "half4": "half car with wheels, four degrees of freedom",
    "full7": "whole car, seven degrees of freedom",
    "roll": "chassis that rolls, wheels held still, three degrees of freedom",
}
_SMALL: Final = 0.005


def car_modes_document(vehicle: Vehicle, which: str) -> Document:
    """Tell the modes of a nominal car.

    Parameters
    ----------
    vehicle : Vehicle
        As read.
    which : str
        A key of :data:`TITLES`.

    Raises
    ------
    InputError
        If the file lacks what this car needs.
    """
    make: Mapping[str, Callable[[Vehicle], Mapping[str, Car]]] = {
        "quarter": quarter_cars,
        "half4": lambda given: {"": half_car4(given)},
        "full7": lambda given: {"": full_car(given)},
        "roll": lambda given: {"": roll_car(given)},
    }
    cars = make[which](vehicle)
    found: list[Document] = []
    undamped: list[Document] = []
    for part, car in cars.items():
        labels, _ = places(car)
        for mode, kind, share in car_modes(car):
            entry = {"corner": part or None, "kind": kind, "energy_share": share}
            found.append({**entry, **mode_document(mode, labels)})
        undamped += [
            {"corner": part or None, "kind": kind, "natural_hz": mode.natural}
            for mode, kind, _ in car_modes(car, damped=False)
        ]
    document = clean(
        {
            "schema": CAR_MODES_SCHEMA,
            "verdict": "ok",
            "vehicle": vehicle.name,
            "car": which,
            "modes": found,
            "undamped": undamped,
            "version": __version__,
        }
    )
    assert isinstance(document, dict)
    return document


def car_modes_lines(document: Document) -> list[str]:
    """Tell the document of ``bayes-asv modes --car``."""
    lines = [f"Modes of {plain(document['vehicle'])}, {TITLES[document['car']]}:"]
    corner = None
    for mode in document["modes"]:
        if mode["corner"] != corner:
            corner = mode["corner"]
            lines.append(f"  {corner} corner")
        motion = (
            f"damped {mode['damped_hz']:.3f} Hz, ratio {mode['ratio']:.3f}"
            if mode["oscillates"]
            else "does not oscillate"
        )
        lines.append(
            f"  {mode['natural_hz']:.3f} Hz, {motion}; mostly {mode['kind']} "
            f"({percent(mode['energy_share'])} of the energy)"
        )
        shape = ", ".join(
            f"{name} {part['size']:.2f}"
            + (f" at {round(part['phase_deg']):+d}°" if part["size"] > _SMALL else "")
            for name, part in mode["shape"].items()
        )
        lines.append(f"      {shape}".replace("-", "−"))
    still = ", ".join(
        f"{mode['corner'] + ' ' if mode['corner'] else ''}{mode['kind']} {mode['natural_hz']:.3f}"
        for mode in document["undamped"]
    )
    lines.append(f"Without damping: {still} Hz")
    return lines
