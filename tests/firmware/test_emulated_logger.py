"""`bayes-asv logger --emulated`: the acquisition without hardware."""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bayes_asv.acquire import emulator
from bayes_asv.acquire.emulator import PERIOD, build_firmware, default_drive, write_voltages
from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import read_vehicle
from bayes_asv.io import read_recording
from bayes_asv.shipped import shipped
from tests.firmware.logger import why_not

REASON = why_not()
ROOT = Path(__file__).parents[2]
VEHICLE = read_vehicle(shipped("vehicles", "baja2008.toml"))


@pytest.mark.skipif(REASON is not None, reason=str(REASON))
def test_printed_commands_give_a_recording(tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-m", "bayes_asv", "logger", "--emulated", "--speed", "4"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT,
    ) as logger:  # fmt: skip
        assert logger.stdout is not None
        lines = [logger.stdout.readline() for _ in range(5)]
        assert lines[0].startswith("The emulated logger is at /dev/")
        words = lines[2].split()[1:]  # the command to type, without the program's name
        assert words[:2] == ["acquire", "--port"]
        done = subprocess.run(
            [sys.executable, "-m", "bayes_asv", *words],
            cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False,
            env={"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin"},
        )  # fmt: skip
        emulator = subprocess.run(
            ["pgrep", "-P", str(logger.pid)], capture_output=True, text=True, check=False
        ).stdout.split()
        logger.terminate()
        assert logger.wait(timeout=20) == 0
    assert done.returncode == 0, done.stderr
    recording = read_recording(tmp_path / "run.csv")
    assert recording.values.shape[1] >= 800
    assert np.ptp(recording.values[:, :800], axis=1).min() > 60  # the car passed over its road
    (left,) = emulator
    deadline = time.monotonic() + 10.0
    while Path("/proc", left).exists() and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not Path("/proc", left).exists()  # no emulator is left behind


def test_readings_are_played_at_their_sample_times(tmp_path: Path) -> None:
    time_stamps = np.arange(400) / 4000.0
    values = np.array([100 * np.sin(40 * time_stamps + k) for k in range(4)])
    delays = (0.0, 0.0007, 0.0002, 0.0009)
    recording = Recording(
        time_stamps, values, ("in/s^2",) * 4,
        tuple((f"delay {name}", f"{delay} s") for name, delay in zip(
            ("front_wheel", "front_chassis", "rear_wheel", "rear_chassis"), delays, strict=True)),
    )  # fmt: skip
    lines, warning = write_voltages(recording, VEHICLE, tmp_path)
    assert warning == ""
    for k, line in enumerate(lines):
        path = line.split("file=")[1].split()[0]
        table = np.loadtxt(path, delimiter=",", skiprows=1)
        sensor = VEHICLE.sensor(CHANNELS[k])
        assert sensor.counts_scale is not None
        assert sensor.zero_counts is not None
        assert (np.diff(table[:, 0]) > 0).all()
        for turn in (0, 3):  # the drive is repeated
            at = PERIOD * turn + 0.001 + delays[k] + time_stamps[50]
            volts = np.interp(at, table[:, 0], table[:, 1])
            expected = sensor.zero_counts + 0.0254 * values[k, 50] / sensor.counts_scale
            assert volts == pytest.approx(expected, abs=1e-4)


def test_low_sample_rate_gives_a_warning(tmp_path: Path) -> None:
    recording = read_recording(ROOT / "data" / "recordings" / "stops-400hz.csv")
    _, warning = write_voltages(recording, VEHICLE, tmp_path)
    assert "interpolated linearly between rows at 400 Hz" in warning


def test_default_drive_has_no_delays() -> None:
    drive = default_drive(VEHICLE, 0)
    assert all(drive.get(f"delay {name}") == "0 s" for name in ("front_chassis", "rear_chassis"))


def test_sensor_without_scale_is_named(tmp_path: Path) -> None:
    bare = replace(VEHICLE.sensor("rear_wheel"), counts_scale=None)
    sensors = {**VEHICLE.sensors, "rear_wheel": bare}
    with pytest.raises(InputError, match="rear_wheel"):
        write_voltages(default_drive(VEHICLE, 0), replace(VEHICLE, sensors=sensors), tmp_path)


def test_installed_package_needs_a_checkout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(emulator, "FIRMWARE", tmp_path / "firmware")
    with pytest.raises(InputError, match="needs a source checkout"):
        build_firmware()


def test_missing_tool_is_named_with_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "shutil.which", lambda tool: None if tool == "avr-gcc" else f"/usr/bin/{tool}"
    )
    with pytest.raises(InputError, match=r"avr-gcc.* not installed.*apt-get install"):
        build_firmware()


def test_option_emulated_is_required() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "bayes_asv", "logger"],
        capture_output=True, text=True, cwd=ROOT, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "--emulated" in done.stderr
