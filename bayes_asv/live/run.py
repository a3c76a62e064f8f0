"""A source followed to its end, or until Ctrl-C, with a page, in the terminal, both or neither."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import webbrowser
from collections.abc import Callable

from bayes_asv.live.metadata import Scene
from bayes_asv.live.server import LiveServer
from bayes_asv.live.session import Show
from bayes_asv.live.sources import About, Source
from bayes_asv.live.worker import Filter, Pump
from bayes_asv.tracking.frames import Frames

__all__ = ["follow"]

_KEPT_OF_A_PORT = 500_000  # rows a port's view can look back on at least: ten minutes at 800 Hz
_LOOK = 0.2  # s between looks at whether it is over


def follow(
    source: Source,
    scene: Scene,
    make: Callable[[About], Filter],
    *,
    rate: float = 400.0,
    page: bool = False,
    terminal: bool = False,
    browser: bool = True,
    speed: float = 1.0,
    sink: Callable[[Frames], None] | None = None,
    say: Callable[[str], None] | None = None,
) -> Show:
    """Run a filter over a source, and show it.

    With a page or in a terminal it goes on until Ctrl-C (or q), so that one may look at what has
    ended; without either, a recording until its end and a port until Ctrl-C.

    Parameters
    ----------
    source : Source
        A recording or a port; it is closed in the end.
    scene : Scene
        What stays.
    make : callable
        Makes the filter.
    rate : float
        Rows a second, Hz, as long as the source has not said it.
    page, terminal : bool
        Where to show it.
    browser : bool
        Whether a browser is opened with the page.
    speed : float
        Recording seconds a second to begin with.
    sink : callable, optional
        Is given all frames.
    say : callable, optional
        Told where the page is.

    Returns
    -------
    Show
        As it stands in the end.

    Raises
    ------
    InputError
        If the source cannot be read.
    KeyboardInterrupt
        If a recording that nobody looks at is interrupted.
    """
    show = Show(scene, rate, speed=speed, keep=_KEPT_OF_A_PORT if scene.live else None)
    pump = Pump(source, make, show, sink)
    over = threading.Event()
    server = LiveServer(show) if page else None
    try:
        pump.start()
        if server is not None:
            server.start()
            if say is not None:
                say(f"Live view: {server.address} (Ctrl-C ends it)")
            if browser:
                _open(server.address)
        # Half a recording is no answer where nobody looked at it.
        expected = (KeyboardInterrupt,) if page or terminal or scene.live else ()
        with contextlib.suppress(*expected):
            if terminal:
                _terminal(show, pump, over)
            else:
                while pump.running or (page and pump.fault is None):
                    over.wait(_LOOK)
    finally:
        if server is not None:
            server.stop()
        pump.stop()
    if pump.fault is not None:
        raise pump.fault
    return show


def _terminal(show: Show, pump: Pump, over: threading.Event) -> None:
    from rich.console import Console

    from bayes_asv.live.terminal import watch_in_terminal

    def fails() -> None:
        pump.wait()
        if pump.fault is not None:
            over.set()

    threading.Thread(target=fails, name="faults", daemon=True).start()
    watch_in_terminal(show, Console(stderr=True), over)


def _open(address: str) -> None:
    """Open a window of a browser, never one that would take over this terminal."""
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        return
    # A browser may take its time to start, or forever.
    threading.Thread(target=webbrowser.open, args=(address,), name="browser", daemon=True).start()
