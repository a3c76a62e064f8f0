"""Documents and terminal lines of ``bayes-asv modes``: modes of every car, and spectra."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
from scipy.signal import find_peaks, welch

from bayes_asv import __version__
from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording, accelerations, nominal_rate
from bayes_asv.domain.units import display_units, from_si
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.mode_shapes import Car, car_modes, places
from bayes_asv.models.textbook_cars import full_car, half_car4, quarter_cars, roll_car
from bayes_asv.reference.document import mode_document, nan_to_none
from bayes_asv.report.words import percent, plain

__all__ = [
    "CAR_MODES_SCHEMA",
    "TITLES",
    "car_modes_document",
    "car_modes_lines",
    "spectrum_document",
]

Document = dict[str, Any]

CAR_MODES_SCHEMA: Final = "bayes_asv/car_modes/1"

TITLES: Final[Mapping[str, str]] = {
    "quarter": "quarter car, two degrees of freedom",
    "half4": "half car with wheels, four degrees of freedom",
    "full7": "whole car, seven degrees of freedom",
    "roll": "roll car with wheels held still, three degrees of freedom",
}
_NEGLIGIBLE_SIZE: Final = 0.005


def car_modes_document(vehicle: Vehicle, which: str) -> Document:
    """Build the document of the modes of a nominal car.

    Parameters
    ----------
    vehicle : Vehicle
        As read.
    which : str
        A key of :data:`TITLES`.

    Raises
    ------
    InputError
        If the vehicle file lacks properties of this car.
    """
    make: Mapping[str, Callable[[Vehicle], Mapping[str, Car]]] = {
        "quarter": quarter_cars,
        "half4": lambda given: {"": half_car4(given)},
        "full7": lambda given: {"": full_car(given)},
        "roll": lambda given: {"": roll_car(given)},
    }
    cars = make[which](vehicle)
    damped: list[Document] = []
    undamped: list[Document] = []
    for part, car in cars.items():
        labels, _ = places(car)
        for mode, kind, share in car_modes(car):
            entry = {"corner": part or None, "kind": kind, "energy_share": share}
            damped.append({**entry, **mode_document(mode, labels)})
        undamped += [
            {"corner": part or None, "kind": kind, "natural_hz": mode.natural}
            for mode, kind, _ in car_modes(car, damped=False)
        ]
    document = nan_to_none(
        {
            "schema": CAR_MODES_SCHEMA,
            "verdict": "ok",
            "vehicle": vehicle.name,
            "car": which,
            "modes": damped,
            "undamped": undamped,
            "version": __version__,
        }
    )
    assert isinstance(document, dict)
    return document


def car_modes_lines(document: Document) -> list[str]:
    """Describe the document of ``bayes-asv modes --car`` on the terminal."""
    lines = [f"Modes of {plain(document['vehicle'])}, {TITLES[document['car']]}:"]
    corner = None
    for mode in document["modes"]:
        if mode["corner"] != corner:
            corner = mode["corner"]
            lines.append(f"  {corner} corner")
        kind = (
            f"damped {mode['damped_hz']:.3f} Hz, ratio {mode['ratio']:.3f}"
            if mode["oscillates"]
            else "does not oscillate"
        )
        lines.append(
            f"  {mode['natural_hz']:.3f} Hz, {kind}; mostly {mode['kind']} "
            f"({percent(mode['energy_share'])} of the energy)"
        )
        shape = ", ".join(
            f"{name} {part['size']:.2f}"
            + (f" at {round(part['phase_deg']):+d}°" if part["size"] > _NEGLIGIBLE_SIZE else "")
            for name, part in mode["shape"].items()
        )
        lines.append(f"      {shape}".replace("-", "−"))
    undamped = ", ".join(
        f"{mode['corner'] + ' ' if mode['corner'] else ''}{mode['kind']} {mode['natural_hz']:.3f}"
        for mode in document["undamped"]
    )
    lines.append(f"Without damping: {undamped} Hz")
    return lines


_MAX_FREQUENCY = 30.0  # Hz; peaks of the car are below
_PEAKS = 3
_MIN_READINGS = 32
_SEGMENT = 2.0  # s


def spectrum_document(recording: Recording, vehicle: Vehicle) -> dict[str, Any]:
    """Estimate the spectral density of each channel by Welch's method, segments up to two seconds.

    Parameters
    ----------
    recording, vehicle : Recording, Vehicle
        As read; missing readings are interpolated linearly.

    Returns
    -------
    dict
        Per channel: ``frequency_hz``, ``density`` in the vehicle's units, and ``peaks_hz``, the
        highest peaks below 30 Hz.

    Raises
    ------
    InputError
        If a channel has fewer than 32 readings, or than that in two seconds, or a gap longer than
        a segment.
    """
    rate = nominal_rate(recording)
    segment = int(_SEGMENT * rate)
    if segment < _MIN_READINGS:
        raise InputError(
            recording.source, f"has {rate:.4g} rows a second, too few for a spectrum",
            f"record at {_MIN_READINGS / _SEGMENT:g} Hz or more, or check the unit of the time",
        )  # fmt: skip
    unit = display_units(vehicle.units)["acceleration"]
    time, channels = recording.time, {}
    even = time[0] + np.arange(int((time[-1] - time[0]) * rate + 1e-6) + 1) / rate
    for name, values in zip(CHANNELS, accelerations(recording, vehicle), strict=True):
        valid = np.isfinite(values)
        if np.count_nonzero(valid) < _MIN_READINGS or len(even) < _MIN_READINGS:
            raise InputError(
                recording.source, f"{name} has fewer than {_MIN_READINGS} readings", "record longer"
            )
        if np.diff(time[valid]).max() > _SEGMENT:
            raise InputError(
                recording.source, f"{name} has a gap of {np.diff(time[valid]).max():.6g} s",
                "cut the recording there, or check its stamps",
            )  # fmt: skip
        signal = from_si(1.0, unit, "acceleration") * np.interp(even, time[valid], values[valid])
        frequency, density = welch(signal, rate, nperseg=min(len(even), segment))
        low = frequency <= _MAX_FREQUENCY
        index = find_peaks(density[low])[0]
        best = index[np.argsort(density[index])[::-1][:_PEAKS]]
        channels[name] = {
            "frequency_hz": frequency.tolist(),
            "density": density.tolist(),
            "peaks_hz": sorted(float(f) for f in frequency[best]),
        }
    return {
        "source": recording.source.replace("\\", "/").rpartition("/")[2],
        "unit": f"({unit})^2/Hz",
        "rate_hz": rate,
        "channels": channels,
    }
