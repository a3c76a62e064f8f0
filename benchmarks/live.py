"""Frame rate of the live view in a browser, and processor time of the program.

``bayes-asv track --live`` runs as a user starts it, on a minute of rough road at 800 Hz: from the
recording at its own pace, and from a serial port (a pseudo-terminal into which another thread
writes the same rows when they are due).  A headless Chromium shows the whole page.  Measured are
the frames that it received and drew, the longest time between two, the delay of what it shows
behind what was sent (port), the processor time of the program with its filter, and that of the
browser; with one page open, and with three more readers of the event stream.

On a busy machine, ``chrt -r 5`` before the command schedules it and its child processes ahead of
other work; the results record that, and the load average.

``python -m benchmarks.live`` writes ``benchmarks/results/live.json``; with ``--pictures`` it
measures nothing and makes ``docs/live.png`` and ``docs/live.gif`` of a shipped recording.
"""

from __future__ import annotations

import argparse
import contextlib
import http.client
import json
import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tty
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bayes_asv import __version__
from bayes_asv.domain.vehicle import read_vehicle
from bayes_asv.live.metadata import view_metadata
from bayes_asv.live.port import PortReader
from bayes_asv.live.server import LiveServer
from bayes_asv.live.session import Session
from bayes_asv.live.sources import PortSource
from bayes_asv.live.worker import Worker
from bayes_asv.tracking.tracker import tracker_for
from benchmarks.provenance import current_commit

__all__ = ["main"]

ROOT = Path(__file__).parents[1]
RESULTS = Path(__file__).parent / "results" / "live.json"
VEHICLE = ROOT / "data" / "vehicles" / "baja2008.toml"
SHIPPED = ROOT / "data" / "recordings" / "stops-800hz.csv"
RATE = 800.0
MORE = 3  # readers besides the browser
_SETTLE = 4.0  # s before the measurement, so that the window is moving
_TICKS = os.sysconf("SC_CLK_TCK")

# Records when a frame was drawn, independently of the page's own timing.
_WATCH = """
const stats = window.liveStats;
const watch = window.watch = {from: performance.now(), drawn: stats.drawn,
                              received: stats.received, gaps: [], last: performance.now()};
let seen = stats.drawn;
(function look() {
    if (stats.drawn !== seen) {
        const now = performance.now();
        watch.gaps.push(now - watch.last);
        [seen, watch.last] = [stats.drawn, now];
    }
    requestAnimationFrame(look);
})();
"""
_COUNT = """
const [stats, watch] = [window.liveStats, window.watch];
const seconds = (performance.now() - watch.from) / 1000;
const gaps = watch.gaps.slice(1).sort((a, b) => a - b);
return {seconds, received: (stats.received - watch.received) / seconds,
        drawn: (stats.drawn - watch.drawn) / seconds,
        gap_median: gaps[gaps.length >> 1], gap_99: gaps[Math.floor(0.99 * gaps.length)],
        gap_longest: gaps[gaps.length - 1], charts: document.querySelectorAll('canvas').length};
"""


@dataclass(frozen=True)
class Program:
    """A running ``bayes-asv track --live``."""

    process: subprocess.Popen[str]
    address: str


def program(*words: str) -> Program:
    """Start the program, and read the address of its page."""
    process = subprocess.Popen(
        [sys.executable, "-m", "bayes_asv", "track", *words, "--vehicle", str(VEHICLE), "--live",
         "--no-browser"],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, cwd=ROOT,
    )  # fmt: skip
    assert process.stderr is not None
    for line in process.stderr:
        if line.startswith("Live view: "):
            return Program(process, line.split()[2])
    raise RuntimeError(f"bayes-asv track ended with {process.wait()}")


def end(running: Program) -> int:
    """End the program by Ctrl-C; return its exit status."""
    running.process.send_signal(signal.SIGINT)
    status = running.process.wait(timeout=30)
    assert running.process.stderr is not None
    running.process.stderr.close()
    return status


def processor_time(pids: list[int]) -> float:
    """User and system time of processes so far, s."""
    total = 0
    for pid in pids:
        with contextlib.suppress(OSError):
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            total += int(fields[11]) + int(fields[12])
    return total / _TICKS


def family(pid: int) -> list[int]:
    """Return a process and its descendants."""
    result = [pid]
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            with contextlib.suppress(OSError):
                fields = (folder / "stat").read_text().rpartition(")")[2].split()
                if int(fields[1]) == pid:
                    result += family(int(folder.name))
    return result


@contextlib.contextmanager
def browser() -> Iterator[tuple[Any, int]]:
    """Open a headless Chromium at 1280 by 1400, where every chart is visible."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    driver_path = shutil.which("chromedriver")
    if chromium is None or driver_path is None:
        raise RuntimeError("install chromium and chromedriver")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        options = webdriver.ChromeOptions()
        options.binary_location = chromium
        for flag in (
            "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
            "--disable-background-networking", "--disable-component-update", "--disable-sync",
            "--hide-scrollbars", "--window-size=1280,1400", f"--user-data-dir={profile}",
        ):  # fmt: skip
            options.add_argument(flag)
        service = Service(driver_path)
        driver = webdriver.Chrome(options=options, service=service)
        try:
            yield driver, service.process.pid
        finally:
            driver.quit()


@dataclass
class Reader:
    """Another viewer, which reads the event stream and counts."""

    address: str
    frames: int = 0
    octets: int = 0

    def run(self) -> None:
        host, port = self.address.removeprefix("http://").rstrip("/").split(":")
        connection = http.client.HTTPConnection(host, int(port), timeout=30)
        connection.request("GET", "/events?window=10")
        with contextlib.suppress(OSError):
            for line in connection.getresponse():
                self.octets += len(line)
                self.frames += line.startswith(b"event: frame")


def measure(address: str, pid: int, seconds: float, more: int) -> dict[str, Any]:
    """Measure a page for a time."""
    readers = [Reader(address) for _ in range(more)]
    with browser() as (driver, driver_pid):
        driver.get(address)
        for reader in readers:
            threading.Thread(target=reader.run, daemon=True).start()
        time.sleep(_SETTLE)
        before = processor_time([pid])
        browser_before = processor_time(family(driver_pid))
        frames, octets = sum(r.frames for r in readers), sum(r.octets for r in readers)
        began = time.perf_counter()
        driver.execute_script(_WATCH)
        time.sleep(seconds)
        result: dict[str, Any] = driver.execute_script(_COUNT)
        passed = time.perf_counter() - began
        result["program_core_percent"] = 100.0 * (processor_time([pid]) - before) / passed
        used = processor_time(family(driver_pid)) - browser_before
        result["browser_core_percent"] = 100.0 * used / passed
        if readers:
            result["reader_frames"] = (sum(r.frames for r in readers) - frames) / passed / more
            result["reader_kilobytes"] = (
                (sum(r.octets for r in readers) - octets) / passed / more / 1000.0
            )
        result["position"] = driver.execute_script("return window.liveStats.at")
        result["looked_at"] = time.perf_counter()
        driver.get("about:blank")
    return result


def replay(file: Path, seconds: float, more: int) -> dict[str, Any]:
    """Measure the view of a recording at its own pace."""
    running = program(str(file))
    try:
        row = measure(running.address, running.process.pid, seconds, more)
    finally:
        status = end(running)
    del row["looked_at"]
    return {"source": "recording", "viewers": 1 + more, **row, "exit_status": status}


class Logger(threading.Thread):
    """Writes the rows of a file to a serial line when they are due."""

    def __init__(self, file: Path, line: int) -> None:
        super().__init__(daemon=True)
        lines = file.read_bytes().splitlines(keepends=True)
        first = next(n for n, text in enumerate(lines) if text.startswith(b"time"))
        self.head, self.rows = b"".join(lines[: first + 1]), lines[first + 1 :]
        self.line, self.began, self.over = line, 0.0, threading.Event()

    def run(self) -> None:
        os.write(self.line, self.head)
        self.began = time.perf_counter()
        sent = 0
        while sent < len(self.rows) and not self.over.is_set():
            due = int((time.perf_counter() - self.began) * RATE)
            if due > sent:
                os.write(self.line, b"".join(self.rows[sent:due]))
                sent = due
            time.sleep(0.005)


def port(file: Path, folder: Path, seconds: float, more: int) -> dict[str, Any]:
    """Measure the view of a serial port."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    running = program("--port", os.ttyname(theirs), "--keep", str(folder / f"kept-{more}.txt"))
    logger = Logger(file, ours)
    try:
        logger.start()
        row = measure(running.address, running.process.pid, seconds, more)
    finally:
        logger.over.set()
        status = end(running)
        os.close(ours)
        os.close(theirs)
    row["behind"] = row.pop("looked_at") - logger.began - row["position"]
    return {"source": "port", "viewers": 1 + more, **row, "exit_status": status}


def threads(file: Path, folder: Path, seconds: float) -> dict[str, Any]:
    """Follow a port in this process with one viewer, and measure each of its threads."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    car, name = read_vehicle(VEHICLE), os.ttyname(theirs)
    source = PortSource(PortReader(name, folder / "kept-threads.txt"), name, car)
    session = Session(view_metadata(car, name, None, live=True), RATE)
    worker = Worker(source, lambda info: tracker_for(info.start, car, rate=info.rate), session)
    server, logger = LiveServer(session), Logger(file, ours)
    reader = threading.Thread(target=Reader(server.address).run, daemon=True)
    server.start()
    for part in (worker, logger, reader):
        part.start()
    time.sleep(_SETTLE)

    def thread_times() -> dict[str, float]:
        """Return the processor time of each thread so far, s."""
        result = {}
        for thread in threading.enumerate():
            stat = Path(f"/proc/self/task/{thread.native_id}/stat").read_text()
            fields = stat.rpartition(")")[2].split()
            result[thread.name] = (int(fields[11]) + int(fields[12])) / _TICKS
        return result

    before = thread_times()
    time.sleep(seconds)
    after = thread_times()
    logger.over.set()
    server.stop()
    worker.stop()
    os.close(ours)
    os.close(theirs)
    share = {k: 100.0 * (after[k] - before[k]) / seconds for k in before if k in after}
    return {
        "source": "port",
        "viewers": 1,
        "server_core_percent": sum(v for k, v in share.items() if "request" in k or k == "server"),
        "reader_thread_core_percent": share["port"],
        "rows_and_filter_core_percent": share["filter"],
    }


def pictures() -> None:
    """Draw the page and the animation of a shipped recording for the documentation."""
    docs = ROOT / "docs"
    subprocess.run(
        [sys.executable, "-m", "bayes_asv", "track", str(SHIPPED), "--vehicle", str(VEHICLE),
         "--gif", str(docs / "live.gif")],
        check=True, cwd=ROOT,
    )  # fmt: skip
    running = program(str(SHIPPED))
    try:
        with browser() as (driver, _):
            driver.get(running.address)
            clock = "return document.querySelector('#clock').textContent"
            while "ended" not in driver.execute_script(clock):  # the filter may need compiling
                time.sleep(0.5)
            control = "fetch('/control', {method: 'POST', body: JSON.stringify(arguments[0])})"
            for request in ({"do": "pause"}, {"do": "seek", "value": 1.0}):
                driver.execute_script(control, request)
                time.sleep(1.0)
            driver.execute_cdp_cmd(
                "Emulation.setDeviceMetricsOverride",
                {"width": 1200, "height": 1520, "deviceScaleFactor": 1, "mobile": False},
            )
            time.sleep(1.0)
            driver.save_screenshot(str(docs / "live.png"))
    finally:
        end(running)


def main() -> int:
    """Run the benchmark and write its results; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seconds", type=float, default=30.0, help="per page")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=RESULTS)
    parser.add_argument("--pictures", action="store_true")
    options = parser.parse_args()
    # A shell's background processes ignore Ctrl-C, and so would the programs started here.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if options.pictures:
        pictures()
        return 0
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        file = folder / "rough.csv"
        subprocess.run(
            [sys.executable, "-m", "bayes_asv", "simulate", "--vehicle", str(VEHICLE), "--road",
             "rough", "--rate", f"{RATE:g}", "--seconds", f"{options.seconds + 40:g}", "--seed",
             str(options.seed), "-o", str(file)],
            check=True, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        for more in (0, MORE):
            rows.append(replay(file, options.seconds, more))
            print(rows[-1], file=sys.stderr, flush=True)
            rows.append(port(file, folder, options.seconds, more))
            print(rows[-1], file=sys.stderr, flush=True)
        rows.append(threads(file, folder, options.seconds))
    commit = current_commit()
    chromium = subprocess.run(
        [shutil.which("chromium") or "chromium-browser", "--version"],
        capture_output=True, text=True, check=False,
    ).stdout.split()  # fmt: skip
    info = {
        "commit": commit,
        "version": __version__,
        "python": platform.python_version(),
        "browser": " ".join(chromium[:2]),
        "cores": os.cpu_count(),
        "load_average": round(os.getloadavg()[1], 2),
        "ahead_of_other_work": os.sched_getscheduler(0) != os.SCHED_OTHER,
        "rate": RATE,
        "seconds": options.seconds,
        "seed": options.seed,
    }
    options.out.parent.mkdir(exist_ok=True)
    rounded = [
        {k: round(v, 4) if isinstance(v, float) else v for k, v in row.items()} for row in rows
    ]
    options.out.write_text(json.dumps({"about": info, "rows": rounded}, indent=1) + "\n")
    print(json.dumps(rounded, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
