"""HTTP server of the live page, for browsers on this machine: files, events and controls.

It listens on the loopback address only.  The Host header has to name that address, so that a page
whose name was pointed at this machine (DNS rebinding) gets nothing; an Origin has to be the page's
own, so that no other page can read events or send controls.  The list of files is fixed, and no
path is looked up on disk.
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
from bayes_asv.live.session import Session
from bayes_asv.live.viewer import WINDOWS, Viewer, metadata_message

__all__ = ["FRAME_RATE", "HEADERS", "LiveServer"]

FRAME_RATE: Final = 25.0
"""Frames per second."""

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
"""Sent with every response: the page may load what this server serves, and nothing else."""

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

_MAX_VIEWERS: Final = 32
_MAX_BODY: Final = 1000  # bytes; a control needs fifty
_HEARTBEAT: Final = 5.0  # s without a message after which a comment detects closed connections
_SEND_BUFFER: Final = 65_536  # bytes, so that a slow browser lags by seconds, not minutes
_DEFAULT_WINDOW: Final = 10.0  # s
_TIMEOUT: Final = 20.0  # s for a request to arrive, or for a browser to accept a frame


class LiveServer(ThreadingHTTPServer):
    """Serves a session on a free port of the loopback address.

    Parameters
    ----------
    session : Session
        What is shown.
    frame_rate : float
        Frames per second and viewer, at most.
    """

    daemon_threads = True
    block_on_close = False
    request_queue_size = 64

    def __init__(self, session: Session, frame_rate: float = FRAME_RATE) -> None:
        self.session = session
        self.interval = 1.0 / frame_rate
        self.stopping = threading.Event()
        self.viewers = threading.BoundedSemaphore(_MAX_VIEWERS)
        folder = resources.files("bayes_asv.live") / "static"
        self.files = {
            path: (folder.joinpath(name).read_bytes(), content_type)
            for path, (name, content_type) in _FILES.items()
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
        """URL of the page."""
        return f"http://{_LOOPBACK}:{self.port}/"

    def start(self) -> None:
        """Serve in a thread."""
        self._thread.start()

    def stop(self) -> None:
        """Notify the viewers, and stop serving."""
        self.stopping.set()
        if self._thread.is_alive():  # otherwise shutdown would wait forever
            self.shutdown()
            self._thread.join(timeout=5.0)
        self.server_close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print nothing: a browser that disconnects is no error."""


class _Handler(BaseHTTPRequestHandler):
    server: LiveServer
    protocol_version = "HTTP/1.1"
    server_version = "bayes-asv"
    sys_version = ""
    timeout = _TIMEOUT
    disable_nagle_algorithm = True  # a frame is sent at once, not with the next one

    def do_GET(self) -> None:
        """Send a file, or events."""
        if self._forbidden():
            return
        path, _, query = self.path.partition("?")
        if path == "/events":
            self._send_events(query)
        elif path in self.server.files:
            data, content_type = self.server.files[path]
            self._send(HTTPStatus.OK, data, content_type)
        else:
            self._send_text(HTTPStatus.NOT_FOUND, "there is no such page")

    def do_HEAD(self) -> None:
        """Send what a GET would send, without its body."""
        self.do_GET()

    def do_POST(self) -> None:
        """Perform a control."""
        if self._forbidden(changes=True):
            return
        if self.path != "/control":
            self._send_text(HTTPStatus.NOT_FOUND, "there is no such page")
            return
        length = self.headers.get("Content-Length", "")
        if not length.isascii() or not length.isdigit() or int(length) > _MAX_BODY:
            self.close_connection = True  # what follows must not be parsed as a request
            self._send_text(HTTPStatus.BAD_REQUEST, "the request is too long or lacks its length")
            return
        try:
            request = json.loads(self.rfile.read(int(length)))
            if not isinstance(request, dict):
                raise ValueError("not an object")
            self.server.session.control(str(request.get("do")), request.get("value"))
        except InputError as error:
            self._send_text(HTTPStatus.BAD_REQUEST, str(error))
        except (ValueError, RecursionError):
            self._send_text(HTTPStatus.BAD_REQUEST, 'write {"do": "pause"}')
        else:
            self._send(HTTPStatus.NO_CONTENT, b"", "")

    def _forbidden(self, *, changes: bool = False) -> bool:
        """Reject requests that do not come from the page itself; return whether it did."""
        server = self.server
        hosts = self.headers.get_all("Host") or []
        origins = self.headers.get_all("Origin") or []
        reason = ""
        if len(hosts) != 1 or hosts[0].lower() not in server.hosts:
            reason = "this address is not served"
        elif any(origin.lower() not in server.origins for origin in origins) or len(origins) > 1:
            reason = "other pages have no access"
        elif changes and not origins:
            reason = "only the page itself may send controls"
        if reason:
            self.close_connection = True
            self._send_text(HTTPStatus.FORBIDDEN, reason)
        return bool(reason)

    def _send_events(self, query: str) -> None:
        """Send frames until the browser disconnects or the program ends."""
        window = _window(query)
        if window is None:
            low, high = WINDOWS
            self._send_text(HTTPStatus.BAD_REQUEST, f"window lies between {low:g} and {high:g} s")
            return
        self.close_connection = True
        if not self.server.viewers.acquire(blocking=False):
            self._send_text(HTTPStatus.SERVICE_UNAVAILABLE, "too many pages are open")
            return
        try:
            self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
            self._send_head(HTTPStatus.OK, {"Content-Type": "text/event-stream; charset=utf-8"})
            if self.command == "GET":
                session = self.server.session
                self._send_event("scene", metadata_message(session.metadata))
                viewer = Viewer(session, window)
                _send_messages(viewer, self._send_event, self._send_heartbeat, self.server)
        except OSError:  # the browser has disconnected, or accepted nothing for too long
            pass
        finally:
            self.server.viewers.release()

    def _send_event(self, name: str, data: object) -> None:
        text = json.dumps(data, separators=(",", ":"), allow_nan=False)
        self.wfile.write(f"event: {name}\ndata: {text}\n\n".encode())

    def _send_heartbeat(self) -> None:
        self.wfile.write(b":\n\n")

    def _send_text(self, status: HTTPStatus, text: str) -> None:
        self._send(status, f"{text}\n".encode(), "text/plain; charset=utf-8")

    def _send(self, status: HTTPStatus, data: bytes, content_type: str) -> None:
        headers = {"Content-Type": content_type} if content_type else {}
        if self.close_connection:
            headers["Connection"] = "close"
        if status is not HTTPStatus.NO_CONTENT:
            headers["Content-Length"] = str(len(data))
        self._send_head(status, headers)
        if self.command != "HEAD":
            self.wfile.write(data)

    def _send_head(self, status: HTTPStatus, headers: dict[str, str]) -> None:
        self.send_response(status)
        for name, value in {**HEADERS, **headers}.items():
            self.send_header(name, value)
        self.end_headers()

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Respond to an invalid request in one plain line, without quoting it."""
        self.close_connection = True
        with contextlib.suppress(OSError):
            self._send_text(HTTPStatus(code), HTTPStatus(code).phrase.lower())

    def log_message(self, format: str, *args: object) -> None:
        """Print nothing: standard error belongs to the program."""


def _send_messages(
    viewer: Viewer,
    send: Callable[[str, object], None],
    send_heartbeat: Callable[[], None],
    server: LiveServer,
) -> None:
    """Send what is new at the frame rate; a send that blocks costs frames, not memory."""
    due = sent = time.monotonic()
    while not server.stopping.is_set():
        message = viewer.message()
        now = time.monotonic()
        if message is not None:
            send("frame", message)
            sent = now
        elif now - sent > _HEARTBEAT:
            send_heartbeat()
            sent = now
        due += server.interval
        late = time.monotonic() - due
        if late > 0.0:
            due += late  # frames that could not be sent are skipped
        server.stopping.wait(max(-late, 0.0))
    send("end", {})


def _window(query: str) -> float | None:
    """Return the requested window, s, or None if it is invalid."""
    try:
        values = parse_qs(query, max_num_fields=8).get("window")
        window = float(values[-1]) if values else _DEFAULT_WINDOW
    except ValueError:
        return None
    return window if WINDOWS[0] <= window <= WINDOWS[1] else None
