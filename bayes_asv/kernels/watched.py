"""Sums over windows that slide along rows of innovations, compiled."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.kernels.steps import OPTIONS

__all__ = ["LAGS", "SUMS", "slide"]

Array = NDArray[np.float64]

LAGS: Final = 10
"""Rows apart up to which products are summed."""

_AXLE: Final = LAGS + 2  # numbers an axle: products by lag, and how many innovations
SUMS: Final = 2 + 2 * _AXLE
"""Numbers in ``sums``: NIS and readings of the short window, then each axle's of the long one."""

_LEAST: Final = 1e-10  # less than any sum of squares but one of nothing


@njit(**OPTIONS)
def slide(
    rows: Array,
    first: int,
    short: int,
    long: int,
    since: int,
    sums: Array,
    totals: Array,
    nis: Array,
    colour: Array,
) -> int:
    """Carry the sums over rows, one after the other, so that chunks make no difference.

    What a window gains and loses is added and taken away; once in a long window all is summed
    afresh, so that neither rounding nor a number beyond all bounds stays.

    Parameters
    ----------
    rows : (M, 4) array
        Squared innovations of a row and how many readings it has, then the innovation of either
        axle, zero where there is none.
    first : int
        Row to begin with, ``long + LAGS`` or later.
    short, long : int
        Rows of the windows.
    since : int
        Rows since all was summed afresh.
    sums : (SUMS,) array
        As the row before left them; changed in place.
    totals : (2, LAGS + 1) array
        Products of each axle by lag, over all rows ever; added to.
    nis : (M − first, 2) array
        Filled with the sums of the first two columns over the short window.
    colour : (M − first,) array
        Filled with n Σ r_l² of both axles over the long one (Box & Pierce 1970).

    Returns
    -------
    int
        ``since``, for the next call.
    """
    for e in range(first, rows.shape[0]):
        since += 1
        if since >= long:
            since = 0
            _afresh(rows, e, short, long, sums)
        else:
            for c in range(2):
                sums[c] += rows[e, c] - rows[e - short, c]
            for axle in range(2):
                at = 2 + axle * _AXLE
                new, old = rows[e, 2 + axle], rows[e - long, 2 + axle]
                for lag in range(LAGS + 1):
                    sums[at + lag] += (
                        new * rows[e - lag, 2 + axle] - old * rows[e - long - lag, 2 + axle]
                    )
                sums[at + LAGS + 1] += (1.0 if new != 0.0 else 0.0) - (1.0 if old != 0.0 else 0.0)
        k = e - first
        nis[k, 0], nis[k, 1] = sums[0], sums[1]
        colour[k] = 0.0
        for axle in range(2):
            at = 2 + axle * _AXLE
            for lag in range(LAGS + 1):
                totals[axle, lag] += rows[e, 2 + axle] * rows[e - lag, 2 + axle]
            power, count = sums[at], sums[at + LAGS + 1]
            if count > 0.5 and power > _LEAST:
                squares = 0.0
                for lag in range(1, LAGS + 1):
                    squares += sums[at + lag] * sums[at + lag]
                colour[k] += count * squares / (power * power)
    return since


@njit(**OPTIONS)
def _afresh(rows: Array, end: int, short: int, long: int, sums: Array) -> None:
    """Sum over the windows that end with a row."""
    sums[:] = 0.0
    for e in range(end - short + 1, end + 1):
        sums[0] += rows[e, 0]
        sums[1] += rows[e, 1]
    for axle in range(2):
        at = 2 + axle * _AXLE
        for e in range(end - long + 1, end + 1):
            new = rows[e, 2 + axle]
            for lag in range(LAGS + 1):
                sums[at + lag] += new * rows[e - lag, 2 + axle]
            sums[at + LAGS + 1] += 1.0 if new != 0.0 else 0.0
