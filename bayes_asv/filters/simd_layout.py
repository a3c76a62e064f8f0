"""Memory layout of the lanes: one array, in blocks of eight lanes side by side.

A lane holds one car with one state.  A block is a table with a row for each quantity and one column
for each of its eight lanes, so that a compiler can load a row into one vector register.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from bayes_asv.filters.prediction import IN_PLACE
from bayes_asv.filters.ukf_state import Sizes

__all__ = [
    "LANES", "WIDTH", "ZERO", "Rows", "blocks", "lane_offset", "lane_rows", "transition_lanes",
]  # fmt: skip

LANES = 8  # per block
ZERO, WIDTH = np.uint64(0), np.uint64(LANES)


class Rows(NamedTuple):
    """Offsets of the rows in a block; each is that of the first row of its quantity.

    Fixed offsets into one array show the compiler that rows do not overlap, and unsigned ones that
    no index counts from the end.  Without either it would not vectorize, at eight times the cost.

    Parameters
    ----------
    A : int
        Accelerations (nR, 2 ne) by deflections and their rates.
    before, after : int
        States of the motion (nx,) before and after the step.
    slope : int
        Accelerations (nR,) at one state.
    forcing : int
        Filtered noise and bias (ne,) of the inputs, m/s².
    inverse_gain : int
        Inverse gains (ne,) of the input sensors.
    step : int
        Length of the step, s.
    reading : int
        Outputs (ny,).
    rate : int
        Bound of the eigenvalues, 1/s.
    damping, spring : int
        Rates (ne,) of the elements.
    input_gain, gain : int
        Gains (ne,) of the input sensors and (ny,) of the output sensors.
    geometry : int
        Polynomials (nG,) of :class:`bayes_asv.filters.ukf_state.Model`.
    parameters : int
        Parameters that are none of these.
    size : int
        Length of a block.
    """

    A: int
    before: int
    after: int
    slope: int
    forcing: int
    inverse_gain: int
    step: int
    reading: int
    rate: int
    damping: int
    spring: int
    input_gain: int
    gain: int
    geometry: int
    parameters: int
    size: int


def lane_rows(sizes: Sizes) -> Rows:
    """Return the offsets of the rows in a block."""
    ne, nx, ny, nR = sizes.elements, sizes.motion, sizes.outputs, sizes.rows
    n = sizes.coordinates
    places = [0]
    for count in (
        2 * ne * nR, nx, nx, nR, ne, ne, 1, ny, 1, ne, ne, ne, ny, ne * n + n + (nR - ne) * n,
        sizes.parameters,
    ):  # fmt: skip
        places.append(places[-1] + count * LANES)
    return Rows(*places)


@njit(**IN_PLACE)
def transition_lanes(ne: int) -> int:
    """Return the number of lanes after the sigma points, for the transition matrices."""
    return 4 * ne


@njit(**IN_PLACE)
def blocks(p: int, ne: int) -> int:
    """Return the number of blocks for p directions."""
    count: int = (1 + 2 * p + transition_lanes(ne) + LANES - 1) // LANES
    return count


@njit(**IN_PLACE)
def lane_offset(lane: int, size: int) -> np.uint64:
    """Return the offset of a lane in the first row of its block."""
    return np.uint64(lane >> 3) * np.uint64(size) + np.uint64(lane & 7)
