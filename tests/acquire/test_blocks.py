"""Frames held, missing and verified of a block."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.acquire.blocks import Block
from bayes_asv.acquire.frames import Frame
from tests.acquire.synthetic import SyntheticBlock, counts
from tests.firmware.frames import block_of


def frames_of(made: SyntheticBlock) -> list[Frame]:
    return [Frame(0, made.board, 0x40, k, payload) for k, payload in enumerate(made.payloads)]


def filled(made: SyntheticBlock, without: tuple[int, ...] = ()) -> Block:
    block = Block(made.board)
    for frame in frames_of(made):
        if frame.seq not in without:
            assert block.add(frame)
    return block


@given(st.integers(1, 130), st.integers(0, 2**31), st.randoms())
def test_frames_in_any_order_give_the_readings(rows: int, seed: int, random: object) -> None:
    made = SyntheticBlock(1, counts(1, rows, seed))
    frames = frames_of(made)
    random.shuffle(frames)  # type: ignore[attr-defined]
    block = Block(1)
    for frame in frames[:-1]:
        block.add(frame)
        assert not block.verified
    block.add(frames[-1])
    assert block.verified
    assert np.array_equal(block.readings(), made.rows)
    other = block_of(dict(enumerate(made.payloads)))
    assert np.array_equal(block.readings(), other.rows)
    assert block.elapsed() == other.elapsed()
    assert block.missing(16) == []


def test_missing_frames_within_a_mask() -> None:
    block = filled(SyntheticBlock(2, counts(2)), without=(4, 5, 40, 41, 82))
    assert block.missing(16) == [4, 5]  # 40 does not fit into 32 bits after 4
    assert not block.complete
    missing = np.flatnonzero(np.isnan(block.readings()).any(axis=1))
    assert missing.tolist() == [*range(10, 30), *range(370, 390), *range(790, 800)]


def test_block_with_a_wrong_crc_has_no_readings() -> None:
    made = SyntheticBlock(1, counts(1, 40))
    frames = frames_of(made)
    frames[4] = frames[4]._replace(payload=bytes(25))
    block = Block(1)
    for frame in frames:
        block.add(frame)
    assert block.complete
    assert not block.verified
    assert np.isnan(block.readings()).all()


def test_conflicting_frames_are_dropped_unless_verified() -> None:
    made = SyntheticBlock(1, counts(1, 40))
    block = filled(made, without=(6,))
    other = frames_of(made)[5]._replace(payload=bytes(25))
    assert block.add(other)
    assert block.conflicts == 1
    assert block.missing(16) == [5, 6]
    whole = filled(made)
    assert not whole.add(other)
    assert whole.verified


def test_another_head_starts_the_block_anew() -> None:
    block = filled(SyntheticBlock(1, counts(1, 40), run=1))
    again = SyntheticBlock(1, counts(1, 60, seed=9), run=2)
    for frame in frames_of(again):
        block.add(frame)
    assert block.verified
    assert np.array_equal(block.readings(), again.rows)


@pytest.mark.parametrize(
    ("number", "payload"),
    [
        (0, bytes(23)),  # of no board
        (0, b"\1\1\4" + bytes(20)),  # without rows
        (1, bytes(19)),
        (2, bytes(20)),
        (3, bytes(24)),
        (83, bytes(25)),
    ],
)
def test_invalid_frames_are_refused(number: int, payload: bytes) -> None:
    block = Block(1)
    assert not block.add(Frame(0, 1, 0x40, number, payload))
    assert block.received == 0


def test_end_mark_is_unwrapped() -> None:
    made = SyntheticBlock(1, counts(1, 20), rate=50, wait=9000.0)
    end = filled(made).elapsed()
    assert end is not None
    assert end == round((9000.0 + 20 / 50 + 0.05) * 5e5)
    assert end > 2**32
