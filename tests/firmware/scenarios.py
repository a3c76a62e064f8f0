"""Scenarios of the emulated logger: the boards' programs, wired as in ``firmware/PROTOCOL.md``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.recording import COUNTS, Recording, acceleration_factor
from bayes_asv.domain.vehicle import Vehicle
from tests.firmware.emulated import EMULATOR, FIRMWARE, make

__all__ = [
    "CHANNEL_PINS",
    "REST",
    "Setup",
    "build_firmware",
    "counts_of",
    "system_1",
    "system_2",
    "write_inputs",
]

CHANNEL_PINS: Mapping[str, str] = {
    "front_wheel": "slave_1.A0",
    "front_chassis": "slave_1.A1",
    "rear_wheel": "slave_2.A0",
    "rear_chassis": "slave_2.A1",
}
# Zero counts of the reference's sensors, App. C of the reference.
REST: Mapping[str, float] = {
    "front_wheel": 569.5,
    "front_chassis": 641.0,
    "rear_wheel": 581.5,
    "rear_chassis": 636.0,
}


@cache
def build_firmware() -> Path:
    """Make the three programs where they are out of date; the folder of their ELF files."""
    make(FIRMWARE, "all")
    return FIRMWARE / "build"


@dataclass(frozen=True)
class Setup:
    """What may differ from one emulated logger to the next.

    Attributes
    ----------
    seed
        Of every random number in it.
    ppm
        Crystal errors of Slave 1, Slave 2 and the Master.
    loss
        Probability that a packet between the boards is lost.
    error_rate
        Probability that a bit is inverted between the modems, or on the cable.
    inputs
        Lines about the four sensors' voltages; at rest with a little noise without any.
    extra
        Further lines, such as ``at 3 s cut synch`` or ``log adc``.
    """

    seed: int = 1
    ppm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    loss: float = 0.0
    error_rate: float = 0.0
    inputs: tuple[str, ...] = field(
        default=tuple(
            f"input {pin} counts={REST[name]} noise=5mV" for name, pin in CHANNEL_PINS.items()
        )
    )
    extra: tuple[str, ...] = ()


def _board(name: str, ppm: float, start: float) -> str:
    return f"board {name} elf={FIRMWARE / 'build' / name}.elf ppm={ppm!r} start={start!r}"


def system_2(setup: Setup) -> str:
    """Text of a scenario: Slave 1 with modem, button and lights, and Slave 2."""
    return "\n".join(
        [
            f"seed {setup.seed}",
            "speed 0",
            _board("slave_1", setup.ppm[0], 0.002),
            _board("slave_2", setup.ppm[1], 0.0071),
            f"include {EMULATOR / 'system_2.wiring'}",
            f"air loss={setup.loss!r} jitter=1us",
            f"channel ber={setup.error_rate!r}",
            *setup.inputs,
            *setup.extra,
            "",
        ]
    )


def system_1(setup: Setup) -> str:
    """Text of a scenario: the Master at a cable, Slave 1 and Slave 2."""
    wiring = (EMULATOR / "system_1.wiring").read_text()
    cable = f"cable master ber={setup.error_rate!r}"
    return "\n".join(
        [
            f"seed {setup.seed}",
            "speed 0",
            _board("master", setup.ppm[2], 0.0),
            _board("slave_1", setup.ppm[0], 0.002),
            _board("slave_2", setup.ppm[1], 0.0071),
            wiring.replace("cable master", cable),
            f"air loss={setup.loss!r} jitter=1us",
            *setup.inputs,
            *setup.extra,
            "",
        ]
    )


def counts_of(recording: Recording, vehicle: Vehicle) -> NDArray[np.float64]:
    """A recording of accelerations as the converter's counts, by each sensor's zero and scale.

    Parameters
    ----------
    recording
        In counts or any unit of acceleration, such as ``bayes-asv simulate`` writes.
    vehicle
        With ``zero_counts`` and ``counts_scale`` of all four sensors.

    Returns
    -------
    Shape (4, rows), in the order of the channels; not rounded.
    """
    counts = np.empty_like(recording.values)
    for i, name in enumerate(CHANNEL_PINS):
        if recording.units[i] == COUNTS:
            counts[i] = recording.values[i]
            continue
        sensor = vehicle.sensor(name)
        assert sensor.zero_counts is not None
        assert sensor.counts_scale is not None
        factor = acceleration_factor(recording.units[i], name)
        counts[i] = sensor.zero_counts + recording.values[i] * factor / sensor.counts_scale
    return counts


def write_inputs(
    path: Path, time: NDArray[np.float64], counts: NDArray[np.float64], start: float
) -> tuple[str, ...]:
    """Write four channels to a file, and give the scenario's lines that play it from `start` on.

    Parameters
    ----------
    time
        Shape (rows,), seconds.
    counts
        Shape (4, rows); the converter reads the whole part.
    """
    names = ",".join(f"{name} [counts]" for name in CHANNEL_PINS)
    rows = np.column_stack([time, counts.T])
    np.savetxt(path, rows, fmt="%.9g", delimiter=",", header=f"time [s],{names}", comments="")
    return tuple(
        f"input {pin} file={path} column={name} start={start!r}"
        for name, pin in CHANNEL_PINS.items()
    )
