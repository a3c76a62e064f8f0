"""Sources of rows: a recording, or a port from which they arrive at this moment."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Iterator
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.recording import Recording, accelerations, nominal_rate
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.live.port import PortReader
from bayes_asv.live.text_stream import RowBlock, TextStreamReader

__all__ = ["PortSource", "RecordingSource", "Rows", "Source", "StreamInfo"]

Array = NDArray[np.float64]

_CHUNK: Final = 0.25  # s of a recording


class StreamInfo(NamedTuple):
    """What a filter needs to know before the first row.

    Attributes
    ----------
    rate : float
        Rows per second, Hz.
    start : Recording
        The recording, or its first rows where more will come; it has units and metadata.
    """

    rate: float
    start: Recording


class Rows(NamedTuple):
    """Rows in SI units.

    Attributes
    ----------
    time : (n,) array
        Stamps, s.
    acceleration : (n, C) array
        m/s² in the order of the channels; NaN where missing.
    """

    time: Array
    acceleration: Array


class Source(Protocol):
    """Interface of a source of rows."""

    def begin(self, stop: threading.Event) -> StreamInfo | None:
        """Wait until the stream is known; None if it was stopped before."""

    def rows(self, stop: threading.Event) -> Iterator[Rows]:
        """Yield rows until there are no more or it is stopped."""

    def notes(self) -> tuple[str, ...]:
        """Return notes about the rows so far, for the user."""

    def close(self) -> None:
        """Release all resources."""


class RecordingSource:
    """Yields a recording as fast as the rows are taken.

    Parameters
    ----------
    recording : Recording
        In any units.
    vehicle : Vehicle
        For channels in counts.

    Raises
    ------
    InputError
        If a channel is in counts and the vehicle lacks its zero or scale.
    """

    def __init__(self, recording: Recording, vehicle: Vehicle) -> None:
        self._recording = recording
        self._acceleration = accelerations(recording, vehicle).T

    @property
    def duration(self) -> float:
        """Time from the first stamp to the last, s."""
        return float(self._recording.time[-1] - self._recording.time[0])

    def begin(self, stop: threading.Event) -> StreamInfo | None:
        """Return the recording at once."""
        return StreamInfo(nominal_rate(self._recording), self._recording)

    def rows(self, stop: threading.Event) -> Iterator[Rows]:
        """Yield a quarter of a second at a time."""
        time = self._recording.time
        size = max(1, round(_CHUNK * nominal_rate(self._recording)))
        for start in range(0, len(time), size):
            if stop.is_set():
                return
            part = slice(start, start + size)
            yield Rows(time[part], self._acceleration[part])

    def notes(self) -> tuple[str, ...]:
        """Return the reader's warnings."""
        return self._recording.warnings

    def close(self) -> None:
        """Do nothing: there are no resources."""


class PortSource:
    """Yields the rows that arrive at a serial port.

    Parameters
    ----------
    port : PortReader
        Open; `close` stops it.
    name : str
        For messages.
    vehicle : Vehicle
        For channels in counts.
    rate : float or None
        Rows per second, Hz, for streams without stamps.
    """

    def __init__(
        self, port: PortReader, name: str, vehicle: Vehicle, rate: float | None = None
    ) -> None:
        self._port = port
        self._name = name
        self._vehicle = vehicle
        self._reader = TextStreamReader(name, rate)
        self._chunks = port.chunks()
        self._pending: list[RowBlock] = []

    def begin(self, stop: threading.Event) -> StreamInfo | None:
        """Wait for the first rows.

        Raises
        ------
        InputError
            If the stream cannot be a recording, or the vehicle lacks a zero or a scale.
        """
        while not stop.is_set():
            chunk = next(self._chunks, None)
            if chunk is None:
                return None
            self._read(chunk)
            start = self._pending_recording()
            if start is not None and self._reader.rate is not None:
                return StreamInfo(self._reader.rate, start)
        return None

    def rows(self, stop: threading.Event) -> Iterator[Rows]:
        """Yield rows as they arrive."""
        for chunk in itertools.chain((b"",), self._chunks):
            if stop.is_set():
                return
            self._read(chunk)
            recording, self._pending = self._pending_recording(1), []
            if recording is not None:  # its first row is padding
                acceleration = accelerations(recording, self._vehicle)
                yield Rows(recording.time[1:], acceleration[:, 1:].T)

    def notes(self) -> tuple[str, ...]:
        """State what was lost, and where the bytes are saved."""
        notes = [f"Every byte is saved in {self._port.file.name}."]
        if not self._port.connected:
            notes.insert(0, f"{self._name} is disconnected; it is reopened as soon as it is back.")
        elif self._port.losses:
            notes.append(f"{self._name} was disconnected {_times(self._port.losses)}.")
        if self._reader.unreadable:
            lines = self._reader.unreadable
            notes.append(f"{lines} {'line was' if lines == 1 else 'lines were'} not readable.")
        if self._reader.restarts:
            notes.append(f"The stamps started again {_times(self._reader.restarts)}.")
        return tuple(notes)

    def close(self) -> None:
        """Stop the reader thread; all bytes received are in the file."""
        self._port.stop()

    def _read(self, data: bytes) -> None:
        """Convert bytes to pending rows."""
        block = self._reader.feed(data)
        if len(block.time):
            self._pending.append(block)

    def _pending_recording(self, padding: int = 0) -> Recording | None:
        """Make a recording of the pending rows after `padding` empty ones; at least two in all."""
        units = self._reader.units
        time = np.concatenate([np.empty(0), *(block.time for block in self._pending)])
        if units is None or not len(time) or len(time) + padding < 2:
            return None
        values = np.concatenate([block.values for block in self._pending], axis=1)
        time = np.concatenate((time[0] - np.arange(padding, 0.0, -1.0), time))
        values = np.concatenate((np.full((len(values), padding), np.nan), values), axis=1)
        return Recording(time, values, units, self._reader.metadata, self._name)


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")
