"""A serial cable between an emulated logger and a real process, that a test can cut and mend.

The bridge opens pseudo-terminals of its own: to the process it is a serial port that disappears and
comes back, as with a plug that is pulled. Virtual time runs as fast as it can while the bridge
lives, and what the test wants done is done at a given number of bytes on their way to the laptop.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
import tty
from pathlib import Path
from types import TracebackType
from typing import Self

from tests.firmware.emulated import Emulated

__all__ = ["Bridge"]

_STEP = 0.02  # s of virtual time between looks at the process


class Bridge:
    """Carries bytes between an emulator and a port that a process opens.

    Parameters
    ----------
    emulated
        The logger; nobody else may move its time while the bridge lives.
    folder
        Where the port is.
    speed
        Virtual seconds a second at most.
    actions
        Number of bytes on their way to the laptop at which something is done, and what: an action
        of the emulator, or ``unplug`` for a cable that is out for a second.

    Attributes
    ----------
    path
        The port.
    fault
        What went wrong in the thread.
    """

    def __init__(
        self,
        emulated: Emulated,
        folder: Path,
        speed: float = 8.0,
        actions: tuple[tuple[int, str], ...] = (),
    ) -> None:
        self.path = folder / "port"
        self.fault: BaseException | None = None
        self._emulated, self._speed = emulated, speed
        self._actions = sorted(actions)
        self._carried = 0
        self._out_since: float | None = None
        self._ends: tuple[int, int] | None = None
        self._stop = threading.Event()
        self._plug()
        self._thread = threading.Thread(target=self._run, name="bridge")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._thread.join(timeout=60)
        self._unplug()
        if self.fault is not None and kind is None:
            raise self.fault

    def _plug(self) -> None:
        ours, theirs = os.openpty()
        tty.setraw(theirs)
        os.set_blocking(ours, False)
        self._ends = (ours, theirs)
        self.path.symlink_to(os.ttyname(theirs))

    def _unplug(self) -> None:
        if self._ends is not None:
            self.path.unlink()
            for end in self._ends:
                os.close(end)
        self._ends = None

    def _run(self) -> None:
        try:
            start, virtual = time.monotonic(), self._emulated.now
            while not self._stop.is_set() and self._emulated.running:
                self._up()
                self._down(self._emulated.wait(_STEP))
                ahead = (self._emulated.now - virtual) / self._speed - (time.monotonic() - start)
                self._stop.wait(max(ahead, 0.0))
                if self._out_since is not None and time.monotonic() - self._out_since > 1.0:
                    self._out_since = None
                    self._plug()
        except BaseException as fault:  # raised again in the test's own thread
            self.fault = fault

    def _up(self) -> None:
        if self._ends is None:
            return
        with contextlib.suppress(BlockingIOError):
            data = os.read(self._ends[0], 4096)
            if data:
                self._emulated.send(data)

    def _down(self, data: bytes) -> None:
        self._carried += len(data)
        if self._ends is not None and data:
            os.write(self._ends[0], data)
        while self._actions and self._carried >= self._actions[0][0]:
            _, action = self._actions.pop(0)
            if action == "unplug":
                self._unplug()
                self._out_since = time.monotonic()
            else:
                self._emulated.do(action)
