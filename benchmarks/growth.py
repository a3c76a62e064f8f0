"""Time and memory of whole commands, from one bump to a drive of a million rows.

Each command runs in a process of its own on one processor, with the compiled code in its cache but
for the first call after an installation; the cases take turns, and the least of the rounds counts.
``python -m benchmarks.growth`` writes ``benchmarks/results/growth.json`` (15 minutes).
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import bayes_asv
from bayes_asv.domain.recording import Recording
from bayes_asv.io import write_csv
from benchmarks.provenance import current_commit, keep
from tests.rig import SensorSpec, baja, draw, draw_biases, drive, vehicle_toml
from tests.rig.long_log import hour, long_log
from tests.rig.terrain import bump, rough_road
from tests.rig.units import INCH

RESULTS = Path(__file__).parent / "results" / "growth.json"
RATE = 400.0
RUNS = (1, 10, 100)
ROWS = (10_000, 100_000, 1_000_000)


class Case(NamedTuple):
    """A command and what it is about.

    Parameters
    ----------
    name : str
        In words.
    words : tuple of str
        Of the command line.
    rounds : int
        How often it runs.
    cold : bool
        Without compiled code in the cache.
    status : int
        Exit status that is right.
    """

    name: str
    words: tuple[str, ...]
    rounds: int = 3
    cold: bool = False
    status: int = 0


def measured(
    words: Sequence[str], folder: Path, more: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Run a command of the package in a process of its own.

    Parameters
    ----------
    words : sequence of str
        Of the command line.
    folder : Path
        In which it runs.
    more : mapping, optional
        Variables of the environment that are added or changed.

    Returns
    -------
    dict
        ``wall``, ``user`` and ``system`` seconds, peak ``megabytes``, exit ``status``.
    """
    began = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "bayes_asv", *words], cwd=folder, env={**os.environ, **(more or {})},
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    peak, status, usage = 0, None, None
    while status is None:  # what the system reports afterwards may be of this process
        peak = max(peak, _peak(process.pid))
        time.sleep(0.01)
        pid, code, usage = os.wait4(process.pid, os.WNOHANG)
        status = code if pid else None
    assert usage is not None
    return {
        "wall": time.perf_counter() - began,
        "user": usage.ru_utime,
        "system": usage.ru_stime,
        "megabytes": peak / 1024.0,
        "status": os.waitstatus_to_exitcode(status),
    }


def _peak(pid: int) -> int:
    try:
        text = Path(f"/proc/{pid}/status").read_text("utf-8")
    except OSError:
        return 0
    found = [line.split()[1] for line in text.splitlines() if line.startswith("VmHWM")]
    return int(found[0]) if found else 0


def make_recordings(folder: Path, seed: int) -> None:
    """Write the vehicle, runs over one bump each, and drives of many rows."""
    rng = np.random.default_rng(seed)
    car = draw(baja(), rng)
    (folder / "car.toml").write_text(vehicle_toml(baja(), SensorSpec()), encoding="utf-8")
    biases = draw_biases(SensorSpec(), rng)
    for k in range(max(RUNS)):
        run = drive(car, bump((2.5 + 0.01 * k) * INCH), 4.4, RATE, 2.0, biases, seed + k)
        write_csv(_recording(run.time, run.channels), folder / f"run{k:03d}.csv")
    for rows in ROWS:
        minutes = rows / RATE / 60.0
        if minutes < 1.0:
            run = drive(car, rough_road(seed, "D"), 4.4, RATE, 60.0 * minutes, biases, seed)
            time_, channels = run.time, run.channels
        else:
            log = long_log(car, hour(minutes, round(0.7 * minutes), seed), RATE, biases, seed)
            time_, channels = log.time[:rows], log.channels[:, :rows]
        write_csv(_recording(time_, channels), folder / f"rows{rows}.csv")
    still = 0.05 * rng.normal(size=channels.shape)
    write_csv(_recording(time_, still), folder / "still.csv")


def _recording(time_: Any, channels: Any) -> Recording:
    return Recording(time_, channels, ("m/s^2",) * 4, (), "drive.csv")


def cases() -> list[Case]:
    """Return all cases."""
    car = ("--vehicle", "car.toml", "--seed", "1")

    def runs(count: int) -> tuple[str, ...]:
        return tuple(f"run{k:03d}.csv" for k in range(count))

    out = [
        Case("--help", ("--help",), 5),
        Case("estimate, 800 rows, first call after an installation",
             ("estimate", *runs(1), *car), 1, cold=True),
    ]  # fmt: skip
    for count in RUNS:
        name = "1 run" if count == 1 else f"{count} runs"
        out.append(Case(f"estimate, {name} of 800 rows", ("estimate", *runs(count), *car)))
    for rows in ROWS:
        out.append(Case(f"estimate, {rows:,} rows", ("estimate", f"rows{rows}.csv", *car)))
    for rows in ROWS:
        words = ("track", f"rows{rows}.csv", "--vehicle", "car.toml")
        out.append(Case(f"track, {rows:,} rows", words))
    out.append(
        Case(
            "estimate, 1,000,000 rows without motion", ("estimate", "still.csv", *car), 1, status=3
        )
    )
    return out


def main() -> int:
    """Run all cases and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    found: dict[str, list[dict[str, Any]]] = {}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        make_recordings(folder, arguments.seed)
        cold = folder / "installed"
        shutil.copytree(
            Path(bayes_asv.__file__).parent, cold / "bayes_asv",
            ignore=shutil.ignore_patterns("*.nbi", "*.nbc"),
        )  # fmt: skip
        single = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        first = {**single, "PYTHONPATH": str(cold)}
        everything = cases()
        for case in everything:
            if not case.cold and case.name != "--help":
                measured(case.words, folder, single)
        for turn in range(max(case.rounds for case in everything)):
            for case in everything:
                if turn < case.rounds:
                    one = measured(case.words, folder, first if case.cold else single)
                    found.setdefault(case.name, []).append(one)
                    print(f"{case.name}: {one['wall']:.2f} s", file=sys.stderr, flush=True)
    wrong = [c.name for c in everything if any(x["status"] != c.status for x in found[c.name])]
    result = {
        "commit": current_commit() or "unknown", "seed": arguments.seed,
        "load_of_the_machine": round(os.getloadavg()[0], 1), "unexpected_status": wrong,
        "commands": {
            name: {
                "seconds": round(min(x["wall"] for x in all_), 2),
                "cpu_seconds": round(min(x["user"] + x["system"] for x in all_), 2),
                "megabytes": round(max(x["megabytes"] for x in all_)),
                "rounds": len(all_),
            }
            for name, all_ in found.items()
        },
    }  # fmt: skip
    keep(RESULTS, result)
    for name, one in result["commands"].items():
        print(f"{name:55s} {one['seconds']:7.2f} s {one['cpu_seconds']:7.2f} CPU-s "
              f"{one['megabytes']:5d} MB")  # fmt: skip
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
