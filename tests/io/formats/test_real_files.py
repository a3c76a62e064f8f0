"""Files that real loggers wrote, against an independent way of reading each."""

import csv
import struct
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.log import Log
from bayes_asv.io.formats import read_log
from tests.io.formats.made import LOGS

pytestmark = pytest.mark.skipif(not LOGS.is_dir(), reason="the shared data are not here")


def read(name: str, rate: float | None = None) -> Log:
    return read_log(LOGS / name, rate)


def text_rows(name: str, separator: str) -> list[list[str]]:
    with open(LOGS / name, newline="") as file:
        return list(csv.reader(file, delimiter=separator))


def test_motec_ld() -> None:
    log = read("motec_sample1.ld")
    assert log.format == "MoTeC .ld"
    assert len(log.channels) == len(set(log.names)) == 78
    # The channels end together although each has its own rate: the layout is understood.
    assert {round(one.time.size / one.rate, 6) for one in log.channels} == {454.0}
    assert {round(one.rate) for one in log.channels} == {1, 2, 5, 10, 20, 50, 100}
    corners = [log.channel(f"Susp Pos {corner}") for corner in ("FL", "FR", "RL", "RR")]
    for one in corners:
        assert (one.unit, one.time.size) == ("mm", 45400)
        assert one.rate == pytest.approx(100)
        assert 20 < np.abs(one.values).max() < 60  # a suspension's travel
    # Values that a running race car must have.
    assert log.channel("Bat Volts ADL").values.mean() == pytest.approx(13.9, abs=0.2)
    assert 200 < log.channel("Ground Speed").values.max() < 300
    assert 6000 < log.channel("Engine RPM").values.max() < 9000
    assert 1.2 < np.abs(log.channel("G Force Lat").values).max() < 2.5
    assert ("venue", "Calder") in log.metadata
    assert log.warnings == ()


def test_motec_ld_agrees_with_the_record_of_one_channel() -> None:
    data = (LOGS / "motec_sample1.ld").read_bytes()
    record = data.index(b"Susp Pos RL\0") - 32
    start, count = struct.unpack_from("<II", data, record + 8)
    shift, multiplier, scale, decimals = struct.unpack_from("<hhhh", data, record + 24)
    raw = struct.unpack_from(f"<{count}h", data, start)
    expected = [(one / scale * 10.0**-decimals + shift) * multiplier for one in raw]
    np.testing.assert_allclose(read("motec_sample1.ld").channel("Susp Pos RL").values, expected)


def test_sufni() -> None:
    log = read("sufni_00648.SST")
    pairs = np.fromfile(LOGS / "sufni_00648.SST", "<u2", offset=16).reshape(-1, 2)
    assert log.names == ("fork", "shock")
    for channel, counts in zip(log.channels, pairs.T, strict=True):
        np.testing.assert_array_equal(channel.values, counts)
        assert channel.unit == "counts"
        assert channel.rate == pytest.approx(1000)
        assert channel.note == "time made from a rate of 1000 Hz"
    assert log.channels[0].time[-1] == pytest.approx(53.065)


def test_picoquake() -> None:
    log = read("picoquake_car_vibration.csv")
    rows = np.loadtxt(LOGS / "picoquake_car_vibration.csv", delimiter=",", skiprows=6)
    assert log.names == ("a_x", "a_y", "a_z", "g_x", "g_y", "g_z")
    assert [one.unit for one in log.channels] == ["g"] * 3 + ["deg/s"] * 3
    for channel, column in zip(log.channels, rows.T[1:], strict=True):
        np.testing.assert_array_equal(channel.values, column)
        np.testing.assert_allclose(channel.time, rows[:, 0] / 2000)


def test_bare_table_without_header_and_with_milliseconds_last() -> None:
    log = read("teensy_accelerometer.csv")
    rows = np.loadtxt(LOGS / "teensy_accelerometer.csv")
    assert log.names == ("column 1", "column 2", "column 3")
    for channel, column in zip(log.channels, rows.T, strict=False):
        np.testing.assert_array_equal(channel.values, column)
        np.testing.assert_allclose(channel.time, (rows[:, 3] - 50) / 1000)
    assert log.warnings == ("no unit of time is stated; ms is taken, as it gives 20 Hz",)


def test_bare_table_without_time_needs_the_rate() -> None:
    with pytest.raises(InputError, match=r"has no column of time; give the sampling rate"):
        read("stm32_suspension.csv")
    log = read("stm32_suspension.csv", rate=500)
    rows = text_rows("stm32_suspension.csv", ";")
    assert log.names == tuple(rows[0])
    np.testing.assert_array_equal(
        [one.values for one in log.channels], np.array(rows[1:], dtype=float).T
    )
    np.testing.assert_allclose(log.channels[0].time, np.arange(6000) / 500)
    assert {one.unit for one in log.channels} == {""}


def test_racechrono() -> None:
    log = read("racechrono_v3.csv")
    rows = text_rows("racechrono_v3.csv", ",")
    names, units, sources, data = rows[9], rows[10], rows[11], rows[12:]
    unique = [row for before, row in zip([[""], *data], data, strict=False) if row != before]
    assert len(data) - len(unique) == 73
    assert "73 rows that repeat the row before were left out" in log.warnings
    columns = np.array(unique, dtype=float).T
    assert list(log.names) == names[1:]
    assert [one.unit for one in log.channels] == units[1:]
    assert [one.source for one in log.channels] == sources[1:]
    for channel, column in zip(log.channels, columns[1:], strict=True):
        np.testing.assert_array_equal(channel.values, column)
        np.testing.assert_allclose(channel.time, columns[0] - columns[0, 0], atol=1e-6)
    # Names repeat; the source tells them apart.
    assert names.count("speed") == 3
    assert log.channel("speed", "200: obd").values[0] == 18.82739
    assert ("Track name", "Tianma") in log.metadata
    start = datetime.fromtimestamp(1767150797.44, UTC).isoformat(timespec="milliseconds")
    assert ("start", start) in log.metadata


def test_endaq() -> None:
    idelib = pytest.importorskip("idelib")
    log = read("endaq_SSX70065.IDE")
    dataset = idelib.importFile(str(LOGS / "endaq_SSX70065.IDE"), quiet=True)
    sensors = {one.name: one.getSession() for one in dataset.channels.values()}
    first = min(events[0][0] for events in sensors.values())
    assert {one.source for one in log.channels} == {"Acceleration", "Pressure/Temperature"}
    for row, (name, unit) in enumerate(
        [("Acceleration: X", "g"), ("Acceleration: Y", "g"), ("Acceleration: Z", "g")], 1
    ):
        channel, events = log.channel(name), sensors["Acceleration"]
        assert channel.unit == unit
        assert channel.values.size == len(events)
        for index in (0, 1000, len(events) - 1):
            assert channel.values[index] == events[index][row]
            assert channel.time[index] == pytest.approx((events[index][0] - first) * 1e-6)
    assert log.channel("Pressure").rate == pytest.approx(1.0, rel=0.01)
    assert log.channel("Acceleration: Z").rate == pytest.approx(3072, rel=0.001)
    dataset.close()


def test_tdms() -> None:
    nptdms = pytest.importorskip("nptdms")
    log = read("labview_raw1.tdms")
    group = nptdms.TdmsFile.read(LOGS / "labview_raw1.tdms")["Layer Data"]
    assert len(log.channels) == 7
    for channel, original in zip(log.channels, group.channels(), strict=True):
        assert channel.name.split() == original.name.split()
        assert (channel.unit, channel.source) == ("Volts", "Layer Data")
        np.testing.assert_array_equal(channel.values, original[:])
        np.testing.assert_allclose(channel.time, original.time_track())


def test_matlab() -> None:
    scipy_io = pytest.importorskip("scipy.io")
    log = read("suspension_project_1.mat")
    workspace = scipy_io.loadmat(LOGS / "suspension_project_1.mat")
    assert log.names == ("Vacc", "Vpos")
    for channel in log.channels:
        np.testing.assert_array_equal(channel.values, workspace[channel.name][:, 0])
        np.testing.assert_allclose(channel.time, workspace["time"][:, 0])


def test_recordings_of_the_project_are_logs_too() -> None:
    folder = Path(__file__).parents[3] / "data" / "recordings"
    log = read_log(folder / "bump-400hz.csv")
    rows = np.loadtxt(folder / "bump-400hz.csv", delimiter=",", skiprows=3)
    assert log.format == "bayes_asv CSV"
    assert log.names == ("front_wheel", "front_chassis", "rear_wheel", "rear_chassis")
    for channel, column in zip(log.channels, rows.T[1:], strict=True):
        assert channel.unit == "in/s^2"
        np.testing.assert_array_equal(channel.values, column)
    assert ("sample_rate", "400 Hz") in log.metadata
