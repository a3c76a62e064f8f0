"""Tasks that processes of the tests run."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

__all__ = ["work"]


def work(task: tuple[str, str]) -> int:
    """Do what a task says: sleep, raise, or kill the own process, always or once."""
    what, mark = task
    time.sleep(0.05)
    if what == "raise":
        raise ValueError("a fault\nin two lines")
    if what == "die" or (what == "die once" and not Path(mark).exists()):
        Path(mark).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "wait":
        Path(mark).touch()
        time.sleep(1.0)
    return os.getpid()
