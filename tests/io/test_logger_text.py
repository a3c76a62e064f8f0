"""The logger's text format: integer columns, and gaps in time."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording, nominal_rate
from bayes_asv.io import read_recording, write_logger, write_recording

USUAL = """1 569 641 581 636
2\t570\t640\t582\t635
  3  571 639 583 634
5 0 1023 0 1023
"""
COUNTS = ("counts",) * 4
Read = Callable[..., Recording]
per_test = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture
def read(tmp_path: Path) -> Read:
    def read_text(text: str, rate: float | None = None) -> Recording:
        path = tmp_path / "run.txt"
        path.write_bytes(text.encode())
        return read_recording(path, rate)

    return read_text


def test_typical_file(read: Read) -> None:
    recording = read(USUAL, rate=400.0)
    np.testing.assert_array_equal(recording.time, np.array([0, 1, 2, 4]) / 400)
    np.testing.assert_array_equal(
        recording.values,
        [[569, 570, 571, 0], [641, 640, 639, 1023], [581, 582, 583, 0], [636, 635, 634, 1023]],
    )
    assert recording.units == COUNTS
    assert recording.warnings == ()
    assert recording.metadata == (("sample_rate", "400.0 Hz"),)
    assert nominal_rate(recording) == pytest.approx(400.0)


def test_rate_from_metadata(read: Read) -> None:
    recording = read("# sample_rate = 800 Hz\n# note = stops\n" + USUAL)
    np.testing.assert_array_equal(recording.time, np.array([0, 1, 2, 4]) / 800)
    assert recording.metadata == (("sample_rate", "800 Hz"), ("note", "stops"))


def test_given_rate_takes_precedence_with_a_warning(read: Read) -> None:
    recording = read("# sample_rate = 800 Hz\n" + USUAL, rate=400.0)
    assert recording.time[-1] == 4 / 400
    assert recording.metadata == (("sample_rate", "400.0 Hz"),)
    assert recording.warnings == ("the file declares 800 Hz, but the given rate of 400 Hz is used",)


def test_the_header_of_a_second_dump_is_refused(read: Read) -> None:
    with pytest.raises(InputError, match=r"sample_rate: is 400 Hz and 800 Hz; keep .* one dump"):
        read("# sample_rate = 400 Hz\n" + USUAL + "# sample_rate = 800 Hz\n6 1 2 3 4\n")
    twice = "# clock rear = 48.3 ppm\n" + USUAL + "# clock rear = 48.4 ppm\n"
    with pytest.raises(InputError, match="clock rear"):
        read(twice, 400.0)
    assert read("# sample_rate = 400 Hz\n" * 2 + USUAL).time[1] == 1 / 400


def test_run_may_start_late(read: Read) -> None:
    assert read("101 1 2 3 4\n102 1 2 3 4\n", rate=100.0).time[0] == 1.0


def test_windows_lines_blank_lines_and_mark(read: Read) -> None:
    text = "\ufeff" + USUAL.replace("\n", "\r\n\r\n")
    np.testing.assert_array_equal(read(text, 400.0).values, read(USUAL, 400.0).values)


def test_readings_beyond_ten_bits_give_a_warning(read: Read) -> None:
    (warning,) = read(USUAL.replace("1023", "4095"), rate=400.0).warnings
    assert warning == "2 readings are outside 0 to 1023 counts"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("2\t570", "2\t57x", r"run.txt:2: is not a row of five integers"),
        ("2\t570", "2\t57.5", r"run.txt:2: is not a row of five integers"),
        ("2\t570", "2\t5_7", r"run.txt:2: is not a row of five integers"),
        ("2\t570", "2", r"run.txt:2: is not a row of five integers"),
        ("1023\n", "1023 7\n", r"run.txt:4: is not a row of five integers"),
        ("2\t570", f"2\t{'9' * 30}", r"run.txt:2: "),
        ("2\t570", "2\t9999999999", r"numbers beyond"),
        ("  3", "  2", r"run.txt:3: index 2 does not come after 2"),
        ("5 0", "1 0", r"run.txt:4: index 1 does not come after 3"),
        ("1 569", "0 569", r"run.txt:1: index 0 does not come after 0"),
    ],
)
def test_faults_name_the_line(read: Read, old: str, new: str, said: str) -> None:
    assert old in USUAL
    with pytest.raises(InputError, match=said) as caught:
        read(USUAL.replace(old, new, 1), rate=400.0)
    assert caught.value.fix


def test_rate_is_needed(read: Read) -> None:
    with pytest.raises(InputError, match=r"no rate; give the rate .--rate 400. or add a line"):
        read(USUAL)
    with pytest.raises(InputError, match="# sample_rate"):
        read("# sample_rate = often\n" + USUAL)
    with pytest.raises(InputError, match="one row"):
        read("1 2 3 4 5\n", rate=400.0)


indices = st.lists(st.integers(1, 100_000), min_size=2, max_size=20, unique=True).map(sorted)


@given(
    index=indices,
    rate=st.sampled_from([50.0, 100.0, 200.0, 400.0, 800.0]) | st.floats(1.0, 1e5),
    data=st.data(),
)
@per_test
def test_written_file_reads_back_equal(
    tmp_path: Path, index: list[int], rate: float, data: st.DataObject
) -> None:
    counts = st.lists(st.integers(0, 1023), min_size=len(index), max_size=len(index))
    recording = Recording(
        (np.array(index) - 1) / rate,
        np.array([data.draw(counts) for _ in range(4)], dtype=float),
        COUNTS,
        (("sample_rate", f"{rate!r} Hz"), ("note", "x")),
    )
    for write, name in ((write_logger, "a.txt"), (write_recording, "a.csv")):
        write(recording, tmp_path / name)
        again = read_recording(tmp_path / name)
        np.testing.assert_array_equal(again.time, recording.time)
        np.testing.assert_array_equal(again.values, recording.values)
        assert again.units == recording.units
        assert again.metadata == recording.metadata


@pytest.mark.parametrize(
    ("time", "values", "units", "metadata", "said"),
    [
        ([0, 0.01], 1.0, "counts", (), "has no sample_rate"),
        ([0, 0.01], 1.0, "g", (("sample_rate", "100 Hz"),), "not in counts"),
        ([0, 0.01], np.nan, "counts", (("sample_rate", "100 Hz"),), "missing or not whole"),
        ([0, 0.01], 1.5, "counts", (("sample_rate", "100 Hz"),), "missing or not whole"),
        ([0, 0.0101], 1.0, "counts", (("sample_rate", "100 Hz"),), "off the grid of 100 Hz"),
        ([-1, 0.0], 1.0, "counts", (("sample_rate", "100 Hz"),), "off the grid of 100 Hz"),
        ([0, 1e12], 1.0, "counts", (("sample_rate", "100 Hz"),), "off the grid of 100 Hz"),
    ],
)
def test_recordings_that_the_format_cannot_store_are_refused(
    tmp_path: Path,
    time: list[float],
    values: float,
    units: str,
    metadata: tuple[tuple[str, str], ...],
    said: str,
) -> None:
    recording = Recording(np.array(time), np.full((4, 2), values), (units,) * 4, metadata)
    with pytest.raises(InputError, match=f"{said}.*; write it as CSV"):
        write_logger(recording, tmp_path / "a.txt")
    assert not list(tmp_path.iterdir())


PIECES = [
    "",
    " ",
    "\n",
    "-",
    "+",
    ".",
    "1",
    "9" * 12,
    "x",
    "#",
    "# sample_rate = 1\n",
    "\0",
    "_",
    "٣",
]


@given(
    edits=st.lists(
        st.tuples(st.integers(0, len(USUAL)), st.integers(0, 10), st.sampled_from(PIECES)),
        min_size=1,
        max_size=4,
    )
)
@settings(per_test, max_examples=400)
def test_mutated_files_are_read_or_refused(
    tmp_path: Path, edits: list[tuple[int, int, str]]
) -> None:
    text = USUAL
    for at, cut, piece in edits:
        text = text[:at] + piece + text[at + cut :]
    path = tmp_path / "fuzz.txt"
    path.write_bytes(text.encode())
    refusal = None
    try:
        recording = read_recording(path, rate=400.0)
    except InputError as error:
        refusal = error
    if refusal is not None:
        assert "\n" not in str(refusal)
        assert "fuzz.txt" in str(refusal)
        assert refusal.fix
    else:
        assert (np.diff(recording.time) > 0).all()
        assert recording.units == COUNTS
