"""Decimated frames against a direct selection of rows."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.tracking.frames import DecimatedFrames, Frames, empty_frames


def _frames(first: int, count: int, seed: int) -> Frames:
    """Rows whose every index is the index of the row."""
    index = np.arange(first, first + count, dtype=float)
    rng = np.random.default_rng([seed, first, count])
    columns = {
        f.name: np.repeat(index[:, None], width, axis=1) if (width := _width(f.name)) else index
        for f in fields(Frames)
    }
    columns["inflation"] = rng.uniform(1.0, 3.0, size=count)
    consistent = rng.uniform(size=count) > 0.05
    return replace(Frames(**columns), consistent=consistent)  # type: ignore[arg-type]


def _width(name: str) -> int:
    shape = getattr(empty_frames(), name).shape
    return int(shape[1]) if len(shape) == 2 else 0


@given(
    sizes=st.lists(st.integers(0, 90), min_size=1, max_size=40),
    max_rows=st.integers(2, 60),
    seed=st.integers(0, 100),
)
def test_every_stride_is_represented_by_its_last_row(
    sizes: list[int], max_rows: int, seed: int
) -> None:
    decimated = DecimatedFrames(max_rows)
    parts, first = [], 0
    for size in sizes:
        parts.append(_frames(first, size, seed))
        decimated.append(parts[-1])
        first += size
    kept = decimated.frames()
    total = sum(sizes)
    stride = 1
    while -(-total // stride) > max_rows:
        stride *= 2
    wanted = np.unique(np.append(np.arange(stride - 1, total, stride), max(total - 1, 0)))[:total]
    assert len(kept) == len(wanted) <= max_rows
    np.testing.assert_array_equal(kept.time, wanted)
    np.testing.assert_array_equal(kept.median[:, 2], wanted)
    consistent = np.concatenate([p.consistent for p in parts])
    inflation = np.concatenate([p.inflation for p in parts])
    for k, index in enumerate(wanted):
        own = slice(index // stride * stride, index + 1)
        assert kept.consistent[k] == consistent[own].all()
        assert kept.inflation[k] == inflation[own].max()
