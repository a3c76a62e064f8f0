"""Merged blocks compared with the true sampling times."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.acquire.blocks import Block
from bayes_asv.acquire.frames import Frame
from bayes_asv.acquire.merge import MergedRun, format_ranges, merge_blocks
from bayes_asv.domain.recording import sample_times
from bayes_asv.domain.vehicle import read_vehicle
from bayes_asv.io import read_recording, write_recording
from bayes_asv.shipped import shipped
from tests.acquire.synthetic import SyntheticBlock, counts

DELAYS = (1110 / 4e6, 2774 / 4e6)
VEHICLE = read_vehicle(shipped("vehicles", "baja2008.toml"))


def block_of(made: SyntheticBlock, without: range | tuple[int, ...] = ()) -> Block:
    block = Block(made.board)
    for number, payload in enumerate(made.payloads):
        if number not in without:
            block.add(Frame(0, made.board, 0x40, number, payload))
    return block


def true_instants(
    made: SyntheticBlock, reference: float
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
def test_times_of_all_readings(
    rate: int, ppm: tuple[float, float], wait: float, leads: tuple[int, int]
) -> None:
    """After a long wait for a trigger simultaneous rows have different numbers."""
    front = SyntheticBlock(1, counts(1, 120), rate=rate, ppm=ppm[0], wait=wait, lead=leads[0])
    rear = SyntheticBlock(2, counts(2, 120), rate=rate, ppm=ppm[1], wait=wait, lead=sum(leads))
    made = merge_blocks(block_of(front), block_of(rear))
    assert made.recording is not None
    assert made.faults == ()
    assert made.drift == pytest.approx(1e-6 * (ppm[1] - ppm[0]), abs=4e-6)
    recording = made.recording
    got = sample_times(recording, VEHICLE) - recording.time[0]
    expected = np.concatenate([true_instants(front, ppm[0]), true_instants(rear, ppm[0])])
    values = np.concatenate([front.rows.T, rear.rows.T])
    # The number of missing rows before a board's row tells which one it is.
    placed = [np.flatnonzero(~np.isnan(recording.values[i])) for i in range(4)]
    first = min(expected[0, 0] - got[0, placed[0][0]], np.inf)
    tick = 8 / 4e6 if rate == 50 else 1 / 4e6
    # Marks are complete_blocks ticks, whose errors grow with the time between them.
    tolerance = 3 * tick + 1e-8
    for i in range(4):
        assert np.array_equal(recording.values[i, placed[i]], values[i])
        assert np.abs(got[i, placed[i]] + first - expected[i]).max() < tolerance
    # Simultaneous rows are within half a period.
    assert abs(made.offset or 0.0) <= 0.5 / rate + 1e-9


def complete_blocks() -> tuple[SyntheticBlock, SyntheticBlock]:
    return SyntheticBlock(1, counts(1)), SyntheticBlock(2, counts(2), ppm=40.0)


def test_missing_frames_are_missing_rows() -> None:
    front, rear = complete_blocks()
    made = merge_blocks(block_of(front, without=(3, 10)), block_of(rear, without=(10, 82)))
    recording = made.recording
    assert recording is not None
    message = " ".join(made.faults)
    assert "20 of 800 rows of the front board were not received: 1 to 10, 71 to 80" in message
    assert "20 of 800 rows of the rear board were not received: 71 to 80, 791 to 800" in message
    assert len(recording.time) == 790  # rows 71 to 80 came from neither
    assert np.isnan(recording.values[:2, :10]).all()
    assert np.isnan(recording.values[2:, -10:]).all()
    notes = [value for key, value in recording.metadata if key == "note"]
    assert set(made.faults) <= set(notes)


def test_missing_leading_rows_do_not_shift_the_clocks(tmp_path: object) -> None:
    front, rear = complete_blocks()
    lost = (3, 4, 5)
    gap = merge_blocks(block_of(front, without=lost), block_of(rear, without=lost)).recording
    full = merge_blocks(block_of(front), block_of(rear)).recording
    assert gap is not None
    assert full is not None
    assert gap.get("first row") == "31"
    times = sample_times(gap, VEHICLE) - gap.time[0] + 30 / 400
    assert np.abs(times - sample_times(full, VEHICLE)[:, 30:]).max() < 2e-9  # as written


def test_recording_can_be_read_back(tmp_path_factory: pytest.TempPathFactory) -> None:
    front, rear = complete_blocks()
    made = merge_blocks(block_of(front, without=(7,)), block_of(rear))
    assert made.recording is not None
    path = tmp_path_factory.mktemp("merged") / "r.csv"
    write_recording(made.recording, path)
    back = read_recording(path)
    assert np.array_equal(back.values, made.recording.values, equal_nan=True)
    assert np.array_equal(back.time, made.recording.time)
    assert back.metadata == made.recording.metadata
    assert back.warnings == ()


@pytest.mark.parametrize(
    ("front", "rear", "message"),
    [
        ({}, {"run": 2}, "not of one run"),
        ({}, {"rate": 800}, "not of one run"),
        ({"overruns": 3}, {}, "missed 3 rows"),
        ({}, {"elapsed": 0}, "end mark is missing"),
        ({}, {"elapsed": 9_000_000}, "implausible"),
    ],
)
def test_faults_of_the_blocks_are_reported(
    front: dict[str, Any], rear: dict[str, Any], message: str
) -> None:
    front_block, rear_block = SyntheticBlock(1, counts(1)), SyntheticBlock(2, counts(2))
    made = merge_blocks(
        block_of(replace(front_block, **front)), block_of(replace(rear_block, **rear))
    )
    assert any(message in fault for fault in made.faults), made.faults
    assert made.recording is not None


def test_without_times_the_boards_are_not_synchronised() -> None:
    front, rear = complete_blocks()
    made = merge_blocks(block_of(front), block_of(rear, without=(1,)))
    assert any("simultaneous start is assumed" in fault for fault in made.faults)
    assert made.drift is None
    assert made.offset is None


@pytest.mark.parametrize("missing", [1, 2])
def test_one_board_alone(missing: int) -> None:
    blocks = {made.board: block_of(made) for made in complete_blocks()}
    blocks[missing] = Block(missing)
    made = merge_blocks(blocks[1], blocks[2])
    assert made.recording is not None
    assert np.isnan(made.recording.values[2 * missing - 2 : 2 * missing]).all()
    assert any("nothing of the" in fault for fault in made.faults)


def test_no_frames_give_no_recording() -> None:
    made: MergedRun = merge_blocks(Block(1), Block(2))
    assert made.recording is None
    assert made.faults


def test_format_ranges() -> None:
    assert format_ranges([1, 2, 3, 7]) == "1 to 3, 7"
    assert format_ranges([]) == ""
    assert format_ranges(list(range(0, 60, 2))).endswith("and 18 more ranges")
