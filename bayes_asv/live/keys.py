"""Single keys from a terminal, as they are pressed."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["pressed_keys"]


@contextmanager
def pressed_keys() -> Iterator[Callable[[], str]]:
    """Read keys without waiting, while the context lasts.

    Yields
    ------
    callable
        Returns what was pressed since the last call, perhaps nothing.  Where standard input is no
        terminal it always returns nothing.
    """
    if not sys.stdin.isatty():
        yield str
        return
    if os.name == "nt":
        yield _windows_keys
        return
    import select
    import termios
    import tty

    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)

    def read() -> str:
        keys = b""
        while select.select([terminal], [], [], 0.0)[0]:
            some = os.read(terminal, 64)
            if not some:
                break
            keys += some
        return keys.decode("ascii", "ignore")

    try:
        tty.setcbreak(terminal)  # keys at once; Ctrl-C still ends the program
        yield read
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def _windows_keys() -> str:
    import importlib

    console = importlib.import_module("msvcrt")
    keys = ""
    while console.kbhit():
        keys += console.getwch()
    return keys
