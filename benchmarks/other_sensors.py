"""Coverage of 95 % intervals with suspension potentiometers, and with an inertial unit on the body.

Cars are drawn about the baja of the rig and driven there; wheel hubs carry the accelerometers of
the rig's logger.  The first set measures both suspension deflections, the second vertical
acceleration and pitch rate at one place of the body.  Given values are exact on every other drive
and have the deviations that the vehicle file declares on the others.
``python -m benchmarks.other_sensors`` writes ``benchmarks/results/other_sensors.json``; it resumes
where it was stopped.
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
from scipy.stats import binomtest

from bayes_asv.domain.channels import channel
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Sensor, Vehicle, read_vehicle
from bayes_asv.estimation import estimate
from benchmarks.provenance import current_commit
from tests.rig import (
    DECLARED_SDS,
    DEFAULT_SPEEDS,
    TERRAINS,
    RigCar,
    RigRun,
    SensorSpec,
    baja,
    draw,
    draw_biases,
    drive,
    vehicle_toml,
)
from tests.rig.motion import lagrange
from tests.rig.sensors import low_pass

__all__ = ["main"]

RESULTS = Path(__file__).parent / "results" / "other_sensors.json"
TERRAIN_NAMES = ("bump", "stops", "rough")
NAMES = ("c_f", "c_r", "i")
PLACE = 0.6  # m ahead of the rear axle
POTENTIOMETER = Sensor(noise=0.0003, resolution=0.0001)  # m
ACCELEROMETER = Sensor(noise=0.03, bandwidth=50.0)  # m/s²
GYROSCOPE = Sensor(noise=0.004)  # rad/s
SETS = {
    "travel": {"front_travel": POTENTIOMETER, "rear_travel": POTENTIOMETER},
    "imu": {"body_vertical": ACCELEROMETER, "body_pitch_rate": GYROSCOPE},
}

Array = NDArray[np.float64]


def travel(run: RigRun, car: RigCar, rng: np.random.Generator) -> Array:
    """Read potentiometers at both suspensions (2, n), m, each with a zero of its own."""
    noise = float(POTENTIOMETER.noise or 0.0) * rng.standard_normal(run.deflection.shape)
    zero = 0.03 * rng.standard_normal((2, 1))
    step = float(POTENTIOMETER.resolution or 0.0)
    return np.asarray(np.rint((run.deflection + zero + noise) / step) * step)


def inertial_unit(run: RigRun, car: RigCar, rng: np.random.Generator) -> Array:
    """Read vertical acceleration at `PLACE`, m/s², and pitch rate, rad/s, (2, n)."""
    motion = run.motion
    assert motion is not None
    front, rear = motion.acceleration[1], motion.acceleration[3]
    bandwidth = float(ACCELEROMETER.bandwidth or np.inf)
    vertical = low_pass(rear + (front - rear) * PLACE / car.l, motion.step, bandwidth)
    at = (run.time - motion.t_start) / motion.step
    sampled = lagrange(np.stack([vertical, motion.states[:, 5]]), at)
    decay = float(np.exp(-2.0 * np.pi * bandwidth / run.rate))
    white = rng.standard_normal((2, len(run.time)))
    filtered = white[0].copy()
    for k in range(1, len(filtered)):
        filtered[k] = decay * filtered[k - 1] + np.sqrt(1.0 - decay**2) * white[0, k]
    noise = np.stack(
        [float(ACCELEROMETER.noise or 0.0) * filtered, float(GYROSCOPE.noise or 0.0) * white[1]]
    )
    return np.asarray(sampled + noise + np.array([[0.3], [0.02]]) * rng.standard_normal((2, 1)))


READ = {"travel": travel, "imu": inertial_unit}


def declared(folder: Path, sensors: dict[str, Sensor], sds: dict[str, float]) -> Vehicle:
    """Return the vehicle file of the rig with the further sensors."""
    path = folder / "car.toml"
    path.write_text(vehicle_toml(baja(), SensorSpec(), sds), encoding="utf-8")
    given = read_vehicle(path)
    unit = replace(channel("body_vertical"), position=PLACE)
    return replace(given, sensors={**given.sensors, **sensors}, channels=(unit,))


def one(which: str, seed: int) -> dict[str, Any]:
    """Drive one car and hold its intervals against the truth."""
    terrain = TERRAIN_NAMES[seed % len(TERRAIN_NAMES)]
    rng = np.random.default_rng([seed, sorted(SETS).index(which), 2026])
    sds = dict(DECLARED_SDS) if seed % 2 else dict.fromkeys(DECLARED_SDS, 0.0)
    car = draw(baja(), rng, sds)
    sensors = draw_biases(SensorSpec(), rng)
    road, noise = (int(v) for v in rng.integers(2**31, size=2))
    run = drive(
        car, TERRAINS[terrain](road), DEFAULT_SPEEDS[terrain], 400.0, 2.0, sensors, noise,
        keep_motion=True,
    )  # fmt: skip
    names = tuple(SETS[which])
    units = {"acceleration": "m/s^2", "angular_rate": "rad/s", "deflection": "m"}
    recording = Recording(
        time=run.time,
        values=np.vstack([run.channels[[0, 2]], READ[which](run, car, rng)]),
        units=("m/s^2", "m/s^2", *(units[channel(name).quantity] for name in names)),
        source=f"{terrain} {seed}",
        channels=("front_wheel", "rear_wheel", *names),
    )
    with tempfile.TemporaryDirectory() as folder:
        result = estimate([recording], declared(Path(folder), SETS[which], sds), seed=seed)
    out: dict[str, Any] = {"seed": seed, "terrain": terrain, "verdict": result.verdict}
    if result.verdict == "refused":
        return out | {"reasons": list(result.reasons)}
    for name in NAMES:
        draws, true = result.draws[name], float(getattr(car, name))
        low, high = np.quantile(draws, [0.025, 0.975])
        out[name] = {
            "inside": bool(low <= true <= high),
            "error": float(draws.mean() / true - 1.0),
            "sd": float(draws.std() / true),
        }
    return out


def summary(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Coverage with its 95 % interval, median error and median deviation of each parameter."""
    answered = [run for run in runs if run["verdict"] != "refused"]
    out: dict[str, Any] = {"runs": len(runs), "refused": len(runs) - len(answered)}
    for name in NAMES:
        hits = sum(run[name]["inside"] for run in answered)
        interval = binomtest(hits, len(answered)).proportion_ci(method="exact")
        out[name] = {
            "coverage": hits / len(answered),
            "coverage_interval": [float(interval.low), float(interval.high)],
            "median_error": float(np.median([abs(run[name]["error"]) for run in answered])),
            "median_sd": float(np.median([run[name]["sd"] for run in answered])),
        }
    return out


def main() -> int:
    """Run what is left and write the summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--set", choices=sorted(SETS), action="append")
    arguments = parser.parse_args()
    done = json.loads(RESULTS.read_text("utf-8")) if RESULTS.exists() else {}
    commit = current_commit()
    for which in arguments.set or sorted(SETS):
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
