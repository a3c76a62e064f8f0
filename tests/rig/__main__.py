"""Make runs from the command line: ``python -m tests.rig --help``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .car import baja, draw, table51
from .files import vehicle_toml, write_csv, write_truth
from .forces import ChassisForce, Engine
from .run import drive
from .sensors import SensorSpec, draw_biases
from .terrain import DEFAULT_SPEEDS, TERRAINS
from .units import INCH, MPH

_CARS = {"baja": baja, "table51": table51}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m tests.rig",
        description="Drive a simulated half car with tyres and write recordings, a vehicle file "
        "and, apart from them, the answers.",
    )
    parser.add_argument("folder", type=Path, help="where to write; made if it is not there")
    parser.add_argument("-t", "--terrain", choices=sorted(TERRAINS), default="stops")
    parser.add_argument("-n", "--runs", type=int, default=1, help="number of runs (default 1)")
    parser.add_argument("--rate", type=float, default=400.0, help="rows a second (default 400)")
    parser.add_argument("--seconds", type=float, default=2.0, help="length (default 2)")
    parser.add_argument("--speed", type=float, help="mph (default: one that does not clip)")
    parser.add_argument("--seed", type=int, default=0, help="of everything (default 0)")
    parser.add_argument("--car", choices=sorted(_CARS), default="baja", help="the nominal car")
    parser.add_argument(
        "--draw",
        choices=("none", "once", "each"),
        default="once",
        help="the true car: nominal, drawn once for all runs (default), or anew for each run",
    )
    parser.add_argument("--bias", type=float, default=4.0, help="sd of biases, in/s^2 (default 4)")
    parser.add_argument("--engine", type=float, help="shake the chassis with this force, N")
    parser.add_argument("--counts", action="store_true", help="write counts instead of in/s^2")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the runs that the command line asks for; return the exit status."""
    given = _parser().parse_args(arguments)
    nominal = _CARS[given.car]()
    declared = SensorSpec()
    speed = DEFAULT_SPEEDS[given.terrain] if given.speed is None else given.speed * MPH
    answers = given.folder / "answers"
    answers.mkdir(parents=True, exist_ok=True)
    (given.folder / "vehicle.toml").write_text(vehicle_toml(nominal, declared), encoding="utf-8")
    shared = np.random.default_rng([given.seed, 0])
    drawn_once = draw(nominal, shared)
    for k in range(given.runs):
        # a stream a run: the tenth run is the same whether ten or a hundred are made
        rng = np.random.default_rng([given.seed, 1, k])
        own = draw(nominal, rng)
        car = {"none": nominal, "once": drawn_once, "each": own}[given.draw]
        sensors = draw_biases(declared, rng, given.bias * INCH)
        road_seed, engine_seed, run_seed = (int(value) for value in rng.integers(2**31, size=3))
        forces: list[ChassisForce] = []
        if given.engine is not None:
            forces.append(Engine(amplitude=given.engine, seed=engine_seed))
        run = drive(
            car,
            TERRAINS[given.terrain](road_seed),
            speed,
            given.rate,
            given.seconds,
            sensors,
            run_seed,
            forces=forces,
        )
        name = f"{given.terrain}-{given.rate:g}hz-{k:04d}"
        note = f"{given.terrain}, simulated, run {k}"
        write_csv(run, given.folder / f"{name}.csv", note=note, counts=given.counts)
        write_truth(run, answers / f"{name}.json")
    return 0


if __name__ == "__main__":
    sys.exit(main())
