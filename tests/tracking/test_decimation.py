"""Frames kept in bounded room, against a plain selection of rows."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.tracking.decimation import DecimatedFrames
from bayes_asv.tracking.frames import Frames, nothing


def _frames(first: int, count: int, seed: int) -> Frames:
    """Rows whose every number tells which row it is."""
    number = np.arange(first, first + count, dtype=float)
    rng = np.random.default_rng([seed, first, count])
    columns = {
        f.name: np.repeat(number[:, None], width, axis=1) if (width := _width(f.name)) else number
        for f in fields(Frames)
    }
    columns["inflation"] = rng.uniform(1.0, 3.0, size=count)
    well = rng.uniform(size=count) > 0.05
    return replace(Frames(**columns), consistent=well)  # type: ignore[arg-type]


def _width(name: str) -> int:
    shape = getattr(nothing(), name).shape
    return int(shape[1]) if len(shape) == 2 else 0


@given(
    sizes=st.lists(st.integers(0, 90), min_size=1, max_size=40),
    most=st.integers(2, 60),
    seed=st.integers(0, 100),
)
def test_every_stride_is_told_by_its_last_row(sizes: list[int], most: int, seed: int) -> None:
    thinned = DecimatedFrames(most)
    parts, first = [], 0
    for size in sizes:
        parts.append(_frames(first, size, seed))
        thinned.append(parts[-1])
        first += size
    kept = thinned.frames()
    total = sum(sizes)
    stride = 1
    while -(-total // stride) > most:
        stride *= 2
    wanted = np.unique(np.append(np.arange(stride - 1, total, stride), max(total - 1, 0)))[:total]
    assert len(kept) == len(wanted) <= most
    np.testing.assert_array_equal(kept.time, wanted)
    np.testing.assert_array_equal(kept.median[:, 2], wanted)
    well = np.concatenate([p.consistent for p in parts])
    widened = np.concatenate([p.inflation for p in parts])
    for k, number in enumerate(wanted):
        own = slice(number // stride * stride, number + 1)
        assert kept.consistent[k] == well[own].all()
        assert kept.inflation[k] == widened[own].max()
