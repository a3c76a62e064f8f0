"""A season through ``bayes-asv fleet``: how busy it keeps a machine, and a worker that is killed.

``python -m benchmarks.fleet`` makes 500 recordings of a car whose front damper loses 12 % half-way,
runs the command on all processors, and kills one of its workers on the way.  It writes
``benchmarks/results/fleet.json`` (6 minutes of two processors).
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from datetime import date, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from bayes_asv.domain.recording import Recording
from bayes_asv.io import write_csv
from benchmarks.provenance import current_commit, keep
from tests.rig import SensorSpec, baja, draw, draw_biases, drive, vehicle_toml
from tests.rig.terrain import bump
from tests.rig.units import INCH

RESULTS = Path(__file__).parent / "results" / "fleet.json"
FALL = 0.12
RATE, SECONDS = 400.0, 2.0
_POLL = 0.25  # s
_TICKS = os.sysconf("SC_CLK_TCK")
_FIRST_DAY = date(2026, 3, 1)


def make_season(folder: Path, count: int, seed: int) -> None:
    """Write the vehicle and dated recordings of a car whose front damper fails half-way."""
    rng = np.random.default_rng(seed)
    car = draw(baja(), rng)
    worn = replace(car, c_f=(1.0 - FALL) * car.c_f)
    (folder / "car.toml").write_text(vehicle_toml(baja(), SensorSpec()), encoding="utf-8")
    (folder / "runs").mkdir()
    biases = draw_biases(SensorSpec(), rng)
    for k in range(count):
        height = float(rng.uniform(2.0, 3.0)) * INCH
        one = worn if k >= count // 2 else car
        run = drive(
            one, bump(height), float(rng.uniform(4.0, 5.0)), RATE, SECONDS, biases, seed + k
        )
        day = _FIRST_DAY + timedelta(days=k // 10)
        name = f"{day.isoformat()}-run{k % 10}.csv"
        recording = Recording(run.time, run.channels, ("m/s^2",) * 4, (), name)
        write_csv(recording, folder / "runs" / name)


class _Watched:
    """A command and all processes below it: their processor time, and who they are."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self.process = process
        self.seconds: dict[int, float] = {}

    def look(self) -> list[int]:
        """Take down processor times; return the processes below it, busiest first."""
        parents, times = {}, {}
        for path in Path("/proc").glob("[0-9]*/stat"):
            try:
                words = path.read_text("utf-8").rpartition(")")[2].split()
            except OSError:
                continue
            parents[int(path.parent.name)] = int(words[1])
            times[int(path.parent.name)] = (int(words[11]) + int(words[12])) / _TICKS
        family = {self.process.pid}
        while more := {pid for pid, of in parents.items() if of in family} - family:
            family |= more
        self.seconds |= {pid: times[pid] for pid in family if pid in times}
        return sorted(family - {self.process.pid}, key=lambda pid: -times[pid])


def run_season(folder: Path, output: str, kill_at: float | None = None) -> dict[str, Any]:
    """Run the command over a season.

    Parameters
    ----------
    folder : Path
        Of :func:`make_season`.
    output : str
        Table to write.
    kill_at : float, optional
        Share of the answers after which the busiest worker is killed.

    Returns
    -------
    dict
        Wall-clock and processor seconds, seconds to the first answer, and the answers' states.
    """
    count = len(list((folder / "runs").glob("*.csv")))
    answers = folder / output.replace(".csv", ".fleet") / "answers"
    began = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, "-m", "bayes_asv", "fleet", "runs/*.csv", "-v", "car.toml",
         "--car", "half", "-o", output],
        cwd=folder, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    watched, first, killed = _Watched(process), 0.0, False
    states: dict[str, int] = {}
    twice = 0
    while process.poll() is None:
        workers = watched.look()
        now = {path.name: path.stat().st_mtime_ns for path in answers.glob("*.json")}
        twice += sum(now.get(name) != state for name, state in states.items())
        states = now
        if now and not first:
            first = time.monotonic() - began
        if kill_at is not None and not killed and len(now) >= kill_at * count and workers:
            os.kill(workers[0], signal.SIGKILL)
            killed = True
        time.sleep(_POLL)
    wall = time.monotonic() - began
    return {
        "recordings": count,
        "status": process.returncode,
        "wall_seconds": round(wall, 1),
        "cpu_seconds": round(sum(watched.seconds.values()), 1),
        "busy": round(sum(watched.seconds.values()) / (wall * (os.cpu_count() or 1)), 3),
        "seconds_to_the_first_answer": round(first, 2),
        "answers": len(states),
        "lost_or_made_twice": twice,
        "worker_killed": killed,
    }


def main() -> int:
    """Run both seasons and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    chance = random.Random(arguments.seed)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        make_season(folder, arguments.count, arguments.seed)
        whole = run_season(folder, "season.csv")
        print(whole, file=sys.stderr, flush=True)
        each = (whole["wall_seconds"] - whole["seconds_to_the_first_answer"]) / arguments.count
        overhead = whole["seconds_to_the_first_answer"] - 2.0 * each
        for path in sorted((folder / "runs").glob("*.csv"))[arguments.count // 5 :]:
            path.unlink()
        struck = run_season(folder, "struck.csv", chance.uniform(0.2, 0.7))
        print(struck, file=sys.stderr, flush=True)
        rows = [(folder / f"{n}.csv").read_text("utf-8").splitlines() for n in ("season", "struck")]
        same = sum(a == b for a, b in zip(*rows, strict=False))
    result = {
        "commit": current_commit() or "unknown", "seed": arguments.seed,
        "load_of_the_machine": round(os.getloadavg()[0], 1), "processors": os.cpu_count(),
        "whole": whole, "start_share": round(overhead / whole["wall_seconds"], 4),
        "worker_killed": struck, "rows_as_in_the_whole_season": same,
    }  # fmt: skip
    keep(RESULTS, result)
    return 0


if __name__ == "__main__":
    sys.exit(main())
