"""Sliding-window statistics of the online filter's innovations, compiled.

Two windows end with each row: a short one for the normalised innovation squared (NIS), and a long
one for the Box–Pierce statistic of the innovations' autocorrelation.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.prediction import OPTIONS

__all__ = ["LAGS", "ConsistencyLimits", "flag_inconsistency", "sums_length", "update_sums"]

Array = NDArray[np.float64]

LAGS: Final = 10
"""Largest lag of the autocorrelation, rows."""

_PER_OUTPUT: Final = LAGS + 2  # products at lags 0 to LAGS, and the number of innovations


def sums_length(outputs: int) -> int:
    """Length of ``sums``: NIS and readings of the short window, each output's of the long one."""
    return 2 + outputs * _PER_OUTPUT


class ConsistencyLimits(NamedTuple):
    """Onset and end of each of three flags; between the two a flag keeps its value.

    Parameters
    ----------
    nis_bands : (3, M) array
        By the number of readings in the window: the band of the mean NIS, below whose upper limit
        the flag ends, and the limit above which it is raised.
    box_pierce_onset, box_pierce_end : float
        Limits of the Box–Pierce statistic.
    noise_onset, noise_end : float
        Limits of the noise factor; infinite where the noise was not declared.
    """

    nis_bands: Array
    box_pierce_onset: float
    box_pierce_end: float
    noise_onset: float
    noise_end: float


_FEWEST: Final = 2 * LAGS  # innovations in a window, of which an autocorrelation can be told
_SMALLEST_POWER: Final = 1e-10  # below the sum of squares of any innovations that are not all zero


@njit(**OPTIONS)
def update_sums(
    rows: Array,
    first: int,
    nis_window: int,
    whiteness_window: int,
    since: int,
    sums: Array,
    products: Array,
    nis: Array,
    box_pierce: Array,
) -> int:
    """Slide both windows over rows, one at a time, so that the size of chunks has no effect.

    Each row adds what enters a window and subtracts what leaves it.  Once per long window all sums
    are recomputed, so that neither rounding errors nor an overflow persist.

    Parameters
    ----------
    rows : (M, 2 + ny) array
        NIS and number of readings of each row, then the normalised innovation of each output, zero
        where there is none.
    first : int
        First row to process, at least ``whiteness_window + LAGS``.
    nis_window, whiteness_window : int
        Lengths of the windows, rows.
    since : int
        Rows since the sums were last recomputed.
    sums : (sums_length,) array
        Window sums after the row before; changed in place.
    products : (ny, LAGS + 1) array
        Lagged products of each output over all rows so far; added to in place.
    nis : (M − first, 2) array
        Filled with the sums of the first two columns over the short window.
    box_pierce : (M − first,) array
        Filled with n Σ r_l² over the long window, summed over all outputs (Box & Pierce 1970).

    Returns
    -------
    int
        ``since``, for the next call.
    """
    for e in range(first, rows.shape[0]):
        since += 1
        if since >= whiteness_window:
            since = 0
            _recompute_sums(rows, e, nis_window, whiteness_window, sums)
        else:
            for c in range(2):
                sums[c] += rows[e, c] - rows[e - nis_window, c]
            for y in range(rows.shape[1] - 2):
                at = 2 + y * _PER_OUTPUT
                new, old = rows[e, 2 + y], rows[e - whiteness_window, 2 + y]
                for lag in range(LAGS + 1):
                    sums[at + lag] += (
                        new * rows[e - lag, 2 + y] - old * rows[e - whiteness_window - lag, 2 + y]
                    )
                sums[at + LAGS + 1] += (1.0 if new != 0.0 else 0.0) - (1.0 if old != 0.0 else 0.0)
        k = e - first
        nis[k, 0], nis[k, 1] = sums[0], sums[1]
        box_pierce[k] = 0.0
        for y in range(rows.shape[1] - 2):
            at = 2 + y * _PER_OUTPUT
            for lag in range(LAGS + 1):
                products[y, lag] += rows[e, 2 + y] * rows[e - lag, 2 + y]
            power, count = sums[at], sums[at + LAGS + 1]
            if count > _FEWEST and power > _SMALLEST_POWER:
                squares = 0.0
                for lag in range(1, LAGS + 1):
                    squares += sums[at + lag] * sums[at + lag]
                box_pierce[k] += count * squares / (power * power)
    return since


@njit(**OPTIONS)
def _recompute_sums(
    rows: Array, end: int, nis_window: int, whiteness_window: int, sums: Array
) -> None:
    """Sum over the windows that end with row ``end``."""
    for k in range(len(sums)):
        sums[k] = 0.0
    for e in range(end - nis_window + 1, end + 1):
        sums[0] += rows[e, 0]
        sums[1] += rows[e, 1]
    for y in range(rows.shape[1] - 2):
        at = 2 + y * _PER_OUTPUT
        for e in range(end - whiteness_window + 1, end + 1):
            new = rows[e, 2 + y]
            for lag in range(LAGS + 1):
                sums[at + lag] += new * rows[e - lag, 2 + y]
            sums[at + LAGS + 1] += 1.0 if new != 0.0 else 0.0


@njit(**OPTIONS)
def flag_inconsistency(
    nis: Array,
    box_pierce: Array,
    noise_factor: Array,
    limits: ConsistencyLimits,
    flags: NDArray[np.bool_],
    mean: Array,
    low: Array,
    high: Array,
    consistent: NDArray[np.bool_],
) -> None:
    """Raise and lower three flags row by row, with hysteresis.

    Parameters
    ----------
    nis, box_pierce : (N, 2) and (N,) arrays
        As :func:`update_sums` fills them.
    noise_factor : (N, ny) array
        Factor on the declared noise variance, front and rear.
    limits : ConsistencyLimits
        Onset and end of each flag.
    flags : (3,) bool array
        Mean NIS, Box–Pierce statistic and noise factor out of limits, after the row before;
        changed in place.
    mean, low, high : (N,) arrays
        Filled with the mean NIS per reading and its 95 % band.
    consistent : (N,) bool array
        Filled: whether no flag is raised.
    """
    for k in range(nis.shape[0]):
        count = nis[k, 1]
        mean[k] = nis[k, 0] / count if count > 0.5 else 1.0
        n = int(count + 0.5)
        low[k], high[k] = limits.nis_bands[0, n], limits.nis_bands[1, n]
        # Errors that are smaller than stated are no fault of a moment: a filter that does not know
        # its parameters yet states large ones.
        if mean[k] > limits.nis_bands[2, n]:
            flags[0] = True
        elif mean[k] <= high[k]:
            flags[0] = False
        if box_pierce[k] > limits.box_pierce_onset:
            flags[1] = True
        elif box_pierce[k] < limits.box_pierce_end:
            flags[1] = False
        largest = 0.0
        for y in range(noise_factor.shape[1]):
            largest = max(largest, noise_factor[k, y])
        if largest > limits.noise_onset:
            flags[2] = True
        elif largest < limits.noise_end:
            flags[2] = False
        consistent[k] = not (flags[0] or flags[1] or flags[2])
