"""The history in display units."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.live.history import PARAMETER_POINTS, History
from bayes_asv.live.metadata import view_metadata
from bayes_asv.tracking.frames import empty_frames
from tests.live.synthetic import BAJA, frames, recording

METADATA = view_metadata(BAJA, "made-up.csv", None)
LBF, INCH = 4.4482216152605, 0.0254


def _append(history: History, seconds: float, cuts: list[int], rate: float = 200.0) -> None:
    run = recording(seconds, rate)
    for time, acc in zip(np.split(run.time, cuts), np.split(run.values.T, cuts), strict=True):
        history.append(frames(BAJA, time, acc))


@given(st.lists(st.integers(0, 600), max_size=6).map(sorted))
def test_chunk_size_has_no_effect(cuts: list[int]) -> None:
    whole, chunks = History(METADATA), History(METADATA)
    _append(whole, 3.0, [])
    _append(chunks, 3.0, cuts)
    for one, other in zip(whole.snapshot(), chunks.snapshot(), strict=True):
        np.testing.assert_array_equal(one, other)


def test_display_units_and_bands() -> None:
    history = History(METADATA)
    _append(history, 1.0, [])
    snapshot = history.snapshot()
    expected = frames(BAJA, recording(1.0, 200.0).time, recording(1.0, 200.0).values.T)
    column = {name: snapshot.traces[:, n] for n, name in enumerate(METADATA.traces)}
    # the 95 % quantile of a normal variable to six figures
    for axle, name in enumerate(("front", "rear")):
        np.testing.assert_allclose(
            column[f"{name} deflection high"] * INCH,
            expected.deflection[:, axle] + 1.959964 * expected.deflection_sd[:, axle],
            rtol=1e-5, atol=1e-7,
        )  # fmt: skip
        np.testing.assert_allclose(
            column[f"{name} predicted low"] * INCH,
            expected.predicted[:, axle] - 1.959964 * expected.predicted_sd[:, axle],
            rtol=1e-5, atol=1e-5,
        )  # fmt: skip
        np.testing.assert_allclose(
            column[f"{name} measured"] * INCH, expected.measured[:, axle], rtol=1e-6
        )
    np.testing.assert_allclose(
        snapshot.estimates[:, 0] * LBF / INCH, expected.median[:, 0], rtol=1e-6
    )
    np.testing.assert_allclose(
        snapshot.estimates[:, 2] * LBF * INCH, expected.median[:, 2], rtol=1e-6
    )
    np.testing.assert_allclose(snapshot.estimates[:, 3:6], expected.log_sd, rtol=1e-6)
    assert len(METADATA.band_sides) == len(METADATA.traces) == snapshot.traces.shape[1]


def test_extremes_so_far() -> None:
    history = History(METADATA)
    _append(history, 2.0, [7, 8, 150])
    snapshot = history.snapshot()
    for axle, name in enumerate(("front", "rear")):
        deflection = snapshot.traces[:, METADATA.traces.index(f"{name} deflection")]
        smallest = [deflection[: n + 1].min() for n in range(len(deflection))]
        largest = [deflection[: n + 1].max() for n in range(len(deflection))]
        np.testing.assert_array_equal(snapshot.extremes[:, 2 * axle], smallest)
        np.testing.assert_array_equal(snapshot.extremes[:, 2 * axle + 1], largest)


@pytest.mark.parametrize("size", [1, 37, 4000])
def test_parameters_are_decimated(size: int) -> None:
    history = History(METADATA)
    rows = 9000 if size > 1 else 2600
    _append(history, rows / 800.0, list(range(size, rows, size)), 800.0)
    snapshot = history.snapshot()
    assert PARAMETER_POINTS < len(snapshot.parameters) <= 2 * PARAMETER_POINTS
    assert snapshot.stride & (snapshot.stride - 1) == 0
    np.testing.assert_array_equal(snapshot.parameters[:, 0], snapshot.time[:: snapshot.stride])
    np.testing.assert_allclose(
        snapshot.parameters[:, 1:], snapshot.estimates[:: snapshot.stride, :6], rtol=1e-6
    )


def test_old_rows_are_dropped() -> None:
    history, whole = History(METADATA, keep=500), History(METADATA)
    cuts = list(range(90, 4000, 90))
    _append(history, 5.0, cuts, 800.0)
    _append(whole, 5.0, cuts, 800.0)
    kept, everything = history.snapshot(), whole.snapshot()
    assert 500 <= len(kept.time) <= 1000
    assert kept.first + len(kept.time) == len(everything.time) == 4000
    np.testing.assert_array_equal(kept.time, everything.time[kept.first :])
    np.testing.assert_array_equal(kept.traces, everything.traces[kept.first :])
    np.testing.assert_array_equal(kept.extremes, everything.extremes[kept.first :])
    np.testing.assert_array_equal(
        kept.parameters, everything.parameters
    )  # parameters are kept since the start


def test_snapshots_do_not_change() -> None:
    history = History(METADATA, keep=100)
    snapshots = []
    for n in range(40):
        time = n + np.arange(50) / 50.0
        history.append(frames(BAJA, time, np.full((50, 4), float(n))))
        snapshot = history.snapshot()
        snapshots.append((snapshot, [np.array(part) for part in snapshot[1:6]]))
    for snapshot, copies in snapshots:
        for part, copy in zip(snapshot[1:6], copies, strict=True):
            np.testing.assert_array_equal(part, copy)


def test_empty_frames_change_nothing() -> None:
    history = History(METADATA)
    history.append(empty_frames())
    assert len(history.snapshot().time) == 0
