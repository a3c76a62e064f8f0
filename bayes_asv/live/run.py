"""Following a source to its end, or until Ctrl-C, with a page, in the terminal, both or neither."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import webbrowser
from collections.abc import Callable

from bayes_asv.live.metadata import ViewMetadata
from bayes_asv.live.server import LiveServer
from bayes_asv.live.session import Session
from bayes_asv.live.sources import Source, StreamInfo
from bayes_asv.live.worker import StreamFilter, Worker
from bayes_asv.tracking.frames import Frames

__all__ = ["follow"]

_PORT_ROWS = 500_000  # rows of a port that the view keeps at least: ten minutes at 800 Hz
_POLL_INTERVAL = 0.2  # s


def follow(
    source: Source,
    metadata: ViewMetadata,
    make: Callable[[StreamInfo], StreamFilter],
    *,
    rate: float = 400.0,
    page: bool = False,
    terminal: bool = False,
    browser: bool = True,
    speed: float = 1.0,
    sink: Callable[[Frames], None] | None = None,
    say: Callable[[str], None] | None = None,
) -> Session:
    """Run a filter over a source, and show it.

    With a page or in a terminal it continues until Ctrl-C (or q), so that the result can be looked
    at; without either, a recording is followed to its end and a port until Ctrl-C.

    Parameters
    ----------
    source : Source
        A recording or a port; it is closed at the end.
    metadata : ViewMetadata
        Names, units and limits.
    make : callable
        Makes the filter.
    rate : float
        Rows per second, Hz, until the source states it.
    page, terminal : bool
        Where to show it.
    browser : bool
        Whether to open a browser with the page.
    speed : float
        Initial playback speed, recording seconds per second.
    sink : callable, optional
        Receives all frames.
    say : callable, optional
        Called with the address of the page.

    Returns
    -------
    Session
        In its final state.

    Raises
    ------
    InputError
        If the source cannot be read.
    KeyboardInterrupt
        If a recording without a view is interrupted.
    """
    session = Session(metadata, rate, speed=speed, keep=_PORT_ROWS if metadata.live else None)
    worker = Worker(source, make, session, sink)
    over = threading.Event()
    server = LiveServer(session) if page else None
    try:
        worker.start()
        if server is not None:
            server.start()
            if say is not None:
                say(f"Live view: {server.address} (Ctrl-C ends it)")
            if browser:
                _open_browser(server.address)
        # Half a recording is no result if nobody looked at it.
        expected = (KeyboardInterrupt,) if page or terminal or metadata.live else ()
        with contextlib.suppress(*expected):
            if terminal:
                _show_in_terminal(session, worker, over)
            else:
                while worker.running or (page and worker.error is None):
                    over.wait(_POLL_INTERVAL)
    finally:
        if server is not None:
            server.stop()
        worker.stop()
    if worker.error is not None:
        raise worker.error
    return session


def _show_in_terminal(session: Session, worker: Worker, over: threading.Event) -> None:
    from rich.console import Console

    from bayes_asv.live.terminal import run_terminal_view

    def end_on_error() -> None:
        worker.wait()
        if worker.error is not None:
            over.set()

    threading.Thread(target=end_on_error, name="errors", daemon=True).start()
    run_terminal_view(session, Console(stderr=True), over)


def _open_browser(address: str) -> None:
    """Open a browser window, but no text browser that would take over this terminal."""
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        return
    # In a thread, because a browser may take long to start, or never return.
    threading.Thread(target=webbrowser.open, args=(address,), name="browser", daemon=True).start()
