"""Corrupted and truncated raw streams: no traceback, and no wrong reading without notice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from bayes_asv.acquire.acquisition import Outcome, outcome_document, outcome_lines, replay_file
from tests.acquire.synthetic import SyntheticBlock, counts, event_bytes, stream

ROWS = 60
FRONT, REAR = SyntheticBlock(1, counts(1, ROWS)), SyntheticBlock(2, counts(2, ROWS), ppm=-35.0)
COMPLETE = event_bytes(3, 1, 5, "Slave 1: run done") + stream(FRONT, REAR)
TRUTH = np.concatenate([FRONT.rows.T, REAR.rows.T])

Change = tuple[int, int]


def text_dump() -> bytes:
    rows = [f"{k + 1} " + " ".join(map(str, TRUTH[:, k])) for k in range(ROWS)]
    delays = [f"# delay {end}_chassis = 0.000416000 s" for end in ("front", "rear")]
    lines = ["# sample_rate = 400.000 Hz", *delays, "# clock rear = -35.0 ppm", *rows, "# end", ""]
    return "\r\n".join(lines).encode()


def read(data: bytes, folder: Path) -> Outcome:
    path = folder / "r.raw"
    path.write_bytes(data or b"\0")
    return replay_file(path)


def check(outcome: Outcome, checked: bool = True) -> None:
    """Check that all readings are true and in the right row, and that gaps are reported."""
    assert outcome_document(outcome, "r.csv", "r.raw")["verdict"] == outcome.verdict
    assert outcome_lines(outcome, "r.csv", "r.raw")
    recording = outcome.recording
    if recording is None:
        assert outcome.verdict == "refused"
        assert outcome.reasons
        return
    first = int(recording.get("first row") or 1) - 1
    rows = np.round(recording.time * 400).astype(int) + first
    given_cells = ~np.isnan(recording.values)
    if checked:
        assert np.array_equal(recording.values[given_cells], TRUTH[:, rows][given_cells])
    if given_cells.sum() < 4 * ROWS:
        assert outcome.verdict == "incomplete"
        assert any("not received" in r or "nothing of" in r or "missing" in r or "differs" in r
                   for r in outcome.reasons)  # fmt: skip


def corrupt(data: bytes, changes: list[Change]) -> bytes:
    out = bytearray(data)
    for place, flip in changes:
        out[place % len(out)] ^= flip
    return bytes(out)


CHANGES = st.lists(st.tuples(st.integers(0, 10_000), st.integers(1, 255)), max_size=12)


def test_complete_stream(tmp_path: Path) -> None:
    outcome = read(COMPLETE, tmp_path)
    check(outcome)
    assert outcome.verdict == "ok"
    assert outcome.reasons == ()
    assert outcome.drift == pytest.approx(-35e-6, abs=2e-6)


@settings(max_examples=150)
@given(CHANGES)
def test_corrupted_bytes(tmp_path_factory: pytest.TempPathFactory, changes: list[Change]) -> None:
    check(read(corrupt(COMPLETE, changes), tmp_path_factory.getbasetemp()))


@settings(max_examples=100)
@given(st.integers(0, 10_000), st.integers(0, 10_000))
def test_truncated_stream(tmp_path_factory: pytest.TempPathFactory, start: int, end: int) -> None:
    start, end = start % len(COMPLETE), end % len(COMPLETE)
    check(read(COMPLETE[min(start, end) : max(start, end)], tmp_path_factory.getbasetemp()))


@settings(max_examples=50)
@given(st.binary(min_size=1, max_size=2000))
def test_arbitrary_bytes(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    outcome = read(data, tmp_path_factory.getbasetemp())
    assert outcome.recording is None or outcome.verdict == "incomplete"


@given(CHANGES, CHANGES, CHANGES)
@settings(max_examples=60)
@example([(28, 32)], [], [(172, 1), (2631, 10)])
@example([(150, 1), (170, 32)], [], [(91, 46)])
def test_three_corrupted_dumps(
    tmp_path_factory: pytest.TempPathFactory,
    first: list[Change],
    second: list[Change],
    third: list[Change],
) -> None:
    """Two of three dumps outvote one; the same error in two dumps cannot be detected."""
    dump = text_dump()
    rows = [{place % len(dump) for place, _ in part} for part in (first, second, third)]
    assume(not (rows[0] & rows[1] or rows[1] & rows[2] or rows[0] & rows[2]))
    data = b"".join(corrupt(dump, part) for part in (first, second, third))
    check(read(data, tmp_path_factory.getbasetemp()))


@given(CHANGES)
def test_single_dump_is_reported_as_unchecked(
    tmp_path_factory: pytest.TempPathFactory, changes: list[Change]
) -> None:
    outcome = read(corrupt(text_dump(), changes), tmp_path_factory.getbasetemp())
    check(outcome, checked=False)
    if outcome.recording is not None:
        assert any("not checked" in w for w in outcome.warnings) or any(
            "twice with the same values" in r for r in outcome.reasons
        )


def test_two_runs_are_not_mixed(tmp_path: Path) -> None:
    older = (
        SyntheticBlock(1, counts(1, ROWS, seed=5), run=9),
        SyntheticBlock(2, counts(2, ROWS, seed=5), run=9),
    )
    data = stream(older[0]) + b"".join(older[1].frames[:5]) + COMPLETE
    outcome = read(data, tmp_path)
    check(outcome)
    assert outcome.verdict == "ok"
