"""What the filter said so far, in display units, for readers of other threads."""

from __future__ import annotations

import threading
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.live.bands import Z95
from bayes_asv.live.metadata import Scene
from bayes_asv.live.table import Table
from bayes_asv.tracking.frames import Frames

__all__ = ["RUN_POINTS", "SIDES", "TRACES", "History", "Snapshot"]

Array = NDArray[np.float64]

TRACES: Final = (
    "front measured", "front predicted", "front predicted low", "front predicted high",
    "front deflection", "front deflection low", "front deflection high",
    "rear measured", "rear predicted", "rear predicted low", "rear predicted high",
    "rear deflection", "rear deflection low", "rear deflection high",
    "nis", "nis low", "nis high",
)  # fmt: skip
"""Columns of `Snapshot.traces`."""

SIDES: Final = tuple(
    -1 if name.endswith(" low") else 1 if name.endswith(" high") else 0 for name in TRACES
)
"""For each of `TRACES`: the lower (-1) or upper (1) edge of a band, or a curve (0)."""

RUN_POINTS: Final = 1000
"""The run of the parameters is thinned to at most twice as many points."""


class Snapshot(NamedTuple):
    """The history as it was at one moment; arrays are not to be written to.

    Attributes
    ----------
    first : int
        How many rows came before those that are still here.
    time : (n,) array
        Stamps, s.
    traces : (n, 17) array of float32
        Columns `TRACES`, display units; bands hold 95 %.
    known : (n, 8) array of float32
        Medians of c_f, c_r, i in display units, deviations of their logarithms, whether
        consistent (1 or 0), and the inflation of the noise.
    reach : (n, 4) array of float32
        Least and largest deflection up to then, front and rear, display units.
    run : (m, 7) array
        Stamp, medians and deviations of the logarithms of every `stride`-th row.
    stride : int
        A power of two.
    """

    first: int
    time: Array
    traces: NDArray[np.float32]
    known: NDArray[np.float32]
    reach: NDArray[np.float32]
    run: Array
    stride: int


class History:
    """Frames in display units.  One thread appends, any may take a snapshot.

    Parameters
    ----------
    scene : Scene
        Has the units.
    keep : int or None
        Rows to remember at least; twice as many at most.  None forgets nothing.
    """

    def __init__(self, scene: Scene, keep: int | None = None) -> None:
        self._scene = scene
        self._keep = keep
        self._lock = threading.Lock()
        self._first = 0
        self._stride = 1
        self._time = Table(1)
        self._traces = Table(len(TRACES), np.float32)
        self._known = Table(8, np.float32)
        self._reach = Table(4, np.float32)
        self._run = Table(7)

    def append(self, frames: Frames) -> None:
        """Take what the filter said of the next rows."""
        if not len(frames):
            return
        medians = frames.median / np.array([p.factor for p in self._scene.parameters])
        known = np.column_stack((medians, frames.log_sd, frames.consistent, frames.inflation))
        reach = self._reached(frames.deflection / self._scene.deflection[1])
        run = np.column_stack((frames.time, medians, frames.log_sd))
        with self._lock:
            row = self._first + len(self._time)
            self._time.append(frames.time[:, None])
            self._traces.append(self._curves(frames))
            self._known.append(known)
            self._reach.append(reach)
            self._run.append(run[-row % self._stride :: self._stride])
            while len(self._run) > 2 * RUN_POINTS:
                self._stride *= 2
                self._run.keep(self._run.rows()[::2])
            if self._keep is not None and len(self._time) > 2 * self._keep:
                for table in (self._time, self._traces, self._known, self._reach):
                    surplus = len(table) - self._keep
                    table.keep(table.rows()[surplus:])
                self._first += surplus

    def snapshot(self) -> Snapshot:
        """Everything up to now; nothing is copied."""
        with self._lock:
            return Snapshot(
                self._first,
                self._time.rows()[:, 0],
                self._traces.rows(),
                self._known.rows(),
                self._reach.rows(),
                self._run.rows(),
                self._stride,
            )

    def _curves(self, frames: Frames) -> Array:
        """Columns `TRACES` of the frames."""
        columns = []
        gravity, length = self._scene.acceleration[1], self._scene.deflection[1]
        for axle in range(2):
            columns += [
                frames.measured[:, axle] / gravity,
                *_band(frames.predicted[:, axle], frames.predicted_sd[:, axle], gravity),
                *_band(frames.deflection[:, axle], frames.deflection_sd[:, axle], length),
            ]
        # A mean that has no band yet is a mean of nothing.
        judged = np.isfinite(frames.nis_low) & np.isfinite(frames.nis_high)
        for errors in (frames.nis_mean, frames.nis_low, frames.nis_high):
            columns.append(np.where(judged, errors, np.nan))
        return np.column_stack(columns)

    def _reached(self, deflection: Array) -> Array:
        """Least and largest deflection up to each row, (n, 4)."""
        before = self._reach.rows()[-1:] if len(self._reach) else np.full((1, 4), np.nan)
        out = np.empty((len(deflection), 4))
        for axle in range(2):
            for place, gather in ((2 * axle, np.fmin), (2 * axle + 1, np.fmax)):
                along = np.concatenate((before[:, place], deflection[:, axle]))
                out[:, place] = gather.accumulate(along)[1:]
        return out


def _band(middle: Array, sd: Array, unit: float) -> tuple[Array, Array, Array]:
    """Return the curve and the edges of its 95 % band, in `unit`."""
    half = Z95 * sd
    return middle / unit, (middle - half) / unit, (middle + half) / unit
