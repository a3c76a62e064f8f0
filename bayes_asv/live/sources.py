"""Where rows come from: a recording, or a port on which they come in while one looks."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Iterator
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.recording import Recording, accelerations, nominal_rate
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.live.lines import LineReader, Piece
from bayes_asv.live.port import PortReader

__all__ = ["About", "PortSource", "RecordingSource", "Rows", "Source"]

Array = NDArray[np.float64]

_CHUNK: Final = 0.25  # s of a recording that are handed over at once


class About(NamedTuple):
    """What a filter has to know before the first row.

    Attributes
    ----------
    rate : float
        Rows a second, Hz.
    start : Recording
        The recording, or its first rows where more are to come: with units and metadata.
    """

    rate: float
    start: Recording


class Rows(NamedTuple):
    """Rows in SI units.

    Attributes
    ----------
    time : (n,) array
        Stamps, s.
    acceleration : (n, 4) array
        m/s² in the order of the channels; NaN where missing.
    """

    time: Array
    acceleration: Array


class Source(Protocol):
    """Something that gives rows."""

    def begin(self, stop: threading.Event) -> About | None:
        """Wait until it is known what comes; None when it was stopped before."""

    def rows(self, stop: threading.Event) -> Iterator[Rows]:
        """Yield rows until there are no more or it is stopped."""

    def notes(self) -> tuple[str, ...]:
        """Say what a person should know about the rows so far."""

    def close(self) -> None:
        """Give back what is held."""


class RecordingSource:
    """A recording, handed over as fast as it is taken.

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
        """From the first stamp to the last, s."""
        return float(self._recording.time[-1] - self._recording.time[0])

    def begin(self, stop: threading.Event) -> About | None:
        """Tell of the recording at once."""
        return About(nominal_rate(self._recording), self._recording)

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
        """Nothing is held."""


class PortSource:
    """Rows from a serial port.

    Parameters
    ----------
    port : PortReader
        Open; `close` stops it.
    name : str
        For messages.
    vehicle : Vehicle
        For channels in counts.
    rate : float or None
        Rows a second, Hz, for streams without stamps.
    """

    def __init__(
        self, port: PortReader, name: str, vehicle: Vehicle, rate: float | None = None
    ) -> None:
        self._port = port
        self._name = name
        self._vehicle = vehicle
        self._reader = LineReader(name, rate)
        self._pieces = port.pieces()
        self._waiting: list[Piece] = []

    def begin(self, stop: threading.Event) -> About | None:
        """Wait for the first rows.

        Raises
        ------
        InputError
            If the stream cannot be a recording, or the vehicle lacks a zero or a scale.
        """
        while not stop.is_set():
            piece = next(self._pieces, None)
            if piece is None:
                return None
            self._take(piece)
            start = self._held()
            if start is not None and self._reader.rate is not None:
                return About(self._reader.rate, start)
        return None

    def rows(self, stop: threading.Event) -> Iterator[Rows]:
        """Yield rows as they come."""
        for piece in itertools.chain((b"",), self._pieces):
            if stop.is_set():
                return
            self._take(piece)
            whole, self._waiting = self._held(1), []
            if whole is not None:  # an empty row went ahead of them
                yield Rows(whole.time[1:], accelerations(whole, self._vehicle)[:, 1:].T)

    def notes(self) -> tuple[str, ...]:
        """Say what was lost, and where the bytes are kept."""
        said = [f"Every byte is kept in {self._port.file.name}."]
        if not self._port.connected:
            said.insert(0, f"{self._name} is away; it is opened again as soon as it is back.")
        elif self._port.losses:
            said.append(f"{self._name} went away {_times(self._port.losses)} and came back.")
        if self._reader.unreadable:
            lines = self._reader.unreadable
            said.append(f"{lines} {'line was' if lines == 1 else 'lines were'} not readable.")
        if self._reader.restarts:
            said.append(f"The stamps began again {_times(self._reader.restarts)}.")
        return tuple(said)

    def close(self) -> None:
        """Stop the reader thread; bytes that have come are in the file."""
        self._port.stop()

    def _take(self, data: bytes) -> None:
        """Read bytes into rows that wait to be yielded."""
        piece = self._reader.feed(data)
        if len(piece.time):
            self._waiting.append(piece)

    def _held(self, ahead: int = 0) -> Recording | None:
        """Make a recording of the rows that wait, with so many empty ones ahead; two at least."""
        units = self._reader.units
        time = np.concatenate([np.empty(0), *(piece.time for piece in self._waiting)])
        if units is None or not len(time) or len(time) + ahead < 2:
            return None
        values = np.concatenate([piece.values for piece in self._waiting], axis=1)
        time = np.concatenate((time[0] - np.arange(ahead, 0.0, -1.0), time))
        values = np.concatenate((np.full((len(values), ahead), np.nan), values), axis=1)
        return Recording(time, values, units, self._reader.metadata, self._name)


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")
