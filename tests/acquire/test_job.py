"""The talk with a logger, in virtual time, over lines that lose, spoil and end."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayes_asv.acquire.job import acquire
from bayes_asv.acquire.messages import Settings
from bayes_asv.acquire.outcome import Outcome
from bayes_asv.acquire.port import GoneError
from bayes_asv.acquire.run import Request
from bayes_asv.domain.errors import InputError
from tests.acquire.fake import FakeLogger
from tests.acquire.made import Made, counts, stream
from tests.firmware.frames import (
    CONFIG,
    DONE,
    GET,
    SENDING_1,
    SENDING_2,
    START,
    STOP,
    WAITING,
)

FRONT, REAR = Made(1, counts(1)), Made(2, counts(2), ppm=20.0)
TRUTH = np.concatenate([FRONT.rows.T, REAR.rows.T])
GO = Request(start=True)


def check_whole(outcome: Outcome) -> None:
    assert outcome.verdict == "ok", outcome.reasons
    assert outcome.recording is not None
    assert np.array_equal(outcome.recording.values, TRUTH)


def check_true(outcome: Outcome) -> None:
    """Assert that what is given is true, and what is missing told."""
    if outcome.verdict == "ok":
        check_whole(outcome)
        return
    assert outcome.reasons
    if outcome.recording is not None:
        recording = outcome.recording
        rows = np.round(recording.time * 400).astype(int) + int(recording.get("first row") or 1) - 1
        here = ~np.isnan(recording.values)
        assert np.array_equal(recording.values[here], TRUTH[:, rows][here])


def test_a_run_comes_whole() -> None:
    logger = FakeLogger(FRONT, REAR)
    said: list[str] = []
    outcome = acquire(logger, GO, say=said.append)
    check_whole(outcome)
    assert logger.state == 0
    assert outcome.events[-1] == "Slave 1: all sent"
    assert any("the run is done" in text for text in said)
    assert outcome.repeats == outcome.spoilt == 0


def test_settings_go_to_the_logger_before_the_run() -> None:
    logger = FakeLogger(FRONT, REAR)
    check_whole(acquire(logger, Request(Settings(rate=400, synch=2, pre=100), start=True)))
    assert logger.settings == bytes([144, 1, 0, 2, 4, 100, 0, 20, 0])


def test_a_run_that_the_button_starts_is_waited_for() -> None:
    logger = FakeLogger(FRONT, REAR)
    outcome = acquire(logger, Request(wait=20.0))
    assert outcome.reasons == ("no run was started within 20 s",)
    logger.state = WAITING
    check_whole(acquire(logger, Request(wait=20.0)))
    assert START not in logger.got


@pytest.mark.parametrize(
    ("event", "words"),
    [
        ((4, 2, "Slave 2: saturated"), "read 0 or 1023 ten times"),
        ((6, 1, "Slave 1: no pulse"), "--synch radio"),
        ((5, 2, "Slave 2: no answer"), "does not answer by radio"),
        ((8, 1, "Slave 1: stopped"), "was stopped"),
    ],
)
def test_a_run_that_ends_early_says_why(event: tuple[int, int, str], words: str) -> None:
    outcome = acquire(FakeLogger(FRONT, REAR, aborts=event), GO)
    assert outcome.verdict == "refused"
    assert len(outcome.reasons) == 1
    assert words in outcome.reasons[0]


def test_a_run_held_already_is_fetched_or_given_up() -> None:
    logger = FakeLogger(FRONT, REAR, state=WAITING)
    said: list[str] = []
    check_whole(acquire(logger, GO, say=said.append))
    assert START not in logger.got
    assert any("--discard" in text for text in said)
    logger = FakeLogger(FRONT, REAR, state=WAITING)
    check_whole(acquire(logger, Request(start=True, discard=True)))
    assert logger.got.index(STOP) < logger.got.index(START)


def test_a_run_taken_otherwise_than_asked_for_is_told() -> None:
    logger = FakeLogger(FRONT, REAR, state=WAITING)
    outcome = acquire(logger, Request(Settings(rate=800), start=True))
    check_whole(outcome)
    assert outcome.warnings == ("800 Hz were asked for, but the run was taken at 400 Hz",)


@pytest.mark.parametrize("start", [True, False])
def test_settings_that_the_logger_refuses_end_it(start: bool) -> None:
    logger = FakeLogger(FRONT, REAR, refuses={CONFIG: 2})
    outcome = acquire(logger, Request(Settings(rate=800, readings=32), start=start))
    assert outcome.verdict == "refused"
    assert "refuses these settings" in outcome.reasons[0]
    assert START not in logger.got


def test_a_logger_that_refuses_to_start_is_not_asked_for_ever() -> None:
    outcome = acquire(FakeLogger(FRONT, REAR, refuses={START: 5}), GO)
    assert outcome.reasons == ("the logger stands by, but refuses to start (busy)",)


def test_only_what_is_missing_is_asked_for_in_a_second_session() -> None:
    held = stream(FRONT) + b"".join(REAR.frames[:40])
    logger = FakeLogger(FRONT, REAR, state=SENDING_2)
    check_whole(acquire(logger, Request(resumed=True), held=held))
    assert logger.got.count(GET) == 3  # 43 frames by 16
    # Blocks of an earlier run are of no use to this one.
    other = Made(1, counts(1, seed=8), run=7), Made(2, counts(2, seed=8), run=7)
    logger = FakeLogger(FRONT, REAR, state=SENDING_1)
    check_whole(acquire(logger, Request(resumed=True), held=stream(*other)))


def test_both_blocks_held_already_need_no_logger_that_holds_them() -> None:
    logger = FakeLogger(FRONT, REAR)
    check_whole(acquire(logger, Request(resumed=True), held=stream(FRONT, REAR)))
    assert GET not in logger.got


def test_a_block_whose_crc_differs_is_fetched_again_and_then_refused() -> None:
    """The logger's own memory is at fault: a frame is wrong and passes its CRC-16."""
    wrong = Made(2, REAR.rows, ppm=20.0)
    payloads = wrong.payloads
    payloads[10] = bytes(25)

    class Broken(Made):
        @property
        def payloads(self) -> list[bytes]:
            return payloads

    logger = FakeLogger(FRONT, Broken(2, REAR.rows))
    outcome = acquire(logger, GO)
    assert outcome.verdict == "incomplete"
    assert outcome.recording is not None
    assert np.isnan(outcome.recording.values[2:]).all()
    assert any("CRC-32" in reason for reason in outcome.reasons)
    assert logger.got.count(DONE) == 1


def test_a_logger_that_falls_silent_leaves_what_came() -> None:
    logger = FakeLogger(FRONT, REAR)
    left = [60]

    def spoil(data: bytes) -> bytes:
        left[0] -= 1
        return data if left[0] > 0 else b""

    logger.spoil = spoil
    outcome = acquire(logger, GO, patience=20.0)
    assert outcome.verdict == "incomplete"
    check_true(outcome)
    assert "for 20 s" in outcome.reasons[0]
    assert any("did not come" in reason for reason in outcome.reasons)


@pytest.mark.parametrize(
    "fault",
    [
        KeyboardInterrupt(),
        GoneError("the port went away"),
        InputError("r.raw", "cannot be written"),
    ],
)
def test_what_came_before_an_interruption_is_kept(fault: BaseException) -> None:
    logger = FakeLogger(FRONT, REAR)
    left = [60]

    def spoil(data: bytes) -> bytes:
        left[0] -= 1
        if left[0] == 0:
            raise fault
        return data

    logger.spoil = spoil
    outcome = acquire(logger, GO)
    assert outcome.verdict == "incomplete"
    assert outcome.recording is not None
    check_true(outcome)


def test_nobody_at_the_port() -> None:
    outcome = acquire(FakeLogger(FRONT, REAR, deaf=True), GO)
    assert outcome.verdict == "refused"
    assert outcome.reasons == (
        "no logger answers at this port; is it on, in range, and is this its port?",
    )


@settings(max_examples=20)
@given(seed=st.integers(0, 2**31), loss=st.floats(0, 0.3), flips=st.floats(0, 0.3))
def test_over_a_bad_line_everything_comes_or_is_told(seed: int, loss: float, flips: float) -> None:
    rng = np.random.default_rng(seed)

    def spoil(data: bytes) -> bytes:
        if rng.random() < loss:
            return b""
        if rng.random() < flips:
            out = bytearray(data)
            out[rng.integers(len(out))] ^= int(rng.integers(1, 256))
            return bytes(out)
        return data

    outcome = acquire(FakeLogger(FRONT, REAR, spoil), GO, seq=3)
    check_true(outcome)
    assert outcome.verdict == "ok"  # a line that carries every second frame is good enough


def text(rows: np.ndarray[tuple[int, int], np.dtype[np.int64]]) -> bytes:
    said = ["# sample_rate = 400.000 Hz", "# clock rear = 20.0 ppm"]
    said += [f"{k + 1} " + " ".join(map(str, row)) for k, row in enumerate(rows.T)]
    return "\r\n".join([*said, "# end", ""]).encode()


def test_the_text_form_is_taken_twice_and_the_run_then_given_up() -> None:
    logger = FakeLogger(FRONT, REAR, dump=text(TRUTH))
    outcome = acquire(logger, Request(start=True, text=True))
    check_whole(outcome)
    assert outcome.warnings == ()
    assert STOP in logger.got
    short = FakeLogger(FRONT, REAR, dump=text(TRUTH[:, :700]))
    outcome = acquire(short, Request(start=True, text=True))
    assert outcome.verdict == "incomplete"
    assert "701 to 800" in outcome.reasons[0]
    assert STOP not in short.got
