"""Files of foreign formats, made after the documented form of each, with the signals in them.

All hold the same drive: 2 s at 200 Hz, or less where a format says so.
"""

from __future__ import annotations

import io
import struct
import zipfile
from pathlib import Path

import numpy as np

LOGS = Path(__file__).parents[4] / "shared" / "data" / "logs"
"""Files that real loggers wrote; they are not shipped."""

RATE = 200.0
TIME = np.arange(400) / RATE
FRONT = np.round(1.5 * np.sin(2 * np.pi * 3 * TIME), 4)  # g
REAR = np.round(-0.8 * np.cos(2 * np.pi * 2 * TIME), 4)  # g
TRAVEL = np.round(20 * np.sin(2 * np.pi * 1.5 * TIME), 2)  # mm


def table(*columns: object, separator: str = ",", decimal: str = ".", quote: str = "") -> str:
    """Return rows of numbers."""
    cells = [[quote + str(cell).replace(".", decimal) + quote for cell in one] for one in columns]  # type: ignore[attr-defined]
    return "".join(separator.join(row) + "\n" for row in zip(*cells, strict=True))


def numbers(values: object, form: str) -> list[str]:
    """Return each number in a format of `str.format`."""
    return [format(value, form) for value in np.asarray(values).tolist()]


SECONDS = numbers(TIME, ".3f")


def motec_csv() -> bytes:
    """MoTeC i2, "Export data as CSV": two blocks of keys side by side, `Time` twice."""
    lines = [
        '"Format","MoTeC CSV File",,,"Workbook",""', '"Venue","Calder",,,"Worksheet",""',
        '"Vehicle","11A",,,"Vehicle Desc",""', '"Device","ADL"', '"Comment","",,,"Session","2"',
        '"Log Date","23/11/2005",,,"Origin Time","0.000","s"',
        '"Sample Rate","200.000","Hz",,"End Time","2.000","s"', '"Beacon Markers","0.5"', "", "",
        '"Time","Time","Susp Pos FL","G Force Vert","Bat Volts"', '"s","min","mm","G","V"', "", "",
    ]  # fmt: skip
    rows = table(SECONDS, numbers(TIME / 60, ".5f"), TRAVEL, FRONT, [13.8] * 400, quote='"')
    return "\r\n".join([*lines, rows.replace("\n", "\r\n")]).encode("cp1252")


def aim_csv(separator: str = ",", decimal: str = ".") -> bytes:
    """AiM Race Studio: no blank line between keys and names, beacons one a cell."""
    head = [
        ["Format", "AIM CSV File"], ["Venue", "Fuji"], ["Vehicle", "SFJ"], ["User", "Ä"],
        ["Comment", "", ""], ["Date", "Sunday, March 10, 2024"], ["Sample Rate", "200"],
        ["Beacon Markers", "0.5", "1.5", "2.0"], ["Segment Times", "0:01.0"],
        ["Time", "LateralAcc", "RL Susp Pot", "Logger Temp"], ["s", "g", "mm", "°C"],
    ]  # fmt: skip
    lines = [separator.join(f'"{cell}"' for cell in row) for row in head]
    rows = table(
        SECONDS, FRONT, TRAVEL, [15.9] * 400, separator=separator, decimal=decimal, quote='"'
    )
    return ("\n".join(lines) + "\n\n" + rows).encode("cp1252")


def racechrono_v2() -> bytes:
    """RaceChrono CSV, version 2: names with units and sources, empty cells between updates."""
    head = (
        "This file is created using RaceChrono Pro v7.0.9 ( http://racechrono.com/ ).\n"
        'Format,2\nSession title,"Test"\nCreated,16/05/2021,18:06\n\n'
        "Time (s),Session fragment #,Lap #,Speed (m/s) *gps,Speed (m/s) *obd,Z acc (G) *acc\n"
    )
    gps = [cell if row % 20 == 0 else "" for row, cell in enumerate(numbers(20 + TIME, ".2f"))]
    obd = [cell if row % 40 == 0 else "" for row, cell in enumerate(numbers(19 + TIME, ".1f"))]
    stamps = numbers(1.6210e9 + TIME, ".3f")
    return (head + table(stamps, [0] * 400, [1] * 400, gps, obd, FRONT)).encode()


def racecapture() -> bytes:
    """RaceCapture log: sparse rows, the analogue channel at 50 Hz, the accelerometer at 200 Hz."""
    head = (
        '"Interval"|"ms"|0|0|1,"Utc"|"ms"|0|0|1,"Battery"|"Volts"|0.0|20.0|1,'
        '"AccelZ"|"G"|-3.0|3.0|200,"FL"|"mm"|0.0|100.0|50\n'
    )
    slow = [cell if row % 4 == 0 else "" for row, cell in enumerate(map(str, TRAVEL))]
    battery = [13.8 if row % 200 == 0 else "" for row in range(400)]
    ticks = [int(402 + 5 * row) for row in range(400)]
    return (head + table(ticks, [0] * 400, battery, FRONT, slow)).encode()


def phyphox(separator: str = ",", decimal: str = ".") -> bytes:
    """phyphox: all in scientific notation, as the app writes it."""
    head = separator.join(f'"{cell}"' for cell in ("Time (s)", "Acceleration z (m/s^2)"))
    rows = table(
        numbers(TIME + 0.1, ".9E"), numbers(FRONT, ".9E"), separator=separator, decimal=decimal
    )
    return (head + "\n" + rows).encode()


def phyphox_zip() -> bytes:
    """Zip of phyphox: two sensors at rates of their own, and the folder of metadata."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("Accelerometer.csv", phyphox())
        half = table(numbers(TIME[::2], ".9E"), numbers(REAR[::2], ".9E"))
        archive.writestr("Gyroscope.csv", '"Time (s)","Gyroscope y (rad/s)"\n' + half)
        archive.writestr("meta/device.csv", '"property","value"\n"deviceModel","Pixel 7"\n')
    return buffer.getvalue()


def gcdc() -> bytes:
    """Gulf Coast Data Concepts X16: counts, the header in comments."""
    head = (
        ";Title, http://www.gcdataconcepts.com, X16-1D, Analog Dev ADXL345\n"
        ";Version, 1113, Build date, Jan  6 2016,  SN:CCDC1016B342233\n"
        ";Start_time, 2017-06-15, 09:00:06.461\n;Temperature, -999.00, deg C,  Vbat, 4138, mv\n"
        ";SampleRate, 200,Hz\n;Deadband, 0, counts\n;DeadbandTimeout, 5,sec\n"
        ";Headers, time,Ax,Ay,Az\n"
    )
    counts = (np.round(2048 * one).astype(int) for one in (FRONT, REAR, 1 + FRONT))
    return (head + table(SECONDS, *counts)).encode()


def gcdc_ham() -> bytes:
    """Gulf Coast Data Concepts HAM-IMU: a sensitivity each, pressure in every tenth row only."""
    head = (
        ";Title, http://www.gcdataconcepts.com, HAM-IMU+alt, MPU9250 BMP280\n"
        ";Version, 2108, Build date, Jan  1 2022,  SN:ABC122345F0420\n"
        ";Start_time, 2022-09-26, 08:13:29.030\n"
        ";MPU, SR (Hz), Sens (counts/unit), FullScale (units), Units\n"
        ";Accel, 225, 1000, 16, g\n;Gyro, 225, 10, 250, dps\n;BMP280 SI, 0.500,s\n"
        ";Time, Ax, Gx, P, T\n"
    )
    rows = [
        f"{stamp},{1000 * front:.0f},{10 * rear:.0f}" + (",98405,22431" if row % 10 == 0 else "")
        for row, (stamp, front, rear) in enumerate(zip(SECONDS, FRONT, REAR, strict=True))
    ]
    return (head + "\n".join(rows) + "\n").encode()


def vbox() -> bytes:
    """VBOX: units of the last channels alone, a repeated row, over midnight, in one line a row."""
    clock = 86399.0 + TIME
    stamps = []
    for seconds in clock.tolist():
        minutes, rest = divmod(seconds % 86400, 60)
        stamps.append(f"{int(minutes) // 60:02d}{int(minutes) % 60:02d}{rest:06.3f}")
    rows = table(
        ["012"] * 400, stamps, ["+2627.80326600"] * 400, ["+05279.38485600"] * 400,
        numbers(40 + TIME, "07.3f"), numbers(FRONT, "+.6E"), numbers(TRAVEL, "+.6E"), separator=" ",
    )  # fmt: skip
    lines = rows.splitlines()
    lines.insert(100, lines[99])
    return "\r\n".join([
        "File created on 01/08/2025 @ 14:00:12", "", "[header]", "satellites", "time", "latitude",
        "longitude", "velocity kmh", "Vert_Acc", "FL_Pot", "", "[channel units]", "G", "mm", "",
        "[comments]", "(c) Racelogic", "Serial : 013449", "", "[laptiming]",
        "Start  +4824.931740 +1527.272930 +4824.931760 +1527.275760 ¬ Start / Finish", "",
        "[column names]", "sats time lat long velocity Vert_Acc FL_Pot ", "", "[data]", *lines, "",
    ]).encode("cp1252")  # fmt: skip


def picoquake() -> bytes:
    """PicoQuake: rate in a comment, a count for the time, one sample lost."""
    head = (
        "# PLab PicoQuake Data\r\n# Time: 2024-04-21 15:54:46.333682, Device: D4E9\r\n"
        "# Config: data_rate = 200.0 Hz, filter = 42 Hz, acc_range = 4 g, gyro_range = 250 dps\r\n"
        "count,a_x,a_z,g_x\r\n"
    )
    keep = np.arange(400) != 50
    columns = (np.arange(400)[keep], FRONT[keep], REAR[keep], TRAVEL[keep])
    return (head + table(*columns).replace("\n", "\r\n")).encode()


def recording() -> bytes:
    """The project's own CSV, with a column that is none of its channels."""
    head = "# sample_rate = 200 Hz\ntime [s],front_wheel [g],rear_wheel [g],pot FL [mm]\n"
    return (head + table(SECONDS, FRONT, REAR, TRAVEL)).encode()


def logger_text() -> bytes:
    """The project's logger: index and four counts, one row lost."""
    rows = [f"{row + 1} {row % 7} 600 {row % 5} 500\n" for row in range(50) if row != 20]
    return ("# sample_rate = 200 Hz\n" + "".join(rows)).encode()


def arduino() -> bytes:
    """A sketch with `micros()` and tabs."""
    head = "micros\tax\tay\n"
    return (head + table([5000 * row for row in range(400)], FRONT, REAR, separator="\t")).encode()


def sufni_v4() -> bytes:
    """Sufni, version 4: chunks of rates, travel at 200 Hz and an inertial unit at 100 Hz."""

    def chunk(kind: int, data: bytes) -> bytes:
        return struct.pack("<BH", kind, len(data)) + data

    counts = np.round(100 + 5 * TRAVEL).astype("<u2")
    pairs = np.column_stack([counts, counts + 7]).astype("<u2")
    imu = np.zeros((200, 6), "<i2")
    imu[:, 2] = np.round(2048 * FRONT[::2])
    imu[:, 3] = np.round(16.4 * REAR[::2])
    return b"".join([
        b"SST\x04", bytes(4), struct.pack("<q", 1_700_000_000),
        chunk(0, struct.pack("<BHBH", 1, 200, 3, 100)),
        chunk(4, struct.pack("<Bff", 1, 2048, 16.4)),
        chunk(1, pairs[:250].tobytes()), chunk(3, imu.tobytes()), chunk(2, b""),
        chunk(1, pairs[250:].tobytes()),
    ])  # fmt: skip


def motec_ld() -> bytes:
    """MoTeC .ld of two channels: int16 with scaling at 200 Hz, float32 at 50 Hz."""
    first, second = 0x3448, 0x3448 + 124
    place = second + 124
    counts = np.round(10 * TRAVEL).astype("<i2")
    floats = FRONT[::4].astype("<f4")
    form = "<IIIIHHHHhhhh32s8s12s40x"
    header = bytearray(first)
    header[0:12] = struct.pack("<III", 0x40, 0, first)
    header[0x5E:0x68] = b"23/11/2005"
    return b"".join([
        header,
        # (raw / 2 · 10^-1 + 5) · 2
        struct.pack(form, 0, second, place, 400, 0x2EE1, 3, 2, 200, 5, 2, 2, 1,
                    b"Susp Pos FL", b"SuspFL", b"mm"),
        struct.pack(form, first, 0, place + 800, 100, 0x2EE2, 7, 4, 50, 0, 1, 1, 0,
                    b"G Force Vert", b"GVert", b"G"),
        counts.tobytes(), floats.tobytes(),
    ])  # fmt: skip


def aim_xrk() -> bytes:
    """AiM .xrk of one channel: messages of a configuration with one channel, then its samples."""

    def message(token: bytes, data: bytes) -> bytes:
        tag = token.ljust(4, b" ") if len(token) == 3 else token
        head = b"<h" + tag + struct.pack("<iB", len(data), 1) + b">"
        return head + data + b"<" + tag + struct.pack("<H", sum(data) & 0xFFFF) + b">"

    channel = bytearray(112)
    struct.pack_into("<H", channel, 0, 0)
    channel[12] = 12  # millimetres
    channel[20] = 6  # a 32-bit float
    channel[24:27] = b"RLP"
    channel[32:43] = b"RL Susp Pot"
    channel[72] = 4  # bytes a sample
    struct.pack_into("<I", channel, 64, 5000)  # microseconds between samples
    samples = b"".join(
        b"(S" + struct.pack("<iHf", 5 * row, 0, value) + b")"
        for row, value in enumerate(TRAVEL.tolist())
    )
    return message(b"CNF", message(b"CHS", bytes(channel))) + samples


def texts() -> dict[str, bytes]:
    """Made files of the formats that need no package, by the name of the format."""
    return {
        "MoTeC CSV": motec_csv(),
        "AiM Race Studio CSV": aim_csv(),
        "RaceChrono CSV": racechrono_v2(),
        "RaceCapture log": racecapture(),
        "phyphox CSV": phyphox(),
        "zip of CSV files, as phyphox writes": phyphox_zip(),
        "GCDC CSV": gcdc(),
        "VBOX": vbox(),
        "PicoQuake CSV": picoquake(),
        "bayes_asv CSV": recording(),
        "bayes_asv logger text": logger_text(),
        "table in text": arduino(),
        "Sufni SST": sufni_v4(),
        "MoTeC .ld": motec_ld(),
    }
