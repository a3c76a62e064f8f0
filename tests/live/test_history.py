"""The history in display units, whatever pieces it came in."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.live.history import RUN_POINTS, SIDES, TRACES, History
from bayes_asv.live.metadata import scene
from bayes_asv.tracking.frames import nothing
from tests.live.made_up import BAJA, frames, recording

SCENE = scene(BAJA, "made-up.csv", None)
LBF, INCH = 4.4482216152605, 0.0254


def _appended(history: History, seconds: float, cuts: list[int], rate: float = 200.0) -> None:
    run = recording(seconds, rate)
    for time, acc in zip(np.split(run.time, cuts), np.split(run.values.T, cuts), strict=True):
        history.append(frames(BAJA, time, acc))


@given(st.lists(st.integers(0, 600), max_size=6).map(sorted))
def test_pieces_make_no_difference(cuts: list[int]) -> None:
    whole, pieces = History(SCENE), History(SCENE)
    _appended(whole, 3.0, [])
    _appended(pieces, 3.0, cuts)
    for one, other in zip(whole.snapshot(), pieces.snapshot(), strict=True):
        np.testing.assert_array_equal(one, other)


def test_display_units_and_bands() -> None:
    history = History(SCENE)
    _appended(history, 1.0, [])
    snapshot = history.snapshot()
    said = frames(BAJA, recording(1.0, 200.0).time, recording(1.0, 200.0).values.T)
    column = {name: snapshot.traces[:, n] for n, name in enumerate(TRACES)}
    # 95 % of a normal variable, from a table to six figures.
    for axle, name in enumerate(("front", "rear")):
        np.testing.assert_allclose(
            column[f"{name} deflection high"] * INCH,
            said.deflection[:, axle] + 1.959964 * said.deflection_sd[:, axle],
            rtol=1e-5, atol=1e-7,
        )  # fmt: skip
        np.testing.assert_allclose(
            column[f"{name} predicted low"] * INCH,
            said.predicted[:, axle] - 1.959964 * said.predicted_sd[:, axle],
            rtol=1e-5, atol=1e-5,
        )  # fmt: skip
        np.testing.assert_allclose(
            column[f"{name} measured"] * INCH, said.measured[:, axle], rtol=1e-6
        )
    np.testing.assert_allclose(snapshot.known[:, 0] * LBF / INCH, said.median[:, 0], rtol=1e-6)
    np.testing.assert_allclose(snapshot.known[:, 2] * LBF * INCH, said.median[:, 2], rtol=1e-6)
    np.testing.assert_allclose(snapshot.known[:, 3:6], said.log_sd, rtol=1e-6)
    assert len(SIDES) == len(TRACES) == snapshot.traces.shape[1]


def test_reach_is_the_extremes_so_far() -> None:
    history = History(SCENE)
    _appended(history, 2.0, [7, 8, 150])
    snapshot = history.snapshot()
    for axle, name in enumerate(("front", "rear")):
        deflection = snapshot.traces[:, TRACES.index(f"{name} deflection")]
        least = [deflection[: n + 1].min() for n in range(len(deflection))]
        most = [deflection[: n + 1].max() for n in range(len(deflection))]
        np.testing.assert_array_equal(snapshot.reach[:, 2 * axle], least)
        np.testing.assert_array_equal(snapshot.reach[:, 2 * axle + 1], most)


@pytest.mark.parametrize("size", [1, 37, 4000])
def test_the_run_is_every_nth_row_and_never_long(size: int) -> None:
    history = History(SCENE)
    rows = 9000 if size > 1 else 2600
    _appended(history, rows / 800.0, list(range(size, rows, size)), 800.0)
    snapshot = history.snapshot()
    assert RUN_POINTS < len(snapshot.run) <= 2 * RUN_POINTS
    assert snapshot.stride & (snapshot.stride - 1) == 0
    np.testing.assert_array_equal(snapshot.run[:, 0], snapshot.time[:: snapshot.stride])
    np.testing.assert_allclose(
        snapshot.run[:, 1:], snapshot.known[:: snapshot.stride, :6], rtol=1e-6
    )


def test_old_rows_go_and_their_number_is_told() -> None:
    history, whole = History(SCENE, keep=500), History(SCENE)
    cuts = list(range(90, 4000, 90))
    _appended(history, 5.0, cuts, 800.0)
    _appended(whole, 5.0, cuts, 800.0)
    kept, all_of_it = history.snapshot(), whole.snapshot()
    assert 500 <= len(kept.time) <= 1000
    assert kept.first + len(kept.time) == len(all_of_it.time) == 4000
    np.testing.assert_array_equal(kept.time, all_of_it.time[kept.first :])
    np.testing.assert_array_equal(kept.traces, all_of_it.traces[kept.first :])
    np.testing.assert_array_equal(kept.reach, all_of_it.reach[kept.first :])
    np.testing.assert_array_equal(kept.run, all_of_it.run)  # the run reaches back to the start


def test_what_was_taken_stays_as_it_was() -> None:
    history = History(SCENE, keep=100)
    taken = []
    for n in range(40):
        time = n + np.arange(50) / 50.0
        history.append(frames(BAJA, time, np.full((50, 4), float(n))))
        snapshot = history.snapshot()
        taken.append((snapshot, [np.array(part) for part in snapshot[1:6]]))
    for snapshot, copies in taken:
        for part, copy in zip(snapshot[1:6], copies, strict=True):
            np.testing.assert_array_equal(part, copy)


def test_frames_of_no_row_change_nothing() -> None:
    history = History(SCENE)
    history.append(nothing())
    assert len(history.snapshot().time) == 0
