"""Raw streams that were spoilt or cut: never a traceback, never a wrong reading untold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bayes_asv.acquire.job import replayed
from bayes_asv.acquire.outcome import Outcome, document, lines
from tests.acquire.made import Made, counts, stream, told

ROWS = 60
FRONT, REAR = Made(1, counts(1, ROWS)), Made(2, counts(2, ROWS), ppm=-35.0)
WHOLE = told(3, 1, 5, "Slave 1: run done") + stream(FRONT, REAR)
TRUTH = np.concatenate([FRONT.rows.T, REAR.rows.T])

Change = tuple[int, int]


def text_dump() -> bytes:
    rows = [f"{k + 1} " + " ".join(map(str, TRUTH[:, k])) for k in range(ROWS)]
    delays = [f"# delay {end}_chassis = 0.000416000 s" for end in ("front", "rear")]
    said = ["# sample_rate = 400.000 Hz", *delays, "# clock rear = -35.0 ppm", *rows, "# end", ""]
    return "\r\n".join(said).encode()


def read(data: bytes, folder: Path) -> Outcome:
    path = folder / "r.raw"
    path.write_bytes(data or b"\0")
    return replayed(path)


def check(outcome: Outcome, checked: bool = True) -> None:
    """Every reading given is a true one at its true place, and gaps are told."""
    assert document(outcome, "r.csv", "r.raw")["verdict"] == outcome.verdict
    assert lines(outcome, "r.csv", "r.raw")
    recording = outcome.recording
    if recording is None:
        assert outcome.verdict == "refused"
        assert outcome.reasons
        return
    first = int(recording.get("first row") or 1) - 1
    places = np.round(recording.time * 400).astype(int) + first
    given_cells = ~np.isnan(recording.values)
    if checked:
        assert np.array_equal(recording.values[given_cells], TRUTH[:, places][given_cells])
    if given_cells.sum() < 4 * ROWS:
        assert outcome.verdict == "incomplete"
        assert any("did not come" in r or "nothing of" in r or "missing" in r or "differs" in r
                   for r in outcome.reasons)  # fmt: skip


def spoilt(data: bytes, changes: list[Change]) -> bytes:
    out = bytearray(data)
    for place, flip in changes:
        out[place % len(out)] ^= flip
    return bytes(out)


CHANGES = st.lists(st.tuples(st.integers(0, 10_000), st.integers(1, 255)), max_size=12)


def test_the_whole_stream_is_whole(tmp_path: Path) -> None:
    outcome = read(WHOLE, tmp_path)
    check(outcome)
    assert outcome.verdict == "ok"
    assert outcome.reasons == ()
    assert outcome.drift == pytest.approx(-35e-6, abs=2e-6)


@settings(max_examples=150)
@given(CHANGES)
def test_spoilt_bytes(tmp_path_factory: pytest.TempPathFactory, changes: list[Change]) -> None:
    check(read(spoilt(WHOLE, changes), tmp_path_factory.getbasetemp()))


@settings(max_examples=100)
@given(st.integers(0, 10_000), st.integers(0, 10_000))
def test_a_stream_cut_at_either_end(
    tmp_path_factory: pytest.TempPathFactory, start: int, end: int
) -> None:
    start, end = start % len(WHOLE), end % len(WHOLE)
    check(read(WHOLE[min(start, end) : max(start, end)], tmp_path_factory.getbasetemp()))


@settings(max_examples=50)
@given(st.binary(min_size=1, max_size=2000))
def test_any_bytes(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    outcome = read(data, tmp_path_factory.getbasetemp())
    assert outcome.recording is None or outcome.verdict == "incomplete"


@given(CHANGES, CHANGES, CHANGES)
@settings(max_examples=60)
def test_spoilt_text_that_came_three_times(
    tmp_path_factory: pytest.TempPathFactory,
    first: list[Change],
    second: list[Change],
    third: list[Change],
) -> None:
    """Two of three outvote one; that two were spoilt at one place alike no vote can tell."""
    dump = text_dump()
    places = [{place % len(dump) for place, _ in part} for part in (first, second, third)]
    assume(not (places[0] & places[1] or places[1] & places[2] or places[0] & places[2]))
    data = b"".join(spoilt(dump, part) for part in (first, second, third))
    check(read(data, tmp_path_factory.getbasetemp()))


@given(CHANGES)
def test_spoilt_text_that_came_once_is_said_to_be_unchecked(
    tmp_path_factory: pytest.TempPathFactory, changes: list[Change]
) -> None:
    outcome = read(spoilt(text_dump(), changes), tmp_path_factory.getbasetemp())
    check(outcome, checked=False)
    if outcome.recording is not None:
        assert any("nothing checks" in w for w in outcome.warnings) or any(
            "twice alike" in r for r in outcome.reasons
        )


def test_a_second_run_in_the_stream_is_not_mixed_with_the_first(tmp_path: Path) -> None:
    older = Made(1, counts(1, ROWS, seed=5), run=9), Made(2, counts(2, ROWS, seed=5), run=9)
    data = stream(older[0]) + b"".join(older[1].frames[:5]) + WHOLE
    outcome = read(data, tmp_path)
    check(outcome)
    assert outcome.verdict == "ok"
