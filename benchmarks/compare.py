"""Is the probability of a change calibrated?  Pairs of sessions of the rig, compared.

A car is drawn about the baja of the rig, its given values off by what the vehicle file declares,
and driven; then each of front damping, rear damping and pitch inertia is, with probability ½,
changed, and the car is driven again over another road.  Half of the changes are of a listed size
(3 to 30 %), half are drawn from the prior that :mod:`bayes_asv.analysis.session_changes` states.  A
third of the pairs are not changed at all; they count for the false alarms only, so that the others
have the prior's share of changes.  The sensors are those of the rig's logger on every other pair,
and have ten times their noise on the others, so that small changes are not all beyond doubt.

Each session is one drive, estimated by weighted draws (:func:`fit_single_run`), which takes a tenth
of the time of the sampler; ``--whole`` sends pairs through ``asv.compare`` as users call it.

``python -m benchmarks.compare`` writes ``benchmarks/results/compare.json`` and continues where it
was stopped.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

import bayes_asv as asv
from bayes_asv.analysis.run_consistency import fit_single_run
from bayes_asv.analysis.session_changes import (
    CHANGE_SD,
    UNCHANGED,
    Session,
    session,
    session_changes,
)
from bayes_asv.domain.files import write_atomically
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.library.progress import progress_bar
from bayes_asv.preprocessing.run_preparation import prepare_runs
from benchmarks.provenance import current_commit
from tests.posterior.cases import DECLARED, as_recording, vehicle
from tests.rig import (
    DEFAULT_SPEEDS,
    TERRAINS,
    RigCar,
    SensorSpec,
    baja,
    draw,
    draw_biases,
    drive,
)

__all__ = ["calibration_error", "main", "pair", "summary"]

RESULTS = Path(__file__).parent / "results" / "compare.json"
NAMES = ("c_f", "c_r", "i")
SIZES = (0.03, 0.05, 0.1, 0.2, 0.3)
TERRAIN_NAMES = ("bump", "stops", "rough")
NOISY = 10.0
BINS = 10

Array = NDArray[np.float64]
Row = dict[str, Any]


def sensors(number: int) -> SensorSpec:
    """Sensors of a pair: those of the rig's logger, or noisy ones."""
    spec = SensorSpec()
    if number % 2 == 0:
        return spec
    front, chassis, rear, other = (NOISY * x for x in spec.noise)
    return replace(spec, noise=(front, chassis, rear, other))


def changes(rng: np.random.Generator, number: int) -> dict[str, float]:
    """Draw the logarithms of after over before."""
    out = dict.fromkeys(NAMES, 0.0)
    if number % 3 == 2:
        return out
    for name in NAMES:
        if rng.random() < 1.0 - UNCHANGED:
            listed = math.log1p(rng.choice([-1.0, 1.0]) * rng.choice(SIZES))
            out[name] = listed if rng.random() < 0.5 else CHANGE_SD * rng.standard_normal()
    return out


def drives(seed: int, number: int) -> tuple[tuple[Recording, Recording], dict[str, float], str]:
    """Drive a car before and after its changes."""
    rng = np.random.default_rng([seed, number, 21])
    car = draw(baja(), rng, DECLARED)
    spec = draw_biases(sensors(number), rng)
    change = changes(rng, number)
    changed = replace(
        car, **{name: getattr(car, name) * math.exp(by) for name, by in change.items()}
    )
    roads = [str(name) for name in rng.choice(TERRAIN_NAMES, 2)]
    both = tuple(
        _drive(one, road, spec, rng) for one, road in zip((car, changed), roads, strict=True)
    )
    return (both[0], both[1]), change, " and ".join(roads)


def _drive(car: RigCar, road: str, spec: SensorSpec, rng: np.random.Generator) -> Recording:
    place, noise = (int(x) for x in rng.integers(2**31, size=2))
    run = drive(car, TERRAINS[road](place), DEFAULT_SPEEDS[road], 400.0, 2.0, spec, noise)
    return as_recording(run, f"{road} {place}")


def fitted(recording: Recording, known: Vehicle) -> Session | str:
    """Estimate one drive; the reason where it is refused."""
    lines, reasons, _ = prepare_runs([recording], known)
    if reasons:
        return reasons[0]
    alone = fit_single_run(lines[0], known, 0)
    if alone.fit.reasons or alone.misfit_reasons:
        return (*alone.fit.reasons, *alone.misfit_reasons)[0]
    space = alone.fit.space
    return session(space, known, alone.z[:, : space.car_dimension], {})


def pair(seed: int, number: int, *, whole: bool = False) -> Row:
    """Compare both sessions of a pair."""
    recordings, change, roads = drives(seed, number)
    known = vehicle(DECLARED, sensors(number))
    row: Row = {"pair": number, "roads": roads, "change": change}
    if whole:
        found = asv.compare(*recordings, known, seed=number, progress=False)
        if found.verdict == "refused":
            return row | {"refused": found.reasons[0]}
        parts = [found[name] for name in NAMES]
        return row | {
            "lower": [c.probability_lower for c in parts],
            "higher": [c.probability_higher for c in parts],
            "mean": [math.log(c.ratio) for c in parts],
            "sd": [c.log_sd for c in parts],
            "p_values": [c.p for c in parts],
            "p_value": found.p,
            "verdict": found.verdict,
        }
    sessions = [fitted(recording, known) for recording in recordings]
    for one in sessions:
        if isinstance(one, str):
            return row | {"refused": one}
    first, second = (one for one in sessions if isinstance(one, Session))
    result = session_changes(first, second)
    return row | {
        "lower": result.lower.tolist(),
        "higher": result.higher.tolist(),
        "mean": result.mean.tolist(),
        "sd": result.sd.tolist(),
        "p_values": result.p_values.tolist(),
        "p_value": result.p_value,
        "rest": result.rest.p,
    }


def calibration_error(predicted: Array, happened: Array) -> float:
    """Compute the expected calibration error over bins of equal width (Guo et al. 2017)."""
    place = np.minimum((predicted * BINS).astype(int), BINS - 1)
    return float(
        sum(
            np.mean(place == b) * abs(predicted[place == b].mean() - happened[place == b].mean())
            for b in np.unique(place)
        )
    )


def share(hits: Sequence[bool] | NDArray[np.bool_]) -> Row:
    """Count hits, with the exact 95 % interval of their share (Clopper & Pearson 1934)."""
    if not len(hits):
        return {"of": 0}
    found = binomtest(int(np.sum(hits)), len(hits)).proportion_ci(0.95, "exact")
    return {
        "of": len(hits),
        "share": float(np.mean(hits)),
        "interval95": [float(found.low), float(found.high)],
    }


def summary(rows: Sequence[Row]) -> Row:
    """Calibration, false alarms, power and coverage over pairs that were not refused."""
    used = [row for row in rows if "refused" not in row]
    out: Row = {"pairs": len(rows), "refused": len(rows) - len(used)}
    if not used:
        return out
    true = np.array([[row["change"][name] for name in NAMES] for row in used])
    lower, higher, p, mean, sd = (
        np.array([row[key] for row in used])
        for key in ("lower", "higher", "p_values", "mean", "sd")
    )
    drawn = np.array([row["pair"] % 3 != 2 for row in used])
    changed = lower + higher
    for key, predicted, happened in (
        ("changed", changed, true != 0.0),
        ("lower", lower, true < 0.0),
        ("higher", higher, true > 0.0),
    ):
        some = predicted[drawn].ravel(), happened[drawn].ravel()
        out[key] = {
            "expected_calibration_error": calibration_error(*some),
            "mean_predicted": float(some[0].mean()),
            "share": float(some[1].mean()),
            "brier": float(np.mean((some[0] - some[1]) ** 2)),
            "between_5_and_95_percent": int(np.sum((some[0] > 0.05) & (some[0] < 0.95))),
        }
    noisy = np.array([row["pair"] % 2 == 1 for row in used])
    for key, of in (("logger", ~noisy), ("ten times its noise", noisy)):
        which = drawn & of
        if np.any(which):
            out[f"changed, {key}"] = {
                "expected_calibration_error": calibration_error(
                    changed[which].ravel(), true[which].ravel() != 0.0
                ),
                "median_sd_percent": [float(100.0 * x) for x in np.median(sd[of], axis=0)],
                "called changed, 3 to 5 %": share(
                    changed[of][_between(true[of], 0.029, 0.051)] > 0.95
                ),
            }
    same = true == 0.0
    out["false alarms of one test at 5 %"] = share(p[same] < 0.05)
    nothing = same.all(axis=1)
    whole = np.array([row["p_value"] for row in used])
    out["false alarms of the test of all at 5 %"] = share(whole[nothing] < 0.05)
    out["called changed (above 95 %) though it is not"] = share(changed[same] > 0.95)
    if "rest" in used[0]:
        rest = np.array([row["rest"] for row in used])
        out["false alarms of the test of what is shared at 1 %"] = share(rest < 0.01)
    out["interval holds the change"] = share(
        (np.abs(mean - true) < 1.959964 * sd)[np.isfinite(sd)].ravel()
    )
    out["called changed by size"] = {
        f"{100 * low:g} to {100 * high:g} %": share(changed[_between(true, low, high)] > 0.95)
        for low, high in ((1e-9, 0.01), (0.01, 0.029), (0.029, 0.049), (0.049, 0.09), (0.09, 9.0))
    }
    out["median_sd_percent"] = [float(100.0 * x) for x in np.median(sd, axis=0)]
    return out


def _between(change: Array, low: float, high: float) -> NDArray[np.bool_]:
    """Whether changes of logarithms are of a size within limits, as shares."""
    size = np.abs(np.expm1(change))
    return np.asarray((size >= low) & (size < high))


def about(seed: int) -> Row:
    """Seed, version and commit that the figures belong to."""
    return {"commit": current_commit(), "version": asv.__version__, "seed": seed}


def main() -> int:
    """Run what is left, write the results and print the summary."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--pairs", type=int, default=1200)
    parser.add_argument("--whole", type=int, default=0, help="pairs through asv.compare")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    told = about(given.seed)
    done = json.loads(RESULTS.read_text("utf-8")) if RESULTS.exists() else {}
    with progress_bar() as progress:
        for part, count in (("pairs", given.pairs), ("whole", given.whole)):
            before = done.get(part, {})
            rows = before.get("each", []) if before.get("about") == told else []
            while len(rows) < count:
                rows.append(pair(given.seed, len(rows), whole=part == "whole"))
                result = {"about": told, "summary": summary(rows), "each": rows}
                done[part] = result
                if len(rows) % 20 == 0 or len(rows) == count:
                    write_atomically(RESULTS, (json.dumps(done, indent=1) + "\n").encode())
                if progress is not None:
                    progress(len(rows) / count, f"{len(rows)} of {count} {part}")
    print(json.dumps({part: one["summary"] for part, one in done.items()}, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
