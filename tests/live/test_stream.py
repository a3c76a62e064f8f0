"""A page that puts the messages together sees what the history holds, however it is asked."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.live.downsampling import bucket_rows, thinned
from bayes_asv.live.history import SIDES, TRACES
from bayes_asv.live.metadata import scene
from bayes_asv.live.session import Show
from bayes_asv.live.stream import POINTS, Viewer, scene_message
from tests.live.made_up import BAJA, Curves, Time, frames, recording


def _show(seconds: float, rate: float) -> tuple[Show, Time]:
    time = Time()
    show = Show(scene(BAJA, "x", seconds), rate, clock=time)
    run = recording(seconds, rate, start=3.0)
    show.history.append(frames(BAJA, run.time, run.values.T))
    show.finish()
    return show, time


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
def test_the_parts_make_the_whole(
    steps: list[tuple[str, float]], window: float, rate: float
) -> None:
    show, time = _show(6.0, rate)
    viewer, traces, run = Viewer(show, window), Curves(), Curves()
    for action, value in [("wait", 0.0), *steps]:
        if action == "wait":
            time.now += value
        else:
            show.ask(action, value)
        message = viewer.message()
        if message is None:
            continue
        traces.take(message["traces"])
        run.take(message["run"])
        assert len(message["traces"]["time"]) <= 1.2 * POINTS
        # Against the history itself, thinned in one go.
        moment = show.moment()
        snapshot, rows = moment.snapshot, moment.rows
        size = bucket_rows(min(window, 6.0) * rate, POINTS)
        stamps, points = thinned(snapshot.time[:rows], snapshot.traces[:rows], size, SIDES)
        np.testing.assert_allclose(traces.time, stamps[-len(traces.time) :], atol=1e-6)
        np.testing.assert_allclose(
            _as_array(traces.columns), points[-len(traces.time) :], rtol=1e-4, atol=1e-30
        )
        begin = max(stamps[-1] - min(window, 6.0), stamps[0])
        assert traces.time[0] <= begin + 0.05  # the window is full
        now = snapshot.time[rows - 1]
        thin = snapshot.run[snapshot.run[:, 0] < now]
        np.testing.assert_allclose(run.time, [*thin[:, 0], now], atol=1e-6)
        np.testing.assert_allclose(_as_array(run.columns)[:-1, 0], thin[:, 1], rtol=1e-4)
        np.testing.assert_allclose(
            _as_array(run.columns)[:-1, 5], thin[:, 2] * np.exp(1.959964 * thin[:, 5]), rtol=1e-4
        )


def test_nothing_new_is_not_said() -> None:
    show, time = _show(2.0, 100.0)
    viewer = Viewer(show, 10.0)
    assert viewer.message() is not None
    assert viewer.message() is None
    time.now += 0.1
    assert viewer.message() is not None
    show.ask("pause")
    message = viewer.message()
    assert message is not None
    assert message["state"] == "paused"
    time.now += 0.1
    assert viewer.message() is None


def test_a_viewer_that_was_away_is_told_a_window_and_no_more() -> None:
    show, time = _show(60.0, 800.0)
    viewer = Viewer(show, 2.0)
    viewer.message()
    show.ask("seek", 50.0)
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


@pytest.mark.parametrize("window", [20.0, 120.0])  # points are rows, and pairs of a bucket
def test_no_line_is_drawn_across_a_gap(window: float) -> None:
    time = Time()
    show = Show(scene(BAJA, "x", None), 100.0, clock=time)
    run = recording(4.0, 100.0)
    stamps = np.where(run.time < 2.0, run.time, run.time + 5.0)
    show.history.append(frames(BAJA, stamps, run.values.T))
    viewer, traces = Viewer(show, window), Curves()
    for moment in (1.9, 1.99, 7.0, 7.01, 8.0):
        show.ask("seek", moment)
        message = viewer.message()
        assert message is not None
        traces.take(message["traces"])
    holes = [n for n, value in enumerate(traces.columns[TRACES.index("front measured")])
             if value is None]  # fmt: skip
    assert len(holes) == 1
    assert 7.0 <= traces.time[holes[0]] < 7.2
    assert traces.time[holes[0] - 1] < 2.0


def test_messages_are_strict_json_also_where_numbers_are_missing() -> None:
    time = Time()
    show = Show(scene(BAJA, "x", None), 100.0, clock=time)
    run = recording(1.0, 100.0)
    values = run.values.T.copy()
    values[20:50] = np.nan
    show.history.append(frames(BAJA, run.time, values))
    show.ask("seek", 0.9)
    message = Viewer(show, 5.0).message()
    text = json.dumps(message, allow_nan=False)
    column = json.loads(text)["traces"]["columns"][TRACES.index("front measured")]
    assert column[20:50] == [None] * 30
    assert None not in column[:20]


def test_the_scene_says_what_the_axes_need() -> None:
    said = scene_message(scene(BAJA, "/home/me/stops.csv", 2.5))
    assert json.loads(json.dumps(said)) == said
    assert said["source"] == "stops.csv"
    assert said["deflection"] == "in"
    assert said["parameters"][0]["nominal"] == pytest.approx(7.2)
    assert said["parameters"][2]["unit"] == "lbf·s²·in"
