"""Messages of a viewer, put together as the page does, compared with the history."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.live.downsampling import bucket_rows, downsample
from bayes_asv.live.metadata import view_metadata
from bayes_asv.live.session import Session
from bayes_asv.live.viewer import POINTS, Viewer, metadata_message
from tests.live.synthetic import BAJA, CurveBuffer, FakeClock, frames, recording

METADATA = view_metadata(BAJA, "x", None)


def _session(seconds: float, rate: float) -> tuple[Session, FakeClock]:
    time = FakeClock()
    session = Session(view_metadata(BAJA, "x", seconds), rate, clock=time)
    run = recording(seconds, rate, start=3.0)
    session.history.append(frames(BAJA, run.time, run.values.T))
    session.finish()
    return session, time


def _as_array(columns: list[list[float | None]]) -> np.ndarray[Any, Any]:
    return np.array([[np.nan if v is None else v for v in column] for column in columns]).T


steps = st.lists(
    st.one_of(
        st.tuples(st.just("wait"), st.floats(0.01, 0.25)),
        st.tuples(st.just("seek"), st.floats(0.0, 6.0)),
        st.tuples(st.just("speed"), st.sampled_from([0.1, 1.0, 10.0, 100.0])),
        st.tuples(st.just("restart"), st.just(0.0)),
    ),
    min_size=1,
    max_size=25,
)


@given(steps, st.sampled_from([1.0, 2.5, 120.0]), st.sampled_from([400.0, 900.0]))
def test_messages_add_up_to_the_history(
    steps: list[tuple[str, float]], window: float, rate: float
) -> None:
    session, time = _session(6.0, rate)
    viewer, traces, run = Viewer(session, window), CurveBuffer(), CurveBuffer()
    for action, value in [("wait", 0.0), *steps]:
        if action == "wait":
            time.now += value
        else:
            session.control(action, value)
        message = viewer.message()
        if message is None:
            continue
        traces.take(message["traces"])
        run.take(message["run"])
        assert len(message["traces"]["time"]) <= 1.2 * POINTS
        # the history itself, downsampled in one go
        playback = session.playback()
        snapshot, rows = playback.snapshot, playback.rows
        size = bucket_rows(min(window, 6.0) * rate, POINTS)
        stamps, points = downsample(
            snapshot.time[:rows], snapshot.traces[:rows], size, METADATA.band_sides
        )
        np.testing.assert_allclose(traces.time, stamps[-len(traces.time) :], atol=1e-6)
        np.testing.assert_allclose(
            _as_array(traces.columns), points[-len(traces.time) :], rtol=1e-4, atol=1e-30
        )
        begin = max(stamps[-1] - min(window, 6.0), stamps[0])
        assert traces.time[0] <= begin + 0.05  # the window is complete
        now = snapshot.time[rows - 1]
        final = snapshot.parameters[snapshot.parameters[:, 0] < now]
        np.testing.assert_allclose(run.time, [*final[:, 0], now], atol=1e-6)
        np.testing.assert_allclose(_as_array(run.columns)[:-1, 0], final[:, 1], rtol=1e-4)
        np.testing.assert_allclose(
            _as_array(run.columns)[:-1, 5], final[:, 2] * np.exp(1.959964 * final[:, 5]), rtol=1e-4
        )


def test_no_message_without_news() -> None:
    session, time = _session(2.0, 100.0)
    viewer = Viewer(session, 10.0)
    assert viewer.message() is not None
    assert viewer.message() is None
    time.now += 0.1
    assert viewer.message() is not None
    session.control("pause")
    message = viewer.message()
    assert message is not None
    assert message["state"] == "paused"
    time.now += 0.1
    assert viewer.message() is None


def test_a_late_viewer_gets_one_window() -> None:
    session, time = _session(60.0, 800.0)
    viewer = Viewer(session, 2.0)
    viewer.message()
    session.control("seek", 50.0)
    message = viewer.message()
    assert message is not None
    assert message["traces"]["fresh"]
    assert len(message["traces"]["time"]) <= 1.2 * POINTS
    assert message["traces"]["time"][0] == pytest.approx(3.0 + 48.0, abs=0.3)
    time.now += 0.04
    small = viewer.message()
    assert small is not None
    assert not small["traces"]["fresh"]
    assert len(json.dumps(small)) < 6_000


@pytest.mark.parametrize("window", [20.0, 120.0])  # one point per row, and two per bucket
def test_gaps_are_not_drawn(window: float) -> None:
    time = FakeClock()
    session = Session(view_metadata(BAJA, "x", None), 100.0, clock=time)
    run = recording(4.0, 100.0)
    stamps = np.where(run.time < 2.0, run.time, run.time + 5.0)
    session.history.append(frames(BAJA, stamps, run.values.T))
    viewer, traces = Viewer(session, window), CurveBuffer()
    for position in (1.9, 1.99, 7.0, 7.01, 8.0):
        session.control("seek", position)
        message = viewer.message()
        assert message is not None
        traces.take(message["traces"])
    gaps = [n for n, value in enumerate(traces.columns[METADATA.traces.index("front measured")])
             if value is None]  # fmt: skip
    assert len(gaps) == 1
    assert 7.0 <= traces.time[gaps[0]] < 7.2
    assert traces.time[gaps[0] - 1] < 2.0


def test_messages_are_strict_json() -> None:
    time = FakeClock()
    session = Session(view_metadata(BAJA, "x", None), 100.0, clock=time)
    run = recording(1.0, 100.0)
    values = run.values.T.copy()
    values[20:50] = np.nan
    session.history.append(frames(BAJA, run.time, values))
    session.control("seek", 0.9)
    message = Viewer(session, 5.0).message()
    text = json.dumps(message, allow_nan=False)
    column = json.loads(text)["traces"]["columns"][METADATA.traces.index("front measured")]
    assert column[20:50] == [None] * 30
    assert None not in column[:20]


def test_metadata_message() -> None:
    message = metadata_message(view_metadata(BAJA, "/home/me/stops.csv", 2.5))
    assert json.loads(json.dumps(message)) == message
    assert message["source"] == "stops.csv"
    assert message["deflection"] == "in"
    assert message["parameters"][0]["nominal"] == pytest.approx(7.2)
    assert message["parameters"][2]["unit"] == "lbf·s²·in"
