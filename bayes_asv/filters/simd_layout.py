"""Where the numbers of a lane stand: one array, in blocks of eight lanes side by side.

A lane holds one half car with one state.  A block is a table of rows of eight numbers, one for each
of its lanes, so that a compiler can take a row in one go.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from bayes_asv.filters.discretization import OPTIONS

__all__ = [
    "A0", "A1", "A2", "A3", "A4", "A5", "A6", "A7", "BLOCK", "CAR", "EIGHT", "GF", "GR",
    "LANES", "NONE", "ONE", "RATE", "SIZE", "STRUCTURE", "UF", "UR", "V0", "V1", "V2", "V3", "WF",
    "WR", "X0", "X1", "X2", "X3", "YF", "YR", "H", "blocks", "place",
]  # fmt: skip

LANES = 8  # in a block
_ROWS = 38  # of a block
BLOCK = _ROWS * LANES
STRUCTURE = 8  # lanes behind the sigma points


def _row(number: int) -> np.uint64:
    """Where a row of a block begins.

    One array with fixed offsets, so that the compiler sees that rows do not overlap; without a
    sign, so that it need not think of places counted from the end.  Either would cost it the
    vector unit, and eight times the time.
    """
    return np.uint64(number * LANES)


A0, A1, A2, A3 = _row(0), _row(1), _row(2), _row(3)  # δ̈_f by the four states
A4, A5, A6, A7 = _row(4), _row(5), _row(6), _row(7)  # δ̈_r
X0, X1, X2, X3 = _row(8), _row(9), _row(10), _row(11)  # states before
V0, V1, V2, V3 = _row(12), _row(13), _row(14), _row(15)  # states after
WF, WR = _row(16), _row(17)  # steady input, m/s²
UF, UR = _row(18), _row(19)  # share of the wheels' input
H = _row(20)  # length of the step, s
YF, YR = _row(21), _row(22)  # chassis readings
GF, GR = _row(23), _row(24)  # reading over truth of the chassis sensors
RATE = _row(25)  # no motion of the car is faster, 1/s
CAR = _row(26)  # the twelve numbers of a car
ONE = _row(1)
NONE, EIGHT = np.uint64(0), np.uint64(LANES)
SIZE = np.uint64(BLOCK)


@njit(**OPTIONS)
def blocks(p: int) -> int:
    """Count the blocks that p directions take."""
    return (1 + 2 * p + STRUCTURE + LANES - 1) // LANES


@njit(**OPTIONS)
def place(lane: int) -> np.uint64:
    """Place of a lane in the first row of its block."""
    return np.uint64(lane >> 3) * SIZE + np.uint64(lane & 7)
