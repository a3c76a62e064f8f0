"""The whole way: a car, its sensors, emulated boards, radios, modem, cable, and the program.

The car is the rig's, which shares no code with the package. What comes out of `bayes-asv acquire`
goes into `bayes-asv estimate`, whose answer is held against the truth.
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
FINE = 4000.0  # Hz of the voltages that the converters see
AT = 24.0  # s of virtual time at which the drive begins: the run is armed well before
SPEED = 8.0
PPM = (35.0, -45.0, 20.0)
LB_S_IN = 175.126835  # N s/m
LB_S2_IN = 0.112984829  # kg m²


@dataclass(frozen=True)
class Came:
    """What the program said and wrote."""

    status: int
    said: str
    document: dict[str, Any]
    recording: Path


def command(*words: object) -> list[str]:
    return [sys.executable, "-m", "bayes_asv", *map(str, words)]


def acquired(port: object, folder: Path, *options: object) -> Came:
    """Run ``bayes-asv acquire`` as a process of its own."""
    recording, answer = folder / "run.csv", folder / "acquire.json"
    words = ("acquire", "--port", port, "-o", recording, "--json", answer, "--patience", 100)
    done = subprocess.run(
        command(*words, *options),
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=240,
        check=False,
    )
    assert "Traceback" not in done.stderr, done.stderr
    document = json.loads(answer.read_text()) if answer.exists() else {}
    return Came(done.returncode, done.stdout + done.stderr, document, recording)


def driven(folder: Path, seed: int) -> tuple[RigCar, Setup]:
    """A car over two parking stops, as voltages at the boards' inputs, and its vehicle file."""
    rng = np.random.default_rng([seed, 71])
    car = draw(baja(), rng, DECLARED)
    declared, adc = SensorSpec(), Adc()
    analogue = replace(draw_biases(declared, rng), delay=(0.0,) * 4, adc=None)
    run = drive(car, TERRAINS["stops"](seed), DEFAULT_SPEEDS["stops"], FINE, 2.6, analogue, seed)
    counts = np.array(adc.zero)[:, None] + run.channels / np.array(adc.scale)[:, None]
    inputs = write_inputs(folder / "voltages.csv", run.time, counts, AT)
    (folder / "car.toml").write_text(vehicle_toml(baja(), declared, DECLARED), encoding="utf-8")
    return car, Setup(seed=seed, ppm=PPM, loss=0.1, error_rate=1e-4, inputs=inputs)


def test_a_car_is_estimated_through_the_whole_way(tmp_path: Path) -> None:
    build_firmware()
    car, setup = driven(tmp_path, seed=3)
    scenario = system_2(setup).replace("speed 0", f"speed {SPEED}")
    with Terminal(scenario, tmp_path) as emulated:
        came = acquired(
            emulated.path, tmp_path,
            "--start", "--mode", "loop", "--pre", 240, "--frequency", 400,
        )  # fmt: skip
    assert came.status == 0, came.said
    assert came.document["verdict"] == "ok"
    assert came.document["reasons"] == []
    assert came.document["drift_ppm"] == pytest.approx(PPM[1] - PPM[0], abs=0.5)
    assert all(block["verified"] for block in came.document["blocks"])
    assert "triggered" in came.said
    assert read_recording(came.recording).values.shape[1] >= 800

    answer = tmp_path / "estimate.json"
    estimate = subprocess.run(
        command("estimate", came.recording, "-v", tmp_path / "car.toml", "--json", answer),
        capture_output=True, text=True, cwd=ROOT, timeout=300, check=False,
    )  # fmt: skip
    assert estimate.returncode == 0, estimate.stderr
    told = json.loads(answer.read_text())["parameters"]
    true = {"c_f": car.c_f / LB_S_IN, "c_r": car.c_r / LB_S_IN, "i": car.i / LB_S2_IN}
    for name, truth in true.items():
        # 99 % of a posterior that is close to normal in the logarithm.
        mean, sd = told[name]["mean"], told[name]["sd"]
        assert abs(np.log(truth / mean)) < 2.576 * sd / mean, (name, truth, told[name])
        assert sd / mean < 0.1  # it has learnt something
    assert told["c_f"]["unit"] == "lbf*s/in"


def check_gaps(came: Came) -> None:
    """Assert that what is missing in the recording is in its notes and in the reasons.

    A recording of one board alone is written, but no reader of recordings takes it.
    """
    assert came.document["verdict"] == "incomplete"
    lines = came.recording.read_text(encoding="utf-8").splitlines()
    notes = [line.removeprefix("# note = ") for line in lines if line.startswith("# note = ")]
    assert set(came.document["reasons"]) <= set(notes)
    rows = [line.split(",") for line in lines if not line.startswith("#")][1:]
    assert sum(cell != "" for row in rows for cell in row[1:]) < 4 * 800
    words = " ".join(came.document["reasons"])
    assert "did not come" in words or "nothing of" in words


def test_a_sensor_at_its_rail_ends_the_run_with_a_message(tmp_path: Path) -> None:
    build_firmware()
    inputs = [line for line in Setup().inputs if "slave_2.A1" not in line]
    setup = Setup(seed=4, inputs=(*inputs, "input slave_2.A1 counts=1023"))
    scenario = system_2(setup).replace("speed 0", f"speed {SPEED}")
    with Terminal(scenario, tmp_path) as emulated:
        came = acquired(emulated.path, tmp_path, "--start", "--frequency", 400)
    assert came.status == 3
    assert came.document["verdict"] == "refused"
    (reason,) = came.document["reasons"]
    assert "rear board (Slave 2) read 0 or 1023 ten times" in reason
    assert f"No recording was written: {reason}" in came.said
    assert not came.recording.exists()


@pytest.mark.parametrize("synch", ["six", "radio"])
def test_without_the_wire_the_boards_are_not_synchronised(tmp_path: Path, synch: str) -> None:
    """By wire the run is refused, in words that name the mend; by radio it is whole."""
    build_firmware()
    setup = Setup(seed=5, ppm=PPM, loss=0.1, extra=("at 0.05 cut synch",))
    scenario = system_2(setup).replace("speed 0", f"speed {SPEED}")
    with Terminal(scenario, tmp_path) as emulated:
        came = acquired(emulated.path, tmp_path, "--start", "--frequency", 800, "--synch", synch)
    if synch == "six":
        assert came.status == 3
        (reason,) = came.document["reasons"]
        assert "did not see the synchronisation pulse" in reason
        assert "--synch radio" in reason
        assert not came.recording.exists()
    else:
        assert came.status == 0, came.said
        assert came.document["drift_ppm"] == pytest.approx(PPM[1] - PPM[0], abs=3)


@pytest.mark.parametrize(
    ("action", "at", "words"),
    [
        ("reset slave_1 for 5 ms", 1500, "Slave 1) has lost the run"),
        ("reset slave_2 for 5 ms", 1500, "Slave 2) has lost the run"),
    ],
)
def test_a_board_that_is_reset_during_the_transfer_leaves_no_silent_gap(
    tmp_path: Path, action: str, at: int, words: str
) -> None:
    build_firmware()
    with (
        Emulated(system_2(Setup(seed=6, ppm=PPM, loss=0.1)), tmp_path) as emulated,
        Bridge(emulated, tmp_path, SPEED, actions=((at, action),)) as bridge,
    ):
        came = acquired(bridge.path, tmp_path, "--start", "--frequency", 800)
    assert came.status == 3, came.said
    assert any(words in reason for reason in came.document["reasons"]), came.said
    check_gaps(came)


def test_a_cable_that_is_pulled_costs_nothing(tmp_path: Path) -> None:
    build_firmware()
    setup = Setup(seed=7, ppm=PPM, loss=0.1)
    with (
        Emulated(system_2(setup), tmp_path) as emulated,
        Bridge(emulated, tmp_path, SPEED, actions=((1200, "unplug"), (4500, "unplug"))) as bridge,
    ):
        came = acquired(bridge.path, tmp_path, "--start", "--frequency", 800)
    assert came.status == 0, came.said
    assert "has gone" in came.said
    assert "is back" in came.said
    assert any("disconnected 2 times" in w for w in came.document["warnings"])
    assert read_recording(came.recording).values.shape == (4, 800)
    # The same bytes give the same recording.
    again = subprocess.run(
        command("acquire", "--replay", f"{came.recording}.raw", "-o", tmp_path / "again.csv"),
        capture_output=True, text=True, cwd=ROOT, timeout=60, check=False,
    )  # fmt: skip
    assert again.returncode == 0, again.stderr
    first, second = read_recording(came.recording), read_recording(tmp_path / "again.csv")
    assert np.array_equal(first.values, second.values)


def test_a_program_that_was_ended_goes_on_where_it_was(tmp_path: Path) -> None:
    """A laptop that shut down: what it had is in the raw file, and only the rest is fetched."""
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
        refused = acquired(bridge.path, tmp_path)
        assert refused.status == 2
        assert "--resume" in refused.said
        came = acquired(bridge.path, tmp_path, "--resume")
    assert came.status == 0, came.said
    assert read_recording(came.recording).values.shape == (4, 800)
    # The front block, over 3000 bytes, did not come again.
    assert raw.stat().st_size - held < 3600


def test_the_master_s_cable_serves_as_well(tmp_path: Path) -> None:
    build_firmware()
    scenario = system_1(Setup(seed=9, ppm=PPM, loss=0.1, error_rate=1e-4))
    with (
        Emulated(scenario, tmp_path) as emulated,
        Bridge(emulated, tmp_path, SPEED) as bridge,
    ):
        came = acquired(bridge.path, tmp_path, "--start", "--frequency", 200)
    assert came.status == 0, came.said
    assert came.document["sample_rate"] == "200 Hz"


def test_the_text_form_is_taken_until_every_row_came_twice_alike(tmp_path: Path) -> None:
    build_firmware()
    with (
        Emulated(system_2(Setup(seed=10, ppm=PPM)), tmp_path) as emulated,
        Bridge(emulated, tmp_path, 20.0) as bridge,
    ):
        came = acquired(bridge.path, tmp_path, "--start", "--frequency", 800, "--text")
    assert came.status == 0, came.said
    assert read_recording(came.recording).values.shape == (4, 800)
    assert came.document["drift_ppm"] == pytest.approx(PPM[1] - PPM[0], abs=0.5)


def test_a_logger_that_is_off_is_named(tmp_path: Path) -> None:
    build_firmware()
    setup = Setup(seed=11, extra=("at 0.01 block channel",))
    with (
        Emulated(system_2(setup), tmp_path) as emulated,
        Bridge(emulated, tmp_path, SPEED) as bridge,
    ):
        came = acquired(bridge.path, tmp_path, "--start", "--patience", 10)
    assert came.status == 3
    assert "no logger answers at this port" in came.said
