"""Shares of the time that a suspension spends at each deflection and each speed, so far."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.live.metadata import ViewMetadata

__all__ = ["Bins", "RunningHistograms", "bins"]

Array = NDArray[np.float64]

_COUNT: Final = 40  # of bins
_TRAVEL: Final = 0.1  # m either way where the vehicle file gives no stop
_BEYOND: Final = 0.1  # of the travel, shown beyond either stop
_SPEED: Final = 1.0  # m/s either way; what is faster is in the last bin
_LONGEST_STEP: Final = 0.25  # s: across a longer gap there is no speed


class Bins(NamedTuple):
    """Bins of equal width of one element, display units; the last ones have what lies beyond.

    Attributes
    ----------
    travel, speed : (n + 1,) arrays
        Edges of deflections, and of their rates in deflections a second.
    """

    travel: Array
    speed: Array


def bins(metadata: ViewMetadata) -> tuple[Bins, ...]:
    """Return the bins of each suspension element.

    Parameters
    ----------
    metadata : ViewMetadata
        Gives the stops and the unit of deflections.
    """
    length = metadata.deflection[1]
    found = []
    for bump, droop in metadata.limits:
        low = -_TRAVEL / length if bump is None else bump
        high = _TRAVEL / length if droop is None else droop
        margin = _BEYOND * (high - low)
        fastest = _SPEED / length
        found.append(
            Bins(
                np.linspace(low - margin, high + margin, _COUNT + 1),
                np.linspace(-fastest, fastest, _COUNT + 1),
            )
        )
    return tuple(found)


class RunningHistograms:
    """Counts that follow the position of a playback.

    Parameters
    ----------
    metadata : ViewMetadata
        Of the session.
    """

    def __init__(self, metadata: ViewMetadata) -> None:
        self._bins = bins(metadata)
        names = list(metadata.traces)
        self._columns = [names.index(f"{element} deflection") for element in metadata.elements]
        self._counts = np.zeros((len(self._bins), 2, _COUNT))
        self._row = 0  # first one that is not counted

    def shares(self, first: int, time: Array, traces: NDArray[np.float32], row: int) -> Array:
        """Count the rows up to a position.

        Parameters
        ----------
        first : int
            Number of rows that were dropped before those in ``time``.
        time, traces : (n,) and (n, nt) arrays
            Stamps, s, and curves of :class:`.history.Snapshot`.
        row : int
            Number of all rows up to the position, those that were dropped included.

        Returns
        -------
        (ne, 2, n) array
            Share of the time of each element in each bin of travel and of speed; zero without any.
            After going back it is that of the rows that are left.
        """
        if row < self._row or first > self._row:
            self._counts[:] = 0.0
            self._row = first
        begin, end = self._row - first, row - first
        before = max(begin - 1, 0)  # for the speed of the first new row
        step = np.diff(time[before:end])
        for e, (column, edges) in enumerate(zip(self._columns, self._bins, strict=True)):
            deflection = traces[before:end, column].astype(float)
            self._add(e, 0, deflection[begin - before :], edges.travel)
            with np.errstate(divide="ignore", invalid="ignore"):
                speed = np.diff(deflection) / step
            self._add(e, 1, speed[step <= _LONGEST_STEP], edges.speed)
        self._row = max(row, self._row)
        total = self._counts.sum(axis=2, keepdims=True)
        return np.asarray(self._counts / np.maximum(total, 1.0))

    def _add(self, element: int, which: int, values: Array, edges: Array) -> None:
        inside = np.clip(values[np.isfinite(values)], edges[0], edges[-1])
        self._counts[element, which] += np.histogram(inside, edges)[0]
