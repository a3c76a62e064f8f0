"""A stream gives what the file gives, wherever it is cut and whatever gets lost on the way."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording
from bayes_asv.io import read_recording, write_csv, write_logger
from bayes_asv.live.lines import RESTART_GAP, LineReader, Piece
from tests.live.made_up import recording

COUNTS = ("counts",) * 4


def _fed(reader: LineReader, data: bytes, cuts: list[int]) -> Piece:
    pieces = []
    for begin, end in zip([0, *cuts], [*cuts, len(data)], strict=True):
        pieces.append(reader.feed(data[begin:end]))
    pieces.append(reader.finish())
    return Piece(
        np.concatenate([p.time for p in pieces]), np.concatenate([p.values for p in pieces], axis=1)
    )


def _counts(rows: int, rate: float = 400.0, first: int = 1) -> Recording:
    rng = np.random.default_rng(5)
    values = rng.integers(0, 1024, (4, rows)).astype(float)
    time = (np.arange(rows) + first - 1) / rate
    return Recording(time, values, COUNTS, (("sample_rate", f"{rate:g} Hz"),), "counts.txt")


def _logger(tmp_path: Path, rows: int, first: int = 1) -> bytes:
    write_logger(_counts(rows, first=first), tmp_path / "counts.txt")
    return (tmp_path / "counts.txt").read_bytes()


@pytest.fixture(scope="module")
def texts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[bytes, Recording]]:
    """The same kind of recording as each format that can be streamed."""
    folder = tmp_path_factory.mktemp("texts")
    run = recording(0.4, 200.0, start=2.0)
    values = run.values.copy()
    values[1, 5:9] = np.nan
    holes = Recording(run.time, values, run.units, (("note", "a drive"),), "run.csv")
    write_csv(holes, folder / "comma.csv")
    text = (folder / "comma.csv").read_text()
    body = text.replace(".", "!").replace(",", ";").replace("!", ",")
    (folder / "semicolon.csv").write_text(body)
    (folder / "tab.csv").write_text(text.replace(",", "\t").replace("\n", "\r\n"))
    swapped = [
        ",".join([*line.split(",")[::-1], "7"]) if not line.startswith("#") else line
        for line in text.splitlines()
    ]
    swapped[1] = swapped[1][:-1] + "battery [V]"
    (folder / "swapped.csv").write_text("\n".join(swapped) + "\n")
    untimed = [
        line.split(",", 1)[1] if not line.startswith("#") else line for line in text.splitlines()
    ]
    (folder / "untimed.csv").write_text("# sample_rate = 200 Hz\n" + "\n".join(untimed))
    (folder / "milli.csv").write_text(
        text.replace("time [s]", "time [ms]").replace("[m/s^2]", "[g]")
    )
    (folder / "logger.txt").write_bytes(_logger(folder, 90))
    return {
        file.name: (file.read_bytes(), read_recording(file))
        for file in folder.iterdir()
        if file.name not in ("comma.txt", "counts.txt")
    }


NAMES = (
    "comma.csv", "semicolon.csv", "tab.csv", "swapped.csv", "untimed.csv", "milli.csv",
    "logger.txt",
)  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
@given(st.data())
def test_a_stream_gives_what_the_file_gives(
    texts: dict[str, tuple[bytes, Recording]], name: str, data: st.DataObject
) -> None:
    text, wanted = texts[name]
    cuts = data.draw(st.lists(st.integers(0, len(text)), max_size=8).map(sorted))
    reader = LineReader(name)
    got = _fed(reader, text, cuts)
    np.testing.assert_allclose(got.time, wanted.time, rtol=1e-13)
    np.testing.assert_array_equal(got.values, wanted.values)
    assert reader.units == wanted.units
    assert reader.unreadable == 0
    assert reader.rate == pytest.approx(400.0 if name == "logger.txt" else
                                        200e3 if name == "milli.csv" else 200.0)  # fmt: skip
    assert dict(wanted.metadata).items() <= dict(reader.metadata).items()


def test_what_the_port_spoils_is_left_out_and_counted(tmp_path: Path) -> None:
    lines = _logger(tmp_path, 200).decode().splitlines()
    whole = _counts(200)
    lines[30] = lines[30][:6]  # row 30
    lines[50] = lines[50].replace(" ", " x", 1)  # row 50
    lines[60] = "\ufffd\x00\x01"
    lines[90:93] = [lines[90][:-1] + lines[92]]  # an end of line lost, and a line: rows 90 to 92
    reader = LineReader("port")
    got = _fed(reader, ("\n".join(lines) + "\n").encode(), [77, 800])
    gone = {29, 49, 59, 89, 90, 91}
    kept = [row for row in range(200) if row not in gone]
    np.testing.assert_allclose(got.time, whole.time[kept], rtol=1e-13)
    np.testing.assert_array_equal(got.values, whole.values[:, kept])
    assert reader.unreadable == 4


def test_listening_begins_in_the_middle_of_a_line(tmp_path: Path) -> None:
    data = _logger(tmp_path, 100)
    body = data[data.index(b"\n1 ") + 1 :]
    reader = LineReader("port", rate=400.0)
    got = _fed(reader, body[5:], [])
    np.testing.assert_array_equal(got.values, _counts(100).values[:, 1:])
    assert reader.unreadable == 1


def test_a_board_may_say_something_before_its_header(
    texts: dict[str, tuple[bytes, Recording]],
) -> None:
    text, wanted = texts["comma.csv"]
    reader = LineReader("port")
    got = _fed(reader, b"\xff\x00boot v1.2, ok\nready\n" + text, [3])
    np.testing.assert_array_equal(got.values, wanted.values)
    assert reader.unreadable == 2


def test_a_logger_that_begins_again_goes_on_after_a_gap(tmp_path: Path) -> None:
    data = _logger(tmp_path, 60)
    rows = data[data.index(b"\n1 ") + 1 :]
    reader = LineReader("port")
    got = _fed(reader, data + rows + rows, [])
    once = _counts(60)
    assert reader.restarts == 2
    assert reader.unreadable == 0
    assert len(got.time) == 180
    for n in range(3):
        part = slice(60 * n, 60 * n + 60)
        begin = n * (once.time[-1] + RESTART_GAP)
        np.testing.assert_allclose(got.time[part], begin + once.time, rtol=1e-12)
        np.testing.assert_array_equal(got.values[:, part], once.values)


@pytest.mark.parametrize("strange", [b"999999", b"2", b"37"])
def test_one_wrong_stamp_moves_nothing(tmp_path: Path, strange: bytes) -> None:
    lines = _logger(tmp_path, 100).split(b"\n")
    lines[50] = strange + lines[50][lines[50].index(b" ") :]
    reader = LineReader("port")
    got = _fed(reader, b"\n".join(lines), [])
    kept = [row for row in range(100) if row != 49]
    np.testing.assert_allclose(got.time, _counts(100).time[kept], rtol=1e-13)
    assert (reader.unreadable, reader.restarts) == (1, 0)


def test_a_gap_of_the_radio_is_a_gap_in_time(tmp_path: Path) -> None:
    data = _logger(tmp_path, 20) + b"\n".join(_logger(tmp_path, 30, first=2021).split(b"\n")[1:])
    reader = LineReader("port")
    got = _fed(reader, data, [])
    assert len(got.time) == 50
    assert got.time[20] - got.time[19] == pytest.approx(2001 / 400.0)
    assert (reader.unreadable, reader.restarts) == (0, 0)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"1 500 500 500 500\n2 500 500 500 500\n", "give the rate"),
        (b"\x01\x02\x03\n" * 300, "sends no rows of a recording"),
        (b"time [s],front_wheel [g],rear_wheel [g],rear_chassis [g]\n" * 250, "front_chassis"),
        (b"time [s],front_wheel,front_chassis,rear_wheel,rear_chassis\n" * 250, "has no unit"),
        (b"0.1,1e0,2,3,4\n" * 250, "not the header"),
    ],
)
def test_what_can_never_be_a_recording_is_refused(data: bytes, words: str) -> None:
    with pytest.raises(InputError, match=words) as refusal:
        LineReader("COM3").feed(data)
    assert "COM3" in str(refusal.value)


@given(st.lists(st.binary(max_size=300), max_size=8))
def test_any_bytes_are_rows_or_a_refusal(pieces: list[bytes]) -> None:
    reader = LineReader("port", rate=400.0)
    rows = 0
    try:
        for piece in pieces:
            rows += len(reader.feed(piece).time)
        rows += len(reader.finish().time)
    except InputError:
        return
    assert rows + reader.unreadable <= sum(piece.count(b"\n") for piece in pieces) + 2


def test_a_line_without_end_is_not_kept_in_memory() -> None:
    reader = LineReader("port", rate=400.0)
    for _ in range(100):
        reader.feed(b"7" * 1000)
    assert reader.unreadable >= 9
    assert len(reader._bytes) <= 11_000
