"""Emulated logger, for users without hardware: the boards' firmware on simulated chips.

The emulator is a process of its own and is built from a source checkout (``firmware/emulator``).
This module writes its scenario and the voltages at its converters, and starts it.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import (
    Recording,
    acceleration_factor,
    accelerations,
    nominal_rate,
    sample_times,
)
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.simulation.roads import road
from bayes_asv.simulation.simulate import simulate

__all__ = [
    "PERIOD", "EmulatorOptions", "build_firmware", "default_drive", "scenario_text",
    "start_emulator", "write_voltages",
]  # fmt: skip

PINS: Final = ("slave_1.A0", "slave_1.A1", "slave_2.A0", "slave_2.A1")
"""Converter inputs in the order of the channels."""
PERIOD: Final = 12.0
"""Time from one drive over the road to the next, s."""
REPEATS: Final = 50

FIRMWARE: Final = Path(__file__).resolve().parents[2] / "firmware"
"""Folder of the firmware in a source checkout."""

_DRIVE_RATE: Final = 2000.0  # Hz: several times the logger's highest rate, linear in between
_MIN_RATE: Final = 1600.0  # Hz below which a recording gives a warning
_DRIVE_SECONDS: Final = 2.8
_OFFSET_SD: Final = 0.1  # m/s², of a sensor's reading at rest
_START: Final = 6.0  # s from switching on to the first drive
_TOOLS: Final = ("make", "gcc", "avr-gcc")
_HEADERS: Final = (("simavr/sim_avr.h", "libsimavr-dev"), ("libelf.h", "libelf-dev"))
_INCLUDES: Final = ("/usr/include", "/usr/local/include")


@dataclass(frozen=True)
class EmulatorOptions:
    """Options of an emulated logger.

    Parameters
    ----------
    seed : int
        Of all random numbers.
    loss : float
        Share of radio packets lost between the boards.
    errors : float
        Share of bits inverted between the modems.
    speed : float
        Simulated seconds per second.
    ppm : tuple of 2 float
        Crystal errors of Slave 1 and Slave 2.
    """

    seed: int = 0
    loss: float = 0.05
    errors: float = 1e-4
    speed: float = 1.0
    ppm: tuple[float, float] = (30.0, -20.0)


def build_firmware() -> Path:
    """Build firmware and emulator if they are out of date; return the folder ``firmware``.

    Raises
    ------
    InputError
        Without a source checkout or one of the tools, or if the build fails.
    """
    firmware = FIRMWARE
    if not (firmware / "emulator" / "Makefile").is_file():
        raise InputError(
            "logger --emulated",
            "needs a source checkout, and this is an installed package",
            "run it in a copy of the repository",
        )
    missing = [tool for tool in _TOOLS if shutil.which(tool) is None]
    missing += [
        package
        for header, package in _HEADERS
        if not any(Path(root, header).exists() for root in _INCLUDES)
    ]
    if missing:
        raise InputError(
            "logger --emulated",
            f"{', '.join(missing)} {'is' if len(missing) == 1 else 'are'} not installed",
            "on Debian: apt-get install make gcc gcc-avr avr-libc libsimavr-dev libelf-dev",
        )
    for folder, target in ((firmware, "all"), (firmware / "emulator", "emulator")):
        result = subprocess.run(
            ["make", "-s", "-C", str(folder), target], capture_output=True, text=True, check=False
        )
        if result.returncode:
            last = (result.stderr or result.stdout).strip().splitlines()[-1:] or ["no message"]
            raise InputError(f"make -C {folder.name} {target}", f"failed: {last[0]}", "see make")
    return firmware


def default_drive(vehicle: Vehicle, seed: int) -> Recording:
    """Simulate the nominal car over two parking stops, as voltages without delays and steps.

    The converters add both. Every sensor has a small random offset, as mounted sensors do: at rest
    exactly between two counts its quantisation error would not look like noise of q²/12.
    """
    bare = replace(
        vehicle,
        sensors={
            name: replace(s, delay=0.0, resolution=None, zero_counts=None, counts_scale=None)
            for name, s in vehicle.sensors.items()
        },
    )
    rng = np.random.default_rng([seed, 0])
    drive = simulate(
        bare, road("stops", rng), rate=_DRIVE_RATE, seconds=_DRIVE_SECONDS, seed=seed
    ).recording
    offsets = [_OFFSET_SD * rng.standard_normal() / acceleration_factor(unit, "drive")
              for unit in drive.units]  # fmt: skip
    no_delays = tuple((f"delay {channel}", "0 s") for channel in CHANNELS)
    return replace(
        drive,
        values=drive.values + np.array(offsets)[:, None],
        metadata=(*drive.metadata, *no_delays),
    )


def write_voltages(recording: Recording, vehicle: Vehicle, folder: Path) -> tuple[list[str], str]:
    """Write the voltages at the converters, a repeated drive; return the scenario's lines.

    Parameters
    ----------
    recording : Recording
        A drive in any unit; each reading is played at its true sampling time.
    vehicle : Vehicle
        With ``zero_counts`` and ``counts_scale`` of all four sensors.
    folder : Path
        For the four files.

    Returns
    -------
    list of str, str
        Lines, and a warning or an empty string.

    Raises
    ------
    InputError
        If a sensor has no zero or no scale.
    """
    values = accelerations(recording, vehicle)
    instants = sample_times(recording, vehicle)
    instants -= instants.min()
    period = max(PERIOD, float(instants.max()) + 2.0)
    lines = []
    for row, channel in enumerate(CHANNELS):
        sensor = vehicle.sensor(channel)
        if sensor.zero_counts is None or sensor.counts_scale is None:
            raise InputError(
                f"{vehicle.source}: [sensors.{channel}]",
                "lacks zero_counts or counts_scale",
                "the converters need both",
            )
        present = ~np.isnan(values[row])
        counts = sensor.zero_counts + values[row, present] / sensor.counts_scale
        # At rest before and after, so that nothing is interpolated between two drives.
        time = np.concatenate([[0.0], instants[row, present] + 0.001, [instants.max() + 0.01]])
        level = np.concatenate([[sensor.zero_counts], counts, [sensor.zero_counts]])
        all_times = (time + period * np.arange(REPEATS)[:, None]).ravel()
        path = folder / f"{channel}.csv"
        np.savetxt(
            path, np.column_stack([all_times, np.tile(level, REPEATS)]),
            fmt="%.10g", delimiter=",", header=f"time [s],{channel} [counts]", comments="",
        )  # fmt: skip
        lines.append(f"input {PINS[row]} file={path} column={channel} start={_START:g}s")
    rate = nominal_rate(recording)
    warning = (
        f"the voltages are interpolated linearly between rows at {rate:.4g} Hz; "
        f"bayes-asv simulate --rate 4000 gives a finer drive"
    )
    return lines, warning if rate < _MIN_RATE else ""


def scenario_text(firmware: Path, options: EmulatorOptions, inputs: list[str]) -> str:
    """Return the text of a scenario: System 2 with modem, button, lights and both boards."""
    boards = [
        f"board slave_{n} elf={firmware / 'build' / f'slave_{n}.elf'} ppm={ppm!r} start={start}"
        for n, ppm, start in ((1, options.ppm[0], "2ms"), (2, options.ppm[1], "7.1ms"))
    ]
    return "\n".join(
        [
            f"seed {options.seed}",
            f"speed {options.speed!r}",
            *boards,
            f"include {firmware / 'emulator' / 'system_2.wiring'}",
            f"air loss={options.loss!r} jitter=1us",
            f"channel ber={options.errors!r}",
            *inputs,
            "",
        ]
    )


def start_emulator(firmware: Path, text: str, folder: Path) -> tuple[subprocess.Popen[str], str]:
    """Start the emulator; return its process and the pseudo-terminal of the logger.

    Simulated time starts when the pseudo-terminal is opened.

    Raises
    ------
    InputError
        With the emulator's message if it does not start.
    """
    path = folder / "logger.scenario"
    path.write_text(text, encoding="utf-8")
    process = subprocess.Popen(
        [str(firmware / "emulator" / "emulator"), str(path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    first = process.stdout.readline()
    if not first:
        raise InputError("emulator", process.stderr.read().strip() or "has ended", "see above")
    return process, str(json.loads(first)["terminal"])
