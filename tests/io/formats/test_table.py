"""Tables in text: separators, headers, units and broken rows."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.log import Log
from bayes_asv.io.formats import LogFile, bare, read_log
from bayes_asv.io.formats.unit_words import is_unit, split_unit
from tests.io.formats.made import FRONT, REAR, SECONDS, TIME, table

Read = Callable[..., Log]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    def read_text(text: str, rate: float | None = None, encoding: str = "utf-8") -> Log:
        path = tmp_path / "log.csv"
        path.write_bytes(text.encode(encoding))
        return read_log(path, rate)

    return read_text


def check(log: Log, name: str = "front", unit: str = "g") -> None:
    channel = log.channel(name)
    assert channel.unit == unit
    np.testing.assert_array_equal(channel.values, FRONT)
    np.testing.assert_allclose(channel.time, TIME, atol=1e-9)


@pytest.mark.parametrize(
    ("separator", "decimal"),
    [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), (" ", "."), (" ", ","),
     ("  ", "."), (", ", ".")],
)  # fmt: skip
@pytest.mark.parametrize("named", [True, False])
def test_separators_and_decimals(read: Read, separator: str, decimal: str, named: bool) -> None:
    rows = table(SECONDS, FRONT, REAR, separator=separator, decimal=decimal)
    header = separator.join(["time", "front", "rear"]) + "\n" if named else ""
    log = read(header + rows)
    check(log, "front" if named else "column 2", "")
    assert len(log.channels) == 2


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_encodings_and_line_ends(read: Read, encoding: str, end: str) -> None:
    text = "time [s],front [g],Öl [°C]\n" + table(SECONDS, FRONT, REAR)
    log = read(text.replace("\n", end), encoding=encoding)
    check(log)
    assert log.channel("Öl").unit == "°C"


@pytest.mark.parametrize(
    "header",
    [
        "time,front,rear\ns,g,g\n", '"time","front","rear"\n"s","g","g"\n\n\n',
        "time (s),front (g),rear (g)\n", "time [s];front [g];rear [g]\n",
        "time,front,rear\n[s],[g],[g]\n", "# time s, front g\ntime,front,rear\ns,g,g\n",
        "time,front,rear\n\ns,g,g\n", "t / s,front / g,rear / g\n",
    ],
)  # fmt: skip
def test_units_in_a_row_or_behind_the_name(read: Read, header: str) -> None:
    log = read(header + table(SECONDS, FRONT, REAR))
    check(log)
    assert log.channel("rear").unit == "g"


@pytest.mark.parametrize("units", ["g,g\n", ",s,g,g\n"])
def test_row_of_units_that_is_shifted_by_a_cell_is_put_right(read: Read, units: str) -> None:
    log = read("time,front,rear\n" + units + table(SECONDS, FRONT, REAR))
    check(log)
    assert log.channel("rear").unit == "g"


def test_row_of_units_that_does_not_fit_is_not_used(read: Read) -> None:
    log = read("time,front,rear\nmm,g,s\n" + table(SECONDS, FRONT, REAR))
    check(log, unit="")
    assert "the row of units does not fit the names and is not used" in log.warnings


def test_units_row_is_trusted_for_the_time(read: Read) -> None:
    ticks = [5 * row for row in range(400)]
    check(read("time,front\nms,g\n" + table(ticks, FRONT)))
    assert read("time,front\ns,g\n" + table(ticks, FRONT)).channels[0].rate == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("name", "scale"), [("millis", 1e3), ("time_us", 1e6), ("timestamp", 1e3), ("Time", 1e6)]
)
def test_unit_of_time_in_the_name_or_by_the_rate(read: Read, name: str, scale: float) -> None:
    ticks = [round(scale * one) + 123_456 for one in TIME.tolist()]
    log = read(f"front,{name}\n" + table(FRONT, ticks))
    check(log, unit="")
    assert bool(log.warnings) == (name in ("timestamp", "Time"))


def test_time_of_day_across_midnight(read: Read) -> None:
    clock = [f"2025-06-01 {h}" for h in ("23:59:59.990", "23:59:59.995", "00:00:00.000")]
    log = read("datetime,front\n" + table(clock, [1, 2, 3]))
    np.testing.assert_allclose(log.channel("front").time, [0, 0.005, 0.01], atol=1e-9)


def test_lap_time_is_no_time(read: Read) -> None:
    lap = [f"{one % 0.7:.3f}" for one in TIME.tolist()]
    log = read("Lap Time,Time,front\n" + table(lap, SECONDS, FRONT))
    check(log, unit="")
    assert log.names == ("Lap Time", "front")


def test_rate_of_the_user_of_the_file_and_the_stamps(read: Read) -> None:
    rows = table(FRONT, REAR)
    with pytest.raises(InputError, match=r"log.csv: has no column of time; give the sampling rate"):
        read("front,rear\n" + rows)
    for log in (
        read("front,rear\n" + rows, rate=200),
        read("# sample_rate = 200 Hz\nfront,rear\n" + rows),
        read("Sampling Rate,200 Hz\n\nfront,rear\n" + rows),
    ):
        check(log, unit="")
        assert log.channels[0].note == "time made from a rate of 200 Hz"
    both = read("# sample_rate = 100 Hz\nfront,rear\n" + rows, rate=200)
    check(both, unit="")
    assert "the file declares 100 Hz, but the given rate of 200 Hz is used" in both.warnings
    stamped = read("time,front\n" + table(SECONDS, FRONT), rate=400)
    check(stamped, unit="")
    assert "the time stamps give 200 Hz; the stamps are used" in stamped.warnings[-1]


def test_labels_of_the_arduino_plotter(read: Read) -> None:
    for form in ("t_ms:{} front:{} rear:{}", "t_ms: {}, front: {}, rear: {}", "t_ms={};front={}"):
        rows = zip([5 * row for row in range(400)], FRONT, REAR, strict=True)
        log = read("booting\n" + "".join(form.format(*row) + "\n" for row in rows))
        check(log, unit="")


def test_stamps_of_the_arduino_monitor(read: Read) -> None:
    for separator in (",", "\t", " "):
        clock = [f"23:59:{58 + second:06.3f}" for second in TIME.tolist() if second < 1.9]
        rows = table(FRONT[: len(clock)], REAR[: len(clock)], separator=separator).splitlines()
        log = read("\n".join(f"{one} -> {row}" for one, row in zip(clock, rows, strict=True)))
        np.testing.assert_array_equal(log.channel("column 2").values, FRONT[: len(clock)])
        np.testing.assert_allclose(log.channels[0].time, TIME[: len(clock)], atol=1e-6)
        assert "the time is that of the computer" in log.warnings[0]


def test_names_that_do_not_fit(read: Read) -> None:
    more = read("time,front,rear,note\n" + table(SECONDS, FRONT, REAR))
    check(more, unit="")
    assert more.warnings[0] == "the columns note have no cells"
    fewer = read("time,front\n" + table(SECONDS, FRONT, REAR))
    assert fewer.names == ("column 2", "column 3")
    assert "the line above the data does not name 3 columns" in fewer.warnings


def test_index_shows_a_lost_row(read: Read) -> None:
    keep = np.arange(400) != 7
    log = read("sample,front\n" + table(np.arange(400)[keep], FRONT[keep]), rate=200)
    np.testing.assert_allclose(log.channel("front").time, TIME[keep])


def test_empty_cells_give_a_channel_stamps_of_its_own(read: Read) -> None:
    slow = [cell if row % 10 == 0 else "" for row, cell in enumerate(map(str, REAR))]
    log = read("time [s],front [g],rear [g]\n" + table(SECONDS, FRONT, slow))
    check(log)
    assert log.channel("rear").rate == pytest.approx(20)
    np.testing.assert_array_equal(log.channel("rear").values, REAR[::10])


def test_text_and_broken_rows_are_left_out_with_a_warning(read: Read) -> None:
    lines = table(SECONDS, FRONT, ["ok"] * 400, REAR).splitlines()
    lines[50] = "0.250,1.2"  # cut
    lines[60] = "garbage"
    lines[399] = lines[399][:7]  # the power went
    log = read("time,front,state,rear\n" + "\n".join(lines))
    keep = np.delete(np.arange(400), [50, 60, 399])
    np.testing.assert_array_equal(log.channel("front").values, FRONT[keep])
    np.testing.assert_allclose(log.channel("front").time, TIME[keep])
    assert log.names == ("front", "rear")
    assert set(log.warnings) >= {
        "3 lines that are not a row of 4 cells were left out, the first is line 52",
        "columns of text were left out: state",
    }


def test_what_a_power_cut_leaves_behind(read: Read) -> None:
    rows = table(SECONDS, FRONT, REAR)
    check(read("time,front,rear\n" + rows + "\0" * 5000), unit="")
    cut = rows.encode()[: -len(rows.splitlines()[-1]) // 2]
    log = read("time,front,rear\n" + cut.decode() + "\0" * 5000)
    np.testing.assert_array_equal(log.channel("front").values, FRONT[: log.channels[0].time.size])
    assert log.channels[0].time.size >= 398


def test_zeros_of_a_damaged_card_spoil_their_cells_only(read: Read) -> None:
    lines = ("time,front,rear\n" + table(SECONDS, FRONT, REAR)).splitlines()
    lines[51] = lines[51].replace(str(FRONT[50]), "1.\0\0")
    log = read("\n".join(lines))
    keep = np.delete(np.arange(400), 50)
    np.testing.assert_array_equal(log.channel("front").values, FRONT[keep])
    np.testing.assert_array_equal(log.channel("rear").values, REAR)


def test_many_broken_rows_are_refused(read: Read) -> None:
    lines = table(SECONDS, FRONT, REAR).splitlines()
    lines[100:150] = [line.rsplit(",", 1)[0] for line in lines[100:150]]
    with pytest.raises(InputError, match=r"log.csv:102: does not have 3 cells .* like 50 of 400"):
        read("time,front,rear\n" + "\n".join(lines))


CLOCK = [f"12:00:{second:06.3f}" for second in TIME.tolist()]


@pytest.mark.parametrize(
    ("head", "columns", "separator", "names"),
    [
        ("LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\nChannels\t1\t\n"
         "Delta_X\t0.005\t\n***End_of_Header***\t\nX_Value\tfront\tComment\n",
         (SECONDS, FRONT), "\t", ("front",)),
        ("Datum;Uhrzeit;front (g)\n", (["01.06.2025"] * 400, CLOCK, FRONT), ";", ("front",)),
        ("GPS Time, Device Time, front, rear\n",
         (["Sun Jun 01 12:00:00 2025"] * 400, [f"01-Jun-2025 {one}" for one in CLOCK], FRONT, REAR),
         ", ", ("front", "rear")),
        ("ets Jun  8 2016 00:22:57\nrst:0x1 (POWERON_RESET),boot:0x13\nMPU6050 OK\ntime_s,front\n",
         (SECONDS, FRONT), ",", ("front",)),
        (",time,front\n", (range(400), SECONDS, FRONT), ",", ("column 1", "front")),
        ("sep=;\nZeit [s];front [g]\n", (SECONDS, FRONT), ";", ("front",)),
    ],
    ids=["LabVIEW", "German clock", "Torque", "ESP32 boot", "pandas", "Excel"],
)  # fmt: skip
def test_tables_of_other_programs(
    read: Read, head: str, columns: tuple[object, ...], separator: str, names: tuple[str, ...]
) -> None:
    log = read(head + table(*columns, separator=separator))
    assert log.names == names
    check(log, unit=log.channel("front").unit)


def test_names_that_repeat_get_a_source(read: Read) -> None:
    log = read("time,acc,acc\n" + table(SECONDS, FRONT, REAR))
    assert log.names == ("acc", "acc")
    np.testing.assert_array_equal(log.channel("acc", "no. 2").values, REAR)


def test_trailing_separators(read: Read) -> None:
    check(read("time,front\n" + table(SECONDS, FRONT, [""] * 400)), unit="")
    check(read("time,front,\n" + table(SECONDS, FRONT, [""] * 400)), unit="")


def test_header_as_a_remark(read: Read) -> None:
    log = read(
        "# recorded on Sunday\n# time front rear\n" + table(SECONDS, FRONT, REAR, separator=" ")
    )
    check(log, unit="")


@pytest.mark.parametrize("text", [
    "s", "m/s^2", "m/s²", "km/h", "°C", "deg/s", "N·m", "in/s2", "1/min", "Volts", "unix time",
    "kg*m^2", "%", "µT",
])  # fmt: skip
def test_units(text: str) -> None:
    assert is_unit(text)


@pytest.mark.parametrize(
    "text", ["front", "a_x", "Ax", "GPS Speed", "", "12.5", "Susp Pos FL", "acc"]
)
def test_names_are_no_units(text: str) -> None:
    assert not is_unit(text)


@pytest.mark.parametrize(
    ("cell", "split"),
    [
        ("Acceleration x (m/s^2)", ("Acceleration x", "m/s^2", "")),
        ("Speed (m/s) *gps", ("Speed", "m/s", "gps")), ("pot [counts]", ("pot", "counts", "")),
        ("odd [what?]", ("odd", "what?", "")), ("Accel (front)", ("Accel (front)", "", "")),
        ("a / g", ("a", "g", "")), ("front/rear", ("front/rear", "", "")),
    ],
)  # fmt: skip
def test_unit_behind_a_name(cell: str, split: tuple[str, str, str]) -> None:
    assert split_unit(cell) == split


@given(st.text(alphabet='0123456789.,;:\t -+eE"#snax\n', max_size=400))
def test_any_text_is_a_log_or_an_error(text: str) -> None:
    try:
        log = bare.FORMAT.read(LogFile("file", text.encode(), 100.0))
    except InputError:
        return
    assert log.channels
