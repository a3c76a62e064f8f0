"""Runs held against each other, and recordings against replicates, on drives of the rig.

Every car is drawn anew, driven over a bump, two parking stops and a rough road, and each run is
asked alone.  Counted are

- false alarms: equal runs, in pairs and threes, that are said to disagree;
- power: the front damper of one run changed by 0.2 to 5 %;
- coverage: dampers that differ from run to run by a known spread, and whether the interval of
  the mean car covers the rate in the middle of that spread, on the rig and, more often, with
  Gaussian runs that each know a rate to 0.1 %;
- predictive checks: how often a run that the half car explains is told, and one with a hidden
  effect.

``python -m benchmarks.agreement`` writes ``benchmarks/results/agreement.json``.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binomtest

from bayes_asv import __version__
from bayes_asv.analysis.predictive_checks import predictive_checks
from bayes_asv.analysis.random_effects import RunLikelihood, fit_random_effects, homogeneity_test
from bayes_asv.analysis.run_consistency import SingleRunFit, compare_runs, fit_single_run
from bayes_asv.domain.files import write_atomically
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.preprocessing.run_preparation import prepare_runs
from benchmarks.provenance import current_commit
from tests.posterior.cases import DECLARED, EXACT, as_recording, vehicle
from tests.rig import (
    DEFAULT_SPEEDS,
    TERRAINS,
    AsymmetricDamper,
    ChassisForce,
    Coulomb,
    Engine,
    RigCar,
    SensorSpec,
    baja,
    draw,
    draw_biases,
    drive,
    with_terms,
)

__all__ = ["main"]

RESULTS = Path(__file__).parent / "results" / "agreement.json"
TERRAIN_NAMES = ("bump", "stops", "rough")
GIVEN = {"exact": EXACT, "declared": DECLARED}
CHANGES = (1.002, 1.005, 1.01, 1.02, 1.05)
SPREADS = (0.03, 0.1)
POUND = 4.4482216152605  # N
DRAWS = 4000


class Job(NamedTuple):
    """One car of the bench."""

    given: str
    seed: int
    number: int


def drives(
    car: RigCar, vehicle: Vehicle, rng: np.random.Generator, sensors: SensorSpec
) -> Iterator[tuple[str, Any]]:
    """Set up a drive a terrain; calling one with a changed car gives its run alone, or None."""
    for terrain in TERRAIN_NAMES:
        road, noise = (int(v) for v in rng.integers(2**31, size=2))

        def go(
            car: RigCar,
            forces: Sequence[ChassisForce] = (),
            terrain: str = terrain,
            road: int = road,
            noise: int = noise,
        ) -> SingleRunFit | None:
            where = TERRAINS[terrain](road)
            run = drive(
                car, where, DEFAULT_SPEEDS[terrain], 400.0, 2.0, sensors, noise, forces=forces
            )
            lines, reasons, _ = prepare_runs([as_recording(run, f"{terrain}.csv")], vehicle)
            return None if reasons else fit_single_run(lines[0], vehicle, noise % 1000)

        yield terrain, go


def effects(car: RigCar, seed: int) -> Iterator[tuple[str, RigCar, Sequence[ChassisForce]]]:
    """Cars that are not the half car."""
    for ratio in (1.3, 3.0):
        terms = AsymmetricDamper(car.c_f, ratio)
        yield f"front damper {ratio:g}:1", with_terms(car, "front", terms, damper=False), ()
    yield "rear friction 5 lbf", with_terms(car, "rear", Coulomb(5.0 * POUND)), ()
    yield "engine", car, (Engine(seed=seed),)


def one(job: Job) -> list[dict[str, Any]]:
    """Everything that is asked of one car, as rows."""
    rng = np.random.default_rng([job.seed, job.number, 11])
    car = draw(baja(), rng, GIVEN[job.given])
    known = vehicle(GIVEN[job.given])
    tracks = dict(drives(car, known, rng, draw_biases(SensorSpec(), rng)))
    rows: list[dict[str, Any]] = []
    plain = {terrain: go(car) for terrain, go in tracks.items()}
    whole = {terrain: run for terrain, run in plain.items() if run is not None}
    for size in (2, 3):
        for chosen in combinations(whole, size):
            found = compare_runs([whole[t] for t in chosen], DRAWS, 0)
            rows.append({"what": f"alike, {size} runs", "p": found.overall_test.p})
    rows += [told(f"half car, {t}", run) for t, run in whole.items()]
    if job.number % 4 == 0 and {"bump", "rough"} <= set(whole):
        for change in CHANGES:
            moved = tracks["stops"](replace(car, c_f=change * car.c_f))
            if moved is not None:
                pair = compare_runs([whole["bump"], moved], DRAWS, 0)
                rows.append({"what": f"front {100 * (change - 1):.1f} %", "p": pair.overall_test.p})
        for spread in SPREADS:
            factors = np.exp(spread * rng.standard_normal(3))
            changed = [
                go(replace(car, c_f=factor * car.c_f))
                for go, factor in zip(tracks.values(), factors, strict=True)
            ]
            there = [run for run in changed if run is not None]
            for count in (2, 3):
                if len(there) >= count:
                    rows.append(covered(there[:count], car, spread))
    if job.number % 8 == 0:
        for name, other, forces in effects(car, job.number):
            for go in tracks.values():
                run = go(other, forces)
                if run is not None:
                    rows.append(told(name, run))
    return [{"given": job.given, "car": job.number, **row} for row in rows]


def covered(runs: list[SingleRunFit], car: RigCar, spread: float) -> dict[str, Any]:
    """Tell whether the interval of the mean car covers the middle of a known spread."""
    found = compare_runs(runs, DRAWS, 0)
    c_f = found.quantities(found.population.centre, 0)["c_f"]
    low, high = np.quantile(c_f, [0.025, 0.975])
    return {
        "what": f"spread {100 * spread:.0f} %, {len(runs)} runs",
        "p": found.overall_test.p,
        "covers": bool(low < car.c_f < high),
        "half_width_percent": 50.0 * float(high - low) / car.c_f,
    }


def told(name: str, run: SingleRunFit) -> dict[str, Any]:
    """Smallest corrected probability of a run's checks."""
    checks = predictive_checks(run.fit.posterior, run.z, 0, 0)
    return {
        "what": name,
        "p_family": min(check.p_family for check in checks),
        "residual_p": [round(check.p, 4) for check in checks if check.of == "residual"],
        "reading_p": [round(check.p, 4) for check in checks if check.of == "reading"],
        "notches": len(run.fit.space.recordings[0].notches),
    }


def gaussian(seed: int, times: int = 200) -> list[dict[str, Any]]:
    """Coverage of the mean car where each run is a Gaussian likelihood."""
    rng = np.random.default_rng([seed, 12])
    prior, own = np.log([3.0, 3.0, 2.0]), 0.001
    way = np.diag(1.0 / prior)
    rows = []
    for spread in (*SPREADS, 0.3):
        for count in (2, 3, 5):
            for k in range(times):
                value = own * rng.standard_normal((count, 3))
                value[:, 0] += spread * rng.standard_normal(count)
                placed_effects = [
                    RunLikelihood(np.diag((prior / own) ** 2), prior * v / own**2) for v in value
                ]
                found = fit_random_effects(placed_effects, way, DRAWS, k)
                low, high = prior[0] * np.quantile(found.centre[:, 0], [0.025, 0.975])
                rows.append(
                    {
                        "given": "Gaussian",
                        "what": f"spread {100 * spread:.0f} %, {count} runs",
                        "p": homogeneity_test(placed_effects, way).p,
                        "covers": bool(low < 0.0 < high),
                        "half_width_percent": 50.0 * float(high - low),
                    }
                )
    return rows


def share(hits: Sequence[bool]) -> dict[str, Any]:
    """Count hits, with the exact 95 % interval of their share (Clopper & Pearson 1934)."""
    found = binomtest(int(np.sum(hits)), len(hits)).proportion_ci(0.95, "exact")
    return {
        "of": len(hits),
        "share": float(np.mean(hits)),
        "interval95": [float(found.low), float(found.high)],
    }


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Shares by what was asked and what was given."""
    by = defaultdict(list)
    for row in rows:
        by[row["what"], row["given"]].append(row)
    out: dict[str, Any] = {}
    for (what, given), mine in by.items():
        entry: dict[str, Any] = {}
        if "p" in mine[0]:
            entry |= {f"p below {a}": share([r["p"] < a for r in mine]) for a in (0.05, 0.01)}
        if "covers" in mine[0]:
            seen = [r for r in mine if r["p"] < 0.01]
            entry["covers"] = share([r["covers"] for r in seen]) if seen else None
            entry["half_width_percent"] = float(
                np.median([r["half_width_percent"] for r in seen] or [np.nan])
            )
        if "p_family" in mine[0]:
            entry |= {f"told at {a}": share([r["p_family"] < a for r in mine])
                      for a in (0.05, 0.01)}  # fmt: skip
            for of in ("residual_p", "reading_p"):
                entry[f"{of} below 0.05"] = float(np.mean([np.array(r[of]) < 0.05 for r in mine]))
            entry["with a notch"] = share([r["notches"] > 0 for r in mine])
        out[f"{what}, {given}"] = entry
    return out


def main() -> int:
    """Run the bench and write its results; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--cars", type=int, default=100, help="for exact and declared values each")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    commit = current_commit()
    about = {
        "commit": commit,
        "version": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "cores": os.cpu_count(),
        "seed": given.seed,
    }
    rows = gaussian(given.seed)
    for number in range(given.cars):
        for known in GIVEN:
            rows += one(Job(known, given.seed, number))
        print(f"{number + 1} of {given.cars} cars", file=sys.stderr, flush=True)
        # After every car, so that hours of work may be stopped.
        whole = {"about": {**about, "cars": number + 1}, "summary": summary(rows), "rows": rows}
        write_atomically(RESULTS, json.dumps(whole, indent=1).encode())
    print(json.dumps(summary(rows), indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
