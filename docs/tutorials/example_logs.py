"""Write logs of a simulated car in the formats of five loggers: ``python example_logs.py motec``.

The car is that of ``car.toml``, beside this file, with a front damper at 80 % of its nominal rate.
It drives over two parking stops and over a bump.  Each logger adds what loggers add: gravity, the
axes of its sensors, sensors that are mounted upside down, readings of the damper in place of the
wheel, a clock of its own.  The tutorials show how to take that out again.
"""

from __future__ import annotations

import sys
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import bayes_asv as asv

Array = NDArray[np.float64]

HERE = Path(__file__).parent
RATE = 400.0  # Hz
GRAVITY = 9.80665  # m/s²
TILT = np.radians(20.0)  # of the box on the frame, nose down
ROADS = ("stops", "bump")


def drive(road: str, *channels: str, rate: float = RATE) -> list[Array]:
    """Simulate a drive and return the time, s, and the readings: g, mm and deg/s."""
    car = asv.read_vehicle(HERE / "car.toml")
    seconds = 3.0 if road == "stops" else 4.0
    run = asv.simulate(
        car,
        road,
        rate=rate,
        seconds=seconds,
        change={"c_f": 0.8},
        channels=channels or None,
        seed=5,
    )
    factor = {"m/s^2": 1.0 / GRAVITY}
    readings = zip(run.units, run.values, strict=True)
    return [run.time, *(factor.get(unit, 1.0) * values for unit, values in readings)]


def table(columns: Sequence[Array], forms: str) -> str:
    """Return rows of cells; ``forms`` has a format for each column, separated by blanks."""
    rows = zip(*columns, strict=True)
    return "\n".join(
        ",".join(f"{x:{form}}" for x, form in zip(row, forms.split(), strict=True)) for row in rows
    )


def arduino(road: str) -> None:
    """Write the table of a sketch: micros, one axis at three places and three axes on the frame."""
    time, front_wheel, front_frame, rear_wheel, rear_frame = drive(road)
    up = front_frame + 1.0  # an accelerometer at rest reads one g upward
    columns = [
        1e6 * time + 1_250_000.0,
        front_wheel + 1.0,
        np.sin(TILT) * up,
        0.0 * up + 0.01,
        np.cos(TILT) * up,
        rear_wheel + 1.03,
        -(rear_frame + 1.0),
    ]
    head = (
        "micros,acc_hub_front,acc_frame_front_x,acc_frame_front_y,acc_frame_front_z,"
        "acc_hub_rear,acc_frame_rear\n"
    )
    Path(f"esp32-{road}.csv").write_text(head + table(columns, ".0f .4f .4f .4f .4f .4f .4f"))


def motec(road: str) -> None:
    """Write an i2 export: hubs in G, damper potentiometers in mm, compression positive."""
    time, front_wheel, rear_wheel, front_travel, rear_travel = drive(
        road, "front_wheel", "rear_wheel", "front_travel", "rear_travel"
    )
    names = ["Time", "Acc Hub Front", "Acc Hub Rear", "Damper Pos Front", "Damper Pos Rear"]
    columns = [time, front_wheel, rear_wheel, 38.2 - 0.62 * front_travel, 41.5 - 0.7 * rear_travel]
    head = (
        f'"Format","MoTeC CSV File"\n"Venue","Car park"\n"Log Date","14/03/2026"\n'
        f'"Sample Rate","{RATE:.3f}","Hz"\n\n'
        + ",".join(f'"{name}"' for name in names)
        + '\n"s","G","G","mm","mm"\n\n'
    )
    rows = table(columns, ".4f .3f .3f .2f .2f")
    quoted = "\n".join(",".join(f'"{x}"' for x in row.split(",")) for row in rows.splitlines())
    Path(f"i2-{road}.csv").write_text(head + quoted + "\n")


def aim(road: str) -> None:
    """Write a Race Studio export: four accelerometers in g, gravity on the frame alone."""
    time, front_wheel, front_frame, rear_wheel, rear_frame = drive(road)
    names = ["Time", "Front_Hub_Acc", "Front_Chassis_Acc", "Rear_Hub_Acc", "Rear_Chassis_Acc"]
    columns = [time, front_wheel, front_frame + 1.0, rear_wheel, -rear_frame - 1.0]
    head = (
        '"Format","AIM CSV File"\n"Session","Parking stops"\n"Vehicle","Baja"\n'
        f'"Sample Rate","{RATE:.0f}"\n\n'
        + ",".join(f'"{name}"' for name in names)
        + '\n"s","g","g","g","g"\n\n'
    )
    Path(f"aim-{road}.csv").write_text(head + table(columns, ".4f .3f .3f .3f .3f") + "\n")


def racecapture(road: str) -> None:
    """Write a RaceCapture log: milliseconds, hubs at 200 Hz, the unit in the logger at 100 Hz."""
    channels = "front_wheel", "rear_wheel", "body_vertical", "body_pitch_rate"
    time, front_wheel, rear_wheel, body, pitch = drive(road, *channels, rate=200.0)
    head = (
        '"Interval"|"ms"|0|0|1,"HubFront"|"G"|-16.0|16.0|200,"HubRear"|"G"|-16.0|16.0|200,'
        '"AccelZ"|"G"|-3.0|3.0|100,"Pitch"|"Deg/Sec"|-120.0|120.0|100\n'
    )
    columns = [1e3 * time + 402.0, front_wheel, rear_wheel, body + 1.0, pitch]
    rows = table(columns, ".0f .3f .3f .3f .2f").splitlines()
    rows[1::2] = [",".join([*row.split(",")[:3], "", ""]) for row in rows[1::2]]
    Path(f"racecapture-{road}.log").write_text(head + "\n".join(rows) + "\n")


def phyphox(road: str) -> None:
    """Write the zip of a phone on the frame, and the table of a sketch on the hubs.

    Both were cut where somebody knocked on the frame, by eye: the phone's log begins 10 ms later.
    """
    channels = "front_wheel", "rear_wheel", "body_vertical", "body_pitch_rate"
    time, front_wheel, rear_wheel, body, pitch = drive(road, *channels, rate=200.0)
    hubs = table([1e3 * time, front_wheel + 1.0, rear_wheel + 1.0], ".2f .4f .4f")
    Path(f"hubs-{road}.csv").write_text("time_ms,acc_hub_front,acc_hub_rear\n" + hubs + "\n")
    zero, seconds = 0.0 * time, time - time[2]
    files = {  # x ahead, y left, z up: a turn about y is nose down
        "Accelerometer": ("Acceleration", "m/s^2", zero, zero, GRAVITY * (body + 1.0)),
        "Gyroscope": ("Gyroscope", "rad/s", zero, -np.radians(pitch), zero),
    }
    with zipfile.ZipFile(f"phone-{road}.zip", "w") as archive:
        for name, (quantity, unit, *axes) in files.items():
            head = ",".join(f'"{quantity} {axis} ({unit})"' for axis in "xyz")
            rows = table([x[2:] for x in (seconds, *axes)], ".6f .5f .5f .5f")
            archive.writestr(f"{name}.csv", f'"Time (s)",{head}\n{rows}\n')


LOGGERS: dict[str, Callable[[str], None]] = {
    "arduino": arduino,
    "motec": motec,
    "aim": aim,
    "racecapture": racecapture,
    "phyphox": phyphox,
}

if __name__ == "__main__":
    if sys.argv[1:] not in [[name] for name in LOGGERS]:
        sys.exit(f"python example_logs.py NAME, where NAME is one of {', '.join(LOGGERS)}")
    for each in ROADS:
        LOGGERS[sys.argv[1]](each)
