"""What a transfer and its times are held against: the emulator's own log."""

from __future__ import annotations

import numpy as np

from tests.firmware.emulated import Emulated
from tests.firmware.frames import (
    Block,
)
from tests.firmware.truth import Rows, predicted_times, rows_of

__all__ = ["ROWS", "check_rows", "check_times"]

ROWS = 800


def check_rows(emulated: Emulated, blocks: tuple[Block, Block], since: float) -> list[Rows]:
    """Assert that the laptop holds what the converters gave; their true times."""
    truths = []
    for board, block in zip(("slave_1", "slave_2"), blocks, strict=True):
        truth = rows_of(emulated, board, block.head.readings, since)
        assert block.rows.shape == (ROWS, 2)
        assert truth.count.shape == (ROWS, 2), f"{board}: a row with other conversions"
        # The mean of four counts, rounded to a whole one.
        assert np.abs(block.rows - truth.count).max() <= 0.5
        truths.append(truth)
    return truths


def check_times(blocks: tuple[Block, Block], truths: list[Rows], start: float, ppm: float) -> None:
    """Assert that the boards' times, as the laptop works them out, are the true ones."""
    predicted = predicted_times(*blocks, ppm)
    error = np.array([predicted[i] + start - truths[i].time for i in range(2)])
    assert np.abs(error[0] - error[1]).max() < 10e-6
    assert np.abs(error).max() < 10e-6
