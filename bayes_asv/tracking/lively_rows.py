"""Rows of a stream that are kept for a check of its input: the liveliest ones, and the last."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import Channel
from bayes_asv.domain.recording import Recording

__all__ = ["LivelyRows"]

Array = NDArray[np.float64]

_SECONDS = 10.0  # of a block: the check fits the liveliest 2.5 s and holds the rest against it
_LIVELY = 0.25  # of the power of the liveliest block, from which on a later one is kept as well
_UNITS = {"acceleration": "m/s^2", "angular_rate": "rad/s", "deflection": "m"}


class LivelyRows:
    """Keeps the liveliest block of a stream, and the last one that is nearly as lively.

    The last one shows what broke during the drive.

    Parameters
    ----------
    channels : sequence of Channel
        What is in a row.
    metadata : tuple of (key, value)
        Of the recording: delays and clocks.
    """

    def __init__(
        self, channels: Sequence[Channel], metadata: tuple[tuple[str, str], ...] = ()
    ) -> None:
        self._channels = tuple(channels)
        self._metadata = metadata
        self._wheels = [c for c, channel in enumerate(self._channels) if channel.is_input]
        self._rows: list[tuple[Array, Array]] = []  # of the block that is being filled
        self._liveliest: Recording | None = None
        self._latest: Recording | None = None

    def append(self, times: Array, readings: Array) -> None:
        """Add rows: stamps (n,), s, and readings (n, C), SI units."""
        if len(times):
            self._rows.append((times.copy(), readings.copy()))
            if times[-1] - self._rows[0][0][0] >= _SECONDS:
                self._close()

    def recordings(self, source: str) -> list[Recording]:
        """Return what is kept, under the name of its source."""
        self._close()
        kept = (self._liveliest, self._latest)
        return [replace(block, source=source) for block in kept if block is not None]

    def _close(self) -> None:
        """End a block, and keep it where it is lively."""
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
        most = 0.0 if self._liveliest is None else self._power(self._liveliest)
        power = self._power(block)
        if self._liveliest is None or power > most:
            self._liveliest, self._latest = block, None
        elif power > _LIVELY * most:
            self._latest = block

    def _power(self, block: Recording) -> float:
        """Mean squared acceleration of the wheels."""
        wheels = block.values[self._wheels]
        return float(np.nan_to_num(np.nanvar(wheels, axis=1)).sum())
