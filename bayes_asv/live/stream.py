"""What one viewer has to be told: only what is new, and no more than fits on a screen."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.live.bands import Z95
from bayes_asv.live.downsampling import bucket_rows, points_in, thinned
from bayes_asv.live.history import RUN_POINTS, SIDES, TRACES, Snapshot
from bayes_asv.live.metadata import AXLES, Scene
from bayes_asv.live.session import Moment, Show
from bayes_asv.live.words import card, consistency, travel

__all__ = ["POINTS", "WINDOWS", "Viewer", "scene_message"]

Message = dict[str, Any]

POINTS: Final = 1200
"""Points a trace has on the screen, at most: more than a laptop's window has pixels."""

WINDOWS: Final = (1.0, 120.0)
"""Shortest and longest window, s."""

_SILENCE = 0.25  # s without a row that are drawn as a hole
_DIGITS = 5  # significant; a screen shows three or four
_WORDS_EVERY = 3  # frames while it plays: eight times a second is as fast as one can read


class Viewer:
    """Tells one viewer of a show what is new since it was last asked.

    If it is asked seldom, because its line is slow, the messages grow a little and frames in
    between are never made; where more than the window is new, the window is sent afresh.

    Parameters
    ----------
    show : Show
        Shared by all viewers.
    window : float
        Seconds of traces that the viewer shows.
    """

    def __init__(self, show: Show, window: float) -> None:
        self._show = show
        self._window = window
        self._size = 1
        self._bucket: int | None = None  # the first one that was not full when it was sent
        self._run: int | None = None  # likewise of the thinned run
        self._stride = 0
        self._rows = -1
        self._silent = _WORDS_EVERY  # frames since there were words
        self._told: tuple[Any, ...] = ()

    def message(self) -> Message | None:
        """Say what is new.

        Returns
        -------
        dict or None
            None when nothing is.
        """
        moment = self._show.moment()
        row = moment.snapshot.first + moment.rows
        told = (row, moment.state, moment.speed, moment.notes, round(moment.end, 1))
        if told == self._told:
            return None
        self._told = told
        message: Message = {
            "state": moment.state,
            "position": round(moment.position, 4),
            "end": round(moment.end, 4),
            "speed": moment.speed,
            "notes": list(moment.notes),
        }
        if moment.rows:
            if row < self._rows:  # went back: whatever was sent is in the future now
                self._bucket = self._run = None
            self._rows = row
            message["time"] = round(float(moment.snapshot.time[moment.rows - 1]), 4)
            self._silent += 1
            if self._silent >= _WORDS_EVERY or moment.state != "playing":
                self._silent = 0
                message["now"] = _now(moment, self._show.scene)
            message["traces"] = self._traces(moment.snapshot, row)
            message["run"] = self._thinned_run(moment, moment.snapshot)
        return message

    def _traces(self, snapshot: Snapshot, row: int) -> Message:
        """Points of the traces from the first bucket on that is not yet full at the viewer."""
        length = self._show.scene.duration
        window = min(self._window, length or self._window) * self._show.rate
        size = bucket_rows(window, POINTS)
        if size != self._size:  # the rate of a port is known with its first rows
            self._size, self._bucket = size, None
        oldest = max(snapshot.first, row - math.ceil(window * 1.1) - size)
        start = -(-oldest // size) if snapshot.first else oldest // size
        fresh = self._bucket is None or self._bucket < start
        bucket = start if fresh or self._bucket is None else self._bucket
        begin = bucket * size - snapshot.first
        time, points = thinned(
            snapshot.time[begin : row - snapshot.first],
            snapshot.traces[begin : row - snapshot.first],
            size,
            SIDES,
        )
        self._bucket = row // size
        before = snapshot.time[begin - 1 : begin] if begin else time[:1]
        silent = np.diff(time, prepend=before) > max(_SILENCE, 3.0 * size / self._show.rate)
        if silent.any():
            points = np.where(silent[:, None], np.nan, points)  # no line across nothing
        return {
            "fresh": fresh,
            "at": bucket * points_in(size),
            "time": _rounded(time, 6),
            "columns": [_numbers(column) for column in points.T],
        }

    def _thinned_run(self, moment: Moment, snapshot: Snapshot) -> Message:
        """Points of the parameters from the first one on that the viewer has not got for good."""
        run = snapshot.run
        now = snapshot.time[moment.rows - 1]
        count = int(np.searchsorted(run[:, 0], now, side="left"))
        fresh = self._run is None or snapshot.stride != self._stride
        begin = 0 if fresh or self._run is None else self._run
        self._run, self._stride = count, snapshot.stride
        known = snapshot.known[moment.rows - 1]
        newest = np.concatenate(((now,), known[:6]))[None]
        rows = np.concatenate((run[begin:count], newest))
        half = Z95 * rows[:, 4:7]
        medians = rows[:, 1:4]
        columns = []
        for place in range(3):
            middle, spread = medians[:, place], np.exp(half[:, place])
            columns += [_numbers(c) for c in (middle, middle / spread, middle * spread)]
        return {"fresh": fresh, "at": begin, "time": _rounded(rows[:, 0], 6), "columns": columns}


def scene_message(scene: Scene) -> Message:
    """Say what stays.

    Parameters
    ----------
    scene : Scene
        Of the show.

    Returns
    -------
    dict
        Names, units, nominal values, limits, and the order of the columns.
    """
    return {
        "vehicle": scene.vehicle,
        "source": scene.source,
        "live": scene.live,
        "duration": scene.duration,
        "acceleration": scene.acceleration[0],
        "deflection": scene.deflection[0],
        "limits": {axle: list(ends) for axle, ends in zip(AXLES, scene.limits, strict=True)},
        "traces": list(TRACES),
        "points": {"traces": POINTS, "run": 2 * RUN_POINTS},
        "parameters": [
            {"name": p.name, "label": p.label, "unit": p.unit, "nominal": p.nominal}
            for p in scene.parameters
        ],
    }


def _now(moment: Moment, scene: Scene) -> Message:
    """Words for the moment."""
    place = moment.rows - 1
    known = [float(v) for v in moment.snapshot.known[place]]
    traces = dict(zip(TRACES, map(float, moment.snapshot.traces[place]), strict=True))
    said = consistency(
        traces["nis"], traces["nis low"], traces["nis high"], known[6] > 0.5, known[7]
    )
    return {
        "cards": [
            card(parameter, known[n], known[3 + n])._asdict()
            for n, parameter in enumerate(scene.parameters)
        ],
        "consistency": said._asdict(),
        "travel": travel(scene, tuple(map(float, moment.snapshot.reach[place]))),
    }


def _rounded(values: NDArray[np.floating], places: int) -> list[float]:
    rounded: list[float] = np.round(values, places).tolist()
    return rounded


def _numbers(values: NDArray[np.floating]) -> list[float | None]:
    """Numbers for JSON: as many digits as a screen shows, None for NaN."""
    return [float(f"{v:.{_DIGITS}g}") if math.isfinite(v) else None for v in values.tolist()]
