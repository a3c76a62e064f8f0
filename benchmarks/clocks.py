"""Coverage of 95 % intervals when the body channels have a clock of their own.

Cars are drawn about the baja of the rig.  The body accelerometers are sampled by another clock than
the wheels', with an offset of up to 15 ms, and over 60 s of rough road a drift of up to 50 ppm as
well.  The vehicle file declares the clock with the default priors.  The second set has neither
offset nor drift, lasts 10 s at most, and is estimated with and without the declaration.
``python -m benchmarks.clocks`` writes ``benchmarks/results/clocks.json``; it resumes where it was
stopped.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from bayes_asv.domain.clocks import Clock
from bayes_asv.domain.recording import CHANNELS, Recording
from bayes_asv.domain.vehicle import Vehicle, read_vehicle
from bayes_asv.estimate_result import EstimationResult
from bayes_asv.estimation import estimate
from benchmarks.provenance import current_commit
from tests.rig import (
    DECLARED_SDS,
    DEFAULT_SPEEDS,
    TERRAINS,
    RigCar,
    SensorSpec,
    baja,
    draw,
    draw_biases,
    drive,
    vehicle_toml,
)

__all__ = ["CLOCK", "drawn", "main", "one", "recorded"]

RESULTS = Path(__file__).parent / "results" / "clocks.json"
SETS = ("offset", "synchronous", "undeclared")
_QUICK = (("bump", 3.0, 400.0), ("stops", 3.0, 400.0))  # s, Hz
DRIVES = (*_QUICK, *_QUICK, ("rough", 60.0, 200.0))
SHORT = 10.0  # s, where there is no drift to be found
LARGEST_OFFSET, LARGEST_DRIFT = 0.015, 50e-6
NAMES = ("c_f", "c_r", "i")
CLOCK = Clock("phone", ("front_chassis", "rear_chassis"))


def recorded(
    car: RigCar, terrain: str, seconds: float, rate: float, offset: float, drift: float, seed: int
) -> Recording:
    """Drive a car whose body channels are stamped by a clock that is off.

    Parameters
    ----------
    car : RigCar
        Truth.
    terrain : str
        Name in ``TERRAINS``.
    seconds, rate : float
        s, Hz.
    offset, drift : float
        The body is sampled at t / (1 + drift) + offset when its row says t.
    seed : int
        Of road, biases and noise.
    """
    rng = np.random.default_rng([seed, 1])
    sensors = draw_biases(SensorSpec(), rng)
    road, noise = (int(v) for v in rng.integers(2**31, size=2))
    late = replace(sensors, clock_offset=(offset, offset), clock_ppm=(-1e6 * drift,) * 2)
    wheels, body = (
        drive(car, TERRAINS[terrain](road), DEFAULT_SPEEDS[terrain], rate, seconds, one, noise)
        for one in (sensors, late)
    )
    values = np.where(np.array([[True], [False], [True], [False]]), wheels.channels, body.channels)
    return Recording(
        time=wheels.time, values=values, units=("m/s^2",) * 4, source=f"{terrain} {seed}",
        channels=CHANNELS,
    )  # fmt: skip


def drawn(seed: int) -> tuple[RigCar, Vehicle]:
    """Draw a car, and its vehicle file; given values are exact on every other seed."""
    sds = dict(DECLARED_SDS) if seed % 2 else dict.fromkeys(DECLARED_SDS, 0.0)
    car = draw(baja(), np.random.default_rng([seed, 2]), sds)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "car.toml"
        path.write_text(vehicle_toml(baja(), SensorSpec(), sds), encoding="utf-8")
        return car, read_vehicle(path)


def one(which: str, seed: int) -> dict[str, Any]:
    """Drive one car and hold its intervals against the truth."""
    terrain, seconds, rate = DRIVES[seed % len(DRIVES)]
    seconds = seconds if which == "offset" else min(seconds, SHORT)
    car, vehicle = drawn(seed)
    sizes = np.random.default_rng([seed, 3]).uniform(-1.0, 1.0, 2)
    offset, drift = sizes * (LARGEST_OFFSET, LARGEST_DRIFT) if which == "offset" else (0.0, 0.0)
    recording = recorded(car, terrain, seconds, rate, float(offset), float(drift), seed)
    clocks = () if which == "undeclared" else (CLOCK,)
    result = estimate([recording], replace(vehicle, clocks=clocks), seed=seed)
    out: dict[str, Any] = {"seed": seed, "terrain": terrain, "verdict": result.verdict}
    out["seconds"] = result.seconds
    if result.verdict == "refused":
        return out | {"reasons": list(result.reasons)}
    for name in NAMES:
        out[name] = against(result.draws[name], float(getattr(car, name)))
    for kind, true in (("offset", offset), ("drift", drift)) if clocks else ():
        out[kind] = against(clock_draws(result, kind), float(true), 1.0)
    return out


def clock_draws(result: EstimationResult, kind: str) -> Any:
    """Draws of the offset or the drift of the only clock."""
    return next(x for name, x in result.nuisance.items() if name.startswith(f"clock {kind}"))


def against(draws: Any, true: float, unit: float | None = None) -> dict[str, Any]:
    """Hold draws against the truth; error and deviation in a unit, by default the truth."""
    unit = true if unit is None else unit
    low, high = np.quantile(draws, [0.025, 0.975])
    return {
        "inside": bool(low <= true <= high),
        "error": float((draws.mean() - true) / unit),
        "sd": float(draws.std() / unit),
    }


def summary(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Coverage with its 95 % interval, median error and median deviation of each quantity."""
    answered = [run for run in runs if run["verdict"] != "refused"]
    out: dict[str, Any] = {"runs": len(runs), "refused": len(runs) - len(answered)}
    out["seconds"] = float(np.median([run["seconds"] for run in runs]))
    for name in (*NAMES, "offset", "drift"):
        known = [run[name] for run in answered if name in run]
        if not known:
            continue
        hits = sum(one["inside"] for one in known)
        interval = binomtest(hits, len(known)).proportion_ci(method="exact")
        out[name] = {
            "coverage": hits / len(known),
            "coverage_interval": [float(interval.low), float(interval.high)],
            "median_error": float(np.median([abs(one["error"]) for one in known])),
            "median_sd": float(np.median([one["sd"] for one in known])),
        }
    return out


def main() -> int:
    """Run what is left and write the summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=24)
    parser.add_argument("--seed", type=int, default=2000)
    parser.add_argument("--set", choices=SETS, action="append")
    arguments = parser.parse_args()
    done = json.loads(RESULTS.read_text("utf-8")) if RESULTS.exists() else {}
    commit = current_commit()
    for which in arguments.set or SETS:
        part = done.get(which, {})
        runs = part.get("each", []) if part.get("commit") == commit else []
        for seed in range(arguments.seed + len(runs), arguments.seed + arguments.runs):
            runs.append(one(which, seed))
            done[which] = {"commit": commit, "first_seed": arguments.seed, **summary(runs)}
            done[which]["each"] = runs
            RESULTS.write_text(json.dumps(done, indent=1) + "\n", encoding="utf-8")
            print(which, seed, runs[-1], file=sys.stderr)
        print(which, {k: v for k, v in done[which].items() if k != "each"})
    return 0


if __name__ == "__main__":
    sys.exit(main())
