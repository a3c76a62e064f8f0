"""Acquisitions from a fake logger, in virtual time, over lossy and corrupting lines."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayes_asv.acquire.acquisition import Outcome, acquire
from bayes_asv.acquire.messages import Settings
from bayes_asv.acquire.port import PortLostError
from bayes_asv.acquire.transfer import RunRequest
from bayes_asv.domain.errors import InputError
from tests.acquire.fake_logger import FakeLogger
from tests.acquire.synthetic import SyntheticBlock, counts, stream
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

FRONT, REAR = SyntheticBlock(1, counts(1)), SyntheticBlock(2, counts(2), ppm=20.0)
TRUTH = np.concatenate([FRONT.rows.T, REAR.rows.T])
GO = RunRequest(start=True)


def check_complete(outcome: Outcome) -> None:
    assert outcome.verdict == "ok", outcome.reasons
    assert outcome.recording is not None
    assert np.array_equal(outcome.recording.values, TRUTH)


def check_true(outcome: Outcome) -> None:
    """Check that all readings are true, and that missing ones are reported."""
    if outcome.verdict == "ok":
        check_complete(outcome)
        return
    assert outcome.reasons
    if outcome.recording is not None:
        recording = outcome.recording
        rows = np.round(recording.time * 400).astype(int) + int(recording.get("first row") or 1) - 1
        present = ~np.isnan(recording.values)
        assert np.array_equal(recording.values[present], TRUTH[:, rows][present])


def test_complete_run() -> None:
    logger = FakeLogger(FRONT, REAR)
    said: list[str] = []
    outcome = acquire(logger, GO, say=said.append)
    check_complete(outcome)
    assert logger.state == 0
    assert outcome.events[-1] == "Slave 1: all sent"
    assert any("the run is done" in text for text in said)
    assert outcome.retries == outcome.corrupted == 0


def test_settings_are_sent_before_the_run() -> None:
    logger = FakeLogger(FRONT, REAR)
    check_complete(acquire(logger, RunRequest(Settings(rate=400, synch=2, pre=100), start=True)))
    assert logger.settings == bytes([144, 1, 0, 2, 4, 100, 0, 20, 0])


def test_waiting_for_the_button() -> None:
    logger = FakeLogger(FRONT, REAR)
    outcome = acquire(logger, RunRequest(wait=20.0))
    assert outcome.reasons == ("no run was started within 20 s",)
    logger.state = WAITING
    check_complete(acquire(logger, RunRequest(wait=20.0)))
    assert START not in logger.received


@pytest.mark.parametrize(
    ("event", "message"),
    [
        ((4, 2, "Slave 2: saturated"), "read 0 or 1023 ten times"),
        ((6, 1, "Slave 1: no pulse"), "--synch radio"),
        ((5, 2, "Slave 2: no answer"), "does not answer by radio"),
        ((8, 1, "Slave 1: stopped"), "was stopped"),
    ],
)
def test_reason_of_an_aborted_run(event: tuple[int, int, str], message: str) -> None:
    outcome = acquire(FakeLogger(FRONT, REAR, aborts=event), GO)
    assert outcome.verdict == "refused"
    assert len(outcome.reasons) == 1
    assert message in outcome.reasons[0]


def test_held_run_is_fetched_or_discarded() -> None:
    logger = FakeLogger(FRONT, REAR, state=WAITING)
    said: list[str] = []
    check_complete(acquire(logger, GO, say=said.append))
    assert START not in logger.received
    assert any("--discard" in text for text in said)
    logger = FakeLogger(FRONT, REAR, state=WAITING)
    check_complete(acquire(logger, RunRequest(start=True, discard=True)))
    assert logger.received.index(STOP) < logger.received.index(START)


def test_other_rate_than_requested_is_reported() -> None:
    logger = FakeLogger(FRONT, REAR, state=WAITING)
    outcome = acquire(logger, RunRequest(Settings(rate=800), start=True))
    check_complete(outcome)
    assert outcome.warnings == ("800 Hz were requested, but the run was taken at 400 Hz",)


@pytest.mark.parametrize("start", [True, False])
def test_refused_settings_end_the_acquisition(start: bool) -> None:
    logger = FakeLogger(FRONT, REAR, refuses={CONFIG: 2})
    outcome = acquire(logger, RunRequest(Settings(rate=800, readings=32), start=start))
    assert outcome.verdict == "refused"
    assert "refuses these settings" in outcome.reasons[0]
    assert START not in logger.received


def test_refused_start_ends_the_acquisition() -> None:
    outcome = acquire(FakeLogger(FRONT, REAR, refuses={START: 5}), GO)
    assert outcome.reasons == ("the logger is in standby, but refuses to start (busy)",)


def test_second_session_requests_missing_frames_only() -> None:
    held = stream(FRONT) + b"".join(REAR.frames[:40])
    logger = FakeLogger(FRONT, REAR, state=SENDING_2)
    check_complete(acquire(logger, RunRequest(resumed=True), held=held))
    assert logger.received.count(GET) == 3  # 43 frames by 16
    # Blocks of an earlier run are of no use to this one.
    other = SyntheticBlock(1, counts(1, seed=8), run=7), SyntheticBlock(2, counts(2, seed=8), run=7)
    logger = FakeLogger(FRONT, REAR, state=SENDING_1)
    check_complete(acquire(logger, RunRequest(resumed=True), held=stream(*other)))


def test_complete_blocks_need_no_transfer() -> None:
    logger = FakeLogger(FRONT, REAR)
    check_complete(acquire(logger, RunRequest(resumed=True), held=stream(FRONT, REAR)))
    assert GET not in logger.received


def test_block_with_a_wrong_crc_is_fetched_again_and_then_refused() -> None:
    """A fault of the logger's memory: a wrong frame with a correct CRC-16."""
    wrong = SyntheticBlock(2, REAR.rows, ppm=20.0)
    payloads = wrong.payloads
    payloads[10] = bytes(25)

    class Broken(SyntheticBlock):
        @property
        def payloads(self) -> list[bytes]:
            return payloads

    logger = FakeLogger(FRONT, Broken(2, REAR.rows))
    outcome = acquire(logger, GO)
    assert outcome.verdict == "incomplete"
    assert outcome.recording is not None
    assert np.isnan(outcome.recording.values[2:]).all()
    assert any("CRC-32" in reason for reason in outcome.reasons)
    assert logger.received.count(DONE) == 1


def test_logger_that_stops_responding() -> None:
    logger = FakeLogger(FRONT, REAR)
    left = [60]

    def corrupt(data: bytes) -> bytes:
        left[0] -= 1
        return data if left[0] > 0 else b""

    logger.corrupt = corrupt
    outcome = acquire(logger, GO, patience=20.0)
    assert outcome.verdict == "incomplete"
    check_true(outcome)
    assert "for 20 s" in outcome.reasons[0]
    assert any("not received" in reason for reason in outcome.reasons)


@pytest.mark.parametrize(
    "fault",
    [
        KeyboardInterrupt(),
        PortLostError("the port went away"),
        InputError("r.raw", "cannot be written"),
    ],
)
def test_data_before_an_interruption_are_kept(fault: BaseException) -> None:
    logger = FakeLogger(FRONT, REAR)
    left = [60]

    def corrupt(data: bytes) -> bytes:
        left[0] -= 1
        if left[0] == 0:
            raise fault
        return data

    logger.corrupt = corrupt
    outcome = acquire(logger, GO)
    assert outcome.verdict == "incomplete"
    assert outcome.recording is not None
    check_true(outcome)


def test_no_logger_at_the_port() -> None:
    outcome = acquire(FakeLogger(FRONT, REAR, deaf=True), GO)
    assert outcome.verdict == "refused"
    assert outcome.reasons == (
        "no logger answers at this port; is it on, in range, and is this its port?",
    )


@settings(max_examples=20)
@given(seed=st.integers(0, 2**31), loss=st.floats(0, 0.3), flips=st.floats(0, 0.3))
def test_transfer_over_a_bad_line(seed: int, loss: float, flips: float) -> None:
    rng = np.random.default_rng(seed)

    def corrupt(data: bytes) -> bytes:
        if rng.random() < loss:
            return b""
        if rng.random() < flips:
            out = bytearray(data)
            out[rng.integers(len(out))] ^= int(rng.integers(1, 256))
            return bytes(out)
        return data

    outcome = acquire(FakeLogger(FRONT, REAR, corrupt), GO, seq=3)
    check_true(outcome)
    assert outcome.verdict == "ok"  # every second frame is enough


def text(rows: np.ndarray[tuple[int, int], np.dtype[np.int64]]) -> bytes:
    said = ["# sample_rate = 400.000 Hz", "# clock rear = 20.0 ppm"]
    said += [f"{k + 1} " + " ".join(map(str, row)) for k, row in enumerate(rows.T)]
    return "\r\n".join([*said, "# end", ""]).encode()


def test_text_dump_is_read_twice_and_the_run_discarded() -> None:
    logger = FakeLogger(FRONT, REAR, dump=text(TRUTH))
    outcome = acquire(logger, RunRequest(start=True, text=True))
    check_complete(outcome)
    assert outcome.warnings == ()
    assert STOP in logger.received
    short = FakeLogger(FRONT, REAR, dump=text(TRUTH[:, :700]))
    outcome = acquire(short, RunRequest(start=True, text=True))
    assert outcome.verdict == "incomplete"
    assert "701 to 800" in outcome.reasons[0]
    assert STOP not in short.received
