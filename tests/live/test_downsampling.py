"""Downsampling keeps the extremes of every bucket, in their order."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.live.downsampling import bucket_rows, downsample, points_per_bucket

numbers = st.one_of(st.floats(-1e3, 1e3, width=32), st.just(math.nan))


@given(st.lists(numbers, min_size=1, max_size=60), st.integers(1, 9))
def test_buckets_keep_their_extremes_in_order(values: list[float], size: int) -> None:
    column = np.array(values)
    time = np.arange(len(column), dtype=float)
    stamps, points = downsample(time, column[:, None], size, (0,))
    assert (np.diff(stamps) > 0.0).all()
    if size <= 2:
        np.testing.assert_array_equal(points[:, 0], column)
        return
    for start in range(0, len(column), size):
        bucket = column[start : start + size]
        own = points[(stamps >= start) & (stamps < start + size), 0]
        assert len(own) == min(len(bucket), 2)
        numbers_in = bucket[np.isfinite(bucket)]
        if not len(numbers_in):
            assert np.isnan(own).all()
            continue
        assert set(own[np.isfinite(own)]) == {numbers_in.min(), numbers_in.max()}
        if len(own) == 2 and own[0] != own[1]:
            first, second = (np.flatnonzero(bucket == value) for value in own)
            assert first.min() < second.max()


@given(st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=50), st.integers(3, 7))
def test_band_edges_enclose_the_band(values: list[float], size: int) -> None:
    centre = np.array(values)
    table = np.column_stack((centre - 1.0, centre, centre + 1.0))
    _, points = downsample(np.arange(len(centre)) * 0.1, table, size, (-1, 0, 1))
    for k, start in enumerate(range(0, len(centre), size)):
        bucket = table[start : start + size]
        own = points[2 * k : 2 * k + 2]
        assert (own[:, 0] == bucket[:, 0].min()).all()
        assert (own[:, 2] == bucket[:, 2].max()).all()


@given(st.floats(1.0, 1e7), st.integers(2, 3000))
def test_number_of_points_of_a_window(rows: float, max_points: int) -> None:
    size = bucket_rows(rows, max_points)
    assert math.floor(rows / size) * points_per_bucket(size) <= max_points
    if size > 2:  # and not much less than could be shown
        assert rows / (size - 1) * 2.0 > max_points


def test_buckets_do_not_depend_on_their_number() -> None:
    rng = np.random.default_rng(1)
    time, table = np.arange(100) / 8.0, rng.normal(size=(100, 2))
    whole = downsample(time, table, 7, (0, 1))
    part = downsample(time[21:70], table[21:70], 7, (0, 1))
    for one, other in zip(whole, part, strict=True):
        np.testing.assert_array_equal(one[6:20], other)


@pytest.mark.parametrize("size", [1, 5])
def test_no_rows_give_no_points(size: int) -> None:
    stamps, points = downsample(np.empty(0), np.empty((0, 3)), size, (0, 0, 0))
    assert stamps.shape == (0,)
    assert points.shape == (0, 3)
