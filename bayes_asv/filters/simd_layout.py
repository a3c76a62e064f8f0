"""Memory layout of the lanes: one array, in blocks of eight lanes side by side.

A lane holds one half car with one state.  A block is a table with a row for each quantity and one
column for each of its eight lanes, so that a compiler can load a row into one vector register.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from bayes_asv.filters.prediction import OPTIONS

__all__ = [
    "A0", "A1", "A2", "A3", "A4", "A5", "A6", "A7", "BLOCK", "BLOCK_SIZE", "GF", "GR", "LANES",
    "PARAMETERS", "RATE", "ROW", "TRANSITION_LANES", "UF", "UR", "V0", "V1", "V2", "V3", "WF",
    "WIDTH", "WR", "X0", "X1", "X2", "X3", "YF", "YR", "ZERO", "H", "blocks", "lane_offset",
]  # fmt: skip

LANES = 8  # per block
_ROWS = 38  # per block
BLOCK = _ROWS * LANES
TRANSITION_LANES = 8  # after the sigma points


def _row(number: int) -> np.uint64:
    """Return the offset of a row in its block.

    Fixed offsets into one array show the compiler that rows do not overlap, and unsigned ones that
    no index counts from the end.  Without either it would not vectorize, at eight times the cost.
    """
    return np.uint64(number * LANES)


A0, A1, A2, A3 = _row(0), _row(1), _row(2), _row(3)  # δ̈_f by the four states
A4, A5, A6, A7 = _row(4), _row(5), _row(6), _row(7)  # δ̈_r
X0, X1, X2, X3 = _row(8), _row(9), _row(10), _row(11)  # states before the step
V0, V1, V2, V3 = _row(12), _row(13), _row(14), _row(15)  # states after the step
WF, WR = _row(16), _row(17)  # filtered noise of the wheels, m/s²
UF, UR = _row(18), _row(19)  # inverse gains of the wheel sensors
H = _row(20)  # length of the step, s
YF, YR = _row(21), _row(22)  # chassis readings
GF, GR = _row(23), _row(24)  # gains of the chassis sensors
RATE = _row(25)  # bound of the eigenvalues, 1/s
PARAMETERS = _row(26)  # the twelve parameters
ROW = _row(1)
ZERO, WIDTH = np.uint64(0), np.uint64(LANES)
BLOCK_SIZE = np.uint64(BLOCK)


@njit(**OPTIONS)
def blocks(p: int) -> int:
    """Return the number of blocks for p directions."""
    return (1 + 2 * p + TRANSITION_LANES + LANES - 1) // LANES


@njit(**OPTIONS)
def lane_offset(lane: int) -> np.uint64:
    """Return the offset of a lane in the first row of its block."""
    return np.uint64(lane >> 3) * BLOCK_SIZE + np.uint64(lane & 7)
