"""One page for browsers on this machine: files, a stream of events, and a few controls.

Nothing but the loopback address is listened on.  The Host header has to name it, so that a page
whose name was pointed at this machine (DNS rebinding) gets nothing, and an Origin has to be our
own, so that no other page may listen or press buttons.  There is a fixed list of files, and no path
is ever looked up on disk.
"""

from __future__ import annotations

import contextlib
import json
import socket
import threading
import time
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import Any, Final
from urllib.parse import parse_qs

from bayes_asv.domain.errors import InputError
from bayes_asv.live.session import Show
from bayes_asv.live.stream import WINDOWS, Viewer, scene_message

__all__ = ["FRAMES_A_SECOND", "HEADERS", "LiveServer"]

FRAMES_A_SECOND: Final = 25.0

HEADERS: Final = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
        "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Sent with every answer: the page may load what this server serves, and nothing else."""

_LOOPBACK: Final = "127.0.0.1"
_FILES: Final = {
    "/": ("index.html", "text/html; charset=utf-8"),
    "/live.css": ("live.css", "text/css; charset=utf-8"),
    "/main.js": ("main.js", "text/javascript; charset=utf-8"),
    "/charts.js": ("charts.js", "text/javascript; charset=utf-8"),
    "/panels.js": ("panels.js", "text/javascript; charset=utf-8"),
    "/link.js": ("link.js", "text/javascript; charset=utf-8"),
    "/uplot/uPlot.iife.min.js": ("uplot/uPlot.iife.min.js", "text/javascript; charset=utf-8"),
    "/uplot/uPlot.min.css": ("uplot/uPlot.min.css", "text/css; charset=utf-8"),
    "/uplot/LICENSE": ("uplot/LICENSE", "text/plain; charset=utf-8"),
}

_MOST_VIEWERS: Final = 32
_LONGEST_BODY: Final = 1000  # bytes; a control needs fifty
_HEARTBEAT: Final = 5.0  # s without news after which a line is sent to see whether anybody is there
_SEND_BUFFER: Final = 65_536  # bytes: a slow browser is then a few seconds late, not minutes
_USUAL_WINDOW: Final = 10.0  # s
_PATIENCE: Final = 20.0  # s for a request to arrive, or for a browser to take a frame


class LiveServer(ThreadingHTTPServer):
    """Serves a show on a free port of the loopback address.

    Parameters
    ----------
    show : Show
        What is watched.
    frames : float
        Frames a second at most, a viewer.
    """

    daemon_threads = True
    block_on_close = False
    request_queue_size = 64

    def __init__(self, show: Show, frames: float = FRAMES_A_SECOND) -> None:
        self.show = show
        self.interval = 1.0 / frames
        self.stopping = threading.Event()
        self.viewers = threading.BoundedSemaphore(_MOST_VIEWERS)
        folder = resources.files("bayes_asv.live") / "static"
        self.files = {
            path: (folder.joinpath(name).read_bytes(), kind)
            for path, (name, kind) in _FILES.items()
        }
        super().__init__((_LOOPBACK, 0), _Handler)
        self.port: int = self.server_address[1]
        self.hosts = {f"{_LOOPBACK}:{self.port}", f"localhost:{self.port}"}
        self.origins = {f"http://{host}" for host in self.hosts}
        self._thread = threading.Thread(
            target=self.serve_forever, kwargs={"poll_interval": 0.1}, name="server", daemon=True
        )

    @property
    def address(self) -> str:
        """What to type into a browser."""
        return f"http://{_LOOPBACK}:{self.port}/"

    def start(self) -> None:
        """Serve in a thread."""
        self._thread.start()

    def stop(self) -> None:
        """Tell the viewers, and serve no more."""
        self.stopping.set()
        if self._thread.is_alive():  # else there is nobody who could end
            self.shutdown()
            self._thread.join(timeout=5.0)
        self.server_close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing: a browser that leaves in the middle is no fault of anybody."""


class _Handler(BaseHTTPRequestHandler):
    server: LiveServer
    protocol_version = "HTTP/1.1"
    server_version = "bayes-asv"
    sys_version = ""
    timeout = _PATIENCE
    disable_nagle_algorithm = True  # a frame is to be seen now, not with the next one

    def do_GET(self) -> None:
        """Send a file, or events."""
        if self._refused():
            return
        path, _, query = self.path.partition("?")
        if path == "/events":
            self._events(query)
        elif path in self.server.files:
            data, kind = self.server.files[path]
            self._answer(HTTPStatus.OK, data, kind)
        else:
            self._say(HTTPStatus.NOT_FOUND, "there is no such page")

    def do_HEAD(self) -> None:
        """Send what a GET would send, without its body."""
        self.do_GET()

    def do_POST(self) -> None:
        """Do what a control asks."""
        if self._refused(changing=True):
            return
        if self.path != "/control":
            self._say(HTTPStatus.NOT_FOUND, "there is no such page")
            return
        length = self.headers.get("Content-Length", "")
        if not length.isascii() or not length.isdigit() or int(length) > _LONGEST_BODY:
            self.close_connection = True  # what follows is not to be taken for a request
            self._say(HTTPStatus.BAD_REQUEST, "the request is too long or does not say how long")
            return
        try:
            wish = json.loads(self.rfile.read(int(length)))
            if not isinstance(wish, dict):
                raise ValueError("not an object")
            self.server.show.ask(str(wish.get("do")), wish.get("value"))
        except InputError as fault:
            self._say(HTTPStatus.BAD_REQUEST, str(fault))
        except (ValueError, RecursionError):
            self._say(HTTPStatus.BAD_REQUEST, 'write {"do": "pause"}')
        else:
            self._answer(HTTPStatus.NO_CONTENT, b"", "")

    def _refused(self, *, changing: bool = False) -> bool:
        """Refuse whoever does not come from our own page; whether that was so."""
        server = self.server
        hosts = self.headers.get_all("Host") or []
        origins = self.headers.get_all("Origin") or []
        wrong = ""
        if len(hosts) != 1 or hosts[0].lower() not in server.hosts:
            wrong = "this address is not served"
        elif any(origin.lower() not in server.origins for origin in origins) or len(origins) > 1:
            wrong = "other pages may not look here"
        elif changing and not origins:
            wrong = "only the page itself may do that"
        if wrong:
            self.close_connection = True
            self._say(HTTPStatus.FORBIDDEN, wrong)
        return bool(wrong)

    def _events(self, query: str) -> None:
        """Send frames until the browser or the program leaves."""
        window = _window(query)
        if window is None:
            low, high = WINDOWS
            self._say(HTTPStatus.BAD_REQUEST, f"window lies between {low:g} and {high:g} s")
            return
        self.close_connection = True
        if not self.server.viewers.acquire(blocking=False):
            self._say(HTTPStatus.SERVICE_UNAVAILABLE, "too many pages look at once")
            return
        try:
            self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
            self._head(HTTPStatus.OK, {"Content-Type": "text/event-stream; charset=utf-8"})
            if self.command == "GET":
                show = self.server.show
                self._event("scene", scene_message(show.scene))
                _pace(Viewer(show, window), self._event, self._beat, self.server)
        except OSError:  # the browser has left, or took nothing for too long
            pass
        finally:
            self.server.viewers.release()

    def _event(self, name: str, data: object) -> None:
        text = json.dumps(data, separators=(",", ":"), allow_nan=False)
        self.wfile.write(f"event: {name}\ndata: {text}\n\n".encode())

    def _beat(self) -> None:
        self.wfile.write(b":\n\n")

    def _say(self, status: HTTPStatus, text: str) -> None:
        self._answer(status, f"{text}\n".encode(), "text/plain; charset=utf-8")

    def _answer(self, status: HTTPStatus, data: bytes, kind: str) -> None:
        headers = {"Content-Type": kind} if kind else {}
        if self.close_connection:
            headers["Connection"] = "close"
        if status is not HTTPStatus.NO_CONTENT:
            headers["Content-Length"] = str(len(data))
        self._head(status, headers)
        if self.command != "HEAD":
            self.wfile.write(data)

    def _head(self, status: HTTPStatus, headers: dict[str, str]) -> None:
        self.send_response(status)
        for name, value in {**HEADERS, **headers}.items():
            self.send_header(name, value)
        self.end_headers()

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Answer a request that is none in one plain line, without quoting it."""
        self.close_connection = True
        with contextlib.suppress(OSError):
            self._say(HTTPStatus(code), HTTPStatus(code).phrase.lower())

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing: standard error belongs to the program."""


def _pace(
    viewer: Viewer,
    send: Callable[[str, object], None],
    beat: Callable[[], None],
    server: LiveServer,
) -> None:
    """Send what is new, so many times a second; a send that waits costs frames, not memory."""
    due = heard = time.monotonic()
    while not server.stopping.is_set():
        message = viewer.message()
        now = time.monotonic()
        if message is not None:
            send("frame", message)
            heard = now
        elif now - heard > _HEARTBEAT:
            beat()
            heard = now
        due += server.interval
        late = time.monotonic() - due
        if late > 0.0:
            due += late  # frames that could not be sent are not made up for
        server.stopping.wait(max(-late, 0.0))
    send("end", {})


def _window(query: str) -> float | None:
    """Seconds of traces that are asked for, or None where that is no window."""
    try:
        asked = parse_qs(query, max_num_fields=8).get("window")
        window = float(asked[-1]) if asked else _USUAL_WINDOW
    except ValueError:
        return None
    return window if WINDOWS[0] <= window <= WINDOWS[1] else None
