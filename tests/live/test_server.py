"""The server, its files, events and controls, and its protection against other pages."""

from __future__ import annotations

import http.client
import json
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from bayes_asv.live.server import HEADERS, LiveServer
from tests.live.synthetic import CurveBuffer, finished_session, new_session, wait_for


def _serving(seconds: float) -> Iterator[LiveServer]:
    made = LiveServer(finished_session(seconds))
    made.start()
    yield made
    made.stop()


@pytest.fixture(scope="module")
def server() -> Iterator[LiveServer]:
    """A server for all tests without controls; it never reaches its end."""
    yield from _serving(60.0)


@pytest.fixture
def own_server() -> Iterator[LiveServer]:
    """A server for a single test."""
    yield from _serving(4.0)


class Answer:
    def __init__(self, response: http.client.HTTPResponse) -> None:
        self.status = response.status
        self.headers = {name.lower(): value for name, value in response.getheaders()}
        self.body = response.read()


def request(
    server: LiveServer, method: str, path: str, body: bytes | None = None, **headers: str
) -> Answer:
    """Send one request; header names with _ for -, empty headers left out."""
    sent = {
        "Host": f"127.0.0.1:{server.port}",
        **{k.replace("_", "-"): v for k, v in headers.items()},
    }
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
    for name, value in sent.items():
        if value:
            connection.putheader(name, value)
    if body is not None and "Content-Length" not in sent:
        connection.putheader("Content-Length", str(len(body)))
    connection.endheaders(body)
    try:
        return Answer(connection.getresponse())
    finally:
        connection.close()


def own(server: LiveServer) -> str:
    return server.address.rstrip("/")


def send_control(server: LiveServer, **what: Any) -> Answer:
    return request(server, "POST", "/control", json.dumps(what).encode(), Origin=own(server))


class Events:
    """An open stream of events."""

    def __init__(self, server: LiveServer, query: str = "", buffer: int | None = None) -> None:
        self.socket = socket.socket()
        if buffer is not None:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
        self.socket.settimeout(10.0)
        self.socket.connect(("127.0.0.1", server.port))
        host = f"127.0.0.1:{server.port}"
        self.socket.sendall(f"GET /events{query} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
        self.file = self.socket.makefile("rb")
        self.status = int(self.file.readline().split()[1])
        while self.file.readline().strip():
            pass

    def __iter__(self) -> Iterator[tuple[str, Any]]:
        name = ""
        for line in self.file:
            text = line.decode().rstrip("\n")
            if text.startswith("event: "):
                name = text[7:]
            elif text.startswith("data: "):
                yield name, json.loads(text[6:])

    def close(self) -> None:
        self.file.close()
        self.socket.close()


def test_page_and_files(server: LiveServer) -> None:
    page = request(server, "GET", "/")
    assert page.status == 200
    assert page.headers["content-type"] == "text/html; charset=utf-8"
    text = page.body.decode()
    for path in ("/live.css", "/main.js", "/uplot/uPlot.iife.min.js", "/uplot/uPlot.min.css"):
        assert f'"{path}"' in text
        assert request(server, "GET", path).status == 200
    for name in ("charts", "panels", "link"):
        script = request(server, "GET", f"/{name}.js")
        assert script.headers["content-type"].startswith("text/javascript")
    assert b"Leon Sorokin" in request(server, "GET", "/uplot/LICENSE").body
    # Nothing inline, nothing external: the policy below would block it.
    for part in ("<style", "style=", "onclick", "http://", "https://", "<script>"):
        assert part not in text
    head = request(server, "HEAD", "/")
    assert (head.status, head.body) == (200, b"")


@pytest.mark.parametrize("path", ["/", "/main.js", "/events", "/nothing"])
def test_security_headers(server: LiveServer, path: str) -> None:
    answer = request(server, "HEAD", path)
    for name, value in HEADERS.items():
        assert answer.headers[name.lower()] == value
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "script-src 'self'" in policy
    assert "frame-ancestors 'none'" in policy
    assert "unsafe" not in policy
    assert "*" not in policy
    assert "Python" not in answer.headers["server"]


def test_only_the_loopback_address_is_served(server: LiveServer) -> None:
    assert server.socket.getsockname()[0] == "127.0.0.1"
    # A server on all addresses would answer on this one as well.
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.2", server.port), timeout=5)


@pytest.mark.parametrize(
    "host",
    ["evil.example:{port}", "127.0.0.1", "127.0.0.1:1", "localhost.evil.example:{port}", "",
     "127.0.0.1:{port}.evil.example", "[::1]:{port}", "0.0.0.0:{port}"],
)  # fmt: skip
@pytest.mark.parametrize("path", ["/", "/events", "/control"])
def test_another_host_is_refused(server: LiveServer, host: str, path: str) -> None:
    method = "POST" if path == "/control" else "GET"
    named = host.format(port=server.port)
    answer = request(server, method, path, b'{"do":"pause"}', Host=named, Origin=own(server))
    assert answer.status == 403
    assert b"html" not in answer.body
    assert server.session.playback().state == "playing"


def test_two_hosts_are_refused(server: LiveServer) -> None:
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as line:
        host = f"127.0.0.1:{server.port}"
        line.sendall(f"GET / HTTP/1.1\r\nHost: {host}\r\nHost: evil\r\n\r\n".encode())
        assert b" 403 " in line.recv(100)


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "null", "https://127.0.0.1:{port}", "http://127.0.0.1:1",
     "http://localhost", "file://"],
)  # fmt: skip
@pytest.mark.parametrize("path", ["/", "/events", "/main.js", "/control"])
def test_another_origin_is_refused(server: LiveServer, origin: str, path: str) -> None:
    named = origin.format(port=server.port)
    method = "POST" if path == "/control" else "GET"
    assert request(server, method, path, b'{"do":"pause"}', Origin=named).status == 403
    assert server.session.playback().state == "playing"


def test_own_page_has_access_by_both_names(server: LiveServer) -> None:
    port = server.port
    for name in ("127.0.0.1", "localhost"):
        host = f"{name}:{port}"
        assert request(server, "GET", "/", Host=host, Origin=f"http://{host}").status == 200


def test_a_control_without_an_origin_is_refused(server: LiveServer) -> None:
    assert request(server, "POST", "/control", b'{"do":"pause"}').status == 403


@pytest.mark.parametrize(
    "path",
    ["/../server.py", "/..%2fserver.py", "/%2e%2e/server.py", "//etc/passwd", "/uplot/../main.py",
     "/uplot", "/index.html/", "/etc/passwd", "/..\\server.py", "/main.js%00", "/.", "/main.js/"],
)  # fmt: skip
def test_no_other_path_is_served(server: LiveServer, path: str) -> None:
    answer = request(server, "GET", path)
    assert answer.status == 404
    assert answer.body == b"there is no such page\n"


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (b"", "write"), (b"{", "write"), (b"[1]", "write"), (b'{"do":"fly"}', "no such action"),
        (b'{"do":"speed","value":1e9}', "between"), (b'{"do":"speed"}', "needs a number"),
        (b'{"do":"seek","value":NaN}', "number of seconds"), (b"[" * 900, "write"),
    ],
)  # fmt: skip
def test_invalid_controls_are_refused(server: LiveServer, body: bytes, message: str) -> None:
    answer = request(server, "POST", "/control", body, Origin=own(server))
    assert answer.status == 400
    assert message in answer.body.decode()


def test_long_controls_are_not_read(server: LiveServer) -> None:
    for length in ("100000000", "-1", "x", "1_0"):
        answer = request(server, "POST", "/control", b"", Origin=own(server), Content_Length=length)
        assert answer.status == 400
        assert answer.headers["connection"] == "close"
    assert request(server, "POST", "/", b"{}", Origin=own(server)).status == 404


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "TRACE", "CONNECT"])
def test_other_methods_are_refused(server: LiveServer, method: str) -> None:
    answer = request(server, method, "/")
    assert answer.status == 501
    assert "access-control-allow-origin" not in answer.headers


def test_invalid_requests_are_not_quoted(server: LiveServer) -> None:
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as line:
        line.sendall(b"<script>alert(1)</script> / HTTP/9.9\r\n\r\n")
        said = line.recv(10_000)
    assert b"script>" not in said
    assert request(server, "GET", "/").status == 200


@pytest.mark.parametrize("window", ["0", "-1", "1e9", "nan", "x", "inf"])
def test_invalid_windows_are_refused(server: LiveServer, window: str) -> None:
    assert request(server, "GET", f"/events?window={window}").status == 400


def test_events_and_controls(own_server: LiveServer) -> None:
    events = Events(own_server, "?window=2")
    stream = iter(events)
    name, metadata = next(stream)
    assert name == "scene"
    assert metadata["vehicle"] == own_server.session.metadata.vehicle
    name, first = next(stream)
    assert (name, first["state"]) == ("frame", "playing")
    assert send_control(own_server, do="speed", value=10).status == 204
    for _, frame in stream:
        if frame["speed"] == 10:
            break
    assert send_control(own_server, do="pause").status == 204
    for _, frame in stream:
        if frame["state"] == "paused":
            break
    assert send_control(own_server, do="seek", value=1.0).status == 204
    assert next(stream)[1]["position"] == 1.0
    assert send_control(own_server, do="restart").status == 204
    assert next(stream)[1]["position"] < 1.0
    events.close()


def test_several_viewers_see_the_same(own_server: LiveServer) -> None:
    send_control(own_server, do="speed", value=10)
    seen: list[CurveBuffer] = []

    def look() -> None:
        events, run = Events(own_server), CurveBuffer()
        for name, frame in events:
            if name == "frame" and "run" in frame:
                run.take(frame["run"])
                if frame["state"] == "ended":
                    break
        seen.append(run)
        events.close()

    threads = [threading.Thread(target=look) for _ in range(5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20.0)
    assert len(seen) == 5
    for run in seen:
        assert run.time == seen[0].time
        assert run.columns == seen[0].columns
    assert len(seen[0].time) > 1000


def test_a_blocked_browser_does_not_delay_others() -> None:
    session, worker = new_session(60.0, 800.0, speed=100.0)
    server = LiveServer(session, frame_rate=500.0)
    server.start()
    blocked = Events(server, "?window=120", buffer=2048)
    worker.start()
    assert worker.wait(20.0)  # the filter does not wait for viewers
    other, run = Events(server), CurveBuffer()
    began = time.monotonic()
    for name, frame in other:
        if name == "frame" and "run" in frame:
            run.take(frame["run"])
            if frame["state"] == "ended":
                break
    assert time.monotonic() - began < 10.0
    # By now the blocked one has missed most frames; what it gets is still complete.
    late, frames, traces = CurveBuffer(), 0, CurveBuffer()
    for name, frame in blocked:
        if name == "frame" and "run" in frame:
            late.take(frame["run"])
            traces.take(frame["traces"])
            frames += 1
            if frame["state"] == "ended":
                break
    assert late.columns == run.columns
    assert frames < 200
    blocked.close()
    other.close()
    server.stop()


def test_number_of_viewers_is_limited(
    own_server: LiveServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(own_server, "viewers", threading.BoundedSemaphore(2))
    first, second = Events(own_server), Events(own_server)
    third = Events(own_server)
    assert (first.status, second.status, third.status) == (200, 200, 503)
    for events in (first, second, third):
        events.close()

    def accepted() -> bool:  # disconnected viewers make room
        events = Events(own_server)
        events.close()
        return events.status == 200

    wait_for(accepted)


def test_server_that_never_started_can_be_stopped() -> None:
    server = LiveServer(finished_session(0.1))
    server.stop()
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", server.port), timeout=2)


def test_stopping_notifies_the_viewers() -> None:
    server = LiveServer(finished_session(4.0))
    server.start()
    events = Events(server)
    stream = iter(events)
    next(stream)
    began = time.monotonic()
    server.stop()
    names = [name for name, _ in stream]
    assert names[-1] == "end"
    assert time.monotonic() - began < 3.0
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", server.port), timeout=2)
    events.close()
