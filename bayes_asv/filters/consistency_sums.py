"""Sums over windows that slide along rows of innovations, compiled."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.discretization import OPTIONS

__all__ = ["LAGS", "SUMS", "Limits", "judge", "slide"]

Array = NDArray[np.float64]

LAGS: Final = 10
"""Rows apart up to which products are summed."""

_AXLE: Final = LAGS + 2  # numbers an axle: products by lag, and how many innovations
SUMS: Final = 2 + 2 * _AXLE
"""Numbers in ``sums``: NIS and readings of the short window, then each axle's of the long one."""


class Limits(NamedTuple):
    """When a doubt begins, and when it ends.

    Parameters
    ----------
    bands : (4, M) array
        By number of readings in a window: the mean NIS within which a doubt ends, low and high,
        and beyond which it begins.
    coloured, white : float
        Statistic of the colour, likewise.
    swollen, shrunk : float
        Level of the noise's variance, likewise; infinite where it tells nothing.
    """

    bands: Array
    coloured: float
    white: float
    swollen: float
    shrunk: float


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


@njit(**OPTIONS)
def judge(
    nis: Array,
    colour: Array,
    level: Array,
    limits: Limits,
    doubt: NDArray[np.bool_],
    mean: Array,
    low: Array,
    high: Array,
    well: NDArray[np.bool_],
) -> None:
    """Doubt and trust, row by row: a doubt lasts from what begins it to what ends it.

    Parameters
    ----------
    nis, colour : (N, 2) and (N,) arrays
        As :func:`slide` filled them.
    level : (N, 2) array
        Level of the noise's variance, front and rear.
    limits : Limits
        See there.
    doubt : (3,) bool array
        Of the mean, the colour and the level, as the row before left them; changed in place.
    mean, low, high : (N,) arrays
        Filled with the mean NIS a reading and its band.
    well : (N,) bool array
        Filled: whether nothing is doubted.
    """
    for k in range(nis.shape[0]):
        count = nis[k, 1]
        mean[k] = nis[k, 0] / count if count > 0.5 else 1.0
        n = int(count + 0.5)
        low[k], high[k] = limits.bands[0, n], limits.bands[1, n]
        if mean[k] < limits.bands[2, n] or mean[k] > limits.bands[3, n]:
            doubt[0] = True
        elif low[k] <= mean[k] <= high[k]:
            doubt[0] = False
        if colour[k] > limits.coloured:
            doubt[1] = True
        elif colour[k] < limits.white:
            doubt[1] = False
        most = max(level[k, 0], level[k, 1])
        if most > limits.swollen:
            doubt[2] = True
        elif most < limits.shrunk:
            doubt[2] = False
        well[k] = not (doubt[0] or doubt[1] or doubt[2])
