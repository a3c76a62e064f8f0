"""Serial port that saves every byte before anything else, and waits for a disconnected cable."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Final, Self

from bayes_asv.domain.errors import BayesAsvError, InputError
from bayes_asv.domain.files import PathLike

__all__ = ["BAUD", "PortLostError", "SavingPort", "find_port"]

BAUD: Final = 9600
"""Bits per second of the logger's serial line."""

_RETRY_INTERVAL: Final = 0.3  # s between attempts to open a lost port again
_MAX_NAMED: Final = 8  # ports in a message


class PortLostError(BayesAsvError):
    """The port was disconnected and did not come back."""


class SavingPort:
    """Serial port that saves what it reads, and waits for a cable that was unplugged.

    Parameters
    ----------
    name : str
        Device, such as ``/dev/ttyUSB0`` or ``COM3``.
    keep : str or os.PathLike
        File for the bytes as they come.
    resume : bool
        Whether the file may exist; new bytes are appended.
    patience : float
        Time to wait for a lost port, s.
    baud : int
        Bits per second.
    say : callable, optional
        Called with a message when the port is lost and when it is back.

    Attributes
    ----------
    timeout : float
        Time that `read` waits for the first byte, s.
    losses : int
        Number of times the port was lost.

    Raises
    ------
    InputError
        If the port cannot be opened, or the file cannot be created or exists.
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
        self._time_lost = 0.0  # s without a port
        self._serial = self._open()
        try:
            self._file: BinaryIO = open(keep, "ab" if resume else "xb", buffering=0)  # noqa: SIM115
        except OSError as error:
            self._serial.close()
            raise _file_error(str(keep), error) from None
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
        """Bytes that can be read at once; none while the port is lost."""
        try:
            return int(self._serial.in_waiting)
        except (OSError, TypeError):
            return 0

    def clock(self) -> float:
        """Time with a port, s: the clock stops while it is lost."""
        return time.monotonic() - self._time_lost

    def read(self, size: int = 1) -> bytes:
        """Read up to `size` bytes, at least one unless none came within `timeout`.

        Raises
        ------
        PortLostError
            If the port was lost and did not come back.
        InputError
            If the bytes cannot be written to the file.
        """
        try:
            self._serial.timeout = self.timeout
            data = bytes(self._serial.read(size))
        except (OSError, TypeError, ValueError):  # unplugged; SerialException is an OSError
            self._reconnect()
            return b""
        if data:
            try:
                self._file.write(data)
            except OSError as error:
                raise _file_error(str(self.file), error) from None
        return data

    def write(self, data: bytes) -> int:
        """Send bytes; what a lost port drops is repeated by the client anyway."""
        try:
            return int(self._serial.write(data) or 0)
        except (OSError, TypeError, ValueError):
            self._reconnect()
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
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            fix = "check the cable and the name; on Linux add yourself to the group dialout"
            raise InputError(self._name, f"cannot be opened ({reason})", fix) from None

    def _reconnect(self) -> None:
        """Wait until the port can be opened again."""
        began = time.monotonic()
        self.losses += 1
        with contextlib.suppress(OSError):
            self._serial.close()
        self._say(
            f"{self._name} has gone; what was received is saved; plug it in again to continue"
        )
        while time.monotonic() - began < self._patience:
            time.sleep(_RETRY_INTERVAL)
            try:
                self._serial = self._open()
            except InputError:
                continue
            self._time_lost += time.monotonic() - began
            self._say(f"{self._name} is back after {time.monotonic() - began:.1f} s; continuing")
            return
        raise PortLostError(
            f"{self._name} was disconnected and did not come back in {self._patience:g} s"
        )


def find_port() -> str:
    """Return the only serial port of this machine.

    Raises
    ------
    InputError
        If there is none, or more than one; they are named.
    """
    from serial.tools.list_ports import comports

    ports = list(comports())
    # Main boards have ports that nothing is plugged into; a cable or a modem has a USB identity.
    candidates = [port for port in ports if port.vid is not None] or [
        port for port in ports if port.description not in (None, "", "n/a", "ttyS", port.name)
    ]
    if not candidates:
        raise InputError(
            "serial port",
            "none was found",
            "plug in the logger's cable or modem, or name it with --port; "
            "without hardware: bayes-asv logger --emulated",
        )
    if len(candidates) > 1:
        named = ", ".join(f"{port.device} ({port.description})" for port in candidates[:_MAX_NAMED])
        raise InputError("serial port", f"there are several: {named}", "choose one with --port")
    return str(candidates[0].device)


def _file_error(where: str, error: OSError) -> InputError:
    if isinstance(error, FileExistsError):
        return InputError(where, "exists already", "give --resume to continue it, or another name")
    if isinstance(error, FileNotFoundError):
        return InputError(where, "its folder does not exist", "make the folder first")
    reason = error.strerror or str(error)
    return InputError(where, f"cannot be written ({reason})", "free some space or name another")
