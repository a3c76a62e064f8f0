"""Standard deviations that ``bayes-asv plan`` predicts, compared with estimates on the rig.

The rig shares no code with the plan: its own tyres, tyre envelope, integrator, sensors.  Three
parts, all with cars and tyres that the plan does not know:

*widths*  Drives drawn from the plan's own grid, driven by the rig and estimated by
``best_fit`` and ``importance``: posterior standard deviation over the predicted one, and over the
prediction with the true tyre rate and unsprung mass.

*errors*  A few drives many times with cars drawn anew: root mean square of the true error over
the predicted standard deviation.

*information*  The plan's formula on the rig's own recordings at the true car, so that nothing
about motion is assumed: posterior deviation over the formula's.

``python -m benchmarks.plan`` writes ``benchmarks/results/plan.json`` and ``docs/plan.png``.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv import __version__
from bayes_asv.domain.channels import CHANNELS, channel
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle, read_vehicle
from bayes_asv.models.cars import car_model
from bayes_asv.planning.drives import KINDS, RATES, Drive, RoadProfile
from bayes_asv.planning.evaluation import MeasuredCar, evaluate, measured_car
from bayes_asv.planning.measurement import with_default_noise
from bayes_asv.planning.plan import plan
from bayes_asv.planning.predicted_sd import predicted_sd
from bayes_asv.planning.ride_simulation import Pass, default_tyres, simulate_passes
from bayes_asv.posterior.importance import importance_sample
from bayes_asv.posterior.information import fisher_information
from bayes_asv.posterior.map_fit import MapFit, best_fit
from bayes_asv.preprocessing.run_preparation import prepare_runs
from benchmarks.plan_cars import CARS, chance_car
from benchmarks.plan_picture import draw_picture
from benchmarks.provenance import current_commit
from tests.rig import (
    DECLARED_SDS,
    SPREADS,
    RigCar,
    SensorSpec,
    Terrain,
    baja,
    bump,
    draw,
    draw_biases,
    drive,
    parking_stops,
    rollers,
    rough_road,
    vehicle_toml,
)

__all__ = [
    "KNOWLEDGE",
    "main",
    "posterior",
    "predict",
    "rig_terrain",
    "vehicle_of",
]

Array = NDArray[np.float64]
Row = dict[str, Any]

RESULTS = Path(__file__).parent / "results" / "plan.json"
EXACT = dict.fromkeys(DECLARED_SDS, 0.0)
KNOWLEDGE: Mapping[str, Mapping[str, float]] = {"exact": EXACT, "declared": DECLARED_SDS}
PARAMETERS = ("c_f", "c_r", "i", "k_g")
WANT = dict.fromkeys(PARAMETERS, 0.05)
_DRAWS = 512
_INCH = 0.0254


def vehicle_of(car: RigCar, sds: Mapping[str, float]) -> Vehicle:
    """Vehicle file of a nominal car with the rig's usual sensors."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "car.toml"
        path.write_text(vehicle_toml(car, SensorSpec(), sds), encoding="utf-8")
        return replace(read_vehicle(path), source="car.toml")


def rig_terrain(road: RoadProfile, seed: int) -> Terrain:
    """Lay the plan's ground on the rig's road."""
    built = {
        "bump": lambda: bump(road.height, road.length),
        "stops": lambda: parking_stops(road.height, road.length),
        "rollers": lambda: rollers(road.height, road.length, road.count),
        "rough": lambda: rough_road(seed, road.iso),
    }[road.kind]()
    return replace(built, lead_in=0.5)


def rig_recording(car: RigCar, planned: Drive, seed: int) -> Recording:
    """Drive the rig over the plan's ground, with biases of its own."""
    rng = np.random.default_rng([seed, 77])
    sensors = draw_biases(SensorSpec(), rng)
    road, run = (int(v) for v in rng.integers(2**31, size=2))
    where = rig_terrain(planned.road, road)
    done = drive(car, where, planned.speed, planned.rate, planned.seconds, sensors, run)
    return Recording(done.time, done.channels / _INCH, ("in/s^2",) * 4, (), f"run-{seed}.csv")


def fitted(car: RigCar, vehicle: Vehicle, planned: Drive, seeds: Sequence[int]) -> MapFit | None:
    """Mode of the posterior of rig runs; None when they are refused."""
    runs = [rig_recording(car, planned, seed) for seed in seeds]
    lines, reasons, _ = prepare_runs(runs, vehicle)
    if reasons:
        return None
    found = best_fit(lines, vehicle)
    return None if found.reasons else found


def error(car: RigCar, found: MapFit) -> Array:
    """Relative error (4,) of the mode."""
    c_f, c_r, i, m, *_ = found.space.cars(found.mode.z[None])[0]
    truth = np.array([getattr(car, name) for name in PARAMETERS])
    return np.asarray(np.array([c_f, c_r, i, np.sqrt(i / m)]) / truth - 1.0)


def posterior(car: RigCar, vehicle: Vehicle, planned: Drive, seeds: Sequence[int]) -> Array | None:
    """Relative posterior deviations (4,) of rig runs; None when they are refused."""
    found = fitted(car, vehicle, planned, seeds)
    if found is None:
        return None
    draws = importance_sample(found.posterior, found.mode, _DRAWS, seeds[0])
    value = found.space.quantities(draws.z, seeds[0])
    mean = np.array([draws.mean(value[name]) for name in PARAMETERS])
    sd = np.array([draws.sd(value[name]) for name in PARAMETERS])
    return np.asarray(sd / mean)


def half_car(vehicle: Vehicle) -> MeasuredCar:
    """Half car of a vehicle with its four accelerometers."""
    channels = [channel(name) for name in CHANNELS]
    noisy, _ = with_default_noise(vehicle, channels)
    return measured_car(noisy, car_model("half", vehicle), channels)


def predicted(information: Array, passes: int, vehicle: Vehicle) -> Array:
    """Predicted sd (4,) of a half car."""
    found = predicted_sd(information, passes, half_car(vehicle).about)
    return np.array([found[name] for name in PARAMETERS])


def predict(
    vehicle: Vehicle, planned: Drive, passes: int, seed: int, tyres: RigCar | None = None
) -> Array | None:
    """Predicted sd (4,) of one drive, with a car's tyres if given; None when not usable."""
    measured = half_car(vehicle)
    roads = 2 if planned.road.kind == "rough" else 1
    passes_ = [Pass(planned.road, planned.speed, planned.seconds, seed + k) for k in range(roads)]
    below = default_tyres(measured.car)
    if tyres is not None:
        rate, unsprung = 0.5 * (tyres.k_tf + tyres.k_tr), 0.5 * (tyres.m_uf + tyres.m_ur)
        below = default_tyres(measured.car, rate, unsprung)
    motions = simulate_passes(measured.car, below, passes_, measured.channels)
    (evaluation,) = evaluate(measured, [planned], motions, seed)
    return predicted(evaluation.information, passes, vehicle) if evaluation.usable else None


def width_rows(each: int, cars: int, seed: int) -> tuple[list[Row], int, int]:
    """Predicted and posterior sd on drives of the grid; also how many were tried and refused.

    Parameters
    ----------
    each : int
        Drives of each kind of road and car with exact given values, and half as many with
        declared ones, at two rates drawn for each car.
    cars : int
        Cars of chance beside the named ones.
    seed : int
        Of everything.
    """
    rows: list[Row] = []
    tried = refused = 0
    chance = {f"chance {k}": chance_car(seed + k) for k in range(cars)}
    named = {name: make() for name, make in CARS.items()}
    for place, (name, nominal) in enumerate({**named, **chance}.items()):
        rng = np.random.default_rng([seed, place])
        rates = sorted(rng.choice(RATES, 2, replace=False).tolist())
        made = plan(vehicle_of(nominal, EXACT), WANT, rates=rates, seed=seed)
        usable = [one for one in made.rated if one.evaluation.usable]
        for knowledge, sds in KNOWLEDGE.items():
            vehicle = vehicle_of(nominal, sds)
            for kind in KINDS:
                count = each if knowledge == "exact" else (each + 1) // 2
                cell = [one for one in usable if one.evaluation.drive.road.kind == kind]
                for _ in range(count if cell else 0):
                    one = cell[int(rng.integers(len(cell)))]
                    # every other car is another one than nominal, as cars are
                    other = bool(rng.integers(2))
                    passes = (1, 1, 3)[int(rng.integers(3))]
                    car = draw(nominal, rng, sds, SPREADS if other else {})
                    first = int(rng.integers(2**31))
                    drive = one.evaluation.drive
                    got = posterior(car, vehicle, drive, [first + k for k in range(passes)])
                    tried += 1
                    if got is None:
                        refused += 1
                        continue
                    promised = predicted(one.evaluation.information, passes, vehicle)
                    informed = predict(vehicle, drive, passes, seed, nominal)
                    rows.append(
                        {
                            "car": name, "drawn": other, "knowledge": knowledge, "road": kind,
                            "height": drive.road.height, "length": drive.road.length,
                            "iso": drive.road.iso, "speed": drive.speed, "rate": drive.rate,
                            "passes": passes, "gentle": one.evaluation.gentle, "seed": first,
                            "promised": promised.tolist(), "posterior": got.tolist(),
                            "ratio": (got / promised).tolist(),
                            "ratio_told": None if informed is None else (got / informed).tolist(),
                        }
                    )  # fmt: skip
        print(f"{name}: {len(rows)} rows", file=sys.stderr, flush=True)
    return rows, tried, refused


# Drives of the second and third part: shapes and speeds of the rig's own defaults.
_CLASSIC = {
    "bump": Drive(RoadProfile("bump", 3.5 * _INCH, 1.5, 1), 4.47, 400.0, 2.2),
    "stops": Drive(RoadProfile("stops", 3.0 * _INCH, 12.0 * _INCH, 2), 2.24, 400.0, 2.6),
    "rollers": Drive(RoadProfile("rollers", 2.25 * _INCH, 1.4, 8), 3.58, 400.0, 4.6),
    "rough": Drive(RoadProfile("rough", iso="D"), 5.36, 400.0, 2.5),
}


def error_rows(runs: int, seed: int) -> list[Row]:
    """Root mean square error over predicted sd, with a new car in each drive."""
    rows: list[Row] = []
    for knowledge, sds in KNOWLEDGE.items():
        vehicle = vehicle_of(baja(), sds)
        for kind, planned in _CLASSIC.items():
            promised = predict(vehicle, planned, 1, seed)
            assert promised is not None, kind
            errors = []
            for k in range(runs):
                rng = np.random.default_rng([seed, k, KINDS.index(kind)])
                car = draw(baja(), rng, sds)
                found = fitted(car, vehicle, planned, [int(rng.integers(2**31))])
                if found is not None:
                    errors.append(error(car, found))
            rms = np.sqrt(np.mean(np.square(errors), axis=0))
            rows.append(
                {
                    "knowledge": knowledge, "road": kind, "runs": len(errors), "tried": runs,
                    "promised": promised.tolist(), "rms_error": rms.tolist(),
                    "ratio": (rms / promised).tolist(),
                }
            )  # fmt: skip
            print(rows[-1], file=sys.stderr, flush=True)
    return rows


def information_rows(runs: int, seed: int) -> list[Row]:
    """Posterior deviation over the formula's, both from one rig recording at its true car."""
    rows: list[Row] = []
    vehicle = vehicle_of(baja(), EXACT)
    for rate in RATES:
        ratios = []
        for kind, planned in _CLASSIC.items():
            at = planned._replace(rate=rate)
            for k in range(runs):
                rng = np.random.default_rng([seed, k, KINDS.index(kind), int(rate)])
                car, first = draw(baja(), rng, EXACT), int(rng.integers(2**31))
                got = posterior(car, vehicle, at, [first])
                if got is None:
                    continue
                true = vehicle_of(car, EXACT)
                lines, _, _ = prepare_runs([rig_recording(car, at, first)], true)
                about = half_car(true).about
                formula = predicted(fisher_information(lines[0], true, about), 1, true)
                ratios.append(got / formula)
        found = np.array(ratios)
        rows.append(
            {
                "rate": rate, "recordings": len(found), "mean": found.mean(axis=0).tolist(),
                "sd": found.std(axis=0).tolist(), "least": found.min(axis=0).tolist(),
                "largest": found.max(axis=0).tolist(),
            }
        )  # fmt: skip
        print(rows[-1], file=sys.stderr, flush=True)
    return rows


def summarise(rows: Sequence[Row]) -> dict[str, Any]:
    """Distribution of ratios: all four answers of all rows together, and by group."""

    def numbers(some: Sequence[Row], key: str = "ratio") -> dict[str, Any]:
        ratio = np.array([row[key] for row in some if row[key] is not None])
        inside = (ratio > 1.0 / 1.5) & (ratio < 1.5)
        low, five, middle, ninety, high = np.quantile(ratio, [0.0, 0.05, 0.5, 0.95, 1.0])
        return {
            "drives": len(ratio), "median": float(middle),
            "quantiles_5_95": [float(five), float(ninety)],
            "range": [float(low), float(high)], "within_1.5": float(inside.mean()),
            "drives_within_1.5": float(inside.all(axis=1).mean()),
        }  # fmt: skip

    out: dict[str, Any] = {}
    for knowledge in KNOWLEDGE:
        mine = [row for row in rows if row["knowledge"] == knowledge]
        if not mine:
            continue
        out[knowledge] = {"all": numbers(mine), "tyres_told": numbers(mine, "ratio_told")}
        nominal = [row for row in mine if not row["drawn"]]
        out[knowledge]["tyres_told_car_as_nominal"] = numbers(nominal, "ratio_told")
        for key in ("road", "rate", "passes", "car", "gentle", "drawn"):
            out[knowledge][key] = {
                str(value): numbers([row for row in mine if row[key] == value])
                for value in dict.fromkeys(row[key] for row in mine)
            }
    return out


def main() -> int:
    """Run all parts and write the results; return the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--each", type=int, default=2, help="drives of a car and kind of road")
    parser.add_argument("--cars", type=int, default=10, help="cars of chance beside the named")
    parser.add_argument("--runs", type=int, default=40, help="runs a drive for the errors")
    parser.add_argument("--recordings", type=int, default=4, help="a road and rate for the formula")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    commit = current_commit()
    began = time.perf_counter()
    rows, tried, refused = width_rows(given.each, given.cars, given.seed)
    errors = error_rows(given.runs, given.seed)
    formula = information_rows(given.recordings, given.seed)
    about = {
        "commit": commit,
        "version": __version__,
        "python": platform.python_version(),
        "packages": {name: metadata.version(name) for name in ("numpy", "scipy", "numba")},
        "cores": os.cpu_count(),
        "seed": given.seed,
        "seconds": time.perf_counter() - began,
        "answers": list(PARAMETERS),
    }
    summary = {"tried": tried, "refused_on_the_rig": refused, "widths": summarise(rows)}
    document = {
        "about": about, "summary": summary, "errors": errors, "information": formula, "rows": rows,
    }  # fmt: skip
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    draw_picture(plan(vehicle_of(baja(), DECLARED_SDS), WANT, rates=[400.0], seed=given.seed), rows)
    print(json.dumps(summary, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
