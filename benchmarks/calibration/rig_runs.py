"""Drives of the rig for a cell: recording, vehicle as declared, and the truth beside them."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle, read_vehicle
from bayes_asv.models.half_car_equations import HalfCar
from benchmarks.calibration.cells import MODEL, TERRAIN_NAMES, Cell
from tests.rig import (
    DECLARED_SDS,
    DEFAULT_SPEEDS,
    TERRAINS,
    Engine,
    Motion,
    RigRun,
    SensorSpec,
    baja,
    draw,
    draw_biases,
    drive,
    vehicle_toml,
)

__all__ = ["Case", "declared_vehicle", "drive_cell"]

Array = NDArray[np.float64]

_EXACT = dict.fromkeys(DECLARED_SDS, 0.0)
_ENGINE_HZ = (25.0, 45.0)
_ENGINE_SEEDS = 2**31
_JITTER, _DROPPED, _BURST = 3e-4, 0.05, 2  # s, share of rows, rows at a time
_CLOCK_PPM = 50.0  # one deviation of a ceramic resonator or a poor crystal
_MOST_CLIPPED = 5  # samples of the true motion beyond a rail


@dataclass(frozen=True)
class Case:
    """One drive and everything that is true about it.

    Parameters
    ----------
    recording : Recording
        What a logger wrote.
    vehicle : Vehicle
        What the team says.
    car : (8,) array
        The true car in the order of :class:`bayes_asv.models.half_car_equations.HalfCar`, SI.
    sensors : SensorSpec
        The true sensors.
    motion : Motion
        What truly happened, 16 000 times a second.
    clipped : int
        Readings at a rail.
    """

    recording: Recording
    vehicle: Vehicle
    car: Array
    sensors: SensorSpec
    motion: Motion
    clipped: int


def drive_cell(cell: Cell, seed: int, run: int) -> Case:
    """Drive one run of a cell.

    Parameters
    ----------
    cell : Cell
        What kind of drive.
    seed, run : int
        Of the bench, and which run; the same pair gives the same drive.

    Returns
    -------
    Case
    """
    rng = cell.random(seed, run)
    terrain = TERRAIN_NAMES[run % len(TERRAIN_NAMES)] if cell.terrain == MODEL else cell.terrain
    car = draw(baja(), rng, _EXACT if cell.exact else DECLARED_SDS)
    sensors = draw_biases(_scaled(_sensors(cell), cell.misstated), rng)
    metadata: tuple[tuple[str, str], ...] = ()
    if cell.clocks:
        sensors, metadata = _own_clocks(sensors, cell.rate, rng)
    forces = []
    if cell.engine:
        frequency = float(rng.uniform(*_ENGINE_HZ))
        forces.append(Engine(frequency=frequency, seed=int(rng.integers(_ENGINE_SEEDS))))
    road_seed, run_seed = (int(v) for v in rng.integers(2**31, size=2))
    done = drive(
        car, TERRAINS[terrain](road_seed), DEFAULT_SPEEDS[terrain], cell.rate, cell.seconds,
        sensors, run_seed, forces=forces, keep_motion=True,
    )  # fmt: skip
    vehicle = declared_vehicle(cell)
    values = done.channels
    clipped = int(np.count_nonzero(done.clipped))
    if cell.clipped:
        low, high = _rails(done, sensors, rng)
        vehicle = _with_ranges(vehicle, low, high)
        values = np.clip(values, low[:, None], high[:, None])
        clipped = int(np.count_nonzero((values <= low[:, None]) | (values >= high[:, None])))
    name = f"{cell.name}-{run}.csv"
    recording = Recording(done.time, values, ("m/s^2",) * 4, metadata, name)
    assert done.motion is not None
    truth = np.array([getattr(car, field) for field in HalfCar._fields])
    return Case(recording, vehicle, truth, sensors, done.motion, clipped)


@lru_cache(maxsize=32)
def declared_vehicle(cell: Cell) -> Vehicle:
    """Vehicle file of a cell: the nominal baja, its deviations and its sensors' data sheet."""
    sds = _EXACT if cell.exact else DECLARED_SDS
    # Recordings are drawn from the model only where the car has a prior that cars can have.
    priors = {"c_f": 0.3, "c_r": 0.3, "i": 0.2} if cell.terrain == MODEL else None
    text = vehicle_toml(baja(), _sensors(cell), sds, nominal_sds=priors)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "car.toml"
        path.write_text(text, encoding="utf-8")
        return replace(read_vehicle(path), source="car.toml")


def _sensors(cell: Cell) -> SensorSpec:
    """Sensors as the data sheets describe them."""
    spec = _scaled(SensorSpec(), cell.noise)
    if cell.white:
        spec = replace(spec, noise_kind="white")
    if cell.uneven:
        spec = replace(spec, jitter=_JITTER, dropped=_DROPPED, burst=_BURST)
    return spec


def _scaled(spec: SensorSpec, factor: float) -> SensorSpec:
    a, b, c, d = (factor * level for level in spec.noise)
    return replace(spec, noise=(a, b, c, d))


def _own_clocks(
    spec: SensorSpec, rate: float, rng: np.random.Generator
) -> tuple[SensorSpec, tuple[tuple[str, str], ...]]:
    """Give each board a clock, and say so in the recording as the laptop that merged them would.

    A board of the rig samples at t (1 + p) + offset when its row says t; a recording says that
    a clock runs fast by e, and that its rows belong to t / (1 + e) + delay.
    """
    front, rear = (float(p) for p in _CLOCK_PPM * rng.standard_normal(2))
    offset = float(rng.uniform(0.0, 1.0 / rate))
    spec = replace(spec, clock_ppm=(front, rear), clock_offset=(0.0, offset))
    metadata = [
        (f"clock {board}", f"{1e6 * (1.0 / (1.0 + 1e-6 * ppm) - 1.0):.6f} ppm")
        for board, ppm in (("front", front), ("rear", rear))
    ]
    metadata += [
        (f"delay {channel}", f"{offset + spec.delay[j]:.9f} s")
        for j, channel in ((2, "rear_wheel"), (3, "rear_chassis"))
    ]
    return spec, tuple(metadata)


def _with_ranges(vehicle: Vehicle, low: Array, high: Array) -> Vehicle:
    sensors = {
        name: replace(vehicle.sensor(name), low=float(a), high=float(b))
        for name, a, b in zip(CHANNELS, low, high, strict=True)
    }
    return replace(vehicle, sensors={**vehicle.sensors, **sensors})


def _rails(run: RigRun, spec: SensorSpec, rng: np.random.Generator) -> tuple[Array, Array]:
    """Rails (4,) and (4,), m/s², on the converter's steps, beyond which a few samples lie.

    They follow from the true motion and not from the readings: a rail set by these would know
    something about their noise.
    """
    assert spec.adc is not None
    ends = []
    for channel, clean in enumerate(run.clean):
        scale, zero = spec.adc.scale[channel], spec.adc.zero[channel]
        ordered = np.sort(clean + spec.bias[channel])
        beyond = rng.integers(0, _MOST_CLIPPED + 1, size=2)
        counts = np.rint(ordered[[beyond[0], -1 - beyond[1]]] / scale + zero)
        ends.append((counts - zero) * scale)
    low, high = np.array(ends).T
    return low, high
