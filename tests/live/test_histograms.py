"""Shares of the time by travel and speed, wherever the playback goes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.live.histograms import RunningHistograms, bins
from bayes_asv.live.history import Event, History, Snapshot
from bayes_asv.live.metadata import view_metadata
from tests.live.synthetic import BAJA, INCONSISTENT, frames, recording

METADATA = view_metadata(BAJA, "made-up.csv", None)
INCH = 0.0254


def _snapshot(seconds: float = 3.0, rate: float = 200.0) -> Snapshot:
    history = History(METADATA)
    run = recording(seconds, rate)
    history.append(frames(BAJA, run.time, run.values.T))
    return history.snapshot()


def test_shares_are_those_of_the_deflection_and_its_rate() -> None:
    snapshot, rows = _snapshot(), 500
    shares = RunningHistograms(METADATA).shares(0, snapshot.time, snapshot.traces, rows)
    true = frames(BAJA, snapshot.time[:rows], np.zeros((rows, 4))).deflection / INCH
    for e, own in enumerate(bins(METADATA)):
        travel, _ = np.histogram(true[:, e], own.travel)
        np.testing.assert_allclose(shares[e, 0], travel / rows, atol=2.0 / rows)
        speed, _ = np.histogram(np.diff(true[:, e]) / np.diff(snapshot.time[:rows]), own.speed)
        np.testing.assert_allclose(shares[e, 1], speed / (rows - 1), atol=4.0 / rows)
    assert np.sum(shares, axis=2) == pytest.approx(1.0)
    # 2 π 1.7 Hz times 50 mm: the fastest that the front moves
    fastest = np.flatnonzero(shares[0, 1])[-1]
    edges = bins(METADATA)[0].speed * INCH
    assert edges[fastest] < 2.0 * np.pi * 1.7 * 0.05 < edges[fastest + 1] + 0.01


@given(st.lists(st.integers(1, 600), min_size=1, max_size=8))
def test_the_way_to_a_position_has_no_effect(positions: list[int]) -> None:
    snapshot = _snapshot()
    running = RunningHistograms(METADATA)
    for row in positions:
        found = running.shares(0, snapshot.time, snapshot.traces, row)
        direct = RunningHistograms(METADATA).shares(0, snapshot.time, snapshot.traces, row)
        np.testing.assert_allclose(found, direct)


def test_rows_that_were_dropped_still_count_while_the_playback_goes_on() -> None:
    snapshot = _snapshot()
    running = RunningHistograms(METADATA)
    running.shares(0, snapshot.time, snapshot.traces, 300)
    later = running.shares(200, snapshot.time[200:], snapshot.traces[200:], 600)
    whole = RunningHistograms(METADATA).shares(0, snapshot.time, snapshot.traces, 600)
    np.testing.assert_allclose(later, whole)


def test_there_is_no_speed_across_a_gap() -> None:
    snapshot = _snapshot()
    rows = np.r_[0:100, 300:400]
    shares = RunningHistograms(METADATA).shares(
        0, snapshot.time[rows], snapshot.traces[rows], len(rows)
    )
    assert np.sum(shares, axis=2) == pytest.approx(1.0)
    edges = bins(METADATA)[0].speed
    still = np.searchsorted(edges, 0.0)
    assert shares[0, 1, still - 20 : still + 20].sum() == pytest.approx(1.0)


def test_a_stop_and_errors_that_change_are_events() -> None:
    low = replace(METADATA, limits=((-1.9, 1.9), (None, None)))  # of ±1.97 in
    run = recording(9.0, 200.0)
    found = []
    for cuts in ([], [7, 500, 1111]):
        history = History(low)
        for time, acc in zip(np.split(run.time, cuts), np.split(run.values.T, cuts), strict=True):
            history.append(frames(BAJA, time, acc))
        found.append(history.snapshot().events)
    assert found[0] == found[1]
    filter_, front = ([e for e in found[0] if e.place == p] for p in ("nis", "front"))
    assert [e.words for e in filter_] == ["errors not as expected", "errors as expected"]
    assert [e.time for e in filter_] == pytest.approx(INCONSISTENT, abs=0.006)
    # once a period of 1.7 Hz at either end
    periods = 1.7 * 9.0
    assert len([e for e in front if e.words == "bump limit"]) == pytest.approx(periods, abs=1)
    assert len([e for e in front if e.words == "droop limit"]) == pytest.approx(periods, abs=1)
    assert list(found[0]) == sorted(found[0], key=lambda e: e.time)
    assert isinstance(found[0][0], Event)
