"""Curves as text: a character holds two by four dots (Braille patterns of Unicode)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["gauge", "plot", "round_limits"]

_DOTS: Final = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
_EMPTY: Final = 0x2800


def plot(
    times: NDArray[np.floating],
    curves: Sequence[NDArray[np.floating]],
    span: tuple[float, float],
    limits: tuple[float, float],
    size: tuple[int, int],
) -> list[list[tuple[str, int]]]:
    """Draw curves on a grid of characters.

    Parameters
    ----------
    times : (n,) array
        Times of the curves' values.
    curves : sequence of (n,) arrays
        Later curves cover earlier ones; NaN leaves a gap.
    span, limits : (float, float)
        Times and values at the edges, both increasing.
    size : (int, int)
        Characters per line, and lines.

    Returns
    -------
    list of list of (str, int)
        Lines of runs of characters, each with the index of the curve it belongs to; -1 for none.
    """
    width, height = size
    dots = np.zeros((height, width), dtype=int)
    owner = np.full((height, width), -1)
    for index, values in enumerate(curves):
        top, bottom = _dot_rows(times, values, span, limits, 2 * width, 4 * height)
        for column in np.flatnonzero(top <= bottom):
            for row in range(int(top[column]), int(bottom[column]) + 1):
                if owner[row // 4, column // 2] != index:
                    dots[row // 4, column // 2] = 0
                    owner[row // 4, column // 2] = index
                dots[row // 4, column // 2] |= _DOTS[row % 4, column % 2]
    return [_runs(line, owners) for line, owners in zip(dots.tolist(), owner.tolist(), strict=True)]


def gauge(low: float, middle: float, high: float, mark: float, width: int) -> str:
    """Draw an interval on a scale from one half to one and a half times a mark.

    Parameters
    ----------
    low, middle, high : float
        The interval.
    mark : float
        Positive; it is in the middle of the scale.
    width : int
        Characters, odd.

    Returns
    -------
    str
        Such as ``├──●──┼─┤``; an arrow where the interval leaves the scale.
    """

    def column(value: float) -> int:
        position = (value / mark - 0.5) * (width - 1)
        return round(min(max(position, -1.0), float(width)))

    characters = [" "] * width
    characters[width // 2] = "┊"
    first, dot, last = column(low), min(max(column(middle), 0), width - 1), column(high)
    if dot in (first, last):  # narrower than can be drawn
        first = last = dot
    for n in range(max(first, 0), min(last, width - 1) + 1):
        characters[n] = "┼" if n == width // 2 else "─"
    for n, end, arrow in ((first, "├", "◂"), (last, "┤", "▸")):
        inside = min(max(n, 0), width - 1)
        characters[inside] = end if n == inside else arrow
    characters[dot] = "●"
    return "".join(characters)


def _dot_rows(
    times: NDArray[np.floating],
    values: NDArray[np.floating],
    span: tuple[float, float],
    limits: tuple[float, float],
    columns: int,
    rows: int,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Top and bottom row of dots in each column; top below bottom where there is none."""
    position = (times - span[0]) / (span[1] - span[0]) * columns
    valid = np.isfinite(values) & (position >= 0.0) & (position <= columns)
    column = np.minimum(position[valid].astype(int), columns - 1)
    share = (values[valid] - limits[0]) / (limits[1] - limits[0])
    row = np.clip(((1.0 - share) * rows).astype(int), 0, rows - 1)
    row[(share < 0.0) | (share > 1.0)] = -1
    column, row = column[row >= 0], row[row >= 0]
    top, bottom = np.full(columns, rows), np.full(columns, -1)
    np.minimum.at(top, column, row)
    np.maximum.at(bottom, column, row)
    return top, bottom


def _runs(line: list[int], owners: list[int]) -> list[tuple[str, int]]:
    runs: list[tuple[str, int]] = []
    for dots, owner in zip(line, owners, strict=True):
        character = chr(_EMPTY + dots) if dots else " "
        if runs and runs[-1][1] == owner:
            runs[-1] = (runs[-1][0] + character, owner)
        else:
            runs.append((character, owner))
    return runs


def round_limits(low: float, high: float) -> tuple[float, float]:
    """Round limits outwards with a margin, so that they change seldom."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return -1.0, 1.0
    span = high - low or abs(high) or 1.0
    step = 10.0 ** math.floor(math.log10(span)) / 2.0
    low, high = (low - 0.05 * span) / step, (high + 0.05 * span) / step
    return math.floor(low) * step, math.ceil(high) * step
