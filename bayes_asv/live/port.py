"""Serial port read by its own thread, which saves every byte before anything else."""

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
"""Default bits per second."""

_READ_TIMEOUT: Final = 0.1  # s
_BATCH: Final = (0.02, 1000.0)  # s and bytes that are collected before the next read
_POLL_INTERVAL: Final = 0.03  # s: a filter that is fed row by row would only cost more time
_RETRY_INTERVAL: Final = 0.5  # s between attempts to open a lost port again


class PortReader:
    """Reads a serial port until it is stopped, and reopens it when it was lost.

    Parameters
    ----------
    port : str
        Device, such as ``/dev/ttyUSB0`` or ``COM3``.
    keep : str or os.PathLike
        New file for the bytes as they come.
    baud : int
        Bits per second.

    Attributes
    ----------
    losses : int
        Number of times the port was lost.
    bytes_saved : int
        Bytes in the file.
    connected : bool
        Whether the port is open.

    Raises
    ------
    InputError
        If the port cannot be opened, or the file exists already or cannot be created.
    """

    def __init__(self, port: str, keep: PathLike, baud: int = BAUD) -> None:
        self.losses = 0
        self.bytes_saved = 0
        self.connected = True
        self._port, self._baud = port, baud
        self._batch_time = min(_BATCH[0], 10.0 * _BATCH[1] / baud)  # ten bits per byte
        self._stop = threading.Event()
        self._error: InputError | None = None
        self._queue: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._serial = self._open(first=True)
        try:
            self._file = open(keep, "xb", buffering=0)  # noqa: SIM115 # closed by the thread
        except OSError as error:
            self._serial.close()
            where = str(keep)
            if isinstance(error, FileExistsError):
                raise InputError(where, "exists already", "name another file") from None
            reason = error.strerror or str(error)
            raise InputError(where, f"cannot be written ({reason})", "name another") from None
        self.file = Path(keep)
        self._thread = threading.Thread(target=self._read, name="port", daemon=True)
        self._thread.start()

    def chunks(self) -> Iterator[bytes]:
        """Yield the bytes since the last time, perhaps none, until `stop`.

        Raises
        ------
        InputError
            If the file cannot be written any more.
        """
        over = False
        while not over:
            time.sleep(_POLL_INTERVAL)
            chunks = []
            with contextlib.suppress(queue.Empty):
                while not over:
                    chunk = self._queue.get_nowait()
                    over = chunk is None
                    chunks.append(chunk or b"")
            yield b"".join(chunks)
        if self._error is not None:
            raise self._error

    def stop(self) -> None:
        """Close port and file; may be called twice."""
        self._stop.set()
        self._thread.join(timeout=5.0)

    def _open(self, *, first: bool) -> Any:
        import serial

        try:
            return serial.serial_for_url(self._port, baudrate=self._baud, timeout=_READ_TIMEOUT)
        except (OSError, ValueError) as error:  # SerialException is an OSError
            if not first:
                return None
            reason = getattr(error, "strerror", None) or str(error)
            fix = "check the cable and the name; on Linux add yourself to the group dialout"
            raise InputError(self._port, f"cannot be opened ({reason})", fix) from None

    def _read(self) -> None:
        """Move bytes from the port to the file, then to the queue."""
        try:
            while not self._stop.is_set():
                data = self._next_bytes()
                if data:
                    self._file.write(data)
                    self.bytes_saved += len(data)
                    self._queue.put(data)
                    self._stop.wait(self._batch_time)
        except OSError as error:
            reason = error.strerror or str(error)
            where, what = str(self.file), f"cannot be written any more ({reason})"
            self._error = InputError(where, what, "free some space")
        finally:
            self._queue.put(None)
            self._file.close()
            if self._serial is not None:
                self._serial.close()

    def _next_bytes(self) -> bytes:
        """Read all bytes that are there, waiting for the first; none while the port is lost."""
        if self._serial is None:
            self._stop.wait(_RETRY_INTERVAL)
            self._serial = self._open(first=False)
            self.connected = self._serial is not None
            return b""
        try:
            # All available bytes in one call, because Python is too slow for single bytes or lines
            # (600,000 messages per second in this way, 4,000 with readline).
            data: bytes = self._serial.read(self._serial.in_waiting or 1)
        except (OSError, TypeError):  # unplugged; closing a port during a read gives a TypeError
            self.losses += 1
            self.connected = False
            with contextlib.suppress(OSError):
                self._serial.close()
            self._serial = None
            return b""
        return data
