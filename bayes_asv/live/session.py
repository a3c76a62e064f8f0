"""A live session: the history of one recording or port, the playback position, and its controls."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from bayes_asv.domain.errors import InputError
from bayes_asv.live.history import History, Snapshot
from bayes_asv.live.metadata import ViewMetadata

__all__ = ["FRAME_RATE", "SPEEDS", "Playback", "PlaybackClock", "Session"]

FRAME_RATE: Final = 12.5
"""Frames of a live view per second."""

SPEEDS: Final = (0.01, 100.0)
"""Slowest and fastest playback, recording seconds per second."""

_ACTIONS: Final = ("pause", "play", "restart", "seek", "speed")
_MAX_ADVANCE: Final = 0.25  # s: after a longer time without a viewer the playback has waited


class PlaybackClock:
    """Position in a recording that advances while viewers ask for it.

    The caller provides the time, so that tests need not wait.  If nobody asks for a while, the
    playback waits: it begins when the first browser is ready.

    Parameters
    ----------
    speed : float
        Recording seconds per second.
    follow : bool
        Stay at the newest row instead, while not paused.
    """

    def __init__(self, speed: float = 1.0, *, follow: bool = False) -> None:
        self.position = 0.0
        self.speed = speed
        self.playing = True
        self.follow = follow
        self._last: float | None = None

    def advance(self, now: float, end: float) -> float:
        """Advance the position.

        Parameters
        ----------
        now : float
            Time of a monotonic clock, s.
        end : float
            Position of the newest row, s, beyond which the position does not advance.

        Returns
        -------
        float
            The position, s.
        """
        elapsed = 0.0 if self._last is None else min(max(now - self._last, 0.0), _MAX_ADVANCE)
        self._last = now
        if self.playing:
            target = end if self.follow else self.position + self.speed * elapsed
            self.position = min(max(target, 0.0), max(end, 0.0))
        return self.position

    def pause(self) -> None:
        """Stop advancing."""
        self.playing = False

    def play(self) -> None:
        """Advance again."""
        self.playing = True

    def seek(self, position: float) -> None:
        """Go to a position, s, whether playing or not.

        Raises
        ------
        ValueError
            If it is not finite.
        """
        if not math.isfinite(position):
            raise ValueError("a position is a number of seconds")
        self.position = max(position, 0.0)

    def set_speed(self, speed: float) -> None:
        """Change the speed.

        Raises
        ------
        ValueError
            If it is outside of `SPEEDS`.
        """
        if not SPEEDS[0] <= speed <= SPEEDS[1]:
            raise ValueError(f"a speed lies between {SPEEDS[0]:g} and {SPEEDS[1]:g}")
        self.speed = speed


@dataclass(frozen=True)
class Playback:
    """State of the playback at one moment.

    Parameters
    ----------
    snapshot : Snapshot
        All rows so far.
    rows : int
        Number of its rows up to the position.
    position, end : float
        Position of the playback and of the newest row, s after the first row.
    state : str
        ``waiting`` (no row yet), ``playing``, ``paused``, ``ended`` or ``failed``.
    speed : float
        Recording seconds per second.
    notes : tuple of str
        Notes about the rows, for the user.
    """

    snapshot: Snapshot
    rows: int
    position: float
    end: float
    state: str
    speed: float
    notes: tuple[str, ...]


class Session:
    """State that all viewers share.  Methods may be called from any thread.

    Parameters
    ----------
    metadata : ViewMetadata
        Names, units and limits.
    rate : float
        Approximate number of rows per second, Hz.
    speed : float
        Initial speed, recording seconds per second.
    keep : int or None
        Rows to keep at least; None keeps all.
    clock : callable
        Monotonic time, s.
    """

    def __init__(
        self,
        metadata: ViewMetadata,
        rate: float,
        *,
        speed: float = 1.0,
        keep: int | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.metadata = metadata
        self.rate = rate
        self.history = History(metadata, keep)
        self._clock = PlaybackClock(speed, follow=metadata.live)
        self._now = clock
        self._lock = threading.Lock()
        self._origin: float | None = None  # stamp of the very first row
        self._finished = False
        self._error = ""
        self._notes: tuple[str, ...] = ()

    def finish(self, error: str = "") -> None:
        """Mark the end of the rows, perhaps because of an error."""
        self._error = error
        self._finished = True

    def set_notes(self, *notes: str) -> None:
        """Replace the notes about the rows."""
        self._notes = tuple(note for note in notes if note)

    def playback(self) -> Playback:
        """Advance the clock, and return the state of the playback."""
        finished = self._finished  # read before the rows: once finished, all of them are there
        snapshot = self.history.snapshot()
        count = len(snapshot.time)
        with self._lock:
            if count and self._origin is None:
                self._origin = float(snapshot.time[0])
            origin = self._origin or 0.0
            end = float(snapshot.time[-1]) - origin if count else 0.0
            position = self._clock.advance(self._now(), end)
            playing, speed = self._clock.playing, self._clock.speed
        rows = int(np.searchsorted(snapshot.time, origin + position, side="right"))
        if count and position <= 0.0:
            rows = max(rows, 1)
        if self._error:
            state = "failed"
        elif not count:
            state = "ended" if finished else "waiting"
        elif finished and position >= end:
            state = "ended"
        else:
            state = "playing" if playing else "paused"
        notes = (*((self._error,) if self._error else ()), *self._notes)
        return Playback(snapshot, rows, position, end, state, speed, notes)

    def control(self, action: str, value: Any = None) -> None:
        """Perform an action: ``pause``, ``play``, ``restart``, ``seek`` or ``speed``.

        Parameters
        ----------
        action : str
            One of these.
        value : float, optional
            Position, s, or speed, for the last two.

        Raises
        ------
        InputError
            For an unknown action or an invalid value, or if a live port is asked to go back.
        """
        if action not in _ACTIONS:
            raise InputError("control", "there is no such action", f"use {', '.join(_ACTIONS)}")
        if self.metadata.live and action not in ("pause", "play"):
            raise InputError(
                "control", f"{action} is not possible with a live port", "use pause or play"
            )
        number = 0.0
        if action in ("seek", "speed"):
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise InputError("control", f"{action} needs a number", "give it as value")
            number = float(value)
        try:
            with self._lock:
                if action == "speed":
                    self._clock.set_speed(number)
                elif action in ("seek", "restart"):
                    self._clock.seek(number)
                if action in ("restart", "play"):
                    self._clock.play()
                elif action == "pause":
                    self._clock.pause()
        except ValueError as error:
            raise InputError("control", str(error), "give another value") from None
