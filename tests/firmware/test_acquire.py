"""End to end: a car, its sensors, emulated boards, radios, modem, cable, and the program.

The car is the rig's, which shares no code with the package. `bayes-asv estimate` reads the
recording that `bayes-asv acquire` wrote, and its estimate is compared with the truth.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bayes_asv.io import read_recording
from tests.firmware.bridge import Bridge
from tests.firmware.emulated import Emulated, Terminal
from tests.firmware.logger import why_not
from tests.firmware.scenarios import Setup, build_firmware, system_1, system_2, write_inputs
from tests.posterior.cases import DECLARED
from tests.rig import (
    DEFAULT_SPEEDS,
    TERRAINS,
    Adc,
    RigCar,
    SensorSpec,
    baja,
    draw,
    draw_biases,
    drive,
    vehicle_toml,
)

REASON = why_not()
pytestmark = pytest.mark.skipif(REASON is not None, reason=str(REASON))

ROOT = Path(__file__).parents[2]
VOLTAGE_RATE = 4000.0  # sample rate of the voltages at the converters, Hz
DRIVE_START = 24.0  # virtual time, s: the run is armed well before it
SPEED = 8.0
PPM = (35.0, -45.0, 20.0)
LB_S_IN = 175.126835  # N s/m
LB_S2_IN = 0.112984829  # kg m²


@dataclass(frozen=True)
class Result:
    """What the program printed and wrote."""

    status: int
    output: str
    document: dict[str, Any]
    recording: Path


def command(*words: object) -> list[str]:
    return [sys.executable, "-m", "bayes_asv", *map(str, words)]


def acquire(port: object, folder: Path, *options: object) -> Result:
    """Run ``bayes-asv acquire`` as a process of its own."""
    recording, document_path = folder / "run.csv", folder / "acquire.json"
    words = ("acquire", "--port", port, "-o", recording, "--json", document_path, "--patience", 100)
    done = subprocess.run(
        command(*words, *options),
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=240,
        check=False,
    )
    assert "Traceback" not in done.stderr, done.stderr
    document = json.loads(document_path.read_text()) if document_path.exists() else {}
    return Result(done.returncode, done.stdout + done.stderr, document, recording)


def prepare_drive(folder: Path, seed: int) -> tuple[RigCar, Setup]:
    """Write a drive over two parking stops as the boards' input voltages, and the vehicle file."""
    rng = np.random.default_rng([seed, 71])
    car = draw(baja(), rng, DECLARED)
    declared, adc = SensorSpec(), Adc()
    analogue = replace(draw_biases(declared, rng), delay=(0.0,) * 4, adc=None)
    run = drive(
        car, TERRAINS["stops"](seed), DEFAULT_SPEEDS["stops"], VOLTAGE_RATE, 2.6, analogue, seed
    )
    counts = np.array(adc.zero)[:, None] + run.channels / np.array(adc.scale)[:, None]
    inputs = write_inputs(folder / "voltages.csv", run.time, counts, DRIVE_START)
    (folder / "car.toml").write_text(vehicle_toml(baja(), declared, DECLARED), encoding="utf-8")
    return car, Setup(seed=seed, ppm=PPM, loss=0.1, error_rate=1e-4, inputs=inputs)


def test_estimate_of_an_acquired_run(tmp_path: Path) -> None:
    build_firmware()
    car, setup = prepare_drive(tmp_path, seed=3)
    scenario = system_2(setup).replace("speed 0", f"speed {SPEED}")
    with Terminal(scenario, tmp_path) as emulated:
        result = acquire(
            emulated.path, tmp_path,
            "--start", "--mode", "loop", "--pre", 240, "--frequency", 400,
        )  # fmt: skip
    assert result.status == 0, result.output
    assert result.document["verdict"] == "ok"
    assert result.document["reasons"] == []
    assert result.document["drift_ppm"] == pytest.approx(PPM[1] - PPM[0], abs=0.5)
    assert all(block["verified"] for block in result.document["blocks"])
    assert "triggered" in result.output
    assert read_recording(result.recording).values.shape[1] >= 800

    document_path = tmp_path / "estimate.json"
    estimate = subprocess.run(
        command("estimate", result.recording, "-v", tmp_path / "car.toml", "--json", document_path),
        capture_output=True, text=True, cwd=ROOT, timeout=300, check=False,
    )  # fmt: skip
    assert estimate.returncode == 0, estimate.stderr
    parameters = json.loads(document_path.read_text())["parameters"]
    true = {"c_f": car.c_f / LB_S_IN, "c_r": car.c_r / LB_S_IN, "i": car.i / LB_S2_IN}
    for name, truth in true.items():
        # 99 % of a posterior that is close to normal in the logarithm.
        mean, sd = parameters[name]["mean"], parameters[name]["sd"]
        assert abs(np.log(truth / mean)) < 2.576 * sd / mean, (name, truth, parameters[name])
        assert sd / mean < 0.1  # the data are informative
    assert parameters["c_f"]["unit"] == "lbf*s/in"


def check_gaps(result: Result) -> None:
    """Assert that the notes and the reasons name what is missing in the recording.

    The file is read as text because `read_recording` refuses a recording of one board alone.
    """
    assert result.document["verdict"] == "incomplete"
    lines = result.recording.read_text(encoding="utf-8").splitlines()
    notes = [line.removeprefix("# note = ") for line in lines if line.startswith("# note = ")]
    assert set(result.document["reasons"]) <= set(notes)
    rows = [line.split(",") for line in lines if not line.startswith("#")][1:]
    assert sum(cell != "" for row in rows for cell in row[1:]) < 4 * 800
    words = " ".join(result.document["reasons"])
    assert "not received" in words or "nothing of" in words


def test_saturated_sensor_ends_the_run(tmp_path: Path) -> None:
    build_firmware()
    inputs = [line for line in Setup().inputs if "slave_2.A1" not in line]
    setup = Setup(seed=4, inputs=(*inputs, "input slave_2.A1 counts=1023"))
    scenario = system_2(setup).replace("speed 0", f"speed {SPEED}")
    with Terminal(scenario, tmp_path) as emulated:
        result = acquire(emulated.path, tmp_path, "--start", "--frequency", 400)
    assert result.status == 3
    assert result.document["verdict"] == "refused"
    (reason,) = result.document["reasons"]
    assert "rear board (Slave 2) read 0 or 1023 ten times" in reason
    assert f"No recording was written: {reason}" in result.output
    assert not result.recording.exists()


@pytest.mark.parametrize("synch", ["six", "radio"])
def test_broken_synchronisation_wire(tmp_path: Path, synch: str) -> None:
    """By wire the run is refused and the message names the remedy; by radio it is complete."""
    build_firmware()
    setup = Setup(seed=5, ppm=PPM, loss=0.1, extra=("at 0.05 cut synch",))
    scenario = system_2(setup).replace("speed 0", f"speed {SPEED}")
    with Terminal(scenario, tmp_path) as emulated:
        result = acquire(emulated.path, tmp_path, "--start", "--frequency", 800, "--synch", synch)
    if synch == "six":
        assert result.status == 3
        (reason,) = result.document["reasons"]
        assert "did not see the synchronisation pulse" in reason
        assert "--synch radio" in reason
        assert not result.recording.exists()
    else:
        assert result.status == 0, result.output
        assert result.document["drift_ppm"] == pytest.approx(PPM[1] - PPM[0], abs=3)


@pytest.mark.parametrize(
    ("action", "at", "message"),
    [
        ("reset slave_1 for 5 ms", 1500, "Slave 1) has lost the run"),
        ("reset slave_2 for 5 ms", 1500, "Slave 2) has lost the run"),
    ],
)
def test_board_reset_during_the_transfer_is_reported(
    tmp_path: Path, action: str, at: int, message: str
) -> None:
    build_firmware()
    with (
        Emulated(system_2(Setup(seed=6, ppm=PPM, loss=0.1)), tmp_path) as emulated,
        Bridge(emulated, tmp_path, SPEED, actions=((at, action),)) as bridge,
    ):
        result = acquire(bridge.path, tmp_path, "--start", "--frequency", 800)
    assert result.status == 3, result.output
    assert any(message in reason for reason in result.document["reasons"]), result.output
    check_gaps(result)


def test_unplugged_cable_loses_no_data(tmp_path: Path) -> None:
    build_firmware()
    setup = Setup(seed=7, ppm=PPM, loss=0.1)
    with (
        Emulated(system_2(setup), tmp_path) as emulated,
        Bridge(emulated, tmp_path, SPEED, actions=((1200, "unplug"), (4500, "unplug"))) as bridge,
    ):
        result = acquire(bridge.path, tmp_path, "--start", "--frequency", 800)
    assert result.status == 0, result.output
    assert "has gone" in result.output
    assert "is back" in result.output
    assert any("disconnected 2 times" in w for w in result.document["warnings"])
    assert read_recording(result.recording).values.shape == (4, 800)
    # The same bytes give the same recording.
    again = subprocess.run(
        command("acquire", "--replay", f"{result.recording}.raw", "-o", tmp_path / "again.csv"),
        capture_output=True, text=True, cwd=ROOT, timeout=60, check=False,
    )  # fmt: skip
    assert again.returncode == 0, again.stderr
    first, second = read_recording(result.recording), read_recording(tmp_path / "again.csv")
    assert np.array_equal(first.values, second.values)


def test_interrupted_transfer_is_resumed(tmp_path: Path) -> None:
    """The raw file holds what came before the program was killed; only the rest is fetched."""
    build_firmware()
    with (
        Emulated(system_2(Setup(seed=8, ppm=PPM)), tmp_path) as emulated,
        Bridge(emulated, tmp_path, SPEED) as bridge,
    ):
        words = ("acquire", "--port", bridge.path, "-o", tmp_path / "run.csv")
        raw = tmp_path / "run.csv.raw"
        with subprocess.Popen(
            command(*words, "--start", "--frequency", 800),
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=ROOT,
        ) as process:  # fmt: skip
            while not raw.exists() or raw.stat().st_size < 4500:  # in the rear board's block
                assert process.poll() is None
                process.poll()
            process.kill()
        held = raw.stat().st_size
        refused = acquire(bridge.path, tmp_path)
        assert refused.status == 2
        assert "--resume" in refused.output
        result = acquire(bridge.path, tmp_path, "--resume")
    assert result.status == 0, result.output
    assert read_recording(result.recording).values.shape == (4, 800)
    # The front block, over 3000 bytes, did not come again.
    assert raw.stat().st_size - held < 3600


def test_transfer_through_the_master_board(tmp_path: Path) -> None:
    build_firmware()
    scenario = system_1(Setup(seed=9, ppm=PPM, loss=0.1, error_rate=1e-4))
    with (
        Emulated(scenario, tmp_path) as emulated,
        Bridge(emulated, tmp_path, SPEED) as bridge,
    ):
        result = acquire(bridge.path, tmp_path, "--start", "--frequency", 200)
    assert result.status == 0, result.output
    assert result.document["sample_rate"] == "200 Hz"


def test_text_transfer_reads_every_row_twice(tmp_path: Path) -> None:
    build_firmware()
    with (
        Emulated(system_2(Setup(seed=10, ppm=PPM)), tmp_path) as emulated,
        Bridge(emulated, tmp_path, 20.0) as bridge,
    ):
        result = acquire(bridge.path, tmp_path, "--start", "--frequency", 800, "--text")
    assert result.status == 0, result.output
    assert read_recording(result.recording).values.shape == (4, 800)
    assert result.document["drift_ppm"] == pytest.approx(PPM[1] - PPM[0], abs=0.5)


def test_logger_that_is_switched_off(tmp_path: Path) -> None:
    build_firmware()
    setup = Setup(seed=11, extra=("at 0.01 block channel",))
    with (
        Emulated(system_2(setup), tmp_path) as emulated,
        Bridge(emulated, tmp_path, SPEED) as bridge,
    ):
        result = acquire(bridge.path, tmp_path, "--start", "--patience", 10)
    assert result.status == 3
    assert "no logger answers at this port" in result.output
