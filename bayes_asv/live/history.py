"""Results of the filter so far, in display units, shared between threads."""

from __future__ import annotations

import threading
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from bayes_asv.domain.quantities import NORMAL_975
from bayes_asv.live.metadata import ViewMetadata
from bayes_asv.tracking.frames import Frames

__all__ = ["PARAMETER_POINTS", "Event", "History", "Snapshot"]

Array = NDArray[np.float64]

PARAMETER_POINTS: Final = 1000
"""The parameters are decimated to at most twice as many points."""

_INITIAL_ROWS: Final = 1024  # of a table
_EVENTS: Final = 200  # that are kept
_APART: Final = 0.5  # s: a stop that is reached again within this time is one event


class Event(NamedTuple):
    """Something that happened during the drive.

    Attributes
    ----------
    time : float
        Stamp, s.
    words : str
        What it was.
    place : str
        Suspension element, or ``nis`` for the filter.
    """

    time: float
    words: str
    place: str


class Snapshot(NamedTuple):
    """The history at one moment; its arrays must not be written to.

    Attributes
    ----------
    first : int
        Number of rows that were dropped before those that are left.
    time : (n,) array
        Stamps, s.
    traces : (n, nt) array of float32
        Columns ``ViewMetadata.traces``, display units; bands are 95 % bands.
    estimates : (n, 2 na + 2) array of float32
        Medians of the parameters in display units, standard deviations of their logarithms,
        whether the filter is consistent (1 or 0), and the inflation of the noise.
    extremes : (n, 2 ne) array of float32
        Smallest and largest deflection so far of each element, display units.
    parameters : (m, 1 + 2 na) array
        Stamp, medians and standard deviations of the logarithms of every `stride`-th row since
        the start.
    stride : int
        A power of two.
    events : tuple of Event
        In order of time.
    """

    first: int
    time: Array
    traces: NDArray[np.float32]
    estimates: NDArray[np.float32]
    extremes: NDArray[np.float32]
    parameters: Array
    stride: int
    events: tuple[Event, ...]


class History:
    """Frames in display units.  One thread appends, any thread may take a snapshot.

    Parameters
    ----------
    metadata : ViewMetadata
        Gives the units.
    keep : int or None
        Rows to keep at least; twice as many at most.  None keeps all.
    """

    def __init__(self, metadata: ViewMetadata, keep: int | None = None) -> None:
        self._metadata = metadata
        self._keep = keep
        self._lock = threading.Lock()
        self._first = 0
        self._stride = 1
        self._time = _Table(1)
        na, ne = len(metadata.parameters), len(metadata.elements)
        self._traces = _Table(len(metadata.traces), np.float32)
        self._estimates = _Table(2 * na + 2, np.float32)
        self._extremes = _Table(2 * ne, np.float32)
        self._parameters = _Table(1 + 2 * na)
        self._last_nis = np.full((3, 1), np.nan)
        self._events: list[Event] = []
        self._ended: dict[str, float] = {}  # when a stop was last reached
        self._consistent = True

    def append(self, frames: Frames) -> None:
        """Add the frames of the next rows."""
        if not len(frames):
            return
        medians = frames.median / np.array([p.factor for p in self._metadata.parameters])
        estimates = np.column_stack((medians, frames.log_sd, frames.consistent, frames.inflation))
        extremes = self._running_extremes(frames.deflection / self._metadata.deflection[1])
        parameters = np.column_stack((frames.time, medians, frames.log_sd))
        events = self._new_events(frames)
        with self._lock:
            row = self._first + len(self._time)
            self._time.append(frames.time[:, None])
            self._traces.append(self._trace_columns(frames))
            self._estimates.append(estimates)
            self._extremes.append(extremes)
            self._events = [*self._events, *events][-_EVENTS:]
            self._parameters.append(parameters[-row % self._stride :: self._stride])
            while len(self._parameters) > 2 * PARAMETER_POINTS:
                self._stride *= 2
                self._parameters.replace(self._parameters.rows()[::2])
            if self._keep is not None and len(self._time) > 2 * self._keep:
                for table in (self._time, self._traces, self._estimates, self._extremes):
                    surplus = len(table) - self._keep
                    table.replace(table.rows()[surplus:])
                self._first += surplus

    def snapshot(self) -> Snapshot:
        """Everything so far, without copying."""
        with self._lock:
            return Snapshot(
                self._first,
                self._time.rows()[:, 0],
                self._traces.rows(),
                self._estimates.rows(),
                self._extremes.rows(),
                self._parameters.rows(),
                self._stride,
                tuple(self._events),
            )

    def _trace_columns(self, frames: Frames) -> Array:
        """Columns ``ViewMetadata.traces`` of the frames."""
        curves: dict[str, Array] = {}
        metadata, edges = self._metadata, ("", " low", " high")
        for y, output in enumerate(metadata.outputs):
            curves[f"{output.key} measured"] = frames.measured[:, y] / output.factor
            band = _band(frames.predicted[:, y], frames.predicted_sd[:, y], output.factor)
            curves |= dict(zip((f"{output.key} predicted{x}" for x in edges), band, strict=True))
        for e, element in enumerate(metadata.elements):
            length = metadata.deflection[1]
            band = _band(frames.deflection[:, e], frames.deflection_sd[:, e], length)
            curves |= dict(zip((f"{element} deflection{x}" for x in edges), band, strict=True))
        # A mean without a finite band is a mean of no readings, as of a car that stands still: the
        # last one holds.
        valid = np.isfinite(frames.nis_low) & np.isfinite(frames.nis_high)
        nis = np.stack([frames.nis_mean, frames.nis_low, frames.nis_high])
        latest = np.maximum.accumulate(np.where(valid, np.arange(len(valid)), -1))
        nis = np.where(latest >= 0, nis[:, latest], self._last_nis)
        self._last_nis = nis[:, -1:].copy()
        curves |= {f"nis{edge}": values for edge, values in zip(edges, nis, strict=True)}
        return np.column_stack([curves[name] for name in metadata.traces])

    def _new_events(self, frames: Frames) -> list[Event]:
        """Return stops that were reached, and changes of the filter's consistency.

        They do not depend on how the rows are divided.
        """
        found: list[Event] = []
        deflection = frames.deflection / self._metadata.deflection[1]
        for e, element in enumerate(self._metadata.elements):
            bump, droop = self._metadata.limits[e]
            for name, hit in (
                ("bump", None if bump is None else deflection[:, e] <= bump),
                ("droop", None if droop is None else deflection[:, e] >= droop),
            ):
                words = f"{name} limit"
                for stamp in () if hit is None else frames.time[hit].tolist():
                    if stamp - self._ended.get(f"{element} {name}", -np.inf) > _APART:
                        found.append(Event(stamp, words, element))
                    self._ended[f"{element} {name}"] = stamp
        before = np.concatenate(([self._consistent], frames.consistent[:-1]))
        for k in np.flatnonzero(before != frames.consistent):
            good = bool(frames.consistent[k])
            words = "errors as expected" if good else "errors not as expected"
            found.append(Event(float(frames.time[k]), words, "nis"))
        self._consistent = bool(frames.consistent[-1])
        return sorted(found)

    def _running_extremes(self, deflection: Array) -> Array:
        """Smallest and largest deflection up to each row, (n, 2 ne)."""
        ne = deflection.shape[1]
        last = self._extremes.rows()[-1:]
        before = last if len(last) else np.full((1, 2 * ne), np.nan)
        out = np.empty((len(deflection), 2 * ne))
        for e in range(ne):
            for column, extreme in ((2 * e, np.fmin), (2 * e + 1, np.fmax)):
                values = np.concatenate((before[:, column], deflection[:, e]))
                out[:, column] = extreme.accumulate(values)[1:]
        return out


def _band(mean: Array, sd: Array, unit: float) -> tuple[Array, Array, Array]:
    """Return a curve and the edges of its 95 % band, in `unit`."""
    half = NORMAL_975 * sd
    return mean / unit, (mean - half) / unit, (mean + half) / unit


class _Table:
    """Growing array of rows that are appended at the end and may be dropped at the front.

    What `rows` returned never changes afterwards: a row is written once, and the rows move to a new
    array when they need room.  `rows` and the methods that change the table must not run at the
    same time; reading what `rows` returned is safe at any time.

    Parameters
    ----------
    columns : int
        Length of a row.
    dtype : data type
        Of every number.
    """

    def __init__(self, columns: int, dtype: DTypeLike = np.float64) -> None:
        self._data: NDArray[Any] = np.empty((_INITIAL_ROWS, columns), dtype)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def append(self, block: NDArray[Any]) -> None:
        """Add the rows of `block`, shape (n, columns)."""
        needed = self._count + len(block)
        if needed > len(self._data):
            self._reallocate(self.rows(), 2 * needed)
        self._data[self._count : needed] = block
        self._count = needed

    def rows(self) -> NDArray[Any]:
        """All rows, shape (n, columns); must not be written to."""
        return self._data[: self._count]

    def replace(self, rows: NDArray[Any]) -> None:
        """Keep `rows`, a part of its own, and drop the others."""
        self._reallocate(rows, max(2 * len(rows), _INITIAL_ROWS))

    def _reallocate(self, rows: NDArray[Any], capacity: int) -> None:
        data = np.empty((capacity, self._data.shape[1]), self._data.dtype)
        data[: len(rows)] = rows
        self._data, self._count = data, len(rows)
