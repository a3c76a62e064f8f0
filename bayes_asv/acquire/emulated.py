"""The emulated logger for those without one: its boards' firmware on simulated chips.

It is a process of its own and is built from a source checkout (``firmware/emulator``); this module
writes its scenario and the voltages that its converters see, and starts it.
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

__all__ = ["Emulation", "built", "default_drive", "scenario", "started", "write_voltages"]

PINS: Final = ("slave_1.A0", "slave_1.A1", "slave_2.A0", "slave_2.A1")
"""Converter inputs in the order of the channels."""
EVERY: Final = 12.0
"""s from one drive over the road to the next."""
REPEATS: Final = 50

FIRMWARE: Final = Path(__file__).resolve().parents[2] / "firmware"
"""Where it is in a source checkout."""

_FINE: Final = 2000.0  # Hz: several times the logger's highest rate, linear in between
_COARSE: Final = 1600.0  # Hz below which a recording is worth a warning
_DRIVE: Final = 2.8  # s
_BESIDE: Final = 0.1  # m/s², one deviation of a sensor's reading at rest
_FIRST: Final = 6.0  # s after switching on
_TOOLS: Final = ("make", "gcc", "avr-gcc")
_HEADERS: Final = (("simavr/sim_avr.h", "libsimavr-dev"), ("libelf.h", "libelf-dev"))
_INCLUDES: Final = ("/usr/include", "/usr/local/include")


@dataclass(frozen=True)
class Emulation:
    """What may be chosen of an emulated logger.

    Parameters
    ----------
    seed : int
        Of every random number in it.
    loss : float
        Share of radio packets lost between the boards.
    errors : float
        Share of bits inverted between the modems.
    speed : float
        Virtual seconds a second.
    ppm : tuple of 2 float
        Crystal errors of Slave 1 and Slave 2.
    """

    seed: int = 0
    loss: float = 0.05
    errors: float = 1e-4
    speed: float = 1.0
    ppm: tuple[float, float] = (30.0, -20.0)


def built() -> Path:
    """Build firmware and emulator where they are out of date; the folder ``firmware``.

    Raises
    ------
    InputError
        If this is no source checkout, a tool is missing, or the build fails.
    """
    firmware = FIRMWARE
    if not (firmware / "emulator" / "Makefile").is_file():
        raise InputError(
            "logger --emulated",
            "needs a source checkout, and this is an installed package",
            "run it in a copy of the repository",
        )
    lacking = [tool for tool in _TOOLS if shutil.which(tool) is None]
    lacking += [
        package
        for header, package in _HEADERS
        if not any(Path(root, header).exists() for root in _INCLUDES)
    ]
    if lacking:
        raise InputError(
            "logger --emulated",
            f"{', '.join(lacking)} {'is' if len(lacking) == 1 else 'are'} not installed",
            "on Debian: apt-get install make gcc gcc-avr avr-libc libsimavr-dev libelf-dev",
        )
    for folder, target in ((firmware, "all"), (firmware / "emulator", "emulator")):
        done = subprocess.run(
            ["make", "-s", "-C", str(folder), target], capture_output=True, text=True, check=False
        )
        if done.returncode:
            last = (done.stderr or done.stdout).strip().splitlines()[-1:] or ["no message"]
            raise InputError(f"make -C {folder.name} {target}", f"failed: {last[0]}", "see make")
    return firmware


def default_drive(vehicle: Vehicle, seed: int) -> Recording:
    """Simulate the nominal car over two parking stops, as voltages: no delays and no steps yet.

    The converters add both themselves. Every sensor reads a little beside its zero, as mounted
    ones do: with none at rest exactly between two counts, steps are like noise of q²/12.
    """
    one, two, three, four = (
        replace(s, delay=0.0, resolution=None, zero_counts=None, counts_scale=None)
        for s in vehicle.sensors
    )
    bare = replace(vehicle, sensors=(one, two, three, four))
    rng = np.random.default_rng([seed, 0])
    made = simulate(bare, road("stops", rng), rate=_FINE, seconds=_DRIVE, seed=seed).recording
    beside = [_BESIDE * rng.standard_normal() / acceleration_factor(unit, "drive")
              for unit in made.units]  # fmt: skip
    at_once = tuple((f"delay {channel}", "0 s") for channel in CHANNELS)
    return replace(
        made,
        values=made.values + np.array(beside)[:, None],
        metadata=(*made.metadata, *at_once),
    )


def write_voltages(recording: Recording, vehicle: Vehicle, folder: Path) -> tuple[list[str], str]:
    """Write what the converters see, the drive again and again; the scenario's lines.

    Parameters
    ----------
    recording : Recording
        A drive in any unit; each reading is played at the instant at which it was taken.
    vehicle : Vehicle
        With ``zero_counts`` and ``counts_scale`` of all four sensors.
    folder : Path
        For the four files.

    Returns
    -------
    list of str, str
        Lines, and a warning or nothing.

    Raises
    ------
    InputError
        If a sensor has no zero or no scale.
    """
    values = accelerations(recording, vehicle)
    instants = sample_times(recording, vehicle)
    instants -= instants.min()
    period = max(EVERY, float(instants.max()) + 2.0)
    lines = []
    for row, (channel, sensor) in enumerate(zip(CHANNELS, vehicle.sensors, strict=True)):
        if sensor.zero_counts is None or sensor.counts_scale is None:
            raise InputError(
                f"{vehicle.source}: [sensors.{channel}]",
                "lacks zero_counts or counts_scale",
                "the converters need both",
            )
        here = ~np.isnan(values[row])
        counts = sensor.zero_counts + values[row, here] / sensor.counts_scale
        # At rest before and behind, so that nothing is drawn out from one drive to the next.
        time = np.concatenate([[0.0], instants[row, here] + 0.001, [instants.max() + 0.01]])
        level = np.concatenate([[sensor.zero_counts], counts, [sensor.zero_counts]])
        all_times = (time + period * np.arange(REPEATS)[:, None]).ravel()
        path = folder / f"{channel}.csv"
        np.savetxt(
            path, np.column_stack([all_times, np.tile(level, REPEATS)]),
            fmt="%.10g", delimiter=",", header=f"time [s],{channel} [counts]", comments="",
        )  # fmt: skip
        lines.append(f"input {PINS[row]} file={path} column={channel} start={_FIRST:g}s")
    rate = nominal_rate(recording)
    warning = (
        f"the converters see straight lines between rows at {rate:.4g} Hz; "
        f"bayes-asv simulate --rate 4000 gives a finer drive"
    )
    return lines, warning if rate < _COARSE else ""


def scenario(firmware: Path, wanted: Emulation, inputs: list[str]) -> str:
    """Return the text of a scenario: System 2 with modem, button, lights and both boards."""
    boards = [
        f"board slave_{n} elf={firmware / 'build' / f'slave_{n}.elf'} ppm={ppm!r} start={start}"
        for n, ppm, start in ((1, wanted.ppm[0], "2ms"), (2, wanted.ppm[1], "7.1ms"))
    ]
    return "\n".join(
        [
            f"seed {wanted.seed}",
            f"speed {wanted.speed!r}",
            *boards,
            f"include {firmware / 'emulator' / 'system_2.wiring'}",
            f"air loss={wanted.loss!r} jitter=1us",
            f"channel ber={wanted.errors!r}",
            *inputs,
            "",
        ]
    )


def started(firmware: Path, text: str, folder: Path) -> tuple[subprocess.Popen[str], str]:
    """Start the emulator; its process and the pseudo-terminal at which it is the logger.

    Virtual time begins when somebody opens the pseudo-terminal.

    Raises
    ------
    InputError
        With the emulator's sentence when it refuses.
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
