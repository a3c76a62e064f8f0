"""How well error budgets foretell what happens: deviations, and shifts by undeclared faults.

Every fault is put into a rig drive's recording at the size at which the budget tells it, the mode
is climbed to again, and the two shifts are compared in deviations of the answer.
``python -m benchmarks.predicted_biases`` writes ``benchmarks/results/predicted_biases.json``.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bayes_asv import __version__
from bayes_asv.analysis.uncertainty_budget import Shift, find_budget
from bayes_asv.analysis.uncertainty_budget.undeclared_faults import Fault, with_fault
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.posterior.likelihood import shared_work
from bayes_asv.posterior.map_fit import MapFit, best_fit
from bayes_asv.posterior.newton import PosteriorMode, find_mode
from bayes_asv.posterior.parameters import ParameterSpace, make_parameter_space
from bayes_asv.preprocessing.run_preparation import prepare_runs
from benchmarks.provenance import current_commit
from tests.posterior.cases import DECLARED, EXACT, case, vehicle

__all__ = ["main"]

RESULTS = Path(__file__).parent / "results" / "predicted_biases.json"
TERRAINS = ("bump", "stops", "rough", "rollers")
KNOWN = {"declared": DECLARED, "exact": EXACT}


def answers(where: ParameterSpace, mode: PosteriorMode) -> dict[str, float]:
    """Logarithms of the answers at a mode."""
    logs = {name: float(np.log(x[0])) for name, x in where.values(mode.z[None]).items()}
    answers = {n: {n: 1.0} for n in where.car.estimated} | dict(where.car.ratios)
    return {n: sum(w * logs[p] for p, w in parts.items()) for n, parts in answers.items()}


def again(fit: MapFit, car: Vehicle, shift: Shift) -> dict[str, float] | None:
    """Put the fault in and climb to the mode; None where the climb does not settle."""
    if shift.kind == "given":
        value = getattr(car, shift.where)
        wrong = replace(value, value=value.value / (1.0 + shift.size))
        where = make_parameter_space(replace(car, **{shift.where: wrong}), fit.space.recordings)
    else:
        fault = Fault(shift.kind, shift.where, shift.size)
        lines = tuple(with_fault(recording, fault, car) for recording in fit.space.recordings)
        where = replace(fit.space, recordings=lines)
    with shared_work(replace(fit.posterior, space=where)) as posterior:
        for start in (fit.mode.z, None):
            mode = find_mode(posterior, start)
            if mode.converged:
                return answers(where, mode)
    return None


def one(terrain: str, known: str, seed: int) -> dict[str, Any]:
    """Budget of one drive, and what came of each of its forecasts."""
    car = vehicle(KNOWN[known])
    lines, _, _ = prepare_runs((case(terrain, seed, KNOWN[known])[2],), car)
    fit = best_fit(lines, car)
    began = time.process_time()
    width = find_budget(fit.posterior, fit.mode, car)
    seconds = time.process_time() - began
    before = answers(fit.space, fit.mode)
    misses, stuck = [], 0
    for shift in width.shifts:
        after, predicted = again(fit, car, shift), width.by_parameter(shift.moved)
        if after is None:
            stuck += 1
            continue
        for name, answer in width.estimands.items():
            misses.append(round((after[name] - before[name] - predicted[name]) / answer.sd, 4))
    sds = {n: fit.space.log_deviation(fit.mode.covariance, n) for n in ("c_f", "c_r", "i")}
    return {
        "terrain": terrain,
        "known": known,
        "seed": seed,
        "seconds": seconds,
        "faults": len(width.shifts),
        "not_settled": stuck,
        "misses": misses,
        "deviation_ratio": {n: width.estimands[n].sd / sd for n, sd in sds.items()},
    }


def main() -> int:
    """Run the bench and write its results; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--runs", type=int, default=2, help="per terrain and kind of vehicle")
    parser.add_argument("--seed", type=int, default=31)
    given = parser.parse_args()
    rows = []
    for terrain in TERRAINS:
        for known in KNOWN:
            for k in range(given.runs):
                rows.append(one(terrain, known, given.seed + k))
                worst = max(map(abs, rows[-1]["misses"]))
                print(terrain, known, given.seed + k, f"{worst:.2f}", file=sys.stderr, flush=True)
    misses = np.abs(np.concatenate([row["misses"] for row in rows]))
    ratios = [abs(math.log(r)) for row in rows for r in row["deviation_ratio"].values()]
    summary = {
        "drives": len(rows),
        "faults": sum(row["faults"] for row in rows),
        "not_settled": sum(row["not_settled"] for row in rows),
        "forecasts": len(misses),
        "miss_median": float(np.median(misses)),
        "miss_95_percent": float(np.quantile(misses, 0.95)),
        "miss_largest": float(misses.max()),
        "deviations_apart_percent": 100.0 * math.expm1(max(ratios)),
        "seconds_median": float(np.median([row["seconds"] for row in rows])),
    }
    commit = current_commit()
    about = {"commit": commit, "version": __version__, "seed": given.seed, "runs": given.runs}
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps({"about": about, "summary": summary, "rows": rows}, indent=1))
    print(json.dumps(summary, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
