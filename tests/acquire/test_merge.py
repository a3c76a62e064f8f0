"""Two blocks on one time line, against the times that were put in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.acquire.blocks import Block
from bayes_asv.acquire.frames import Frame
from bayes_asv.acquire.merge import Merged, merged, ranges
from bayes_asv.domain.recording import sample_times
from bayes_asv.domain.vehicle import read_vehicle
from bayes_asv.io import read_recording, write_recording
from bayes_asv.shipped import shipped
from tests.acquire.made import Made, counts

DELAYS = (1110 / 4e6, 2774 / 4e6)
VEHICLE = read_vehicle(shipped("vehicles", "baja2008.toml"))


def block_of(made: Made, without: range | tuple[int, ...] = ()) -> Block:
    block = Block(made.board)
    for number, payload in enumerate(made.payloads):
        if number not in without:
            block.take(Frame(0, made.board, 0x40, number, payload))
    return block


def true_instants(
    made: Made, reference: float
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Seconds of a clock that runs `reference` ppm fast, from the start mark, shape (2, rows)."""
    hertz = 4e6 * (1 + 1e-6 * made.ppm)
    prescale = 8 if made.rate == 50 else 1
    cycles = 4e6 / made.rate  # of the processor
    number = round(made.wait * made.rate) + np.arange(len(made.rows))
    start = made.lead * prescale + number * cycles
    seconds = np.array([start + delay * 4e6 for delay in DELAYS]) / hertz
    return seconds * (1 + 1e-6 * reference)


@given(
    rate=st.sampled_from([50, 100, 200, 400, 800]),
    ppm=st.tuples(st.floats(-100, 100), st.floats(-100, 100)),
    wait=st.floats(0, 3000),
    leads=st.tuples(st.integers(8_000, 60_000), st.integers(-3, 3)),
)
def test_every_reading_stands_at_its_instant(
    rate: int, ppm: tuple[float, float], wait: float, leads: tuple[int, int]
) -> None:
    """After a long wait for a trigger the rows beside each other have other numbers."""
    front = Made(1, counts(1, 120), rate=rate, ppm=ppm[0], wait=wait, lead=leads[0])
    rear = Made(2, counts(2, 120), rate=rate, ppm=ppm[1], wait=wait, lead=sum(leads))
    made = merged(block_of(front), block_of(rear))
    assert made.recording is not None
    assert made.faults == ()
    assert made.drift == pytest.approx(1e-6 * (ppm[1] - ppm[0]), abs=4e-6)
    recording = made.recording
    got = sample_times(recording, VEHICLE) - recording.time[0]
    expected = np.concatenate([true_instants(front, ppm[0]), true_instants(rear, ppm[0])])
    values = np.concatenate([front.rows.T, rear.rows.T])
    # Which row of a board stands where is known by how many are missing before it.
    placed = [np.flatnonzero(~np.isnan(recording.values[i])) for i in range(4)]
    first = min(expected[0, 0] - got[0, placed[0][0]], np.inf)
    tick = 8 / 4e6 if rate == 50 else 1 / 4e6
    # Marks are whole ticks; their errors grow with what lies between the marks.
    tolerance = 3 * tick + 1e-8
    for i in range(4):
        assert np.array_equal(recording.values[i, placed[i]], values[i])
        assert np.abs(got[i, placed[i]] + first - expected[i]).max() < tolerance
    # Rows beside each other lie within half a period.
    assert abs(made.offset or 0.0) <= 0.5 / rate + 1e-9


def whole() -> tuple[Made, Made]:
    return Made(1, counts(1)), Made(2, counts(2), ppm=40.0)


def test_missing_frames_become_missing_rows_and_are_told() -> None:
    front, rear = whole()
    made = merged(block_of(front, without=(3, 10)), block_of(rear, without=(10, 82)))
    recording = made.recording
    assert recording is not None
    words = " ".join(made.faults)
    assert "20 of 800 rows of the front board did not come: 1 to 10, 71 to 80" in words
    assert "20 of 800 rows of the rear board did not come: 71 to 80, 791 to 800" in words
    assert len(recording.time) == 790  # rows 71 to 80 came from neither
    assert np.isnan(recording.values[:2, :10]).all()
    assert np.isnan(recording.values[2:, -10:]).all()
    notes = [value for key, value in recording.metadata if key == "note"]
    assert set(made.faults) <= set(notes)


def test_leading_rows_that_came_from_neither_do_not_shift_the_clocks(tmp_path: object) -> None:
    front, rear = whole()
    lost = (3, 4, 5)
    gap = merged(block_of(front, without=lost), block_of(rear, without=lost)).recording
    full = merged(block_of(front), block_of(rear)).recording
    assert gap is not None
    assert full is not None
    assert gap.get("first row") == "31"
    late = sample_times(gap, VEHICLE) - gap.time[0] + 30 / 400
    assert np.abs(late - sample_times(full, VEHICLE)[:, 30:]).max() < 2e-9  # as written


def test_it_can_be_read_back(tmp_path_factory: pytest.TempPathFactory) -> None:
    front, rear = whole()
    made = merged(block_of(front, without=(7,)), block_of(rear))
    assert made.recording is not None
    path = tmp_path_factory.mktemp("merged") / "r.csv"
    write_recording(made.recording, path)
    back = read_recording(path)
    assert np.array_equal(back.values, made.recording.values, equal_nan=True)
    assert np.array_equal(back.time, made.recording.time)
    assert back.metadata == made.recording.metadata
    assert back.warnings == ()


@pytest.mark.parametrize(
    ("front", "rear", "words"),
    [
        ({}, {"run": 2}, "not of one run"),
        ({}, {"rate": 800}, "not of one run"),
        ({"overruns": 3}, {}, "missed 3 rows"),
        ({}, {"elapsed": 0}, "end mark is missing"),
        ({}, {"elapsed": 9_000_000}, "not believable"),
    ],
)
def test_doubts_are_told(front: dict[str, int], rear: dict[str, int], words: str) -> None:
    ours, theirs = Made(1, counts(1)), Made(2, counts(2))
    made = merged(block_of(replace(ours, **front)), block_of(replace(theirs, **rear)))  # type: ignore[arg-type]
    assert any(words in fault for fault in made.faults), made.faults
    assert made.recording is not None


def test_without_times_the_boards_are_not_synchronised_and_it_is_told() -> None:
    front, rear = whole()
    made = merged(block_of(front), block_of(rear, without=(1,)))
    assert any("began together is assumed" in fault for fault in made.faults)
    assert made.drift is None
    assert made.offset is None


@pytest.mark.parametrize("missing", [1, 2])
def test_one_board_alone_is_written_and_told(missing: int) -> None:
    blocks = {made.board: block_of(made) for made in whole()}
    blocks[missing] = Block(missing)
    made = merged(blocks[1], blocks[2])
    assert made.recording is not None
    assert np.isnan(made.recording.values[2 * missing - 2 : 2 * missing]).all()
    assert any("nothing of the" in fault for fault in made.faults)


def test_nothing_is_no_recording() -> None:
    made: Merged = merged(Block(1), Block(2))
    assert made.recording is None
    assert made.faults


def test_ranges_are_short() -> None:
    assert ranges([1, 2, 3, 7]) == "1 to 3, 7"
    assert ranges([]) == ""
    assert ranges(list(range(0, 60, 2))).endswith("and 18 more stretches")
