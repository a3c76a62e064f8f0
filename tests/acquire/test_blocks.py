"""Blocks: what is held, what is missing, what is verified."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.acquire.blocks import Block
from bayes_asv.acquire.frames import Frame
from tests.acquire.made import Made, counts
from tests.firmware.frames import block_of


def frames_of(made: Made) -> list[Frame]:
    return [Frame(0, made.board, 0x40, k, payload) for k, payload in enumerate(made.payloads)]


def filled(made: Made, without: tuple[int, ...] = ()) -> Block:
    block = Block(made.board)
    for frame in frames_of(made):
        if frame.seq not in without:
            assert block.take(frame)
    return block


@given(st.integers(1, 130), st.integers(0, 2**31), st.randoms())
def test_frames_in_any_order_give_the_readings(rows: int, seed: int, random: object) -> None:
    made = Made(1, counts(1, rows, seed))
    frames = frames_of(made)
    random.shuffle(frames)  # type: ignore[attr-defined]
    block = Block(1)
    for frame in frames[:-1]:
        block.take(frame)
        assert not block.verified
    block.take(frames[-1])
    assert block.verified
    assert np.array_equal(block.readings(), made.rows)
    other = block_of(dict(enumerate(made.payloads)))
    assert np.array_equal(block.readings(), other.rows)
    assert block.elapsed() == other.elapsed()
    assert block.missing(16) == []


def test_what_is_missing_is_asked_for_within_a_mask() -> None:
    block = filled(Made(2, counts(2)), without=(4, 5, 40, 41, 82))
    assert block.missing(16) == [4, 5]  # 40 does not fit into 32 bits after 4
    assert not block.complete
    holes = np.flatnonzero(np.isnan(block.readings()).any(axis=1))
    assert holes.tolist() == [*range(10, 30), *range(370, 390), *range(790, 800)]


def test_a_block_that_fails_its_crc_gives_no_reading() -> None:
    made = Made(1, counts(1, 40))
    frames = frames_of(made)
    frames[4] = frames[4]._replace(payload=bytes(25))
    block = Block(1)
    for frame in frames:
        block.take(frame)
    assert block.complete
    assert not block.verified
    assert np.isnan(block.readings()).all()


def test_of_two_frames_that_differ_none_is_kept_before_the_block_is_verified() -> None:
    made = Made(1, counts(1, 40))
    block = filled(made, without=(6,))
    other = frames_of(made)[5]._replace(payload=bytes(25))
    assert block.take(other)
    assert block.disputed == 1
    assert block.missing(16) == [5, 6]
    whole = filled(made)
    assert not whole.take(other)
    assert whole.verified


def test_another_head_begins_the_block_anew() -> None:
    block = filled(Made(1, counts(1, 40), run=1))
    again = Made(1, counts(1, 60, seed=9), run=2)
    for frame in frames_of(again):
        block.take(frame)
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
def test_frames_without_sense_are_not_taken(number: int, payload: bytes) -> None:
    block = Block(1)
    assert not block.take(Frame(0, 1, 0x40, number, payload))
    assert block.come == 0


def test_an_end_mark_beyond_32_bits_is_unwrapped() -> None:
    made = Made(1, counts(1, 20), rate=50, wait=9000.0)
    end = filled(made).elapsed()
    assert end is not None
    assert end == round((9000.0 + 20 / 50 + 0.05) * 5e5)
    assert end > 2**32
