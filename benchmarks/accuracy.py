"""Accuracy and time of ``bayes-asv estimate`` on fresh drives of the rig.

Each run is a call of the command, start-up included, on files of a car drawn anew; known values
are exact.  ``python -m benchmarks.accuracy`` writes ``benchmarks/results/accuracy.json``.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from bayes_asv import __version__
from benchmarks.provenance import current_commit
from tests.rig import (
    DEFAULT_SPEEDS,
    TERRAINS,
    SensorSpec,
    baja,
    draw,
    draw_biases,
    drive,
    vehicle_toml,
    write_csv,
)

__all__ = ["main"]

RESULTS = Path(__file__).parent / "results" / "accuracy.json"
TERRAIN_NAMES = ("bump", "stops", "rough")
EXACT = {"m": 0.0, "wdf": 0.0, "l": 0.0, "k_f": 0.0, "k_r": 0.0}
NAMES = ("c_f", "c_r", "i")


def one(folder: Path, terrain: str, seed: int) -> dict[str, Any]:
    """Drive, write the files, call the command, and hold its answer against the truth."""
    rng = np.random.default_rng([seed, TERRAIN_NAMES.index(terrain), 2026])
    car = draw(baja(), rng, EXACT)
    sensors = draw_biases(SensorSpec(), rng)
    road_seed, run_seed = (int(v) for v in rng.integers(2**31, size=2))
    where = TERRAINS[terrain](road_seed)
    run = drive(car, where, DEFAULT_SPEEDS[terrain], 400.0, 2.0, sensors, run_seed)
    recording, vehicle = folder / "run.csv", folder / "car.toml"
    write_csv(run, recording)
    vehicle.write_text(vehicle_toml(baja(), SensorSpec(), EXACT), encoding="utf-8")
    began = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "bayes_asv", "estimate", str(recording), "--vehicle", str(vehicle),
         "--json", "-"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    seconds = time.perf_counter() - began
    document = json.loads(done.stdout)
    out: dict[str, Any] = {
        "terrain": terrain,
        "seed": seed,
        "verdict": document["verdict"],
        "reasons": document["reasons"],
        "seconds": seconds,
    }
    if document["verdict"] == "ok":
        out["rhat"] = document["diagnostics"]["rhat_max"]
        for name in NAMES:
            answer = document["parameters"][name]["si"]
            truth = getattr(car, name)
            out[f"error_{name}"] = answer["mean"] / truth - 1.0
            out[f"z_{name}"] = (answer["mean"] - truth) / answer["sd"]
    return out


def main() -> int:
    """Run the bench and write its results; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--runs", type=int, default=15, help="per terrain")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for terrain in TERRAIN_NAMES:
            for k in range(given.runs):
                rows.append(one(Path(folder), terrain, given.seed + k))
                print(rows[-1], file=sys.stderr, flush=True)
    answered = [row for row in rows if row["verdict"] == "ok"]
    summary: dict[str, Any] = {
        "runs": len(rows),
        "answered": len(answered),
        "seconds_median": float(np.median([row["seconds"] for row in rows])),
        "seconds_max": max(row["seconds"] for row in rows),
        "rhat_max": max(row["rhat"] for row in answered),
    }
    for name in NAMES:
        errors = np.abs([row[f"error_{name}"] for row in answered])
        z = np.array([row[f"z_{name}"] for row in answered])
        summary[name] = {
            "median_error_percent": 100.0 * float(np.median(errors)),
            "largest_error_percent": 100.0 * float(np.max(errors)),
            "rms_z": float(np.sqrt(np.mean(z**2))),
        }
    commit = current_commit()
    about = {
        "commit": commit,
        "version": __version__,
        "python": platform.python_version(),
        "cores": os.cpu_count(),
        "seed": given.seed,
    }
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps({"about": about, "summary": summary, "rows": rows}, indent=1))
    print(json.dumps(summary, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
