"""Estimates, consistency and predictions of the linear half car on drives of a real car.

``python -m benchmarks.roomster [FOLDER]`` reads the drives (by default from
``../shared/data/roomster``), writes ``benchmarks/results/roomster.json``, the tables of
``docs/roomster.md`` and its figure.  ``--report`` only writes tables and figure again.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from pathlib import Path
from typing import Any

import numpy as np

from bayes_asv import __version__
from bayes_asv.analysis.run_consistency import compare_runs
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.kalman import VALUE
from bayes_asv.posterior.free_simulation import simulate_free
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from benchmarks.provenance import current_commit
from benchmarks.roomster import drives as of
from benchmarks.roomster.picture import draw_picture
from benchmarks.roomster.prediction import Learnt, learn, learn_reference, predict
from benchmarks.roomster.tables import write_tables

__all__ = ["main"]

Row = dict[str, Any]

ROOT = Path(__file__).parents[2]
FOLDER = ROOT.parent / "shared" / "data" / "roomster"
RESULTS = ROOT / "benchmarks" / "results" / "roomster.json"
BANDS = (3.0, 4.0, 6.0)
SHOWN = ("04_1", "10_1", 20.0, 26.0)  # learnt from, predicted, s


def measure(drives: dict[str, Recording], vehicle: Vehicle, seed: int) -> Row:
    """Compute all results of the drives."""

    def report(words: str) -> None:
        print(words, file=sys.stderr, flush=True)

    out: Row = {"below": of.BELOW, "full_band": {}, "coherence": {}, "halves": {}, "bands": {}}
    lines, runs = {}, {}
    for name, recording in drives.items():
        report(f"drive {name}")
        lines[name], runs[name] = of.run_of(recording, vehicle, seed)
    out["posterior"] = {name: of.posterior_row(lines[name], run) for name, run in runs.items()}
    worked = [runs[name] for name in of.WORKED_ON]
    for name in of.WORKED_ON:
        report(f"bands and halves of {name}")
        best = runs[name].fit.space.cars(runs[name].fit.mode.z[None])[0]
        out["coherence"][name] = of.coherence_row(drives[name], vehicle, best)
        out["full_band"][name] = of.at_full_band(drives[name], vehicle)
        share = out["posterior"][name]["share"] or 1.0
        out["halves"][name] = of.halves(drives[name], vehicle, share, seed)
        out["bands"][name] = {
            f"{below:g}": of.posterior_row(*of.run_of(drives[name], vehicle, seed, below))
            for below in BANDS
        }
    report("between drives")
    agreement = compare_runs(worked, 10000, seed)
    plain, counted = of.between(worked, counted=False), of.between(worked, counted=True)
    mean_car = agreement.quantities(agreement.population.centre, seed)
    out["between"] = {
        "freedom": plain.freedom,
        "all_readings": {"q": plain.q, "p": plain.p},
        "counted": {"q": counted.q, "p": counted.p},
        "spread_percent": {n: agreement.spread_percent(n) for n in ("c_f", "c_r", "i")},
        "own_percent": {n: agreement.own_percent(n) for n in ("c_f", "c_r", "i")},
        "own": {
            n: [x.tolist() for x in agreement.estimates_of_runs(n)] for n in ("c_f", "c_r", "i")
        },
        "mean_car": {
            n: {"mean": float(mean_car[n].mean()), "sd": float(mean_car[n].std()),
                "eti95": [float(v) for v in np.quantile(mean_car[n], [0.025, 0.975])]}
            for n in ("c_f", "c_r", "i")
        },
    }  # fmt: skip
    out["variants"] = {}
    chosen, cut = [], []
    for name in of.WORKED_ON:
        report(f"lags and gains of {name}")
        row, asked = of.variants(drives[name], vehicle, seed)
        out["variants"][name] = row
        cut.append(asked.pop(of.CUT))
        best_name = min(asked, key=lambda v: float(np.sum(np.square(row[v]["nrmse"]))))
        chosen.append(asked[best_name])
        row["best"] = best_name
    for what, those in (("best_variants", chosen), ("ends_cut", cut)):
        counted = of.between(those, counted=True)
        out["between"][what] = {"q": counted.q, "p": counted.p}
    report("prediction")
    out["prediction"] = {}
    for name in drives:  # what 02 and 10 teach is used for nothing but their own columns
        cars = runs[name].fit.space.cars(runs[name].z)
        best = runs[name].fit.space.cars(runs[name].fit.mode.z[None])[0]
        learnt = learn(lines[name], cars, best)
        reference = learn_reference(lines[name])
        out["prediction"][name] = {
            other: predict(lines[other], learnt, reference) for other in drives
        }
        if name == SHOWN[0]:
            out["shown"] = _shown(lines[SHOWN[1]], learnt)
    return out


def _shown(recording: PreparedRecording, learnt: Learnt) -> Row:
    """Take a few seconds of a drive and of its prediction, for the picture."""
    outputs = np.stack([simulate_free(recording, car).output for car in learnt.cars])
    time = recording.instants - recording.instants[0]
    here = (time >= SHOWN[2]) & (time <= SHOWN[3])
    row: Row = {"from": SHOWN[0], "drive": SHOWN[1], "time": time[here].round(3).tolist()}
    for axle, name in enumerate(("front", "rear")):
        made = outputs[:, here, axle]
        read = here & (recording.kind[:, axle] == VALUE)
        row[name] = {
            "read_at": time[read].round(3).tolist(),
            "measured": recording.reading[read, axle].round(3).tolist(),
            "mean": made.mean(axis=0).round(3).tolist(),
            "sd": np.sqrt(made.var(axis=0) + learnt.left[axle] ** 2).round(3).tolist(),
        }
    return row


def main() -> int:
    """Run the bench and write its results; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folder", nargs="?", type=Path, default=FOLDER)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--report", action="store_true", help="write tables and picture again")
    given = parser.parse_args()
    if not given.report:
        if not given.folder.is_dir():
            print(f"{given.folder} is not there: the road drives do not travel with the project")
            return 0
        drives, vehicle = of.read_all(given.folder)
        result = measure(drives, vehicle, given.seed)
        commit = current_commit()
        about = {
            "commit": commit,
            "version": __version__,
            "python": platform.python_version(),
            "cores": os.cpu_count(),
            "seed": given.seed,
        }
        RESULTS.write_text(json.dumps({"about": about, **result}, indent=1) + "\n")
    result = json.loads(RESULTS.read_text(encoding="utf-8"))
    write_tables(result)
    draw_picture(result)
    return 0


if __name__ == "__main__":
    sys.exit(main())
