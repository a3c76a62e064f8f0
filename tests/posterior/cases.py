"""Rig drives as recordings and vehicles of the package."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle, read_vehicle
from bayes_asv.models.cars import car_model
from bayes_asv.preprocessing.prepare import prepare
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from tests.rig import (
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

INCH = 0.0254
EXACT = {"m": 0.0, "wdf": 0.0, "l": 0.0, "k_f": 0.0, "k_r": 0.0}
DECLARED = {"m": 0.01, "wdf": 0.01, "l": 0.0, "k_f": 0.05, "k_r": 0.05}


def vehicle(sds: dict[str, float], sensors: SensorSpec | None = None) -> Vehicle:
    """The nominal baja with declared deviations and sensors."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "car.toml"
        path.write_text(vehicle_toml(baja(), sensors or SensorSpec(), sds), encoding="utf-8")
        return replace(read_vehicle(path), source="car.toml")


def prepared(recording: Recording, vehicle: Vehicle, car: str = "half") -> PreparedRecording:
    """Put a recording in the form that a filter takes, for a car by name."""
    return prepare(recording, vehicle, car_model(car, vehicle))


def case(
    terrain: str,
    seed: int,
    sds: dict[str, float],
    rate: float = 400.0,
    seconds: float = 2.0,
    sensors: SensorSpec | None = None,
) -> tuple[RigCar, RigRun, Recording]:
    """One drive of a car drawn around the baja, with biases, delay and 10-bit steps."""
    rng = np.random.default_rng([seed, 45])
    car = draw(baja(), rng, sds)
    declared = draw_biases(sensors or SensorSpec(), rng)
    road_seed, run_seed = (int(v) for v in rng.integers(2**31, size=2))
    run = drive(
        car,
        TERRAINS[terrain](road_seed),
        DEFAULT_SPEEDS[terrain],
        rate,
        seconds,
        declared,
        run_seed,
    )
    return car, run, as_recording(run, f"{terrain}-{seed}.csv")


def as_recording(run: RigRun, name: str) -> Recording:
    """What a logger would have written, without the file."""
    return Recording(run.time, run.channels / INCH, ("in/s^2",) * 4, (), name)
