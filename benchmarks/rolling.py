"""Drives of the rig's whole car through ``estimate --car roll``: coverage of 95 % intervals.

    python -m benchmarks.rolling [RUNS]
    python -m benchmarks.rolling again
    python -m benchmarks.rolling worn RUNS

RUNS drives a case (25) over each of four terrains, the right wheels 0.6 m behind the left ones or
on a track of their own, with a true car drawn for each.  Known values are as a team declares them
(1 % mass and weight share, 5 % springs), where the mass makes nearly all of the width, or exact.
``again`` repeats those of the last results that gave no answer, and ``worn`` adds drives of a car
whose front left damper has lost 20 %.  Results go to
``benchmarks/results/rolling.json``.
"""

from __future__ import annotations

import json
import math
import platform
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.stats import beta

from bayes_asv import __version__
from bayes_asv.domain.recording import ROLL_CHANNELS, Recording
from bayes_asv.domain.vehicle import Vehicle, read_vehicle
from bayes_asv.estimate_result import EstimationResult
from bayes_asv.estimation import estimate
from benchmarks.provenance import current_commit
from tests.rig import DEFAULT_SPEEDS, TERRAINS
from tests.rig.wide import WideCar, draw_wide, shifted, wide_baja, wide_drive, wide_toml

__all__ = ["main", "one_run"]

RESULTS: Final = Path(__file__).parent / "results" / "rolling.json"
_TERRAINS: Final = ("bump", "stops", "rough", "rollers")
_ANSWERS: Final = ("c_fl", "c_fr", "c_rl", "c_rr", "i", "i_roll", "ratio_f", "ratio_r")
_WORN: Final = 0.8
_FIRST: Final = {"declared": 1000, "exact": 2000, "worn": 3000}  # seeds


def one_run(case: str, terrain: str, seed: int, vehicle: Vehicle) -> dict[str, Any]:
    """Drive one true car and estimate it.

    Parameters
    ----------
    case : str
        ``declared``, ``exact`` or ``worn`` (declared, front left damper at 80 %).
    terrain : str
        One of the rig's.
    seed : int
        Of the car, the road and the sensors.
    vehicle : Vehicle
        The nominal car as the case declares it.

    Returns
    -------
    dict
        Verdict, and for each answer truth, 95 % interval and standard score of the logarithm.
    """
    rng = np.random.default_rng([seed, 83])
    drawn = draw_wide(wide_baja(), rng)
    if case == "exact":
        given = wide_baja()
        drawn = replace(drawn, m=given.m, wdf=given.wdf, k=given.k)
    if case == "worn":
        c = wide_baja().c
        drawn = replace(drawn, c=(_WORN * c[0], *c[1:]))
    road = TERRAINS[terrain](seed)
    right = TERRAINS[terrain](seed + 10_000) if terrain == "rough" else shifted(road, 0.6)
    run = wide_drive(drawn, (road, right), DEFAULT_SPEEDS[terrain], 400.0, 2.5, seed)
    recording = Recording(
        run.time, run.channels, ("m/s^2",) * 7, (), f"{terrain}-{seed}", channels=ROLL_CHANNELS
    )
    found = estimate([recording], vehicle, seed=seed, car="roll")
    row: dict[str, Any] = {
        "case": case, "terrain": terrain, "seed": seed, "verdict": found.verdict,
        "seconds": round(found.seconds, 2),
    }  # fmt: skip
    if found.draws:
        row["effective"] = round(min(found.ess_bulk_min, found.ess_tail_min))
        row["answers"] = _scored(found, drawn)
    return row


def _scored(found: EstimationResult, car: WideCar) -> dict[str, list[float]]:
    """Truth, bounds of the interval, and standard score of each answer."""
    truth = {
        **dict(zip(("c_fl", "c_fr", "c_rl", "c_rr"), car.c, strict=True)),
        "i": car.i, "i_roll": car.i_roll,
        "ratio_f": car.c[0] / car.c[1], "ratio_r": car.c[2] / car.c[3],
    }  # fmt: skip
    value = {name: x.ravel() for name, x in found.draws.items()}
    value["ratio_f"] = value["c_fl"] / value["c_fr"]
    value["ratio_r"] = value["c_rl"] / value["c_rr"]
    rows = {}
    for name in _ANSWERS:
        logs = np.log(value[name])
        low, high = np.quantile(value[name], [0.025, 0.975])
        score = (logs.mean() - math.log(truth[name])) / logs.std()
        rows[name] = [float(f"{x:.6g}") for x in (truth[name], low, high, score)]
    return rows


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Coverage with Clopper and Pearson's 95 % interval, rms score and width, by answer."""
    told = [row for row in rows if row["verdict"] == "ok"]
    out: dict[str, Any] = {"runs": len(rows), "answered": len(told)}
    for name in _ANSWERS:
        table = np.array([row["answers"][name] for row in told])
        inside = int(np.sum((table[:, 1] <= table[:, 0]) & (table[:, 0] <= table[:, 2])))
        out[name] = _share(inside, len(told)) | {
            "rms_score": round(float(np.sqrt(np.mean(table[:, 3] ** 2))), 3),
            "median_half_width_percent": round(
                float(np.median(50.0 * (table[:, 2] - table[:, 1]) / table[:, 0])), 3
            ),
        }
    return out


def _share(hits: int, count: int) -> dict[str, Any]:
    low = float(beta.ppf(0.025, hits, count - hits + 1)) if hits else 0.0
    high = float(beta.ppf(0.975, hits + 1, count - hits)) if hits < count else 1.0
    return {"covered": hits / count, "interval95": [round(low, 4), round(high, 4)]}


def _found(rows: list[dict[str, Any]]) -> Mapping[str, Any]:
    """How often a front left damper at 80 % is told: below nominal, and below the right one."""
    nominal = wide_baja().c[0]
    told = [row["answers"] for row in rows if row["verdict"] == "ok"]
    return {
        "below_nominal": sum(a["c_fl"][2] < nominal for a in told),
        "below_the_right_one": sum(a["ratio_f"][2] < 1.0 for a in told),
        "of": len(rows),
    }


def _cars() -> dict[str, Vehicle]:
    """Nominal car of each case."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "car.toml"
        cars = {}
        for name, sds in (("declared", None), ("exact", {}), ("worn", None)):
            path.write_text(wide_toml(wide_baja(), sds), encoding="utf-8")
            cars[name] = read_vehicle(path)
    return cars


def _write(document: dict[str, Any]) -> None:
    """Sum up and write what there is."""
    for case in ("declared", "exact", "worn"):
        rows = [row for row in document["rows"] if row["case"] == case]
        if rows:
            document["cases"][case] = summary(rows)
            if case == "worn":
                document["cases"][case]["told"] = _found(rows)
    RESULTS.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def main(count: int) -> None:
    """Run all cases and write the results after each."""
    cars = _cars()
    document: dict[str, Any] = {
        "command": f"python -m benchmarks.rolling {count}",
        "commit": current_commit(),
        "version": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "cases": {},
        "rows": [],
    }
    for case in ("declared", "exact"):
        document["rows"] += _runs(case, count, cars[case])
        _write(document)


def _runs(case: str, count: int, vehicle: Vehicle) -> list[dict[str, Any]]:
    rows = []
    for k in range(count):
        for j, terrain in enumerate(_TERRAINS):
            rows.append(one_run(case, terrain, _FIRST[case] + 4 * k + j, vehicle))
            print(case, terrain, rows[-1]["verdict"], rows[-1]["seconds"], flush=True)
    return rows


def worn(count: int) -> None:
    """Add the worn car's drives to the last results, in place of those that are there."""
    document = json.loads(RESULTS.read_text(encoding="utf-8"))
    rows = [row for row in document["rows"] if row["case"] != "worn"]
    document["rows"] = rows + _runs("worn", count, _cars()["worn"])
    _write(document)


def again() -> None:
    """Repeat the runs of the last results that gave no answer."""
    document = json.loads(RESULTS.read_text(encoding="utf-8"))
    cars = _cars()
    for k, row in enumerate(document["rows"]):
        if row["verdict"] != "ok":
            new = one_run(row["case"], row["terrain"], row["seed"], cars[row["case"]])
            document["rows"][k] = {**new, "repeated_after": row["verdict"]}
            print(row["case"], row["terrain"], row["verdict"], "now", new["verdict"], flush=True)
    _write(document)


if __name__ == "__main__":
    if sys.argv[1:] == ["again"]:
        again()
    elif sys.argv[1:2] == ["worn"]:
        worn(int(sys.argv[2]))
    else:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else 25)
