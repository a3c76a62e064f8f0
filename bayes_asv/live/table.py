"""A table that grows, and whose readers keep what they took."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

__all__ = ["Table"]

_FIRST = 1024


class Table:
    """Rows that are appended at the end and perhaps dropped at the front.

    What `rows` has returned never changes afterwards: a row is written once, and where room is
    needed the rows move to an array of their own.  `rows` and what changes the table must not run
    at the same time; looking at what `rows` returned may.

    Parameters
    ----------
    columns : int
        Numbers in a row.
    dtype : data type
        Of every number.
    """

    def __init__(self, columns: int, dtype: DTypeLike = np.float64) -> None:
        self._data: NDArray[Any] = np.empty((_FIRST, columns), dtype)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def append(self, block: NDArray[Any]) -> None:
        """Add the rows of `block`, shape (n, columns)."""
        wanted = self._count + len(block)
        if wanted > len(self._data):
            self._move(self.rows(), 2 * wanted)
        self._data[self._count : wanted] = block
        self._count = wanted

    def rows(self) -> NDArray[Any]:
        """All rows, shape (n, columns); not to be written to."""
        return self._data[: self._count]

    def keep(self, rows: NDArray[Any]) -> None:
        """Hold `rows`, some of its own, and forget the others."""
        self._move(rows, max(2 * len(rows), _FIRST))

    def _move(self, rows: NDArray[Any], room: int) -> None:
        data = np.empty((room, self._data.shape[1]), self._data.dtype)
        data[: len(rows)] = rows
        self._data, self._count = data, len(rows)
