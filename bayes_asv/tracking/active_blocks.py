"""Rows of a stream that are kept for the input check: the most active block, and the latest one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import Channel
from bayes_asv.domain.recording import Recording

__all__ = ["ActiveBlocks"]

Array = NDArray[np.float64]

# Length of a block, s: the check fits the most active 2.5 s, and compares the rest with that fit.
_SECONDS = 10.0
_MIN_POWER = 0.25  # least power of a later block that is kept, relative to the most active one
_UNITS = {"acceleration": "m/s^2", "angular_rate": "rad/s", "deflection": "m"}


class ActiveBlocks:
    """Keeps the most active block of a stream, and the latest one that is nearly as active.

    The latest one shows faults that occurred during the drive.

    Parameters
    ----------
    channels : sequence of Channel
        Channels of a row.
    metadata : tuple of (key, value)
        Metadata of the recording: delays and clocks.
    """

    def __init__(
        self, channels: Sequence[Channel], metadata: tuple[tuple[str, str], ...] = ()
    ) -> None:
        self._channels = tuple(channels)
        self._metadata = metadata
        self._wheels = [c for c, channel in enumerate(self._channels) if channel.is_input]
        self._rows: list[tuple[Array, Array]] = []  # rows of the current block
        self._most_active: Recording | None = None
        self._latest: Recording | None = None

    def append(self, times: Array, readings: Array) -> None:
        """Add rows: stamps (n,), s, and readings (n, C), SI units."""
        if len(times):
            self._rows.append((times.copy(), readings.copy()))
            if times[-1] - self._rows[0][0][0] >= _SECONDS:
                self._close()

    def recordings(self, source: str) -> list[Recording]:
        """Return the kept blocks, with the name of their source."""
        self._close()
        kept = (self._most_active, self._latest)
        return [replace(block, source=source) for block in kept if block is not None]

    def _close(self) -> None:
        """End a block, and keep it if it is active enough."""
        rows = sum(len(time) for time, _ in self._rows)
        if rows < 2:
            return
        block = Recording(
            time=np.concatenate([time for time, _ in self._rows]),
            values=np.concatenate([readings for _, readings in self._rows]).T,
            units=tuple(_UNITS[channel.quantity] for channel in self._channels),
            metadata=self._metadata,
            channels=tuple(channel.name for channel in self._channels),
        )
        self._rows = []
        most = 0.0 if self._most_active is None else self._power(self._most_active)
        power = self._power(block)
        if self._most_active is None or power > most:
            self._most_active, self._latest = block, None
        elif power > _MIN_POWER * most:
            self._latest = block

    def _power(self, block: Recording) -> float:
        """Mean squared acceleration of the wheels."""
        wheels = block.values[self._wheels]
        return float(np.nan_to_num(np.nanvar(wheels, axis=1)).sum())
