"""Where in the recording one looks, as time goes by: pause, speed, restart."""

from __future__ import annotations

import math
from typing import Final

__all__ = ["SPEEDS", "Clock"]

SPEEDS: Final = (0.01, 100.0)
"""Slowest and fastest, recording seconds a second."""

_LONGEST_STEP: Final = 0.25  # s: nobody looked for longer, so nothing was missed


class Clock:
    """A position that moves while somebody asks for it.

    The caller gives the time, so that tests need not wait; and if nobody asks for a while, the
    recording waits as well: it begins when the first browser has come up, not before.

    Parameters
    ----------
    speed : float
        Recording seconds a second.
    follow : bool
        Stay at the newest row instead, while not paused.
    """

    def __init__(self, speed: float = 1.0, *, follow: bool = False) -> None:
        self.position = 0.0
        self.speed = speed
        self.playing = True
        self.follow = follow
        self._asked: float | None = None

    def advance(self, now: float, end: float) -> float:
        """Move on.

        Parameters
        ----------
        now : float
            Time of a steady clock, s.
        end : float
            Position of the newest row, s: the clock waits there.

        Returns
        -------
        float
            The position, s.
        """
        passed = 0.0 if self._asked is None else min(max(now - self._asked, 0.0), _LONGEST_STEP)
        self._asked = now
        if self.playing:
            wanted = end if self.follow else self.position + self.speed * passed
            self.position = min(max(wanted, 0.0), max(end, 0.0))
        return self.position

    def pause(self) -> None:
        """Stand still."""
        self.playing = False

    def play(self) -> None:
        """Go on."""
        self.playing = True

    def seek(self, position: float) -> None:
        """Go to a position, s, playing or not.

        Raises
        ------
        ValueError
            If it is not a number.
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
