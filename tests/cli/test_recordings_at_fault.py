"""Recordings as people hand them over by mistake: one line that names file, line and fix."""

from __future__ import annotations

import contextlib
import gzip
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.cli.conftest import Check, Command

Edit = Callable[[list[str]], object]

HEADER = 2  # the first two lines are metadata


def _line(at: int, change: Callable[[str], str]) -> Edit:
    def edit(lines: list[str]) -> None:
        lines[at] = change(lines[at])

    return edit


def _replace(at: int, old: str, new: str) -> Edit:
    return _line(at, lambda line: line.replace(old, new))


def _cell(at: int, place: int, text: str) -> Edit:
    def change(line: str) -> str:
        cells = line.split(",")
        cells[place] = text
        return ",".join(cells)

    return _line(at, change)


def _emptied(place: int) -> Edit:
    def edit(lines: list[str]) -> None:
        for at in range(HEADER + 1, len(lines)):
            _cell(at, place, "nan")(lines)

    return edit


FAULTS: dict[str, tuple[Edit, tuple[str, ...]]] = {
    "no header": (lambda x: x.pop(HEADER), (":3:", "is not the header", "write: time [s]")),
    "no unit": (_replace(HEADER, "[in/s^2]", ""), (":3:", "has no unit", "[m/s^2]")),
    "wrong unit": (
        _replace(HEADER, "rear_wheel [in/s^2]", "rear_wheel [in/s]"),
        (":3:", "rear_wheel", "in/s", "use m/s^2"),
    ),
    "unit nobody knows": (
        _replace(HEADER, "rear_wheel [in/s^2]", "rear_wheel [furlong/fortnight/x]"),
        (":3:", "rear_wheel", "use m/s^2"),
    ),
    "bare lb": (
        _replace(HEADER, "rear_wheel [in/s^2]", "rear_wheel [lb]"),
        (":3:", "lbf (force) or lbm (mass)"),
    ),
    "time without unit": (_replace(HEADER, "time [s]", "time"), (":3:", "write time [s]")),
    "time in metres": (_replace(HEADER, "time [s]", "time [m]"), (":3:", "time", "write time [s]")),
    "misspelt channel": (
        _replace(HEADER, "rear_wheel", "rear_weel"),
        (":3:", "rear_wheel is missing", "rename rear_weel [in/s^2] to rear_wheel"),
    ),
    "channel gone": (
        _replace(HEADER, "rear_wheel", "speed"),
        (":3:", "rear_wheel is missing", "add it with its unit"),
    ),
    "channel twice": (
        _replace(HEADER, "rear_wheel", "front_wheel"),
        (":3:", "front_wheel occurs twice", "keep one"),
    ),
    "text cell": (_cell(20, 2, "n/a"), (":21:", "front_chassis", "n/a")),
    "infinite cell": (_cell(20, 2, "inf"), (":21:", "front_chassis")),
    "huge cell": (_cell(20, 2, "1e30"), (":21:", "front_chassis")),
    "decimal comma": (_replace(20, "0.", "0,"), (":21:", "has 6 cells, the header 5")),
    "only NaN": (_emptied(3), ("rear_wheel has no readings", "wiring")),
    "no stamp": (_cell(20, 0, ""), (":21:", "has no time", "delete the row")),
    "same stamp": (_cell(20, 0, "0.040000"), (":21:", "does not come after", "sort the rows")),
    "unsorted": (_cell(20, 0, "-3"), (":21:", "does not come after", "sort the rows")),
    "one row": (lambda x: x.__delitem__(slice(HEADER + 2, None)), ("1 rows", "at least two")),
    "header only": (lambda x: x.__delitem__(slice(HEADER + 1, None)), ("0 rows",)),
    "metadata only": (lambda x: x.__delitem__(slice(HEADER, None)), ("contains no data",)),
    "cut line": (_line(-1, lambda s: s[:14]), (":803:", "complete the row or delete it")),
    "open quote": (_line(20, lambda s: '"' + s), (":21:",)),
    "no rate": (_replace(0, "400 Hz", "fast"), ("# sample_rate", "400 Hz")),
    "no such clock": (
        lambda x: x.insert(0, "# clock middle = 3 ppm"),
        ("# clock middle", "there is no channel 'middle'"),
    ),
    "absurd delay": (
        lambda x: x.insert(0, "# delay front_wheel = 8 s"),
        ("# delay front_wheel", "not a plausible delay"),
    ),
}


@pytest.mark.parametrize("kind", FAULTS)
def test_a_faulty_table(
    invoke: Command, refuse: Check, stops: Path, baja: Path, tmp_path: Path, kind: str
) -> None:
    edit, expected = FAULTS[kind]
    lines = stops.read_text(encoding="utf-8").splitlines()
    edit(lines)
    file = tmp_path / "run.csv"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert refuse(invoke("estimate", file, "-v", baja), "run.csv", *expected)


BYTES: dict[str, tuple[bytes, tuple[str, ...]]] = {
    "empty": (b"", ("is empty",)),
    "blank": (b"\n\n  \n", ("contains no data",)),
    "binary": (bytes(range(256)) * 8, ("is not a text file",)),
    "gzip": (gzip.compress(b"time [s]", mtime=0), ("gunzip",)),
    "xlsx": (b"PK\x03\x04" + bytes(100), ("save the sheet as CSV UTF-8",)),
    "xls": (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(100), ("save the sheet as CSV UTF-8",)),
    "utf-16": ("time [s]\n".encode("utf-16"), ("save it as UTF-8",)),
    "latin-1": ("# note = Fahrt über die Schwelle\n".encode("latin-1"), (":1:", "UTF-8")),
    "mdf": (b"MDF     4.10", ("export it as CSV",)),
    "html": (b"<!DOCTYPE html>\n<html><body>404</body></html>\n", (":1:", "not the header")),
    "json": (b'{"schema": "bayes_asv/estimate/1"}\n', (":1:", "not the header")),
    "logger without rate": (b"1 570 641 581 636\n2 570 641 581 636\n", ("--rate 400",)),
    "logger with a gap in a row": (
        b"# sample_rate = 400 Hz\n1 570 641 581 636\n2 570 641 581\n",
        (":3:", "five integers"),
    ),
    "logger that counts backwards": (
        b"# sample_rate = 400 Hz\n2 570 641 581 636\n1 570 641 581 636\n",
        (":3:", "does not come after"),
    ),
}


@pytest.mark.parametrize("kind", BYTES)
def test_a_file_that_is_no_table(
    invoke: Command, refuse: Check, baja: Path, tmp_path: Path, kind: str
) -> None:
    data, expected = BYTES[kind]
    file = tmp_path / "run.csv"
    file.write_bytes(data)
    assert refuse(invoke("estimate", file, "-v", baja), "run.csv", *expected)
    assert refuse(
        invoke("report", file, "-v", baja, "-o", tmp_path / "x.html"), "run.csv", *expected
    )
    assert not (tmp_path / "x.html").exists()


def test_no_file_there(
    invoke: Command, refuse: Check, stops: Path, baja: Path, tmp_path: Path
) -> None:
    (tmp_path / "monday.csv").write_bytes(stops.read_bytes())
    assert refuse(
        invoke("estimate", tmp_path / "mondey.csv", "-v", baja), "no such file", "monday.csv?"
    )
    assert refuse(invoke("estimate", tmp_path / "no" / "run.csv", "-v", baja), "check the path")
    assert refuse(invoke("estimate", tmp_path, "-v", baja), "is a folder", "name a file in it")
    assert refuse(invoke("estimate", "/dev/null", "-v", baja), "is not an ordinary file")
    assert refuse(invoke("estimate", stops, "-v", tmp_path), "is a folder")
    assert refuse(invoke("estimate", stops, "-v", tmp_path / "car.toml"), "no such file")


def test_a_name_that_is_no_text_stays_on_its_line(
    invoke: Command, refuse: Check, baja: Path, tmp_path: Path
) -> None:
    assert refuse(
        invoke("estimate", tmp_path / "a\nb\x1b[31m\u202e.csv", "-v", baja), "no such file"
    )
    assert refuse(invoke("estimate", tmp_path / "\udcff.csv", "-v", baja), "no such file")
    assert refuse(invoke("estimate", tmp_path / ("x" * 5000), "-v", baja))


def test_counts_without_a_calibration(
    invoke: Command, refuse: Check, stops: Path, baja: Path, tmp_path: Path
) -> None:
    car = tmp_path / "car.toml"
    text = baja.read_text(encoding="utf-8")
    car.write_text(text.replace("zero_counts", "# zero_counts"), encoding="utf-8")
    counts = stops.with_name("stops-800hz.csv")
    assert refuse(
        invoke("estimate", counts, "-v", car), "[sensors.front_wheel]", "add zero_counts = 512"
    )


@pytest.mark.usefixtures("without_input_search")
@pytest.mark.parametrize("fault", ["short", "slow", "still", "clipped", "gap"])
def test_data_that_cannot_answer_are_refused_with_reasons(
    invoke: Command, stops: Path, baja: Path, tmp_path: Path, fault: str
) -> None:
    import json

    lines = stops.read_text(encoding="utf-8").splitlines()
    head, rows = lines[: HEADER + 1], lines[HEADER + 1 :]
    if fault == "short":
        rows = rows[:90]
    elif fault == "slow":
        rows = rows[::40]
        head[0] = "# sample_rate = 10 Hz"
    elif fault == "still":
        rows = [",".join([row.split(",")[0], "1", "2", "3", "4"]) for row in rows]
    elif fault == "clipped":
        for at in range(0, len(rows), 3):
            _cell(at, 1, "9999")(rows)
    else:
        rows = rows[:200] + rows[400:]
    file = tmp_path / "run.csv"
    file.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    said = invoke("estimate", file, "-v", baja, "--json", tmp_path / "x.json")
    assert said.status == 3
    assert said.err == ""
    document = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert document["verdict"] == "refused"
    assert document["reasons"]
    assert document["parameters"] == {}
    assert any("run.csv" in reason for reason in document["reasons"])
    assert "Why: " in said.out
    assert "Next: " in said.out
    told = invoke("report", "--from", tmp_path / "x.json", "-o", tmp_path / "x.html")
    assert told.status == 3
    assert "Why: " in told.out
    assert "refused" in (tmp_path / "x.html").read_text(encoding="utf-8")


def _stamps(lines: list[str], change: Callable[[int, float], float]) -> None:
    for at in range(HEADER + 1, len(lines)):
        stamp, rest = lines[at].split(",", 1)
        lines[at] = f"{change(at - HEADER - 1, float(stamp))!r},{rest}"


STAMPS: dict[str, tuple[Callable[[int, float], float], str]] = {
    "milliseconds": (lambda _, t: 1e3 * t, "probably in milliseconds"),
    "microseconds": (lambda _, t: 1e6 * t, "probably in microseconds"),
    "a gap of hours": (lambda row, t: t + 25_200.0 * (row > 500), ""),
    "one stamp far off": (lambda row, t: t + 1e9 * (row == 799), "row 800: comes 1e+09 s after"),
    "clock set after the first row": (lambda row, t: t + 1.7e9 * (row > 0), "row 2: comes 1.7e+09"),
    "milliseconds since 1970": (lambda _, t: 1.7e12 + 1e3 * t, "such as time [ms]"),
}
COMMANDS = {
    "track": ("track",), "watch": ("watch", "--below", "80"), "estimate": ("estimate",),
    "diagnose": ("diagnose",), "greybox": ("greybox",), "modes": ("modes",),
}  # fmt: skip


@pytest.mark.parametrize("kind", STAMPS)
@pytest.mark.parametrize("command", COMMANDS)
def test_stamps_far_off_cost_no_memory(
    invoke: Command, stops: Path, baja: Path, tmp_path: Path, command: str, kind: str
) -> None:
    """Without their bounds these stamps make grids of 0.4 to 5000 GiB."""
    lines = stops.read_text(encoding="utf-8").splitlines()[: HEADER + 1 + 800]
    change, expected = STAMPS[kind]
    _stamps(lines, change)
    file = tmp_path / "run.csv"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    with _address_space(1 << 30):
        said = invoke(*COMMANDS[command], file, "-v", baja)
    assert said.status in (0, 2, 3), said
    assert "memory" not in said.err
    if said.status == 2:
        assert len(said.err.splitlines()) == 1
    if command in ("track", "watch") or (said.status == 2 and command != "modes"):
        assert expected in " ".join((said.out + said.err).split())


@contextlib.contextmanager
def _address_space(more: int) -> Iterator[None]:
    """Let this process take no more than so many bytes in addition to what it has."""
    resource = pytest.importorskip("resource")
    old = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + more, old[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, old)
