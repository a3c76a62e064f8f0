"""What the online filter knew after each row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

__all__ = ["PARAMETERS", "Frames", "joined", "nothing"]

Array = NDArray[np.float64]

PARAMETERS = ("c_f", "c_r", "i")


@dataclass(frozen=True)
class Frames:
    """What the filter knew after each of N rows; SI units.

    Parameters
    ----------
    time : (N,) array
        Stamp of each row, s.
    median : (N, 3) array
        Medians of c_f, c_r (N·s/m) and i (kg·m²).
    log_sd : (N, 3) array
        Deviation of the logarithm of each: the 95 % interval is median · exp(±1.96 log_sd).
    deflection, deflection_sd : (N, 2) arrays
        Front and rear suspension deflection, m, extension positive, and its deviation.
    measured : (N, 2) array
        Front and rear chassis acceleration as read, m/s²; NaN where it did not enter.
    predicted, predicted_sd : (N, 2) arrays
        What the filter expected of that reading one step before, m/s², and its deviation.
    nis : (N,) array
        Normalised innovation squared, summed over the row's readings.
    readings : (N,) array
        How many readings it stands on: 0, 1 or 2.
    nis_mean, nis_low, nis_high : (N,) arrays
        Mean of the NIS a reading over a window that slides along, and where it lies 95 % of
        the time if the filter's noise is right.
    consistent : (N,) bool array
        Whether the mean is inside that band, or was until recently.
    inflation : (N,) array
        Factor by which the noise's deviations were widened; one while all is well.
    """

    time: Array
    median: Array
    log_sd: Array
    deflection: Array
    deflection_sd: Array
    measured: Array
    predicted: Array
    predicted_sd: Array
    nis: Array
    readings: Array
    nis_mean: Array
    nis_low: Array
    nis_high: Array
    consistent: NDArray[np.bool_]
    inflation: Array

    def __len__(self) -> int:
        return len(self.time)


_WIDTH = {
    "median": 3, "log_sd": 3, "deflection": 2, "deflection_sd": 2,
    "measured": 2, "predicted": 2, "predicted_sd": 2,
}  # fmt: skip


def nothing() -> Frames:
    """Frames of no row at all."""
    columns = {
        f.name: np.empty((0, _WIDTH[f.name]) if f.name in _WIDTH else 0) for f in fields(Frames)
    }
    return Frames(**{**columns, "consistent": np.empty(0, bool)})


def joined(parts: Sequence[Frames]) -> Frames:
    """Chunks one after the other, as one."""
    if not parts:
        return nothing()
    return Frames(
        **{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Frames)}
    )
