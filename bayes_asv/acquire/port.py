"""The serial port: every byte on disk before anybody looks at it, through losses of the cable."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Final, Self

from bayes_asv.domain.errors import BayesAsvError, InputError
from bayes_asv.domain.files import PathLike

__all__ = ["BAUD", "GoneError", "KeptPort", "found_port"]

BAUD: Final = 9600
"""Bits a second of the logger's line."""

_BETWEEN_TRIES: Final = 0.3  # s before a port that was lost is opened again
_MOST_NAMED: Final = 8


class GoneError(BayesAsvError):
    """The port went away and did not come back."""


class KeptPort:
    """A serial port that keeps what it reads, and waits for a cable that was pulled.

    Parameters
    ----------
    name : str
        Device, such as ``/dev/ttyUSB0`` or ``COM3``.
    keep : str or os.PathLike
        File for the bytes as they come.
    resume : bool
        Whether the file may exist and is written on.
    patience : float
        s to wait for a lost port.
    baud : int
        Bits a second.
    say : callable, optional
        Told when the port goes and comes.

    Attributes
    ----------
    timeout : float
        s that `read` waits for a first byte.
    losses : int
        How often the port went away.

    Raises
    ------
    InputError
        If the port cannot be opened, or the file cannot be made or exists.
    """

    def __init__(
        self,
        name: str,
        keep: PathLike,
        *,
        resume: bool = False,
        patience: float = 600.0,
        baud: int = BAUD,
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.timeout = 1.0
        self.losses = 0
        self._name, self._baud, self._patience, self._say = name, baud, patience, say
        self._away = 0.0  # s during which there was no port
        self._serial = self._open()
        try:
            self._file: BinaryIO = open(keep, "ab" if resume else "xb", buffering=0)  # noqa: SIM115
        except OSError as fault:
            self._serial.close()
            raise _unkept(str(keep), fault) from None
        self.file = Path(keep)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read at once; none where the port is away."""
        try:
            return int(self._serial.in_waiting)
        except (OSError, TypeError):
            return 0

    def clock(self) -> float:
        """Seconds with a port: the clock stands still while it is away."""
        return time.monotonic() - self._away

    def read(self, size: int = 1) -> bytes:
        """Up to `size` bytes, at least one unless none came within `timeout`.

        Raises
        ------
        GoneError
            If the port went away and did not come back.
        InputError
            If what came cannot be written to the file.
        """
        try:
            self._serial.timeout = self.timeout
            data = bytes(self._serial.read(size))
        except (OSError, TypeError, ValueError):  # pulled out; SerialException is an OSError
            self._wait()
            return b""
        if data:
            try:
                self._file.write(data)
            except OSError as fault:
                raise _unkept(str(self.file), fault) from None
        return data

    def write(self, data: bytes) -> int:
        """Send bytes; what a lost port swallows is asked for again anyway."""
        try:
            return int(self._serial.write(data) or 0)
        except (OSError, TypeError, ValueError):
            self._wait()
            return 0

    def close(self) -> None:
        """Close port and file."""
        with contextlib.suppress(OSError):
            self._serial.close()
        self._file.close()

    def _open(self) -> Any:
        import serial

        try:
            return serial.serial_for_url(self._name, baudrate=self._baud, write_timeout=5.0)
        except (OSError, ValueError) as fault:
            reason = getattr(fault, "strerror", None) or str(fault)
            fix = "check the cable and the name; on Linux the group dialout may open it"
            raise InputError(self._name, f"cannot be opened ({reason})", fix) from None

    def _wait(self) -> None:
        """Wait until the port can be opened again."""
        began = time.monotonic()
        self.losses += 1
        with contextlib.suppress(OSError):
            self._serial.close()
        self._say(f"{self._name} has gone; what came is kept; plug it in again to go on")
        while time.monotonic() - began < self._patience:
            time.sleep(_BETWEEN_TRIES)
            try:
                self._serial = self._open()
            except InputError:
                continue
            self._away += time.monotonic() - began
            self._say(f"{self._name} is back after {time.monotonic() - began:.1f} s; going on")
            return
        raise GoneError(f"{self._name} went away and did not come back in {self._patience:g} s")


def found_port() -> str:
    """Return the one serial port of this machine.

    Raises
    ------
    InputError
        If there is none, or more than one; they are named.
    """
    from serial.tools.list_ports import comports

    ports = list(comports())
    # Main boards show ports that nothing is plugged into; a cable or a modem has a USB identity.
    real = [port for port in ports if port.vid is not None] or [
        port for port in ports if port.description not in (None, "", "n/a", "ttyS", port.name)
    ]
    if not real:
        raise InputError(
            "serial port",
            "none is there",
            "plug in the logger's cable or modem, or name it with --port; "
            "without hardware: bayes-asv logger --emulated",
        )
    if len(real) > 1:
        named = ", ".join(f"{port.device} ({port.description})" for port in real[:_MOST_NAMED])
        raise InputError("serial port", f"there are several: {named}", "choose one with --port")
    return str(real[0].device)


def _unkept(where: str, fault: OSError) -> InputError:
    if isinstance(fault, FileExistsError):
        return InputError(
            where, "is there already", "give --resume to go on with it, or name another"
        )
    if isinstance(fault, FileNotFoundError):
        return InputError(where, "its folder does not exist", "make the folder first")
    reason = fault.strerror or str(fault)
    return InputError(where, f"cannot be written ({reason})", "free some space or name another")
