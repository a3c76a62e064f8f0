"""Commands that are killed and interrupted at random instants.

A command with one output leaves the old one or the new one, whole.  A season continues where it was
killed, with every answer it had.  A transfer from the logger continues with every byte it had read.
"""

from __future__ import annotations

import contextlib
import csv
import math
import os
import random
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tty
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bayes_asv.domain.recording import Recording
from bayes_asv.io import read_recording, write_recording
from tests.acquire.fake_logger import FakeLogger
from tests.acquire.synthetic import SyntheticBlock, counts
from tests.firmware.frames import DONE, STANDBY, TAKING, WAITING

__all__ = [
    "CAR", "COMMANDS", "RECORDINGS", "run_command", "strike_commands", "strike_seasons",
    "strike_transfers",
]  # fmt: skip

ROOT = Path(__file__).parents[1]
RECORDINGS = ROOT / "data" / "recordings"
CAR = ROOT / "data" / "vehicles" / "baja2008.toml"
_STOPS = str(RECORDINGS / "stops-400hz.csv")

COMMANDS: dict[str, tuple[str, ...]] = {
    "modes": (_STOPS, "-v", str(CAR), "--json", "out.json"),
    "simulate": ("-v", str(CAR), "-o", "out.csv"),
    "track": (_STOPS, "-v", str(CAR), "--trace", "out.csv"),
    "estimate": (_STOPS, "-v", str(CAR), "--json", "out.json"),
    "inspect": (_STOPS, "-o", "out.toml"),
    "report": ("--from", str(ROOT / "tests" / "report" / "data" / "us.json"), "-o", "out.html"),
}
"""Whole commands with one output each."""

_SEASON_FILES = 10
_KILLS_A_SEASON = 12  # at most; then the season is let finish
_LINE = 64  # bytes that the line carries in `_LINE_SECONDS`
_LINE_SECONDS = 0.004


def run_command(
    words: tuple[str, ...], folder: Path, **options: Any
) -> subprocess.Popen[bytes]:  # fmt: skip
    """Start the program in a folder."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        [sys.executable, "-m", "bayes_asv", *words], cwd=folder,
        env=environment | options.pop("more", {}),
        stdout=options.pop("stdout", subprocess.PIPE), stderr=subprocess.PIPE, **options,
    )  # fmt: skip


def strike_commands(
    strikes: int, seconds: float, seed: int, commands: Sequence[str] = tuple(COMMANDS)
) -> dict[str, Any]:
    """Kill and interrupt whole commands at random instants.

    Parameters
    ----------
    strikes : int
        Number of commands that are started and struck.
    seconds : float
        When to stop in any case.
    seed : int
        Of the instants.
    commands : sequence of str
        Those of :data:`COMMANDS` that are struck.

    Returns
    -------
    dict
        Number of each kind of strike, faults, and the longest time from a signal to the end.
    """
    chance = random.Random(seed)
    found: dict[str, int] = {}
    counted = {"SIGKILL": 0, "SIGINT": 0, "SIGTERM": 0, "finished before": 0}
    longest, begin = 0.0, time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        times, answers = {}, {}
        for command in commands:
            words = COMMANDS[command]
            started = time.monotonic()
            process = run_command((command, *words), folder)
            process.communicate()
            times[command] = time.monotonic() - started
            output = folder / words[-1]
            answers[command] = _comparable(output.read_bytes())
            output.unlink()
        for _ in range(strikes):
            command = chance.choice(commands)
            words = COMMANDS[command]
            kind = chance.choice(("SIGKILL", "SIGKILL", "SIGINT", "SIGTERM"))
            output = folder / words[-1]
            old = chance.choice((None, b"old"))
            if old is not None:
                output.write_bytes(old)
            # the end, where the output is written, is struck as often as all the rest
            share = chance.choice((chance.uniform(0.2, 1.0), chance.uniform(0.85, 1.05)))
            process = run_command((command, *words), folder)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(share * times[command])
            struck = process.poll() is None
            counted[kind if struck else "finished before"] += 1
            stop = time.monotonic()
            process.send_signal(getattr(signal, kind))
            _, err = process.communicate()
            if struck and kind != "SIGKILL":
                longest = max(longest, time.monotonic() - stop)
                lines = err.decode().splitlines()
                if len(lines) > 1 or b"Traceback" in err:
                    said = " / ".join(lines)[-200:]
                    _count(found, f"{command}: more than one line after {kind}: {said}")
            state = output.read_bytes() if output.exists() else None
            if state != old and (state is None or _comparable(state) != answers[command]):
                _count(found, f"{command}: output neither old nor new after {kind}")
            beside = sorted(p.name for p in folder.iterdir() if p != output)
            if beside:
                _count(found, f"{command}: left {beside[0][-5:]} behind after {kind}")
            for path in folder.iterdir():
                path.unlink()
            if time.monotonic() - begin > seconds:
                break
    return {
        "strikes": counted, "longest_seconds_to_end": round(longest, 2), "faults": found,
    }  # fmt: skip


def strike_seasons(kills: int, seconds: float, seed: int) -> dict[str, Any]:
    """Kill ``bayes-asv fleet`` at random instants, and start it again until the season is done.

    Its recordings are too short for an estimate, so that a season takes seconds; what is kept, and
    how, does not depend on the answers.

    Parameters
    ----------
    kills : int
        Number of kills, over as many seasons as they need.
    seconds : float
        When to stop in any case.
    seed : int
        Of the instants.

    Returns
    -------
    dict
        Numbers of kills and seasons, and faults.
    """
    chance, found, struck, seasons = random.Random(seed), dict[str, int](), 0, 0
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        runs, folder = Path(name) / "runs", Path(name) / "season"
        runs.mkdir()
        folder.mkdir()
        whole = read_recording(_STOPS)
        for k in range(_SEASON_FILES):
            part = slice(3 * k, 3 * k + 90)
            run = Recording(whole.time[part], whole.values[:, part], whole.units)
            write_recording(run, runs / f"run{k:02d}-2026-05-03.csv")
        words = ("fleet", "../runs/*.csv", "-v", str(CAR), "--jobs", "2", "-o", "table.csv")
        output, answers = folder / words[-1], folder / "table.fleet" / "answers"
        started = time.monotonic()
        run_command(words, folder).communicate()
        takes, want = time.monotonic() - started, _rows(output)
        while struck < kills and time.monotonic() - begin < seconds:
            shutil.rmtree(folder)
            folder.mkdir()
            seasons += 1
            kept: dict[str, int] = {}
            for attempt in range(_KILLS_A_SEASON + 1):
                process = run_command(words, folder)
                if attempt < _KILLS_A_SEASON and struck < kills:
                    with contextlib.suppress(subprocess.TimeoutExpired):
                        process.wait(chance.uniform(0.3, 1.0) * takes)
                    struck += process.poll() is None
                    process.kill()
                _, err = process.communicate()
                now = {path.name: path.stat().st_mtime_ns for path in answers.glob("*.json")}
                if {file: now.get(file) for file in kept} != kept:
                    _count(found, "an answer was lost or made twice")
                kept = now
                if b"Traceback" in err:
                    _count(found, "a traceback")
                if output.exists() and _rows(output) != want:
                    _count(found, "the table is neither absent nor right")
                if process.returncode != -signal.SIGKILL:
                    break
            if not output.exists():
                _count(found, "a season was not finished")
    return {"kills": struck, "seasons": seasons, "faults": found}


def strike_transfers(kills: int, seconds: float, seed: int) -> dict[str, Any]:
    """Kill ``bayes-asv acquire`` at random instants, and fetch the rest of the run.

    Parameters
    ----------
    kills : int
        Number of transfers, each killed once.
    seconds : float
        When to stop in any case.
    seed : int
        Of the instants and of the readings.

    Returns
    -------
    dict
        Numbers of transfers and kills, and faults.
    """
    chance, found, struck, transfers = random.Random(seed), dict[str, int](), 0, 0
    begin, length = time.monotonic(), math.inf  # the first transfer is let finish
    while struck < kills and time.monotonic() - begin < seconds:
        transfers += 1
        front, rear = (SyntheticBlock(board, counts(board, 400, transfers)) for board in (1, 2))
        truth = np.concatenate([front.rows.T, rear.rows.T])
        logger = FakeLogger(front, rear, run_takes=0.5)
        with tempfile.TemporaryDirectory() as name, _line(logger) as (port, sent):
            folder = Path(name)
            raw, output = folder / "run.csv.raw", folder / "run.csv"
            words = ("acquire", "--port", port, "-o", output.name)
            # before the first byte, while bytes come, and while the recording is written
            share = chance.uniform(0.0, 1.2)
            process = run_command((*words, "--start"), folder)
            while process.poll() is None and len(sent) < min(share, 1.0) * length:
                time.sleep(0.001)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(chance.uniform(0.0, 0.3 if share > 1.0 else 0.02))
            struck += process.poll() is None
            process.kill()
            process.communicate()
            held = raw.read_bytes() if raw.exists() else b""
            if not bytes(sent).startswith(held):
                _count(found, "the raw file holds other bytes than the port gave")
            if output.exists() and not _is(output, truth):
                _count(found, "the recording is neither absent nor right")
            if not output.exists():
                _finish(logger, words, raw, folder)
            if not (output.exists() and _is(output, truth)):
                _count(found, "the run could not be fetched after the kill")
            length = len(held) if length == math.inf else length
    return {"transfers": transfers, "kills": struck, "faults": found}


def _finish(logger: FakeLogger, words: tuple[str, ...], raw: Path, folder: Path) -> None:
    """Do what a person would do next."""
    if logger.state in (TAKING, WAITING) or (logger.state != STANDBY and raw.exists()):
        more: tuple[str, ...] = ("--resume",) if raw.exists() else ()
    elif DONE in logger.received:
        more, words = ("--replay", raw.name), (words[0], *words[3:])
    else:  # no run was started yet
        raw.unlink(missing_ok=True)
        more = ("--start",)
    run_command((*words, *more), folder).communicate(timeout=120.0)


@contextlib.contextmanager
def _line(logger: FakeLogger) -> Iterator[tuple[str, bytearray]]:
    """Put a logger behind a pseudo-terminal; yield its name and what the logger has sent."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    sent, stop = bytearray(), threading.Event()
    logger.timeout = 0.05  # s of the logger's own time

    def serve() -> None:
        while not stop.is_set():
            if select.select([ours], [], [], _LINE_SECONDS)[0]:
                logger.write(os.read(ours, 4096))
            data = logger.read(_LINE)
            sent.extend(data)
            os.write(ours, data)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield os.ttyname(theirs), sent
    finally:
        stop.set()
        thread.join()
        os.close(ours)
        os.close(theirs)


def _is(path: Path, truth: Any) -> bool:
    return bool(np.array_equal(read_recording(path).values, truth))


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return [
            {key: value for key, value in row.items() if "seconds" not in key}
            for row in csv.DictReader(file)
        ]


def _comparable(data: bytes) -> bytes:
    """Return an output without the figures that no two runs have alike."""
    return b"\n".join(line for line in data.split(b"\n") if b'"seconds"' not in line)


def _count(found: dict[str, int], what: str) -> None:
    found[what] = found.get(what, 0) + 1
