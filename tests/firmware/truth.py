"""What really happened in an emulated run, from the emulator's log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.firmware.emulated import Emulated
from tests.firmware.frames import CPU, Block

__all__ = ["Rows", "predicted_times", "rows_of", "synch_pulses"]

ADC_CLOCK = 32 / CPU  # s
WHEEL, CHASSIS = 0, 1


@dataclass(frozen=True)
class Rows:
    """What a board's converter did, row by row.

    Attributes
    ----------
    time
        Shape (rows, 2): true mean instant of the sample-and-holds of wheel and chassis, in seconds.
    count
        Shape (rows, 2): mean of the conversions, before any rounding.
    """

    time: NDArray[np.float64]
    count: NDArray[np.float64]


def rows_of(emulated: Emulated, board: str, readings: int, since: float = 0.0) -> Rows:
    """The rows that a board has taken, from a log with ``log adc``.

    A row is a burst of 2 * `readings` conversions without a gap, first of wheel, then of chassis.
    """
    events = [e for e in emulated.events("adc", board=board) if e["sampled"] >= since]
    time = np.array([e["sampled"] for e in events])
    channel = np.array([e["channel"] for e in events])
    count = np.array([e["count"] for e in events], dtype=float)
    bursts = np.split(np.arange(time.size), np.flatnonzero(np.diff(time) > 20 * ADC_CLOCK) + 1)
    pattern = np.repeat([WHEEL, CHASSIS], readings)
    rows = np.array([b for b in bursts if np.array_equal(channel[b], pattern)], dtype=int)
    shape = (-1, 2, readings)
    return Rows(time[rows].reshape(shape).mean(axis=2), count[rows].reshape(shape).mean(axis=2))


def synch_pulses(emulated: Emulated, since: float = 0.0) -> list[float]:
    """True times of the rising edges on the synch wire, from a log with ``log wires``."""
    edges = emulated.events("wire", name="synch", level=True)
    return [e["t"] for e in edges if e["t"] >= since]


def predicted_times(front: Block, rear: Block, ppm: float) -> NDArray[np.float64]:
    """Times of all readings as the laptop works them out from the two blocks alone.

    Parameters
    ----------
    ppm
        True crystal error of Slave 1, so that its seconds are true ones: what is asked is how the
        two boards agree, not which of them is right.

    Returns
    -------
    Shape (2 boards, rows, 2 channels): seconds from the start mark.
    """
    second = CPU * (1 + ppm * 1e-6) / front.head.prescale
    scale = front.elapsed() / rear.elapsed()
    return np.array(
        [
            np.column_stack([block.ticks(channel) for channel in (WHEEL, CHASSIS)])
            * factor
            / second
            for block, factor in ((front, 1.0), (rear, scale))
        ]
    )
