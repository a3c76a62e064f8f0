"""One recording or port, watched: what is known of it, where one looks, and what may be asked."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from bayes_asv.domain.errors import InputError
from bayes_asv.live.clock import Clock
from bayes_asv.live.history import History, Snapshot
from bayes_asv.live.metadata import Scene

__all__ = ["Moment", "Show"]

_ACTIONS: Final = ("pause", "play", "restart", "seek", "speed")


@dataclass(frozen=True)
class Moment:
    """Where one looks.

    Parameters
    ----------
    snapshot : Snapshot
        Everything there is.
    rows : int
        How many of its rows belong to the past.
    position, end : float
        s after the first row, of the moment and of the newest row.
    state : str
        ``waiting`` (no row yet), ``playing``, ``paused``, ``ended`` or ``failed``.
    speed : float
        Recording seconds a second.
    notes : tuple of str
        What a person should know about the rows.
    """

    snapshot: Snapshot
    rows: int
    position: float
    end: float
    state: str
    speed: float
    notes: tuple[str, ...]


class Show:
    """What all viewers share.  Methods may be called from any thread.

    Parameters
    ----------
    scene : Scene
        What stays.
    rate : float
        Rows a second, Hz, about.
    speed : float
        Recording seconds a second to begin with.
    keep : int or None
        Rows to remember at least; None forgets nothing.
    clock : callable
        Steady time, s.
    """

    def __init__(
        self,
        scene: Scene,
        rate: float,
        *,
        speed: float = 1.0,
        keep: int | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.scene = scene
        self.rate = rate
        self.history = History(scene, keep)
        self._clock = Clock(speed, follow=scene.live)
        self._now = clock
        self._lock = threading.Lock()
        self._origin: float | None = None  # stamp of the very first row
        self._finished = False
        self._fault = ""
        self._notes: tuple[str, ...] = ()

    def finish(self, fault: str = "") -> None:
        """Say that no more rows come, perhaps because of a fault."""
        self._fault = fault
        self._finished = True

    def note(self, *notes: str) -> None:
        """Replace what a person should know about the rows."""
        self._notes = tuple(note for note in notes if note)

    def moment(self) -> Moment:
        """Move the clock on, and tell where it stands."""
        finished = self._finished  # before the rows: what is ended has all of them
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
        if self._fault:
            state = "failed"
        elif not count:
            state = "ended" if finished else "waiting"
        elif finished and position >= end:
            state = "ended"
        else:
            state = "playing" if playing else "paused"
        notes = (*((self._fault,) if self._fault else ()), *self._notes)
        return Moment(snapshot, rows, position, end, state, speed, notes)

    def ask(self, action: str, value: Any = None) -> None:
        """Do what a viewer asks: ``pause``, ``play``, ``restart``, ``seek`` or ``speed``.

        Parameters
        ----------
        action : str
            One of these.
        value : float, optional
            Position, s, or speed, for the last two.

        Raises
        ------
        InputError
            If it is none of these, the value does not fit, or a port is asked to go back.
        """
        if action not in _ACTIONS:
            raise InputError("control", "there is no such action", f"use {', '.join(_ACTIONS)}")
        if self.scene.live and action not in ("pause", "play"):
            raise InputError("control", "a port has no other time than now", "pause or play")
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
        except ValueError as fault:
            raise InputError("control", str(fault), "give another value") from None
