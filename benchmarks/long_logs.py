"""Time, memory and answer of `bayes-asv estimate` on logs of an hour.

Cars of the rig drive for an hour with forty bumps in it, and stand, cruise, brake, corner, jump and
cross rough stretches in between; logs are written as CSV and estimated by the command, in a process
of its own.  The answer is compared with the truth and with that of the bumps cut by hand: the four
highest as recordings of their own, and all of them as pieces of one log, which share the noise of
their sensors.  ``python -m benchmarks.long_logs`` writes ``benchmarks/results/long_logs.json``.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle, read_vehicle
from bayes_asv.estimation import estimate
from bayes_asv.io import write_csv
from benchmarks.growth import measured
from benchmarks.provenance import current_commit
from tests.rig import RigCar, SensorSpec, baja, draw, draw_biases, vehicle_toml
from tests.rig.long_log import LongLog, hour, long_log

__all__ = ["main"]

RESULTS = Path(__file__).parent / "results" / "long_logs.json"
NAMES = ("c_f", "c_r", "i")
CASES = ((10.0, 8, 400.0), (30.0, 20, 400.0), (60.0, 40, 400.0), (60.0, 40, 1000.0))
"""Minutes, bumps and rows a second."""
_SETTLED = 2.0  # s at the end of a part in which the car stands


def made(minutes: float, bumps: int, rate: float, seed: int) -> tuple[RigCar, LongLog]:
    """Drive a car that was drawn about the nominal one."""
    rng = np.random.default_rng(seed)
    car = draw(baja(), rng)
    return car, long_log(
        car, hour(minutes, bumps, seed), rate, draw_biases(SensorSpec(), rng), seed
    )


def recording(log: LongLog, begin: float, end: float, source: str, sha256: str = "") -> Recording:
    """Return the rows between two times."""
    rows = (log.time >= begin) & (log.time < end)
    return Recording(log.time[rows], log.channels[:, rows], ("m/s^2",) * 4, (), source, sha256)


def by_command(file: Path, vehicle: Path) -> dict[str, Any]:
    """Estimate a file in a process of its own; its time, its memory and its document."""
    document = file.with_suffix(".json")
    words = ("estimate", str(file), "--vehicle", str(vehicle), "--json", str(document))
    found = measured((*words, "--seed", "1"), file.parent)
    if found["status"] != 0:
        raise SystemExit(f"{file.name}: exit status {found['status']}")
    return {
        "wall_seconds": round(found["wall"], 1),
        "user_seconds": round(found["user"], 1),
        "system_seconds": round(found["system"], 1),
        "peak_megabytes": round(found["megabytes"]),
        "document": json.loads(document.read_text("utf-8")),
    }


def of_document(document: dict[str, Any], car: RigCar, vehicle: Vehicle) -> dict[str, Any]:
    """Relative deviation from the truth and standard deviation of every answer."""
    out = {}
    for name in NAMES:
        found = document["parameters"][name]
        scale = getattr(vehicle, name).value / found["nominal"]
        out[name] = {
            "error": found["mean"] * scale / getattr(car, name) - 1.0,
            "sd": found["sd"] * scale / getattr(car, name),
            "interval": [edge * scale / getattr(car, name) - 1.0 for edge in found["eti95"]],
        }
    return out


def by_hand(runs: list[Recording], car: RigCar, vehicle: Vehicle) -> dict[str, Any]:
    """Estimate recordings together; as :func:`of_document`, with the time."""
    began = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    result = estimate(runs, vehicle, seed=1)
    out: dict[str, Any] = {"runs": len(runs), "verdict": result.verdict}
    for name in NAMES:
        ratio = result.draws[name] / getattr(car, name)
        out[name] = {
            "error": float(ratio.mean() - 1.0),
            "sd": float(ratio.std()),
            "interval": [float(edge - 1.0) for edge in np.quantile(ratio, [0.025, 0.975])],
        }
    used = resource.getrusage(resource.RUSAGE_SELF).ru_utime - began
    return {**out, "user_seconds": round(used, 1)}


def one(minutes: float, bumps: int, rate: float, seed: int, folder: Path) -> dict[str, Any]:
    """Run one log."""
    car, log = made(minutes, bumps, rate, seed)
    vehicle_file, file = folder / "car.toml", folder / "log.csv"
    vehicle_file.write_text(vehicle_toml(baja(), SensorSpec()), encoding="utf-8")
    write_csv(recording(log, 0.0, np.inf, "log.csv"), file)
    vehicle = read_vehicle(vehicle_file)
    said = by_command(file, vehicle_file)
    (found,) = said["document"]["logs"]
    reasons = [event["reason"] or "used" for event in found["events"]]
    out = {
        "minutes": minutes,
        "bumps": bumps,
        "rate": rate,
        "rows": len(log.time),
        "file_megabytes": round(file.stat().st_size / 1e6, 1),
        "seed": seed,
        **{key: value for key, value in said.items() if key != "document"},
        "events": {reason: reasons.count(reason) for reason in dict.fromkeys(reasons)},
        "bumps_found": sum(
            any(event["begin"] < end and event["end"] > begin for event in found["events"])
            for begin, end in log.of("bump")
        ),
        "rows_used": sum(run["rows"] for run in said["document"]["runs"]),
        "verdict": said["document"]["verdict"],
        "answers": of_document(said["document"], car, vehicle),
    }
    file.unlink()
    if (minutes, rate) != (60.0, 400.0):
        return out
    sizes = [part.size for part, _, _ in log.parts if part.kind == "bump"]
    spans = [(begin, end - _SETTLED) for begin, end in log.of("bump")]
    highest = [spans[k] for k in np.argsort(sizes)[-4:]]
    own = [recording(log, span[0], span[1], f"cut at {span[0]:.0f} s") for span in sorted(highest)]
    pieces = [
        recording(log, span[0], span[1], f"cut at {span[0]:.0f} s", "one log") for span in spans
    ]
    out["four_cut_by_hand"] = by_hand(own, car, vehicle)
    out["all_cut_by_hand"] = by_hand(pieces, car, vehicle)
    return out


def main() -> int:
    """Run all logs and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    commit = current_commit()
    done: dict[str, Any] = {"commit": commit, "cores": os.cpu_count(), "logs": []}
    for minutes, bumps, rate in CASES:
        with tempfile.TemporaryDirectory() as folder:
            load = os.getloadavg()[0]
            found = one(minutes, bumps, rate, arguments.seed, Path(folder))
        done["logs"].append({**found, "load_of_the_machine": round(load, 1)})
        RESULTS.write_text(json.dumps(done, indent=1) + "\n", encoding="utf-8")
        print(json.dumps(done["logs"][-1]), file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
