"""What a track knew after each row, as CSV in the vehicle's units."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.units import display_units, from_si
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.tracking.frames import PARAMETERS, Frames

__all__ = ["Trace", "moments", "shown"]

Array = NDArray[np.float64]

_PIECE = 1 << 20  # bytes


class Trace:
    """Rows of CSV as they come; they wait in a file without a name, not in memory.

    Columns are ``time [s]``, ``c_f mean``, ``c_f sd``, … of c_f, c_r and i, then ``nis mean``
    (one before the first reading that counts), ``inflation`` and ``consistent`` (1 or 0).

    Parameters
    ----------
    vehicle : Vehicle
        Gives the units.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._file = tempfile.TemporaryFile()  # noqa: SIM115 # lives as long as the trace
        names = [f"{name} {what}" for name in PARAMETERS for what in ("mean", "sd")]
        columns = ["time [s]", *names, "nis mean", "inflation", "consistent"]
        self._file.write((",".join(columns) + "\n").encode())

    def append(self, frames: Frames) -> None:
        """Take the frames that follow."""
        values = [frames.time]
        for k, name in enumerate(PARAMETERS):
            for value in moments(np.log(frames.median[:, k]), frames.log_sd[:, k]):
                values.append(shown(value, name, self._vehicle))
        values += [frames.nis_mean, frames.inflation, frames.consistent.astype(float)]
        rows = np.column_stack(values).tolist()
        self._file.writelines((",".join(map(_number, row)) + "\n").encode() for row in rows)

    def close(self) -> None:
        """Give the file back; may be called twice."""
        self._file.close()

    def pieces(self) -> Iterator[bytes]:
        """Yield all of it, from the header on."""
        self._file.seek(0)
        while piece := self._file.read(_PIECE):
            yield piece


def _number(value: float) -> str:
    return f"{value:.9g}"


def moments(log_mean: Any, log_sd: Any) -> tuple[Any, Any]:
    """Mean and deviation of a log-normal."""
    mean = np.exp(log_mean + 0.5 * log_sd**2)
    return mean, mean * np.sqrt(np.expm1(log_sd**2))


def shown(value: Array, name: str, vehicle: Vehicle, units: str | None = None) -> Array:
    """Values of a quantity in the units that the vehicle wants, or in others."""
    dimension = QUANTITIES[name][0]
    return value * from_si(1.0, display_units(units or vehicle.units)[dimension], dimension)
