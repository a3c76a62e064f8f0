"""Online filter fed while the rear board's block is being transferred.

The logger sends a run after it was taken, the front board's block first; at 9600 bits per second it
transfers some sixty rows of both boards per second. A row is complete, and enters the filter, when
its half from the rear board has arrived.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

import numpy as np

from bayes_asv.acquire.blocks import Block
from bayes_asv.acquire.frames import Address
from bayes_asv.acquire.merge import merge_blocks
from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.quantities import NORMAL_975, QUANTITIES
from bayes_asv.domain.recording import COUNTS, Recording, accelerations
from bayes_asv.domain.units import display_units, from_si
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.report.words import number
from bayes_asv.tracking.frames import Frames, concatenate
from bayes_asv.tracking.track import TrackResult, conclude
from bayes_asv.tracking.tracker import Tracker, tracker_for

__all__ = ["TransferOnlineFilter"]

_MESSAGE_ROWS: Final = 200  # rows between messages
_MAX_LOG_SD: Final = 0.5  # standard deviation of a logarithm beyond which no number is given


class TransferOnlineFilter:
    """Tracks a run while it is transferred.

    Parameters
    ----------
    vehicle : Vehicle
        The car, with zero and scale of its sensors.
    say : callable
        Called with the estimates as a message.

    Attributes
    ----------
    rows : int
        Rows that the filter has received.

    Raises
    ------
    InputError
        If a sensor has no zero or no scale.
    """

    def __init__(self, vehicle: Vehicle, say: Callable[[str], None]) -> None:
        probe = Recording(np.arange(2.0), np.zeros((len(CHANNELS), 2)), (COUNTS,) * 4)
        accelerations(probe, vehicle)  # fail now, not after the run
        self.rows = 0
        self._vehicle, self._say = vehicle, say
        self._blocks: dict[int, Block] = {}
        self._tracker: Tracker | None = None
        self._frames: list[Frames] = []
        self._next_message = _MESSAGE_ROWS
        self._seconds = 0.0

    def on_block(self, block: Block) -> None:
        """Process the rows that are complete with a new frame of a block."""
        self._blocks[block.board] = block
        front, rear = (self._blocks.get(b) for b in (Address.SLAVE_1, Address.SLAVE_2))
        if front is None or rear is None or not front.verified or not (rear.head and rear.times):
            return
        recording = merge_blocks(front, rear).recording
        if recording is not None:
            gaps = np.flatnonzero(np.isnan(recording.values).any(axis=0))
            self._feed(recording, int(gaps[0]) if gaps.size else len(recording.time))

    def finish(self, recording: Recording) -> TrackResult:
        """Process the rest of a recording, with its gaps, and conclude.

        Tracking starts again if a block failed its CRC-32 and was fetched again.
        """
        refetched = any(block.discards for block in self._blocks.values())
        if refetched or self.rows > len(recording.time):
            self._tracker, self._frames, self.rows = None, [], 0
        self._feed(recording, len(recording.time))
        assert self._tracker is not None
        self._frames.append(self._tracker.finish())
        return conclude(
            self._tracker,
            concatenate(self._frames),
            recording.source,
            recording.sha256,
            recording.warnings,
            self._seconds,
        )

    def _feed(self, recording: Recording, end: int) -> None:
        if end <= self.rows and self._tracker is not None:
            return
        began = time.perf_counter()
        if self._tracker is None:
            self._tracker = tracker_for(recording, self._vehicle)
        part = slice(self.rows, end)
        acceleration = accelerations(recording, self._vehicle)[:, part].T
        self._frames.append(self._tracker.feed(recording.time[part], acceleration))
        self.rows = end
        self._seconds += time.perf_counter() - began
        if end >= self._next_message:
            self._next_message = end - end % _MESSAGE_ROWS + _MESSAGE_ROWS
            self._say(f"after {end} rows: {self._estimates()}")

    def _estimates(self) -> str:
        """Estimates of c_f, c_r and i after the last complete row."""
        last = next((frames for frames in reversed(self._frames) if len(frames)), None)
        if last is None or self._tracker is None:
            return "nothing known yet"
        texts = []
        for k, name in enumerate(self._tracker.estimands):
            dimension, label = QUANTITIES[name][:2]
            unit = display_units(self._vehicle.units)[dimension]
            median, log_sd = float(last.median[-1, k]), float(last.log_sd[-1, k])
            if log_sd > _MAX_LOG_SD:
                texts.append(f"{label} not known yet")
                continue
            value = from_si(median, unit, dimension)
            ends = (value * np.exp(sign * NORMAL_975 * log_sd) for sign in (-1.0, 1.0))
            low, high = (number(float(x), value * log_sd) for x in ends)
            shown = number(value, value * log_sd)
            texts.append(f"{label} {shown} {unit} (95 %: {low} to {high})")
        return ", ".join(texts)
