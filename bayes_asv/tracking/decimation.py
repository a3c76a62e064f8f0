"""Frames of a drive of any length in bounded room: every 2ⁿ-th row, and the last."""

from __future__ import annotations

from dataclasses import fields
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.tracking.frames import Frames, joined

__all__ = ["MOST", "DecimatedFrames"]

MOST: Final = 8192
"""Rows that are kept at most; a figure shows 1500 of them."""


class DecimatedFrames:
    """Takes frames, and keeps the last row of every `stride`.

    A kept row says of its stride that the filter was consistent only if it was at every row, and
    how far noise was widened at most.  Everything else is as it was at that row.  The stride
    doubles when there would be more than `most` rows; how rows were cut into chunks makes no
    difference.

    Parameters
    ----------
    most : int
        Rows to keep, two at least.
    """

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        self._stride = 1
        self._rows = 0  # that came
        self._held = 0  # in the parts
        self._parts: list[Frames] = []
        self._numbers: list[NDArray[np.int64]] = []  # of the row that each kept one stands for

    def append(self, frames: Frames) -> None:
        """Take the frames that follow."""
        if not len(frames):
            return
        numbers = np.arange(self._rows, self._rows + len(frames))
        self._rows += len(frames)
        if self._parts:  # the last stride may not be full
            last = self._parts.pop()
            number = self._numbers.pop()
            self._held -= len(last)
            frames, numbers = joined([last, frames]), np.concatenate([number, numbers])
        self._keep(frames, numbers)
        while self._held > self._most:
            self._stride *= 2
            frames, numbers = joined(self._parts), np.concatenate(self._numbers)
            self._parts, self._numbers, self._held = [], [], 0
            self._keep(frames, numbers)

    def frames(self) -> Frames:
        """Return what is kept."""
        return joined(self._parts)

    def _keep(self, frames: Frames, numbers: NDArray[np.int64]) -> None:
        """Keep one row of every stride; the last, to which more may come, as a part of its own."""
        frames, numbers = _strided(frames, numbers, self._stride)
        for part in (slice(0, -1), slice(-1, None)):
            if len(numbers[part]):
                self._parts.append(_rows(frames, part))
                self._numbers.append(numbers[part])
        self._held += len(numbers)


def _rows(frames: Frames, which: slice | NDArray[np.int64]) -> Frames:
    return Frames(**{f.name: getattr(frames, f.name)[which] for f in fields(Frames)})


def _strided(
    frames: Frames, numbers: NDArray[np.int64], stride: int
) -> tuple[Frames, NDArray[np.int64]]:
    """Take the last row of every stride, with what holds for all of it."""
    if stride == 1:
        return frames, numbers
    first = np.flatnonzero(np.diff(numbers // stride, prepend=-1))
    last = np.append(first[1:], len(numbers)) - 1
    columns = {f.name: getattr(frames, f.name)[last] for f in fields(Frames)}
    columns["consistent"] = np.logical_and.reduceat(frames.consistent, first)
    columns["inflation"] = np.maximum.reduceat(frames.inflation, first)
    return Frames(**columns), numbers[last]
