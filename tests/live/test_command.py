"""``bayes-asv track`` with a page, with a port, and with invalid options."""

from __future__ import annotations

import http.client
import json
import math
import os
import signal
import subprocess
import sys
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from bayes_asv.domain.vehicle import read_vehicle
from bayes_asv.io import read_recording
from bayes_asv.tracking.track import track

ROOT = Path(__file__).parents[2]
STOPS = ROOT / "data" / "recordings" / "stops-400hz.csv"
BAJA = ROOT / "data" / "vehicles" / "baja2008.toml"


class Track(subprocess.Popen[str]):
    """The command as a process."""

    def __init__(self, *words: object, cwd: Path = ROOT) -> None:
        super().__init__(
            [sys.executable, "-m", "bayes_asv", "track", *map(str, words), "-v", str(BAJA)],
            cwd=cwd, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )  # fmt: skip

    def line_starting(self, start: str) -> str:
        """First line on standard error that starts with a text."""
        assert self.stderr is not None
        for line in self.stderr:
            if line.startswith(start):
                return line
        raise AssertionError(f"ended with {self.wait()}")

    def interrupt(self) -> tuple[int, str, str]:
        self.send_signal(signal.SIGINT)
        out, err = self.communicate(timeout=60)
        return self.returncode, out, err


@contextmanager
def page_events(line: str) -> Iterator[Iterator[tuple[str, Any]]]:
    """Events of the page whose address is in a line."""
    address = line.split()[2]
    host, port = address.removeprefix("http://").rstrip("/").split(":")
    connection = http.client.HTTPConnection(host, int(port), timeout=60)
    connection.request("GET", "/events")
    response = connection.getresponse()
    assert response.status == 200

    def events() -> Iterator[tuple[str, Any]]:
        name = ""
        for raw in response:
            text = raw.decode().rstrip("\n")
            if text.startswith("event: "):
                name = text[7:]
            elif text.startswith("data: "):
                yield name, json.loads(text[6:])

    yield events()
    connection.close()


def test_page_and_result_of_a_recording(tmp_path: Path) -> None:
    saved = tmp_path / "track.json"
    running = Track(STOPS, "--live", "--no-browser", "--speed", 10, "--json", saved)
    with page_events(running.line_starting("Live view: ")) as events:
        frame = next(f for n, f in events if n == "frame" and f["state"] == "ended")
    status, out, err = running.interrupt()
    assert (status, err) == (0, "")
    assert out.startswith("Front damper: ")
    parameter = json.loads(saved.read_text())["parameters"]["c_f"]
    median = frame["run"]["columns"][0][-1]
    assert median == pytest.approx(parameter["median"], rel=1e-3)
    assert frame["end"] == pytest.approx(2.0, abs=0.02)


def test_port_gives_the_result_of_its_file(tmp_path: Path) -> None:
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    from_port, kept = tmp_path / "port.json", tmp_path / "kept.csv"
    running = Track(
        "--port", os.ttyname(theirs), "--keep", kept, "--live", "--no-browser", "--json", from_port
    )
    with page_events(running.line_starting("Live view: ")) as events:
        data = STOPS.read_bytes()
        for start in range(0, len(data), 500):
            os.write(ours, data[start : start + 500])
        for name, frame in events:
            if name == "frame" and frame["end"] > 1.9:
                break
    status, _, err = running.interrupt()
    assert (status, err) == (0, "")
    assert kept.read_bytes() == data
    direct = track(read_recording(STOPS), read_vehicle(BAJA)).frames
    parameters = json.loads(from_port.read_text())["parameters"]
    for n, name in enumerate(("c_f", "c_r", "i")):
        assert parameters[name]["si"]["median"] == pytest.approx(direct.median[-1, n], rel=1e-6)
        low, high = parameters[name]["si"]["eti95"]
        spread = math.log(high / low) / (2.0 * 1.959964)
        assert spread == pytest.approx(direct.log_sd[-1, n], rel=1e-4)
    os.close(ours)
    os.close(theirs)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ((), "either a recording or --port"),
        ((STOPS, "--port", "COM3"), "either a recording or --port"),
        ((STOPS, "--tui"), "needs a terminal"),
        ((STOPS, "--speed", "2"), "--speed belongs to"),
        ((STOPS, "--live", "--speed", "0"), "--speed"),
        ((STOPS, "--gif", "no/such/folder/a.gif"), "its folder does not exist"),
        (("--port", "/dev/nothing", "--keep", "{tmp}/x.txt"), "/dev/nothing: cannot be opened"),
    ],
)
def test_invalid_usage_is_one_line(
    words: tuple[object, ...], expected: str, tmp_path: Path
) -> None:
    running = Track(*(str(word).format(tmp=tmp_path) for word in words))
    out, err = running.communicate(timeout=60)
    assert running.returncode == 2
    assert out == ""
    assert err.startswith("bayes-asv: ")
    assert err.count("\n") == 1
    assert expected in err
