"""A serial port read by a thread of its own; every byte is on disk before anybody looks at it."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike

__all__ = ["BAUD", "PortReader"]

BAUD: Final = 115_200
"""Bits a second, where nothing else is said."""

_PATIENCE: Final = 0.1  # s that a read waits for the first byte
_GATHER: Final = (0.02, 1000.0)  # s and bytes: so much may come together before it is taken
_FRAME: Final = 0.03  # s between pieces: a filter fed row by row would only spend more time
_BETWEEN_TRIES: Final = 0.5  # s before a port that was lost is opened again


class PortReader:
    """Reads a serial port until it is stopped, through losses of the port.

    Parameters
    ----------
    port : str
        Device, such as ``/dev/ttyUSB0`` or ``COM3``.
    keep : str or os.PathLike
        New file for the bytes as they come.
    baud : int
        Bits a second.

    Attributes
    ----------
    losses : int
        How often the port went away.
    kept : int
        Bytes in the file.

    Raises
    ------
    InputError
        If the port cannot be opened, or the file exists already or cannot be made.
    """

    def __init__(self, port: str, keep: PathLike, baud: int = BAUD) -> None:
        self.losses = 0
        self.kept = 0
        self.connected = True
        self._port, self._baud = port, baud
        self._gather = min(_GATHER[0], 10.0 * _GATHER[1] / baud)  # ten bits a byte
        self._stop = threading.Event()
        self._fault: InputError | None = None
        self._bytes: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._serial = self._open(first=True)
        try:
            self._file = open(keep, "xb", buffering=0)  # noqa: SIM115 # closed by the thread
        except OSError as fault:
            self._serial.close()
            where = str(keep)
            if isinstance(fault, FileExistsError):
                raise InputError(where, "is there already", "name another file") from None
            reason = fault.strerror or str(fault)
            raise InputError(where, f"cannot be written ({reason})", "name another") from None
        self.file = Path(keep)
        self._thread = threading.Thread(target=self._read, name="port", daemon=True)
        self._thread.start()

    def pieces(self) -> Iterator[bytes]:
        """Yield what has come since the last time, perhaps nothing, until `stop`.

        Raises
        ------
        InputError
            If the file cannot be written any more.
        """
        over = False
        while not over:
            time.sleep(_FRAME)
            pieces = []
            with contextlib.suppress(queue.Empty):
                while not over:
                    piece = self._bytes.get_nowait()
                    over = piece is None
                    pieces.append(piece or b"")
            yield b"".join(pieces)
        if self._fault is not None:
            raise self._fault

    def stop(self) -> None:
        """Close port and file; may be called twice."""
        self._stop.set()
        self._thread.join(timeout=5.0)

    def _open(self, *, first: bool) -> Any:
        import serial

        try:
            return serial.serial_for_url(self._port, baudrate=self._baud, timeout=_PATIENCE)
        except (OSError, ValueError) as fault:  # SerialException is an OSError
            if not first:
                return None
            reason = getattr(fault, "strerror", None) or str(fault)
            fix = "check the cable and the name; on Linux the group dialout may open it"
            raise InputError(self._port, f"cannot be opened ({reason})", fix) from None

    def _read(self) -> None:
        """Move bytes from the port to the file, then to the queue."""
        try:
            while not self._stop.is_set():
                data = self._some()
                if data:
                    self._file.write(data)
                    self.kept += len(data)
                    self._bytes.put(data)
                    self._stop.wait(self._gather)
        except OSError as fault:
            reason = fault.strerror or str(fault)
            where, what = str(self.file), f"cannot be written any more ({reason})"
            self._fault = InputError(where, what, "free some space")
        finally:
            self._bytes.put(None)
            self._file.close()
            if self._serial is not None:
                self._serial.close()

    def _some(self) -> bytes:
        """Bytes that are there, at least after waiting for one; none where the port is away."""
        if self._serial is None:
            self._stop.wait(_BETWEEN_TRIES)
            self._serial = self._open(first=False)
            self.connected = self._serial is not None
            return b""
        try:
            # In one call what has come: byte by byte Python would not keep up (measured: 600 000
            # messages a second so, 4 000 by readline).
            data: bytes = self._serial.read(self._serial.in_waiting or 1)
        except (OSError, TypeError):  # pulled out; a port closed under a read gives a TypeError
            self.losses += 1
            self.connected = False
            with contextlib.suppress(OSError):
                self._serial.close()
            self._serial = None
            return b""
        return data
