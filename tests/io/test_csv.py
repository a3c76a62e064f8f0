"""Recordings as CSV: tolerant of variants of loggers and spreadsheets, exact in values."""

import gzip
import math
import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bayes_asv.domain.channels import channel
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording
from bayes_asv.io import read_recording, write_recording
from bayes_asv.io.text import TextFile, parse_column

HEADER = (
    "time [s],front_wheel [in/s^2],front_chassis [in/s^2],rear_wheel [in/s^2],rear_chassis [in/s^2]"
)
USUAL = f"""# sample_rate = 400 Hz
# note = two parking stops, run 3
{HEADER}
0.0000,1.5,2,3,4
0.0025,-1.5,,nan,4e1
0.0050,1.5,2,3,4
"""

per_test = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
Read = Callable[..., Recording]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    def read_text(text: str | bytes, rate: float | None = None) -> Recording:
        path = tmp_path / "run.csv"
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return read_recording(path, rate)

    return read_text


def same(a: Recording, b: Recording) -> bool:
    numbers = np.array_equal(a.time, b.time) and np.array_equal(a.values, b.values, equal_nan=True)
    return numbers and a.units == b.units


def test_typical_file(read: Read) -> None:
    recording = read(USUAL)
    np.testing.assert_array_equal(recording.time, [0.0, 0.0025, 0.005])
    np.testing.assert_array_equal(recording.values[0], [1.5, -1.5, 1.5])
    np.testing.assert_array_equal(recording.values[1], [2.0, math.nan, 2.0])
    np.testing.assert_array_equal(recording.values[2], [3.0, math.nan, 3.0])
    np.testing.assert_array_equal(recording.values[3], [4.0, 40.0, 4.0])
    assert recording.units == ("in/s^2",) * 4
    assert recording.metadata == (
        ("sample_rate", "400 Hz"),
        ("note", "two parking stops, run 3"),
    )
    assert recording.warnings == ()
    assert recording.source.endswith("run.csv")
    assert len(recording.sha256) == 64


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + USUAL,
        USUAL.replace("\n", "\r\n"),
        USUAL.replace("\n", "\r"),
        USUAL.replace("\n", "\n\n"),
        USUAL.replace("\n", "\n  \n").rstrip(),
        USUAL.replace("4\n", "4,\n").replace("4e1\n", "4e1,\n"),
        USUAL.replace("4\n", "4,,,\n"),
        USUAL.replace("]\n", "],\n").replace("4\n", "4,\n").replace("4e1\n", "4e1,\n"),
        USUAL.replace(",", ", "),
        USUAL.replace("1.5,2", '"1.5",2'),
        USUAL.replace("time [s]", '"Time [s]"'),
        USUAL.replace("front_wheel [in/s^2]", "Front Wheel (in/s^2)"),
        USUAL.replace("nan", "NaN"),
        USUAL.replace(",", "\t"),
        USUAL.replace("0.0025", "2.5e-3"),
    ],
)
def test_tolerated_spellings(read: Read, text: str) -> None:
    assert same(read(text), read(USUAL))


def test_semicolon_and_decimal_comma(read: Read) -> None:
    table = USUAL.split("\n", 2)[2].replace(",", ";").replace(".", ",")
    assert same(read(table), read(USUAL))


def test_columns_in_any_order_and_extra_columns(read: Read) -> None:
    shuffled = ["temp [degC],rear_chassis [g],name,rear_wheel [g],time [ms]"]
    shuffled[0] += ",front_chassis [g],front_wheel [counts]"
    shuffled += ['20,4,"a, b",3,0,2,512', "21,4.5,c,3.5,2.5,2.5,513"]
    recording = read("\n".join(shuffled))
    np.testing.assert_array_equal(recording.time, [0.0, 0.0025])
    np.testing.assert_array_equal(recording.values, [[512, 513], [2, 2.5], [3, 3.5], [4, 4.5]])
    assert recording.units == ("counts", "g", "g", "g")
    assert recording.warnings == ("columns ignored: temp [degC], name",)


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e-3), ("us", 1e-6), ("hour", 3600.0)])
def test_units_of_time(read: Read, unit: str, factor: float) -> None:
    recording = read(f"{HEADER}\n0,1,1,1,1\n0.007,1,1,1,1\n".replace("[s]", f"[{unit}]"))
    assert recording.time[1] == pytest.approx(0.007 * factor)


def test_metadata_may_follow_the_header(read: Read) -> None:
    recording = read(f"# a = 1\n{HEADER}\n# b=2=3\n# only words\n0,1,1,1,1\n1,1,1,1,1\n")
    assert recording.metadata == (("a", "1"), ("b", "2=3"), ("comment", "only words"))


def test_without_stamps_the_rate_is_needed(read: Read) -> None:
    text = USUAL.replace("time [s],", "").replace("0.0000,", "").replace("0.0025,", "")
    text = text.replace("0.0050,", "")
    np.testing.assert_array_equal(read(text).time, [0.0, 0.0025, 0.005])
    np.testing.assert_array_equal(read(text, rate=100.0).time, [0.0, 0.01, 0.02])
    with pytest.raises(InputError, match="--rate"):
        read(text.split("\n", 1)[1])


def test_stamps_take_precedence_and_the_rate_is_a_check(read: Read) -> None:
    assert read(USUAL, rate=400.0).warnings == ()
    (warning,) = read(USUAL.replace("400 Hz", "800 Hz")).warnings
    assert warning.startswith("sample_rate is 800 Hz, but the time stamps give 400 Hz")
    (warning,) = read(USUAL, rate=100.0).warnings
    assert warning.startswith("the given rate is 100 Hz")


@pytest.mark.parametrize(
    ("old", "new", "line", "said"),
    [
        ("-1.5,", "-1.5x,", 5, "front_wheel is '-1.5x', not a number"),
        ("-1.5,", "1_5,", 5, "not a number"),
        ("-1.5,", "٣,", 5, "not a number"),
        ("-1.5,", "inf,", 5, "front_wheel is inf, which is implausible for a sensor"),
        ("-1.5,", "1e999,", 5, "front_wheel is inf, which is implausible for a sensor"),
        ("0.0025", "", 5, "has no time"),
        ("0.0025", "nan", 5, "has no time"),
        ("0.0025", "0.0000", 5, "does not come after"),
        ("0.0050", "0.0001", 6, "does not come after 0.0025"),
        ("-1.5,", "1e30,", 5, r"front_wheel is 1e\+30, which is implausible for a sensor"),
        ("0.0050", "soon", 6, "time is 'soon'"),
        ("-1.5,,nan,4e1", "-1.5,", 5, "has 3 cells, the header 5"),
        ("-1.5,,", "-1.5,1,1,1,", 5, "cells, the header 5"),
        ("-1.5,", '"-1.5,', 5, "cells, the header 5"),
        ("front_wheel [in/s^2]", "front_wheel [m]", 3, "not a unit of acceleration"),
        ("front_wheel [in/s^2]", "front_wheel", 3, "front_wheel has no unit"),
        ("front_wheel [in/s^2]", "front_wheel []", 3, "front_wheel has no unit"),
        ("front_wheel [in/s^2]", "front_weel [in/s^2]", 3, "rename front_weel .* to front_wheel"),
        ("front_wheel [in/s^2]", "rear_wheel [in/s^2]", 3, "rear_wheel occurs twice"),
        ("time [s]", "time [m]", 3, "not a unit of time"),
        ("time [s]", "time", 3, "time has no unit"),
        (HEADER + "\n", "", 3, "not the header of a recording; write: time"),
    ],
)
def test_faults_name_the_line(read: Read, old: str, new: str, line: int, said: str) -> None:
    assert old in USUAL
    with pytest.raises(InputError, match=said) as caught:
        read(USUAL.replace(old, new, 1))
    assert f"run.csv:{line}: " in str(caught.value)
    assert caught.value.fix


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "is empty"),
        (b"\n\n", "contains no data"),
        (b"# a = b\n", "contains no data"),
        (gzip.compress(USUAL.encode()), "gzip"),
        (b"PK\x03\x04rest", "workbook or a zip"),
        (USUAL.encode("utf-16"), "UTF-16"),
        (b"\0\1\2\3", "not a text file"),
        (USUAL.replace("two", "zw\u00f6lf").encode("latin-1"), "run.csv:2: is not UTF-8"),
        (HEADER.encode(), "has 0 rows"),
        (f"{HEADER}\n0,1,1,1,1\n".encode(), "has 1 rows"),
        (f"{HEADER}\n0,,1,1,1\n1,nan,1,1,1\n".encode(), "front_wheel has no readings"),
        (USUAL.replace("400 Hz", "fast").encode(), "# sample_rate"),
        (b"# clock reer = 3 ppm\n" + USUAL.encode(), "did you mean rear"),
    ],
)
def test_files_without_a_recording_are_refused(read: Read, data: bytes, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        read(data)
    assert "run.csv" in str(caught.value)
    assert caught.value.fix


def test_too_many_cells(read: Read, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bayes_asv.io.text.MAX_CELLS", 10)
    with pytest.raises(InputError, match="split it into files"):
        read(USUAL)


def test_too_many_bytes(read: Read, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bayes_asv.io.MAX_FILE_SIZE", 100)
    with pytest.raises(InputError, match="longer than 100 bytes"):
        read(USUAL)


def test_implausible_rate_is_refused(read: Read) -> None:
    for rate in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(InputError, match="rate for"):
            read(USUAL, rate=rate)


@pytest.mark.parametrize("unit", ["us", "hour"])
def test_unusual_rates_give_a_warning(read: Read, unit: str) -> None:
    warnings = read(USUAL.replace("[s]", f"[{unit}]")).warnings
    assert any("check the unit of the time column" in warning for warning in warnings)


def test_unreadable_paths_are_refused(tmp_path: Path) -> None:
    (tmp_path / "run3.csv").write_text(USUAL)
    with pytest.raises(InputError, match=r"no such file; did you mean .*run3\.csv"):
        read_recording(tmp_path / "run2.csv")
    with pytest.raises(InputError, match="is a folder"):
        read_recording(tmp_path)
    with pytest.raises(InputError, match="no such file"):
        read_recording(tmp_path / "nowhere" / "run.csv")
    for name in ("a\0b", "x" * 5000, ""):
        with pytest.raises(InputError):
            read_recording(name)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes")
def test_a_pipe_is_refused_without_blocking(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="not an ordinary file"):
        read_recording(tmp_path / "pipe")


def test_file_without_permission(read: Read, monkeypatch: pytest.MonkeyPatch) -> None:
    def denied(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("builtins.open", denied)
    with pytest.raises(InputError, match="may not be read; check its permissions"):
        read_recording(__file__)


def test_large_file_is_read_fast(tmp_path: Path) -> None:
    n = 100_000
    values = np.random.default_rng(1).normal(size=(4, n))
    recording = Recording(np.arange(n) / 400, values, ("in/s^2",) * 4)
    write_recording(recording, tmp_path / "long.csv")
    start = time.process_time()
    again = read_recording(tmp_path / "long.csv")
    assert time.process_time() - start < 1.5  # 0.3 s on a laptop; room for a loaded machine
    assert same(again, recording)


spellings = st.one_of(
    st.floats(-1e13, 1e13).map(repr),
    st.floats(allow_nan=False).map("{:.17e}".format),
    st.decimals(-1000, 1000, places=20).map(str),
    st.sampled_from(["", "nan", "NaN", "-0", "+1.", ".5", "1E3", " 7", "1 2", "1e", "--1", "1_0"]),
    st.text('0123456789.eE+-nai_, \t;"', max_size=4),
)


@given(
    rows=st.lists(st.lists(spellings, min_size=3, max_size=3), min_size=1, max_size=6),
    separator=st.sampled_from(",;\t"),
    chunk=st.sampled_from([1, 20, 1 << 22]),
)
@per_test
def test_cells_parsed_at_once_equal_those_parsed_one_by_one(
    monkeypatch: pytest.MonkeyPatch, rows: list[list[str]], separator: str, chunk: int
) -> None:
    """Bit for bit; what is unusual is left to the careful path, never read as something else."""
    monkeypatch.setattr("bayes_asv.io.text._CHUNK", chunk)
    lines = [separator.join(row) for row in rows]
    text = TextFile("\n".join(["a", *lines, ""]), "table", "")
    table = text.table(separator, 3, [2, 0])
    if table is None:
        return
    cells = [line.split(separator) for line in lines]
    assert all(len(row) == 3 for row in cells)
    for found, column in zip(table, (2, 0), strict=True):
        own = [row[column] for row in cells]
        own = [cell.replace(",", ".") for cell in own] if separator == ";" else own
        careful = parse_column(own, text, 1, "cell")
        assert np.array_equal(found.view(np.int64), careful.view(np.int64))


def test_plain_tables_are_parsed_at_once() -> None:
    for separator, comma in ((",", "."), (";", ","), ("\t", ".")):
        rows = [separator.join((f"{k}{comma}5", "", f"-{k}e-3")) for k in range(9)]
        table = TextFile("\n".join(["a", *rows]), "table", "").table(separator, 3, [0, 1, 2])
        assert table is not None
        assert np.array_equal(table[0], np.arange(9) + 0.5)
        assert np.isnan(table[1]).all()


finite = st.floats(-1e12, 1e12)


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    steps = draw(st.lists(st.floats(1e-5, 50.0), min_size=1, max_size=8))
    stamps = np.cumsum([draw(st.floats(-1e6, 1e6)), *steps])
    n = stamps.size
    units = st.sampled_from(["in/s^2", "g", "m/s^2", "counts"])
    cell = st.just(math.nan) | finite
    rows = [[draw(finite), *draw(st.lists(cell, min_size=n - 1, max_size=n - 1))] for _ in range(4)]
    words = st.text(max_size=12)
    keys = words.filter(
        lambda key: (
            "=" not in key
            and "".join(ch for ch in key if ch.isprintable()).strip()
            and key.strip() != "sample_rate"
            and not key.strip().startswith(("delay ", "clock "))
        )
    )
    return Recording(
        stamps,
        np.array(rows),
        (draw(units), draw(units), draw(units), draw(units)),
        tuple(draw(st.lists(st.tuples(keys, words), max_size=3))),
    )


@given(recording=recordings())
@per_test
def test_written_file_reads_back_equal(tmp_path: Path, recording: Recording) -> None:
    write_recording(recording, tmp_path / "again.csv")
    again = read_recording(tmp_path / "again.csv")
    assert same(again, recording)
    assert again.metadata == recording.metadata


def test_minus_zero_keeps_its_sign(tmp_path: Path) -> None:
    values = np.full((4, 2), -0.0)
    write_recording(Recording(np.arange(2.0), values, ("g",) * 4), tmp_path / "a.csv")
    assert np.signbit(read_recording(tmp_path / "a.csv").values).all()


def test_failed_write_leaves_the_old_file(
    tmp_path: Path, read: Read, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = read(USUAL)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(InputError, match="No space left"):
        write_recording(recording, tmp_path / "run.csv")
    assert (tmp_path / "run.csv").read_text() == USUAL
    assert len(list(tmp_path.iterdir())) == 1


PIECES = [
    "",
    ",",
    ";",
    "\t",
    "\n",
    "\r",
    '"',
    "#",
    "=",
    "[",
    "]",
    "nan",
    "inf",
    "-",
    "e",
    "9" * 400,
]
PIECES += [
    "\0",
    "\u2028",
    "\x0c",
    "time",
    "counts",
    "[g]",
    "# clock rear = 1\n",
    "1 2 3 4 5\n",
    "_",
]


@given(
    edits=st.lists(
        st.tuples(st.integers(0, len(USUAL)), st.integers(0, 30), st.sampled_from(PIECES)),
        min_size=1,
        max_size=5,
    ),
    rate=st.none() | st.just(400.0),
)
@settings(per_test, max_examples=500)
def test_mutated_files_are_read_or_refused(
    tmp_path: Path, edits: list[tuple[int, int, str]], rate: float | None
) -> None:
    text = USUAL
    for at, cut, piece in edits:
        text = text[:at] + piece + text[at + cut :]
    assert read_or_refused(tmp_path, text.encode(), rate)


@given(
    data=st.binary(max_size=200)
    | st.text('0123456789.,;-+eE nan#=[]()"\n\r\ttimefrontwheelrearchassis_/', max_size=300).map(
        str.encode
    )
    | st.binary(max_size=60).map(lambda tail: USUAL.encode() + tail)
)
@settings(per_test, max_examples=500)
def test_any_bytes_are_read_or_refused(tmp_path: Path, data: bytes) -> None:
    assert read_or_refused(tmp_path, data, None)


def read_or_refused(folder: Path, data: bytes, rate: float | None) -> bool:
    """Read to what a written copy gives again, or refused in one sentence with file and fix."""
    path = folder / "fuzz.csv"
    path.write_bytes(data)
    try:
        recording = read_recording(path, rate)
    except InputError as error:
        return "\n" not in str(error) and "fuzz.csv" in str(error) and bool(error.fix)
    write_recording(recording, folder / "again.csv")
    rising = bool((np.diff(recording.time) > 0).all())
    return rising and same(read_recording(folder / "again.csv"), recording)


@pytest.mark.parametrize(
    ("columns", "fault"),
    [
        ("front_wheel front_chassis rear_wheel", None),
        ("front_wheel rear_wheel body_pitch_rate", None),
        ("front_wheel front_chassis", None),  # a quarter car
        ("rear_wheel rear_travel", None),
        ("front_wheel front_chassis rear_chassis", "rear_wheel is missing"),
        ("front_wheel front_chassis body_pitch_rate", "rear_wheel is missing"),
        ("front_chassis rear_chassis", "front_wheel is missing"),
        ("front_left_wheel front_right_wheel rear_left_wheel rear_right_wheel rear_chassis", None),
        ("front_left_wheel rear_left_wheel rear_right_wheel rear_chassis", "front_right_wheel is"),
        ("front_left_chassis front_right_chassis rear_chassis", "front_left_wheel is missing"),
    ],
)
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_all_wheel_hubs_of_some_car_are_needed(
    read: Read, columns: str, fault: str | None, separator: str
) -> None:
    names = columns.split()
    header = ["time [s]", *(f"{name} [{channel(name).si_unit}]" for name in names)]
    rows = [str(k) for k in range(2)]
    text = "\n".join(
        [separator.join(header), *(separator.join([row] * len(header)) for row in rows)]
    )
    if fault is None:
        assert read(text).channels == tuple(names)
    else:
        with pytest.raises(InputError, match=f"run.csv:1: column {fault}"):
            read(text)
