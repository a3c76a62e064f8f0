"""Formats of which no real file is at hand, on files made after the documented form of each."""

import gzip
import json
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.log import Log
from bayes_asv.io.formats import FORMATS, read_log
from tests.io.formats import made
from tests.io.formats.made import FRONT, RATE, REAR, TIME, TRAVEL

Read = Callable[..., Log]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    def read_bytes(data: bytes, rate: float | None = None, name: str = "log.dat") -> Log:
        path = tmp_path / name
        path.write_bytes(data)
        return read_log(path, rate)

    return read_bytes


def check(
    log: Log, name: str, unit: str, values: NDArray[Any], time: NDArray[Any] = TIME,
    source: str | None = None, within: float = 1e-12,
) -> None:  # fmt: skip
    """Compare one channel with the signal that was put in; stamps count from the first."""
    channel = log.channel(name, source)
    assert channel.unit == unit
    np.testing.assert_allclose(channel.values, values, rtol=0, atol=within)
    np.testing.assert_allclose(channel.time, time, rtol=0, atol=1e-6)


def test_motec_csv(read: Read) -> None:
    log = read(made.motec_csv())
    assert log.format == "MoTeC CSV"
    assert log.names == ("Time", "Susp Pos FL", "G Force Vert", "Bat Volts")
    check(log, "Susp Pos FL", "mm", TRAVEL)
    check(log, "G Force Vert", "G", FRONT)
    check(log, "Time", "min", TIME / 60, within=1e-5)  # the second column of that name
    assert dict(log.metadata)["Venue"] == "Calder"
    assert dict(log.metadata)["End Time"] == "2.000 s"
    assert "one common rate" in log.warnings[0]


@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", ","), ("\t", ",")])
def test_aim_csv(read: Read, separator: str, decimal: str) -> None:
    log = read(made.aim_csv(separator, decimal))
    assert log.format == "AiM Race Studio CSV"
    assert log.names == ("LateralAcc", "RL Susp Pot", "Logger Temp")
    check(log, "LateralAcc", "g", FRONT)
    check(log, "RL Susp Pot", "mm", TRAVEL)
    assert log.channel("Logger Temp").unit == "°C"
    assert dict(log.metadata)["User"] == "Ä"


def test_racechrono_2(read: Read) -> None:
    log = read(made.racechrono_v2())
    assert log.format == "RaceChrono CSV"
    check(log, "Z acc", "G", FRONT, source="acc")
    check(log, "Speed", "m/s", 20 + TIME[::20], TIME[::20], "gps", within=0.006)
    check(log, "Speed", "m/s", 19 + TIME[::40], TIME[::40], "obd", within=0.06)
    assert dict(log.metadata)["start"] == "2021-05-14T13:46:40.000+00:00"


def test_racecapture(read: Read) -> None:
    log = read(made.racecapture())
    assert log.format == "RaceCapture log"
    check(log, "AccelZ", "G", FRONT)
    check(log, "FL", "mm", TRAVEL[::4], TIME[::4])
    check(log, "Battery", "Volts", np.array([13.8, 13.8]), np.array([0.0, 1.0]))


def test_racecapture_repeats_its_header(read: Read) -> None:
    data = made.racecapture()
    header, rows = data.split(b"\n", 1)
    later = rows.split(b"\n")
    log = read(b"\n".join([header, *later[:200], header, *later[200:]]))
    check(log, "AccelZ", "G", FRONT)
    other = header.replace(b"AccelZ", b"AccelX")
    with pytest.raises(InputError, match="runs with different channels; split it"):
        read(b"\n".join([header, *later[:200], other, *later[200:]]))


@pytest.mark.parametrize(
    ("separator", "decimal"), [(",", "."), (";", ","), ("\t", "."), ("\t", ",")]
)
def test_phyphox(read: Read, separator: str, decimal: str) -> None:
    log = read(made.phyphox(separator, decimal))
    assert log.format == "phyphox CSV"
    check(log, "Acceleration z", "m/s^2", FRONT)


def test_phyphox_zip(read: Read) -> None:
    log = read(made.phyphox_zip())
    check(log, "Acceleration z", "m/s^2", FRONT, source="Accelerometer")
    check(log, "Gyroscope y", "rad/s", REAR[::2], TIME[::2], "Gyroscope")
    assert ("deviceModel", "Pixel 7") in log.metadata


def test_gcdc_counts_become_g(read: Read) -> None:
    log = read(made.gcdc())
    assert log.format == "GCDC CSV"
    check(log, "Ax", "g", FRONT, within=0.5 / 2048)
    check(log, "Ay", "g", REAR, within=0.5 / 2048)
    assert dict(log.metadata)["Start_time"] == "2017-06-15, 09:00:06.461"


def test_gcdc_of_unknown_sensitivity_stays_in_counts(read: Read) -> None:
    log = read(made.gcdc().replace(b"X16-1D", b"X2-2"))
    check(log, "Ax", "counts", np.round(2048 * FRONT))


def test_gcdc_with_sensitivities_and_short_rows(read: Read) -> None:
    log = read(made.gcdc_ham())
    check(log, "Ax", "g", FRONT, within=0.0006)
    check(log, "Gx", "dps", REAR, within=0.06)
    check(log, "P", "", np.full(40, 98405.0), TIME[::10])
    assert log.warnings == ()


@pytest.mark.parametrize("column", [0, 1, 5])
def test_a_number_that_overflows_is_missing(read: Read, column: int) -> None:
    lines = made.vbox().decode("latin-1").split("\n")
    row = next(k for k, line in enumerate(lines) if line.strip() == "[data]") + 5
    cells = lines[row].split()
    cells[column] = "1e999"
    lines[row] = " ".join(cells)
    whole, damaged = read(made.vbox()), read("\n".join(lines).encode("latin-1"))
    assert 0 <= whole.channels[0].values.size - damaged.channels[0].values.size <= 1


def test_vbox(read: Read) -> None:
    log = read(made.vbox())
    assert log.format == "VBOX"
    assert log.names == ("sats", "lat", "long", "velocity", "Vert_Acc", "FL_Pot")
    check(log, "Vert_Acc", "G", FRONT)
    check(log, "FL_Pot", "mm", TRAVEL)
    check(log, "velocity", "kmh", 40 + TIME, within=0.0006)  # across midnight
    assert log.channel("lat").unit == ""
    assert log.warnings == ("1 rows that repeat the row before were left out",)
    assert ("Serial", "013449") in log.metadata


def test_picoquake_count_shows_a_lost_sample(read: Read) -> None:
    keep = np.arange(400) != 50
    check(read(made.picoquake()), "a_x", "g", FRONT[keep], TIME[keep])


def test_own_recording_with_other_columns(read: Read) -> None:
    log = read(made.recording())
    assert log.format == "bayes_asv CSV"
    check(log, "front_wheel", "g", FRONT)
    check(log, "pot FL", "mm", TRAVEL)


def test_own_logger_text(read: Read) -> None:
    log = read(made.logger_text())
    assert log.format == "bayes_asv logger text"
    rows = np.delete(np.arange(50), 20)
    check(log, "front_wheel", "counts", rows % 7, rows / 200)
    with pytest.raises(InputError, match="rate"):
        read(made.logger_text().split(b"\n", 1)[1])


def test_sufni_4(read: Read) -> None:
    log = read(made.sufni_v4())
    check(log, "fork", "counts", np.round(100 + 5 * TRAVEL))
    check(log, "shock", "counts", np.round(100 + 5 * TRAVEL) + 7)
    check(log, "az", "g", FRONT[::2], TIME[::2], "fork", within=0.5 / 2048)
    check(log, "gx", "deg/s", REAR[::2], TIME[::2], "fork", within=0.5 / 16.4)
    assert dict(log.metadata)["start"] == "2023-11-14T22:13:20.000+00:00"


def test_motec_ld(read: Read) -> None:
    log = read(made.motec_ld())
    expected = (np.round(10 * TRAVEL) / 2 / 10 + 5) * 2
    check(log, "Susp Pos FL", "mm", expected)
    check(log, "G Force Vert", "G", FRONT[::4], TIME[::4], within=1e-6)


def test_motec_ld_with_a_circle_of_channels_is_refused(read: Read) -> None:
    data = bytearray(made.motec_ld())
    data[0x3448 + 4 : 0x3448 + 8] = (0x3448).to_bytes(4, "little")
    with pytest.raises(InputError, match="damaged list of channels"):
        read(bytes(data))


@pytest.mark.parametrize("compressed", [False, True])
def test_aim_xrk(read: Read, compressed: bool) -> None:
    pytest.importorskip("libxrk")
    data = made.aim_xrk()
    log = read(zlib.compress(data) if compressed else data)
    assert log.format == "AiM .xrk"
    check(log, "RL Susp Pot", "mm", TRAVEL.astype(np.float32))


def test_mdf(read: Read, tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as mdf:
        fast = [
            asammdf.Signal(FRONT, TIME, name="acc_fl", unit="g"),
            asammdf.Signal(
                np.round(10 * TRAVEL).astype("i2"), TIME, name="pot_fl", unit="mm",
                conversion={"a": 0.1, "b": 5.0},
            ),
        ]  # fmt: skip
        mdf.append(fast, acq_name="fast")
        mdf.append([asammdf.Signal(REAR[::4], TIME[::4], name="acc_rl", unit="g")], acq_name="slow")
        path = mdf.save(tmp_path / "made.mf4")
    log = read(Path(path).read_bytes())
    assert log.format == "MDF"
    check(log, "acc_fl", "g", FRONT, source="fast")
    check(log, "pot_fl", "mm", np.round(10 * TRAVEL) * 0.1 + 5, source="fast", within=1e-9)
    check(log, "acc_rl", "g", REAR[::4], TIME[::4], "slow")


def test_tdms_with_a_channel_of_time(read: Read, tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(tmp_path / "made.tdms") as writer:
        writer.write_segment(
            [
                nptdms.ChannelObject("run", "Time", TIME * 1000, {"unit_string": "ms"}),
                nptdms.ChannelObject("run", "FL", FRONT, {"unit_string": "g"}),
                nptdms.ChannelObject("alone", "RL", REAR, {"unit_string": "g"}),
            ]
        )
    data = (tmp_path / "made.tdms").read_bytes()
    log = read(data)
    check(log, "FL", "g", FRONT, source="run")
    assert log.names == ("FL",)
    assert log.warnings == ("channels without an increment or a channel of time were left out: RL",)
    check(read(data, rate=RATE), "RL", "g", REAR, source="alone")


def test_matlab_structures_and_rates(read: Read, tmp_path: Path) -> None:
    scipy_io = pytest.importorskip("scipy.io")
    scipy_io.savemat(tmp_path / "made.mat", {
        "Susp_Pos_FL": {"Time": TIME, "Value": TRAVEL, "Units": "mm"},  # as MoTeC exports it
        "run": {"fs": RATE, "acc": np.column_stack([FRONT, REAR])},
        "mass": 287.0,
    })  # fmt: skip
    log = read((tmp_path / "made.mat").read_bytes())
    check(log, "Susp_Pos_FL", "mm", TRAVEL)
    check(log, "acc[1]", "", FRONT, source="run")
    check(log, "acc[2]", "", REAR, source="run")
    assert len(log.channels) == 3


def test_matlab_without_time_needs_the_rate(read: Read, tmp_path: Path) -> None:
    scipy_io = pytest.importorskip("scipy.io")
    scipy_io.savemat(tmp_path / "made.mat", {"acc": FRONT})
    data = (tmp_path / "made.mat").read_bytes()
    with pytest.raises(InputError, match="no vector of time for acc; save a vector named time"):
        read(data)
    check(read(data, rate=RATE), "acc", "", FRONT)


def test_matlab_7_3(read: Read, tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "made.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["time"] = TIME[None, :]
        file["front"] = FRONT[None, :]
        file["pot/value"] = TRAVEL[None, :]
        file["pot/units"] = np.array([[ord("m")], [ord("m")]], dtype="u2")
        file["pot/units"].attrs["MATLAB_class"] = np.bytes_("char")
    data = bytearray(path.read_bytes())
    data[:128] = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    log = read(bytes(data))
    assert log.format == "MATLAB 7.3 .mat"
    check(log, "front", "", FRONT)
    check(log, "pot", "mm", TRAVEL)


def ros_messages(store: Any) -> list[tuple[int, Any]]:
    """Accelerations of an IMU, each logged 3 ms after its header's stamp, ns."""
    Imu = store.types["sensor_msgs/msg/Imu"]
    Header, Time = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    Vector, Quaternion = (
        store.types["geometry_msgs/msg/Vector3"],
        store.types["geometry_msgs/msg/Quaternion"],
    )
    nine = np.zeros(9)
    result = []
    for row, value in enumerate(FRONT.tolist()):
        stamp = 1_700_000_000_000_000_000 + 5_000_000 * row
        second, rest = divmod(stamp, 1_000_000_000)
        extra = {"seq": row} if "seq" in Header.__dataclass_fields__ else {}
        header = Header(stamp=Time(sec=second, nanosec=rest), frame_id="frame", **extra)
        message = Imu(
            header=header, orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=nine, angular_velocity=Vector(x=0.0, y=value, z=0.0),
            angular_velocity_covariance=nine,
            linear_acceleration=Vector(x=0.0, y=0.0, z=9.81 + value),
            linear_acceleration_covariance=nine,
        )  # fmt: skip
        result.append((stamp + 3_000_000 + (row % 3) * 1_000_000, message))
    return result


def check_imu(log: Log) -> None:
    """The stamps of the headers are even although the log's are not."""
    check(log, "linear_acceleration.z", "", 9.81 + FRONT, source="/imu")
    check(log, "angular_velocity.y", "", FRONT, source="/imu")


def test_ros_bag(tmp_path: Path) -> None:
    rosbag1, typesys = (
        pytest.importorskip("rosbags.rosbag1"),
        pytest.importorskip("rosbags.typesys"),
    )
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
    path = tmp_path / "made.bag"
    with rosbag1.Writer(path) as bag:
        connection = bag.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
        for logged, message in ros_messages(store):
            bag.write(connection, logged, store.serialize_ros1(message, "sensor_msgs/msg/Imu"))
    log = read_log(path)
    assert log.format == "ROS bag"
    check_imu(log)


@pytest.mark.parametrize("plugin", ["sqlite3", "mcap"])
def test_ros_2_bag(tmp_path: Path, plugin: str) -> None:
    rosbag2, typesys = (
        pytest.importorskip("rosbags.rosbag2"),
        pytest.importorskip("rosbags.typesys"),
    )
    pytest.importorskip("mcap_ros2")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    storage = {"sqlite3": rosbag2.StoragePlugin.SQLITE3, "mcap": rosbag2.StoragePlugin.MCAP}[plugin]
    with rosbag2.Writer(tmp_path / "bag", version=9, storage_plugin=storage) as bag:
        connection = bag.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
        for logged, message in ros_messages(store):
            bag.write(connection, logged, store.serialize_cdr(message, "sensor_msgs/msg/Imu"))
    (path,) = (tmp_path / "bag").glob("*.db3" if plugin == "sqlite3" else "*.mcap")
    log = read_log(path)
    assert log.format == {"sqlite3": "ROS 2 bag", "mcap": "MCAP"}[plugin]
    check_imu(log)


def test_mcap_json_and_an_unknown_encoding(tmp_path: Path) -> None:
    writer_module = pytest.importorskip("mcap.writer")
    pytest.importorskip("mcap_protobuf")
    path = tmp_path / "made.mcap"
    with open(path, "wb") as stream:
        writer = writer_module.Writer(stream)
        writer.start()
        schema = writer.register_schema("pots", "jsonschema", b"{}")
        pots = writer.register_channel("/pots", "json", schema)
        other = writer.register_channel("/odd", "odd", schema)
        for row, value in enumerate(TRAVEL.tolist()):
            stamp = 5_000_000 * row
            data = json.dumps({"pot": {"fl": value, "rl": [value, 1]}, "note": "x"}).encode()
            writer.add_message(pots, stamp, data, stamp)
        writer.add_message(other, 0, b"?", 0)
        writer.finish()
    log = read_log(path)
    check(log, "pot.fl", "", TRAVEL, source="/pots")
    check(log, "pot.rl[0]", "", TRAVEL, source="/pots")
    assert log.warnings == ("topics in an unknown encoding were left out: /odd",)


def test_mcap_protobuf(tmp_path: Path) -> None:
    protobuf_writer = pytest.importorskip("mcap_protobuf.writer")
    timestamps = pytest.importorskip("google.protobuf.timestamp_pb2")
    path = tmp_path / "made.mcap"
    with open(path, "wb") as stream, protobuf_writer.Writer(stream) as writer:
        for row in range(10):
            message = timestamps.Timestamp(seconds=row, nanos=7)
            writer.write_message("/clock", message, log_time=row * 10_000_000, publish_time=0)
    log = read_log(path)
    check(log, "seconds", "", np.arange(10.0), np.arange(10) / 100, "/clock")


def test_missing_package_names_the_command(read: Read, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"needs the package nptdms; pip install 'bayes-asv\[form"):
        read(b"TDSm" + bytes(100))
    with pytest.raises(InputError, match=r"needs the package libxrk; pip install 'bayes-asv\[aim"):
        read(made.aim_xrk())
    assert {one.extra for one in FORMATS if one.needs} == {"formats", "aim"}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"\x89PNG\r\n\x1a\n" + bytes(100), "is not in a known format; export it as CSV"),
        (gzip.compress(made.arduino()), "is not in a known format"),
        (b"PK\x03\x04" + bytes(22) + b"\x13\0\0\0[Content_Types].xml", "not in a known format"),
        (b"no 1 table in here\n" * 20, "has no table of numbers"),
        (b"", "is empty"),
    ],
)
def test_other_files_are_refused(read: Read, data: bytes, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read(data)
