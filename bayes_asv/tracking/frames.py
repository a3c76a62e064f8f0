"""Results of the online filter row by row, whole or decimated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["MAX_ROWS", "DecimatedFrames", "Frames", "concatenate", "empty_frames"]

Array = NDArray[np.float64]

MAX_ROWS: Final = 8192
"""Largest number of rows that :class:`DecimatedFrames` keeps; a figure shows 1500 of them."""


@dataclass(frozen=True)
class Frames:
    """State of the filter after each of N rows; SI units.

    The car has na parameters of interest, ne suspension elements and ny measured outputs.

    Parameters
    ----------
    time : (N,) array
        Stamp of each row, s.
    median : (N, na) array
        Medians of the parameters of interest, such as c_f, c_r (N·s/m) and i (kg·m²).
    log_sd : (N, na) array
        Standard deviation of the logarithm of each; the 95 % interval is
        median · exp(±1.96 log_sd).
    effect, effect_sd : (N, nq) arrays
        Means and standard deviations of the coordinates of force laws
        (``Coordinates.law_effects``).
    deflection, deflection_sd : (N, ne) arrays
        Suspension deflections, m, extension positive, and their standard deviations.
    measured : (N, ny) array
        Outputs as read; NaN where the filter did not use any.
    predicted, predicted_sd : (N, ny) arrays
        One-step predictions of those readings, and their standard deviations.
    nis : (N,) array
        Normalised innovation squared, summed over the row's readings.
    readings : (N,) array
        Number of readings in that sum.
    nis_mean, nis_low, nis_high : (N,) arrays
        Mean NIS per reading over a sliding window, and its 95 % band for a correct filter.
    consistent : (N,) bool array
        Whether the filter is consistent (:mod:`bayes_asv.tracking.consistency`).
    inflation : (N,) array
        Factor on the noise's standard deviation; one for a consistent filter.
    """

    time: Array
    median: Array
    log_sd: Array
    effect: Array
    effect_sd: Array
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


def empty_frames(answers: int = 3, elements: int = 2, outputs: int = 2, effects: int = 0) -> Frames:
    """Frames without a row; by default of the half car with its four accelerometers."""
    columns = {
        "median": answers, "log_sd": answers, "deflection": elements, "deflection_sd": elements,
        "effect": effects, "effect_sd": effects, "measured": outputs, "predicted": outputs,
        "predicted_sd": outputs,
    }  # fmt: skip
    empty = {
        f.name: np.empty((0, columns[f.name]) if f.name in columns else 0) for f in fields(Frames)
    }
    return Frames(**{**empty, "consistent": np.empty(0, bool)})


def concatenate(parts: Sequence[Frames]) -> Frames:
    """Concatenate frames in order."""
    if not parts:
        return empty_frames()
    return Frames(
        **{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Frames)}
    )


class DecimatedFrames:
    """Collects frames of a drive of any length in bounded memory: the last row of every stride.

    A kept row is consistent only if every row of its stride was, and has the largest inflation of
    its stride; all other values are those at the row.  The stride doubles whenever more than
    ``max_rows`` rows would be kept.  The size of chunks has no effect.

    Parameters
    ----------
    max_rows : int
        Rows to keep, at least two.
    """

    def __init__(self, max_rows: int = MAX_ROWS) -> None:
        self._max_rows = max_rows
        self._stride = 1
        self._received = 0
        self._kept = 0
        self._parts: list[Frames] = []
        self._indices: list[NDArray[np.int64]] = []  # of the kept rows among those received

    def append(self, frames: Frames) -> None:
        """Add the frames that follow."""
        if not len(frames):
            return
        indices = np.arange(self._received, self._received + len(frames))
        self._received += len(frames)
        if self._parts:  # the last stride may not be full
            last = self._parts.pop()
            index = self._indices.pop()
            self._kept -= len(last)
            frames, indices = concatenate([last, frames]), np.concatenate([index, indices])
        self._add(frames, indices)
        while self._kept > self._max_rows:
            self._stride *= 2
            frames, indices = concatenate(self._parts), np.concatenate(self._indices)
            self._parts, self._indices, self._kept = [], [], 0
            self._add(frames, indices)

    def frames(self) -> Frames:
        """Return the kept rows."""
        return concatenate(self._parts)

    def _add(self, frames: Frames, indices: NDArray[np.int64]) -> None:
        """Keep one row per stride; the last row, whose stride may grow, as a part of its own."""
        frames, indices = _decimate(frames, indices, self._stride)
        for part in (slice(0, -1), slice(-1, None)):
            if len(indices[part]):
                self._parts.append(_select(frames, part))
                self._indices.append(indices[part])
        self._kept += len(indices)


def _select(frames: Frames, rows: slice | NDArray[np.int64]) -> Frames:
    return Frames(**{f.name: getattr(frames, f.name)[rows] for f in fields(Frames)})


def _decimate(
    frames: Frames, indices: NDArray[np.int64], stride: int
) -> tuple[Frames, NDArray[np.int64]]:
    """Take the last row of every stride, with the verdict and the inflation of all its rows."""
    if stride == 1:
        return frames, indices
    first = np.flatnonzero(np.diff(indices // stride, prepend=-1))
    last = np.append(first[1:], len(indices)) - 1
    columns = {f.name: getattr(frames, f.name)[last] for f in fields(Frames)}
    columns["consistent"] = np.logical_and.reduceat(frames.consistent, first)
    columns["inflation"] = np.maximum.reduceat(frames.inflation, first)
    return Frames(**columns), indices[last]
