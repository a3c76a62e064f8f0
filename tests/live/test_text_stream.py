"""A stream gives the rows of the file, whatever the chunks and whatever gets lost."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording
from bayes_asv.io import read_recording, write_csv, write_logger
from bayes_asv.live.text_stream import RESTART_GAP, RowBlock, TextStreamReader
from tests.live.synthetic import recording

COUNTS = ("counts",) * 4


def _read(reader: TextStreamReader, data: bytes, cuts: list[int]) -> RowBlock:
    chunks = []
    for begin, end in zip([0, *cuts], [*cuts, len(data)], strict=True):
        chunks.append(reader.feed(data[begin:end]))
    chunks.append(reader.finish())
    return RowBlock(
        np.concatenate([p.time for p in chunks]), np.concatenate([p.values for p in chunks], axis=1)
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
    """A recording in each format that can be streamed."""
    folder = tmp_path_factory.mktemp("texts")
    run = recording(0.4, 200.0, start=2.0)
    values = run.values.copy()
    values[1, 5:9] = np.nan
    missing = Recording(run.time, values, run.units, (("note", "a drive"),), "run.csv")
    write_csv(missing, folder / "comma.csv")
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
def test_stream_equals_file(
    texts: dict[str, tuple[bytes, Recording]], name: str, data: st.DataObject
) -> None:
    text, expected = texts[name]
    cuts = data.draw(st.lists(st.integers(0, len(text)), max_size=8).map(sorted))
    reader = TextStreamReader(name)
    block = _read(reader, text, cuts)
    np.testing.assert_allclose(block.time, expected.time, rtol=1e-13)
    np.testing.assert_array_equal(block.values, expected.values)
    assert reader.units == expected.units
    assert reader.unreadable == 0
    assert reader.rate == pytest.approx(400.0 if name == "logger.txt" else
                                        200e3 if name == "milli.csv" else 200.0)  # fmt: skip
    assert dict(expected.metadata).items() <= dict(reader.metadata).items()


def test_damaged_lines_are_left_out_and_counted(tmp_path: Path) -> None:
    lines = _logger(tmp_path, 200).decode().splitlines()
    whole = _counts(200)
    lines[30] = lines[30][:6]  # row 30
    lines[50] = lines[50].replace(" ", " x", 1)  # row 50
    lines[60] = "\ufffd\x00\x01"
    lines[90:93] = [lines[90][:-1] + lines[92]]  # a line and a line end are lost: rows 90 to 92
    reader = TextStreamReader("port")
    block = _read(reader, ("\n".join(lines) + "\n").encode(), [77, 800])
    lost = {29, 49, 59, 89, 90, 91}
    kept = [row for row in range(200) if row not in lost]
    np.testing.assert_allclose(block.time, whole.time[kept], rtol=1e-13)
    np.testing.assert_array_equal(block.values, whole.values[:, kept])
    assert reader.unreadable == 4


def test_reading_starts_in_the_middle_of_a_line(tmp_path: Path) -> None:
    data = _logger(tmp_path, 100)
    body = data[data.index(b"\n1 ") + 1 :]
    reader = TextStreamReader("port", rate=400.0)
    block = _read(reader, body[5:], [])
    np.testing.assert_array_equal(block.values, _counts(100).values[:, 1:])
    assert reader.unreadable == 1


def test_boot_messages_before_the_header(
    texts: dict[str, tuple[bytes, Recording]],
) -> None:
    text, expected = texts["comma.csv"]
    reader = TextStreamReader("port")
    block = _read(reader, b"\xff\x00boot v1.2, ok\nready\n" + text, [3])
    np.testing.assert_array_equal(block.values, expected.values)
    assert reader.unreadable == 2


def test_restarted_logger_continues_after_a_gap(tmp_path: Path) -> None:
    data = _logger(tmp_path, 60)
    rows = data[data.index(b"\n1 ") + 1 :]
    reader = TextStreamReader("port")
    block = _read(reader, data + rows + rows, [])
    once = _counts(60)
    assert reader.restarts == 2
    assert reader.unreadable == 0
    assert len(block.time) == 180
    for n in range(3):
        part = slice(60 * n, 60 * n + 60)
        begin = n * (once.time[-1] + RESTART_GAP)
        np.testing.assert_allclose(block.time[part], begin + once.time, rtol=1e-12)
        np.testing.assert_array_equal(block.values[:, part], once.values)


@pytest.mark.parametrize("stamp", [b"999999", b"2", b"37"])
def test_one_wrong_stamp_has_no_effect(tmp_path: Path, stamp: bytes) -> None:
    lines = _logger(tmp_path, 100).split(b"\n")
    lines[50] = stamp + lines[50][lines[50].index(b" ") :]
    reader = TextStreamReader("port")
    block = _read(reader, b"\n".join(lines), [])
    kept = [row for row in range(100) if row != 49]
    np.testing.assert_allclose(block.time, _counts(100).time[kept], rtol=1e-13)
    assert (reader.unreadable, reader.restarts) == (1, 0)


def test_a_clock_that_is_set_continues_after_a_gap() -> None:
    """A gap of years would need as much memory as its rows."""
    header = b"time [s],front_wheel [g],front_chassis [g],rear_wheel [g],rear_chassis [g]\n"
    stamps = [0.01 * k + 1.7e9 * (k >= 30) for k in range(60)]
    rows = b"".join(b"%.2f,1,2,3,4\n" % stamp for stamp in stamps)
    reader = TextStreamReader("port")
    block = _read(reader, header + rows, [])
    assert (len(block.time), reader.restarts) == (60, 1)
    assert block.time[30] - block.time[29] == pytest.approx(5.0)


def test_lost_rows_are_a_gap_in_time(tmp_path: Path) -> None:
    data = _logger(tmp_path, 20) + b"\n".join(_logger(tmp_path, 30, first=2021).split(b"\n")[1:])
    reader = TextStreamReader("port")
    block = _read(reader, data, [])
    assert len(block.time) == 50
    assert block.time[20] - block.time[19] == pytest.approx(2001 / 400.0)
    assert (reader.unreadable, reader.restarts) == (0, 0)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"1 500 500 500 500\n2 500 500 500 500\n", "give the rate"),
        (b"\x01\x02\x03\n" * 300, "sends no rows of a recording"),
        (b"time [s],front_wheel [g],rear_wheel [g],rear_chassis [g]\n" * 250, "front_chassis"),
        (b"time [s],front_wheel,front_chassis,rear_wheel,rear_chassis\n" * 250, "has no unit"),
        (b"0.1,1e0,2,3,4\n" * 250, "not the header"),
    ],
)
def test_streams_that_are_no_recording_are_refused(data: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message) as refusal:
        TextStreamReader("COM3").feed(data)
    assert "COM3" in str(refusal.value)


@given(st.lists(st.binary(max_size=300), max_size=8))
def test_arbitrary_bytes(chunks: list[bytes]) -> None:
    reader = TextStreamReader("port", rate=400.0)
    rows = 0
    try:
        for chunk in chunks:
            rows += len(reader.feed(chunk).time)
        rows += len(reader.finish().time)
    except InputError:
        return
    assert rows + reader.unreadable <= sum(chunk.count(b"\n") for chunk in chunks) + 2


def test_endless_line_is_not_kept_in_memory() -> None:
    reader = TextStreamReader("port", rate=400.0)
    for _ in range(100):
        reader.feed(b"7" * 1000)
    assert reader.unreadable >= 9
    assert len(reader._bytes) <= 11_000
