"""Fewer points that look like all of them: least and largest of every bucket, in their order."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["bucket_rows", "points_in", "thinned"]


def bucket_rows(rows: float, most: int) -> int:
    """Rows a bucket, so that a window of `rows` rows gives about `most` points, not more.

    Parameters
    ----------
    rows : float
        Rows in the window.
    most : int
        Points wanted, two at least.

    Returns
    -------
    int
        1: every row is a point; 2 or more: two points a bucket.
    """
    return 1 if rows <= most else max(2, math.ceil(2.0 * rows / most))


def points_in(size: int) -> int:
    """Points that a full bucket of `size` rows gives."""
    return min(size, 2)


def thinned(
    time: NDArray[np.floating], values: NDArray[np.floating], size: int, sides: Sequence[int]
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Thin columns to the least and the largest of each bucket of rows.

    A line through the points covers the same pixels as one through all rows as long as a bucket is
    no wider than a pixel.  The last bucket may be short.

    Parameters
    ----------
    time : (n,) array
        Stamps.
    values : (n, k) array
        Columns; NaN where there is none.
    size : int
        Rows a bucket, from 1.
    sides : sequence of k int
        0 for a curve, whose extremes come in the order in which they happened; -1 for the lower
        edge of a band, of which both points are the least; 1 for an upper edge.

    Returns
    -------
    stamps : (p,) array
        Stamps of the first row and of the middle row of each bucket, one for a short bucket of a
        single row; the rows' own where buckets hold one or two.
    points : (p, k) array
        The columns there; NaN where a bucket holds no number.
    """
    if size <= 2 or not len(time):
        return time, values
    full = len(time) // size
    whole = full * size
    parts = [_extremes(values[:whole].reshape(full, size, values.shape[1]), sides)]
    stamps = [np.stack((time[:whole:size], time[size // 2 : whole : size]), axis=1).ravel()]
    rest = len(time) - whole
    if rest == 1:
        parts.append(values[whole:])
        stamps.append(time[whole:])
    elif rest:
        parts.append(_extremes(values[None, whole:], sides))
        stamps.append(time[[whole, min(whole + size // 2, len(time) - 1)]])
    return np.concatenate(stamps), np.concatenate(parts)


def _extremes(buckets: NDArray[np.floating], sides: Sequence[int]) -> NDArray[np.floating]:
    """Two rows for each bucket, (b, size, k) to (2 b, k)."""
    missing = np.isnan(buckets)
    low = np.where(missing, np.inf, buckets)
    high = np.where(missing, -np.inf, buckets)
    # Where the least comes first stands the least; a bucket without a number gives NaN twice.
    rising = low.argmin(axis=1) <= high.argmax(axis=1)
    least, most = low.min(axis=1), high.max(axis=1)
    empty = missing.all(axis=1)
    least[empty], most[empty] = np.nan, np.nan
    side = np.asarray(sides)
    first = np.where(side < 0, least, np.where(side > 0, most, np.where(rising, least, most)))
    second = np.where(side < 0, least, np.where(side > 0, most, np.where(rising, most, least)))
    return np.stack((first, second), axis=1).reshape(-1, buckets.shape[2])
