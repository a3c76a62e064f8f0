"""Downsampling for the screen: smallest and largest value of every bucket, in their order."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["bucket_rows", "downsample", "points_per_bucket"]


def bucket_rows(rows: float, max_points: int) -> int:
    """Rows per bucket, so that a window of `rows` rows gives about `max_points` points, not more.

    Parameters
    ----------
    rows : float
        Rows in the window.
    max_points : int
        Points, at least two.

    Returns
    -------
    int
        1: every row is a point; 2 or more: two points per bucket.
    """
    return 1 if rows <= max_points else max(2, math.ceil(2.0 * rows / max_points))


def points_per_bucket(size: int) -> int:
    """Points of a full bucket of `size` rows."""
    return min(size, 2)


def downsample(
    time: NDArray[np.floating], values: NDArray[np.floating], size: int, sides: Sequence[int]
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Reduce columns to the smallest and the largest value of each bucket of rows.

    A line through the points covers the same pixels as one through all rows as long as a bucket is
    no wider than a pixel.  The last bucket may be short.

    Parameters
    ----------
    time : (n,) array
        Stamps.
    values : (n, k) array
        Columns; NaN where a value is missing.
    size : int
        Rows per bucket, from 1.
    sides : sequence of k int
        0 for a curve, whose extremes keep their order in time; -1 for the lower edge of a band, of
        which both points are the smallest value; 1 for an upper edge.

    Returns
    -------
    stamps : (p,) array
        Stamps of the first row and of the middle row of each bucket, one for a short bucket of a
        single row; the rows' own where buckets hold one or two.
    points : (p, k) array
        The columns there; NaN where a bucket holds no value.
    """
    if size <= 2 or not len(time):
        return time, values
    buckets = len(time) // size
    end = buckets * size
    parts = [_extremes(values[:end].reshape(buckets, size, values.shape[1]), sides)]
    stamps = [np.stack((time[:end:size], time[size // 2 : end : size]), axis=1).ravel()]
    rest = len(time) - end
    if rest == 1:
        parts.append(values[end:])
        stamps.append(time[end:])
    elif rest:
        parts.append(_extremes(values[None, end:], sides))
        stamps.append(time[[end, min(end + size // 2, len(time) - 1)]])
    return np.concatenate(stamps), np.concatenate(parts)


def _extremes(buckets: NDArray[np.floating], sides: Sequence[int]) -> NDArray[np.floating]:
    """Two rows for each bucket, (b, size, k) to (2 b, k)."""
    missing = np.isnan(buckets)
    low = np.where(missing, np.inf, buckets)
    high = np.where(missing, -np.inf, buckets)
    rising = low.argmin(axis=1) <= high.argmax(axis=1)
    smallest, largest = low.min(axis=1), high.max(axis=1)
    empty = missing.all(axis=1)
    smallest[empty], largest[empty] = np.nan, np.nan
    side = np.asarray(sides)
    first = np.where((side < 0) | ((side == 0) & rising), smallest, largest)
    second = np.where((side < 0) | ((side == 0) & ~rising), smallest, largest)
    return np.stack((first, second), axis=1).reshape(-1, buckets.shape[2])
