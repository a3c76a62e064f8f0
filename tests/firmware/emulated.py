"""The emulated logger, as a process of its own that a test drives.

``firmware/emulator`` builds a program that runs the boards' ELF files with everything they are
wired to.  It links simavr, which is under the GPL, and is therefore never loaded here: this module
starts it and speaks with it over its standard input and output, or over a pseudo-terminal.

Two ways:

`Emulated`
    Virtual time moves only when the test says so, and the test is the laptop.  The same seed
    gives the same run to the byte.
`Terminal`
    Virtual time runs against the clock, and the laptop is whoever opens the pseudo-terminal.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import subprocess
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import serial

__all__ = [
    "EMULATOR",
    "FIRMWARE",
    "Emulated",
    "EmulatorError",
    "Pyserial",
    "Terminal",
    "VirtualPort",
    "build",
    "build_programs",
    "make",
    "missing",
]

FIRMWARE = Path(__file__).resolve().parents[2] / "firmware"
EMULATOR = FIRMWARE / "emulator"
PROGRAMS = EMULATOR / "build" / "programs"
SHORTEST_WAIT = 1e-9  # s: less may be nothing in the emulator's arithmetic

Event = dict[str, Any]


class EmulatorError(Exception):
    """The emulator refused a scenario or a command, or ended."""


def missing() -> str | None:
    """What this machine lacks to build and run the emulator, in a sentence; None when nothing."""
    tools = [tool for tool in ("make", "gcc", "avr-gcc") if shutil.which(tool) is None]
    if tools:
        return f"not installed: {', '.join(tools)} (see tests/debian-packages.sh)"
    for header, package in (("sim_avr.h", "libsimavr-dev"), ("libelf.h", "libelf-dev")):
        folder = "simavr" if header == "sim_avr.h" else "."
        if not any((Path(root) / folder / header).exists() for root in _include_folders()):
            return f"{header} is missing: install {package} (see tests/debian-packages.sh)"
    return None


def _include_folders() -> list[str]:
    return ["/usr/include", "/usr/local/include"]


def make(folder: Path, target: str, *, builds: bool = True) -> subprocess.CompletedProcess[str]:
    """Run make in a folder; builds run one at a time, however many tests ask for them.

    Raises
    ------
    EmulatorError
        With what it said, when it failed.
    """
    # A make that runs the tests has no business with this one.
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("MAKE", "MFLAGS"))}
    with (folder / "Makefile").open() as lock:
        if builds:
            fcntl.flock(lock, fcntl.LOCK_EX)
        done = subprocess.run(
            ["make", "-s", "-C", str(folder), target],
            capture_output=True,
            text=True,
            check=False,
            env=environment,
        )
    if done.returncode:
        raise EmulatorError(f"make -C {folder.name} {target} failed:\n{done.stdout}{done.stderr}")
    return done


@cache
def build() -> Path:
    """Make the emulator where it is out of date; its path."""
    make(EMULATOR, "emulator")
    return EMULATOR / "emulator"


@cache
def build_programs() -> Path:
    """Make the small test programs for the part; their folder."""
    make(EMULATOR, "programs")
    return PROGRAMS


class _Process:
    """A running emulator with its scenario and its log."""

    def __init__(self, scenario: str, folder: Path, *options: str) -> None:
        self._log = folder / "events.jsonl"
        path = folder / "test.scenario"
        path.write_text(scenario)
        self._process = subprocess.Popen(
            [str(build()), *options, "--events", str(self._log), str(path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._read = 0
        self._events: list[Event] = []

    def events(self, kind: str | None = None, **fields: object) -> list[Event]:
        """What has happened so far, of one kind and with the given fields.

        The log is written out whenever virtual time stops, and at the end.
        """
        with self._log.open() as log:
            log.seek(self._read)
            for line in log:
                if not line.endswith("\n"):
                    break
                self._read += len(line.encode())
                self._events.append(json.loads(line))
        return [
            event
            for event in self._events
            if (kind is None or event["event"] == kind)
            and all(event.get(key) == value for key, value in fields.items())
        ]

    def totals(self, kind: str, **fields: object) -> Event:
        """The last statistics of one device, such as ``totals("board", name="slave_1")``."""
        found = self.events(kind, **fields)
        if not found:
            raise EmulatorError(f"no statistics of {kind} {fields}")
        return found[-1]

    def _stop(self) -> int:
        process = self._process
        for pipe in (process.stdin, process.stdout, process.stderr):
            if pipe is not None:
                with suppress(BrokenPipeError):  # it had ended already
                    pipe.close()
        return process.wait(timeout=60)

    def _failed(self) -> EmulatorError:
        self._process.wait(timeout=60)
        said = self._process.stderr.read() if self._process.stderr else ""
        return EmulatorError(said.strip() or f"ended with status {self._process.returncode}")


class Emulated(_Process):
    """An emulator whose virtual time the test moves.

    Parameters
    ----------
    scenario
        Text of a scenario (``firmware/emulator/README.md``); paths in it are absolute or relative
        to `folder`.
    folder
        An empty folder for the scenario and the event log.

    Raises
    ------
    EmulatorError
        With the emulator's sentence when the scenario is wrong.
    """

    def __init__(self, scenario: str, folder: Path) -> None:
        super().__init__(scenario, folder, "--control")
        self.now = 0.0
        self.running = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop()

    def _ask(self, command: str) -> Event:
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(command + "\n")
            process.stdin.flush()
        except (BrokenPipeError, ValueError):
            raise self._failed() from None
        answer = process.stdout.readline()
        if not answer:
            raise self._failed()
        said: Event = json.loads(answer)
        if "problem" in said:
            raise EmulatorError(said["problem"])
        self.now = float(said["t"])
        self.running = bool(said["running"])
        return said

    def run(self, seconds: float) -> bytes:
        """Let virtual time pass until bytes reach the laptop, at most `seconds`; the bytes."""
        return bytes.fromhex(self._ask(f"run {seconds!r}")["data"])

    def wait(self, seconds: float) -> bytes:
        """Let `seconds` of virtual time pass; the bytes that have reached the laptop."""
        return bytes.fromhex(self._ask(f"wait {seconds!r}")["data"])

    def do(self, action: str) -> None:
        """Let something happen now, such as ``press start`` or ``cut synch``."""
        self._ask(action)

    def send(self, data: bytes) -> None:
        """Let the laptop send bytes, at its line's baud rate and when its modem can take them."""
        for first in range(0, len(data), 256):
            self._ask(f"send {data[first : first + 256].hex()}")

    def statistics(self) -> None:
        """Write what was counted to the event log, for `totals`."""
        self._ask("statistics")


@dataclass
class VirtualPort:
    """The laptop's end of an `Emulated` link with the methods of a pyserial port.

    Its time-outs are in virtual time, which passes while it waits.

    Attributes
    ----------
    emulated
        The emulator.
    timeout
        Longest wait of `read` in virtual seconds.
    """

    emulated: Emulated
    timeout: float = 1.0
    _waiting: bytes = b""

    @property
    def in_waiting(self) -> int:
        """Number of bytes that can be read without waiting."""
        return len(self._waiting)

    def read(self, size: int = 1) -> bytes:
        """Up to `size` bytes; fewer when they have not come within `timeout`."""
        end = self.emulated.now + self.timeout
        while len(self._waiting) < size and self.emulated.running:
            left = end - self.emulated.now
            if left < SHORTEST_WAIT:
                break
            self._waiting += self.emulated.run(left)
        data, self._waiting = self._waiting[:size], self._waiting[size:]
        return data

    def write(self, data: bytes) -> int:
        """Queue bytes for sending; their number."""
        self.emulated.send(data)
        return len(data)

    def flush(self) -> None:
        """Nothing to do: what is written goes out as time passes."""

    def close(self) -> None:
        """Nothing to do: the emulator belongs to the test."""

    def clock(self) -> float:
        """Virtual time in seconds, for whoever measures time-outs himself."""
        return self.emulated.now


class Pyserial:
    """A real serial port with a clock that runs `speed` times as fast, for a `Terminal`.

    Parameters
    ----------
    path
        The pseudo-terminal.
    speed
        Virtual seconds a second; time-outs and the clock are in virtual ones.
    """

    def __init__(self, path: str, speed: float) -> None:
        self._port = serial.Serial(path, 9600)
        self._speed = speed
        self.timeout = 1.0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._port.close()

    @property
    def in_waiting(self) -> int:
        """Number of bytes that can be read without waiting."""
        return int(self._port.in_waiting)

    def read(self, size: int = 1) -> bytes:
        """Up to `size` bytes; fewer when they have not come within `timeout`."""
        self._port.timeout = self.timeout / self._speed
        return bytes(self._port.read(size))

    def write(self, data: bytes) -> int:
        """Send bytes; their number."""
        return int(self._port.write(data) or 0)

    def clock(self) -> float:
        """Virtual time in seconds, as far as the emulator keeps up."""
        return time.monotonic() * self._speed


class Terminal(_Process):
    """An emulator on a pseudo-terminal, against the clock.

    Parameters
    ----------
    scenario, folder
        As for `Emulated`; the scenario's ``speed`` sets virtual seconds a second, 0 as fast as
        possible.

    Attributes
    ----------
    path
        The pseudo-terminal, for pyserial.  Virtual time starts when it is opened.
    """

    def __init__(self, scenario: str, folder: Path) -> None:
        super().__init__(scenario, folder)
        assert self._process.stdout is not None
        first = self._process.stdout.readline()
        if not first:
            raise self._failed()
        said: Mapping[str, str] = json.loads(first)
        self.path = said["terminal"]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()

    def alive(self) -> bool:
        """Whether the process still runs."""
        return self._process.poll() is None

    def stop(self) -> int:
        """End the process, which then writes its statistics; its exit status."""
        if self.alive():
            self._process.terminate()
        return self._stop()

    def wait(self, seconds: float) -> int:
        """Wait for the scenario's end, at most `seconds` of real time; the exit status."""
        return self._process.wait(timeout=seconds)
