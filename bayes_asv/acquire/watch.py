"""The online filter fed while the rear board's block comes in.

The logger sends a run after it was taken, the front board's block first: 9600 bits a second carry
some sixty rows of both boards a second, no rate at which a car is measured. A row is whole, and
goes into the filter, when its half from the rear has come.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

import numpy as np

from bayes_asv.acquire.blocks import Block
from bayes_asv.acquire.frames import Address
from bayes_asv.acquire.merge import merged
from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.recording import COUNTS, Recording, accelerations
from bayes_asv.domain.units import display_units, from_si
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.report.readable import number
from bayes_asv.tracking.frames import PARAMETERS, Frames, joined
from bayes_asv.tracking.track import Track, concluded
from bayes_asv.tracking.tracker import Tracker, tracker_for

__all__ = ["Watch"]

_EVERY: Final = 200  # rows between words
_Z95: Final = 1.96
_VAGUE: Final = 0.5  # deviation of a logarithm beyond which a number is not worth saying


class Watch:
    """Tracks a run while it is transferred.

    Parameters
    ----------
    vehicle : Vehicle
        The car, its sensors with zero and scale.
    say : callable
        Told where the parameters stand.

    Raises
    ------
    InputError
        If a sensor has no zero or no scale.
    """

    def __init__(self, vehicle: Vehicle, say: Callable[[str], None]) -> None:
        nothing = Recording(np.arange(2.0), np.zeros((len(CHANNELS), 2)), (COUNTS,) * 4)
        accelerations(nothing, vehicle)  # told now, not after the run
        self._vehicle, self._say = vehicle, say
        self._blocks: dict[int, Block] = {}
        self._tracker: Tracker | None = None
        self._frames: list[Frames] = []
        self._fed = 0
        self._next = _EVERY
        self._seconds = 0.0

    @property
    def rows(self) -> int:
        """Rows that the filter has taken."""
        return self._fed

    def grown(self, block: Block) -> None:
        """Take the rows that have become whole with a frame of a block."""
        self._blocks[block.board] = block
        front, rear = (self._blocks.get(b) for b in (Address.SLAVE_1, Address.SLAVE_2))
        if front is None or rear is None or not front.verified or not (rear.head and rear.times):
            return
        made = merged(front, rear).recording
        if made is not None:
            holes = np.flatnonzero(np.isnan(made.values).any(axis=0))
            self._feed(made, int(holes[0]) if holes.size else len(made.time))

    def finish(self, recording: Recording) -> Track:
        """Take what is left of a recording, gaps and all, and conclude.

        Where a block failed its CRC-32 and was fetched again, tracking begins again as well.
        """
        again = any(block.dropped for block in self._blocks.values())
        if again or self._fed > len(recording.time):
            self._tracker, self._frames, self._fed = None, [], 0
        self._feed(recording, len(recording.time))
        assert self._tracker is not None
        self._frames.append(self._tracker.finish())
        return concluded(
            self._tracker,
            joined(self._frames),
            recording.source,
            recording.sha256,
            recording.warnings,
            self._seconds,
        )

    def _feed(self, recording: Recording, end: int) -> None:
        if end <= self._fed and self._tracker is not None:
            return
        began = time.perf_counter()
        if self._tracker is None:
            self._tracker = tracker_for(recording, self._vehicle)
        part = slice(self._fed, end)
        acceleration = accelerations(recording, self._vehicle)[:, part].T
        self._frames.append(self._tracker.feed(recording.time[part], acceleration))
        self._fed = end
        self._seconds += time.perf_counter() - began
        if end >= self._next:
            self._next = end - end % _EVERY + _EVERY
            self._say(f"after {end} rows: {self._standing()}")

    def _standing(self) -> str:
        """Where c_f, c_r and i stand after the last row that the filter has finished."""
        last = next((frames for frames in reversed(self._frames) if len(frames)), None)
        if last is None:
            return "nothing known yet"
        said = []
        for k, name in enumerate(PARAMETERS):
            dimension, label = QUANTITIES[name][:2]
            unit = display_units(self._vehicle.units)[dimension]
            median, sd = float(last.median[-1, k]), float(last.log_sd[-1, k])
            if sd > _VAGUE:
                said.append(f"{label} not known yet")
                continue
            value = from_si(median, unit, dimension)
            ends = (value * np.exp(sign * _Z95 * sd) for sign in (-1.0, 1.0))
            low, high = (number(float(x), value * sd) for x in ends)
            said.append(f"{label} {number(value, value * sd)} {unit} (95 %: {low} to {high})")
        return ", ".join(said)
