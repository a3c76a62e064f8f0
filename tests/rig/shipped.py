"""Make the shipped recordings again: ``python -m tests.rig.shipped``."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from .car import RigCar, baja, with_terms
from .files import write_csv, write_truth
from .laws import AsymmetricDamper
from .run import drive
from .sensors import Adc, SensorSpec, draw_biases
from .terrain import DEFAULT_SPEEDS, TERRAINS
from .units import INCH

__all__ = ["main"]

FOLDER = Path(__file__).resolve().parents[2] / "data" / "recordings"
SEED = 2008

# One car for all runs: its front damper has lost a fifth, its rear damper is as new, and it
# pitches a little more slowly than was thought. Given values are off by what is declared.
CAR = replace(
    baja(),
    c_f=0.80 * baja().c_f,
    c_r=1.02 * baja().c_r,
    i=1.07 * baja().i,
    m=1.006 * baja().m,
    wdf=1.004 * baja().wdf,
    k_f=0.97 * baja().k_f,
    k_r=1.02 * baja().k_r,
)

# The same car after a change of valves: the front damper resists extension half as much again as
# compression, at the same mean rate.
VALVED = with_terms(CAR, "front", AsymmetricDamper(CAR.c_f, 1.5), damper=False)

# The sensors that data/vehicles/baja2008.toml declares.
SENSORS = SensorSpec(
    noise=(0.855 * INCH, 0.513 * INCH, 0.855 * INCH, 0.513 * INCH),
    adc=Adc(scale=(5.945 * INCH, 2.470 * INCH, 5.991 * INCH, 2.455 * INCH)),
)

# name, car, terrain, rate (Hz), seconds, in counts
RUNS: tuple[tuple[str, RigCar, str, float, float, bool], ...] = (
    ("stops-400hz", CAR, "stops", 400.0, 2.0, False),
    ("stops-800hz", CAR, "stops", 800.0, 1.5, True),
    ("bump-400hz", CAR, "bump", 400.0, 2.0, False),
    ("rough-400hz", CAR, "rough", 400.0, 2.5, False),
    ("valved-bump-400hz", VALVED, "bump", 400.0, 2.0, False),
    ("valved-stops-400hz", VALVED, "stops", 400.0, 2.0, False),
)


def main() -> int:
    """Write recordings and, beside them, the truth; return the exit status."""
    for k, (name, car, terrain, rate, seconds, counts) in enumerate(RUNS):
        rng = np.random.default_rng([SEED, k])
        sensors = draw_biases(SENSORS, rng, 4.0 * INCH)
        road_seed, run_seed = (int(value) for value in rng.integers(2**31, size=2))
        where = TERRAINS[terrain](road_seed)
        run = drive(car, where, DEFAULT_SPEEDS[terrain], rate, seconds, sensors, run_seed)
        note = f"{terrain}, simulated by tests/rig, seed {SEED}"
        write_csv(run, FOLDER / f"{name}.csv", note=note, counts=counts)
        write_truth(run, FOLDER / f"{name}.truth.json")
    return 0


if __name__ == "__main__":
    sys.exit(main())
