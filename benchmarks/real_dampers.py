"""Cars whose front dampers have been on a dynamometer: what the diagnosis makes of them.

The curves are those of two real dampers (``shared/data/dyno``; the files are not part of the
project), force against speed with the loop taken out, scaled in force and in speed as another
setting or another motion ratio would.  Half of the cars have a stiffness in series with the damper,
so that force lags velocity.  The rig drives each over one of three terrains, and over another road
of that kind, which is held out.  The true rate is the power that the rig's damper took over the
mean square of its rate.  A shape is named right where the curve is called digressive, where force
is said to lag velocity if and only if there is a stiffness in series, and where the sides are
called unequal if and only if their forces at the root mean square of the speeds driven differ by
more than a tenth; between a twentieth and a fifth either answer is right.
``python -m benchmarks.real_dampers DYNO`` writes ``benchmarks/results/real_dampers.json`` and
resumes where it was stopped.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression
from scipy.signal import savgol_filter

from bayes_asv.diagnosis.workflow import diagnose
from benchmarks.provenance import current_commit, keep, share
from tests.posterior.cases import as_recording, vehicle
from tests.rig import (
    DECLARED_SDS,
    DEFAULT_SPEEDS,
    TERRAINS,
    CurveDamper,
    MountedCurve,
    RigCar,
    RigRun,
    SensorSpec,
    baja,
    draw,
    draw_biases,
    drive,
    with_terms,
)

__all__ = ["Curve", "bent", "drawn", "equal_power", "main", "measured"]

Array = NDArray[np.float64]
Curve = tuple[Array, Array]
"""Rates of deflection, m/s, and the forces against them, N."""

RESULTS = Path(__file__).parent / "results" / "real_dampers.json"
FILES = ("t1_1_1_18_18_s6_n10_100psi.csv", "t1_2_2_24_24_s5_n10_100psi.csv")
DRIVES = (("bump", 3.0), ("stops", 3.0), ("rough", 5.0))
RATE = 400.0
SEEN = 100  # cars that the diagnosis was developed with; those after them were drawn later
_SPEEDS = np.concatenate([[0.0], 0.004 * 1.45 ** np.arange(12)])  # knots on either side, m/s


def measured(path: Path) -> Curve:
    """Curve of a damper from a dynamometer file, without its loop and the gas behind its piston."""
    table = np.genfromtxt(path, delimiter=",", skip_header=1, usecols=(2, 4))
    force, travel = table[:, 0], 1e-3 * table[:, 1]
    rate = savgol_filter(travel, 11, 3, deriv=1, delta=1.0 / 300.0)
    inside = slice(20, -20)
    force, travel, rate = force[inside], travel[inside], rate[inside]
    if np.corrcoef(force, rate)[0, 1] < 0.0:
        rate, travel = -rate, -travel
    gas = np.polyfit(travel, force, 1)[0]  # in phase with travel, which the rate is not
    force = force - gas * (travel - travel.mean())
    knots = np.concatenate([-_SPEEDS[:0:-1], _SPEEDS])
    edges = 0.5 * (knots[1:] + knots[:-1])
    which = np.digitize(rate, edges)
    there = [k for k in range(len(knots)) if np.count_nonzero(which == k) > 5]
    means = np.array([force[which == k].mean() for k in there])
    speeds = np.array([rate[which == k].mean() for k in there])
    at_rest = float(np.interp(0.0, speeds, means))
    rising = isotonic_regression(means - at_rest).x + 1e-3 * (means.max() - means.min()) * speeds
    keep = np.diff(speeds, prepend=-np.inf) > 1e-4
    return speeds[keep], rising[keep] - float(np.interp(0.0, speeds[keep], rising[keep]))


def bent(car: RigCar, curve: Curve, force: float, speed: float, stiffness: float | None) -> RigCar:
    """Give a car a curve at its front axle, scaled; and a stiffness in series, N/m."""
    rates = tuple((curve[0] * speed).tolist())
    forces = tuple((curve[1] * force).tolist())
    term = (
        CurveDamper(rates, forces) if stiffness is None else MountedCurve(rates, forces, stiffness)
    )
    return with_terms(car, "front", term, damper=False)


def equal_power(car: RigCar, run: RigRun) -> float:
    """Power of the front damper over the mean square of its rate, N·s/m."""
    motion = run.motion
    assert motion is not None
    rate = motion.deflection_rate[0]
    force = motion.suspension_force[0] + car.k_f * motion.deflection[0]
    return float(-np.sum(force * rate) / np.sum(rate**2))


def drawn(seed: int, curves: list[Curve]) -> tuple[RigCar, list[RigRun], dict[str, Any]]:
    """One car on two drives, the second to be held out, and what was drawn."""
    rng = np.random.default_rng([seed, 71])
    car = draw(baja(), rng, DECLARED_SDS)
    which = seed % len(curves)
    terrain, seconds = DRIVES[seed // len(curves) % len(DRIVES)]
    speed = float(np.exp(rng.uniform(np.log(0.6), np.log(2.5))))
    rate = float(np.exp(rng.uniform(np.log(900.0), np.log(2500.0))))
    rates, forces = curves[which]
    slope = float(forces[-1] - forces[0]) / float(rates[-1] - rates[0])
    force = rate * speed / slope
    lag = float(rng.uniform(0.002, 0.008))
    stiffness = None if seed // (len(curves) * len(DRIVES)) % 2 else rate / lag
    own = bent(car, curves[which], force, speed, stiffness)
    declared = draw_biases(SensorSpec(), rng)
    runs = []
    for factor in (1.0, 0.85):
        road, noise = (int(v) for v in rng.integers(2**31, size=2))
        run = drive(
            own, TERRAINS[terrain](road), factor * DEFAULT_SPEEDS[terrain], RATE, seconds,
            declared, noise, keep_motion=True,
        )  # fmt: skip
        runs.append(run)
    motion = runs[0].motion
    assert motion is not None
    driven = float(np.sqrt(np.mean(motion.deflection_rate[0] ** 2)))
    ends = np.interp([-driven, driven], rates * speed, forces * force)
    about = {
        "file": FILES[which],
        "terrain": terrain,
        "speed_scale": speed,
        "stiffness": stiffness,
        "extension_over_compression": float(-ends[1] / ends[0]),
        "c_f": equal_power(own, runs[0]),
    }
    return own, runs, about


def one(seed: int, curves: list[Curve]) -> dict[str, Any]:
    """Diagnose one car, and score it."""
    car, runs, about = drawn(seed, curves)
    fit, held = (as_recording(run, f"real-{seed}-{k}.csv") for k, run in enumerate(runs))
    found = diagnose([fit], [held], vehicle(dict(DECLARED_SDS)), seed)
    out: dict[str, Any] = {"seed": seed, **about, "verdict": found.verdict}
    out["seconds"] = found.seconds
    if found.verdict == "refused":
        return {**out, "reasons": list(found.reasons)}
    out["named"] = [[str(e.placed), found.probability_of(e)] for e in found.named]
    out["unexplained"] = bool(found.unexplained and found.unexplained.present)
    assert found.quantities_after is not None
    assert found.errors is not None
    front = next((d for d in found.dampers if d.element == "front"), None)
    # a curve has no rate but that of equal power, whatever the laws that describe it
    after = dict(found.quantities_after)
    if front is not None:
        after["c_f"] = front.equal_power
    for name, truth in (("c_f", about["c_f"]), ("c_r", car.c_r), ("i", car.i)):
        out[name] = [truth, *np.quantile(after[name], [0.025, 0.5, 0.975]).tolist()]
    shapes = [] if front is None else [[s.name, s.side, s.probability] for s in front.shapes]
    out["shapes"] = shapes
    out["shape_right"] = _shape_right(out)
    error = found.errors["holdout"]
    out["gap"] = [error.before, error.after, error.floor]
    return out


def _shape_right(row: dict[str, Any]) -> bool:
    """Whether bend, sides and lag of the front damper are told right."""
    names = {placed.partition("@")[0] for placed, _ in row["named"] if not placed.endswith("@rear")}
    told = {name for name, _, _ in row["shapes"]}
    difference = abs(float(np.log(row["extension_over_compression"])))
    unequal = "unequal_sides" in told
    sides = np.log(1.05) < difference < np.log(1.2) or unequal == (difference > np.log(1.1))
    lags = ("damper_hysteresis" in names) == (row["stiffness"] is not None)
    return "digressive" in told and bool(sides) and lags


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Coverage of 95 % intervals, shares of right names, and the held-out gap that was closed."""
    answered = [row for row in rows if "c_f" in row and row["verdict"] != "refused"]
    out: dict[str, Any] = {"runs": len(rows), "answered": len(answered)}
    if not answered:
        return out
    for name in ("c_f", "c_r", "i"):
        values = [row[name] for row in answered]
        widths = [(high - low) / truth for truth, low, _, high in values]
        out[name] = {
            **share([low <= truth <= high for truth, low, _, high in values]),
            "relative_width": float(np.median(widths)),
        }
    out["shape_right"] = share([row["shape_right"] for row in answered])
    unseen = [row for row in answered if row["seed"] >= SEEN]
    if unseen:
        hits = [low <= truth <= high for truth, low, _, high in (row["c_f"] for row in unseen)]
        right = [row["shape_right"] for row in unseen]
        out["unseen"] = {"runs": len(unseen), "c_f": share(hits), "shape_right": share(right)}
    closed = [
        1.0 - (after**2 - floor**2) / (before**2 - floor**2)
        for before, after, floor in (row["gap"] for row in answered)
    ]
    out["closed"] = {"median": float(np.median(closed)), "least": float(min(closed))}
    return out


def main() -> None:
    """Diagnose all cars that are not there yet."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("dyno", type=Path)
    parser.add_argument("--runs", type=int, default=140)
    parser.add_argument("--out", type=Path, default=RESULTS)
    options = parser.parse_args()
    curves = [measured(options.dyno / name) for name in FILES]
    rows: list[dict[str, Any]] = []
    if options.out.exists():
        rows = json.loads(options.out.read_text(encoding="utf-8"))["rows"]
    for seed in sorted(set(range(options.runs)) - {row["seed"] for row in rows}):
        rows.append(one(seed, curves))
        rows.sort(key=lambda row: row["seed"])
        keep(options.out, {"commit": current_commit(), "summary": summary(rows), "rows": rows})
        print(seed, summary(rows), flush=True)
    print(json.dumps(summary(rows), indent=1))


if __name__ == "__main__":
    main()
