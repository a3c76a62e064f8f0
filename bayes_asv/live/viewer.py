"""Messages for one viewer of a session: only what is new, and at the screen's resolution."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.quantities import NORMAL_975
from bayes_asv.live.downsampling import bucket_rows, downsample, points_per_bucket
from bayes_asv.live.histograms import RunningHistograms, bins
from bayes_asv.live.history import PARAMETER_POINTS, Snapshot
from bayes_asv.live.metadata import ViewMetadata
from bayes_asv.live.session import Playback, Session
from bayes_asv.live.text import consistency_text, parameter_card, travel_text

__all__ = ["POINTS", "WINDOWS", "Viewer", "metadata_message"]

Message = dict[str, Any]

POINTS: Final = 1200
"""Points of a trace on the screen, at most: more than a laptop's window has pixels."""

WINDOWS: Final = (1.0, 120.0)
"""Shortest and longest window, s."""

_MAX_GAP = 0.25  # s without a row; a longer time is drawn as a gap
_DIGITS = 5  # significant; a screen shows three or four
_TEXT_INTERVAL = 3  # frames during playback: texts eight times per second are fast enough to read


class Viewer:
    """Composes the messages for one viewer of a session.

    If it is asked seldom, because the connection is slow, the messages grow a little and the frames
    in between are never made; where more than the window is new, the window is sent anew.

    Parameters
    ----------
    session : Session
        Shared by all viewers.
    window : float
        Length of the viewer's traces, s.
    """

    def __init__(self, session: Session, window: float) -> None:
        self._session = session
        self._window = window
        self._size = 1
        self._bucket: int | None = None  # first bucket that was not full when it was sent
        self._point: int | None = None  # first point of the parameters that was not final
        self._stride = 0
        self._row = -1
        self._frames_since_text = _TEXT_INTERVAL
        self._last: tuple[Any, ...] = ()
        self._histograms = RunningHistograms(session.metadata)

    def message(self) -> Message | None:
        """Compose the next message.

        Returns
        -------
        dict or None
            None when nothing is new.
        """
        playback = self._session.playback()
        row = playback.snapshot.first + playback.rows
        key = (row, playback.state, playback.speed, playback.notes, round(playback.end, 1))
        if key == self._last:
            return None
        self._last = key
        message: Message = {
            "state": playback.state,
            "position": round(playback.position, 4),
            "end": round(playback.end, 4),
            "speed": playback.speed,
            "notes": list(playback.notes),
        }
        if playback.rows:
            if row < self._row:  # went back: the viewer's points after it are in the future
                self._bucket = self._point = None
            self._row = row
            message["time"] = round(float(playback.snapshot.time[playback.rows - 1]), 4)
            self._frames_since_text += 1
            if self._frames_since_text >= _TEXT_INTERVAL or playback.state != "playing":
                self._frames_since_text = 0
                message["now"] = _texts(playback, self._session.metadata)
                message["now"]["shares"] = self._shares(playback)
                message["now"]["events"] = [
                    [round(one.time, 4), one.words, one.place]
                    for one in playback.snapshot.events
                    if one.time <= message["time"]
                ]
            message["traces"] = self._traces(playback.snapshot, row)
            message["run"] = self._parameters(playback)
        return message

    def _shares(self, playback: Playback) -> list[Message]:
        """Shares of the time by travel and by speed, percent, one an element."""
        snapshot = playback.snapshot
        found = self._histograms.shares(
            snapshot.first, snapshot.time, snapshot.traces, snapshot.first + playback.rows
        )
        return [
            {"travel": _rounded(100.0 * travel, 2), "speed": _rounded(100.0 * speed, 2)}
            for travel, speed in found
        ]

    def _traces(self, snapshot: Snapshot, row: int) -> Message:
        """Points of the traces from the first bucket on that the viewer has not got in full."""
        length = self._session.metadata.duration
        window = min(self._window, length or self._window) * self._session.rate
        size = bucket_rows(window, POINTS)
        if size != self._size:  # the rate of a port is known with its first rows
            self._size, self._bucket = size, None
        oldest = max(snapshot.first, row - math.ceil(window * 1.1) - size)
        start = -(-oldest // size) if snapshot.first else oldest // size
        fresh = self._bucket is None or self._bucket < start
        bucket = start if fresh or self._bucket is None else self._bucket
        begin = bucket * size - snapshot.first
        time, points = downsample(
            snapshot.time[begin : row - snapshot.first],
            snapshot.traces[begin : row - snapshot.first],
            size,
            self._session.metadata.band_sides,
        )
        self._bucket = row // size
        before = snapshot.time[begin - 1 : begin] if begin else time[:1]
        gap = np.diff(time, prepend=before) > max(_MAX_GAP, 3.0 * size / self._session.rate)
        if gap.any():
            points = np.where(gap[:, None], np.nan, points)  # draw no line across a gap
        return {
            "fresh": fresh,
            "at": bucket * points_per_bucket(size),
            "time": _rounded(time, 6),
            "columns": [_numbers(column) for column in points.T],
        }

    def _parameters(self, playback: Playback) -> Message:
        """Points of the parameters from the first one on that is not final at the viewer."""
        snapshot = playback.snapshot
        history = snapshot.parameters
        now = snapshot.time[playback.rows - 1]
        count = int(np.searchsorted(history[:, 0], now, side="left"))
        fresh = self._point is None or snapshot.stride != self._stride
        begin = 0 if fresh or self._point is None else self._point
        self._point, self._stride = count, snapshot.stride
        estimates = snapshot.estimates[playback.rows - 1]
        na = len(self._session.metadata.parameters)
        newest = np.concatenate(((now,), estimates[: 2 * na]))[None]
        rows = np.concatenate((history[begin:count], newest))
        half = NORMAL_975 * rows[:, 1 + na :]
        medians = rows[:, 1 : 1 + na]
        columns = []
        for n in range(na):
            median, factor = medians[:, n], np.exp(half[:, n])
            columns += [_numbers(c) for c in (median, median / factor, median * factor)]
        return {"fresh": fresh, "at": begin, "time": _rounded(rows[:, 0], 6), "columns": columns}


def metadata_message(metadata: ViewMetadata) -> Message:
    """Compose the first message: names, units, nominal values, limits, and order of the columns.

    Parameters
    ----------
    metadata : ViewMetadata
        Of the session.
    """
    return {
        "vehicle": metadata.vehicle,
        "source": metadata.source,
        "live": metadata.live,
        "duration": metadata.duration,
        "outputs": [
            {"key": o.key, "label": o.label, "unit": o.unit, "sign": o.sign}
            for o in metadata.outputs
        ],
        "elements": list(metadata.elements),
        "deflection": metadata.deflection[0],
        "limits": {
            element: list(ends)
            for element, ends in zip(metadata.elements, metadata.limits, strict=True)
        },
        "bins": {
            element: {"travel": _rounded(own.travel, 6), "speed": _rounded(own.speed, 6)}
            for element, own in zip(metadata.elements, bins(metadata), strict=True)
        },
        "dampers": dict(zip(metadata.elements, metadata.dampers, strict=True)),
        "force": list(metadata.force),
        "traces": list(metadata.traces),
        "points": {"traces": POINTS, "run": 2 * PARAMETER_POINTS},
        "parameters": [
            {"name": p.name, "label": p.label, "unit": p.unit, "nominal": p.nominal}
            for p in metadata.parameters
        ],
    }


def _texts(playback: Playback, metadata: ViewMetadata) -> Message:
    """Texts at the playback position."""
    row, na = playback.rows - 1, len(metadata.parameters)
    estimates = [float(v) for v in playback.snapshot.estimates[row]]
    traces = dict(zip(metadata.traces, map(float, playback.snapshot.traces[row]), strict=True))
    consistency = consistency_text(
        traces["nis"], traces["nis low"], traces["nis high"], estimates[-2] > 0.5, estimates[-1]
    )
    return {
        "cards": [
            parameter_card(parameter, estimates[n], estimates[na + n])._asdict()
            for n, parameter in enumerate(metadata.parameters)
        ],
        "consistency": consistency._asdict(),
        "travel": travel_text(metadata, tuple(map(float, playback.snapshot.extremes[row]))),
    }


def _rounded(values: NDArray[np.floating], places: int) -> list[float]:
    rounded: list[float] = np.round(values, places).tolist()
    return rounded


def _numbers(values: NDArray[np.floating]) -> list[float | None]:
    """Numbers for JSON, with the digits that a screen shows; None for NaN."""
    return [float(f"{v:.{_DIGITS}g}") if math.isfinite(v) else None for v in values.tolist()]
