"""Curves as text: a sign of a terminal holds two by four dots (Unicode's Braille Patterns)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["gauge", "plotted", "round_limits"]

_DOTS: Final = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
_EMPTY: Final = 0x2800


def plotted(
    times: NDArray[np.floating],
    curves: Sequence[NDArray[np.floating]],
    span: tuple[float, float],
    limits: tuple[float, float],
    size: tuple[int, int],
) -> list[list[tuple[str, int]]]:
    """Draw curves on a grid of signs.

    Parameters
    ----------
    times : (n,) array
        Where the curves' values stand.
    curves : sequence of (n,) arrays
        The later one is on top; NaN leaves a hole.
    span, limits : (float, float)
        Times and values at the edges, both increasing.
    size : (int, int)
        Signs across and down.

    Returns
    -------
    list of list of (str, int)
        Lines of runs of signs, each with the place of the curve it belongs to; -1 for none.
    """
    across, down = size
    dots = np.zeros((down, across), dtype=int)
    owner = np.full((down, across), -1)
    for place, values in enumerate(curves):
        top, low = _reach(times, values, span, limits, 2 * across, 4 * down)
        for column in np.flatnonzero(top <= low):
            for row in range(int(top[column]), int(low[column]) + 1):
                if owner[row // 4, column // 2] != place:
                    dots[row // 4, column // 2] = 0
                    owner[row // 4, column // 2] = place
                dots[row // 4, column // 2] |= _DOTS[row % 4, column % 2]
    return [_runs(signs, whose) for signs, whose in zip(dots.tolist(), owner.tolist(), strict=True)]


def gauge(low: float, middle: float, high: float, mark: float, width: int) -> str:
    """Draw an interval on a scale from half to one and a half times a mark.

    Parameters
    ----------
    low, middle, high : float
        The interval.
    mark : float
        Positive; it stands in the middle of the scale.
    width : int
        Signs, odd.

    Returns
    -------
    str
        ``├──●──┼─┤`` and the like; an arrow where the interval leaves the scale.
    """

    def column(value: float) -> int:
        share = (value / mark - 0.5) * (width - 1)
        return round(min(max(share, -1.0), float(width)))

    signs = [" "] * width
    signs[width // 2] = "┊"
    first, dot, last = column(low), min(max(column(middle), 0), width - 1), column(high)
    if dot in (first, last):  # narrower than can be drawn
        first = last = dot
    for place in range(max(first, 0), min(last, width - 1) + 1):
        signs[place] = "┼" if place == width // 2 else "─"
    for place, sign, arrow in ((first, "├", "◂"), (last, "┤", "▸")):
        inside = min(max(place, 0), width - 1)
        signs[inside] = sign if place == inside else arrow
    signs[dot] = "●"
    return "".join(signs)


def _reach(
    times: NDArray[np.floating],
    values: NDArray[np.floating],
    span: tuple[float, float],
    limits: tuple[float, float],
    columns: int,
    rows: int,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Highest and lowest row of dots in each column; the highest below the lowest where none."""
    place = (times - span[0]) / (span[1] - span[0]) * columns
    good = np.isfinite(values) & (place >= 0.0) & (place <= columns)
    column = np.minimum(place[good].astype(int), columns - 1)
    share = (values[good] - limits[0]) / (limits[1] - limits[0])
    row = np.clip(((1.0 - share) * rows).astype(int), 0, rows - 1)
    row[(share < 0.0) | (share > 1.0)] = -1
    column, row = column[row >= 0], row[row >= 0]
    top, low = np.full(columns, rows), np.full(columns, -1)
    np.minimum.at(top, column, row)
    np.maximum.at(low, column, row)
    return top, low


def _runs(signs: list[int], whose: list[int]) -> list[tuple[str, int]]:
    runs: list[tuple[str, int]] = []
    for dots, owner in zip(signs, whose, strict=True):
        sign = chr(_EMPTY + dots) if dots else " "
        if runs and runs[-1][1] == owner:
            runs[-1] = (runs[-1][0] + sign, owner)
        else:
            runs.append((sign, owner))
    return runs


def round_limits(low: float, high: float) -> tuple[float, float]:
    """Round limits a little wider than what they hold, so that they stand still."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return -1.0, 1.0
    span = high - low or abs(high) or 1.0
    step = 10.0 ** math.floor(math.log10(span)) / 2.0
    low, high = (low - 0.05 * span) / step, (high + 0.05 * span) / step
    return math.floor(low) * step, math.ceil(high) * step
