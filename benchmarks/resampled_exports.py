"""Interval widths from resampled exports, compared with those from the original recordings.

Cars are drawn about a baja and a heavier, softer car, and driven on the rig.  Each recording is
then exported as PC programs of loggers do: held, interpolated linearly or by a cubic spline, or
low-passed.  An export holds no more information than its original, so no 95 % interval may be
narrower.  ``python -m benchmarks.resampled_exports`` writes
``benchmarks/results/resampled_exports.json``; it resumes where it was stopped.
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
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import butter as butterworth
from scipy.signal import filtfilt, firwin, resample_poly, sosfiltfilt
from scipy.stats import binomtest

from bayes_asv.domain.recording import Recording
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

__all__ = ["EXPORTS", "export", "main"]

RESULTS = Path(__file__).parent / "results" / "resampled_exports.json"
NAMES = ("c_f", "c_r", "i")
TERRAIN_NAMES = ("bump", "stops", "rough")
# How, the rate of the logger, and that of the export, Hz.
EXPORTS = (
    ("held", 400, 800), ("linear", 400, 1000), ("cubic", 400, 1000), ("sinc", 400, 1000),
    ("linear", 400, 800), ("held", 400, 1000), ("fir", 800, 800), ("linear", 800, 1000),
    ("cubic", 200, 500), ("held", 200, 1000), ("linear", 200, 500), ("cubic", 400, 800),
    ("sinc", 400, 800), ("butterworth", 400, 400),
)  # fmt: skip

Array = NDArray[np.float64]


def heavy() -> RigCar:
    """Return a car with three times the mass of the baja and softer springs."""
    car = baja()
    return replace(
        car, name="heavy", m=3.0 * car.m, i=4.5 * car.i, l=2.4, k_f=2.0 * car.k_f,
        k_r=2.2 * car.k_r, c_f=2.2 * car.c_f, c_r=2.0 * car.c_r, m_uf=1.5 * car.m_uf,
        m_ur=1.5 * car.m_ur, k_tf=3.0 * car.k_tf, k_tr=3.0 * car.k_tr, wdf=0.52,
    )  # fmt: skip


def export(time: Array, values: Array, how: str, rate: int, new: int) -> tuple[Array, Array]:
    """Resample channels (C, N) as an export does.

    Parameters
    ----------
    time, values : (N,) and (C, N) arrays
        Stamps (s) on an even grid, and readings.
    how : str
        First entry of one of `EXPORTS`.
    rate, new : int
        Of the recording and of the export, Hz.

    Returns
    -------
    (M,) and (C, M) arrays
        Stamps and readings of the export.
    """
    if how == "sinc":
        ratio = np.gcd(rate, new)
        out = resample_poly(values, new // ratio, rate // ratio, axis=1, padtype="line")
        return time[0] + np.arange(out.shape[1]) / new, np.asarray(out)
    if how == "fir":
        return time, np.asarray(filtfilt(firwin(65, 0.4), np.ones(1), values, axis=1))
    if how == "butterworth":
        low = butterworth(8, 0.5, output="sos")
        return time, np.asarray(sosfiltfilt(low, values, axis=1))
    stamps = time[0] + np.arange(int((time[-1] - time[0]) * new + 1e-9) + 1) / new
    if how == "held":
        return stamps, values[:, np.searchsorted(time, stamps + 1e-9, side="right") - 1]
    if how == "linear":
        return stamps, np.array([np.interp(stamps, time, x) for x in values])
    return stamps, np.asarray(CubicSpline(time, values, axis=1)(stamps))


def widths(result: EstimationResult) -> dict[str, float]:
    """Widths of the 95 % intervals."""
    return {n: float(np.subtract(*np.quantile(result.draws[n], [0.975, 0.025]))) for n in NAMES}


def inside(result: EstimationResult, car: RigCar) -> dict[str, bool]:
    """Whether the intervals contain the true values."""
    out = {}
    for name in NAMES:
        low, high = np.quantile(result.draws[name], [0.025, 0.975])
        out[name] = bool(low <= getattr(car, name) <= high)
    return out


def declared(car: RigCar, sensors: SensorSpec, sds: dict[str, float]) -> Vehicle:
    """Return the vehicle file of a nominal car."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "car.toml"
        path.write_text(vehicle_toml(car, sensors, sds), encoding="utf-8")
        return read_vehicle(path)


def one(seed: int) -> dict[str, Any]:
    """Drive a car, export its recording, and estimate from both."""
    how, rate, new = EXPORTS[seed % len(EXPORTS)]
    terrain = TERRAIN_NAMES[seed % len(TERRAIN_NAMES)]
    rng = np.random.default_rng([seed, 826])
    nominal = heavy() if seed % 5 in (1, 3) else baja()
    sds = dict(DECLARED_SDS) if seed % 2 else dict.fromkeys(DECLARED_SDS, 0.0)
    # every third logger has a converter without visible steps
    kind = SensorSpec(adc=None) if seed % 3 == 2 else SensorSpec()
    car = draw(nominal, rng, sds)
    road, noise = (int(v) for v in rng.integers(2**31, size=2))
    run = drive(
        car, TERRAINS[terrain](road), DEFAULT_SPEEDS[terrain], float(rate), 2.0,
        draw_biases(kind, rng), noise,
    )  # fmt: skip
    vehicle = declared(nominal, kind, sds)
    source = f"{terrain} {seed}"
    units = ("m/s^2",) * 4
    original = estimate([Recording(run.time, run.channels, units, source=source)], vehicle)
    time, values = export(run.time, run.channels, how, rate, new)
    exported = Recording(time, np.round(values, 5), units, source=source)
    result = estimate([exported], vehicle)
    out: dict[str, Any] = {
        "seed": seed, "export": [how, rate, new], "terrain": terrain, "car": nominal.name,
        "verdicts": [original.verdict, result.verdict],
        "found": [w for w in result.warnings if "Hz" in w],
    }  # fmt: skip
    if original.draws and result.draws:
        before, after = widths(original), widths(result)
        out["width_ratio"] = {n: after[n] / before[n] for n in NAMES}
        out["inside"] = [inside(original, car), inside(result, car)]
    else:
        out["reasons"] = [list(original.reasons), list(result.reasons)]
    return out


def summary(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Least and median ratio of widths, and coverage before and after."""
    answered = [run for run in runs if "width_ratio" in run]
    ratios = np.array([[run["width_ratio"][n] for n in NAMES] for run in answered])
    out: dict[str, Any] = {
        "runs": len(runs),
        "refused": len(runs) - len(answered),
        "recognised": sum(bool(run["found"]) for run in runs),
        "least_ratio": float(ratios.min()),
        "median_ratio": float(np.median(ratios)),
        "narrower_by_5_percent": int(np.count_nonzero(ratios < 0.95)),
    }
    for k, name in enumerate(("coverage_original", "coverage_export")):
        hits = sum(run["inside"][k][n] for run in answered for n in NAMES)
        total = len(NAMES) * len(answered)
        interval = binomtest(hits, total).proportion_ci(method="exact")
        out[name] = [hits / total, float(interval.low), float(interval.high)]
    return out


def main() -> int:
    """Run what is left and write the summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=56)
    parser.add_argument("--seed", type=int, default=4000)
    arguments = parser.parse_args()
    done = json.loads(RESULTS.read_text("utf-8")) if RESULTS.exists() else {}
    commit = current_commit()
    runs = done.get("each", []) if done.get("first_seed") == arguments.seed else []
    for seed in range(arguments.seed + len(runs), arguments.seed + arguments.runs):
        runs.append(one(seed))
        print(runs[-1], file=sys.stderr, flush=True)
        if any("width_ratio" in run for run in runs):
            done = {"commit": commit, "first_seed": arguments.seed, **summary(runs), "each": runs}
            RESULTS.write_text(json.dumps(done, indent=1) + "\n", encoding="utf-8")
    print({k: v for k, v in done.items() if k != "each"})
    return 0


if __name__ == "__main__":
    sys.exit(main())
